#include "sim_workers/engine/actors/decorate_expression.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad::doom {
namespace {

constexpr int kNestingMax = 48;

int64_t whole(double value) {
  return std::isfinite(value) ? static_cast<int64_t>(std::clamp(value, -4e18, 4e18)) : 0;
}

/// How strongly an operator binds; -1 for what is none.
int strength_of(const std::string& symbol) {
  if (symbol == "||") return 1;
  if (symbol == "&&") return 2;
  if (symbol == "|") return 3;
  if (symbol == "^") return 4;
  if (symbol == "&") return 5;
  if (symbol == "==" || symbol == "!=") return 6;
  if (symbol == "<" || symbol == ">" || symbol == "<=" || symbol == ">=") return 7;
  if (symbol == "<<" || symbol == ">>") return 8;
  if (symbol == "+" || symbol == "-") return 9;
  if (symbol == "*" || symbol == "/" || symbol == "%") return 10;
  return -1;
}

class Reader {
 public:
  Reader(DecorateLexer* lexer, const DecorateNames& names) : lexer_(*lexer), names_(names) {}

  Expected<DecorateValue> choice() {
    COMRAD_TRY_ASSIGN(DecorateValue condition, binary(0));
    if (!lexer_.peek().is("?")) return condition;
    const Token mark = lexer_.next();
    if (++depth_ > kNestingMax) return error_at(mark, "an expression is nested too deeply");
    COMRAD_TRY_ASSIGN(DecorateValue yes, choice());
    if (const Token colon = lexer_.next(); !colon.is(":"))
      return error_at(colon, "':' of a choice is missing");
    COMRAD_TRY_ASSIGN(DecorateValue no, choice());
    --depth_;
    return condition.number != 0.0 ? yes : no;
  }

  Expected<DecorateValue> primary() {
    Token token = lexer_.next();
    DecorateValue value;
    value.line = token.line, value.column = token.column;
    switch (token.kind) {
      case Token::Kind::kInteger:
      case Token::Kind::kDecimal:
        value.number = token.number;
        value.decimal = token.kind == Token::Kind::kDecimal;
        return value;
      case Token::Kind::kText:
        value.kind = DecorateValue::Kind::kText;
        value.text = std::move(token.text);
        return value;
      case Token::Kind::kName:
        return word(token, std::move(value));
      case Token::Kind::kBroken:
        return error_at(token, token.text);
      case Token::Kind::kEnd:
        return error_at(token, "the lump ends where a value must stand");
      case Token::Kind::kSymbol:
        break;
    }
    if (++depth_ > kNestingMax) return error_at(token, "an expression is nested too deeply");
    if (token.is("(")) {
      COMRAD_TRY_ASSIGN(value, choice());
      if (const Token end = lexer_.next(); !end.is(")")) return error_at(end, "')' is missing");
      value.in_parentheses = true;
    } else if (token.is("-") || token.is("+") || token.is("!") || token.is("~")) {
      COMRAD_TRY_ASSIGN(value, primary());
      if (value.kind == DecorateValue::Kind::kText) return error_at(token, "a number must stand here");
      if (token.is("-")) {
        const double low = value.number;
        value.number = value.kind == DecorateValue::Kind::kRandom ? -value.high : -low;
        value.high = -low;
        value.step = -value.step;
      } else if (token.is("!")) {
        value.number = value.number == 0.0 ? 1.0 : 0.0;
      } else if (token.is("~")) {
        value.number = static_cast<double>(~whole(value.number));
      }
    } else {
      return error_at(token, "'" + token.text + "' where a value must stand");
    }
    --depth_;
    return value;
  }

 private:
  Expected<DecorateValue> binary(int weakest) {
    COMRAD_TRY_ASSIGN(DecorateValue left, primary());
    while (true) {
      const Token symbol = lexer_.peek();
      const int strength = symbol.kind == Token::Kind::kSymbol ? strength_of(symbol.text) : -1;
      if (strength < 0 || strength <= weakest) return left;
      lexer_.next();
      if (++depth_ > kNestingMax) return error_at(symbol, "an expression is nested too deeply");
      COMRAD_TRY_ASSIGN(DecorateValue right, binary(strength));
      --depth_;
      COMRAD_TRY_ASSIGN(left, combine(symbol, left, right));
    }
  }

  /// A word that is no constant belongs to the running game: reported, and 0 from here on.
  DecorateValue known(DecorateValue value) const {
    if (value.kind != DecorateValue::Kind::kText || !value.name) return value;
    if (names_.unknown)
      names_.unknown(
          {.kind = Token::Kind::kName, .text = value.text, .line = value.line, .column = value.column});
    DecorateValue zero;
    zero.line = value.line, zero.column = value.column;
    return zero;
  }

  Expected<DecorateValue> combine(const Token& symbol, DecorateValue left, DecorateValue right) {
    left = known(std::move(left)), right = known(std::move(right));
    if (left.kind == DecorateValue::Kind::kText || right.kind == DecorateValue::Kind::kText)
      return error_at(symbol, "'" + symbol.text + "' needs a number on both sides");
    const bool left_drawn = left.kind == DecorateValue::Kind::kRandom,
               right_drawn = right.kind == DecorateValue::Kind::kRandom;
    if (left_drawn || right_drawn) return combine_draws(symbol, left, right);
    const double a = left.number, b = right.number;
    const int64_t x = whole(a), y = whole(b);
    const bool decimal = left.decimal || right.decimal;
    left.decimal = false;
    const std::string& text = symbol.text;
    if (text == "+") left.number = a + b, left.decimal = decimal;
    if (text == "-") left.number = a - b, left.decimal = decimal;
    if (text == "*") left.number = a * b, left.decimal = decimal;
    if (text == "/" || text == "%") {
      if (b == 0.0 || (!decimal && y == 0)) return error_at(symbol, "a division by zero");
      left.decimal = decimal;
      if (text == "/") {
        left.number = decimal ? a / b : static_cast<double>(x / y);
      } else {
        left.number = decimal ? std::fmod(a, b) : static_cast<double>(y == -1 ? 0 : x % y);
      }
    }
    if (text == "|") left.number = static_cast<double>(x | y);
    if (text == "&") left.number = static_cast<double>(x & y);
    if (text == "^") left.number = static_cast<double>(x ^ y);
    if (text == "<<")
      left.number = static_cast<double>(static_cast<int32_t>(static_cast<uint32_t>(x) << (y & 31)));
    if (text == ">>") left.number = static_cast<double>(static_cast<int32_t>(x) >> (y & 31));
    if (text == "==") left.number = a == b;
    if (text == "!=") left.number = a != b;
    if (text == "<") left.number = a < b;
    if (text == ">") left.number = a > b;
    if (text == "<=") left.number = a <= b;
    if (text == ">=") left.number = a >= b;
    if (text == "&&") left.number = a != 0.0 && b != 0.0;
    if (text == "||") left.number = a != 0.0 || b != 0.0;
    return finite(symbol, left);
  }

  /// A draw can be moved and stretched; anything else of it is left to the running game, which this engine
  /// does not do.
  Expected<DecorateValue> combine_draws(const Token& symbol, DecorateValue left, const DecorateValue& right) {
    const bool left_drawn = left.kind == DecorateValue::Kind::kRandom;
    const bool both = left_drawn && right.kind == DecorateValue::Kind::kRandom;
    DecorateValue draw = left_drawn ? left : right;
    const double other = left_drawn ? right.number : left.number;
    const bool can_move = symbol.is("+") || (symbol.is("-") && left_drawn);
    if (both || !(can_move || symbol.is("*"))) {
      if (names_.unknown) names_.unknown(symbol);
      return draw;
    }
    if (symbol.is("*")) {
      draw.number *= other, draw.high *= other, draw.step *= other;
      if (other < 0) std::swap(draw.number, draw.high);
    } else {
      draw.number += symbol.is("-") ? -other : other;
      draw.high += symbol.is("-") ? -other : other;
    }
    return finite(symbol, draw);
  }

  /// Two numbers that can be written may have a result that no number represents; infinity less infinity is none at
  /// all, and every clamp lets it through.
  static Expected<DecorateValue> finite(const Token& symbol, const DecorateValue& result) {
    if (std::isfinite(result.number) && std::isfinite(result.high) && std::isfinite(result.step))
      return result;
    return error_at(symbol, "the result of '" + symbol.text + "' is too large");
  }

  Expected<DecorateValue> word(const Token& token, DecorateValue value) {
    if (lexer_.peek().is("(") || lexer_.peek().is("[")) return call(token, std::move(value));
    if (const std::optional<double> known = names_.constant ? names_.constant(token.text) : std::nullopt) {
      value.number = *known;
      value.decimal = *known != std::floor(*known);
      value.name = true;
      value.text = token.text;
      return value;
    }
    value.kind = DecorateValue::Kind::kText;
    value.name = true;
    value.text = token.text;
    return value;
  }

  Expected<DecorateValue> call(const Token& name, DecorateValue value) {
    const bool random = name.is_name("random") || name.is_name("frandom");
    if (random && lexer_.peek().is("[")) {  // the name of a random number stream
      lexer_.next(), lexer_.next();
      if (const Token end = lexer_.next(); !end.is("]")) return error_at(end, "']' is missing");
    }
    const Token open = lexer_.next();
    if (++depth_ > kNestingMax) return error_at(open, "an expression is nested too deeply");
    const std::string close = open.is("[") ? "]" : ")";
    double values[4] = {};
    std::size_t count = 0;
    while (!lexer_.peek().is(close)) {
      COMRAD_TRY_ASSIGN(const DecorateValue arg, choice());
      if (count < 4) values[count] = arg.kind == DecorateValue::Kind::kText ? 0.0 : arg.number;
      ++count;
      if (!lexer_.peek().is(",")) break;
      lexer_.next();
    }
    if (const Token end = lexer_.next(); !end.is(close)) return error_at(end, "'" + close + "' is missing");
    --depth_;
    if (random && (count == 0 || count == 2)) {
      value.kind = DecorateValue::Kind::kRandom;
      if (count == 0) values[1] = 255.0;
      value.number = std::min(values[0], values[1]);
      value.high = std::max(values[0], values[1]);
      if (name.is_name("frandom") && names_.unknown) names_.unknown(name);
    } else if (name.is_name("abs") && count == 1) {
      value.number = std::abs(values[0]);
    } else if (name.is_name("int") && count == 1) {
      value.number = std::trunc(values[0]);
    } else {
      if (names_.unknown) names_.unknown(name);
      value.number = 0.0;
    }
    return value;
  }

  DecorateLexer& lexer_;
  const DecorateNames& names_;
  int depth_ = 0;
};

}  // namespace

Error error_at(const Token& token, const std::string& what) {
  return {ErrorCode::kBadFormat, fmt::format("{}:{}: {}", token.line, token.column, what)};
}

int32_t DecorateValue::integer() const {
  return static_cast<int32_t>(std::clamp<int64_t>(whole(number), INT32_MIN, INT32_MAX));
}

Fixed DecorateValue::fixed() const {
  if (!std::isfinite(number)) return 0;
  return static_cast<Fixed>(std::clamp(std::floor(number * kFracUnit + 0.5), -2147483647.0, 2147483647.0));
}

Fixed DecorateValue::fixed_cut() const {
  if (!std::isfinite(number)) return 0;
  return static_cast<Fixed>(std::clamp(std::trunc(number * kFracUnit), -2147483647.0, 2147483647.0));
}

Expected<DecorateValue> read_expression(DecorateLexer* lexer, const DecorateNames& names) {
  return Reader(lexer, names).choice();
}

Expected<DecorateValue> read_property_value(DecorateLexer* lexer, const DecorateNames& names) {
  return Reader(lexer, names).primary();
}

}  // namespace comrad::doom
