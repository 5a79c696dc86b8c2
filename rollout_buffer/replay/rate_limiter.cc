#include "rollout_buffer/replay/rate_limiter.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>

namespace comrad::replay {

Status validate(const RateLimiterOptions& options, int64_t insert_piece, int64_t sample_piece) {
  if (!std::isfinite(options.samples_per_insert) || options.samples_per_insert < 0)
    return Error{ErrorCode::kBadInput, "samples per insert must be 0 (no limit) or above"};
  if (options.min_size_to_sample < 1)
    return Error{ErrorCode::kBadInput, "a replay must hold at least 1 transition before it is sampled"};
  const double needed =
      (static_cast<double>(insert_piece) * options.samples_per_insert + static_cast<double>(sample_piece)) /
      2;
  if (options.samples_per_insert > 0 && !(options.error_buffer >= needed))
    return Error{ErrorCode::kBadInput,
                 fmt::format("the tolerance of {} samples is below {}; with pieces of this size collecting "
                             "and learning could wait for each other",
                             options.error_buffer, needed)};
  return {};
}

bool RateLimiter::insert_is_due(int64_t count) const {
  if (options_.samples_per_insert <= 0 || inserted_ + count <= options_.min_size_to_sample) return true;
  const double ahead =
      static_cast<double>(inserted_ + count - options_.min_size_to_sample) * options_.samples_per_insert -
      static_cast<double>(sampled_);
  return ahead <= options_.error_buffer;
}

bool RateLimiter::sample_is_due(int64_t count) const {
  if (inserted_ < options_.min_size_to_sample) return false;
  if (options_.samples_per_insert <= 0) return true;
  const double ahead =
      static_cast<double>(inserted_ - options_.min_size_to_sample) * options_.samples_per_insert -
      static_cast<double>(sampled_ + count);
  return ahead >= -options_.error_buffer;
}

void RateLimiter::inserted(int64_t count) {
  const std::lock_guard lock(mutex_);
  inserted_ += count;
  changed_.notify_all();
}

void RateLimiter::sampled(int64_t count) {
  const std::lock_guard lock(mutex_);
  sampled_ += count;
  changed_.notify_all();
}

bool RateLimiter::can_insert(int64_t count) const {
  const std::lock_guard lock(mutex_);
  return insert_is_due(count);
}

bool RateLimiter::can_sample(int64_t count) const {
  const std::lock_guard lock(mutex_);
  return sample_is_due(count);
}

template <typename Due>
WaitResult RateLimiter::wait(int timeout_ms, Due&& due) {
  std::unique_lock lock(mutex_);
  const bool ready =
      changed_.wait_for(lock, std::chrono::milliseconds(timeout_ms), [&] { return stopped_ || due(); });
  if (stopped_) return WaitResult::kStopped;
  return ready ? WaitResult::kReady : WaitResult::kTimeout;
}

WaitResult RateLimiter::wait_to_insert(int64_t count, int timeout_ms) {
  return wait(timeout_ms, [&] { return insert_is_due(count); });
}

WaitResult RateLimiter::wait_to_sample(int64_t count, int timeout_ms) {
  return wait(timeout_ms, [&] { return sample_is_due(count); });
}

void RateLimiter::stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  changed_.notify_all();
}

double RateLimiter::filled() const {
  const std::lock_guard lock(mutex_);
  return std::min(1.0, static_cast<double>(inserted_) / static_cast<double>(options_.min_size_to_sample));
}

double RateLimiter::pending_inserts() const {
  const std::lock_guard lock(mutex_);
  if (options_.samples_per_insert <= 0) return 0;
  return std::max(0.0, static_cast<double>(inserted_ - options_.min_size_to_sample) -
                           static_cast<double>(sampled_) / options_.samples_per_insert);
}

double RateLimiter::inserts_per_sample() const {
  const std::lock_guard lock(mutex_);
  if (sampled_ <= 0) return 0;
  return static_cast<double>(std::max<int64_t>(0, inserted_ - options_.min_size_to_sample)) /
         static_cast<double>(sampled_);
}

int64_t RateLimiter::insert_count() const {
  const std::lock_guard lock(mutex_);
  return inserted_;
}

int64_t RateLimiter::sample_count() const {
  const std::lock_guard lock(mutex_);
  return sampled_;
}

int64_t RateLimiter::min_size_to_sample() const {
  const std::lock_guard lock(mutex_);
  return options_.min_size_to_sample;
}

void RateLimiter::restore(int64_t insert_count, int64_t sample_count) {
  const std::lock_guard lock(mutex_);
  inserted_ = insert_count;
  sampled_ = sample_count;
  changed_.notify_all();
}

void RateLimiter::set_min_size(int64_t min_size_to_sample) {
  const std::lock_guard lock(mutex_);
  options_.min_size_to_sample = std::max<int64_t>(1, min_size_to_sample);
  changed_.notify_all();
}

}  // namespace comrad::replay
