#include "rollout_buffer/link/trajectories/slab_stream.h"

#include <spdlog/fmt/fmt.h>

#include <lz4.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/schema/slab_check.h"

namespace comrad::link {
namespace {

static_assert(LZ4_COMPRESSBOUND(dds::kFragmentBytes) <= dds::kFragmentPayloadBytes,
              "the bound in comrad.idl holds what does not compress");

Error damaged_slabs(const std::string& what) {
  return Error{ErrorCode::kBadFormat, "a trajectory's fragment " + what};
}

}  // namespace

Hole hole_of(const SlabOffsets& offsets, int finals) {
  const int64_t row = offsets.shape.env.num_agents * offsets.shape.env.frame_bytes();
  return {offsets.final_frame + finals * row, offsets.final_frame + offsets.shape.final_capacity * row};
}

void SlabCutter::begin(const SlabView& slab, const shm::SlabHeader& header,
                       const dds::TrajectoryFragment& name) {
  base_ = slab.at<std::byte>(0);
  name_ = name;
  name_.env_index = header.env_index;
  name_.length = header.length;
  name_.rollout_index = header.rollout_index;
  name_.layout_id = header.layout_id;
  name_.first_episode_id = header.first_episode.episode_id;
  name_.first_episode_seed = header.first_episode.episode_seed;
  const int steps = static_cast<int>(std::min<int64_t>(header.length, offsets_.shape.rollout_steps));
  int finals = 0;
  for (int step = 0; step < steps; ++step) finals = std::max(finals, slab.final_index(step) + 1);
  finals = std::min(finals, offsets_.shape.final_capacity);
  pieces_.clear();
  const Hole hole = hole_of(offsets_, finals);
  const auto add = [this](int64_t begin, int64_t end) {
    for (; begin < end; begin += pieces_.back().bytes)
      pieces_.push_back({begin, std::min<int64_t>(end - begin, dds::kFragmentBytes)});
  };
  add(0, hole.begin);
  add(hole.end, offsets_.slab_bytes);
  payload_.resize(dds::kFragmentPayloadBytes);
}

dds::TrajectoryFragment SlabCutter::cut(uint32_t index) {
  const Piece& piece = pieces_[index];
  dds::TrajectoryFragment fragment = name_;
  fragment.fragment_index = index;
  fragment.fragment_count = fragment_count();
  fragment.offset_bytes = static_cast<uint64_t>(piece.offset_bytes);
  fragment.raw_bytes = static_cast<uint32_t>(piece.bytes);
  const std::span raw(base_ + piece.offset_bytes, static_cast<std::size_t>(piece.bytes));
  fragment.checksum = checksum64(raw);
  const int bytes = LZ4_compress_default(reinterpret_cast<const char*>(raw.data()),
                                         reinterpret_cast<char*>(payload_.data()),
                                         static_cast<int>(raw.size()), static_cast<int>(payload_.size()));
  COMRAD_CHECK(bytes > 0, "a fragment fits its payload however it compresses");
  fragment.payload = {payload_.data(), static_cast<std::size_t>(bytes)};
  return fragment;
}

void SlabAssembler::begin(const SlabView& slab) {
  base_ = slab.at<std::byte>(0);
  next_index_ = fragment_count_ = 0;
  position_ = 0;
  finals_ = offsets_.shape.final_capacity;
}

Expected<bool> SlabAssembler::take(const dds::TrajectoryFragment& fragment) {
  COMRAD_CHECK(base_ != nullptr, "a slab was begun");
  COMRAD_TRY(place(fragment));
  if (next_index_ < fragment_count_) return false;
  if (position_ != offsets_.slab_bytes)
    return damaged_slabs(
        fmt::format("is the last, and {} bytes are missing", offsets_.slab_bytes - position_));
  COMRAD_TRY(check(fragment.length));
  return true;
}

Status SlabAssembler::place(const dds::TrajectoryFragment& fragment) {
  if (next_index_ == 0) fragment_count_ = fragment.fragment_count;
  if (fragment.fragment_index != next_index_ || fragment.fragment_count != fragment_count_)
    return damaged_slabs(fmt::format("{} of {} came where {} of {} was due", fragment.fragment_index,
                                     fragment.fragment_count, next_index_, fragment_count_));
  if (fragment.raw_bytes == 0 || fragment.raw_bytes > dds::kFragmentBytes ||
      fragment.payload.size() > dds::kFragmentPayloadBytes ||
      fragment.offset_bytes > static_cast<uint64_t>(offsets_.slab_bytes) ||
      fragment.raw_bytes > static_cast<uint64_t>(offsets_.slab_bytes) - fragment.offset_bytes)
    return damaged_slabs(fmt::format("of {} bytes at {} lies outside of a slab of {}", fragment.raw_bytes,
                                     fragment.offset_bytes, offsets_.slab_bytes));
  const auto offset = static_cast<int64_t>(fragment.offset_bytes);
  if (offset != position_) {
    // Only final observations may be left out, whole ones and the last.
    const Hole all = hole_of(offsets_, 0);
    const int64_t row = (all.end - all.begin) / offsets_.shape.final_capacity;
    if (offset != all.end || position_ < all.begin || position_ >= all.end ||
        (position_ - all.begin) % row != 0)
      return damaged_slabs(fmt::format("begins at {} where {} was due", offset, position_));
    finals_ = static_cast<int>((position_ - all.begin) / row);
    std::memset(base_ + position_, 0, static_cast<std::size_t>(offset - position_));
  }
  const int bytes = LZ4_decompress_safe(
      reinterpret_cast<const char*>(fragment.payload.data()), reinterpret_cast<char*>(base_ + offset),
      static_cast<int>(fragment.payload.size()), static_cast<int>(fragment.raw_bytes));
  if (bytes != static_cast<int>(fragment.raw_bytes)) return damaged_slabs("does not decompress");
  if (checksum64({base_ + offset, fragment.raw_bytes}) != fragment.checksum)
    return damaged_slabs("has another checksum");
  position_ = offset + fragment.raw_bytes;
  ++next_index_;
  return {};
}

/// Numbers are judged decision by decision when the slab is drained, as those of this host are; here it must be a slab
/// at all.
Status SlabAssembler::check(uint32_t length) const {
  const SlabView slab(offsets_, base_);
  const TrajectoryShape& shape = offsets_.shape;
  if (length < 1 || length > static_cast<uint32_t>(shape.rollout_steps))
    return Error{ErrorCode::kBadFormat,
                 fmt::format("a trajectory of {} decisions; 1 to {}", length, shape.rollout_steps)};
  for (int step = 0; step < static_cast<int>(length); ++step) {
    const std::string where = fmt::format("a trajectory's step {}", step);
    if (!take_end(slab, step).is_sound || slab.final_index(step) >= finals_)
      return Error{ErrorCode::kBadFormat, where + " ends with an observation that did not come"};
    for (int agent = 0; agent < shape.env.num_agents; ++agent) {
      std::array<int64_t, kMaxHeads> choices{};
      if (!take_action(shape.env, slab.action(step, agent), choices.data()))
        return Error{ErrorCode::kBadFormat, fmt::format("{}: agent {} chose what no head has", where, agent)};
      if (!std::isfinite(slab.reward(step, agent)))
        return Error{ErrorCode::kBadFormat, where + ": the reward is no number"};
    }
  }
  for (int step = static_cast<int>(length); step < shape.rollout_steps; ++step) slab.valid(step) = 0;
  return {};
}

}  // namespace comrad::link
