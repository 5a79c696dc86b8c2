// An arena for small networks and the simulator's side of its hand-overs, driven by hand: what the tests of
// batcher and policy worker play against. Frames are a pure function of environment, step and agent.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"
#include "tests/support/patience.h"

namespace comrad::policy {

/// 2 agents, 40 x 44 frames, heads (3, 2), a small core.
inline NetworkOptions small_network(const std::string& core = "gru") {
  NetworkOptions options;
  options.env.num_agents = 2;
  options.env.height = 40;
  options.env.width = 44;
  options.env.measurement_count = 3;
  options.env.head_count = 2;
  options.env.head_sizes = {3, 2};
  options.use_rnn = core != "none";
  options.rnn_type = core == "lstm" ? RnnType::kLstm : RnnType::kGru;
  options.rnn_size = 16;
  return options;
}

/// Settings that fit small_network().
inline RunConfig small_config() {
  RunConfig config;
  config.network.rnn_size = 16;
  config.collection.device = "cpu";
  config.collection.min_batch = 1;
  config.collection.max_wait_us = 200;
  return config;
}

struct ArenaOptions {
  int sim_workers = 1, envs_per_worker = 4, splits = 2, policy_workers = 1;
  int rollout_steps = 4, recurrent_snapshots = 1;
};

inline shm::Arena make_arena(const NetworkOptions& network, const ArenaOptions& options,
                             int64_t weights_bytes = 0) {
  shm::ArenaShape shape;
  shape.trajectory.env = network.env;
  shape.trajectory.rollout_steps = options.rollout_steps;
  shape.trajectory.recurrent_state_count = static_cast<int32_t>(network.recurrent_state_count());
  shape.trajectory.recurrent_snapshots = options.recurrent_snapshots;
  shape.sim_worker_count = options.sim_workers;
  shape.envs_per_worker = options.envs_per_worker;
  shape.splits_per_worker = options.splits;
  shape.policy_worker_count = options.policy_workers;
  shape.slab_count = 2 * shape.env_count();
  shape.weights_bytes = weights_bytes;
  auto arena = shm::Arena::create(shape, 7);
  EXPECT_TRUE(arena) << arena.error().message;
  return std::move(arena).value();
}

/// The simulator's side of one environment.
class FakeEnv {
 public:
  FakeEnv(const shm::Arena& arena, int env_index) : arena_(&arena), env_index_(env_index) {
    const auto slab = arena.slabs().acquire(env_index / arena.shape().envs_per_worker);
    EXPECT_TRUE(slab.has_value());
    slab_ = *slab;
  }

  SlabView slab() const { return arena_->slabs().view(static_cast<int>(slab_)); }
  shm::StepSlot& slot() const { return arena_->step_slots().slot(env_index_); }
  int step() const { return step_; }
  uint64_t step_id() const { return step_id_; }

  /// Renders row `step()` and commits kAct for it.
  void commit_act(bool reset_state = false) {
    paint(slab().frames(step_), step_id_);
    commit(shm::RequestKind::kAct, step_, 0, reset_state);
  }
  void commit_value() {
    paint(slab().frames(step_), step_id_);
    commit(shm::RequestKind::kValue, step_, 0, false);
  }
  void commit_final(int row) {
    for (int agent = 0; agent < arena_->shape().trajectory.env.num_agents; ++agent)
      paint(slab().final_frame(row, agent), step_id_ + 1000 + static_cast<uint64_t>(agent));
    commit(shm::RequestKind::kFinal, step_, row, false);
  }

  bool has_answer() const { return slot().state.load(std::memory_order_acquire) == shm::SlotState::kActed; }
  /// Takes the answer to a kAct; the episode continues in the next row, wrapping inside the one slab.
  void take_act() {
    ASSERT_TRUE(shm::advance(slot(), shm::SlotState::kActed, shm::SlotState::kIdle));
    step_ = (step_ + 1) % arena_->shape().trajectory.rollout_steps;
    ++step_id_;
    ++episode_step_;
  }
  void take_other() { ASSERT_TRUE(shm::advance(slot(), shm::SlotState::kActed, shm::SlotState::kIdle)); }

  void commit(shm::RequestKind kind, int step, int final_row, bool reset_state) {
    for (int agent = 0; agent < arena_->shape().trajectory.env.num_agents; ++agent) {
      for (float& x : slab().measurement(step, agent)) x = static_cast<float>(env_index_ + agent);
      for (uint8_t& allowed : slab().action_mask(step, agent)) allowed = 1;
    }
    shm::StepSlot& s = slot();
    s.step_id = step_id_;
    s.episode_id = 11;
    s.episode_step = episode_step_;
    s.slab_index = slab_;
    s.step = static_cast<uint32_t>(step);
    s.final_row = static_cast<uint32_t>(final_row);
    s.kind = kind;
    s.reset_state = reset_state;
    ASSERT_TRUE(shm::advance(s, shm::SlotState::kIdle, shm::SlotState::kReady));
  }

 private:
  void paint(std::span<uint8_t> frame, uint64_t salt) const {
    Rng rng(RngKey(5).split(static_cast<uint64_t>(env_index_)).split(salt));
    for (uint8_t& byte : frame) byte = static_cast<uint8_t>(rng.next() >> 56);
  }

  const shm::Arena* arena_;
  int env_index_;
  uint32_t slab_ = 0;
  int step_ = 0;
  uint64_t step_id_ = 0;
  uint32_t episode_step_ = 0;
};

/// A split commits all its requests and then rings, as a simulator does.
class FakeSplit {
 public:
  FakeSplit(const shm::Arena& arena, int sim_worker, int split)
      : arena_(&arena), sim_worker_(sim_worker), split_(split) {
    const shm::ArenaShape& shape = arena.shape();
    for (int local = shape.split_begin(split); local < shape.split_end(split); ++local)
      envs.emplace_back(arena, sim_worker * shape.envs_per_worker + local);
  }

  std::vector<FakeEnv> envs;

  void announce(size_t request_count) {
    arena_->step_slots().round(sim_worker_, split_).request_count.store(static_cast<uint32_t>(request_count));
  }
  void ring() {
    shm::ring(arena_->step_slots().ready(arena_->shape().policy_worker_of(sim_worker_, split_)));
  }
  void commit_act(bool reset_state = false) {
    announce(envs.size());
    for (FakeEnv& env : envs) env.commit_act(reset_state);
    ring();
  }
  /// Waits until every environment has its answer.
  bool await() {
    shm::Doorbell& doorbell = arena_->step_slots().acted(sim_worker_, split_);
    for (const double end_s = test::deadline_s(); monotonic_s() < end_s;) {
      const uint32_t heard = shm::listen(doorbell);
      bool done = true;
      for (FakeEnv& env : envs) done &= env.has_answer();
      if (done) return true;
      shm::wait(doorbell, heard, 100'000);
    }
    return false;
  }
  void take_act() {
    for (FakeEnv& env : envs) env.take_act();
  }

 private:
  const shm::Arena* arena_;
  int sim_worker_, split_;
};

}  // namespace comrad::policy
