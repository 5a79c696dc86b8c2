#include "doomgen/acs/code_generator.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "doomgen/acs/declarations.h"
#include "doomgen/acs/pcodes.h"
#include "doomgen/wad/special_names.h"
#include "rollout_buffer/core/text.h"

namespace comrad::acs_compiler {
namespace {

using bytecode::Operation;
using bytecode::PCode;
using bytecode::VariableScope;

constexpr std::size_t kCodeBytesMax = 16u << 20;
constexpr std::size_t kMapVariablesMax = 128;
constexpr int32_t kLocalsMax = 255;  // a byte counts those of a function
constexpr std::size_t kLocalArraysMax = 255;
constexpr std::size_t kFunctionsMax = 4096, kScriptsMax = 4096;
constexpr std::size_t kTextsMax = 32768;
constexpr int32_t kSpecialsInOneByte = 255;
constexpr std::string_view kWaitsInScripts = "waiting only in scripts";

// ---------------------------------------------------------------- p-codes of variables

PCode offset(PCode first, int by) { return static_cast<PCode>(static_cast<int>(first) + by); }

/// The p-code that does `operation` to a variable of a scope of the source, or to an element of its array.
PCode variable_code(Operation operation, Scope scope, bool is_array) {
  constexpr VariableScope kPlain[] = {VariableScope::kScript, VariableScope::kMap, VariableScope::kWorld,
                                      VariableScope::kGlobal};
  constexpr VariableScope kArrays[] = {VariableScope::kScriptArray, VariableScope::kMapArray,
                                       VariableScope::kWorldArray, VariableScope::kGlobalArray};
  const auto index = static_cast<std::size_t>(scope);
  return bytecode::variable_code(operation, is_array ? kArrays[index] : kPlain[index]);
}

Operation operation_of(Operator op) {
  switch (op) {
    case Operator::kAdd:
      return Operation::kAdd;
    case Operator::kSubtract:
      return Operation::kSub;
    case Operator::kMultiply:
      return Operation::kMul;
    case Operator::kDivide:
      return Operation::kDiv;
    case Operator::kModulus:
      return Operation::kMod;
    case Operator::kAnd:
      return Operation::kAnd;
    case Operator::kEor:
      return Operation::kEor;
    case Operator::kOr:
      return Operation::kOr;
    case Operator::kLeftShift:
      return Operation::kLeftShift;
    case Operator::kRightShift:
      return Operation::kRightShift;
    default:
      return Operation::kAssign;
  }
}

PCode operator_code(Operator op) {
  switch (op) {
    case Operator::kAdd:
      return PCode::kAdd;
    case Operator::kSubtract:
      return PCode::kSubtract;
    case Operator::kMultiply:
      return PCode::kMultiply;
    case Operator::kDivide:
      return PCode::kDivide;
    case Operator::kModulus:
      return PCode::kModulus;
    case Operator::kEqual:
      return PCode::kEqual;
    case Operator::kNotEqual:
      return PCode::kNotEqual;
    case Operator::kLess:
      return PCode::kLess;
    case Operator::kGreater:
      return PCode::kGreater;
    case Operator::kLessOrEqual:
      return PCode::kLessOrEqual;
    case Operator::kGreaterOrEqual:
      return PCode::kGreaterOrEqual;
    case Operator::kAndLogical:
      return PCode::kAndLogical;
    case Operator::kOrLogical:
      return PCode::kOrLogical;
    case Operator::kAnd:
      return PCode::kAndBitwise;
    case Operator::kOr:
      return PCode::kOrBitwise;
    case Operator::kEor:
      return PCode::kEorBitwise;
    case Operator::kLeftShift:
      return PCode::kLeftShift;
    case Operator::kRightShift:
      return PCode::kRightShift;
    case Operator::kMinus:
      return PCode::kUnaryMinus;
    case Operator::kNot:
      return PCode::kNegateLogical;
    case Operator::kComplement:
      return PCode::kNegateBinary;
    default:
      return PCode::kNop;
  }
}

PCode print_code(char kind) {
  switch (kind) {
    case 's':
      return PCode::kPrintString;
    case 'c':
      return PCode::kPrintCharacter;
    case 'f':
      return PCode::kPrintFixed;
    case 'k':
      return PCode::kPrintBind;
    case 'l':
      return PCode::kPrintLocalized;
    case 'n':
      return PCode::kPrintName;
    case 'x':
      return PCode::kPrintHex;
    case 'b':
      return PCode::kPrintBinary;
    default:
      return PCode::kPrintNumber;
  }
}

PCode array_code(Scope scope, PCode map, PCode world, PCode global, PCode script) {
  return scope == Scope::kMap      ? map
         : scope == Scope::kWorld  ? world
         : scope == Scope::kGlobal ? global
                                   : script;
}

// ---------------------------------------------------------------- the generator

struct Symbol {
  Scope scope = Scope::kScript;
  bool is_array = false;
  int32_t index = -1;  ///< -1: an imported variable that nothing has used yet
  std::vector<int32_t> sizes;
  const Variable* imported = nullptr;
};

class Generator {
 public:
  Generator(const Program& program, Diagnostics& diagnostics)
      : program_(program), diagnostics_(diagnostics) {}

  Object run() {
    object_.is_library = !program_.library.empty();
    object_.encrypts_texts = program_.encrypts_texts;
    object_.imports = program_.imports;
    for (const DeclaredSpecial& special : program_.specials) specials_[special.name] = &special;
    declare_variables();
    declare_routines();
    for (const Routine& routine : program_.routines) {
      if (diagnostics_.full() || too_large_) break;
      if (!routine.imported) generate(routine);
    }
    for (const auto& [place, label] : patches_) set_word(place, labels_[label]);
    return std::move(object_);
  }

 private:
  using Label = std::size_t;

  void error(Place place, std::string_view found, std::string_view expected = {}) {
    diagnostics_.error(place, found, expected);
  }

  // ---- tables

  void declare_variables() {
    // Plain variables first, arrays behind them, imported ones where they are used.
    for (const bool arrays : {false, true}) {
      for (const Variable& variable : program_.variables) {
        if (variable.scope != Scope::kMap || variable.imported || variable.is_array != arrays) continue;
        Symbol symbol{variable.scope, arrays, static_cast<int32_t>(object_.variables.size()), variable.sizes,
                      nullptr};
        ObjectVariable entry;
        entry.name = variable.name;
        entry.is_array = arrays;
        if (arrays) {
          entry.size = 1;
          for (const int32_t size : variable.sizes) entry.size *= size;
        } else {
          entry.values.push_back(0);
        }
        std::size_t text_count = 0, number_count = 0;
        for (const auto& [element, value] : variable.initials) {
          const auto at = static_cast<std::size_t>(element);
          if (entry.values.size() <= at) entry.values.resize(at + 1, 0);
          entry.values[at] =
              value->kind == ExpressionKind::kText ? text(value->text, value->place) : value->value;
          (value->kind == ExpressionKind::kText ? text_count : number_count) += 1;
        }
        entry.holds_text = text_count != 0;
        if (object_.is_library && text_count != 0 && number_count != 0)
          error(variable.place, "an array of texts and numbers in a library", "one or the other");
        if (object_.variables.size() >= kMapVariablesMax)
          return error(variable.place, fmt::format("more than {} variables of the map", kMapVariablesMax));
        add_symbol(variable, std::move(symbol));
        object_.variables.push_back(std::move(entry));
      }
    }
    for (const Variable& variable : program_.variables) {
      if (variable.scope == Scope::kMap && !variable.imported) continue;
      Symbol symbol{variable.scope, variable.is_array, variable.number, variable.sizes, nullptr};
      if (variable.scope == Scope::kMap) symbol.imported = &variable;
      if (!variable.initials.empty() && !variable.imported)
        error(variable.place, "a first value for a world or global variable",
              "none; these keep what an earlier map left in them, so a script has to set them");
      add_symbol(variable, std::move(symbol));
    }
  }
  void add_symbol(const Variable& variable, Symbol symbol) {
    if (!symbols_.emplace(variable.name, std::move(symbol)).second)
      error(variable.place, "a second variable " + in_quotes(variable.name), "another name");
  }

  void declare_routines() {
    std::unordered_set<std::string> names;
    std::unordered_set<int32_t> numbers;
    for (const Routine& routine : program_.routines) {
      if (routine.is_script) {
        if (routine.imported) continue;
        if (routine.named ? !names.insert(lower_case(routine.name)).second
                          : !numbers.insert(routine.number).second)
          error(
              routine.place,
              "a second script " + (routine.named ? in_quotes(routine.name) : std::to_string(routine.number)),
              "another number or name");
        continue;
      }
      if (symbols_.contains(routine.name))
        error(routine.place, in_quotes(routine.name) + ", which is a variable too", "another name");
      FunctionEntry entry{&routine, -1};
      if (!routine.imported) {
        entry.index = static_cast<int32_t>(object_.functions.size());
        object_.functions.push_back({std::string(routine.name),
                                     static_cast<int32_t>(routine.parameters.size()),
                                     0,
                                     routine.returns_value,
                                     false,
                                     0,
                                     {}});
        if (object_.functions.size() > kFunctionsMax)
          return error(routine.place, fmt::format("more than {} functions", kFunctionsMax));
      }
      if (!functions_.emplace(routine.name, entry).second)
        error(routine.place, "a second function " + in_quotes(routine.name), "another name");
      if (find_function(routine.name) || wad::find_special(routine.name))
        diagnostics_.warn(routine.place,
                          in_quotes(routine.name) + " hides what the game provides under this name");
    }
  }

  int32_t text(std::string_view content, Place place) {
    const auto [found, added] = texts_.emplace(content, static_cast<int32_t>(object_.texts.size()));
    if (added) {
      object_.texts.emplace_back(content);
      if (object_.texts.size() == kTextsMax + 1)
        error(place, fmt::format("more than {} different texts", kTextsMax));
    }
    return found->second;
  }

  // ---- code

  uint32_t address() const { return kHeadBytes + static_cast<uint32_t>(object_.code.size()); }
  void word(int32_t value) {
    for (int i = 0; i < 4; ++i)
      object_.code.push_back(static_cast<uint8_t>(static_cast<uint32_t>(value) >> (8 * i)));
  }
  void set_word(uint32_t place, uint32_t value) {
    for (std::size_t i = 0; i < 4; ++i)
      object_.code[place - kHeadBytes + i] = static_cast<uint8_t>(value >> (8 * i));
  }
  /// An instruction; in this format every operand has four bytes.
  void emit(PCode code, std::initializer_list<int32_t> operands = {}) {
    if (object_.code.size() > kCodeBytesMax) {
      if (!too_large_) error(place_, fmt::format("code of more than {} bytes", kCodeBytesMax));
      too_large_ = true;
      return;
    }
    word(static_cast<int32_t>(code));
    for (const int32_t operand : operands) word(operand);
  }
  Label new_label() {
    labels_.push_back(0);
    return labels_.size() - 1;
  }
  void bind(Label label) { labels_[label] = address(); }
  void emit_label(Label label) {
    patches_.emplace_back(address(), label);
    word(0);
  }
  void jump(PCode code, Label label) {
    emit(code);
    if (!too_large_) emit_label(label);
  }
  void push(int32_t value) { emit(PCode::kPushNumber, {value}); }
  void push_text(std::string_view content, Place place) {
    push(text(content, place));
    if (object_.is_library) emit(PCode::kTagString);
  }

  // ---- scripts and functions

  void generate(const Routine& routine) {
    routine_ = &routine;
    place_ = routine.place;
    scopes_.clear();
    scopes_.emplace_back();
    out_of_scope_.clear();
    local_count_ = 0;
    local_arrays_.clear();
    for (const Parameter& parameter : routine.parameters) add_local(parameter.name, parameter.place);
    const uint32_t begin = address();
    if (routine.body != nullptr) {
      for (const Statement* part : routine.body->body) statement(*part);
    }
    place_ = routine.end;
    if (routine.is_script) {
      emit(PCode::kTerminate);
    } else if (routine.returns_value) {
      push(0);
      emit(PCode::kReturnValue);
    } else {
      emit(PCode::kReturnVoid);
    }
    const auto arg_count = static_cast<int32_t>(routine.parameters.size());
    if (routine.is_script) {
      ObjectScript script{.number = routine.number,
                          .type = routine.type,
                          .arg_count = arg_count,
                          .variable_count = local_count_,
                          .address = begin,
                          .net = routine.net,
                          .clientside = routine.clientside,
                          .arrays = local_arrays_};
      if (routine.named) {
        object_.script_names.emplace_back(routine.name);
        script.number = -static_cast<int32_t>(object_.script_names.size());
      }
      object_.scripts.push_back(std::move(script));
      if (object_.scripts.size() == kScriptsMax + 1)
        error(routine.place, fmt::format("more than {} scripts", kScriptsMax));
    } else {
      ObjectFunction& function =
          object_.functions[static_cast<std::size_t>(functions_.at(routine.name).index)];
      function.address = begin;
      function.variable_count = local_count_ - arg_count;
      function.arrays = local_arrays_;
    }
  }

  Symbol* add_local(std::string_view name, Place place, const std::vector<int32_t>* sizes = nullptr) {
    Symbol symbol;
    symbol.is_array = sizes != nullptr;
    if (sizes != nullptr) {
      int32_t total = 1;
      for (const int32_t size : *sizes) total *= size;
      if (local_arrays_.size() >= kLocalArraysMax) {
        error(place, fmt::format("more than {} arrays in one script or function", kLocalArraysMax));
        return nullptr;
      }
      symbol.sizes = *sizes;
      symbol.index = static_cast<int32_t>(local_arrays_.size());
      local_arrays_.push_back(total);
    } else {
      if (local_count_ >= kLocalsMax) {
        error(place, fmt::format("more than {} variables in one script or function", kLocalsMax),
              "map variables or an array for some of them");
        return nullptr;
      }
      symbol.index = local_count_++;
    }
    const auto [found, added] = scopes_.back().insert_or_assign(name, std::move(symbol));
    if (!added) error(place, "a second variable " + in_quotes(name) + " in the same block", "another name");
    return &found->second;
  }

  /// Null after an error.
  Symbol* find(std::string_view name, Place place) {
    for (auto scope = scopes_.rbegin(); scope != scopes_.rend(); ++scope)
      if (const auto found = scope->find(name); found != scope->end()) return &found->second;
    if (const auto found = symbols_.find(name); found != symbols_.end()) {
      Symbol& symbol = found->second;
      if (symbol.index < 0 && symbol.imported != nullptr) import(symbol, place);
      return &symbol;
    }
    if (const auto found = out_of_scope_.find(name); found != out_of_scope_.end()) {
      diagnostics_.warn(place, in_quotes(name) + " is used outside the block that declares it");
      return &found->second;
    }
    std::string found = "the unknown name " + in_quotes(name);
    std::string wanted = "a variable or constant";
    if (functions_.contains(name) || find_function(name)) {
      found = "the function " + in_quotes(name) + " without arguments";
      wanted = "\"(\" behind it";
    } else if (const std::string_view near = nearest(name); !near.empty()) {
      wanted += ", perhaps " + std::string(near);
    }
    error(place, found, wanted);
    return nullptr;
  }
  std::string_view nearest(std::string_view name) const { return nearest_name(name); }

  void import(Symbol& symbol, Place place) {
    if (object_.variables.size() >= kMapVariablesMax) {
      error(place, fmt::format("more than {} variables of the map", kMapVariablesMax));
    }
    symbol.index = static_cast<int32_t>(object_.variables.size());
    ObjectVariable entry;
    entry.name = symbol.imported->name;
    entry.imported = true;
    entry.is_array = symbol.is_array;
    entry.size = 1;
    for (const int32_t size : symbol.sizes) entry.size *= size;
    object_.variables.push_back(std::move(entry));
  }

  // ---- statements

  struct Target {
    Label on_break = 0, on_continue = 0;
    bool is_loop = true;
    std::vector<std::pair<int32_t, Label>> cases;
    std::optional<Label> on_default;
  };

  void statement(const Statement& node) {
    if (too_large_ || diagnostics_.full()) return;
    place_ = node.place;
    switch (node.kind) {
      case StatementKind::kBlock:
        scopes_.emplace_back();
        for (const Statement* part : node.body) statement(*part);
        close_scope();
        return;
      case StatementKind::kDeclare:
        for (const Variable& variable : node.variables) declare(variable);
        return;
      case StatementKind::kExpression:
        for (const Expression* part : node.expressions) effect(*part);
        return;
      case StatementKind::kIf:
        return if_statement(node);
      case StatementKind::kWhile:
        return while_statement(node);
      case StatementKind::kDo:
        return do_statement(node);
      case StatementKind::kFor:
        return for_statement(node);
      case StatementKind::kSwitch:
        return switch_statement(node);
      case StatementKind::kCase:
      case StatementKind::kDefault:
        return case_label(node);
      case StatementKind::kBreak:
        if (targets_.empty()) return error(node.place, "break outside of loops and switches");
        return jump(PCode::kGoto, targets_.back().on_break);
      case StatementKind::kContinue:
        for (auto target = targets_.rbegin(); target != targets_.rend(); ++target)
          if (target->is_loop) return jump(PCode::kGoto, target->on_continue);
        return error(node.place, "continue outside of loops");
      case StatementKind::kReturn:
        return return_statement(node);
      case StatementKind::kTerminate:
        return ending(node, PCode::kTerminate, "terminate");
      case StatementKind::kSuspend:
        return ending(node, PCode::kSuspend, "suspend");
      case StatementKind::kRestart:
        return ending(node, PCode::kRestart, "restart");
      case StatementKind::kPrint:
        return print_statement(node);
      case StatementKind::kTranslation:
        return translation_statement(node);
    }
  }

  void close_scope() {
    for (auto& [name, symbol] : scopes_.back()) out_of_scope_.insert_or_assign(name, std::move(symbol));
    scopes_.pop_back();
  }

  void declare(const Variable& variable) {
    if (variable.scope != Scope::kScript) {
      if (!variable.initials.empty())
        error(variable.place, "a first value for a world or global variable", "an assignment behind it");
      Symbol symbol{variable.scope, variable.is_array, variable.number, {}, nullptr};
      if (!scopes_.back().emplace(variable.name, std::move(symbol)).second)
        error(variable.place, "a second variable " + in_quotes(variable.name) + " in the same block",
              "another name");
      return;
    }
    if (!variable.is_array) {
      // The value is computed before the name is known: int x = x; means the outer x.
      if (!variable.initials.empty()) value(*variable.initials[0].second);
      const Symbol* symbol = add_local(variable.name, variable.place);
      if (symbol != nullptr && !variable.initials.empty())
        emit(variable_code(Operation::kAssign, Scope::kScript, false), {symbol->index});
      return;
    }
    const Symbol* symbol = add_local(variable.name, variable.place, &variable.sizes);
    if (symbol == nullptr) return;
    const int32_t index = symbol->index;
    for (const auto& [element, initial] : variable.initials) {
      push(element);
      value(*initial);
      emit(PCode::kAssignScriptArray, {index});
    }
  }

  void if_statement(const Statement& node) {
    if (node.body.empty()) return;  // the parser gave up inside it
    const Label otherwise = new_label(), end = new_label();
    value(*node.condition);
    jump(PCode::kIfNotGoto, otherwise);
    scoped(*node.body[0]);
    if (node.body.size() > 1) {
      jump(PCode::kGoto, end);
      bind(otherwise);
      scoped(*node.body[1]);
    } else {
      bind(otherwise);
    }
    bind(end);
  }
  void scoped(const Statement& node) {
    scopes_.emplace_back();
    statement(node);
    close_scope();
  }

  /// Goes to `label` where the condition, or its opposite, does not hold.
  void leave_unless(const Expression& condition, bool negated, Label label) {
    if (condition.kind == ExpressionKind::kNumber) {
      if ((condition.value != 0) == negated) jump(PCode::kGoto, label);
      return;
    }
    value(condition);
    jump(negated ? PCode::kIfGoto : PCode::kIfNotGoto, label);
  }

  void while_statement(const Statement& node) {
    if (node.body.empty()) return;
    Target target{
        .on_break = new_label(), .on_continue = new_label(), .is_loop = true, .cases = {}, .on_default = {}};
    const Label begin = target.on_continue, end = target.on_break;
    bind(begin);
    leave_unless(*node.condition, node.negated, end);
    targets_.push_back(std::move(target));
    scoped(*node.body[0]);
    targets_.pop_back();
    jump(PCode::kGoto, begin);
    bind(end);
  }

  void do_statement(const Statement& node) {
    if (node.condition == nullptr || node.body.empty()) return;
    Target target{
        .on_break = new_label(), .on_continue = new_label(), .is_loop = true, .cases = {}, .on_default = {}};
    const Label test = target.on_continue, end = target.on_break, begin = new_label();
    bind(begin);
    targets_.push_back(std::move(target));
    scoped(*node.body[0]);
    targets_.pop_back();
    bind(test);
    value(*node.condition);
    jump(node.negated ? PCode::kIfNotGoto : PCode::kIfGoto, begin);
    bind(end);
  }

  void for_statement(const Statement& node) {
    if (node.body.size() < 2) return;
    scopes_.emplace_back();
    if (node.body[0] != nullptr) statement(*node.body[0]);
    Target target{
        .on_break = new_label(), .on_continue = new_label(), .is_loop = true, .cases = {}, .on_default = {}};
    const Label step = target.on_continue, end = target.on_break, test = new_label();
    bind(test);
    if (node.condition != nullptr) leave_unless(*node.condition, false, end);
    targets_.push_back(std::move(target));
    scoped(*node.body[1]);
    targets_.pop_back();
    bind(step);
    for (const Expression* part : node.expressions) effect(*part);
    jump(PCode::kGoto, test);
    bind(end);
    close_scope();
  }

  void switch_statement(const Statement& node) {
    if (node.body.empty()) return;
    const Label table = new_label();
    value(*node.condition);
    jump(PCode::kGoto, table);
    targets_.push_back({.on_break = new_label(),
                        .on_continue = 0,
                        .is_loop = false,
                        .cases = {},
                        .on_default = std::nullopt});
    statement(*node.body[0]);
    Target target = std::move(targets_.back());
    targets_.pop_back();
    jump(PCode::kGoto, target.on_break);
    bind(table);
    if (!target.cases.empty()) {
      std::sort(target.cases.begin(), target.cases.end());
      emit(PCode::kCaseGotoSorted);
      if (!too_large_) {
        word(static_cast<int32_t>(target.cases.size()));
        for (const auto& [value, label] : target.cases) {
          word(value);
          emit_label(label);
        }
      }
    }
    emit(PCode::kDrop);
    if (target.on_default) jump(PCode::kGoto, *target.on_default);
    bind(target.on_break);
  }

  void case_label(const Statement& node) {
    Target* target = nullptr;
    for (auto candidate = targets_.rbegin(); candidate != targets_.rend() && target == nullptr; ++candidate)
      if (!candidate->is_loop) target = &*candidate;
    if (target == nullptr)
      return error(node.place, node.kind == StatementKind::kCase ? "case outside of a switch"
                                                                 : "default outside of a switch");
    const Label label = new_label();
    bind(label);
    if (node.kind == StatementKind::kDefault) {
      if (target->on_default) error(node.place, "a second default in one switch");
      target->on_default = label;
      return;
    }
    const Expression& constant = *node.condition;
    const int32_t number =
        constant.kind == ExpressionKind::kText ? text(constant.text, constant.place) : constant.value;
    if (std::any_of(target->cases.begin(), target->cases.end(),
                    [&](const auto& entry) { return entry.first == number; }))
      error(constant.place, fmt::format("a second case {} in one switch", number), "another value");
    target->cases.emplace_back(number, label);
  }

  void return_statement(const Statement& node) {
    if (routine_->is_script)
      return error(node.place, "return in a script", "terminate; return belongs to functions");
    if (routine_->returns_value) {
      if (node.condition == nullptr)
        return error(node.place, "return without a value", "the result of the function");
      value(*node.condition);
      return emit(PCode::kReturnValue);
    }
    if (node.condition != nullptr)
      return error(node.place, "return with a value in a void function",
                   "\"return;\" or another type of function");
    emit(PCode::kReturnVoid);
  }

  void ending(const Statement& node, PCode code, const char* word) {
    if (!routine_->is_script)
      return error(node.place, std::string(word) + " in a function", "return; this belongs to scripts");
    emit(code);
  }

  void print_statement(const Statement& node) {
    emit(PCode::kBeginPrint);
    print_items(node.items);
    if (node.text == "print") return emit(PCode::kEndPrint);
    if (node.text == "printbold") return emit(PCode::kEndPrintBold);
    if (node.text == "log") return emit(PCode::kEndLog);
    emit(PCode::kMoreHudMessage);
    for (std::size_t i = 0; i < node.expressions.size(); ++i) {
      if (i == 6) emit(PCode::kOptHudMessage);
      value(*node.expressions[i]);
    }
    emit(node.text == "hudmessagebold" ? PCode::kEndHudMessageBold : PCode::kEndHudMessage);
  }

  void print_items(const std::vector<PrintItem>& items) {
    for (const PrintItem& item : items) {
      if (item.kind != 'a') {
        value(*item.value);
        emit(print_code(item.kind));
        continue;
      }
      const Symbol* symbol = array_start(item);
      if (symbol == nullptr) continue;
      if (item.offset == nullptr) {
        emit(array_code(symbol->scope, PCode::kPrintMapCharArray, PCode::kPrintWorldCharArray,
                        PCode::kPrintGlobalCharArray, PCode::kPrintScriptCharArray));
        continue;
      }
      const Scope scope = symbol->scope;
      value(*item.offset);
      item.length != nullptr ? value(*item.length) : push(INT32_MAX);
      emit(array_code(scope, PCode::kPrintMapChRange, PCode::kPrintWorldChRange, PCode::kPrintGlobalChRange,
                      PCode::kPrintScriptChRange));
    }
  }
  /// Leaves the first element and the number of the array on the stack. Null after an error.
  const Symbol* array_start(const PrintItem& item) {
    const Expression& node = *item.value;
    const Symbol* symbol = find(node.text, node.place);
    if (symbol == nullptr) return nullptr;
    if (!symbol->is_array)
      return error(node.place, in_quotes(node.text) + " is no array", "an array"), nullptr;
    element(*symbol, node, true);
    push(symbol->index);
    return symbol;
  }

  void translation_statement(const Statement& node) {
    value(*node.condition);
    emit(PCode::kStartTranslation);
    for (const TranslationRange& range : node.ranges) {
      for (const Expression* end : range.ends) value(*end);
      for (const Expression* part : range.values) value(*part);
      emit(range.kind == TranslationRange::Kind::kPalette  ? PCode::kTranslationRange1
           : range.kind == TranslationRange::Kind::kColors ? PCode::kTranslationRange2
                                                           : PCode::kTranslationRange3);
    }
    emit(PCode::kEndTranslation);
  }

  // ---- expressions

  /// Leaves exactly one value on the stack.
  void value(const Expression& node) {
    if (too_large_ || diagnostics_.full()) return;
    switch (node.kind) {
      case ExpressionKind::kNumber:
        return push(node.value);
      case ExpressionKind::kText:
        return push_text(node.text, node.place);
      case ExpressionKind::kName:
      case ExpressionKind::kElement: {
        // SetThingSpecial(1, Door_Open, 2): the name of a special alone is its number.
        if (node.kind == ExpressionKind::kName && !is_declared(node.text))
          if (const std::optional<int32_t> special = special_number(node.text)) return push(*special);
        const Symbol* symbol = variable(node);
        if (symbol == nullptr) return;
        if (symbol->is_array) element(*symbol, node, false);
        return emit(variable_code(Operation::kPush, symbol->scope, symbol->is_array), {symbol->index});
      }
      case ExpressionKind::kUnary:
        value(*node.parts[0]);
        return emit(operator_code(node.op));
      case ExpressionKind::kBinary:
        value(*node.parts[0]);
        value(*node.parts[1]);
        return emit(operator_code(node.op));
      case ExpressionKind::kAssign:
        return assign(node, true);
      case ExpressionKind::kIncrement:
        return increment(node, true);
      case ExpressionKind::kConditional: {
        const Label otherwise = new_label(), end = new_label();
        value(*node.parts[0]);
        jump(PCode::kIfNotGoto, otherwise);
        value(*node.parts[1]);
        jump(PCode::kGoto, end);
        bind(otherwise);
        value(*node.parts[2]);
        return bind(end);
      }
      case ExpressionKind::kCall:
        return call(node, true);
      case ExpressionKind::kStrParam:
        emit(PCode::kBeginPrint);
        print_items(node.items);
        return emit(PCode::kSaveString);
      case ExpressionKind::kStrCpy:
        return copy_text(node);
    }
  }

  /// Leaves nothing on the stack.
  void effect(const Expression& node) {
    if (too_large_ || diagnostics_.full()) return;
    switch (node.kind) {
      case ExpressionKind::kAssign:
        return assign(node, false);
      case ExpressionKind::kIncrement:
        return increment(node, false);
      case ExpressionKind::kCall:
        return call(node, false);
      case ExpressionKind::kStrCpy:
        break;
      case ExpressionKind::kConditional: {
        const Label otherwise = new_label(), end = new_label();
        value(*node.parts[0]);
        jump(PCode::kIfNotGoto, otherwise);
        effect(*node.parts[1]);
        jump(PCode::kGoto, end);
        bind(otherwise);
        effect(*node.parts[2]);
        return bind(end);
      }
      default:
        diagnostics_.warn(node.place, "a statement that does nothing");
        break;
    }
    value(node);
    emit(PCode::kDrop);
  }

  /// The variable of a name or element. Null after an error.
  const Symbol* variable(const Expression& node) {
    const Symbol* symbol = find(node.text, node.place);
    if (symbol == nullptr) return nullptr;
    const bool indexed = node.kind == ExpressionKind::kElement;
    if (indexed && !symbol->is_array)
      return error(node.place, in_quotes(node.text) + " with an index", "a variable; it is no array"),
             nullptr;
    if (!indexed && symbol->is_array)
      return error(node.place, "the array " + in_quotes(node.text) + " without an index", "\"[\" behind it"),
             nullptr;
    return symbol;
  }

  /// Leaves the number of an element on the stack. `partial`: fewer indices than dimensions mean the first of
  /// the rest.
  void element(const Symbol& symbol, const Expression& node, bool partial) {
    const std::size_t dimensions = std::max<std::size_t>(symbol.sizes.size(), 1);
    const std::size_t given = node.parts.size();
    if (given > dimensions || (!partial && given < dimensions)) {
      return error(node.place, fmt::format("{} with {} indices", in_quotes(node.text), given),
                   std::to_string(dimensions));
    }
    const std::vector<int32_t> sizes = symbol.sizes;  // what the indices call may add symbols
    bool constant = true;
    int64_t folded = 0;
    for (std::size_t i = 0; i < dimensions; ++i) {
      const int32_t size = i < sizes.size() ? sizes[i] : INT32_MAX;
      if (i < given && node.parts[i]->kind != ExpressionKind::kNumber) constant = false;
      const int32_t index =
          i < given && node.parts[i]->kind == ExpressionKind::kNumber ? node.parts[i]->value : 0;
      if (index < 0 || index >= size)
        diagnostics_.warn(node.place,
                          fmt::format("index {} lies outside of {}", index, in_quotes(node.text)));
      folded = folded * (i == 0 ? 1 : size) + index;
    }
    if (constant) return push(static_cast<int32_t>(static_cast<uint64_t>(folded)));
    value(*node.parts[0]);
    for (std::size_t i = 1; i < dimensions; ++i) {
      push(sizes[i]);
      emit(PCode::kMultiply);
      if (i < given) {
        value(*node.parts[i]);
        emit(PCode::kAdd);
      }
    }
  }

  void assign(const Expression& node, bool wanted) {
    const Expression& left = *node.parts[0];
    const Symbol* found = variable(left);
    if (found == nullptr) return;
    const Symbol symbol = *found;
    if (symbol.is_array) {
      element(symbol, left, false);
      if (wanted) emit(PCode::kDuplicate);
    }
    value(*node.parts[1]);
    emit(variable_code(operation_of(node.op), symbol.scope, symbol.is_array), {symbol.index});
    if (wanted) emit(variable_code(Operation::kPush, symbol.scope, symbol.is_array), {symbol.index});
  }

  void increment(const Expression& node, bool wanted) {
    const Expression& operand = *node.parts[0];
    const Symbol* found = variable(operand);
    if (found == nullptr) return;
    const Symbol symbol = *found;
    const PCode step = variable_code(node.op == Operator::kAdd ? Operation::kInc : Operation::kDec,
                                     symbol.scope, symbol.is_array);
    const PCode read = variable_code(Operation::kPush, symbol.scope, symbol.is_array);
    if (symbol.is_array) element(symbol, operand, false);
    if (!wanted) return emit(step, {symbol.index});
    if (symbol.is_array) emit(PCode::kDuplicate);
    if (node.prefix) {
      emit(step, {symbol.index});
      return emit(read, {symbol.index});
    }
    emit(read, {symbol.index});
    if (symbol.is_array) emit(PCode::kSwap);
    emit(step, {symbol.index});
  }

  void copy_text(const Expression& node) {
    const PrintItem& item = node.items[0];
    const Symbol* symbol = array_start(item);
    if (symbol == nullptr) return;
    const Scope scope = symbol->scope;
    item.offset != nullptr ? value(*item.offset) : push(0);
    item.length != nullptr ? value(*item.length) : push(INT32_MAX);
    value(*node.parts[0]);
    node.parts.size() > 1 ? value(*node.parts[1]) : push(0);
    emit(array_code(scope, PCode::kStrCpyToMapChRange, PCode::kStrCpyToWorldChRange,
                    PCode::kStrCpyToGlobalChRange, PCode::kStrCpyToScriptChRange));
  }

  bool is_declared(std::string_view name) const {
    return symbols_.contains(name) || functions_.contains(name) || out_of_scope_.contains(name) ||
           std::any_of(scopes_.begin(), scopes_.end(),
                       [&](const auto& scope) { return scope.contains(name); });
  }
  std::optional<int32_t> special_number(std::string_view name) const {
    if (const auto found = specials_.find(name); found != specials_.end()) return found->second->number;
    // ACS_NamedExecute and its kin, which a line or thing may have as its special, are functions: a minus marks that.
    if (name.starts_with("acs_named"))
      if (const std::optional<BuiltInFunction> function = find_function(name)) return -function->number;
    return wad::find_special(name);
  }

  // ---- calls

  struct FunctionEntry {
    const Routine* routine;
    int32_t index;
  };

  void call(const Expression& node, bool wanted) {
    if (node.only_constants)
      for (const Expression* part : node.parts)
        if (part->kind != ExpressionKind::kNumber && part->kind != ExpressionKind::kText)
          return error(part->place, "a value that is not known before the program runs",
                       "a constant behind const:");
    if (const auto found = functions_.find(node.text); found != functions_.end())
      return call_function(node, found->second, wanted);
    if (const auto found = specials_.find(node.text); found != specials_.end()) {
      const DeclaredSpecial& special = *found->second;
      if (!arguments_fit(node, special.args_min, special.args_max)) return;
      if (special.number < 0) return call_engine(node, -special.number, wanted);
      return call_special(node, special.number, wanted);
    }
    if (node.text == "acs_executewait" || node.text == "acs_namedexecutewait")
      return execute_and_wait(node, wanted);
    if (const std::optional<BuiltInFunction> function = find_function(node.text))
      return call_built_in(node, *function, wanted);
    if (const std::optional<int32_t> special = wad::find_special(node.text)) {
      if (arguments_fit(node, 0, 5)) call_special(node, *special, wanted);
      return;
    }
    const std::string_view near = nearest(node.text);
    error(node.place, "the unknown function " + in_quotes(node.text),
          "a function of the program or the game" +
              (near.empty() ? std::string() : ", perhaps " + std::string(near)));
  }

  bool arguments_fit(const Expression& node, int32_t least, int32_t most) {
    const auto given = static_cast<int32_t>(node.parts.size());
    if (given >= least && given <= most) return true;
    error(node.place,
          fmt::format("{} with {}{}", in_quotes(node.text), given, (given == 1 ? " argument" : " arguments")),
          least == most ? std::to_string(most) : fmt::format("{} to {}", least, most));
    return false;
  }
  bool returns(const Expression& node, bool returns_value, bool wanted) {
    if (!wanted || returns_value) return true;
    error(node.place, "the value of " + in_quotes(node.text), "something that has a value");
    return false;
  }
  bool all_constant(const Expression& node) const {
    return std::all_of(node.parts.begin(), node.parts.end(), [&](const Expression* part) {
      return part->kind == ExpressionKind::kNumber || part->kind == ExpressionKind::kText;
    });
  }
  bool has_text(const Expression& node) const {
    return std::any_of(node.parts.begin(), node.parts.end(),
                       [](const Expression* part) { return part->kind == ExpressionKind::kText; });
  }
  int32_t constant(const Expression& node) {
    return node.kind == ExpressionKind::kText ? text(node.text, node.place) : node.value;
  }

  void call_function(const Expression& node, FunctionEntry& entry, bool wanted) {
    const Routine& routine = *entry.routine;
    const auto arg_count = static_cast<int32_t>(routine.parameters.size());
    if (!arguments_fit(node, arg_count, arg_count) || !returns(node, routine.returns_value, wanted)) return;
    if (entry.index < 0) {  // of a library, used for the first time
      entry.index = static_cast<int32_t>(object_.functions.size());
      object_.functions.push_back(
          {std::string(routine.name), arg_count, 0, routine.returns_value, true, 0, {}});
    }
    for (const Expression* part : node.parts) value(*part);
    emit(wanted ? PCode::kCall : PCode::kCallDiscard, {entry.index});
  }

  void call_built_in(const Expression& node, const BuiltInFunction& function, bool wanted) {
    if (!arguments_fit(node, function.args_min, function.args_max) ||
        !returns(node, function.returns_value, wanted))
      return;
    if (function.waits && !routine_->is_script)
      return error(node.place, in_quotes(function.name) + " in a function", kWaitsInScripts);
    if (function.code == PCode::kCallFunc) return call_engine(node, function.number, wanted);
    const auto missing = static_cast<std::size_t>(function.args_max) - node.parts.size();
    if (function.direct != PCode::kNop && all_constant(node)) {
      std::vector<int32_t> operands;
      for (const Expression* part : node.parts) operands.push_back(constant(*part));
      operands.resize(operands.size() + missing, 0);
      emit(function.direct);
      if (!too_large_)
        for (const int32_t operand : operands) word(operand);
    } else {
      for (const Expression* part : node.parts) value(*part);
      for (std::size_t i = 0; i < missing; ++i) push(0);
      emit(function.code);
    }
    if (function.returns_value && !wanted) emit(PCode::kDrop);
  }

  /// ACS_Execute or ACS_NamedExecute, then a wait for the script that they name.
  void execute_and_wait(const Expression& node, bool wanted) {
    if (!arguments_fit(node, 1, 5) || !returns(node, false, wanted)) return;
    if (!routine_->is_script)
      return error(node.place, in_quotes(node.text) + " in a function", kWaitsInScripts);
    value(*node.parts[0]);
    emit(PCode::kDuplicate);
    for (std::size_t i = 1; i < node.parts.size(); ++i) value(*node.parts[i]);
    const auto given = static_cast<int32_t>(node.parts.size());
    if (node.text == "acs_executewait") {
      emit(offset(PCode::kLspec1, given - 1), {*wad::find_special("acs_execute")});
      return emit(PCode::kScriptWait);
    }
    emit(PCode::kCallFunc, {given, static_cast<int32_t>(bytecode::BuiltIn::kACS_NamedExecute)});
    emit(PCode::kDrop);
    emit(PCode::kScriptWaitNamed);
  }

  void call_engine(const Expression& node, int32_t number, bool wanted) {
    for (const Expression* part : node.parts) value(*part);
    emit(PCode::kCallFunc, {static_cast<int32_t>(node.parts.size()), number});
    if (!wanted) emit(PCode::kDrop);
  }

  void call_special(const Expression& node, int32_t number, bool wanted) {
    const auto given = static_cast<int>(node.parts.size());
    const bool wide = number > kSpecialsInOneByte;
    if (wanted || wide) {
      for (const Expression* part : node.parts) value(*part);
      for (int i = given; i < 5; ++i) push(0);
      return emit(wide ? wanted ? PCode::kLspec5ExResult : PCode::kLspec5Ex : PCode::kLspec5Result, {number});
    }
    const int count = std::max(given, 1);
    // In a library texts need a tag, which operands cannot have.
    if (all_constant(node) && !(object_.is_library && has_text(node))) {
      emit(offset(PCode::kLspec1Direct, count - 1), {number});
      if (too_large_) return;
      for (const Expression* part : node.parts) word(constant(*part));
      if (given == 0) word(0);
      return;
    }
    for (const Expression* part : node.parts) value(*part);
    emit(offset(PCode::kLspec1, count - 1), {number});
  }

  const Program& program_;
  Diagnostics& diagnostics_;
  Object object_;
  bool too_large_ = false;
  Place place_;  // for errors that belong to no node
  std::unordered_map<std::string_view, Symbol> symbols_;
  std::unordered_map<std::string_view, FunctionEntry> functions_;
  std::unordered_map<std::string_view, const DeclaredSpecial*> specials_;
  std::unordered_map<std::string_view, int32_t> texts_;
  std::vector<uint32_t> labels_;
  std::vector<std::pair<uint32_t, Label>> patches_;  // place of the word, label
  // Of the script or function under way.
  const Routine* routine_ = nullptr;
  std::vector<std::unordered_map<std::string_view, Symbol>> scopes_;
  std::unordered_map<std::string_view, Symbol> out_of_scope_;
  int32_t local_count_ = 0;
  std::vector<int32_t> local_arrays_;
  std::vector<Target> targets_;
};

}  // namespace

Object generate(const Program& program, Diagnostics& diagnostics) {
  return Generator(program, diagnostics).run();
}

}  // namespace comrad::acs_compiler
