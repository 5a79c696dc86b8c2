#include "rollout_buffer/schema/trajectory.h"

#include <algorithm>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/schema/version.h"

namespace comrad {
namespace {

constexpr int64_t kPageBytes = 4096;

int64_t round_up(int64_t value, int64_t multiple) { return (value + multiple - 1) / multiple * multiple; }

}  // namespace

SlabOffsets::SlabOffsets(const TrajectoryShape& given) : shape(given) {
  const int64_t steps = shape.rollout_steps, agents = shape.env.num_agents, finals = shape.final_capacity;
  const int64_t logit_count = shape.env.logit_count(), measurements = shape.env.measurement_count;
  int64_t end = 0;
  const auto place = [&end](int64_t bytes) {
    const int64_t start = end;
    end = round_up(end + bytes, static_cast<int64_t>(kCacheLineBytes));
    return start;
  };
  frame = place((steps + 1) * agents * shape.env.frame_bytes());
  final_frame = place(finals * agents * shape.env.frame_bytes());
  measurement = place((steps + 1) * agents * measurements * 4);
  final_measurement = place(finals * agents * measurements * 4);
  global_state = place((steps + 1) * shape.env.global_state_count * 4);
  final_global_state = place(finals * shape.env.global_state_count * 4);
  action_mask = place((steps + 1) * agents * logit_count);
  agent_active = place((steps + 1) * agents);
  reward = place(steps * agents * 4);
  terminated = place(steps);
  truncated = place(steps);
  final_index = place(steps * 4);
  layout_index = place(steps * 4);
  recurrent_state = place(int64_t{shape.recurrent_snapshots} * agents * shape.recurrent_state_count * 4);
  action = place(steps * agents * shape.env.head_count * 4);
  log_prob = place(steps * agents * 4);
  value = place((steps + 1) * agents * 4);
  final_value = place(finals * agents * 4);
  logits = place(steps * agents * logit_count * 4);
  policy_version = place(steps * agents * 4);
  valid = place(steps);
  slab_bytes = round_up(end, kPageBytes);
}

namespace {

/// The row `index` of rows of `width` elements, checked against `rows` in debug builds.
template <typename T>
std::span<T> row(T* base, int64_t index, [[maybe_unused]] int64_t rows, int64_t width) {
  COMRAD_DCHECK(index >= 0 && index < rows, "slab row index is in range");
  return {base + index * width, static_cast<std::size_t>(width)};
}

}  // namespace

std::span<uint8_t> SlabView::frame(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<uint8_t>(offsets_->frame), step * agents + agent, (shape().rollout_steps + 1) * agents,
             shape().env.frame_bytes());
}

std::span<uint8_t> SlabView::frames(int step) const {
  return row(at<uint8_t>(offsets_->frame), step, shape().rollout_steps + 1,
             shape().env.num_agents * shape().env.frame_bytes());
}

std::span<float> SlabView::measurement(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->measurement), step * agents + agent, (shape().rollout_steps + 1) * agents,
             shape().env.measurement_count);
}

std::span<float> SlabView::global_state(int step) const {
  return row(at<float>(offsets_->global_state), step, shape().rollout_steps + 1,
             shape().env.global_state_count);
}

std::span<uint8_t> SlabView::action_mask(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<uint8_t>(offsets_->action_mask), step * agents + agent, (shape().rollout_steps + 1) * agents,
             shape().env.logit_count());
}

uint8_t& SlabView::agent_active(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<uint8_t>(offsets_->agent_active), step * agents + agent, (shape().rollout_steps + 1) * agents,
             1)[0];
}

float& SlabView::reward(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->reward), step * agents + agent, shape().rollout_steps * agents, 1)[0];
}

uint8_t& SlabView::terminated(int step) const {
  return row(at<uint8_t>(offsets_->terminated), step, shape().rollout_steps, 1)[0];
}

uint8_t& SlabView::truncated(int step) const {
  return row(at<uint8_t>(offsets_->truncated), step, shape().rollout_steps, 1)[0];
}

int32_t& SlabView::final_index(int step) const {
  return row(at<int32_t>(offsets_->final_index), step, shape().rollout_steps, 1)[0];
}

int32_t& SlabView::layout_index(int step) const {
  return row(at<int32_t>(offsets_->layout_index), step, shape().rollout_steps, 1)[0];
}

std::span<uint8_t> SlabView::final_frame(int final_row, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<uint8_t>(offsets_->final_frame), final_row * agents + agent, shape().final_capacity * agents,
             shape().env.frame_bytes());
}

std::span<float> SlabView::final_measurement(int final_row, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->final_measurement), final_row * agents + agent,
             shape().final_capacity * agents, shape().env.measurement_count);
}

std::span<float> SlabView::final_global_state(int final_row) const {
  return row(at<float>(offsets_->final_global_state), final_row, shape().final_capacity,
             shape().env.global_state_count);
}

std::span<float> SlabView::recurrent_state(int snapshot, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->recurrent_state), snapshot * agents + agent,
             shape().recurrent_snapshots * agents, shape().recurrent_state_count);
}

std::span<int32_t> SlabView::action(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<int32_t>(offsets_->action), step * agents + agent, shape().rollout_steps * agents,
             shape().env.head_count);
}

float& SlabView::log_prob(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->log_prob), step * agents + agent, shape().rollout_steps * agents, 1)[0];
}

float& SlabView::value(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->value), step * agents + agent, (shape().rollout_steps + 1) * agents, 1)[0];
}

float& SlabView::final_value(int final_row, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->final_value), final_row * agents + agent, shape().final_capacity * agents,
             1)[0];
}

std::span<float> SlabView::logits(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<float>(offsets_->logits), step * agents + agent, shape().rollout_steps * agents,
             shape().env.logit_count());
}

uint32_t& SlabView::policy_version(int step, int agent) const {
  const int64_t agents = shape().env.num_agents;
  return row(at<uint32_t>(offsets_->policy_version), step * agents + agent, shape().rollout_steps * agents,
             1)[0];
}

uint8_t& SlabView::valid(int step) const {
  return row(at<uint8_t>(offsets_->valid), step, shape().rollout_steps, 1)[0];
}

void SlabView::clear() const {
  const auto steps = static_cast<std::size_t>(shape().rollout_steps);
  std::fill_n(at<float>(offsets_->reward), steps * static_cast<std::size_t>(shape().env.num_agents), 0.0f);
  std::fill_n(at<int32_t>(offsets_->final_index), steps, -1);
  std::fill_n(at<int32_t>(offsets_->layout_index), steps, 0);
  for (const int64_t flags : {offsets_->terminated, offsets_->truncated, offsets_->valid})
    std::fill_n(at<uint8_t>(flags), steps, uint8_t{0});
}

namespace {

/// Row `from` of rows of `width` elements is repeated up to row `end`.
template <typename T>
void repeat(T* rows, int64_t width, int from, int end) {
  for (int step = from + 1; step < end; ++step)
    std::copy_n(rows + from * width, static_cast<std::size_t>(width), rows + step * width);
}

}  // namespace

void SlabView::pad(int length) const {
  const int64_t agents = shape().env.num_agents, logits = shape().env.logit_count();
  const SlabOffsets& field = *offsets_;
  // Observations and values have T+1 rows, the last one is row `length`; what belongs to a decision has T.
  const int last = length - 1, steps = shape().rollout_steps;
  repeat(at<uint8_t>(field.frame), agents * shape().env.frame_bytes(), length, steps + 1);
  repeat(at<float>(field.measurement), agents * shape().env.measurement_count, length, steps + 1);
  repeat(at<float>(field.global_state), shape().env.global_state_count, length, steps + 1);
  repeat(at<uint8_t>(field.action_mask), agents * logits, length, steps + 1);
  repeat(at<uint8_t>(field.agent_active), agents, length, steps + 1);
  repeat(at<float>(field.value), agents, length, steps + 1);
  repeat(at<int32_t>(field.action), agents * shape().env.head_count, last, steps);
  repeat(at<float>(field.logits), agents * logits, last, steps);
  repeat(at<float>(field.log_prob), agents, last, steps);
  repeat(at<uint32_t>(field.policy_version), agents, last, steps);
  repeat(at<int32_t>(field.layout_index), 1, last, steps);
}

}  // namespace comrad
