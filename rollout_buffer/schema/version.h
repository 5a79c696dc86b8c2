// Numbers that two processes must agree on before they share bytes. Change what lies in the arena, bump the version, and
// add a line to the table of rollout_buffer/FORMATS.md.
#pragma once

#include <cstddef>
#include <cstdint>

namespace comrad {

constexpr uint32_t kArenaMagic = 0x44524D43;  // "CMRD"
constexpr uint32_t kArenaVersion = 14;
constexpr std::size_t kCacheLineBytes = 64;

constexpr int kTicRateHz = 35;  ///< Doom's world updates per second

/// Optimizer steps of the policy; 0 before the first one. Policy lag is a difference of two of these.
using PolicyVersion = uint32_t;

}  // namespace comrad
