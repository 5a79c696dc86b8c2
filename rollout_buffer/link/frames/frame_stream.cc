#include "rollout_buffer/link/frames/frame_stream.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "rollout_buffer/shm/step_slots.h"

namespace comrad::link {
namespace {

using shm::RequestKind;

// How a step ended, in front of its rewards [N].
struct StepOutcome {
  int32_t final_index = -1;
  uint8_t terminated = 0;
  uint8_t truncated = 0;
  uint8_t padding[2] = {};
};
static_assert(sizeof(StepOutcome) == 8);

bool is_of(const auto& message, RequestKind kind) { return message.kind == static_cast<uint32_t>(kind); }

struct PartBytes {
  std::size_t outcome, frames, measurement, state, mask, active;
  explicit PartBytes(const EnvShape& env) {
    const auto agents = static_cast<std::size_t>(env.num_agents);
    outcome = sizeof(StepOutcome) + agents * sizeof(float);
    frames = agents * static_cast<std::size_t>(env.frame_bytes());
    measurement = agents * static_cast<std::size_t>(env.measurement_count) * sizeof(float);
    state = static_cast<std::size_t>(env.global_state_count) * sizeof(float);
    mask = agents * static_cast<std::size_t>(env.logit_count());
    active = agents;
  }
};

/// Calls `use` with where each part behind a request's outcome lies in a slab, and its size, in the order in which they
/// travel.
template <typename Use>
void visit_parts(const FrameRequest& request, const SlabView& slab, Use use) {
  const EnvShape& env = slab.shape().env;
  const PartBytes parts(env);
  if (request.step > 0)
    use(&slab.reward(static_cast<int>(request.step) - 1, 0),
        static_cast<std::size_t>(env.num_agents) * sizeof(float));
  const bool is_of_final = is_of(request, RequestKind::kFinal);
  const int row = static_cast<int>(is_of_final ? request.final_row : request.step);
  use(is_of_final ? slab.final_frame(row, 0).data() : slab.frames(row).data(), parts.frames);
  if (parts.measurement > 0)
    use(is_of_final ? slab.final_measurement(row, 0).data() : slab.measurement(row, 0).data(),
        parts.measurement);
  if (parts.state > 0)
    use(is_of_final ? slab.final_global_state(row).data() : slab.global_state(row).data(), parts.state);
  if (is_of_final) return;
  use(slab.action_mask(row, 0).data(), parts.mask);
  use(&slab.agent_active(row, 0), parts.active);
}

void append(std::vector<std::byte>& bytes, const void* from, std::size_t count) {
  const auto* begin = static_cast<const std::byte*>(from);
  bytes.insert(bytes.end(), begin, begin + count);
}

Error damaged_frames(const std::string& what) {
  return Error{ErrorCode::kBadFormat, "a batch of frames " + what};
}

}  // namespace

int split_of(const shm::ArenaShape& shape, int env) {
  const int worker = env / shape.envs_per_worker, local = env % shape.envs_per_worker;
  const bool is_second = shape.splits_per_worker > 1 && local >= shape.split_begin(1);
  return worker * shape.splits_per_worker + (is_second ? 1 : 0);
}

std::size_t bytes_of(const FrameRequest& request, const SlabOffsets& offsets) {
  if (request.kind == kSealedKind) return sizeof request;
  const PartBytes parts(offsets.shape.env);
  return sizeof request + (request.step > 0 ? parts.outcome : 0) + parts.frames + parts.measurement +
         parts.state + (is_of(request, RequestKind::kFinal) ? 0 : parts.mask + parts.active);
}

std::size_t largest_request_bytes(const SlabOffsets& offsets) {
  FrameRequest request;
  request.step = 1;
  return bytes_of(request, offsets);
}

void FramePacker::add(const FrameRequest& request, const SlabView& slab) {
  ++count_;
  bytes_.reserve(bytes_.size() + bytes_of(request, offsets_));
  append(bytes_, &request, sizeof request);
  if (request.kind == kSealedKind) return;
  if (request.step > 0) {
    const int last = static_cast<int>(request.step) - 1;
    const StepOutcome outcome{.final_index = slab.final_index(last),
                              .terminated = slab.terminated(last),
                              .truncated = slab.truncated(last)};
    append(bytes_, &outcome, sizeof outcome);
  }
  visit_parts(request, slab, [&](const void* part, std::size_t bytes) { append(bytes_, part, bytes); });
}

Expected<std::optional<FrameRequest>> FrameUnpacker::next() {
  if (left_.empty()) return std::optional<FrameRequest>();
  if (left_.size() < sizeof request_) return damaged_frames("ends inside a request");
  std::memcpy(&request_, left_.data(), sizeof request_);
  const TrajectoryShape& shape = offsets_.shape;
  const auto steps = static_cast<uint32_t>(shape.rollout_steps);
  if (request_.env_index >= env_count_)
    return damaged_frames(
        fmt::format("is of environment {}; the host has {}", request_.env_index, env_count_));
  const bool is_first = request_.step == 0, is_last = request_.step == steps;
  const bool is_possible = request_.step <= steps && request_.kind <= kSealedKind &&
                           !(is_of(request_, RequestKind::kAct) ? is_last : is_first) &&
                           (!is_of(request_, RequestKind::kFinal) ||
                            request_.final_row < static_cast<uint32_t>(shape.final_capacity));
  if (!is_possible)
    return damaged_frames(fmt::format("has a request of kind {} at step {}, which no simulator makes",
                                      request_.kind, request_.step));
  const std::size_t bytes = bytes_of(request_, offsets_);
  if (left_.size() < bytes) return damaged_frames("ends inside a frame");
  body_ = left_.subspan(sizeof request_, bytes - sizeof request_);
  left_ = left_.subspan(bytes);
  COMRAD_TRY(check(body_));
  return std::optional(request_);
}

/// As of a trajectory that comes whole: numbers of observations are judged when the slab is drained.
Status FrameUnpacker::check(std::span<const std::byte> body) const {
  if (request_.step == 0 || request_.kind == kSealedKind) return {};
  StepOutcome outcome;
  std::memcpy(&outcome, body.data(), sizeof outcome);
  if (outcome.final_index < -1 || outcome.final_index >= offsets_.shape.final_capacity ||
      (outcome.truncated != 0 && outcome.final_index < 0))
    return damaged_frames("has a step that ends with an observation that there is not");
  for (int agent = 0; agent < offsets_.shape.env.num_agents; ++agent) {
    float reward = 0;
    std::memcpy(&reward, body.data() + sizeof outcome + static_cast<std::size_t>(agent) * sizeof reward,
                sizeof reward);
    if (!std::isfinite(reward)) return damaged_frames("has a reward that is no number");
  }
  return {};
}

void FrameUnpacker::copy_to(const SlabView& slab) const {
  const std::byte* from = body_.data();
  if (request_.step > 0) {
    const int last = static_cast<int>(request_.step) - 1;
    StepOutcome outcome;
    std::memcpy(&outcome, from, sizeof outcome);
    from += sizeof outcome;
    slab.final_index(last) = outcome.final_index;
    slab.terminated(last) = outcome.terminated != 0;
    slab.truncated(last) = outcome.truncated != 0;
  }
  visit_parts(request_, slab, [&](void* part, std::size_t bytes) {
    std::memcpy(part, from, bytes);
    from += bytes;
  });
}

void add_answer(std::vector<std::byte>& bytes, const FrameAnswer& answer, std::span<const int32_t> choices) {
  append(bytes, &answer, sizeof answer);
  if (is_of(answer, RequestKind::kAct)) append(bytes, choices.data(), choices.size_bytes());
}

Expected<std::optional<FrameAnswer>> take_answer(std::span<const std::byte>& bytes, const EnvShape& shape,
                                                 std::span<int32_t> choices) {
  if (bytes.empty()) return std::optional<FrameAnswer>();
  FrameAnswer answer;
  const auto cut = [] { return Error{ErrorCode::kBadFormat, "a batch of actions ends inside an answer"}; };
  if (bytes.size() < sizeof answer) return cut();
  std::memcpy(&answer, bytes.data(), sizeof answer);
  bytes = bytes.subspan(sizeof answer);
  if (answer.kind > kSealedKind)
    return Error{ErrorCode::kBadFormat, fmt::format("an answer to a request of kind {}", answer.kind)};
  if (!is_of(answer, RequestKind::kAct)) return std::optional(answer);
  if (bytes.size() < choices.size_bytes()) return cut();
  std::memcpy(choices.data(), bytes.data(), choices.size_bytes());
  bytes = bytes.subspan(choices.size_bytes());
  for (std::size_t i = 0; i < choices.size(); ++i) {
    const int32_t size = shape.head_sizes[i % static_cast<std::size_t>(shape.head_count)];
    if (choices[i] < 0 || choices[i] >= size)
      return Error{ErrorCode::kBadFormat, fmt::format("an action of {} for a head of {}", choices[i], size)};
  }
  return std::optional(answer);
}

void CompressionChoice::count(uint64_t decisions, double now_s) {
  constexpr double kWindowS = 0.5;
  constexpr double kWorthIt = 1.05;  // below it the rates are the same; plain frames cost both hosts less
  constexpr int kWindowsBetweenTrials = 60;
  if (began_s_ < 0) began_s_ = now_s;
  decisions_ += decisions;
  if (now_s - began_s_ < kWindowS) return;
  rates_[is_compressed_] = static_cast<double>(decisions_) / (now_s - began_s_);
  decisions_ = 0;
  began_s_ = now_s;
  if (is_trial_ && rates_[!is_compressed_] == 0) {  // the other one has never been tried
    is_compressed_ = !is_compressed_;
    return;
  }
  if (is_trial_) {
    is_trial_ = false;
    windows_ = 0;
    choice_ = rates_[true] > kWorthIt * rates_[false];
  } else if (++windows_ >= kWindowsBetweenTrials) {
    is_trial_ = true;
    is_compressed_ = !choice_;
    return;
  }
  is_compressed_ = choice_;
}

void LatencyCounts::add(double us) {
  const double bucket = us <= 1 ? 0 : 8 * std::log2(us);
  ++counts_[std::min(kBuckets - 1, static_cast<std::size_t>(bucket))];
  ++all_;
}

double LatencyCounts::quantile_us(double share) const {
  uint64_t seen = 0;
  for (std::size_t bucket = 0; bucket < kBuckets; ++bucket) {
    seen += counts_[bucket];
    if (seen > 0 && static_cast<double>(seen) >= share * static_cast<double>(all_))
      return std::exp2(static_cast<double>(bucket + 1) / 8);
  }
  return 0;
}

}  // namespace comrad::link
