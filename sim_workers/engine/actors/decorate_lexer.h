// Tokens of a DECORATE lump, read one at a time. Sprites and frames are a separate kind of words, so the
// parser states what it expects. Stage: loading.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"

namespace comrad::doom {

struct Token {
  enum class Kind : uint8_t { kEnd, kName, kInteger, kDecimal, kText, kSymbol, kBroken };
  Kind kind = Kind::kEnd;
  std::string text;  ///< name, symbol, or what stands between the quotes; of kBroken: what is wrong
  double number = 0.0;
  int32_t line = 1, column = 1;

  bool is(std::string_view symbol) const { return kind == Kind::kSymbol && text == symbol; }
  bool is_name(std::string_view name) const;  ///< any case
};

class DecorateLexer {
 public:
  explicit DecorateLexer(std::string_view text) : text_(text) {}

  /// The next token. Names hold letters, digits and underscores; symbols are one character, or "::", "<<",
  /// ">>", "<=", ">=", "==", "!=", "&&", "||".
  Token next();
  Token peek();
  /// The next word up to a blank, a comment or one of : { } ( ) ; , and the quote; a text in quotes counts as
  /// a word. Empty at the end.
  Token word();
  /// Skips what is left of `line`.
  void skip_line(int32_t line);

 private:
  bool skip_blanks();  ///< false: a comment has no end
  void advance();
  char at(std::size_t offset) const { return place_ + offset < text_.size() ? text_[place_ + offset] : '\0'; }
  Token read_text();
  Token read_number();

  std::string_view text_;
  std::size_t place_ = 0;
  int32_t line_ = 1, column_ = 1;
};

}  // namespace comrad::doom
