// Syntax tree to p-codes and tables. Names are looked up here: local variables, those of the map, functions,
// what the game provides.
#pragma once

#include "doomgen/acs/diagnostics.h"
#include "doomgen/acs/object_writer.h"
#include "doomgen/acs/syntax_tree.h"

namespace comrad::acs_compiler {

/// Of no use where `diagnostics` has an error afterwards.
Object generate(const Program& program, Diagnostics& diagnostics);

}  // namespace comrad::acs_compiler
