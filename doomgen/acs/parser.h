// Tokens to syntax tree. Constants, #define'd and built in, are put in and folded on the way, because sizes
// of arrays and numbers of scripts need them. After an error the parser continues behind the statement, so that
// one run shows several.
#pragma once

#include <vector>

#include "doomgen/acs/diagnostics.h"
#include "doomgen/acs/lexer.h"
#include "doomgen/acs/syntax_tree.h"

namespace comrad::acs_compiler {

/// Parses all tokens (the last is kEnd) into `program`, whose pool owns their texts.
void parse(const std::vector<Token>& tokens, Program& program, Diagnostics& diagnostics);

}  // namespace comrad::acs_compiler
