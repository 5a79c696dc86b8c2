// What a program may name without declaring it: constants and functions; line specials are in
// doomgen/wad/special_names.h. The numbers are the public ones of Hexen and ZDoom; the declarations are this
// project's own.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "doomgen/acs/pcodes.h"

namespace comrad::acs_compiler {

/// The value of a built-in constant such as APROP_Health. `name` in lower case.
std::optional<int32_t> find_constant(std::string_view name);

/// A function that the game provides.
struct BuiltInFunction {
  std::string_view name;
  bytecode::PCode code = bytecode::PCode::kNop;  ///< kCallFunc: through `number`
  bytecode::PCode direct =
      bytecode::PCode::kNop;           ///< the same with constants in the code; kNop: there is none
  int32_t number = 0;                  ///< of CallFunc
  int32_t args_min = 0, args_max = 0;  ///< p-codes take args_max: what is not given is 0
  bool returns_value = false;
  bool waits = false;  ///< such as Delay, which a function of the program cannot do
};
std::optional<BuiltInFunction> find_function(std::string_view name);  ///< in lower case

/// The built-in name closest to a mistyped one; empty where none is near.
std::string_view nearest_name(std::string_view name);

}  // namespace comrad::acs_compiler
