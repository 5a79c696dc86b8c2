// Randomness as keys: a run's key is split by purpose, environment and episode, so that any episode replays
// from its seed and no draw depends on which process made it first. Integer only: the same on every machine.
#pragma once

#include <cstdint>
#include <string_view>

namespace comrad {

/// One round of the SplitMix64 output function. Source: Steele, Lea, Flood 2014, "Fast splittable
/// pseudorandom number generators", with the finaliser constants of Stafford's Mix13.
constexpr uint64_t mix64(uint64_t z) {
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

constexpr uint64_t kGoldenGamma = 0x9E3779B97F4A7C15ull;

/// A place in the tree of random streams. Splitting is pure: key.split(3) is the same key everywhere.
class RngKey {
 public:
  constexpr explicit RngKey(uint64_t seed) : state_(mix64(seed + kGoldenGamma)) {}

  /// The child number `index` of this key.
  constexpr RngKey split(uint64_t index) const {
    return RngKey(Raw{mix64(state_ + kGoldenGamma * (2 * index + 1)) ^ mix64(index + 0x5851F42D4C957F2Dull)});
  }
  /// The child named `purpose`, for streams that must never collide with numbered ones.
  constexpr RngKey split(std::string_view purpose) const {
    uint64_t hash = 0xCBF29CE484222325ull;  // FNV-1a 64
    for (char c : purpose) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3ull;
    return RngKey(Raw{mix64(state_ ^ hash) + kGoldenGamma});
  }
  /// 64 well-mixed bits of this key itself.
  constexpr uint64_t bits() const { return mix64(state_ + kGoldenGamma); }
  /// Uniform in [0, 1) with 24 bits, exact in float.
  constexpr float uniform() const { return static_cast<float>(bits() >> 40) * 0x1p-24f; }

 private:
  struct Raw {
    uint64_t state;
  };
  constexpr explicit RngKey(Raw raw) : state_(raw.state) {}
  uint64_t state_;
};

/// A sequential stream (SplitMix64) below one key.
class Rng {
 public:
  constexpr explicit Rng(RngKey key) : state_(key.bits()) {}
  constexpr explicit Rng(uint64_t seed) : Rng(RngKey(seed)) {}

  constexpr uint64_t next() { return mix64(state_ += kGoldenGamma); }
  /// Uniform integer in [0, bound); bound > 0. Multiply-shift with rejection (Lemire 2019): no bias.
  constexpr uint32_t below(uint32_t bound) {
    uint64_t product = (next() >> 32) * bound;
    if (static_cast<uint32_t>(product) < bound) {
      const uint32_t threshold = (0u - bound) % bound;
      while (static_cast<uint32_t>(product) < threshold) product = (next() >> 32) * bound;
    }
    return static_cast<uint32_t>(product >> 32);
  }
  /// Uniform integer in [low, high], both included.
  constexpr int32_t between(int32_t low, int32_t high) {
    return low + static_cast<int32_t>(below(static_cast<uint32_t>(high - low) + 1u));
  }
  /// Uniform in [0, 1) with 53 bits.
  constexpr double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }

  /// The whole state, for snapshots: Rng::restore(rng.state()) continues the same stream.
  constexpr uint64_t state() const { return state_; }
  static constexpr Rng restore(uint64_t state) {
    Rng rng(uint64_t{0});
    rng.state_ = state;
    return rng;
  }

 private:
  uint64_t state_;
};

}  // namespace comrad
