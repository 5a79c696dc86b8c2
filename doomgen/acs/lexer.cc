#include "doomgen/acs/lexer.h"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <optional>

#include "rollout_buffer/core/text.h"

namespace comrad::acs_compiler {
namespace {

constexpr std::size_t kNameMax = 128, kTextMax = 32768;
constexpr char kColorEscape = 0x1C;

// Longest first, so that the first match is the right one.
constexpr std::array<std::string_view, 47> kSymbols = {
    "<<=", ">>=", "...", "##", "::", "++", "--", "+=", "-=", "*=", "/=", "%=", "&=", "|=", "^=", "<<",
    ">>",  "<=",  ">=",  "==", "!=", "&&", "||", "{",  "}",  "(",  ")",  "[",  "]",  ";",  ",",  ":",
    "?",   "+",   "-",   "*",  "/",  "%",  "<",  ">",  "=",  "!",  "&",  "|",  "^",  "~",  "#"};

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }

/// Digit of any radix up to 36; 99 for what is none.
int digit_value(char c) {
  if (is_digit(c)) return c - '0';
  const char letter = lower_case(c);
  return letter >= 'a' && letter <= 'z' ? letter - 'a' + 10 : 99;
}

class Lexer {
 public:
  Lexer(std::string_view source, uint32_t file, TextPool& pool, Diagnostics& diagnostics)
      : source_(source), file_(file), pool_(pool), diagnostics_(diagnostics) {
    if (source_.starts_with("\xEF\xBB\xBF")) at_ = line_start_ = 3;
  }

  std::vector<Token> run() {
    while (!diagnostics_.full()) {
      skip_blank();
      if (at_ >= source_.size()) break;
      start_ = at_;
      start_line_ = line_;
      start_column_ = at_ - line_start_ + 1;
      const char c = peek();
      if (is_letter(c)) {
        name();
      } else if (is_digit(c)) {
        number();
      } else if (c == '"') {
        text();
      } else if (c == '\'') {
        character();
      } else {
        symbol();
      }
    }
    return std::move(tokens_);
  }

 private:
  char peek(std::size_t ahead = 0) const {
    return at_ + ahead < source_.size() ? source_[at_ + ahead] : '\0';
  }
  bool at_end() const { return at_ >= source_.size(); }
  void newline() {
    ++line_;
    line_start_ = at_;
  }
  Place here() const { return {file_, line_, static_cast<uint32_t>(at_ - line_start_ + 1)}; }
  Place start() const { return {file_, start_line_, static_cast<uint32_t>(start_column_)}; }
  void add(TokenKind kind, std::string_view content, int32_t value = 0) {
    tokens_.push_back({kind, start(), content, source_.substr(start_, at_ - start_), value});
  }

  void skip_blank() {
    while (!at_end()) {
      const char c = peek();
      if (c == '\n') {
        ++at_;
        newline();
      } else if (static_cast<unsigned char>(c) <= ' ') {
        ++at_;
      } else if (c == '/' && peek(1) == '/') {
        while (!at_end() && peek() != '\n') ++at_;
      } else if (c == '/' && peek(1) == '*') {
        const Place begin = here();
        at_ += 2;
        while (!at_end() && !(peek() == '*' && peek(1) == '/')) {
          ++at_;
          if (source_[at_ - 1] == '\n') newline();
        }
        if (at_end()) {
          diagnostics_.error(begin, "a comment without an end", "*/");
        } else {
          at_ += 2;
        }
      } else {
        return;
      }
    }
  }

  void name() {
    while (is_letter(peek()) || is_digit(peek())) ++at_;
    std::string text(source_.substr(start_, at_ - start_));
    if (text.size() > kNameMax) {
      diagnostics_.error(start(), fmt::format("a name of {} letters", text.size()),
                         fmt::format("at most {}", kNameMax));
      text.resize(kNameMax);
    }
    for (char& c : text) c = lower_case(c);
    add(TokenKind::kName, pool_.keep(std::move(text)));
  }

  /// Digits of a radix from `at_` on; nothing where there is none or they do not fit 32 bits.
  std::optional<uint32_t> digits(int radix) {
    uint64_t value = 0;
    const std::size_t first = at_;
    bool fits = true;
    for (; digit_value(peek()) < radix; ++at_) {
      value = value * static_cast<uint64_t>(radix) + static_cast<uint64_t>(digit_value(peek()));
      if (value > UINT32_MAX) fits = false, value = 0;
    }
    if (at_ == first) {
      diagnostics_.error(here(), "a number without digits", fmt::format("digits of base {}", radix));
      return std::nullopt;
    }
    if (!fits) {
      diagnostics_.error(start(), "the number " + in_quotes(source_.substr(start_, at_ - start_)),
                         "one that fits 32 bits");
      return std::nullopt;
    }
    return static_cast<uint32_t>(value);
  }

  void number() {
    std::optional<uint32_t> value;
    const char second = lower_case(peek(1));
    if (peek() == '0' && (second == 'x' || second == 'o' || second == 'b') && digit_value(peek(2)) < 16) {
      at_ += 2;
      value = digits(second == 'x' ? 16 : second == 'o' ? 8 : 2);
    } else {
      value = digits(10);
      if (value && peek() == '_') {
        if (*value < 2 || *value > 36) {
          diagnostics_.error(start(), fmt::format("base {} of a number", *value), "a base from 2 to 36");
          value = 10;
        }
        ++at_;
        value = digits(static_cast<int>(*value));
      } else if (peek() == '.' && peek(1) != '.') {
        ++at_;
        value = fixed(value.value_or(0));
      } else if (value && source_[start_] == '0' && at_ - start_ > 1) {
        diagnostics_.warn(start(), "a leading zero: " + std::string(source_.substr(start_, at_ - start_)) +
                                       " is decimal, 0o marks octal numbers");
      }
    }
    if (is_letter(peek()) || is_digit(peek())) {
      diagnostics_.error(here(), "a number followed by " + in_quotes(source_.substr(at_, 1)),
                         "a space or an operator");
      while (is_letter(peek()) || is_digit(peek())) ++at_;
    }
    add(TokenKind::kNumber, {}, static_cast<int32_t>(value.value_or(0)));
  }

  /// The digits behind the point, which may be none; the fraction is cut off after 16 bits.
  uint32_t fixed(uint32_t whole) {
    uint64_t fraction = 0, divisor = 1;
    for (; is_digit(peek()); ++at_) {
      if (divisor >= 1'000'000'000'000) continue;
      fraction = fraction * 10 + static_cast<uint64_t>(digit_value(peek()));
      divisor *= 10;
    }
    if (whole > 32768)
      diagnostics_.error(start(), "the number " + in_quotes(source_.substr(start_, at_ - start_)),
                         "a fixed-point number below 32768");
    return (whole << 16) + static_cast<uint32_t>((fraction << 16) / divisor);
  }

  /// What follows a backslash; `out` takes it as the game reads it. A text ends at code 0, so `code_min` is 1 there.
  void escape(std::string& out, int code_min) {
    const char c = peek();
    ++at_;
    switch (c) {
      case 'n':
        out += '\n';
        return;
      case 'r':
        out += '\r';
        return;
      case 't':
        out += '\t';
        return;
      case 'a':
        out += '\a';
        return;
      case 'b':
        out += '\b';
        return;
      case 'f':
        out += '\f';
        return;
      case 'v':
        out += '\v';
        return;
      case 'c':
        out += kColorEscape;
        return;
      case '"':
      case '\'':
      case '\\':
      case '?':
        out += c;
        return;
      case '\r':
        if (peek() == '\n') ++at_;
        newline();
        return;
      case '\n':
        newline();
        return;
      case 'x': {
        int value = 0, count = 0;
        for (; count < 2 && digit_value(peek()) < 16; ++count, ++at_)
          value = value * 16 + digit_value(peek());
        put_code(out, value, count != 0, code_min);
        return;
      }
      default:
        break;
    }
    if (c >= '0' && c <= '7') {
      int value = c - '0';
      for (int count = 1; count < 3 && digit_value(peek()) < 8; ++count, ++at_)
        value = value * 8 + digit_value(peek());
      put_code(out, value, true, code_min);
      return;
    }
    diagnostics_.warn(
        {file_, line_, static_cast<uint32_t>(at_ - line_start_ - 1)},
        "\\" + std::string(1, c >= ' ' && c <= '~' ? c : '?') + " is no escape; the backslash is dropped");
    out += c;
  }
  void put_code(std::string& out, int value, bool has_digits, int code_min) {
    if (!has_digits || value < code_min || value > 255) {
      diagnostics_.error(here(), fmt::format("an escape for character {}", value),
                         fmt::format("a code from {} to 255", code_min));
      return;
    }
    out += static_cast<char>(value);
  }

  void text() {
    std::string content;
    ++at_;
    while (peek() != '"') {
      if (at_end()) {
        diagnostics_.error(start(), "a text without an end", "a closing \"");
        add(TokenKind::kText, pool_.keep(std::move(content)));
        return;
      }
      if (peek() == '\\' && at_ + 1 < source_.size()) {
        ++at_;
        escape(content, 1);
      } else if (peek() == '\0') {
        diagnostics_.error(here(), "a zero byte in a text", "a printable character");
        ++at_;
      } else if (peek() == '\r' && peek(1) == '\n') {
        ++at_;  // a line's end is one character, whatever editor wrote the file
      } else {
        content += peek();
        ++at_;
        if (content.back() == '\n') newline();
      }
    }
    ++at_;
    if (content.size() > kTextMax) {
      diagnostics_.error(start(), fmt::format("a text of {} bytes", content.size()),
                         fmt::format("at most {}", kTextMax));
      content.resize(kTextMax);
    }
    add(TokenKind::kText, pool_.keep(std::move(content)));
  }

  void character() {
    std::string content;
    ++at_;
    if (peek() == '\\' && at_ + 1 < source_.size()) {
      ++at_;
      escape(content, 0);
    } else if (!at_end() && peek() != '\'' && peek() != '\n') {
      content += peek();
      ++at_;
    }
    if (content.size() != 1 || peek() != '\'') {
      diagnostics_.error(start(), "a character that is not one", "one character between two '");
      while (!at_end() && peek() != '\n' && peek() != '\'') ++at_;
      if (peek() == '\'') ++at_;
      return;
    }
    ++at_;
    add(TokenKind::kNumber, {}, static_cast<unsigned char>(content[0]));
  }

  void symbol() {
    for (const std::string_view candidate : kSymbols) {
      if (source_.substr(at_, candidate.size()) != candidate) continue;
      at_ += candidate.size();
      return add(TokenKind::kSymbol, candidate);
    }
    diagnostics_.error(start(), "the character " + in_quotes(source_.substr(at_, 1)),
                       "a word, number, text or operator");
    ++at_;
  }

  std::string_view source_;
  uint32_t file_;
  TextPool& pool_;
  Diagnostics& diagnostics_;
  std::vector<Token> tokens_;
  std::size_t at_ = 0, start_ = 0, line_start_ = 0, start_column_ = 1;
  uint32_t line_ = 1, start_line_ = 1;
};

}  // namespace

std::string describe(const Token& token) {
  switch (token.kind) {
    case TokenKind::kEnd:
    case TokenKind::kImportEnd:
      return "the end of the file";
    case TokenKind::kName:
      return in_quotes(token.spelling);
    case TokenKind::kNumber:
      return "the number " + in_quotes(token.spelling);
    case TokenKind::kText:
      return "the text " + in_quotes(token.text);
    case TokenKind::kDirective:
      return "\"#" + std::string(token.text) + "\"";
    default:
      return in_quotes(token.text);
  }
}

std::vector<Token> lex(std::string_view source, uint32_t file, TextPool& pool, Diagnostics& diagnostics) {
  return Lexer(source, file, pool, diagnostics).run();
}

}  // namespace comrad::acs_compiler
