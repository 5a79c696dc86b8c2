// Brings the files of a program together: #include puts a file's tokens in place, #import puts them between
// marks, and the directives that only set something are noted.
#pragma once

#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "doomgen/acs/compiler.h"
#include "doomgen/acs/lexer.h"

namespace comrad::acs_compiler {

struct SourceTokens {
  std::vector<Token> tokens;  ///< of all files, with one kEnd
  bool encrypts_texts = false;
};

/// Names of the community's header files. What they declare is built in, so including them does nothing.
bool is_built_in_header(std::string_view name);

/// Lexes `source` and all that it includes and imports. Errors go to `diagnostics`.
///
///   texts   keeps every file's text alive, as tokens point into it
SourceTokens load_source(std::string_view source, const std::string& path, const CompileOptions& options,
                         TextPool& pool, std::deque<std::string>& texts, Diagnostics& diagnostics);

}  // namespace comrad::acs_compiler
