// Source text to tokens: names, numbers in every notation of the language, texts with their escapes, symbols.
#pragma once

#include <deque>
#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "doomgen/acs/diagnostics.h"

namespace comrad::acs_compiler {

enum class TokenKind : uint8_t {
  kEnd,
  kName,         ///< text: lower case, for the language ignores case; spelling: as written
  kNumber,       ///< value; also characters and fixed-point numbers
  kText,         ///< text: with its escapes replaced
  kSymbol,       ///< text: the operator or bracket
  kDirective,    ///< text: define, libdefine, library
  kImportBegin,  ///< what follows belongs to an imported library
  kImportEnd
};

struct Token {
  TokenKind kind = TokenKind::kEnd;
  Place place;
  std::string_view text, spelling;
  int32_t value = 0;

  bool is(std::string_view symbol) const { return kind == TokenKind::kSymbol && text == symbol; }
  bool is_name(std::string_view name) const { return kind == TokenKind::kName && text == name; }
};

/// What a message calls a token.
std::string describe(const Token& token);

/// Keeps texts alive for the string_views of tokens and trees.
class TextPool {
 public:
  std::string_view keep(std::string text) { return *texts_.insert(std::move(text)).first; }

 private:
  std::unordered_set<std::string> texts_;  // its nodes never move
};

/// All tokens of one file, without a kEnd. '#' comes as a symbol. Errors go to `diagnostics`; lexing continues.
std::vector<Token> lex(std::string_view source, uint32_t file, TextPool& pool, Diagnostics& diagnostics);

}  // namespace comrad::acs_compiler
