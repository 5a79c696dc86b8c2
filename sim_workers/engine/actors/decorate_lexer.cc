#include "sim_workers/engine/actors/decorate_lexer.h"

#include <array>
#include <charconv>

#include "rollout_buffer/core/text.h"

namespace comrad::doom {
namespace {

bool is_blank(char letter) {
  return letter == ' ' || letter == '\t' || letter == '\r' || letter == '\n' || letter == '\f' ||
         letter == '\0';
}
bool is_digit(char letter) { return letter >= '0' && letter <= '9'; }
bool is_name_letter(char letter) {
  return (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z') || letter == '_' ||
         is_digit(letter);
}

constexpr std::array<std::string_view, 9> kTwoCharacterSymbols = {
    "::", "<<", ">>", "<=", ">=", "==", "!=", "&&", "||"};

}  // namespace

bool Token::is_name(std::string_view name) const {
  return kind == Kind::kName && same_ignoring_case(text, name);
}

void DecorateLexer::advance() {
  if (text_[place_++] == '\n') {
    ++line_, column_ = 1;
  } else {
    ++column_;
  }
}

bool DecorateLexer::skip_blanks() {
  while (place_ < text_.size()) {
    if (is_blank(at(0))) {
      advance();
    } else if (at(0) == '/' && at(1) == '/') {
      while (place_ < text_.size() && at(0) != '\n') advance();
    } else if (at(0) == '/' && at(1) == '*') {
      const std::size_t end = text_.find("*/", place_ + 2);
      if (end == std::string_view::npos) return false;
      while (place_ < end + 2) advance();
    } else {
      return true;
    }
  }
  return true;
}

Token DecorateLexer::read_text() {
  Token token{.kind = Token::Kind::kText, .text = {}, .line = line_, .column = column_};
  const char quote = at(0);
  advance();
  while (place_ < text_.size() && at(0) != quote) {
    if (at(0) == '\\' && place_ + 1 < text_.size() && (at(1) == quote || at(1) == '\\')) advance();
    token.text += at(0);
    advance();
  }
  if (place_ == text_.size()) {
    token.kind = Token::Kind::kBroken;
    token.text = "a text has no closing quote";
    return token;
  }
  advance();
  return token;
}

Token DecorateLexer::read_number() {
  Token token{.kind = Token::Kind::kInteger, .text = {}, .line = line_, .column = column_};
  const bool hexadecimal = at(0) == '0' && (at(1) == 'x' || at(1) == 'X');
  std::size_t length = hexadecimal ? 2 : 0;
  if (hexadecimal) {
    uint64_t value = 0;
    const char* first = text_.data() + place_ + 2;
    const auto [end, error] = std::from_chars(first, text_.data() + text_.size(), value, 16);
    length += static_cast<std::size_t>(end - first);
    token.number = error == std::errc() ? static_cast<double>(value) : -1.0;
    if (error != std::errc()) token.kind = Token::Kind::kBroken;
  } else {
    const char* first = text_.data() + place_;
    const auto [end, error] = std::from_chars(first, text_.data() + text_.size(), token.number);
    length = static_cast<std::size_t>(end - first);
    if (error != std::errc()) token.kind = Token::Kind::kBroken;
    for (std::size_t offset = 0; offset < length; ++offset)
      if (!is_digit(at(offset)) && token.kind == Token::Kind::kInteger) token.kind = Token::Kind::kDecimal;
  }
  token.text = text_.substr(place_, length);
  if (token.kind == Token::Kind::kBroken) token.text = "'" + token.text + "' is no number";
  for (std::size_t offset = 0; offset < length || offset == 0; ++offset) advance();
  return token;
}

Token DecorateLexer::next() {
  Token token{.text = {}, .line = line_, .column = column_};
  if (!skip_blanks()) {
    token = {.kind = Token::Kind::kBroken, .text = "a comment has no end", .line = line_, .column = column_};
    place_ = text_.size();
    return token;
  }
  token.line = line_, token.column = column_;
  if (place_ == text_.size()) return token;
  const char letter = at(0);
  if (letter == '"' || letter == '\'') return read_text();
  if (is_digit(letter) || (letter == '.' && is_digit(at(1)))) return read_number();
  if (is_name_letter(letter)) {
    token.kind = Token::Kind::kName;
    while (place_ < text_.size() && is_name_letter(at(0))) token.text += at(0), advance();
    return token;
  }
  token.kind = Token::Kind::kSymbol;
  token.text = letter;
  for (const std::string_view symbol : kTwoCharacterSymbols)
    if (letter == symbol[0] && at(1) == symbol[1]) token.text = symbol;
  for (std::size_t length = token.text.size(); length > 0; --length) advance();
  return token;
}

Token DecorateLexer::peek() {
  DecorateLexer ahead = *this;
  return ahead.next();
}

Token DecorateLexer::word() {
  if (!skip_blanks()) return next();
  if (at(0) == '"' || at(0) == '\'') return read_text();
  Token token{.text = {}, .line = line_, .column = column_};
  while (place_ < text_.size() && !is_blank(at(0)) &&
         std::string_view(":{}();,\"").find(at(0)) == std::string_view::npos &&
         !(at(0) == '/' && (at(1) == '/' || at(1) == '*'))) {
    token.kind = Token::Kind::kName;
    token.text += at(0);
    advance();
  }
  return token;
}

void DecorateLexer::skip_line(int32_t line) {
  while (place_ < text_.size() && line_ == line) advance();
}

}  // namespace comrad::doom
