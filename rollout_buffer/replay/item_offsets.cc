#include "rollout_buffer/replay/item_offsets.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "rollout_buffer/schema/slab_check.h"

namespace comrad::replay {
namespace {

constexpr int64_t kFrameAlignmentBytes = 64;

int64_t round_up(int64_t value, int64_t multiple) { return (value + multiple - 1) / multiple * multiple; }

template <typename T>
T* at(std::byte* base, int64_t offset) {
  return reinterpret_cast<T*>(base + offset);
}
template <typename T>
const T* at(const std::byte* base, int64_t offset) {
  return reinterpret_cast<const T*>(base + offset);
}

}  // namespace

ItemOffsets::ItemOffsets(const TrajectoryShape& shape, const ItemForm& form) {
  const int64_t agents = shape.env.num_agents, measurements = shape.env.measurement_count;
  const int64_t length = form.length, rows = length + 1, finals = form.finals;
  int64_t end = 0;
  const auto place = [&end](int64_t bytes) {
    const int64_t start = end;
    end += bytes;
    return start;
  };
  frame_count = (rows + finals) * agents;
  // Fields of four bytes first: nothing needs padding.
  recurrent_state = place(form.has_state ? agents * shape.recurrent_state_count * 4 : 0);
  measurement = place(rows * agents * measurements * 4);
  final_measurement = place(finals * agents * measurements * 4);
  global_state = place(rows * shape.env.global_state_count * 4);
  final_global_state = place(finals * shape.env.global_state_count * 4);
  reward = place(length * agents * 4);
  post_death_reward = place(form.has_post_death_reward ? agents * 4 : 0);
  frame_ends = place(form.compressed ? frame_count * 4 : 0);
  action = place(length * agents * shape.env.head_count);
  agent_active = place(rows * agents);
  terminated = place(length);
  truncated = place(length);
  valid = place(length);
  final_row = place(length);
  action_mask = place(form.has_mask ? rows * agents * shape.env.logit_count() : 0);
  frames = round_up(end, kFrameAlignmentBytes);
  raw_bytes = frames + frame_count * shape.env.frame_bytes();
}

void pack_item(const TrajectoryShape& shape, const ItemForm& kept, const SlabView& slab, uint32_t length,
               PackedItem& item) {
  const EnvShape& env = shape.env;
  const int agents = env.num_agents, steps = static_cast<int>(std::min<int64_t>(length, shape.rollout_steps));
  const int64_t choices = env.logit_count(), measurements = env.measurement_count;
  const auto cell = [agents](int row, int agent) { return static_cast<std::size_t>(row * agents + agent); };
  item.form = {.length = steps,
               .has_state = kept.has_state && shape.recurrent_state_count > 0,
               .compressed = kept.compressed,
               .has_post_death_reward = kept.has_post_death_reward};
  item.final_rows.clear();
  item.broken_decisions = 0;
  if (steps == 0) return;

  // What decides the offsets: which final rows are used, and whether any mask forbids something.
  std::vector<StepEnd> ends(static_cast<std::size_t>(steps));
  std::vector<int8_t> final_row(static_cast<std::size_t>(steps), -1);
  for (int step = 0; step < steps; ++step) {
    const auto index = static_cast<std::size_t>(step);
    ends[index] = take_end(slab, step);
    if (ends[index].final_row < 0) continue;
    const auto known = std::find(item.final_rows.begin(), item.final_rows.end(), ends[index].final_row);
    final_row[index] = static_cast<int8_t>(known - item.final_rows.begin());
    if (known == item.final_rows.end()) item.final_rows.push_back(ends[index].final_row);
  }
  std::vector<uint8_t> mask(cell(steps + 1, 0) * static_cast<std::size_t>(choices));
  std::vector<uint8_t> is_active(cell(steps + 1, 0)), row_is_sound(cell(steps + 1, 0), 1);
  for (int row = 0; row <= steps; ++row)
    for (int agent = 0; agent < agents; ++agent) {
      is_active[cell(row, agent)] = slab.agent_active(row, agent) != 0;
      row_is_sound[cell(row, agent)] =
          take_mask(env, slab.action_mask(row, agent),
                    mask.data() + cell(row, agent) * static_cast<std::size_t>(choices)) ||
          is_active[cell(row, agent)] == 0;
    }
  item.form.finals = static_cast<int32_t>(item.final_rows.size());
  item.form.has_mask = std::find(mask.begin(), mask.end(), uint8_t{0}) != mask.end();
  item.offsets = ItemOffsets(shape, item.form);
  const ItemOffsets& offsets = item.offsets;
  item.head.assign(static_cast<std::size_t>(offsets.frames), std::byte{0});
  std::byte* base = item.head.data();

  std::vector<uint8_t> state_is_sound(static_cast<std::size_t>(agents), 1);
  for (int agent = 0; agent < agents && item.form.has_state; ++agent)
    state_is_sound[static_cast<std::size_t>(agent)] =
        take_floats(slab.recurrent_state(0, agent),
                    at<float>(base, offsets.recurrent_state) + int64_t{agent} * shape.recurrent_state_count);
  std::vector<uint8_t> final_measurement_is_sound(item.final_rows.size() * static_cast<std::size_t>(agents),
                                                  1);
  for (int agent = 0; agent < agents; ++agent) {
    for (int row = 0; row <= steps && measurements > 0; ++row)
      row_is_sound[cell(row, agent)] &= take_floats(
          slab.measurement(row, agent),
          at<float>(base, offsets.measurement) + static_cast<int64_t>(cell(row, agent)) * measurements);
    for (int f = 0; f < item.form.finals && measurements > 0; ++f)
      final_measurement_is_sound[cell(f, agent)] = take_floats(
          slab.final_measurement(item.final_rows[static_cast<std::size_t>(f)], agent),
          at<float>(base, offsets.final_measurement) + static_cast<int64_t>(cell(f, agent)) * measurements);
  }
  // The state is the world's: where it is broken, the row is for every agent.
  std::vector<uint8_t> final_state_is_sound(item.final_rows.size(), 1);
  const int64_t states = env.global_state_count;
  for (int row = 0; row <= steps && states > 0; ++row)
    if (!take_floats(slab.global_state(row), at<float>(base, offsets.global_state) + row * states))
      std::fill_n(row_is_sound.begin() + row * agents, agents, uint8_t{0});
  for (int f = 0; f < item.form.finals && states > 0; ++f)
    final_state_is_sound[static_cast<std::size_t>(f)] =
        take_floats(slab.final_global_state(item.final_rows[static_cast<std::size_t>(f)]),
                    at<float>(base, offsets.final_global_state) + f * states);
  std::memcpy(base + offsets.agent_active, is_active.data(), is_active.size());
  if (item.form.has_mask) std::memcpy(base + offsets.action_mask, mask.data(), mask.size());

  for (int step = 0; step < steps; ++step) {
    const auto index = static_cast<std::size_t>(step);
    const StepEnd& end = ends[index];
    bool step_is_valid = slab.valid(step) != 0;
    for (int agent = 0; agent < agents; ++agent) {
      bool sound = end.is_sound && state_is_sound[static_cast<std::size_t>(agent)] != 0 &&
                   row_is_sound[cell(step, agent)] != 0;
      if (final_row[index] >= 0)
        sound &= final_measurement_is_sound[cell(final_row[index], agent)] != 0 &&
                 final_state_is_sound[static_cast<std::size_t>(final_row[index])] != 0;
      sound &= take_action(
          env, slab.action(step, agent),
          at<uint8_t>(base, offsets.action) + cell(step, agent) * static_cast<std::size_t>(env.head_count));
      const float value = slab.reward(step, agent);
      sound &= std::isfinite(value);
      at<float>(base, offsets.reward)[cell(step, agent)] = sound ? value : 0.0f;
      item.broken_decisions += !sound;
      step_is_valid &= sound;
      // The observation behind a step that ends an episode belongs to the next one.
      if (!end.is_terminated && !end.is_truncated) step_is_valid &= row_is_sound[cell(step + 1, agent)] != 0;
    }
    at<uint8_t>(base, offsets.terminated)[step] = end.is_terminated;
    at<uint8_t>(base, offsets.truncated)[step] = end.is_truncated;
    at<uint8_t>(base, offsets.valid)[step] = step_is_valid;
    at<int8_t>(base, offsets.final_row)[step] = final_row[index];
  }
}

Status validate_item(const TrajectoryShape& shape, const ItemForm& form, const std::byte* bytes,
                     int64_t byte_count) {
  const auto bad = [](const char* what) { return Error{ErrorCode::kBadFormat, what}; };
  const EnvShape& env = shape.env;
  if (form.length < 1 || form.length > shape.rollout_steps)
    return bad("a trajectory's length is out of range");
  if (form.finals < 0 || form.finals > shape.final_capacity) return bad("too many last observations");
  const ItemOffsets offsets(shape, form);
  if (byte_count < offsets.frames || (!form.compressed && byte_count != offsets.raw_bytes))
    return bad("a trajectory's size does not fit its length");
  const int64_t agents = env.num_agents, rows = form.length + 1;
  if (!all_finite({at<float>(bytes, 0), static_cast<std::size_t>(offsets.frame_ends / 4)}))
    return bad("a number is not finite");
  const auto flags_ok = [&](int64_t offset, int64_t count) {
    return std::all_of(bytes + offset, bytes + offset + count,
                       [](std::byte flag) { return std::to_integer<int>(flag) <= 1; });
  };
  if (!flags_ok(offsets.agent_active, rows * agents) || !flags_ok(offsets.terminated, 3 * form.length) ||
      (form.has_mask && !flags_ok(offsets.action_mask, rows * agents * env.logit_count())))
    return bad("a flag is neither 0 nor 1");
  for (int64_t i = 0; i < form.length * agents * env.head_count; ++i)
    if (at<uint8_t>(bytes, offsets.action)[i] >= env.head_sizes[static_cast<std::size_t>(i % env.head_count)])
      return bad("an action lies outside its head");
  for (int step = 0; step < form.length; ++step) {
    const int row = at<int8_t>(bytes, offsets.final_row)[step];
    const bool cut = at<uint8_t>(bytes, offsets.truncated)[step] != 0;
    const bool valid = at<uint8_t>(bytes, offsets.valid)[step] != 0;
    if (row < -1 || row >= form.finals || (row >= 0 && !cut) || (valid && cut && row < 0))
      return bad("a last observation is missing");
  }
  if (form.compressed) {
    uint32_t end = 0;
    for (int64_t frame = 0; frame < offsets.frame_count; ++frame) {
      const uint32_t next = at<uint32_t>(bytes, offsets.frame_ends)[frame];
      if (next <= end || next - end > env.frame_bytes()) return bad("a compressed frame is out of place");
      end = next;
    }
    if (offsets.frames + int64_t{end} != byte_count)
      return bad("compressed frames do not fill their trajectory");
  }
  return {};
}

}  // namespace comrad::replay
