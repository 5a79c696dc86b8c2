#include "policy_workers/batching/batcher.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::policy {

using shm::RequestKind;
using shm::SlotState;

Expected<Batcher> Batcher::create(const shm::Arena& arena, const BatcherOptions& options,
                                  const Clock& clock) {
  const int worker_count = arena.shape().policy_worker_count;
  if (options.policy_worker < 0 || options.policy_worker >= worker_count)
    return Error{ErrorCode::kBadInput, fmt::format("worker_index is {}; this run has {} policy workers",
                                                   options.policy_worker, worker_count)};
  if (options.min_batch < 0 || options.max_batch < 0 || options.max_wait_us < 0)
    return Error{ErrorCode::kBadInput, "min_batch, max_batch and max_wait_us must not be negative"};
  return Batcher(arena, options, clock);
}

Batcher::Batcher(const shm::Arena& arena, const BatcherOptions& options, const Clock& clock)
    : arena_(&arena),
      clock_(&clock),
      options_(options),
      action_key_(RngKey(options.seed).split("action")),
      states_(arena) {
  const shm::ArenaShape& shape = arena.shape();
  for (int sim_worker = 0; sim_worker < shape.served_worker_count(); ++sim_worker) {
    for (int split = 0; split < shape.splits_per_worker; ++split) {
      if (shape.policy_worker_of(sim_worker, split) != options.policy_worker) continue;
      const int first = sim_worker * shape.envs_per_worker;
      splits_.push_back(
          {sim_worker, split, first + shape.split_begin(split), first + shape.split_end(split)});
      env_count_ += shape.split_end(split) - shape.split_begin(split);
    }
  }
  if (options_.max_batch == 0) options_.max_batch = std::max<int64_t>(1, env_count_);
  options_.min_batch = std::clamp<int64_t>(options_.min_batch, 1, std::max<int64_t>(1, env_count_));
  options_.max_batch = std::max(options_.max_batch, options_.min_batch);

  const auto rows = static_cast<size_t>(env_count_ * shape.trajectory.env.num_agents);
  batch_.requests.reserve(static_cast<size_t>(env_count_));
  batch_.frames.reserve(rows);
}

int Batcher::adopt_orphans() { return arena_->reclaim_policy_worker(options_.policy_worker); }

/// The states are read before the round's count: a slot seen kReady makes the count that was stored before
/// it visible.
Batcher::SplitCount Batcher::count_ready(const Split& split) const {
  int ready = 0, acted = 0;
  for (int env = split.first_env; env < split.last_env; ++env) {
    const SlotState state = arena_->step_slots().slot(env).state.load(std::memory_order_acquire);
    ready += state == SlotState::kReady;
    acted += state == SlotState::kActed;
  }
  // Slots that a predecessor answered before it died belong to the same round.
  const uint32_t round =
      arena_->step_slots().round(split.sim_worker, split.index).request_count.load(std::memory_order_acquire);
  return {ready, ready > 0 && static_cast<uint32_t>(ready + acted) >= round};
}

const Batch& Batcher::gather(int64_t timeout_us) {
  batch_.requests.clear();
  batch_.frames.clear();
  const int64_t deadline_ns = clock_->now_ns() + timeout_us * 1000;
  shm::Doorbell& doorbell = arena_->step_slots().ready(options_.policy_worker);
  while (true) {
    const uint32_t heard = shm::listen(doorbell);
    if (collect()) break;
    const int64_t now_ns = clock_->now_ns();
    if (now_ns >= deadline_ns) return batch_;
    int64_t until_ns = deadline_ns;
    if (first_ready_ns_ != 0 && !options_.is_deterministic)
      until_ns = std::min(until_ns, first_ready_ns_ + options_.max_wait_us * 1000);
    shm::wait(doorbell, heard, std::max<int64_t>(1, (until_ns - now_ns + 999) / 1000));
    wait_ns_ += static_cast<uint64_t>(clock_->now_ns() - now_ns);
  }
  load_inputs();
  return batch_;
}

/// Looks over all splits once and takes a batch if there is enough. True if a batch was taken.
bool Batcher::collect() {
  int64_t complete_envs = 0, ready_envs = 0;
  for (const Split& split : splits_) {
    const SplitCount count = count_ready(split);
    ready_envs += count.ready;
    if (count.is_complete) complete_envs += count.ready;
  }
  if (ready_envs == 0) {
    first_ready_ns_ = 0;
    return false;
  }
  const int64_t now_ns = clock_->now_ns();
  if (first_ready_ns_ == 0) first_ready_ns_ = now_ns;
  const bool is_overdue =
      !options_.is_deterministic && now_ns - first_ready_ns_ >= options_.max_wait_us * 1000;
  if (options_.is_deterministic ? complete_envs == 0 : complete_envs < options_.min_batch && !is_overdue)
    return false;

  const size_t split_count = splits_.size(), first = next_split_;
  for (size_t offset = 0; offset < split_count; ++offset) {
    const size_t index = (first + offset) % split_count;
    const Split& split = splits_[index];
    const SplitCount count = count_ready(split);
    if (count.ready == 0 || (!count.is_complete && !is_overdue)) continue;
    if (options_.is_deterministic) {
      take(split, count.ready);
      next_split_ = (index + 1) % split_count;
      break;
    }
    const int64_t room = options_.max_batch - static_cast<int64_t>(batch_.requests.size());
    // A split that does not fit goes first next time; only one that is larger than any batch is cut.
    if (count.ready > room && !batch_.requests.empty()) {
      next_split_ = index;
      break;
    }
    take(split, room);
    next_split_ = count.ready > room ? index : (index + 1) % split_count;
  }
  first_ready_ns_ = 0;
  if (options_.is_deterministic) std::ranges::sort(batch_.requests, {}, &Request::env_index);
  return !batch_.requests.empty();
}

void Batcher::take(const Split& split, int64_t limit) {
  for (int env = split.first_env; env < split.last_env && limit > 0; ++env) {
    shm::StepSlot& slot = arena_->step_slots().slot(env);
    if (!shm::advance(slot, SlotState::kReady, SlotState::kInBatch)) continue;
    if (const std::optional<Request> request = read_request(slot, split, env)) {
      batch_.requests.push_back(*request);
      --limit;
    } else {
      // Answered without being read, so that its simulator continues and notices rather than hangs.
      ++refused_count_;
      shm::advance(slot, SlotState::kInBatch, SlotState::kActed);
      shm::ring(arena_->step_slots().acted(split.sim_worker, split.index));
    }
  }
}

std::optional<Request> Batcher::read_request(const shm::StepSlot& slot, const Split& split, int env_index) {
  const shm::ArenaShape& shape = arena_->shape();
  Request request{.env_index = env_index,
                  .sim_worker = split.sim_worker,
                  .split = split.index,
                  .kind = slot.kind,
                  .slab_index = slot.slab_index,
                  .step = static_cast<int>(slot.step),
                  .final_row = static_cast<int>(slot.final_row),
                  .reset_state = slot.reset_state != 0,
                  .step_id = slot.step_id,
                  .episode_id = slot.episode_id,
                  .episode_step = slot.episode_step};
  const int steps = shape.trajectory.rollout_steps;
  const bool is_row_valid =
      request.kind == RequestKind::kAct     ? request.step >= 0 && request.step < steps
      : request.kind == RequestKind::kValue ? request.step >= 0 && request.step <= steps
      : request.kind == RequestKind::kFinal
          ? request.final_row >= 0 && request.final_row < shape.trajectory.final_capacity
          : false;
  if (is_row_valid && request.slab_index < static_cast<uint32_t>(shape.slab_count)) return request;
  spdlog::error(
      "slot of environment {}: request kind {}, slab {}, step {}, final row {} is out of range; refused",
      env_index, static_cast<uint32_t>(slot.kind), slot.slab_index, slot.step, slot.final_row);
  return std::nullopt;
}

void Batcher::load_inputs() {
  const EnvShape& env = arena_->shape().trajectory.env;
  const int64_t agents = env.num_agents, measurements = env.measurement_count, state = states_.state_count();
  const int64_t rows = static_cast<int64_t>(batch_.requests.size()) * agents;
  batch_.measurement = measurements > 0 ? torch::empty({rows, measurements}) : Tensor();
  batch_.recurrent_state = torch::empty({rows, state});
  const int64_t state_of_world = env.global_state_count;
  batch_.global_state = state_of_world > 0
                            ? torch::empty({static_cast<int64_t>(batch_.requests.size()), state_of_world})
                            : Tensor();
  float* world_out = state_of_world > 0 ? batch_.global_state.data_ptr<float>() : nullptr;
  float* state_out = batch_.recurrent_state.data_ptr<float>();
  float* measurement_out = measurements > 0 ? batch_.measurement.data_ptr<float>() : nullptr;
  for (const Request& request : batch_.requests) {
    const SlabView slab = arena_->slabs().view(static_cast<int>(request.slab_index));
    const bool is_final = request.kind == RequestKind::kFinal;
    for (int agent = 0; agent < env.num_agents; ++agent) {
      batch_.frames.push_back(is_final ? slab.final_frame(request.final_row, agent).data()
                                       : slab.frame(request.step, agent).data());
      if (measurements == 0) continue;
      const std::span<const float> measured =
          is_final ? slab.final_measurement(request.final_row, agent) : slab.measurement(request.step, agent);
      measurement_out = std::ranges::copy(measured, measurement_out).out;
    }
    if (state_of_world > 0)
      world_out = std::ranges::copy(
                      is_final ? slab.final_global_state(request.final_row) : slab.global_state(request.step),
                      world_out)
                      .out;
    count_copied(static_cast<uint64_t>(agents * (measurements + state) + state_of_world) * sizeof(float));
    if (state > 0) {
      states_.load(request.env_index, request.step_id, request.reset_state,
                   {state_out, static_cast<size_t>(agents * state)});
      state_out += agents * state;
    }
  }
}

void Batcher::scatter(const Batch& batch, const PolicyOutput& output, PolicyVersion version) {
  const Tensor logits = output.logits.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor value = output.value.to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor state = output.recurrent_state.to(torch::kCPU, torch::kFloat32).contiguous();
  COMRAD_CHECK(logits.size(0) == batch.row_count() && value.size(0) == batch.row_count(),
               "one output row per batch row");
  answer(batch, logits.data_ptr<float>(), value.data_ptr<float>(), state.data_ptr<float>(), version);
}

void Batcher::scatter_random(const Batch& batch) {
  const int64_t rows = batch.row_count();
  const Tensor logits = torch::zeros({rows, arena_->shape().trajectory.env.logit_count()});
  const Tensor value = torch::zeros({rows});
  const Tensor state = torch::zeros({rows, states_.state_count()});
  answer(batch, logits.data_ptr<float>(), value.data_ptr<float>(), state.data_ptr<float>(), 0);
}

void Batcher::seat(std::vector<SeatRule> rules) {
  COMRAD_CHECK(static_cast<int32_t>(rules.size()) == arena_->shape().trajectory.env.num_agents,
               "every agent has one rule");
  seats_ = std::move(rules);
}

/// One agent's action; returns its log-probability.
float Batcher::choose(int agent, std::span<const float> row, std::span<const uint8_t> mask, RngKey key,
                      float epsilon, std::span<int32_t> action) const {
  const EnvShape& env = arena_->shape().trajectory.env;
  SeatRule rule;
  if (seats_.empty()) {
    if (options_.is_epsilon_greedy) rule = {SeatRule::Choice::kByQValues, epsilon, options_.exploration};
  } else {
    rule = seats_[static_cast<size_t>(agent)];
    if (options_.is_greedy) rule.epsilon = 0;
  }
  switch (rule.choice) {
    case SeatRule::Choice::kByPolicy:
      return sample_action(row, mask, env, key, options_.is_greedy, action);
    case SeatRule::Choice::kByQValues:
      return explore_action(row, mask, env, key, rule.epsilon, rule.exploration, action);
    case SeatRule::Choice::kDrawn:
      return sample_action(row, mask, env, key, /*greedy=*/false, action);
    case SeatRule::Choice::kNothing:
      std::ranges::fill(action, 0);
      return 0;
  }
  return 0;
}

void Batcher::answer(const Batch& batch, const float* logits, const float* value, const float* state,
                     PolicyVersion version) {
  const TrajectoryShape& shape = arena_->shape().trajectory;
  const EnvShape& env = shape.env;
  const size_t logit_count = static_cast<size_t>(env.logit_count());
  const size_t state_count = static_cast<size_t>(states_.state_count());
  const size_t agents = static_cast<size_t>(env.num_agents);
  const float* state_in = batch.recurrent_state.data_ptr<float>();
  const float epsilon = options_.is_greedy ? 0.0f
                                           : static_cast<float>(options_.epsilon.at(static_cast<double>(
                                                 arena_->control().schedule_env_frames.load())));
  for (size_t index = 0; index < batch.requests.size(); ++index) {
    const Request& request = batch.requests[index];
    shm::StepSlot& slot = arena_->step_slots().slot(request.env_index);
    // The supervisor gives a dead simulator's slots and slabs back; another simulator may own this slab by now.
    if (slot.state.load(std::memory_order_acquire) != SlotState::kInBatch) continue;
    const SlabView slab = arena_->slabs().view(static_cast<int>(request.slab_index));
    const size_t first_row = index * agents;
    const int snapshot = shape.recurrent_snapshots == 1 ? 0 : request.step;
    const bool keeps_snapshot = state_count > 0 && request.kind != RequestKind::kFinal &&
                                (request.step == 0 || shape.recurrent_snapshots > 1) &&
                                snapshot < shape.recurrent_snapshots;
    // An evaluation's episodes are the same however many environments share them.
    const RngKey world =
        options_.is_evaluation ? action_key_ : action_key_.split(static_cast<uint64_t>(request.env_index));
    const RngKey key = world.split(request.episode_id).split(uint64_t{request.episode_step});
    for (size_t agent = 0; agent < agents; ++agent) {
      const size_t row = first_row + agent;
      const int agent_index = static_cast<int>(agent);
      if (request.kind == RequestKind::kFinal) {
        slab.final_value(request.final_row, agent_index) = value[row];
        continue;
      }
      slab.value(request.step, agent_index) = value[row];
      if (keeps_snapshot)
        std::ranges::copy(std::span(state_in + row * state_count, state_count),
                          slab.recurrent_state(snapshot, agent_index).begin());
      if (request.kind == RequestKind::kValue) continue;
      const std::span<const float> row_logits(logits + row * logit_count, logit_count);
      std::ranges::copy(row_logits, slab.logits(request.step, agent_index).begin());
      const auto mask = slab.action_mask(request.step, agent_index);
      const RngKey agent_key = key.split(uint64_t{agent});
      const auto action = slab.action(request.step, agent_index);
      slab.log_prob(request.step, agent_index) =
          choose(agent_index, row_logits, mask, agent_key, epsilon, action);
      slab.policy_version(request.step, agent_index) = version;
    }
    if (request.kind == RequestKind::kAct && state_count > 0)
      states_.store(request.env_index, request.step_id,
                    {state + first_row * state_count, agents * state_count});
  }
  // Only now hand everything back: a worker killed above leaves whole rounds for its successor.
  for (const Request& request : batch.requests)
    shm::advance(arena_->step_slots().slot(request.env_index), SlotState::kInBatch, SlotState::kActed);
  for (const Split& split : splits_) {
    const bool is_touched = std::ranges::any_of(batch.requests, [&](const Request& request) {
      return request.sim_worker == split.sim_worker && request.split == split.index;
    });
    if (is_touched) shm::ring(arena_->step_slots().acted(split.sim_worker, split.index));
  }
}

}  // namespace comrad::policy
