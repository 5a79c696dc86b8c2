// Gathers what the simulators committed into one batch and scatters the network's answers back into slots,
// slabs and recurrent states. Stages: gather, batch, scatter. A frame is not copied here: the batch holds
// pointers into slabs.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "policy_workers/batching/recurrent_state_table.h"
#include "policy_workers/network/action_heads.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/settings/schedule.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::policy {

/// How one agent's action comes out of its row, where the agents of a world have different players.
struct SeatRule {
  enum class Choice {
    kByPolicy,   ///< logits: drawn, or the most probable
    kByQValues,  ///< Q-values: the best, or with epsilon any
    kDrawn,      ///< logits: drawn, in greedy play too (of zeros: uniform over what is allowed)
    kNothing,    ///< choice 0 of every head, which presses no button
  };
  Choice choice = Choice::kByPolicy;
  float epsilon = 0;                                ///< kByQValues; ignored in greedy play
  Exploration exploration = Exploration::kPerHead;  ///< kByQValues
};

/// How a policy worker fills its batches.
struct BatcherOptions {
  int policy_worker = 0;
  int64_t min_batch = 1;           ///< environments a batch waits for (settings/resolve.cc resolves "auto")
  int64_t max_batch = 0;           ///< environments in a batch at most; 0: all that are served
  int64_t max_wait_us = 2000;      ///< longest wait for min_batch, from the first request on
  bool is_deterministic = false;   ///< one whole split per batch, whatever the limits say
  bool is_evaluation = false;      ///< episodes are counted over all environments: they alone key the draws
  bool is_greedy = false;          ///< most probable actions instead of drawn ones
  bool is_epsilon_greedy = false;  ///< outputs are Q-values
  Schedule epsilon = 0;            ///< over the env frames in the control block
  Exploration exploration = Exploration::kPerHead;  ///< how epsilon is drawn
  uint64_t seed = 0;                                ///< of the run; keys the action draws
};

/// A slot's question, copied and bounds-checked when it was gathered.
struct Request {
  int env_index;
  int sim_worker;
  int split;
  shm::RequestKind kind;
  uint32_t slab_index;
  int step;
  int final_row;
  bool reset_state;
  uint64_t step_id;
  uint64_t episode_id;
  uint32_t episode_step;
};

/// Requests of one forward pass; row = request * N + agent. Valid until the next gather().
struct Batch {
  std::vector<Request> requests;
  std::vector<const uint8_t*> frames;  ///< [B] pointers to C*H*W bytes inside slabs
  Tensor measurement;                  ///< [B, M] f32; undefined when M = 0
  Tensor recurrent_state;              ///< [B, H] f32, inputs, zeroed where an episode begins
  Tensor global_state;                 ///< [B / N, S] f32; undefined when S = 0

  bool is_empty() const { return requests.empty(); }
  int64_t row_count() const { return static_cast<int64_t>(frames.size()); }
};

/// One policy worker's end of the arena. Answers only the splits that ArenaShape::policy_worker_of deals to
/// it.
///
/// A split (half of a simulator's environments) commits together and is gathered together: a batch holds
/// whole splits, except where max_batch is smaller than a split or a split stays incomplete for max_wait_us.
/// Everything an answer consists of is written before the first slot becomes kActed, so a worker killed at
/// any point leaves slots that its successor answers anew with the same result.
class Batcher {
 public:
  /// Arena and clock outlive it. A gather() reads the clock twice, and up to three times for each wait.
  /// Errors: kBadInput when the worker index is not of this run, or the network does not fit the
  /// arena's shapes.
  static Expected<Batcher> create(const shm::Arena& arena, const BatcherOptions& options,
                                  const Clock& clock = kMachineClock);

  /// Takes over what a dead predecessor had gathered: kInBatch -> kReady. Returns how many slots. At
  /// start only.
  int adopt_orphans();

  /// kReady -> kInBatch. Waits up to `timeout_us` for a first request; an empty batch means there was none.
  const Batch& gather(int64_t timeout_us);

  /// Writes answers and hands the slots back: kInBatch -> kActed, then rings each split once.
  void scatter(const Batch& batch, const PolicyOutput& output, PolicyVersion version);

  /// From now on every agent has its own rule, [N]; the options' say no more how actions are chosen, but for
  /// is_greedy.
  void seat(std::vector<SeatRule> rules);

  /// Answers without a network (--random): uniform over allowed choices, value 0, state untouched at 0.
  void scatter_random(const Batch& batch);

  int64_t env_count() const { return env_count_; }  ///< environments served
  int64_t min_batch() const { return options_.min_batch; }
  int64_t max_batch() const { return options_.max_batch; }
  uint64_t wait_ns() const { return wait_ns_; }              ///< time spent waiting in gather(), in all
  uint64_t refused_count() const { return refused_count_; }  ///< requests whose indices were out of range

 private:
  /// Environments [first, last) that commit together.
  struct Split {
    int sim_worker;
    int index;
    int first_env;
    int last_env;
  };
  struct SplitCount {
    int ready;
    bool is_complete;
  };

  Batcher(const shm::Arena& arena, const BatcherOptions& options, const Clock& clock);
  SplitCount count_ready(const Split& split) const;
  bool collect();
  void take(const Split& split, int64_t limit);
  std::optional<Request> read_request(const shm::StepSlot& slot, const Split& split, int env_index);
  void load_inputs();
  float choose(int agent, std::span<const float> row, std::span<const uint8_t> mask, RngKey key,
               float epsilon, std::span<int32_t> action) const;
  void answer(const Batch& batch, const float* logits, const float* value, const float* state,
              PolicyVersion version);

  const shm::Arena* arena_;
  const Clock* clock_;
  BatcherOptions options_;
  std::vector<SeatRule> seats_;  // [N]; empty: all agents alike
  RngKey action_key_;
  RecurrentStateTable states_;
  std::vector<Split> splits_;
  size_t next_split_ = 0;  // where the next batch starts to look, so that no split starves
  int64_t env_count_ = 0;
  Batch batch_;
  uint64_t wait_ns_ = 0;
  uint64_t refused_count_ = 0;
  int64_t first_ready_ns_ = 0;  // when the requests that wait now were first seen; 0: none wait
};

}  // namespace comrad::policy
