#include "rollout_buffer/replay/trajectory_store.h"

#include <spdlog/fmt/fmt.h>

#include <lz4.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"

namespace comrad::replay {
namespace {

constexpr int64_t kSlotAlignmentBytes = 64;
constexpr std::array<char, 8> kSnapshotMagic = {'C', 'O', 'M', 'R', 'P', 'L', 'A', 'Y'};
constexpr int32_t kSnapshotVersion =
    4;  // 1 and 2 had other checksums, so that nothing in them can be believed; 3 had no global state
constexpr uint32_t kFlagMask = 1, kFlagState = 2, kFlagCompressed = 4, kFlagLate = 8;

int64_t round_up(int64_t value) {
  return (value + kSlotAlignmentBytes - 1) / kSlotAlignmentBytes * kSlotAlignmentBytes;
}

/// First section of a snapshot.
struct SnapshotHeader {
  std::array<char, 8> magic{};
  int32_t version = 0;
  int32_t num_agents = 0, channels = 0, height = 0, width = 0, measurement_count = 0, head_count = 0;
  int32_t global_state_count = 0, unused = 0;
  std::array<int32_t, kMaxHeads> head_sizes{};
  int32_t rollout_steps = 0, recurrent_state_count = 0, final_capacity = 0;
  int32_t keeps_state = 0, compressed = 0;
  int64_t capacity_bytes = 0, write_offset = 0;
  int64_t item_count = 0, end_id = 0, broken_decisions = 0;
};
static_assert(std::has_unique_object_representations_v<SnapshotHeader>, "no padding reaches the disk");

SnapshotHeader header_of(const StoreOptions& options) {
  const TrajectoryShape& shape = options.shape;
  SnapshotHeader header;
  header.magic = kSnapshotMagic;
  header.version = kSnapshotVersion;
  header.num_agents = shape.env.num_agents;
  header.channels = shape.env.channels;
  header.height = shape.env.height;
  header.width = shape.env.width;
  header.measurement_count = shape.env.measurement_count;
  header.global_state_count = shape.env.global_state_count;
  header.head_count = shape.env.head_count;
  for (int head = 0; head < shape.env.head_count; ++head)
    header.head_sizes[static_cast<std::size_t>(head)] = shape.env.head_sizes[static_cast<std::size_t>(head)];
  header.rollout_steps = shape.rollout_steps;
  header.recurrent_state_count = shape.recurrent_state_count;
  header.final_capacity = shape.final_capacity;
  header.keeps_state = options.keep_recurrent_state;
  header.compressed = options.compress;
  header.capacity_bytes = options.capacity_bytes;
  return header;
}

/// What differs between a snapshot's shapes and ours; empty where nothing does.
std::string difference(const SnapshotHeader& saved, const SnapshotHeader& ours) {
  struct Field {
    const char* name;
    int32_t SnapshotHeader::*value;
  };
  static constexpr Field kFields[] = {{"num_agents", &SnapshotHeader::num_agents},
                                      {"channels", &SnapshotHeader::channels},
                                      {"height", &SnapshotHeader::height},
                                      {"width", &SnapshotHeader::width},
                                      {"measurements", &SnapshotHeader::measurement_count},
                                      {"global state", &SnapshotHeader::global_state_count},
                                      {"action heads", &SnapshotHeader::head_count},
                                      {"rollout", &SnapshotHeader::rollout_steps},
                                      {"recurrent state", &SnapshotHeader::recurrent_state_count},
                                      {"final rows", &SnapshotHeader::final_capacity},
                                      {"kept recurrent state", &SnapshotHeader::keeps_state}};
  for (const Field& field : kFields)
    if (saved.*field.value != ours.*field.value)
      return fmt::format("{} {}, this run has {}", field.name, saved.*field.value, ours.*field.value);
  return saved.head_sizes == ours.head_sizes ? "" : "sizes of action heads that differ from this run's";
}

uint32_t flags_of(const ItemForm& form) {
  return (form.has_mask ? kFlagMask : 0) | (form.has_state ? kFlagState : 0) |
         (form.compressed ? kFlagCompressed : 0) | (form.has_post_death_reward ? kFlagLate : 0);
}

std::span<const std::byte> frame_bytes_of(std::span<const uint8_t> frames) { return std::as_bytes(frames); }

}  // namespace

// ----------------------------------------------------------------------------------------------
// StoredTrajectory

uint8_t StoredTrajectory::flag(int64_t offset, int step) const {
  COMRAD_DCHECK(step >= 0 && step < length(), "the step lies in the trajectory");
  return std::to_integer<uint8_t>(bytes_[offset + step]);
}

void StoredTrajectory::copy_cells(int64_t first, int64_t count, uint8_t* out) const {
  COMRAD_DCHECK(first >= 0 && first + count <= offsets_.frame_count, "the frame lies in the trajectory");
  const int64_t frame = shape_->env.frame_bytes();
  if (!form_.compressed) {
    std::memcpy(out, bytes_ + offsets_.frames + first * frame, static_cast<std::size_t>(count * frame));
    return;
  }
  const auto ends = field<uint32_t>(offsets_.frame_ends, 0, offsets_.frame_count);
  for (int64_t cell = first; cell < first + count; ++cell, out += frame) {
    const int64_t begin = cell == 0 ? 0 : ends[static_cast<std::size_t>(cell - 1)];
    const int64_t end = ends[static_cast<std::size_t>(cell)];
    const int64_t size = end - begin;
    // The bytes may lie in a file that others can write: they cannot make us look outside.
    const bool inside = size > 0 && size <= frame && offsets_.frames + end <= byte_count_;
    const std::byte* block = bytes_ + offsets_.frames + begin;
    if (inside && size == frame)
      std::memcpy(out, block, static_cast<std::size_t>(frame));  // did not shrink: stored as it was
    else if (!inside ||
             LZ4_decompress_safe(reinterpret_cast<const char*>(block), reinterpret_cast<char*>(out),
                                 static_cast<int>(size), static_cast<int>(frame)) != frame)
      std::memset(out, 0, static_cast<std::size_t>(frame));
  }
}

void StoredTrajectory::copy_frames(int step, uint8_t* out) const {
  copy_cells(int64_t{step} * agents(), agents(), out);
}

void StoredTrajectory::copy_frame(int step, int agent, uint8_t* out) const {
  copy_cells(int64_t{step} * agents() + agent, 1, out);
}

void StoredTrajectory::copy_final_frames(int row, uint8_t* out) const {
  copy_cells(int64_t{length() + 1 + row} * agents(), agents(), out);
}

void StoredTrajectory::copy_final_frame(int row, int agent, uint8_t* out) const {
  copy_cells(int64_t{length() + 1 + row} * agents() + agent, 1, out);
}

std::span<const float> StoredTrajectory::measurement(int step) const {
  COMRAD_DCHECK(step >= 0 && step <= length(), "the row lies in the trajectory");
  return field<float>(offsets_.measurement, step, int64_t{agents()} * shape_->env.measurement_count);
}

std::span<const float> StoredTrajectory::final_measurement(int row) const {
  COMRAD_DCHECK(row >= 0 && row < final_count(), "the last observation lies in the trajectory");
  return field<float>(offsets_.final_measurement, row, int64_t{agents()} * shape_->env.measurement_count);
}

std::span<const float> StoredTrajectory::global_state(int step) const {
  COMRAD_DCHECK(step >= 0 && step <= length(), "the row lies in the trajectory");
  return field<float>(offsets_.global_state, step, shape_->env.global_state_count);
}

std::span<const float> StoredTrajectory::final_global_state(int row) const {
  COMRAD_DCHECK(row >= 0 && row < final_count(), "the last observation lies in the trajectory");
  return field<float>(offsets_.final_global_state, row, shape_->env.global_state_count);
}

std::span<const uint8_t> StoredTrajectory::action_mask(int step) const {
  COMRAD_DCHECK(step >= 0 && step <= length(), "the row lies in the trajectory");
  const int64_t width = int64_t{agents()} * shape_->env.logit_count();
  if (!form_.has_mask) return {ones_, static_cast<std::size_t>(width)};
  return field<uint8_t>(offsets_.action_mask, step, width);
}

std::span<const uint8_t> StoredTrajectory::agent_active(int step) const {
  COMRAD_DCHECK(step >= 0 && step <= length(), "the row lies in the trajectory");
  return field<uint8_t>(offsets_.agent_active, step, agents());
}

std::span<const uint8_t> StoredTrajectory::action(int step) const {
  COMRAD_DCHECK(step >= 0 && step < length(), "the step lies in the trajectory");
  return field<uint8_t>(offsets_.action, step, int64_t{agents()} * shape_->env.head_count);
}

std::span<const float> StoredTrajectory::reward(int step) const {
  COMRAD_DCHECK(step >= 0 && step < length(), "the step lies in the trajectory");
  return field<float>(offsets_.reward, step, agents());
}

float StoredTrajectory::post_death_reward(int agent) const {
  COMRAD_DCHECK(agent >= 0 && agent < agents(), "the agent exists");
  return form_.has_post_death_reward
             ? field<float>(offsets_.post_death_reward, 0, agents())[static_cast<std::size_t>(agent)]
             : 0;
}

bool StoredTrajectory::terminated(int step) const { return flag(offsets_.terminated, step) != 0; }
bool StoredTrajectory::truncated(int step) const { return flag(offsets_.truncated, step) != 0; }
bool StoredTrajectory::valid(int step) const { return flag(offsets_.valid, step) != 0; }
int StoredTrajectory::final_row(int step) const {
  return static_cast<int8_t>(flag(offsets_.final_row, step));
}

std::span<const float> StoredTrajectory::recurrent_state(int agent) const {
  if (!form_.has_state) return {};
  return field<float>(offsets_.recurrent_state, agent, shape_->recurrent_state_count);
}

std::pair<int64_t, int64_t> StoredTrajectory::frame_range(int first, int last) const {
  return cell_range(int64_t{first} * agents(), int64_t{last + 1} * agents());
}

std::pair<int64_t, int64_t> StoredTrajectory::frame_range_of_agent(int row, int agent) const {
  return cell_range(int64_t{row} * agents() + agent, int64_t{row} * agents() + agent + 1);
}

std::pair<int64_t, int64_t> StoredTrajectory::cell_range(int64_t begin, int64_t end) const {
  if (!form_.compressed) {
    const int64_t frame = shape_->env.frame_bytes();
    return {offsets_.frames + begin * frame, (end - begin) * frame};
  }
  const auto ends = field<uint32_t>(offsets_.frame_ends, 0, offsets_.frame_count);
  // Bounded, because the ends may lie in a file that others can write.
  const int64_t room = byte_count_ - offsets_.frames;
  const int64_t from = begin == 0 ? 0 : std::min<int64_t>(ends[static_cast<std::size_t>(begin - 1)], room);
  const int64_t to = std::min<int64_t>(ends[static_cast<std::size_t>(end - 1)], room);
  return {offsets_.frames + from, std::max<int64_t>(to - from, 0)};
}

// -----------------------------------------------------------------------------------------------
// TrajectoryStore

int64_t TrajectoryStore::item_bytes(const TrajectoryShape& shape, int finals, bool with_mask) {
  const ItemForm whole{.length = shape.rollout_steps,
                       .finals = finals,
                       .has_mask = with_mask,
                       .has_state = shape.recurrent_state_count > 0};
  return round_up(ItemOffsets(shape, whole).raw_bytes);
}

Expected<TrajectoryStore> TrajectoryStore::create(const StoreOptions& options) {
  COMRAD_TRY(validate(options.shape));
  const TrajectoryShape& shape = options.shape;
  if (shape.final_capacity > std::numeric_limits<int8_t>::max())
    return Error{ErrorCode::kBadInput,
                 fmt::format("a replay keeps at most 127 last observations a trajectory, not {}",
                             shape.final_capacity)};
  // The largest item: everything kept, and a table of frames that do not shrink.
  ItemForm largest{.length = shape.rollout_steps,
                   .finals = shape.final_capacity,
                   .has_mask = true,
                   .has_state = options.keep_recurrent_state && shape.recurrent_state_count > 0,
                   .compressed = options.compress,
                   .has_post_death_reward = options.post_death_reward.has_value()};
  const int64_t largest_bytes = round_up(ItemOffsets(shape, largest).raw_bytes);
  if (largest_bytes > int64_t{std::numeric_limits<uint32_t>::max()})
    return Error{ErrorCode::kBadInput, "a trajectory of " + bytes_text(largest_bytes) +
                                           " is too large for a replay (4 GB); lower --rollout"};
  if (options.capacity_bytes < largest_bytes)
    return Error{ErrorCode::kBadInput, "a replay of " + bytes_text(options.capacity_bytes) +
                                           " holds not one trajectory of " + bytes_text(largest_bytes) +
                                           "; raise --replay_gb or lower --rollout"};
  const int64_t largest_transitions = int64_t{shape.rollout_steps} * shape.env.num_agents;
  if (options.capacity_transitions != 0 && options.capacity_transitions < largest_transitions)
    return Error{ErrorCode::kBadInput,
                 fmt::format("a replay of {} agent transitions holds not one trajectory of {}",
                             options.capacity_transitions, largest_transitions)};
  COMRAD_TRY_ASSIGN(RingMemory memory, options.file.empty()
                                           ? RingMemory::in_ram(options.capacity_bytes)
                                           : RingMemory::in_file(options.file, options.capacity_bytes));
  return TrajectoryStore(options, std::move(memory));
}

TrajectoryStore::TrajectoryStore(const StoreOptions& options, RingMemory memory)
    : options_(options),
      memory_(std::make_unique<RingMemory>(std::move(memory))),
      all_ones_(static_cast<std::size_t>(options.shape.env.num_agents * options.shape.env.logit_count()), 1) {
}

ItemId TrajectoryStore::append(const SlabView& slab, uint32_t length, const SlabOrigin& origin) {
  prepare(slab, length);
  return commit(slab, origin);
}

void TrajectoryStore::prepare(const SlabView& slab, uint32_t length) {
  const EnvShape &ours = shape().env, &theirs = slab.shape().env;
  COMRAD_CHECK(theirs.num_agents == ours.num_agents && theirs.frame_bytes() == ours.frame_bytes() &&
                   theirs.measurement_count == ours.measurement_count &&
                   theirs.global_state_count == ours.global_state_count &&
                   theirs.head_count == ours.head_count && theirs.logit_count() == ours.logit_count() &&
                   slab.shape().rollout_steps == shape().rollout_steps &&
                   slab.shape().final_capacity == shape().final_capacity &&
                   slab.shape().recurrent_state_count == shape().recurrent_state_count,
               "slab and replay have the same shape");
  pack_item(shape(),
            {.has_state = options_.keep_recurrent_state,
             .compressed = options_.compress,
             .has_post_death_reward = options_.post_death_reward.has_value()},
            slab, length, packed_);
  block_bytes_ = 0;
  if (!options_.compress || packed_.form.length == 0) return;
  const int agents = ours.num_agents, rows = packed_.form.length + 1;
  int64_t index = 0;
  for (int row = 0; row < rows; ++row)
    for (int agent = 0; agent < agents; ++agent) compress_frame(slab.frame(row, agent), index++);
  for (const int32_t row : packed_.final_rows)
    for (int agent = 0; agent < agents; ++agent) compress_frame(slab.final_frame(row, agent), index++);
}

void TrajectoryStore::compress_frame(std::span<const uint8_t> frame, int64_t index) {
  const auto raw = static_cast<int64_t>(frame.size());
  if (static_cast<int64_t>(blocks_.size()) < block_bytes_ + raw)
    blocks_.resize(
        static_cast<std::size_t>(std::max(block_bytes_ + raw, 2 * static_cast<int64_t>(blocks_.size()))));
  std::byte* out = blocks_.data() + block_bytes_;
  // A block must end up smaller than the frame; other frames are stored raw, marked by their size.
  const int size =
      LZ4_compress_default(reinterpret_cast<const char*>(frame.data()), reinterpret_cast<char*>(out),
                           static_cast<int>(raw), static_cast<int>(raw - 1));
  if (size <= 0) std::memcpy(out, frame.data(), frame.size());
  block_bytes_ += size > 0 ? size : raw;
  const auto end = static_cast<uint32_t>(block_bytes_);
  std::memcpy(packed_.head.data() + packed_.offsets.frame_ends + index * 4, &end, sizeof end);
}

ItemId TrajectoryStore::commit(const SlabView& slab, const SlabOrigin& origin) {
  const int32_t length = std::exchange(packed_.form.length, 0);  // an item is committed once
  if (length == 0) return kNoItem;
  ItemForm form = packed_.form;
  form.length = length;
  broken_decisions_ += packed_.broken_decisions;
  std::vector<std::span<const std::byte>> parts = {packed_.head};
  if (form.compressed) {
    parts.push_back({blocks_.data(), static_cast<std::size_t>(block_bytes_)});
  } else {
    const int64_t row_bytes = shape().env.num_agents * shape().env.frame_bytes();
    // Rows lie one behind the other in a slab, agents inside a row.
    parts.push_back(
        frame_bytes_of({slab.frames(0).data(), static_cast<std::size_t>((length + 1) * row_bytes)}));
    for (const int32_t row : packed_.final_rows)
      parts.push_back(frame_bytes_of({slab.final_frame(row, 0).data(), static_cast<std::size_t>(row_bytes)}));
  }
  if (const Status put = put_item(form, parts); !put) {
    if (!write_error_) write_error_ = put.error();
    return kNoItem;
  }
  const ItemId id = end_ - 1;
  if (options_.post_death_reward) {
    for (const PostDeathLedger::Payment& payment :
         ledger_.enter(item(id), id, origin, *options_.post_death_reward)) {
      const Status paid = add_late_reward(payment.item, payment.agent, payment.amount);
      if (!paid && !write_error_) write_error_ = paid.error();
    }
  }
  return id;
}

Status TrajectoryStore::add_late_reward(ItemId id, int agent, double amount) {
  if (!contains(id)) return {};  // evicted meanwhile
  const Slot& slot = slots_[static_cast<std::size_t>(id - oldest())];
  const auto sum = static_cast<float>(item(id).post_death_reward(agent) + amount);
  if (!slot.form.has_post_death_reward || !std::isfinite(sum))
    return {};  // read from a snapshot that has no room for it
  const auto bytes = std::as_bytes(std::span<const float>(&sum, 1));
  return memory_->write(slot.offset + ItemOffsets(shape(), slot.form).post_death_reward + int64_t{agent} * 4,
                        std::array{bytes});
}

StoredTrajectory TrajectoryStore::item(ItemId id) const {
  COMRAD_CHECK(contains(id), "the item is still in the replay");
  const Slot& slot = slots_[static_cast<std::size_t>(id - oldest())];
  return {options_.shape, slot.form, memory_->data() + slot.offset, slot.bytes, all_ones_.data()};
}

void TrajectoryStore::evict_oldest() {
  const Slot& slot = slots_.front();
  transition_count_ -= int64_t{slot.form.length} * shape().env.num_agents;
  used_bytes_ -= round_up(slot.bytes);
  slots_.pop_front();
  if (slots_.empty()) write_offset_ = 0;
}

std::optional<int64_t> TrajectoryStore::take_room(int64_t byte_count, int64_t transitions) {
  const int64_t capacity = options_.capacity_bytes / kSlotAlignmentBytes * kSlotAlignmentBytes;
  if (byte_count > capacity) return std::nullopt;
  while (options_.capacity_transitions > 0 && !slots_.empty() &&
         transition_count_ + transitions > options_.capacity_transitions)
    evict_oldest();
  while (true) {
    if (slots_.empty()) return 0;
    // Free are the bytes from the write position to the oldest item, around the end of the ring. An item is
    // never cut in two: where the rest at the end is too short, it stays unused for one round.
    const int64_t oldest_offset = slots_.front().offset;
    if (write_offset_ > oldest_offset) {
      if (byte_count <= capacity - write_offset_) return write_offset_;
      if (byte_count <= oldest_offset) return 0;
    } else if (byte_count <= oldest_offset - write_offset_) {
      return write_offset_;
    }
    evict_oldest();
  }
}

Status TrajectoryStore::put_item(const ItemForm& form, std::span<const std::span<const std::byte>> parts,
                                 int64_t offset) {
  int64_t byte_count = 0;
  for (const auto& part : parts) byte_count += static_cast<int64_t>(part.size());
  const int64_t transitions = int64_t{form.length} * shape().env.num_agents;
  if (offset < 0) {
    const std::optional<int64_t> room = take_room(round_up(byte_count), transitions);
    if (!room)
      return Error{ErrorCode::kNoSpace, "a replay of " + bytes_text(options_.capacity_bytes) +
                                            " holds not one trajectory of " + bytes_text(byte_count) +
                                            "; raise --replay_gb"};
    offset = *room;
  }
  COMRAD_TRY(memory_->write(offset, parts));
  slots_.push_back({offset, byte_count, form});
  ++end_;
  write_offset_ = offset + round_up(byte_count);
  used_bytes_ += round_up(byte_count);
  transition_count_ += transitions;
  return {};
}

int64_t TrajectoryStore::capacity_transitions() const {
  const int64_t per_item = int64_t{shape().rollout_steps} * shape().env.num_agents;
  int64_t fits = 0;
  if (transition_count_ > 0) {
    fits = static_cast<int64_t>(static_cast<double>(options_.capacity_bytes) /
                                (static_cast<double>(used_bytes_) / static_cast<double>(transition_count_)));
  } else {
    TrajectoryShape kept = shape();
    if (!options_.keep_recurrent_state) kept.recurrent_state_count = 0;
    fits = options_.capacity_bytes / item_bytes(kept, 0, false) * per_item;
  }
  return options_.capacity_transitions > 0 ? std::min(fits, options_.capacity_transitions) : fits;
}

void TrajectoryStore::prefetch(ItemId id) const {
  if (!contains(id)) return;
  const Slot& slot = slots_[static_cast<std::size_t>(id - oldest())];
  memory_->prefetch(slot.offset, slot.bytes);
}

void TrajectoryStore::prefetch_head(ItemId id) const {
  if (!contains(id)) return;
  const Slot& slot = slots_[static_cast<std::size_t>(id - oldest())];
  memory_->prefetch(slot.offset, ItemOffsets(shape(), slot.form).frames);
}

void TrajectoryStore::prefetch_rows(ItemId id, int first, int last, int agent) const {
  if (!contains(id)) return;
  const Slot& slot = slots_[static_cast<std::size_t>(id - oldest())];
  const StoredTrajectory trajectory = item(id);
  if (agent < 0) {
    const auto [offset, byte_count] = trajectory.frame_range(first, last);
    memory_->prefetch(slot.offset + offset, byte_count);
    return;
  }
  for (int row = first; row <= last; ++row) {
    const auto [offset, byte_count] = trajectory.frame_range_of_agent(row, agent);
    memory_->prefetch(slot.offset + offset, byte_count);
  }
}

// -----------------------------------------------------------------------------------------------------
// snapshots

void TrajectoryStore::clear() {
  slots_.clear();
  ledger_.clear();
  write_offset_ = transition_count_ = used_bytes_ = 0;
}

int64_t TrajectoryStore::snapshot_bytes() const {
  return used_bytes_ + (item_count() + 4) * static_cast<int64_t>(sizeof(SectionHeader)) +
         static_cast<int64_t>(sizeof(SnapshotHeader)) + static_cast<int64_t>(ledger_.bytes().size());
}

Status TrajectoryStore::save(const std::string& path) const {
  COMRAD_TRY_ASSIGN(SnapshotWriter writer, SnapshotWriter::create(path, snapshot_bytes()));
  COMRAD_TRY(write(writer));
  return writer.finish();
}

Status TrajectoryStore::write(SnapshotWriter& writer) const {
  SnapshotHeader header = header_of(options_);
  header.write_offset = write_offset_;
  header.item_count = item_count();
  header.end_id = end_;
  header.broken_decisions = broken_decisions_;
  // The ledger of late rewards follows the header in its section.
  std::vector<std::byte> head(sizeof header);
  std::memcpy(head.data(), &header, sizeof header);
  const std::vector<std::byte> ledger = ledger_.bytes();
  head.insert(head.end(), ledger.begin(), ledger.end());
  COMRAD_TRY(writer.write({.tag = static_cast<uint32_t>(SectionTag::kHeader)}, head));
  for (ItemId id = oldest(); id < end_; ++id) {
    const Slot& slot = slots_[static_cast<std::size_t>(id - oldest())];
    COMRAD_TRY(writer.write({.tag = static_cast<uint32_t>(SectionTag::kItem),
                             .flags = flags_of(slot.form),
                             .length = slot.form.length,
                             .finals = slot.form.finals,
                             .id = id,
                             .offset = slot.offset},
                            {memory_->data() + slot.offset, static_cast<std::size_t>(slot.bytes)}));
    if (id + 1 < end_) prefetch(id + 1);
  }
  return {};
}

Status TrajectoryStore::load(const std::string& path) {
  COMRAD_TRY_ASSIGN(SnapshotReader reader, SnapshotReader::open(path));
  Status done = read(reader);
  if (done) {
    std::vector<std::byte> bytes;
    // Sections of the sampler may follow; the store alone has no use for them.
    uint32_t tag = 0;
    while (done && tag != static_cast<uint32_t>(SectionTag::kEnd)) {
      const Expected<SectionHeader> section = reader.next(bytes);
      if (section)
        tag = section->tag;
      else
        done = section.error();
    }
    if (done) done = reader.expect_end();
  }
  if (!done) clear();
  return done;
}

Status TrajectoryStore::read(SnapshotReader& reader) {
  clear();
  Status done = read_items(reader);
  if (!done) clear();
  return done;
}

Status TrajectoryStore::read_items(SnapshotReader& reader) {
  const auto bad = [&reader](const std::string& what) {
    return Error{ErrorCode::kBadFormat, reader.path() + ": replay snapshot is unusable: " + what};
  };
  SnapshotHeader saved;
  if (reader.peek(
          std::as_writable_bytes(std::span(&saved, 1)).first(sizeof saved.magic + sizeof saved.version)) &&
      saved.magic == kSnapshotMagic && saved.version != kSnapshotVersion)
    return bad(
        fmt::format("it has version {}, this program reads version {} alone; remove it, and the run "
                    "continues with an empty replay",
                    saved.version, kSnapshotVersion));
  std::vector<std::byte> bytes;
  COMRAD_TRY_ASSIGN(const SectionHeader first, reader.next(bytes));
  if (first.tag != static_cast<uint32_t>(SectionTag::kHeader) || bytes.size() < sizeof saved.magic + 4)
    return bad("it does not begin with a header");
  std::memcpy(&saved, bytes.data(), std::min(bytes.size(), sizeof saved));
  if (saved.magic != kSnapshotMagic) return bad("it is none of COMRAD's");
  if (bytes.size() < sizeof saved) return bad("its header has a wrong size");
  const std::vector<std::byte> ledger(bytes.begin() + sizeof saved, bytes.end());
  if (const std::string differs = difference(saved, header_of(options_)); !differs.empty())
    return Error{ErrorCode::kBadInput, reader.path() + ": replay snapshot of another shape: " + differs};
  if (saved.item_count < 0 || saved.end_id < saved.item_count ||
      saved.end_id > std::numeric_limits<int64_t>::max() / 4 || saved.broken_decisions < 0)
    return bad("its counts make no sense");

  const int64_t capacity = options_.capacity_bytes / kSlotAlignmentBytes * kSlotAlignmentBytes;
  const bool same_places =
      saved.capacity_bytes == options_.capacity_bytes && (saved.compressed != 0) == options_.compress;
  end_ = saved.end_id - saved.item_count;
  bool wrapped = false;
  for (int64_t index = 0; index < saved.item_count; ++index) {
    COMRAD_TRY_ASSIGN(const SectionHeader section, reader.next(bytes));
    if (section.tag != static_cast<uint32_t>(SectionTag::kItem) || section.id != end_ ||
        section.flags >= 2 * kFlagLate)
      return bad("trajectories are missing or out of order");
    const ItemForm form{.length = section.length,
                        .finals = section.finals,
                        .has_mask = (section.flags & kFlagMask) != 0,
                        .has_state = (section.flags & kFlagState) != 0,
                        .compressed = (section.flags & kFlagCompressed) != 0,
                        .has_post_death_reward = (section.flags & kFlagLate) != 0};
    const bool keeps_state = options_.keep_recurrent_state && shape().recurrent_state_count > 0;
    if (form.has_state != keeps_state || form.compressed != (saved.compressed != 0))
      return bad("a trajectory does not fit the header");
    if (const Status sound = validate_item(shape(), form, bytes.data(), static_cast<int64_t>(bytes.size()));
        !sound)
      return bad(sound.error().message);
    if (!same_places) {
      COMRAD_TRY(adopt(form, bytes, -1));
      continue;
    }
    // Places are taken over only if they are a ring: ascending, around its end at most once,
    // nothing overlapping.
    const int64_t begin = section.offset, byte_count = round_up(static_cast<int64_t>(bytes.size()));
    if (begin < 0 || begin % kSlotAlignmentBytes != 0 || begin > capacity || byte_count > capacity - begin)
      return bad("a trajectory lies outside");
    const int64_t end = begin + byte_count;
    if (!slots_.empty() && begin < write_offset_) {
      if (wrapped || begin != 0) return bad("trajectories overlap");
      wrapped = true;
    }
    if (wrapped && end > slots_.front().offset) return bad("trajectories overlap");
    COMRAD_TRY(adopt(form, bytes, begin));
  }
  if (same_places && !slots_.empty() && saved.write_offset != write_offset_)
    return bad("its write position does not follow its last trajectory");
  while (options_.capacity_transitions > 0 && item_count() > 1 &&
         transition_count_ > options_.capacity_transitions)
    evict_oldest();
  broken_decisions_ = saved.broken_decisions;
  if (!ledger_.restore(ledger, shape().env.num_agents)) return bad("its late rewards make no sense");
  return {};
}

Status TrajectoryStore::adopt(const ItemForm& form, std::span<const std::byte> bytes, int64_t offset) {
  if (form.compressed == options_.compress) return put_item(form, std::array{bytes}, offset);
  // The saver compressed and we do not, or the other way round: the small fields move over, frames are
  // decoded and coded again.
  const StoredTrajectory source(shape(), form, bytes.data(), static_cast<int64_t>(bytes.size()),
                                all_ones_.data());
  const ItemOffsets from(shape(), form);
  packed_.form = form;
  packed_.form.compressed = options_.compress;
  packed_.offsets = ItemOffsets(shape(), packed_.form);
  packed_.head.assign(static_cast<std::size_t>(packed_.offsets.frames), std::byte{0});
  const int64_t floats = from.frame_ends,
                small = from.action_mask - from.action +
                        (form.has_mask
                             ? int64_t{form.length + 1} * shape().env.num_agents * shape().env.logit_count()
                             : 0);
  std::memcpy(packed_.head.data(), bytes.data(), static_cast<std::size_t>(floats));
  std::memcpy(packed_.head.data() + packed_.offsets.action, bytes.data() + from.action,
              static_cast<std::size_t>(small));
  const int agents = shape().env.num_agents;
  std::vector<uint8_t> frame(static_cast<std::size_t>(shape().env.frame_bytes()));
  std::vector<std::byte> raw;
  block_bytes_ = 0;
  int64_t index = 0;
  for (int row = 0; row < form.length + 1 + form.finals; ++row) {
    for (int agent = 0; agent < agents; ++agent) {
      source.copy_frame(row, agent, frame.data());
      if (options_.compress) {
        compress_frame(frame, index++);
      } else {
        const auto as_stored = std::as_bytes(std::span<const uint8_t>(frame));
        raw.insert(raw.end(), as_stored.begin(), as_stored.end());
      }
    }
  }
  const std::span<const std::byte> frames =
      options_.compress ? std::span<const std::byte>(blocks_.data(), static_cast<std::size_t>(block_bytes_))
                        : std::span<const std::byte>(raw);
  const ItemForm stored = std::exchange(packed_.form, {});
  return put_item(stored, std::array<std::span<const std::byte>, 2>{packed_.head, frames}, offset);
}

}  // namespace comrad::replay
