#include "policy_workers/batching/slab_frames.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "policy_workers/device/queue.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::policy {
namespace {

constexpr int64_t kShareOfDevice = 4;  ///< one part of so many of its memory

/// Integers that a device moves at once: eight times as fast as bytes.
torch::ScalarType largest_word(int64_t bytes) {
  return bytes % 8 == 0   ? torch::kInt64
         : bytes % 4 == 0 ? torch::kInt32
         : bytes % 2 == 0 ? torch::kInt16
                          : torch::kUInt8;
}

}  // namespace

int64_t SlabFrames::bytes_of(const shm::ArenaShape& shape) {
  const TrajectoryShape& trajectory = shape.trajectory;
  return int64_t{shape.slab_count} * trajectory.rollout_steps * trajectory.env.num_agents *
         trajectory.env.frame_bytes();
}

Status SlabFrames::check_room(const shm::ArenaShape& shape, int64_t device_bytes) {
  const int64_t share = device_bytes / kShareOfDevice;
  if (bytes_of(shape) <= share) return {};
  return Error{ErrorCode::kNoSpace,
               fmt::format("the frames of {} trajectory slabs take {}, and a quarter of the GPU is {}; "
                           "lower --trajectory_slabs",
                           shape.slab_count, bytes_text(bytes_of(shape)), bytes_text(share))};
}

Expected<std::unique_ptr<SlabFrames>> SlabFrames::create(const shm::Arena& arena, torch::Device device,
                                                         bool keeps_frames) {
  if (keeps_frames && !device.is_cpu())
    COMRAD_TRY(check_room(arena.shape(), device::memory_of(device).total_bytes));
  COMRAD_TRY_ASSIGN(device::MappedMemory memory, device::MappedMemory::create(arena.bytes(), device));
  return std::unique_ptr<SlabFrames>(new SlabFrames(arena, std::move(memory), keeps_frames));
}

SlabFrames::SlabFrames(const shm::Arena& arena, device::MappedMemory memory, bool keeps_frames)
    : arena_(arena),
      env_(arena.shape().trajectory.env),
      steps_(arena.shape().trajectory.rollout_steps),
      slabs_(arena.shape().slab_count),
      idle_row_(steps_ * slabs_ * env_.num_agents),
      memory_(std::move(memory)),
      word_(largest_word(env_.frame_bytes())),
      words_of_frame_(env_.frame_bytes() / static_cast<int64_t>(c10::elementSize(word_))),
      words_(memory_.bytes().view(word_)),
      frames_(words_.as_strided({words_.numel() - words_of_frame_ + 1, words_of_frame_}, {1, 1})) {
  if (!keeps_frames) return;
  copies_ = torch::zeros({idle_row_ + 1, words_of_frame_}, words_.options());
  held_.resize(static_cast<std::size_t>(slabs_ * steps_));
}

int64_t SlabFrames::words_to(const void* place) const {
  const auto bytes = static_cast<const std::byte*>(place) - arena_.bytes().data();
  return bytes / static_cast<int64_t>(c10::elementSize(word_));
}

SlabFrames::Rollout SlabFrames::rollout_of(uint32_t slab_index) const {
  const shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slab_index));
  return {.env_index = header.env_index, .rollout_index = header.rollout_index};
}

SlabFrames::Place SlabFrames::place_of(const Request& request, int agent) const {
  const SlabView slab = arena_.slabs().view(static_cast<int>(request.slab_index));
  if (request.kind == shm::RequestKind::kFinal)
    return {.from = words_to(slab.final_frame(request.final_row, agent).data()), .to = idle_row_};
  const int64_t row = (request.step * slabs_ + request.slab_index) * env_.num_agents + agent;
  return {.from = words_to(slab.frame(request.step, agent).data()),
          .to = request.kind == shm::RequestKind::kAct ? row : idle_row_};
}

Tensor SlabFrames::take(const Tensor& from, const Tensor& to) const {
  const Tensor taken = frames_.index_select(0, from);
  if (copies_.defined()) copies_.index_copy_(0, to, taken);
  return taken.view(torch::kUInt8).view({from.numel(), env_.channels, env_.height, env_.width});
}

void SlabFrames::note_taken(const Request& request) {
  if (held_.empty() || request.kind != shm::RequestKind::kAct) return;
  held_[static_cast<std::size_t>(request.slab_index * steps_ + request.step)] =
      rollout_of(request.slab_index);
}

void SlabFrames::copy_slab(const Tensor& frame, int64_t position, uint32_t slab_index,
                           uint32_t length) const {
  const torch::NoGradGuard no_grad;
  COMRAD_CHECK(copies_.defined(), "frames are kept");
  const int64_t agents = env_.num_agents, filled = std::min<int64_t>(length, steps_);
  const Tensor rows = frame.view({steps_, frame.size(1), env_.frame_bytes()})
                          .view(word_)
                          .narrow(1, position * agents, agents);
  const auto first = held_.begin() + static_cast<std::ptrdiff_t>(slab_index * steps_);
  const bool is_there =
      std::all_of(first, first + static_cast<std::ptrdiff_t>(filled),
                  [rollout = rollout_of(slab_index)](const Rollout& held) { return held == rollout; });
  const Tensor all =
      is_there ? copies_.narrow(0, 0, idle_row_)
                     .view({steps_, slabs_, agents, words_of_frame_})
                     .select(1, slab_index)
               : words_
                     .narrow(0, words_to(arena_.slabs().view(static_cast<int>(slab_index)).frames(0).data()),
                             steps_ * agents * words_of_frame_)
                     .view({steps_, agents, words_of_frame_});
  rows.narrow(0, 0, filled).copy_(all.narrow(0, 0, filled));
  if (filled < steps_) rows.narrow(0, filled, steps_ - filled).zero_();
}

}  // namespace comrad::policy
