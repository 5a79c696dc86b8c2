// What is drawn next: units of a replay have serial numbers in the order of their coming, the oldest leave
// first, and a sampler chooses among those that are there. It is independent of trajectories. Stage: sample.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/rng.h"

namespace comrad::replay {

struct Pick {
  int64_t serial = 0;
  double weight = 1;  ///< importance weight, 1 at most
};

/// What a checkpoint needs to draw on as if nothing had happened.
struct SamplerState {
  int64_t first = 0;                    ///< serial of the oldest unit
  int64_t leaf_capacity = 0;            ///< of the sum tree; 0 without one
  double max_priority = 1;              ///< running maximum, given to new units
  std::vector<double> priorities = {};  ///< of every unit, oldest first; empty without priorities
};

/// Threads: no locks; Replay adds them.
class Sampler {
 public:
  virtual ~Sampler() = default;
  /// `count` new units take the next serials.
  virtual void push(int64_t count) = 0;
  /// The `count` oldest units leave.
  virtual void pop(int64_t count) = 0;
  /// Appends `count` picks, with replacement; none where there are no units.
  virtual void draw(int64_t count, double beta, Rng& rng, std::vector<Pick>& picks) const = 0;
  /// New temporal-difference errors. Units that left meanwhile and errors that are not finite are
  /// passed over.
  virtual void set_priorities(std::span<const int64_t> serials, std::span<const float> abs_td) = 0;

  /// The probability of the unit that draw() takes least often; 0 where there are no units.
  virtual double least_probability() const = 0;

  virtual SamplerState state() const = 0;
  /// Takes over a state of `count` units. The caller has checked that it makes sense.
  virtual void restore(const SamplerState& state, int64_t count) = 0;

  int64_t first() const { return first_; }
  int64_t end() const { return end_; }
  int64_t size() const { return end_ - first_; }
  bool contains(int64_t serial) const { return serial >= first_ && serial < end_; }

 protected:
  int64_t first_ = 0;
  int64_t end_ = 0;
};

}  // namespace comrad::replay
