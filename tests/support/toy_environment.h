// Environments without a game: every byte they show is a hash of agent, time and actions before, so that
// a frame of another agent, step, episode or environment, or one rendered at the wrong moment, never passes
// for the right one.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/env/environment.h"

namespace comrad::test {

struct ToyOptions {
  EnvShape shape;
  uint32_t min_length = 1;       ///< decisions of the shortest episode
  uint32_t max_length = 20;      ///< and of the longest; the seed decides
  double truncated_share = 0.5;  ///< of the episodes that end by truncation
  int layout_count = 1;          ///< layouts to choose from
  int broken_layout = -1;        ///< one that cannot be loaded
};

/// An episode is a pure function of its seed and the actions; its length and how it ends follow from the
/// seed alone.
class ToyEnvironment : public sim::Environment {
 public:
  explicit ToyEnvironment(const ToyOptions& options) : options_(options) {
    const auto agents = static_cast<std::size_t>(options.shape.num_agents);
    last_.reward.resize(agents);
    summary_.agent_count = static_cast<uint32_t>(agents);
  }

  const EnvShape& shape() const override { return options_.shape; }
  uint64_t layout_id() const override { return 77 + static_cast<uint64_t>(layout_); }
  Status choose_layout(int layout_index) override {
    if (layout_index < 0 || layout_index >= options_.layout_count || layout_index == options_.broken_layout)
      return Error{ErrorCode::kNotFound, "toy layout " + std::to_string(layout_index) + " is not there"};
    layout_ = layout_index;
    return {};
  }

  void set_env_frames(uint64_t env_frames) override { std::atomic_ref(env_frames_).store(env_frames); }
  /// The last actions, from any thread.
  uint64_t env_frames() { return std::atomic_ref(env_frames_).load(); }

  void reset(uint64_t episode_seed) override {
    seed_ = episode_seed;
    state_ = mix64(episode_seed + static_cast<uint64_t>(layout_));
    step_ = 0;
    last_.terminated = last_.truncated = false;
    summary_.agent_return.fill(0.0f);
    const RngKey plan = RngKey(episode_seed).split("plan");
    length_ = options_.min_length +
              static_cast<uint32_t>(plan.bits() % (options_.max_length - options_.min_length + 1));
    ends_truncated_ = plan.split(uint64_t{1}).uniform() < static_cast<float>(options_.truncated_share);
  }

  void step(std::span<const int32_t> action) override {
    for (std::size_t index = 0; index < action.size(); ++index) {
      const int32_t size =
          options_.shape.head_sizes[index % static_cast<std::size_t>(options_.shape.head_count)];
      const int32_t choice = action[index] < 0 || action[index] >= size ? 0 : action[index];
      state_ = mix64(state_ + kGoldenGamma + static_cast<uint64_t>(choice));
    }
    ++step_;
    for (std::size_t agent = 0; agent < last_.reward.size(); ++agent) {
      last_.reward[agent] = static_cast<float>(static_cast<int>(mix64(state_ + agent) % 17) - 8);
      summary_.agent_return[agent] += last_.reward[agent];
      summary_.agent_score[agent] = static_cast<float>(mix64(state_ ^ agent) % 1000);
    }
    const bool is_over = step_ >= length_;
    last_.terminated = is_over && !ends_truncated_;
    last_.truncated = is_over && ends_truncated_;
    summary_.length_steps = step_;
    summary_.length_tics = 4 * step_;
    summary_.score = static_cast<float>(state_ % 10007);
  }

  const sim::Step& last_step() const override { return last_; }
  const EpisodeRecord& summary() const override { return summary_; }
  uint64_t state_hash() const override { return mix64(state_ ^ mix64(step_)); }

  void observe(const sim::ObservationTarget& target) const {
    const EnvShape& s = options_.shape;
    const auto frame_bytes = static_cast<std::size_t>(s.frame_bytes());
    for (std::size_t agent = 0; agent < last_.reward.size(); ++agent) {
      Rng noise(mix64(state_hash() + 1000 * agent));
      for (std::size_t index = 0; index < frame_bytes; ++index)
        target.frame[agent * frame_bytes + index] = static_cast<uint8_t>(noise.next());
      for (int index = 0; index < s.measurement_count; ++index)
        target.measurement[agent * static_cast<std::size_t>(s.measurement_count) +
                           static_cast<std::size_t>(index)] = static_cast<float>(noise.next() % 1000);
      for (int index = 0; index < s.logit_count(); ++index)
        target.action_mask[agent * static_cast<std::size_t>(s.logit_count()) +
                           static_cast<std::size_t>(index)] = static_cast<uint8_t>(noise.next() & 1);
      target.agent_active[agent] = static_cast<uint8_t>(noise.next() & 1);
    }
    Rng noise(mix64(state_hash() + 77));
    for (int index = 0; index < s.global_state_count; ++index)
      target.global_state[index] = static_cast<float>(noise.next() % 1000);
  }

 private:
  uint64_t env_frames_ = 0;
  ToyOptions options_;
  uint64_t seed_ = 0, state_ = 0;
  uint32_t step_ = 0, length_ = 1;
  int layout_ = 0;
  bool ends_truncated_ = false;
  sim::Step last_;
  EpisodeRecord summary_;
};

class ToyEnvironmentSet : public sim::EnvironmentSet {
 public:
  ToyEnvironmentSet(const ToyOptions& options, int count) {
    for (int index = 0; index < count; ++index)
      environments_.push_back(std::make_unique<ToyEnvironment>(options));
  }

  int size() const override { return static_cast<int>(environments_.size()); }
  ToyEnvironment& at(int index) override { return *environments_[static_cast<std::size_t>(index)]; }

  void observe(std::span<const int> indices, std::span<const sim::ObservationTarget> targets) override {
    for (std::size_t index = 0; index < indices.size(); ++index) at(indices[index]).observe(targets[index]);
    if (on_observe) on_observe();
  }

  std::function<void()> on_observe;  ///< called after every observe(), in the worker's thread

 private:
  std::vector<std::unique_ptr<ToyEnvironment>> environments_;
};

}  // namespace comrad::test
