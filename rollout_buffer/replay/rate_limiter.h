// Holds collecting and learning together: so many samples for each inserted transition, within a tolerance,
// and none before the replay has some. The side that is ahead waits. Stage: between drain and sample.
//
//   min_size * r - error_buffer  <=  inserted * r - sampled  <=  min_size * r + error_buffer
//   r = samples_per_insert
//
// An insert must not go above the right side (unless the replay has not reached min_size yet), a sample not
// below the left one. Source: Cassirer et al. 2021, Reverb: A Framework For Experience Replay,
// arXiv:2102.04736, section 3.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>

#include "rollout_buffer/core/expected.h"

namespace comrad::replay {

struct RateLimiterOptions {
  double samples_per_insert = 0;   ///< r; 0: only min_size_to_sample counts
  int64_t min_size_to_sample = 1;  ///< inserts before the first sample
  double error_buffer = 0;         ///< in samples
};

/// Checks ranges, and that pieces of these sizes cannot make both sides wait for each other: error_buffer
/// must be at least (insert_piece * r + sample_piece) / 2. Errors: kBadInput.
Status validate(const RateLimiterOptions& options, int64_t insert_piece, int64_t sample_piece);

enum class WaitResult { kReady, kTimeout, kStopped };

/// Threads: all functions may be called from any thread. `can_*` and `wait_*` reserve nothing, so each side
/// has one thread.
class RateLimiter {
 public:
  explicit RateLimiter(const RateLimiterOptions& options) : options_(options) {}

  void inserted(int64_t count);
  void sampled(int64_t count);
  bool can_insert(int64_t count = 1) const;
  bool can_sample(int64_t count = 1) const;
  /// Waits until can_insert(count) or can_sample(count), the time-out or stop().
  WaitResult wait_to_insert(int64_t count, int timeout_ms);
  WaitResult wait_to_sample(int64_t count, int timeout_ms);
  /// Every wait returns kStopped, now and later.
  void stop();

  /// Share of the inserts that the first sample waits for: 1 once they are there.
  double filled() const;
  /// Inserts whose samples have not been drawn yet; 0 where samplers are ahead, or where only min_size_to_sample counts.
  double pending_inserts() const;
  /// Inserts behind the first min_size_to_sample ones for each sample so far; 0 before the first sample.
  double inserts_per_sample() const;
  int64_t insert_count() const;
  int64_t sample_count() const;
  int64_t min_size_to_sample() const;
  /// Takes over the counts of a checkpoint.
  void restore(int64_t insert_count, int64_t sample_count);
  /// The first sample comes after so many inserts, at least 1. Before the first one.
  void set_min_size(int64_t min_size_to_sample);

 private:
  bool insert_is_due(int64_t count) const;
  bool sample_is_due(int64_t count) const;
  template <typename Due>
  WaitResult wait(int timeout_ms, Due&& due);

  RateLimiterOptions options_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  int64_t inserted_ = 0;
  int64_t sampled_ = 0;
  bool stopped_ = false;
};

}  // namespace comrad::replay
