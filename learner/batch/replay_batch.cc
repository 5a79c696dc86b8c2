#include "learner/batch/replay_batch.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "policy_workers/device/queue.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

using replay::StoredTrajectory;

/// Writes one world into its rows of a batch.
class WorldWriter {
 public:
  WorldWriter(ReplayBatch& batch, const ReplayBatchOptions& options, int64_t world)
      : batch_(batch),
        env_(options.shape.env),
        pay_(options.pay),
        agents_end_(options.agents_end),
        agents_(batch.shape.env.num_agents),
        first_(world * agents_) {}

  /// Row t of the batch becomes the observation at `step` of the trajectory; `agent` -1 means all of them.
  void observe(int64_t t, const StoredTrajectory& from, int step, int agent) {
    if (agent < 0)
      from.copy_frames(step, frame(t));
    else
      from.copy_frame(step, agent, frame(t));
    observe_rest(t, from.measurement(step), from.action_mask(step), from.agent_active(step), agent);
    observe_state(t, from.global_state(step));
  }
  /// Row t becomes the true last observation of the episode that was cut at `step`, whose masks still hold.
  void observe_final(int64_t t, const StoredTrajectory& from, int step, int agent) {
    const int row = from.final_row(step);
    if (agent < 0)
      from.copy_final_frames(row, frame(t));
    else
      from.copy_final_frame(row, agent, frame(t));
    observe_rest(t, from.final_measurement(row), from.action_mask(step), from.agent_active(step), agent);
    observe_state(t, from.final_global_state(row));
  }
  void observe_nothing(int64_t t) {
    std::memset(frame(t), 0, static_cast<std::size_t>(agents_ * env_.frame_bytes()));
    if (env_.global_state_count > 0) std::fill_n(state_of(t), env_.global_state_count, 0.0f);
    for (int64_t i = 0; i < agents_; ++i) {
      const int64_t at = index(t, i);
      if (env_.measurement_count > 0)
        std::fill_n(batch_.measurement.data_ptr<float>() + at * env_.measurement_count,
                    env_.measurement_count, 0.0f);
      std::fill_n(batch_.action_mask.data_ptr<uint8_t>() + at * env_.logit_count(), env_.logit_count(),
                  uint8_t{1});
      batch_.agent_active.data_ptr<uint8_t>()[at] = 0;
    }
  }

  /// The actions of row t.
  void choose(int64_t t, const StoredTrajectory& from, int step, int agent) {
    const auto action = from.action(step);
    for (int64_t i = 0; i < agents_; ++i) {
      const int64_t source = agent < 0 ? i : agent, at = index(t, i);
      for (int64_t head = 0; head < env_.head_count; ++head)
        batch_.action.data_ptr<int64_t>()[at * env_.head_count + head] =
            action[static_cast<std::size_t>(source * env_.head_count + head)];
    }
  }
  /// The actions of all agents at a step of a sequence, and what they led to.
  void decide(int64_t t, const StoredTrajectory& from, int step) {
    choose(t, from, step, -1);
    for (int64_t i = 0; i < agents_; ++i)
      end(t, i,
          {.reward = static_cast<float>(paid(from, step, static_cast<int>(i))),
           .terminated = from.terminated(step) || is_last(from, step, static_cast<int>(i)),
           .truncated = from.truncated(step),
           .valid = from.valid(step)});
  }
  void decide_nothing(int64_t t) {
    for (int64_t i = 0; i < agents_; ++i) {
      std::fill_n(batch_.action.data_ptr<int64_t>() + index(t, i) * env_.head_count, env_.head_count,
                  int64_t{0});
      end(t, i, {});
    }
  }

  struct Outcome {
    float reward = 0, bootstrap = 1;
    bool terminated = true, truncated = false, valid = false;
  };
  /// What a decision of row i led to.
  void end(int64_t t, int64_t i, const Outcome& outcome) {
    const int64_t at = index(t, i);
    batch_.reward.data_ptr<float>()[at] = outcome.reward;
    batch_.bootstrap.data_ptr<float>()[at] = outcome.bootstrap;
    batch_.terminated.data_ptr<uint8_t>()[at] = outcome.terminated;
    batch_.truncated.data_ptr<uint8_t>()[at] = outcome.truncated;
    batch_.valid.data_ptr<uint8_t>()[at] = outcome.valid;
  }

  /// What the decision of an agent pays, and whether its way ends with it.
  double paid(const StoredTrajectory& from, int step, int agent) {
    if (agents_end_) {
      const replay::PaidDecision decision = replay::paid_decision(from, step, agent, pay_);
      batch_.rewards_read += decision.payments;
      batch_.rewards_clipped += decision.clipped_payments;
      return decision.reward;
    }
    const double reward = double{from.reward(step)[static_cast<std::size_t>(agent)]};
    const double clipped = pay_.clipped(reward);
    ++batch_.rewards_read;
    batch_.rewards_clipped += clipped != reward;
    return clipped;
  }
  bool is_last(const StoredTrajectory& from, int step, int agent) const {
    return agents_end_ && replay::is_last_decision(from, step, agent);
  }

  void reset(int64_t t, bool is_reset) {
    std::fill_n(batch_.reset.data_ptr<uint8_t>() + index(t, 0), agents_, uint8_t{is_reset});
  }
  void state(const StoredTrajectory& from) {
    const int64_t count = batch_.recurrent_state.size(1);
    if (count == 0) return;
    for (int64_t i = 0; i < agents_; ++i)
      std::ranges::copy(from.recurrent_state(static_cast<int>(i)),
                        batch_.recurrent_state.data_ptr<float>() + (first_ + i) * count);
  }
  void no_state() {
    const int64_t count = batch_.recurrent_state.size(1);
    std::fill_n(batch_.recurrent_state.data_ptr<float>() + first_ * count, agents_ * count, 0.0f);
  }

 private:
  int64_t index(int64_t t, int64_t i) const { return t * batch_.rows() + first_ + i; }
  uint8_t* frame(int64_t t) const {
    return batch_.frame.data_ptr<uint8_t>() + index(t, 0) * env_.frame_bytes();
  }
  float* state_of(int64_t t) const {
    return batch_.global_state.data_ptr<float>() +
           (t * batch_.world_count + first_ / agents_) * env_.global_state_count;
  }
  void observe_state(int64_t t, std::span<const float> state) {
    if (env_.global_state_count > 0) std::ranges::copy(state, state_of(t));
  }
  void observe_rest(int64_t t, std::span<const float> measurement, std::span<const uint8_t> mask,
                    std::span<const uint8_t> active, int agent) {
    const int64_t choices = env_.logit_count(), measurements = env_.measurement_count;
    for (int64_t i = 0; i < agents_; ++i) {
      const int64_t source = agent < 0 ? i : agent, at = index(t, i);
      if (measurements > 0)
        std::copy_n(measurement.data() + source * measurements, measurements,
                    batch_.measurement.data_ptr<float>() + at * measurements);
      const uint8_t* from = mask.data() + source * choices;
      std::copy_n(from, choices, batch_.action_mask.data_ptr<uint8_t>() + at * choices);
      batch_.has_action_mask |= std::any_of(from, from + choices, [](uint8_t byte) { return byte == 0; });
      batch_.agent_active.data_ptr<uint8_t>()[at] = active[static_cast<std::size_t>(source)];
    }
  }

  ReplayBatch& batch_;
  const EnvShape& env_;
  replay::PostDeathReward pay_;
  bool agents_end_;
  int64_t agents_, first_;
};

/// Frames of cuts, collected while worlds are written.
struct Finals {
  std::vector<uint8_t> frames;
  std::vector<float> measurements, states;
};

void write_nothing(ReplayBatch& batch, const ReplayBatchOptions& options, int64_t world) {
  WorldWriter writer(batch, options, world);
  writer.no_state();
  for (int64_t t = 0; t <= batch.steps(); ++t) {
    writer.observe_nothing(t);
    writer.reset(t, t > 0);
    if (t < batch.steps()) writer.decide_nothing(t);
  }
}

void write_sequence(ReplayBatch& batch, const ReplayBatchOptions& options, int64_t world,
                    const StoredTrajectory& from, Finals& finals) {
  WorldWriter writer(batch, options, world);
  const EnvShape& env = options.shape.env;
  const int length = from.length(), steps = options.shape.rollout_steps;
  writer.state(from);
  for (int t = 0; t <= steps; ++t) {
    if (t <= length)
      writer.observe(t, from, t, -1);
    else
      writer.observe_nothing(t);
    writer.reset(
        t, t > 0 && (t > length || from.terminated(t - 1) || from.truncated(t - 1) || !from.valid(t - 1)));
    if (t == steps) break;
    if (t >= length) {
      writer.decide_nothing(t);
      continue;
    }
    writer.decide(t, from, t);
    const int row = from.final_row(t);
    if (!from.truncated(t) || row < 0) continue;
    const std::size_t bytes = static_cast<std::size_t>(env.num_agents * env.frame_bytes());
    finals.frames.resize(finals.frames.size() + bytes);
    from.copy_final_frames(row, finals.frames.data() + finals.frames.size() - bytes);
    const auto measured = from.final_measurement(row);
    finals.measurements.insert(finals.measurements.end(), measured.begin(), measured.end());
    const auto state = from.final_global_state(row);
    finals.states.insert(finals.states.end(), state.begin(), state.end());
    for (int64_t agent = 0; agent < env.num_agents; ++agent) {
      batch.final_step.push_back(t);
      batch.final_row.push_back(world * env.num_agents + agent);
    }
  }
}

void write_decision(ReplayBatch& batch, const ReplayBatchOptions& options, int64_t world,
                    const StoredTrajectory& from, const replay::Draw& draw) {
  WorldWriter writer(batch, options, world);
  const int agent = options.unit == replay::Unit::kAgentStep ? draw.agent : -1;
  const int step = draw.step;
  writer.no_state();
  writer.reset(0, false), writer.reset(1, false);
  writer.observe(0, from, step, agent);
  writer.choose(0, from, step, agent);

  // n rewards, fewer where the episode or the trajectory ends before, or the agent's own way.
  int last = step;
  while (last - step + 1 < options.n_step && last + 1 < from.length() && !from.terminated(last) &&
         !from.truncated(last) && from.valid(last + 1))
    ++last;
  for (int64_t i = 0; i < batch.shape.env.num_agents; ++i) {
    const int source = agent < 0 ? static_cast<int>(i) : agent;
    double sum = 0, discount = 1;
    int end = step;
    for (int t = step;; ++t, discount *= options.pay.gamma) {
      sum += discount * writer.paid(from, t, source);
      end = t;
      if (t == last || writer.is_last(from, t, source)) break;
    }
    writer.end(0, i,
               {.reward = static_cast<float>(sum),
                .bootstrap = static_cast<float>(discount),
                .terminated = from.terminated(end) || writer.is_last(from, end, source),
                .truncated = from.truncated(end),
                .valid = from.valid(step)});
  }
  if (from.truncated(last) && from.final_row(last) >= 0)
    writer.observe_final(1, from, last, agent);
  else
    writer.observe(1, from, last + 1, agent);
}

template <typename Visitor>
void visit_time_major(ReplayBatch& batch, Visitor&& visit) {
  for (Tensor* field :  // the global state has worlds where these have rows
       {&batch.frame, &batch.measurement, &batch.action_mask, &batch.agent_active, &batch.action,
        &batch.reward, &batch.bootstrap, &batch.terminated, &batch.truncated, &batch.valid, &batch.reset})
    if (field->defined()) visit(*field);
}

/// Keeps the final rows for which `wanted(step, row)` holds, moved by -step_shift and -row_shift.
template <typename Wanted>
void keep_finals(ReplayBatch& part, const ReplayBatch& whole, int64_t step_shift, int64_t row_shift,
                 Wanted&& wanted) {
  std::vector<int64_t> kept, kept_cuts;
  const int64_t agents = whole.shape.env.num_agents;
  part.final_step.clear(), part.final_row.clear();
  for (std::size_t f = 0; f < whole.final_row.size(); ++f) {
    if (!wanted(whole.final_step[f], whole.final_row[f])) continue;
    kept.push_back(static_cast<int64_t>(f));
    if (whole.final_row[f] % agents == 0) kept_cuts.push_back(static_cast<int64_t>(f) / agents);
    part.final_step.push_back(whole.final_step[f] - step_shift);
    part.final_row.push_back(whole.final_row[f] - row_shift);
  }
  const Tensor index = torch::tensor(kept, torch::kInt64);
  part.final_frame = whole.final_frame.index_select(0, index);
  if (whole.final_measurement.defined())
    part.final_measurement = whole.final_measurement.index_select(0, index);
  if (whole.final_global_state.defined())
    part.final_global_state =
        whole.final_global_state.index_select(0, torch::tensor(kept_cuts, torch::kInt64));
}

}  // namespace

ReplayBatch make_replay_batch(const ReplayBatchOptions& options) {
  COMRAD_CHECK(options.world_count > 0, "a batch holds at least one world");
  const bool single = options.unit != replay::Unit::kSequence;
  ReplayBatch batch;
  batch.shape = options.shape;
  if (single) batch.shape.rollout_steps = 1;
  if (options.unit == replay::Unit::kAgentStep) batch.shape.env.num_agents = 1;
  batch.world_count = options.world_count;
  const EnvShape& env = batch.shape.env;
  const int64_t steps = batch.steps(), rows = batch.rows();
  const auto f32 = torch::kFloat32;
  const auto u8 = torch::kUInt8;
  batch.frame =
      device::host_memory({steps + 1, rows, env.channels, env.height, env.width}, u8, options.device);
  if (env.measurement_count > 0)
    batch.measurement = torch::zeros({steps + 1, rows, env.measurement_count}, f32);
  if (env.global_state_count > 0)
    batch.global_state = torch::zeros({steps + 1, options.world_count, env.global_state_count}, f32);
  batch.action_mask = torch::ones({steps + 1, rows, env.logit_count()}, u8);
  batch.agent_active = torch::ones({steps + 1, rows}, u8);
  batch.action = torch::zeros({steps, rows, env.head_count}, torch::kInt64);
  batch.reward = torch::zeros({steps, rows}, f32);
  batch.bootstrap = torch::ones({steps, rows}, f32);
  batch.terminated = torch::ones({steps, rows}, u8);
  batch.truncated = torch::zeros({steps, rows}, u8);
  batch.valid = torch::zeros({steps, rows}, u8);
  batch.reset = torch::zeros({steps + 1, rows}, u8);
  batch.recurrent_state = torch::zeros({rows, single ? 0 : options.shape.recurrent_state_count}, f32);
  batch.weight = torch::ones({options.world_count}, f32);
  batch.final_frame = torch::empty({0, env.channels, env.height, env.width}, u8);
  if (env.measurement_count > 0) batch.final_measurement = torch::empty({0, env.measurement_count}, f32);
  if (env.global_state_count > 0) batch.final_global_state = torch::empty({0, env.global_state_count}, f32);
  return batch;
}

void hand_back(ReplayBatch& batch, torch::Device device) {
  batch.was_read.record(device::Stream::current(device));
}

void fill(ReplayBatch& batch, const ReplayBatchOptions& options, const replay::Replay& replay,
          std::span<const replay::Draw> draws) {
  COMRAD_CHECK(static_cast<int64_t>(draws.size()) == batch.world_count, "one draw for every world");
  const EnvShape& env = batch.shape.env;
  batch.was_read.wait();
  Finals finals;
  batch.has_action_mask = false;
  batch.final_step.clear(), batch.final_row.clear(), batch.serial.clear();
  batch.rewards_read = batch.rewards_clipped = 0;
  batch.abs_td = Tensor();
  replay.read_each(draws, [&](std::size_t index, const StoredTrajectory* from) {
    const replay::Draw& draw = draws[index];
    const int64_t world = static_cast<int64_t>(index);
    batch.serial.push_back(draw.serial);
    batch.weight.data_ptr<float>()[index] = static_cast<float>(draw.weight);
    if (from == nullptr)
      write_nothing(batch, options, world);
    else if (options.unit == replay::Unit::kSequence)
      write_sequence(batch, options, world, *from, finals);
    else
      write_decision(batch, options, world, *from, draw);
  });
  const int64_t final_count = static_cast<int64_t>(batch.final_row.size());
  batch.final_frame = torch::empty({final_count, env.channels, env.height, env.width}, torch::kUInt8);
  std::ranges::copy(finals.frames, batch.final_frame.data_ptr<uint8_t>());
  if (env.global_state_count > 0) {
    batch.final_global_state =
        torch::empty({final_count / env.num_agents, env.global_state_count}, torch::kFloat32);
    std::ranges::copy(finals.states, batch.final_global_state.data_ptr<float>());
  }
  if (env.measurement_count == 0) return;
  batch.final_measurement = torch::empty({final_count, env.measurement_count}, torch::kFloat32);
  std::ranges::copy(finals.measurements, batch.final_measurement.data_ptr<float>());
}

ReplayBatch narrow_worlds(const ReplayBatch& batch, int64_t begin, int64_t count) {
  const int64_t agents = batch.shape.env.num_agents, first = begin * agents, rows = count * agents;
  ReplayBatch part = batch;
  part.world_count = count;
  visit_time_major(part, [&](Tensor& field) { field = field.narrow(1, first, rows); });
  part.recurrent_state = part.recurrent_state.narrow(0, first, rows);
  part.weight = part.weight.narrow(0, begin, count);
  if (part.global_state.defined()) part.global_state = part.global_state.narrow(1, begin, count);
  keep_finals(part, batch, 0, first,
              [&](int64_t, int64_t row) { return row >= first && row < first + rows; });
  return part;
}

ReplayBatch steps_from(const ReplayBatch& batch, int64_t first, const Tensor& recurrent_state) {
  ReplayBatch part = batch;
  part.shape.rollout_steps -= static_cast<int32_t>(first);
  visit_time_major(part, [&](Tensor& field) { field = field.narrow(0, first, field.size(0) - first); });
  if (part.global_state.defined())
    part.global_state = part.global_state.narrow(0, first, part.global_state.size(0) - first);
  part.recurrent_state = recurrent_state;
  keep_finals(part, batch, first, 0, [&](int64_t step, int64_t) { return step >= first; });
  return part;
}

}  // namespace comrad::learn
