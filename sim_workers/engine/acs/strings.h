// Text of scripts: the lump's strings, those that scripts build at run time, and comparing names without
// case. Stage: tic.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom::acs {

constexpr std::size_t kTextMax = 1 << 16;  ///< bytes of one text that a script builds

/// -1, 0, 1; of at most `count` letters.
int compare_text(std::string_view a, std::string_view b, bool any_case, std::size_t count = SIZE_MAX);
std::string printable(std::string_view text);  ///< for messages: other bytes as '?', cut at 64

/// The number of a string with this text, for a script to keep: the same text has one number. Texts that
/// nothing refers to any more make room. Nothing where there are too many.
std::optional<int32_t> add_string(World& world, std::string_view text);
/// Forgets texts that nothing refers to, once there are many. Only while no script runs: its stack is not
/// looked at.
void purge_strings(World& world);

/// "1.5" for 98304, as printf's %g of the quotient.
void append_fixed(std::string& out, int32_t value);
void append_number(std::string& out, int32_t value);
void append_unsigned(std::string& out, uint32_t value, uint32_t base);

}  // namespace comrad::doom::acs
