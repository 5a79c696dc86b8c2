// A policy worker without a network: its answers are a function of what lies in the slot, the slab and the
// recurrent state, so that a test can tell afterwards from which bytes each answer was made.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::test {

/// What the fake policy makes of one agent's frame and of the state before it. Exact in float.
inline float fake_value(std::span<const uint8_t> frame, float decisions_since_reset) {
  uint64_t hash = 0;
  for (const uint8_t byte : frame) hash = mix64(hash + byte + 1);
  return static_cast<float>(hash % 4096) + 4096.0f * decisions_since_reset;
}

inline int32_t fake_action(float value, int head, int32_t head_size) {
  return static_cast<int32_t>(mix64(static_cast<uint64_t>(value) + static_cast<uint64_t>(head) * 977) %
                              static_cast<uint64_t>(head_size));
}

/// Answers every ready slot of one policy worker in its own thread, or, in lock step, whole rounds of
/// a split.
class FakePolicy {
 public:
  FakePolicy(const shm::Arena& arena, int policy_worker, bool lock_step)
      : arena_(arena), policy_worker_(policy_worker), lock_step_(lock_step), thread_([this] { run(); }) {}
  ~FakePolicy() {
    stop_ = true;
    thread_.join();
  }

  uint64_t answers() const { return answers_.load(); }
  /// Requests that broke the contract (a slab of another environment, a row out of range, a step id
  /// that fell).
  int faults() const { return faults_.load(); }
  /// Lock step: sizes of the batches in order. Read it after the run.
  const std::vector<uint32_t>& batch_sizes() const { return batch_sizes_; }

 private:
  void run() {
    const shm::ArenaShape& shape = arena_.shape();
    last_step_id_.assign(static_cast<std::size_t>(shape.env_count()), 0);
    while (!stop_.load()) {
      shm::Doorbell& ready = arena_.step_slots().ready(policy_worker_);
      const uint32_t heard = shm::listen(ready);
      bool found = false;
      for (int sim = 0; sim < shape.sim_worker_count; ++sim)
        for (int split = 0; split < shape.splits_per_worker; ++split)
          if (shape.policy_worker_of(sim, split) == policy_worker_) found |= answer_split(sim, split);
      if (!found) shm::wait(ready, heard, 5000);
    }
  }

  bool answer_split(int sim, int split) {
    const shm::ArenaShape& shape = arena_.shape();
    std::vector<int> batch;
    for (int local = shape.split_begin(split); local < shape.split_end(split); ++local) {
      const int env = sim * shape.envs_per_worker + local;
      if (arena_.step_slots().slot(env).state.load(std::memory_order_acquire) == shm::SlotState::kReady)
        batch.push_back(env);
    }
    if (batch.empty()) return false;
    if (lock_step_) {
      const uint32_t wanted =
          arena_.step_slots().round(sim, split).request_count.load(std::memory_order_acquire);
      if (batch.size() > wanted) ++faults_;
      if (batch.size() < wanted) return false;
      batch_sizes_.push_back(wanted);
    }
    for (const int env : batch) {
      shm::StepSlot& slot = arena_.step_slots().slot(env);
      if (!shm::advance(slot, shm::SlotState::kReady, shm::SlotState::kInBatch)) continue;
      answer(slot, env);
      shm::advance(slot, shm::SlotState::kInBatch, shm::SlotState::kActed);
      ++answers_;
    }
    shm::ring(arena_.step_slots().acted(sim, split));
    return true;
  }

  void answer(shm::StepSlot& slot, int env) {
    const TrajectoryShape& shape = arena_.shape().trajectory;
    const int agents = shape.env.num_agents, step = static_cast<int>(slot.step);
    const bool is_act = slot.kind == shm::RequestKind::kAct;
    if (slot.slab_index >= static_cast<uint32_t>(arena_.shape().slab_count) ||
        step > shape.rollout_steps - (is_act ? 1 : 0) ||
        slot.final_row >= static_cast<uint32_t>(shape.final_capacity)) {
      ++faults_;
      return;
    }
    const shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slot.slab_index));
    if (header.env_index != static_cast<uint32_t>(env) || header.state.load() != shm::SlabState::kFilling)
      ++faults_;
    uint64_t& last_step_id = last_step_id_[static_cast<std::size_t>(env)];
    if (slot.step_id < last_step_id) ++faults_;
    last_step_id = slot.step_id;

    const SlabView slab = arena_.slabs().view(static_cast<int>(slot.slab_index));
    const std::span<float> in = arena_.step_slots().recurrent(env, slot.step_id),
                           out = arena_.step_slots().recurrent(env, slot.step_id + 1);
    const std::size_t width = in.size() / static_cast<std::size_t>(agents);
    for (int agent = 0; agent < agents; ++agent) {
      const std::size_t first = static_cast<std::size_t>(agent) * width;
      const float decisions = slot.reset_state != 0 ? 0.0f : in[first];
      if (slot.kind == shm::RequestKind::kFinal) {
        slab.final_value(static_cast<int>(slot.final_row), agent) =
            fake_value(slab.final_frame(static_cast<int>(slot.final_row), agent), decisions);
        continue;
      }
      const float value = fake_value(slab.frame(step, agent), decisions);
      slab.value(step, agent) = value;
      if (!is_act) continue;
      if (step == 0) std::fill_n(slab.recurrent_state(0, agent).begin(), width, decisions);
      std::fill_n(out.begin() + static_cast<std::ptrdiff_t>(first), width, decisions + 1);
      slab.log_prob(step, agent) = -value;
      slab.policy_version(step, agent) = slot.episode_step;
      for (int head = 0; head < shape.env.head_count; ++head)
        slab.action(step, agent)[static_cast<std::size_t>(head)] =
            fake_action(value, head, shape.env.head_sizes[static_cast<std::size_t>(head)]);
      for (float& logit : slab.logits(step, agent)) logit = value;
    }
  }

  const shm::Arena& arena_;
  const int policy_worker_;
  const bool lock_step_;
  std::vector<uint64_t> last_step_id_;
  std::vector<uint32_t> batch_sizes_;
  std::atomic<bool> stop_{false};
  std::atomic<uint64_t> answers_{0};
  std::atomic<int> faults_{0};
  std::thread thread_;
};

}  // namespace comrad::test
