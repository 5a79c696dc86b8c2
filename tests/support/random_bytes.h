// Seeded hostile input for parser tests. The seed comes from COMRAD_FUZZ_SEED or is fixed; tests print it
// on failure.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "rollout_buffer/core/rng.h"

namespace comrad::test {

/// The seed of this run's hostile bytes.
inline uint64_t fuzz_seed() {
  const char* given = std::getenv("COMRAD_FUZZ_SEED");
  return given != nullptr ? std::strtoull(given, nullptr, 0) : 20240607;
}

inline std::vector<uint8_t> random_bytes(Rng& rng, std::size_t count) {
  std::vector<uint8_t> bytes(count);
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(rng.next());
  return bytes;
}

/// A copy of `text` with a few bytes changed, left out, doubled or moved.
template <typename Bytes>
Bytes mutated(Rng& rng, Bytes text) {
  const int changes = rng.between(1, 8);
  for (int i = 0; i < changes && !text.empty(); ++i) {
    const std::size_t at = rng.below(static_cast<uint32_t>(text.size()));
    switch (rng.below(4)) {
      case 0:
        text[at] = static_cast<typename Bytes::value_type>(rng.next());
        break;
      case 1:
        text.erase(text.begin() + static_cast<std::ptrdiff_t>(at));
        break;
      case 2:
        text.insert(text.begin() + static_cast<std::ptrdiff_t>(at),
                    text[rng.below(static_cast<uint32_t>(text.size()))]);
        break;
      default:
        text.resize(at);
        break;
    }
  }
  return text;
}

}  // namespace comrad::test
