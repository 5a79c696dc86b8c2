#include "doomgen/acs/parser.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "doomgen/acs/declarations.h"

namespace comrad::acs_compiler {
namespace {

constexpr int kNestingMax = 256;          // brackets and blocks inside each other
constexpr int32_t kTreeDepthMax = 1000;   // of an expression without brackets: a + b + c ...
constexpr int64_t kArraySizeMax = 65536;  // elements of all arrays of a program together
constexpr std::size_t kDimensionsMax = 8;
constexpr std::size_t kArgumentsMax = 64;
constexpr std::size_t kItemsMax = 256;
constexpr std::size_t kNodesMax = 4u << 20;
constexpr int32_t kScriptNumberMax = 32767;
constexpr std::size_t kParametersMax = 64;
constexpr std::size_t kScriptParametersMax = 4;

constexpr std::array<std::string_view, 4> kTypes = {"int", "bool", "str", "fixed"};
constexpr std::array<std::string_view, 28> kReserved = {
    "script",  "function", "special",  "world",  "global",    "static",  "if",
    "else",    "while",    "until",    "do",     "for",       "switch",  "case",
    "default", "break",    "continue", "return", "terminate", "suspend", "restart",
    "int",     "bool",     "str",      "fixed",  "void",      "goto",    "createtranslation"};

struct ScriptKind {
  std::string_view name;
  int32_t type;
  std::size_t parameters_max;
};
constexpr std::array<ScriptKind, 15> kScriptKinds = {{{"open", 1, 0},
                                                      {"respawn", 2, 0},
                                                      {"death", 3, 0},
                                                      {"enter", 4, 0},
                                                      {"pickup", 5, 0},
                                                      {"bluereturn", 6, 0},
                                                      {"redreturn", 7, 0},
                                                      {"whitereturn", 8, 0},
                                                      {"lightning", 12, 0},
                                                      {"unloading", 13, 0},
                                                      {"disconnect", 14, 1},
                                                      {"return", 15, 0},
                                                      {"event", 16, 3},
                                                      {"kill", 17, 0},
                                                      {"reopen", 18, 0}}};

struct BinaryOperator {
  std::string_view symbol;
  Operator op;
  int strength;
};
constexpr std::array<BinaryOperator, 18> kBinaryOperators = {{{"||", Operator::kOrLogical, 1},
                                                              {"&&", Operator::kAndLogical, 2},
                                                              {"|", Operator::kOr, 3},
                                                              {"^", Operator::kEor, 4},
                                                              {"&", Operator::kAnd, 5},
                                                              {"==", Operator::kEqual, 6},
                                                              {"!=", Operator::kNotEqual, 6},
                                                              {"<", Operator::kLess, 7},
                                                              {">", Operator::kGreater, 7},
                                                              {"<=", Operator::kLessOrEqual, 7},
                                                              {">=", Operator::kGreaterOrEqual, 7},
                                                              {"<<", Operator::kLeftShift, 8},
                                                              {">>", Operator::kRightShift, 8},
                                                              {"+", Operator::kAdd, 9},
                                                              {"-", Operator::kSubtract, 9},
                                                              {"*", Operator::kMultiply, 10},
                                                              {"/", Operator::kDivide, 10},
                                                              {"%", Operator::kModulus, 10}}};
struct AssignOperator {
  std::string_view symbol;
  Operator op;
};
constexpr std::array<AssignOperator, 11> kAssignOperators = {{{"=", Operator::kNone},
                                                              {"+=", Operator::kAdd},
                                                              {"-=", Operator::kSubtract},
                                                              {"*=", Operator::kMultiply},
                                                              {"/=", Operator::kDivide},
                                                              {"%=", Operator::kModulus},
                                                              {"&=", Operator::kAnd},
                                                              {"|=", Operator::kOr},
                                                              {"^=", Operator::kEor},
                                                              {"<<=", Operator::kLeftShift},
                                                              {">>=", Operator::kRightShift}}};

int32_t wrap(int64_t value) { return static_cast<int32_t>(static_cast<uint64_t>(value)); }

/// What the machine would compute; nothing for a division by zero.
std::optional<int32_t> compute(Operator op, int32_t a, int32_t b) {
  switch (op) {
    case Operator::kAdd:
      return wrap(int64_t{a} + b);
    case Operator::kSubtract:
      return wrap(int64_t{a} - b);
    case Operator::kMultiply:
      return wrap(int64_t{a} * b);
    case Operator::kDivide:
      if (b == 0) return std::nullopt;
      return wrap(int64_t{a} / b);
    case Operator::kModulus:
      if (b == 0) return std::nullopt;
      return wrap(int64_t{a} % b);
    case Operator::kEqual:
      return a == b;
    case Operator::kNotEqual:
      return a != b;
    case Operator::kLess:
      return a < b;
    case Operator::kGreater:
      return a > b;
    case Operator::kLessOrEqual:
      return a <= b;
    case Operator::kGreaterOrEqual:
      return a >= b;
    case Operator::kAndLogical:
      return a != 0 && b != 0;
    case Operator::kOrLogical:
      return a != 0 || b != 0;
    case Operator::kAnd:
      return a & b;
    case Operator::kOr:
      return a | b;
    case Operator::kEor:
      return a ^ b;
    case Operator::kLeftShift:
      return static_cast<int32_t>(static_cast<uint32_t>(a) << (b & 31));
    case Operator::kRightShift:
      return a >> (b & 31);
    case Operator::kMinus:
      return wrap(-int64_t{a});
    case Operator::kNot:
      return a == 0;
    case Operator::kComplement:
      return ~a;
    default:
      return 0;
  }
}

class Parser {
 public:
  Parser(const std::vector<Token>& tokens, Program& program, Diagnostics& diagnostics)
      : tokens_(tokens), program_(program), diagnostics_(diagnostics) {}

  void run() {
    while (current().kind != TokenKind::kEnd && !gave_up()) {
      panic_ = false;
      const std::size_t before = at_;
      declaration();
      if (panic_) skip_declaration();
      if (at_ == before) ++at_;
    }
  }

 private:
  // ---- tokens

  const Token& current() const { return tokens_[at_]; }
  const Token& next() const { return tokens_[std::min(at_ + 1, tokens_.size() - 1)]; }
  void advance() {
    if (at_ + 1 < tokens_.size()) ++at_;
  }
  bool accept(std::string_view symbol) {
    if (!current().is(symbol)) return false;
    advance();
    return true;
  }
  bool accept_name(std::string_view name) {
    if (!current().is_name(name)) return false;
    advance();
    return true;
  }
  void error(Place place, std::string_view found, std::string_view expected = {}) {
    if (!panic_) diagnostics_.error(place, found, expected);
    panic_ = true;
  }
  /// The current token is not what is wanted.
  void unexpected(std::string_view expected) { error(current().place, describe(current()), expected); }
  bool expect(std::string_view symbol, std::string_view where) {
    if (panic_) return false;
    if (accept(symbol)) return true;
    unexpected("\"" + std::string(symbol) + "\"" + (where.empty() ? "" : " " + std::string(where)));
    return false;
  }
  bool gave_up() {
    if (program_.expressions.size() + program_.statements.size() > kNodesMax && !too_large_) {
      too_large_ = true;
      diagnostics_.error(current().place, fmt::format("a program of more than {} terms", kNodesMax));
    }
    return too_large_ || diagnostics_.full();
  }

  /// Keeps count of how deep the parser stands; false, with an error, where it is too deep.
  class Nest {
   public:
    explicit Nest(Parser& parser) : parser_(parser) {
      if (++parser_.nesting_ > kNestingMax)
        parser_.error(parser_.current().place,
                      fmt::format("blocks or brackets more than {} deep inside each other", kNestingMax));
    }
    ~Nest() { --parser_.nesting_; }
    Nest(const Nest&) = delete;
    Nest& operator=(const Nest&) = delete;
    explicit operator bool() const { return parser_.nesting_ <= kNestingMax; }

   private:
    Parser& parser_;
  };

  // ---- after an error

  /// To the next thing that begins a declaration at the top.
  void skip_declaration() {
    int depth = 0;
    while (current().kind != TokenKind::kEnd) {
      const Token& token = current();
      if (token.is("{")) ++depth;
      if (token.is("}")) {
        advance();
        if (--depth <= 0) return;
        continue;
      }
      if (depth <= 0 && token.is(";")) return advance();
      if (depth <= 0 && token.kind == TokenKind::kName &&
          (token.text == "script" || token.text == "function"))
        return;
      if (depth <= 0 && (token.kind == TokenKind::kImportEnd || token.kind == TokenKind::kDirective)) return;
      advance();
    }
  }
  /// Behind the statement that went wrong, inside its block.
  void skip_statement() {
    int depth = 0;
    while (current().kind != TokenKind::kEnd) {
      const Token& token = current();
      if (depth == 0 && token.is("}")) return;
      if (token.is("{")) ++depth;
      if (token.is("}") && --depth == 0) return advance();
      if (depth == 0 && token.is(";")) return advance();
      if (depth == 0 && (token.is_name("script") || token.is_name("function"))) return;
      advance();
    }
  }

  // ---- nodes

  Expression* make(ExpressionKind kind, Place place) {
    Expression& node = program_.expressions.emplace_back();
    node.kind = kind;
    node.place = place;
    return &node;
  }
  Expression* number(Place place, int32_t value) {
    Expression* node = make(ExpressionKind::kNumber, place);
    node->value = value;
    return node;
  }
  void add_part(Expression* node, Expression* part) {
    node->parts.push_back(part);
    node->depth = std::max(node->depth, part->depth + 1);
    if (node->depth > kTreeDepthMax)
      error(node->place, fmt::format("an expression of more than {} steps", kTreeDepthMax));
  }
  Statement* make(StatementKind kind, Place place) {
    Statement& node = program_.statements.emplace_back();
    node.kind = kind;
    node.place = place;
    return &node;
  }

  // ---- constants

  const Expression* defined(std::string_view name) const {
    const auto found = defines_.find(name);
    return found != defines_.end() ? found->second.value : nullptr;
  }

  /// #define name value; #libdefine applies to importing files too.
  void define() {
    const bool for_importers = current().text == "libdefine";
    advance();
    if (current().kind != TokenKind::kName) return unexpected("the name of a constant");
    const Token name = current();
    if (is_reserved(name.text)) return unexpected("a name; this word is part of the language");
    advance();
    if (current().place.line != name.place.line || current().place.file != name.place.file)
      return error(name.place, "#define " + std::string(name.spelling) + " without a value", "a constant");
    const Expression* value = expression();
    if (panic_) return;
    if (value->kind != ExpressionKind::kNumber && value->kind != ExpressionKind::kText)
      return error(value->place, "a value that is not known before the program runs",
                   "a constant: numbers, texts, other constants and operators");
    if (defined(name.text) != nullptr && !same_constant(*defined(name.text), *value))
      diagnostics_.warn(name.place, in_quotes(name.spelling) + " is defined again with another value");
    defines_[name.text] = {value, for_importers};
  }
  static bool same_constant(const Expression& a, const Expression& b) {
    return a.kind == b.kind && a.value == b.value && a.text == b.text;
  }
  static bool is_reserved(std::string_view name) {
    return std::find(kReserved.begin(), kReserved.end(), name) != kReserved.end();
  }
  static bool is_type(const Token& token) {
    return token.kind == TokenKind::kName &&
           std::find(kTypes.begin(), kTypes.end(), token.text) != kTypes.end();
  }

  std::optional<int32_t> constant(std::string_view what) {
    const Expression* value = expression();
    if (panic_) return std::nullopt;
    if (value->kind == ExpressionKind::kNumber) return value->value;
    error(value->place, "a value that is not known before the program runs", what);
    return std::nullopt;
  }

  /// A name that something new is to have.
  std::optional<Token> new_name(std::string_view what) {
    if (panic_) return std::nullopt;
    if (current().kind != TokenKind::kName) return unexpected(what), std::nullopt;
    if (is_reserved(current().text)) {
      unexpected(std::string(what) + "; this word is part of the language");
      return std::nullopt;
    }
    if (defined(current().text) != nullptr) {
      unexpected(std::string(what) + "; this one is a #define'd constant");
      return std::nullopt;
    }
    const Token name = current();
    declared_.insert(name.text);
    advance();
    return name;
  }

  // ---- the outermost level

  void declaration() {
    const Token& token = current();
    switch (token.kind) {
      case TokenKind::kImportBegin:
        advance();
        return begin_import();
      case TokenKind::kImportEnd:
        advance();
        return end_import(token);
      case TokenKind::kDirective:
        return token.text == "library" ? library() : define();
      default:
        break;
    }
    if (accept(";")) return;
    if (token.is_name("script")) return script();
    if (token.is_name("function")) return function();
    if (token.is_name("special")) return special();
    if (token.is_name("world") || token.is_name("global") || token.is_name("static") || is_type(token)) {
      std::vector<Variable> variables;
      variable_declaration(variables, true);
      if (imports_.size() > 1) return;  // of a library's library, which is its own affair
      for (Variable& variable : variables) program_.variables.push_back(std::move(variable));
      return;
    }
    unexpected("script, function, a variable or a directive");
  }

  void library() {
    const Place place = current().place;
    advance();
    if (current().kind != TokenKind::kText) return unexpected("the name of the library in quotes");
    const std::string name(current().text);
    if (name.empty() || name.size() > 8 || name.find_first_of("./\\\n") != std::string::npos)
      return error(current().place, "the library name " + in_quotes(name),
                   "the name of a lump, 1 to 8 letters");
    if (!imports_.empty()) {
      imports_.back().name = name;
    } else if (!program_.library.empty() && program_.library != name) {
      return error(place, "a second #library", "one in a file");
    } else {
      program_.library = name;
    }
    advance();
  }
  void begin_import() { imports_.push_back({.name = {}, .outer_defines = defines_}); }
  void end_import(const Token& token) {
    if (imports_.empty()) return;  // its beginning was skipped behind an error
    Import import = std::move(imports_.back());
    imports_.pop_back();
    if (import.name.empty())
      error(token.place, "an imported file without #library", "#library \"NAME\" in the file");
    else if (imports_.empty() && std::find(program_.imports.begin(), program_.imports.end(), import.name) ==
                                     program_.imports.end())
      program_.imports.push_back(import.name);
    for (const auto& [name, entry] : defines_)
      if (entry.for_importers) import.outer_defines.insert_or_assign(name, entry);
    defines_ = std::move(import.outer_defines);
  }

  /// special 80:ACS_Execute(1, 5), -22:CheckActorProperty(3);
  void special() {
    advance();
    do {
      DeclaredSpecial entry;
      const Place place = current().place;
      const bool function = accept("-");
      if (current().kind != TokenKind::kNumber) return unexpected("the number of a line special");
      entry.number = current().value;
      if (entry.number < 0 || entry.number > 32767) return unexpected("a number up to 32767");
      if (function) entry.number = -entry.number;
      advance();
      if (!expect(":", "behind the number of a special")) return;
      const std::optional<Token> name = new_name("the name of a line special");
      if (!name || !expect("(", "and the number of arguments")) return;
      entry.name = name->text;
      const std::optional<int32_t> first = constant("a number of arguments");
      if (!first) return;
      entry.args_min = entry.args_max = *first;
      if (accept(",")) {
        const std::optional<int32_t> most = constant("a number of arguments");
        if (!most) return;
        entry.args_max = *most;
      } else if (!function) {
        entry.args_min = 0;
      }
      if (entry.args_min < 0 || entry.args_max < entry.args_min || entry.args_max > (function ? 16 : 5))
        return error(place, fmt::format("a special of {} arguments", entry.args_max),
                     function ? "at most 16" : "at most 5");
      if (!expect(")", {})) return;
      program_.specials.push_back(entry);
    } while (accept(","));
    expect(";", "behind the specials");
  }

  // ---- scripts and functions

  void script() {
    Routine routine;
    routine.is_script = true;
    routine.imported = !imports_.empty();
    routine.place = current().place;
    advance();
    if (current().kind == TokenKind::kText) {
      routine.named = true;
      routine.name = current().text;
      if (routine.name.empty()) return unexpected("a name that is not empty");
      advance();
    } else if (current().is("<<") && next().kind == TokenKind::kNumber && next().value == 0) {
      advance();
      advance();
      if (!expect(">>", "of script <<0>>")) return;
    } else {
      const Place place = current().place;
      if (current().kind == TokenKind::kName
              ? defined(current().text) == nullptr && !find_constant(current().text)
              : current().kind != TokenKind::kNumber && !current().is("-"))
        return unexpected("the number or the name of the script");
      const Expression* value = expression();
      if (panic_) return;
      if (value->kind == ExpressionKind::kText) {
        routine.named = true;
        routine.name = value->text;
      } else if (value->kind != ExpressionKind::kNumber) {
        return error(place, "a script number that is no constant",
                     "a number from 1 to 32767 or a name in quotes");
      } else if (value->value < 1 || value->value > kScriptNumberMax) {
        return error(place, fmt::format("script number {}", value->value), "a number from 1 to 32767");
      } else {
        routine.number = value->value;
      }
    }
    bool has_parameters = false;
    if (current().is("(")) {
      parameters(routine);
      has_parameters = true;
    }
    const ScriptKind* kind = nullptr;
    while (!panic_ && !current().is("{")) {
      const Token& word = current();
      const ScriptKind* found = nullptr;
      if (word.kind == TokenKind::kName)
        for (const ScriptKind& candidate : kScriptKinds)
          if (candidate.name == word.text) found = &candidate;
      if (found != nullptr) {
        if (kind != nullptr)
          return error(word.place, "a second kind of script: " + in_quotes(word.spelling), "one kind");
        kind = found;
      } else if (word.is_name("net")) {
        routine.net = true;
      } else if (word.is_name("clientside")) {
        routine.clientside = true;
      } else {
        return unexpected(has_parameters || kind != nullptr
                              ? "\"{\" or a kind of script (OPEN, ENTER, ..., NET, CLIENTSIDE)"
                              : "\"(\" or a kind of script (OPEN, ENTER, ...)");
      }
      advance();
    }
    if (panic_) return;
    if (kind != nullptr) routine.type = kind->type;
    if (!has_parameters && kind == nullptr) return unexpected("\"(\" or a kind of script (OPEN, ENTER, ...)");
    const std::size_t most = kind != nullptr ? kind->parameters_max : kScriptParametersMax;
    if (routine.parameters.size() > most)
      return error(routine.parameters[most].place,
                   fmt::format("a script{} with {} parameters",
                               (kind != nullptr ? " of kind " + in_quotes(kind->name) : std::string()),
                               routine.parameters.size()),
                   most == 0 ? "none" : fmt::format("at most {}", most));
    in_function_ = false;
    finish(routine);
  }

  void function() {
    Routine routine;
    routine.imported = !imports_.empty();
    advance();
    if (accept_name("void")) {
      routine.returns_value = false;
    } else if (is_type(current())) {
      routine.returns_value = true;
      advance();
    } else {
      return unexpected("the type of the result: int, bool, str, fixed or void");
    }
    routine.place = current().place;
    const std::optional<Token> name = new_name("the name of the function");
    if (!name) return;
    routine.name = name->text;
    if (!current().is("(")) return unexpected("\"(\" and the parameters");
    parameters(routine);
    if (panic_) return;
    in_function_ = true;
    finish(routine);
  }

  void finish(Routine& routine) {
    if (!current().is("{")) return unexpected("\"{\"");
    routine.body = statement();
    routine.end = tokens_[at_ == 0 ? 0 : at_ - 1].place;
    if (imports_.size() > 1) return;  // of a library's library, which is its own affair
    // What went wrong inside has been reported and skipped: the routine itself is there.
    program_.routines.push_back(std::move(routine));
  }

  void parameters(Routine& routine) {
    advance();
    if (accept(")")) return;
    if (current().is_name("void") && next().is(")")) {
      advance();
      advance();
      return;
    }
    do {
      if (!is_type(current()))
        return unexpected("the type of a parameter: int, bool, str or fixed, or void alone");
      advance();
      const std::optional<Token> name = new_name("the name of a parameter");
      if (!name) return;
      if (routine.parameters.size() >= kParametersMax)
        return error(name->place, fmt::format("more than {} parameters", kParametersMax));
      routine.parameters.push_back({name->text, name->place});
    } while (accept(","));
    expect(")", "or \",\" behind a parameter");
  }

  // ---- variables

  void variable_declaration(std::vector<Variable>& variables, bool outermost) {
    Scope scope = outermost ? Scope::kMap : Scope::kScript;
    if (accept_name("world")) {
      scope = Scope::kWorld;
    } else if (accept_name("global")) {
      scope = Scope::kGlobal;
    } else if (current().is_name("static")) {
      if (!outermost) return unexpected("a variable of the script; static ones belong outside");
      advance();
    }
    if (!is_type(current())) return unexpected("the type of a variable: int, bool, str or fixed");
    advance();
    do {
      Variable variable;
      variable.scope = scope;
      variable.imported = !imports_.empty();
      if (scope == Scope::kWorld || scope == Scope::kGlobal) {
        const int32_t count = scope == Scope::kWorld ? 256 : 64;
        const Place place = current().place;
        const std::optional<int32_t> index = constant("the number of the variable");
        if (!index) return;
        if (*index < 0 || *index >= count)
          return error(place,
                       fmt::format("{} variable {}", scope == Scope::kWorld ? "world" : "global", *index),
                       fmt::format("a number from 0 to {}", count - 1));
        variable.number = *index;
        if (!expect(":", "behind the number of the variable")) return;
      }
      const std::optional<Token> name = new_name("the name of a variable");
      if (!name) return;
      variable.name = name->text;
      variable.place = name->place;
      dimensions(variable);
      if (!panic_ && accept("=")) initial_values(variable);
      if (!panic_ && scope != Scope::kWorld && scope != Scope::kGlobal && variable.is_array &&
          variable.sizes.empty())
        error(variable.place, "an array without a size", "a number in its brackets, or values");
      if (panic_) {  // the name is known all the same, so that its uses are no errors
        variable.initials.clear();
        if (variable.is_array && variable.sizes.empty()) variable.sizes.push_back(1);
      }
      variables.push_back(std::move(variable));
      if (panic_) return;
    } while (accept(","));
    expect(";", "behind the variable");
  }

  void dimensions(Variable& variable) {
    while (!panic_ && current().is("[")) {
      const Place place = current().place;
      advance();
      const bool sizeless = variable.scope == Scope::kWorld || variable.scope == Scope::kGlobal;
      if (variable.is_array && (sizeless || variable.sizes.empty()))
        return error(place, "a second dimension of an array without a size", "sizes in all brackets");
      variable.is_array = true;
      if (accept("]")) continue;
      const std::optional<int32_t> size = constant("the size of the array");
      if (!size) return;
      if (*size < 1 || *size > kArraySizeMax)
        return error(place, fmt::format("an array of {} elements", *size),
                     fmt::format("1 to {}", kArraySizeMax));
      if (variable.sizes.size() >= kDimensionsMax)
        return error(place, fmt::format("an array of more than {} dimensions", kDimensionsMax));
      if (!sizeless) variable.sizes.push_back(*size);
      int64_t total = 1;
      for (const int32_t one : variable.sizes) total = std::min(total * one, kArraySizeMax + 1);
      if (total > kArraySizeMax)
        return error(place, fmt::format("an array of more than {} elements", kArraySizeMax));
      if (!expect("]", "behind the size")) return;
    }
    if (panic_) return;
    int64_t total = variable.is_array ? 1 : 0;
    for (const int32_t one : variable.sizes) total *= one;
    array_elements_ += total;
    if (array_elements_ > kArraySizeMax)
      error(variable.place, fmt::format("arrays of more than {} elements in one program", kArraySizeMax));
  }

  void initial_values(Variable& variable) {
    if (!variable.is_array) {
      variable.initials.emplace_back(0, expression());
      if (!panic_ && variable.scope != Scope::kScript) need_constant(*variable.initials.back().second);
      return;
    }
    if (variable.scope == Scope::kWorld || variable.scope == Scope::kGlobal)
      return error(current().place, "values for a world or global array",
                   "\";\"; these arrays begin as zeros");
    if (!current().is("{")) return unexpected("\"{\" and the values of the array");
    if (variable.sizes.empty()) {
      list(variable, 0, 0, kArraySizeMax);
      int32_t last = -1;
      for (const auto& [element, value] : variable.initials) last = std::max(last, element);
      if (last >= 0) variable.sizes.push_back(last + 1);
      array_elements_ += last;
      return;
    }
    int64_t total = 1;
    for (const int32_t one : variable.sizes) total *= one;
    list(variable, 0, 0, total);
  }

  /// { values }, elements `first` to `first` + `count` - 1; in inner lists each holds one row.
  void list(Variable& variable, std::size_t dimension, int64_t first, int64_t count) {
    const Nest nest(*this);
    if (!nest) return;
    advance();
    const int64_t row = dimension < variable.sizes.size() ? count / variable.sizes[dimension] : 1;
    int64_t place = first;
    while (!panic_ && !current().is("}")) {
      if (place >= first + count)
        return error(current().place, "more values than the array has room for",
                     fmt::format("at most {} here", count));
      if (current().is("{")) {
        if (dimension + 1 >= variable.sizes.size())
          return unexpected("a value; the array has no more dimensions");
        if ((place - first) % row != 0) place += row - (place - first) % row;
        if (place >= first + count) return error(current().place, "more values than the array has room for");
        list(variable, dimension + 1, place, row);
        place += row;
      } else {
        Expression* value = expression();
        if (panic_) return;
        if (variable.scope != Scope::kScript) need_constant(*value);
        variable.initials.emplace_back(static_cast<int32_t>(place), value);
        ++place;
      }
      if (!accept(",")) break;
    }
    expect("}", "or \",\" behind a value");
  }
  void need_constant(const Expression& value) {
    if (value.kind != ExpressionKind::kNumber && value.kind != ExpressionKind::kText)
      error(value.place, "a value that is not known before the program runs", "a constant");
  }

  // ---- statements

  /// Never null; after an error the parser stands behind the statement.
  Statement* statement() {
    const Place place = current().place;
    Statement* result = nullptr;
    {
      const Nest nest(*this);
      if (nest) result = parse_statement();
    }
    if (panic_) {
      // Half a statement is of no use; blocks and declarations are good as far as they got.
      if (result != nullptr && result->kind != StatementKind::kBlock &&
          result->kind != StatementKind::kDeclare)
        result = nullptr;
      skip_statement();
      // Too deep or too many: nothing more is to be learned from what lies inside.
      panic_ = nesting_ >= kNestingMax;
    }
    return result != nullptr ? result : make(StatementKind::kBlock, place);
  }

  Statement* parse_statement() {
    const Token& token = current();
    if (token.is("{")) return block();
    if (token.is(";")) {
      advance();
      return make(StatementKind::kBlock, token.place);
    }
    if (token.kind == TokenKind::kDirective && token.text != "library") {
      define();
      return nullptr;
    }
    if (token.kind == TokenKind::kName) {
      if (is_type(token) || token.text == "world" || token.text == "global" || token.text == "static") {
        Statement* node = make(StatementKind::kDeclare, token.place);
        variable_declaration(node->variables, false);
        return node;
      }
      if (token.text == "if") return if_statement();
      if (token.text == "while" || token.text == "until") return while_statement();
      if (token.text == "do") return do_statement();
      if (token.text == "for") return for_statement();
      if (token.text == "switch") return switch_statement();
      if (token.text == "case") {
        Statement* node = make(StatementKind::kCase, token.place);
        advance();
        node->condition = expression();
        if (!panic_) need_constant(*node->condition);
        expect(":", "behind the case");
        return node;
      }
      if (token.text == "default") {
        advance();
        expect(":", "behind default");
        return make(StatementKind::kDefault, token.place);
      }
      if (token.text == "break") return word_statement(StatementKind::kBreak);
      if (token.text == "continue") return word_statement(StatementKind::kContinue);
      if (token.text == "terminate") return word_statement(StatementKind::kTerminate);
      if (token.text == "suspend") return word_statement(StatementKind::kSuspend);
      if (token.text == "restart") return word_statement(StatementKind::kRestart);
      if (token.text == "return") {
        Statement* node = make(StatementKind::kReturn, token.place);
        advance();
        if (!current().is(";")) node->condition = expression();
        expect(";", "behind return");
        return node;
      }
      if (token.text == "print" || token.text == "printbold" || token.text == "log" ||
          token.text == "hudmessage" || token.text == "hudmessagebold")
        return print_statement();
      if (token.text == "createtranslation") return translation_statement();
      if (token.text == "else") return unexpected("a statement; this else belongs to no if"), nullptr;
      if (token.text == "script" || token.text == "function")
        return unexpected("\"}\"; the script or function before is not closed"), nullptr;
    }
    Statement* node = make(StatementKind::kExpression, token.place);
    expression_list(node->expressions);
    expect(";", "behind the statement");
    return node;
  }

  void expression_list(std::vector<Expression*>& list) {
    do list.push_back(expression());
    while (!panic_ && list.size() < kArgumentsMax && accept(","));
  }

  Statement* word_statement(StatementKind kind) {
    Statement* node = make(kind, current().place);
    const std::string word(current().text);
    advance();
    expect(";", "behind " + word);
    return node;
  }

  Statement* block() {
    Statement* node = make(StatementKind::kBlock, current().place);
    const Place begin = current().place;
    advance();
    while (!panic_ && !current().is("}") && !gave_up()) {
      if (current().kind == TokenKind::kEnd || current().kind == TokenKind::kImportEnd) {
        error(current().place, describe(current()),
              fmt::format("\"}}\" for the block of line {}", begin.line));
        return node;
      }
      if (current().is_name("script") || current().is_name("function")) {
        unexpected(fmt::format("\"}}\" for the block of line {}", begin.line));
        return node;
      }
      const std::size_t before = at_;
      node->body.push_back(statement());
      if (at_ == before && !current().is("}")) advance();
    }
    if (!panic_) expect("}", {});
    return node;
  }

  Expression* in_brackets(std::string_view what) {
    if (!expect("(", "behind " + std::string(what))) return number(current().place, 0);
    Expression* value = expression();
    expect(")", "behind the condition of " + std::string(what));
    return value;
  }

  Statement* if_statement() {
    Statement* node = make(StatementKind::kIf, current().place);
    advance();
    node->condition = in_brackets("if");
    if (panic_) return node;
    node->body.push_back(statement());
    if (panic_ || !current().is_name("else")) return node;
    advance();
    node->body.push_back(statement());
    return node;
  }

  Statement* while_statement() {
    Statement* node = make(StatementKind::kWhile, current().place);
    const std::string word(current().text);
    node->negated = word == "until";
    advance();
    node->condition = in_brackets(word);
    if (!panic_) node->body.push_back(statement());
    return node;
  }

  Statement* do_statement() {
    Statement* node = make(StatementKind::kDo, current().place);
    advance();
    node->body.push_back(statement());
    if (panic_) return node;
    if (!current().is_name("while") && !current().is_name("until"))
      return unexpected("while or until behind the body of do"), node;
    const std::string word(current().text);
    node->negated = word == "until";
    advance();
    node->condition = in_brackets(word);
    expect(";", "behind the loop");
    return node;
  }

  Statement* for_statement() {
    Statement* node = make(StatementKind::kFor, current().place);
    advance();
    node->body.push_back(nullptr);
    if (!expect("(", "behind for")) return node;
    if (is_type(current())) {
      Statement* first = make(StatementKind::kDeclare, current().place);
      variable_declaration(first->variables, false);
      node->body[0] = first;
    } else if (!accept(";")) {
      Statement* first = make(StatementKind::kExpression, current().place);
      expression_list(first->expressions);
      node->body[0] = first;
      expect(";", "behind the beginning of for");
    }
    if (panic_) return node;
    if (!current().is(";")) node->condition = expression();
    if (!expect(";", "behind the condition of for")) return node;
    if (!current().is(")")) expression_list(node->expressions);
    if (!expect(")", "of for")) return node;
    node->body.push_back(statement());
    return node;
  }

  Statement* switch_statement() {
    Statement* node = make(StatementKind::kSwitch, current().place);
    advance();
    node->condition = in_brackets("switch");
    if (panic_) return node;
    if (!current().is("{")) return unexpected("\"{\" and the cases"), node;
    node->body.push_back(statement());
    return node;
  }

  /// print(s:"text", d:number); hudmessage(items; type, id, color, x, y, hold[, more]);
  Statement* print_statement() {
    Statement* node = make(StatementKind::kPrint, current().place);
    node->text = current().text;
    const std::string word(current().spelling);
    advance();
    if (!expect("(", "behind " + word)) return node;
    const bool on_hud = node->text == "hudmessage" || node->text == "hudmessagebold";
    print_items(node->items, on_hud ? ";" : ")");
    if (on_hud) {
      if (!expect(";", "between the text and the numbers of " + word)) return node;
      expression_list(node->expressions);
      // Old sources set the optional numbers apart.
      if (!panic_ && accept(";")) expression_list(node->expressions);
      if (!panic_ && (node->expressions.size() < 6 || node->expressions.size() > 9))
        error(current().place, fmt::format("{} with {} numbers", word, node->expressions.size()),
              "type, id, colour, x, y, hold time and up to 3 more");
    }
    expect(")", "behind " + word);
    expect(";", "behind " + word);
    return node;
  }

  void print_items(std::vector<PrintItem>& items, std::string_view end) {
    if (current().is(end)) return;
    do {
      PrintItem item;
      item.place = current().place;
      constexpr std::string_view kKinds = "abcdfiklnsx";
      if (current().kind != TokenKind::kName || current().text.size() != 1 || !next().is(":") ||
          kKinds.find(current().text[0]) == std::string_view::npos) {
        return unexpected("a kind of item: s: d: i: c: f: k: l: n: x: a: or b:");
      }
      item.kind = current().text[0];
      advance();
      advance();
      if (item.kind == 'a') {
        array_item(item);
      } else {
        item.value = expression();
      }
      if (panic_) return;
      if (items.size() >= kItemsMax)
        return error(item.place, fmt::format("more than {} items in one text", kItemsMax));
      items.push_back(item);
    } while (accept(","));
  }

  /// array, array[row], (array, offset) or (array, offset, length)
  void array_item(PrintItem& item) {
    if (!accept("(")) {
      item.value = unary();
    } else {
      item.value = unary();
      if (!panic_ && accept(",")) item.offset = expression();
      if (!panic_ && item.offset != nullptr && accept(",")) item.length = expression();
      expect(")", "behind the array");
    }
    if (!panic_ && item.value->kind != ExpressionKind::kName && item.value->kind != ExpressionKind::kElement)
      error(item.value->place, "an item a: that is no array", "the name of an array");
  }

  /// createtranslation(number, a:b = c:d, a:b = [r,g,b]:[r,g,b], a:b = %[r,g,b]:[r,g,b]);
  Statement* translation_statement() {
    Statement* node = make(StatementKind::kTranslation, current().place);
    advance();
    if (!expect("(", "behind createtranslation")) return node;
    node->condition = expression();
    while (!panic_ && accept(",")) {
      TranslationRange range;
      range.place = current().place;
      range.ends[0] = conditional();
      if (!expect(":", "between the ends of a range")) return node;
      range.ends[1] = conditional();
      if (!expect("=", "behind the range")) return node;
      if (current().is("[") || current().is("%")) {
        range.kind =
            current().is("%") ? TranslationRange::Kind::kDesaturated : TranslationRange::Kind::kColors;
        accept("%");
        color(range.values);
        expect(":", "between two colours");
        color(range.values);
      } else {
        range.values.push_back(expression());
        expect(":", "between the ends of a range");
        range.values.push_back(panic_ ? nullptr : expression());
      }
      if (panic_) return node;
      if (node->ranges.size() >= kItemsMax)
        return error(range.place, fmt::format("more than {} ranges", kItemsMax)), node;
      node->ranges.push_back(std::move(range));
    }
    expect(")", "behind createtranslation");
    expect(";", "behind createtranslation");
    return node;
  }
  void color(std::vector<Expression*>& values) {
    if (!expect("[", "and a colour")) return;
    for (int i = 0; i < 3 && !panic_; ++i) {
      if (i != 0) expect(",", "between the parts of a colour");
      if (!panic_) values.push_back(expression());
    }
    expect("]", "behind the colour");
  }

  // ---- expressions; never null, panic_ reports what is of no use

  Expression* expression() {
    const Nest nest(*this);
    if (!nest) return number(current().place, 0);
    Expression* left = conditional();
    if (panic_) return left;
    for (const AssignOperator& candidate : kAssignOperators) {
      if (!current().is(candidate.symbol)) continue;
      if (left->kind != ExpressionKind::kName && left->kind != ExpressionKind::kElement) {
        error(current().place, describe(current()) + " behind what is no variable", "a variable on its left");
        return left;
      }
      Expression* node = make(ExpressionKind::kAssign, current().place);
      node->op = candidate.op;
      advance();
      Expression* right = expression();
      add_part(node, left);
      add_part(node, right);
      return node;
    }
    return left;
  }
  Expression* conditional() {
    Expression* condition = binary(1);
    if (panic_ || !current().is("?")) return condition;
    const Place place = current().place;
    advance();
    Expression* yes = expression();
    if (!expect(":", "of ?")) return condition;
    Expression* no = expression();
    if (panic_) return condition;
    if (condition->kind == ExpressionKind::kNumber) return condition->value != 0 ? yes : no;
    Expression* node = make(ExpressionKind::kConditional, place);
    add_part(node, condition);
    add_part(node, yes);
    add_part(node, no);
    return node;
  }

  Expression* binary(int strength) {
    Expression* left = unary();
    while (!panic_ && current().kind == TokenKind::kSymbol) {
      const BinaryOperator* found = nullptr;
      for (const BinaryOperator& candidate : kBinaryOperators)
        if (current().text == candidate.symbol) found = &candidate;
      if (found == nullptr || found->strength < strength) break;
      const Place place = current().place;
      advance();
      Expression* right = binary(found->strength + 1);
      if (panic_) break;
      left = fold(found->op, place, left, right);
    }
    return left;
  }

  Expression* fold(Operator op, Place place, Expression* left, Expression* right) {
    if (left->kind == ExpressionKind::kNumber && right->kind == ExpressionKind::kNumber) {
      const std::optional<int32_t> value = compute(op, left->value, right->value);
      if (value) return number(left->place, *value);
      error(place, "a division by zero", "another divisor");
      return left;
    }
    if ((op == Operator::kDivide || op == Operator::kModulus) && right->kind == ExpressionKind::kNumber &&
        right->value == 0)
      error(place, "a division by zero", "another divisor");
    Expression* node = make(ExpressionKind::kBinary, place);
    node->op = op;
    add_part(node, left);
    add_part(node, right);
    return node;
  }

  Expression* unary() {
    const Nest nest(*this);
    const Token& token = current();
    if (!nest) return number(token.place, 0);
    Operator op = Operator::kNone;
    if (token.is("-")) op = Operator::kMinus;
    if (token.is("!")) op = Operator::kNot;
    if (token.is("~")) op = Operator::kComplement;
    if (op != Operator::kNone) {
      advance();
      Expression* operand = unary();
      if (panic_) return operand;
      if (operand->kind == ExpressionKind::kNumber)
        return number(token.place, compute(op, operand->value, 0).value_or(0));
      Expression* node = make(ExpressionKind::kUnary, token.place);
      node->op = op;
      add_part(node, operand);
      return node;
    }
    if (accept("+")) return unary();
    if (token.is("++") || token.is("--")) {
      advance();
      Expression* operand = unary();
      return increment(token, operand, true);
    }
    Expression* result = primary();
    while (!panic_ && (current().is("++") || current().is("--"))) {
      const Token& sign = current();
      advance();
      result = increment(sign, result, false);
    }
    return result;
  }

  Expression* increment(const Token& sign, Expression* operand, bool prefix) {
    if (panic_) return operand;
    if (operand->kind != ExpressionKind::kName && operand->kind != ExpressionKind::kElement) {
      error(sign.place, describe(sign) + " on what is no variable", "a variable");
      return operand;
    }
    Expression* node = make(ExpressionKind::kIncrement, sign.place);
    node->op = sign.text == "++" ? Operator::kAdd : Operator::kSubtract;
    node->prefix = prefix;
    add_part(node, operand);
    return node;
  }

  Expression* primary() {
    const Token& token = current();
    switch (token.kind) {
      case TokenKind::kNumber:
        advance();
        return number(token.place, token.value);
      case TokenKind::kText:
        return text();
      case TokenKind::kName:
        return name();
      default:
        break;
    }
    if (accept("(")) {
      Expression* value = expression();
      expect(")", fmt::format("for the \"(\" of line {}", token.place.line));
      return value;
    }
    unexpected("a value");
    return number(token.place, 0);
  }

  /// Texts behind each other are one.
  Expression* text() {
    Expression* node = make(ExpressionKind::kText, current().place);
    node->text = current().text;
    advance();
    if (current().kind != TokenKind::kText) return node;
    std::string all(node->text);
    while (current().kind == TokenKind::kText) {
      all += current().text;
      advance();
    }
    if (all.size() > kTextMax)
      error(node->place, fmt::format("a text of {} bytes", all.size()), "at most 32768");
    node->text = program_.pool.keep(std::move(all));
    return node;
  }
  static constexpr std::size_t kTextMax = 32768;

  Expression* name() {
    const Token& token = current();
    if (const Expression* value = defined(token.text)) {
      advance();
      Expression* node = make(value->kind, token.place);
      node->value = value->value;
      node->text = value->text;
      return node;
    }
    if (is_reserved(token.text)) {
      unexpected("a value");
      return number(token.place, 0);
    }
    advance();
    if (current().is("(")) return call(token);
    if (!declared_.contains(token.text))
      if (const std::optional<int32_t> value = find_constant(token.text)) return number(token.place, *value);
    Expression* node = make(ExpressionKind::kName, token.place);
    node->text = token.text;
    while (!panic_ && current().is("[")) {
      node->kind = ExpressionKind::kElement;
      const Token& bracket = current();
      advance();
      Expression* index = expression();
      if (!expect("]", fmt::format("for the \"[\" of line {}", bracket.place.line))) break;
      if (node->parts.size() >= kDimensionsMax) {
        error(bracket.place, fmt::format("more than {} indices", kDimensionsMax));
        break;
      }
      add_part(node, index);
    }
    return node;
  }

  Expression* call(const Token& word) {
    advance();  // (
    if (word.text == "strparam") {
      Expression* node = make(ExpressionKind::kStrParam, word.place);
      print_items(node->items, ")");
      expect(")", "behind strparam");
      for (const PrintItem& item : node->items)
        for (const Expression* part : {item.value, item.offset, item.length})
          if (part != nullptr) node->depth = std::max(node->depth, part->depth + 1);
      return node;
    }
    if (word.text == "strcpy") {
      Expression* node = make(ExpressionKind::kStrCpy, word.place);
      if (!current().is_name("a") || !next().is(":")) {
        unexpected("a: and the array to copy into");
        return node;
      }
      PrintItem item;
      item.kind = 'a';
      item.place = current().place;
      advance();
      advance();
      array_item(item);
      if (panic_) return node;
      node->items.push_back(item);
      while (!panic_ && node->parts.size() < 3 && accept(",")) add_part(node, expression());
      if (!panic_ && (node->parts.empty() || node->parts.size() > 2))
        error(word.place, "strcpy without a text", "strcpy(a:array, text) or strcpy(a:array, text, place)");
      expect(")", "behind strcpy");
      return node;
    }
    Expression* node = make(ExpressionKind::kCall, word.place);
    node->text = word.text;
    if (current().is_name("const") && next().is(":")) {
      node->only_constants = true;
      advance();
      advance();
    }
    if (accept(")")) return node;
    do {
      if (node->parts.size() >= kArgumentsMax) {
        error(current().place, fmt::format("more than {} arguments", kArgumentsMax));
        return node;
      }
      add_part(node, expression());
    } while (!panic_ && accept(","));
    expect(")", "or \",\" behind an argument of " + std::string(word.spelling));
    return node;
  }

  struct Define {
    const Expression* value = nullptr;
    bool for_importers = false;
  };

  const std::vector<Token>& tokens_;
  Program& program_;
  Diagnostics& diagnostics_;
  std::size_t at_ = 0;
  bool panic_ = false, too_large_ = false;
  int nesting_ = 0;
  int64_t array_elements_ = 0;
  bool in_function_ = false;
  std::unordered_map<std::string_view, Define> defines_;
  /// An #import under way: the library's name, and the constants of the file that imports it.
  struct Import {
    std::string name;
    std::unordered_map<std::string_view, Define> outer_defines;
  };
  std::vector<Import> imports_;                    // each inside the one before
  std::unordered_set<std::string_view> declared_;  // names that hide built-in constants
};

}  // namespace

void parse(const std::vector<Token>& tokens, Program& program, Diagnostics& diagnostics) {
  Parser(tokens, program, diagnostics).run();
}

}  // namespace comrad::acs_compiler
