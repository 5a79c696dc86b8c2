#include "learner/batch/collate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/schema/slab_check.h"

namespace comrad::learn {
namespace {

/// The fields that have rows in dimension 1 (after time), for views and selections. (The global state has worlds there.)
template <typename Visitor>
void visit_time_major(RolloutBatch& batch, Visitor&& visit) {
  for (Tensor* field : {&batch.frame,          &batch.measurement,  &batch.action_mask, &batch.agent_active,
                        &batch.action,         &batch.log_prob,     &batch.logits,      &batch.value,
                        &batch.final_value,    &batch.reward,       &batch.terminated,  &batch.truncated,
                        &batch.policy_version, &batch.layout_index, &batch.filled,      &batch.valid,
                        &batch.value_valid,    &batch.reset,        &batch.advantage,   &batch.raw_advantage,
                        &batch.target,         &batch.host_valid,   &batch.host_acting}) {
    if (field->defined()) visit(*field);
  }
}

}  // namespace

Tensor RolloutBatch::acting() const { return valid * agent_active; }

RolloutBatch make_rollout_batch(const TrajectoryShape& shape, int64_t slab_count, torch::Device device,
                                bool frames_there_alone) {
  COMRAD_CHECK(slab_count > 0, "a batch holds at least one slab");
  const EnvShape& env = shape.env;
  const int64_t steps = shape.rollout_steps, rows = slab_count * env.num_agents;
  const auto f32 = torch::kFloat32;
  const auto u8 = torch::kUInt8;
  RolloutBatch batch;
  batch.shape = shape;
  batch.slab_count = slab_count;
  const std::vector<int64_t> frames = {steps, rows, env.channels, env.height, env.width};
  if (frames_there_alone)
    batch.frame_there = torch::empty(frames, torch::TensorOptions(u8).device(device));
  else
    batch.frame = device::host_memory(frames, u8, device);
  if (env.measurement_count > 0) batch.measurement = torch::zeros({steps, rows, env.measurement_count}, f32);
  if (env.global_state_count > 0)
    batch.global_state = torch::zeros({steps, slab_count, env.global_state_count}, f32);
  batch.action_mask = torch::ones({steps, rows, env.logit_count()}, u8);
  batch.agent_active = torch::ones({steps, rows}, u8);
  batch.action = torch::zeros({steps, rows, env.head_count}, torch::kInt64);
  batch.log_prob = torch::zeros({steps, rows}, f32);
  batch.logits = torch::zeros({steps, rows, env.logit_count()}, f32);
  batch.value = torch::zeros({steps + 1, rows}, f32);
  batch.final_value = torch::zeros({steps, rows}, f32);
  batch.reward = torch::zeros({steps, rows}, f32);
  batch.terminated = torch::ones({steps, rows}, u8);
  batch.truncated = torch::zeros({steps, rows}, u8);
  batch.policy_version = torch::zeros({steps, rows}, torch::kInt64);
  batch.layout_index = torch::zeros({steps, rows}, torch::kInt32);
  batch.recurrent_state = torch::zeros({rows, shape.recurrent_state_count}, f32);
  batch.filled = torch::zeros({steps, rows}, u8);
  batch.valid = torch::zeros({steps, rows}, u8);
  batch.value_valid = torch::zeros({steps + 1, rows}, u8);
  batch.reset = torch::zeros({steps, rows}, u8);
  return batch;
}

void hand_back(RolloutBatch& batch, torch::Device device) {
  batch.was_read.record(device::Stream::current(device));
}

void clear(RolloutBatch& batch) {
  batch.frame_arrived.wait();
  batch.was_read.wait();
  batch.transitions = 0;
  batch.has_action_mask = batch.is_frame_there = false;
  batch.filled.zero_();
  batch.valid.zero_();
}

int64_t collate_slab(RolloutBatch& batch, int64_t position, const SlabView& slab, uint32_t length) {
  COMRAD_CHECK(position >= 0 && position < batch.slab_count, "slab position lies in the batch");
  const EnvShape& env = batch.shape.env;
  const int64_t agents = env.num_agents, rows = batch.rows(), first = position * agents;
  const int steps = batch.shape.rollout_steps;
  const int filled = static_cast<int>(std::min<int64_t>(length, steps));
  const int64_t choices = env.logit_count(), heads = env.head_count, measurements = env.measurement_count;
  const int64_t hidden = batch.shape.recurrent_state_count, frame_bytes = env.frame_bytes();

  uint8_t* frame = batch.frame.defined() ? batch.frame.data_ptr<uint8_t>() : nullptr;
  float* measurement = measurements > 0 ? batch.measurement.data_ptr<float>() : nullptr;
  const int64_t states = env.global_state_count;
  float* global_state = states > 0 ? batch.global_state.data_ptr<float>() : nullptr;
  uint8_t* action_mask = batch.action_mask.data_ptr<uint8_t>();
  uint8_t* agent_active = batch.agent_active.data_ptr<uint8_t>();
  int64_t* action = batch.action.data_ptr<int64_t>();
  float* log_prob = batch.log_prob.data_ptr<float>();
  float* logits = batch.logits.data_ptr<float>();
  float* value = batch.value.data_ptr<float>();
  float* final_value = batch.final_value.data_ptr<float>();
  float* reward = batch.reward.data_ptr<float>();
  uint8_t* terminated = batch.terminated.data_ptr<uint8_t>();
  uint8_t* truncated = batch.truncated.data_ptr<uint8_t>();
  int64_t* policy_version = batch.policy_version.data_ptr<int64_t>();
  int32_t* layout_index = batch.layout_index.data_ptr<int32_t>();
  float* state = batch.recurrent_state.data_ptr<float>();
  uint8_t* taken = batch.filled.data_ptr<uint8_t>();
  uint8_t* valid = batch.valid.data_ptr<uint8_t>();

  std::vector<uint8_t> state_is_sound(static_cast<std::size_t>(agents), 1);
  for (int agent = 0; agent < agents; ++agent) {
    if (hidden == 0) break;
    state_is_sound[static_cast<std::size_t>(agent)] =
        take_floats(slab.recurrent_state(0, agent), state + (first + agent) * hidden);
  }

  int64_t broken_count = 0;
  for (int t = 0; t < steps; ++t) {
    uint8_t* frames_of_step = frame != nullptr ? frame + (t * rows + first) * frame_bytes : nullptr;
    float* state_of_step = states > 0 ? global_state + (t * batch.slab_count + position) * states : nullptr;
    if (t >= filled) {  // padding
      if (frames_of_step != nullptr)
        std::memset(frames_of_step, 0, static_cast<std::size_t>(agents * frame_bytes));
      if (states > 0) std::fill_n(state_of_step, states, 0.0f);
      for (int64_t at = t * rows + first; at < t * rows + first + agents; ++at) {
        if (measurement != nullptr) std::fill_n(measurement + at * measurements, measurements, 0.0f);
        std::fill_n(action_mask + at * choices, choices, uint8_t{1});
        std::fill_n(action + at * heads, heads, int64_t{0});
        std::fill_n(logits + at * choices, choices, 0.0f);
        agent_active[at] = 0;
        log_prob[at] = reward[at] = final_value[at] = 0.0f;
        if (t > filled || filled == 0) value[at] = 0.0f;
        terminated[at] = 1;
        truncated[at] = 0;
        policy_version[at] = 0;
        layout_index[at] = 0;
        taken[at] = valid[at] = 0;
      }
      continue;
    }
    if (frames_of_step != nullptr) {
      const auto frames = slab.frames(t);
      std::memcpy(frames_of_step, frames.data(), frames.size_bytes());
      count_copied(frames.size_bytes());
    }
    const StepEnd end = take_end(slab, t);
    const bool world_is_sound = states == 0 || take_floats(slab.global_state(t), state_of_step);
    for (int agent = 0; agent < agents; ++agent) {
      const int64_t at = t * rows + first + agent;
      bool sound = end.is_sound && world_is_sound && state_is_sound[static_cast<std::size_t>(agent)] != 0;
      if (measurement != nullptr)
        sound &= take_floats(slab.measurement(t, agent), measurement + at * measurements);
      const bool is_active = slab.agent_active(t, agent) != 0;
      uint8_t* mask = action_mask + at * choices;
      sound &= take_mask(env, slab.action_mask(t, agent), mask) || !is_active;
      batch.has_action_mask |= std::find(mask, mask + choices, uint8_t{0}) != mask + choices;
      sound &= take_action(env, slab.action(t, agent), action + at * heads);
      sound &= take_floats(slab.logits(t, agent), logits + at * choices);
      log_prob[at] = slab.log_prob(t, agent);
      value[at] = slab.value(t, agent);
      reward[at] = slab.reward(t, agent);
      final_value[at] = end.final_row >= 0 ? slab.final_value(end.final_row, agent) : 0.0f;
      sound &= all_finite(std::array{log_prob[at], value[at], reward[at], final_value[at]});
      agent_active[at] = is_active;
      terminated[at] = end.is_terminated;
      truncated[at] = end.is_truncated;
      policy_version[at] = slab.policy_version(t, agent);
      layout_index[at] = slab.layout_index(t);
      taken[at] = 1;
      valid[at] = slab.valid(t) != 0 && sound;
      if (sound) continue;
      ++broken_count;
      // Numbers that multiply a zero weight later must still be finite.
      std::fill_n(logits + at * choices, choices, 0.0f);
      std::fill_n(mask, choices, uint8_t{1});
      log_prob[at] = value[at] = reward[at] = final_value[at] = 0.0f;
    }
  }
  // The bootstrap behind the last filled row.
  for (int agent = 0; agent < agents; ++agent) {
    float& bootstrap = value[filled * rows + first + agent];
    bootstrap = filled > 0 ? slab.value(filled, agent) : 0.0f;
    if (!std::isfinite(bootstrap)) bootstrap = 0.0f;
    if (filled < steps) value[steps * rows + first + agent] = 0.0f;
  }
  batch.transitions += filled * agents;
  return broken_count;
}

LagStats apply_lag_filter(RolloutBatch& batch, PolicyVersion learner_version, int64_t max_policy_lag) {
  const int64_t steps = batch.steps(), rows = batch.rows();
  uint8_t* valid = batch.valid.data_ptr<uint8_t>();
  uint8_t* value_valid = batch.value_valid.data_ptr<uint8_t>();
  uint8_t* reset = batch.reset.data_ptr<uint8_t>();
  const uint8_t* terminated = batch.terminated.data_ptr<uint8_t>();
  const uint8_t* truncated = batch.truncated.data_ptr<uint8_t>();
  const int64_t* version = batch.policy_version.data_ptr<int64_t>();

  LagStats stats;
  int64_t counted = 0, valid_count = 0;
  double sum = 0;
  for (int64_t at = 0; at < steps * rows; ++at) {
    if (valid[at] == 0) continue;
    const int64_t lag = std::max<int64_t>(0, int64_t{learner_version} - version[at]);
    stats.min = counted == 0 ? lag : std::min(stats.min, lag);
    stats.max = std::max(stats.max, lag);
    sum += static_cast<double>(lag);
    ++counted;
    if (lag >= max_policy_lag) {
      valid[at] = 0;
      ++stats.dropped;
    } else {
      ++valid_count;
    }
  }
  stats.mean = counted > 0 ? sum / static_cast<double>(counted) : 0;
  stats.valid_fraction = static_cast<double>(valid_count) / static_cast<double>(steps * rows);

  const uint8_t* filled = batch.filled.data_ptr<uint8_t>();
  for (int64_t at = 0; at < (steps + 1) * rows; ++at) {
    const bool is_filled = at < steps * rows && filled[at] != 0;
    value_valid[at] = is_filled ? valid[at] : at >= rows ? valid[at - rows] : uint8_t{0};
  }
  std::fill_n(reset, rows, uint8_t{0});
  for (int64_t t = 1; t < steps; ++t) {
    for (int64_t r = 0; r < rows; ++r) {
      const int64_t before = (t - 1) * rows + r;
      reset[t * rows + r] = terminated[before] != 0 || truncated[before] != 0 || valid[before] == 0;
    }
  }
  return stats;
}

void visit_device_fields(RolloutBatch& batch, const std::function<void(Tensor&)>& visit) {
  for (Tensor* field :
       {&batch.frame, &batch.measurement, &batch.action_mask, &batch.agent_active, &batch.action,
        &batch.log_prob, &batch.logits, &batch.value, &batch.valid, &batch.reset, &batch.recurrent_state,
        &batch.global_state, &batch.advantage, &batch.target})
    if (field->defined()) visit(*field);
}

void send_ahead(RolloutBatch& batch, torch::Device device) {
  if (!batch.frame.defined() || device::has_own_kernels(device)) return;
  const device::Stream copies = device::Stream::beside(device);
  const device::StreamScope scope(copies);
  if (!batch.frame_there.defined())
    batch.frame_there = torch::empty(batch.frame.sizes(), torch::TensorOptions(torch::kUInt8).device(device));
  batch.frame_there.copy_(batch.frame, /*non_blocking=*/true);
  batch.frame_arrived.record(copies);
  batch.is_frame_there = true;
}

Tensor frames_on(const RolloutBatch& batch, torch::Device device) {
  if (!batch.is_frame_there) return batch.frame.to(device, /*non_blocking=*/true);
  device::Stream::current(device).wait_for(batch.frame_arrived);
  return batch.frame_there;
}

RolloutBatch to_device(const RolloutBatch& batch, torch::Device device) {
  RolloutBatch there = batch;
  there.host_valid = batch.valid;
  there.host_acting = batch.acting();
  there.frame = frames_on(batch, device);
  there.is_frame_there = false;  // views and selections are of `frame`
  std::vector<Tensor*> fields;
  visit_device_fields(there, [&](Tensor& field) {
    if (&field != &there.frame) fields.push_back(&field);
  });
  device::move_together(fields, device);
  return there;
}

RolloutBatch narrow_rows(const RolloutBatch& batch, int64_t begin, int64_t count) {
  const int64_t agents = batch.shape.env.num_agents;
  COMRAD_CHECK(begin % agents == 0 && count % agents == 0, "a micro-batch holds whole worlds");
  RolloutBatch part = batch;
  part.is_frame_there = false;
  visit_time_major(part, [&](Tensor& field) { field = field.narrow(1, begin, count); });
  part.recurrent_state = part.recurrent_state.narrow(0, begin, count);
  if (part.global_state.defined())
    part.global_state = part.global_state.narrow(1, begin / agents, count / agents);
  part.slab_count = count / agents;
  return part;
}

RolloutBatch agent_rows(const RolloutBatch& batch, int64_t agent) {
  const int64_t agents = batch.shape.env.num_agents;
  COMRAD_CHECK(agent >= 0 && agent < agents, "the agent is one of the batch");
  RolloutBatch part = batch;
  part.is_frame_there = false;
  visit_time_major(part, [&](Tensor& field) { field = field.slice(1, agent, c10::nullopt, agents); });
  part.recurrent_state = part.recurrent_state.slice(0, agent, c10::nullopt, agents);
  part.shape.env.num_agents = 1;
  part.transitions = batch.transitions / agents;
  return part;
}

RolloutBatch select_slabs(const RolloutBatch& batch, const std::vector<int64_t>& slab_index) {
  const int64_t agents = batch.shape.env.num_agents;
  std::vector<int64_t> row_index;
  row_index.reserve(slab_index.size() * static_cast<std::size_t>(agents));
  for (int64_t slab : slab_index)
    for (int64_t agent = 0; agent < agents; ++agent) row_index.push_back(slab * agents + agent);
  const Tensor index = torch::tensor(row_index, torch::kInt64);
  const torch::Device device = batch.recurrent_state.device();
  const Tensor there = device::moved(index, device);
  RolloutBatch part = batch;
  part.is_frame_there = false;
  visit_time_major(part,
                   [&](Tensor& field) { field = field.index_select(1, field.is_cpu() ? index : there); });
  part.recurrent_state = part.recurrent_state.index_select(0, there);
  if (part.global_state.defined()) {
    const Tensor worlds = device::moved(torch::tensor(slab_index, torch::kInt64), device);
    part.global_state = part.global_state.index_select(1, worlds);
  }
  part.slab_count = static_cast<int64_t>(slab_index.size());
  return part;
}

}  // namespace comrad::learn
