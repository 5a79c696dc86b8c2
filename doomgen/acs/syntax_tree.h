// A program's syntax tree, as the parser leaves it and the code generator takes it. All nodes live in the
// Program's deques, so pointers stay good and deep trees are freed without recursion. Names are lower case.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "doomgen/acs/diagnostics.h"
#include "doomgen/acs/lexer.h"

namespace comrad::acs_compiler {

enum class Operator : uint8_t {
  kNone,
  kAdd,
  kSubtract,
  kMultiply,
  kDivide,
  kModulus,
  kEqual,
  kNotEqual,
  kLess,
  kGreater,
  kLessOrEqual,
  kGreaterOrEqual,
  kAndLogical,
  kOrLogical,
  kAnd,
  kOr,
  kEor,
  kLeftShift,
  kRightShift,
  kMinus,  // one operand from here on
  kNot,
  kComplement
};

struct Expression;

/// One `s:text` of Print and its kin.
struct PrintItem {
  char kind = 's';
  Place place;
  Expression* value = nullptr;                      ///< of an array: its name, with indices
  Expression *offset = nullptr, *length = nullptr;  ///< of `a:(array, offset, length)`
};

enum class ExpressionKind : uint8_t {
  kNumber,       ///< value
  kText,         ///< text
  kName,         ///< text
  kElement,      ///< text[parts...]
  kUnary,        ///< op parts[0]
  kBinary,       ///< parts[0] op parts[1]
  kAssign,       ///< parts[0] op= parts[1]; kNone: =
  kIncrement,    ///< ++ (kAdd) or -- (kSubtract) on parts[0]; prefix
  kConditional,  ///< parts[0] ? parts[1] : parts[2]
  kCall,         ///< text(parts...)
  kStrParam,     ///< items
  kStrCpy        ///< items[0] is the array, parts the rest
};

struct Expression {
  ExpressionKind kind = ExpressionKind::kNumber;
  Place place;
  Operator op = Operator::kNone;
  bool prefix = false;
  bool only_constants = false;  ///< of a call written with `const:`
  int32_t value = 0;
  int32_t depth = 1;  ///< of the tree below
  std::string_view text;
  std::vector<Expression*> parts;
  std::vector<PrintItem> items;
};

enum class Scope : uint8_t { kScript, kMap, kWorld, kGlobal };

struct Variable {
  Scope scope = Scope::kScript;
  std::string_view name;
  Place place;
  int32_t number = -1;  ///< of world and global ones
  bool is_array = false;
  bool imported = false;
  std::vector<int32_t> sizes;                             ///< empty for world and global arrays
  std::vector<std::pair<int32_t, Expression*>> initials;  ///< element, value
};

struct Statement;

enum class StatementKind : uint8_t {
  kBlock,       ///< body
  kDeclare,     ///< variables
  kExpression,  ///< expressions
  kIf,          ///< condition, body[0], perhaps body[1]
  kWhile,       ///< condition, body[0]; negated: until
  kDo,          ///< condition, body[0]; negated: until
  kFor,         ///< body[0] first (or null), condition (or null), expressions after each turn, body[1]
  kSwitch,      ///< condition, body[0]
  kCase,        ///< condition is the value
  kDefault,
  kBreak,
  kContinue,
  kReturn,  ///< condition or null
  kTerminate,
  kSuspend,
  kRestart,
  kPrint,       ///< text is print, printbold, log, hudmessage, hudmessagebold; items; expressions
  kTranslation  ///< ranges; condition is the number
};

/// One range of CreateTranslation: a:b = ...
struct TranslationRange {
  Place place;
  Expression* ends[2] = {nullptr, nullptr};
  enum class Kind : uint8_t { kPalette, kColors, kDesaturated } kind = Kind::kPalette;
  std::vector<Expression*> values;  ///< 2 or 6
};

struct Statement {
  StatementKind kind = StatementKind::kBlock;
  Place place;
  bool negated = false;
  std::string_view text;
  Expression* condition = nullptr;
  std::vector<Expression*> expressions;
  std::vector<Statement*> body;
  std::vector<Variable> variables;
  std::vector<PrintItem> items;
  std::vector<TranslationRange> ranges;
};

struct Parameter {
  std::string_view name;
  Place place;
};

/// A script or a function.
struct Routine {
  Place place, end;
  bool is_script = false;
  std::string_view name;  ///< of functions, lower case; of named scripts as written
  bool named = false;     ///< of scripts
  int32_t number = 0;     ///< of numbered scripts
  int32_t type = 0;       ///< of scripts, as in the SPTR chunk
  bool net = false, clientside = false;
  bool returns_value = false;
  bool imported = false;
  std::vector<Parameter> parameters;
  Statement* body = nullptr;
};

/// A line special or function declared in the source: `special 80:ACS_Execute(1, 5);`
struct DeclaredSpecial {
  std::string_view name;
  int32_t number = 0;  ///< negative: function -number of CallFunc
  int32_t args_min = 0, args_max = 5;
};

struct Program {
  std::vector<Variable> variables;  ///< of map, world and global scope
  std::vector<Routine> routines;
  std::vector<DeclaredSpecial> specials;
  std::string library;               ///< #library; empty for a map's script
  std::vector<std::string> imports;  ///< names of libraries, in order
  bool encrypts_texts = false;

  std::deque<Expression> expressions;
  std::deque<Statement> statements;
  TextPool pool;
};

}  // namespace comrad::acs_compiler
