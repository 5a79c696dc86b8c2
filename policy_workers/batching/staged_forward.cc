#include "policy_workers/batching/staged_forward.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "policy_workers/device/tensor_layout.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {
namespace {

constexpr int64_t kRowsPackedAtATime = 32;  // 0.9 MB, some 0.1 ms of one core: worth waking another one

}  // namespace

int64_t bucket_of(int64_t worlds) {
  if (worlds <= 2) return worlds;
  int64_t size = 2;
  while (size < worlds) size = size % 3 == 0 ? size / 3 * 4 : size / 2 * 3;
  return size;
}

StagedForward::StagedForward(const ActorCritic& policy, const shm::ArenaShape& shape, int packing_threads,
                             SlabFrames* frames)
    : policy_(policy),
      env_(shape.trajectory.env),
      state_count_(shape.trajectory.recurrent_state_count),
      zero_row_(int64_t{shape.env_count()} * env_.num_agents),
      idle_row_(zero_row_ + 1),
      frames_(frames),
      states_(torch::zeros({idle_row_ + 1, state_count_}, torch::TensorOptions().device(policy.device()))),
      held_(static_cast<size_t>(shape.env_count())),
      packers_(packing_threads) {}

StagedForward::Bucket& StagedForward::bucket_for(int64_t worlds) {
  const int64_t size = bucket_of(worlds);
  if (const auto made = std::ranges::find(buckets_, size, &Bucket::worlds); made != buckets_.end())
    return *made;
  const torch::Device device = policy_.device();
  const int64_t rows = size * env_.num_agents;
  device::TensorLayout layout;
  std::vector<std::pair<Tensor Bucket::*, std::size_t>> fields;
  const auto add = [&](Tensor Bucket::*field, at::IntArrayRef sizes, torch::ScalarType type) {
    fields.emplace_back(field, layout.add(sizes, type));
  };
  if (frames_ == nullptr) add(&Bucket::frame, {rows, env_.channels, env_.height, env_.width}, torch::kUInt8);
  if (env_.measurement_count > 0) add(&Bucket::measurement, {rows, env_.measurement_count}, torch::kFloat32);
  if (env_.global_state_count > 0)
    add(&Bucket::global_state, {size, env_.global_state_count}, torch::kFloat32);
  add(&Bucket::read, {rows}, torch::kInt64);
  add(&Bucket::write, {rows}, torch::kInt64);
  if (frames_ != nullptr) {
    add(&Bucket::from, {rows}, torch::kInt64);
    add(&Bucket::to, {rows}, torch::kInt64);
  }
  Bucket bucket;
  bucket.worlds = size;
  bucket.staging = device::host_memory({layout.bytes()}, torch::kUInt8, device).zero_();
  bucket.there = bucket.staging.to(device);  // on a CPU the same memory
  for (const auto& [field, index] : fields) bucket.*field = layout.view(bucket.there, index);
  const int64_t width = env_.logit_count() + 1 + state_count_;
  bucket.answer_there = torch::zeros({rows, width}, torch::TensorOptions().device(device));
  bucket.answer =
      device.is_cpu() ? bucket.answer_there : device::host_memory({rows, width}, torch::kFloat32, device);
  buckets_.push_back(std::move(bucket));
  Bucket& made = buckets_.back();
  // The recording reads and writes idle rows: nothing was packed yet.
  pack({}, made);
  if (!device.is_cpu()) made.there.copy_(made.staging);
  // Buckets move when another is made; their tensors do not.
  (void)made.graph.record(device,
                          [this, size] { forward(*std::ranges::find(buckets_, size, &Bucket::worlds)); });
  return made;
}

void StagedForward::forward(Bucket& bucket) {
  torch::NoGradGuard no_grad;
  const KeptFactors::Scope kept(factors_);
  const int64_t logits = env_.logit_count();
  const Tensor frame = frames_ == nullptr ? bucket.frame : frames_->take(bucket.from, bucket.to);
  const PolicyOutput output =
      policy_.step(frame, bucket.measurement, states_.index_select(0, bucket.read), bucket.global_state);
  bucket.answer_there.narrow(1, 0, logits).copy_(output.logits);
  bucket.answer_there.select(1, logits).copy_(output.value.reshape({-1}));
  if (state_count_ == 0) return;
  bucket.answer_there.narrow(1, logits + 1, state_count_).copy_(output.recurrent_state);
  states_.index_copy_(0, bucket.write, output.recurrent_state);
}

PolicyOutput StagedForward::step(const Batch& batch, StageClock* clock) {
  torch::NoGradGuard no_grad;
  const torch::Device device = policy_.device();
  Bucket& bucket = bucket_for(static_cast<int64_t>(batch.requests.size()));
  bring_up(batch);
  pack(batch, bucket);
  if (clock != nullptr) clock->end(Stage::kPack);
  if (!device.is_cpu()) bucket.there.copy_(bucket.staging, /*non_blocking=*/true);
  factors_.refresh();
  bucket.graph.replay();
  if (!device.is_cpu()) {
    bucket.answer.copy_(bucket.answer_there, /*non_blocking=*/true);
    device::Event arrived;
    arrived.record(device::Stream::current(device));
    arrived.wait();
  }
  for (const Request& request : batch.requests) {
    if (request.kind == shm::RequestKind::kAct)
      held_[static_cast<size_t>(request.env_index)] = request.step_id + 1;
    if (frames_ != nullptr) frames_->note_taken(request);
  }
  const Tensor answer = bucket.answer.narrow(0, 0, batch.row_count());
  const int64_t logits = env_.logit_count();
  return {answer.narrow(1, 0, logits), answer.select(1, logits), answer.narrow(1, logits + 1, state_count_)};
}

/// States that the device does not hold, from the batch.
void StagedForward::bring_up(const Batch& batch) {
  if (state_count_ == 0) return;
  std::vector<int64_t> from, to;
  for (size_t index = 0; index < batch.requests.size(); ++index) {
    const Request& request = batch.requests[index];
    std::optional<uint64_t>& held = held_[static_cast<size_t>(request.env_index)];
    if (request.reset_state || held == request.step_id) continue;
    for (int64_t agent = 0; agent < env_.num_agents; ++agent) {
      from.push_back(static_cast<int64_t>(index) * env_.num_agents + agent);
      to.push_back(int64_t{request.env_index} * env_.num_agents + agent);
    }
    held = request.step_id;
  }
  if (from.empty()) return;
  states_brought_up_ += static_cast<int64_t>(from.size());
  const Tensor rows = batch.recurrent_state.index_select(0, torch::tensor(from, torch::kInt64));
  states_.index_copy_(0, torch::tensor(to, torch::kInt64).to(states_.device()), rows.to(states_.device()));
}

void StagedForward::pack(const Batch& batch, Bucket& bucket) {
  uint8_t* bytes = bucket.staging.data_ptr<uint8_t>();
  const auto at = [&](const Tensor& field) {
    return bytes + (field.storage_offset() * static_cast<int64_t>(field.element_size()));
  };
  if (batch.measurement.defined() && bucket.measurement.defined())
    std::memcpy(at(bucket.measurement), batch.measurement.data_ptr<float>(), batch.measurement.nbytes());
  if (batch.global_state.defined() && bucket.global_state.defined())
    std::memcpy(at(bucket.global_state), batch.global_state.data_ptr<float>(), batch.global_state.nbytes());
  const auto indices = [&](const Tensor& field, int64_t idle) {
    auto* first = reinterpret_cast<int64_t*>(at(field));
    std::fill_n(first, field.numel(), idle);
    return first;
  };
  int64_t* read = indices(bucket.read, zero_row_);
  int64_t* write = indices(bucket.write, idle_row_);
  for (const Request& request : batch.requests)
    for (int agent = 0; agent < env_.num_agents; ++agent, ++read, ++write) {
      const int64_t row = int64_t{request.env_index} * env_.num_agents + agent;
      if (!request.reset_state) *read = row;
      if (request.kind == shm::RequestKind::kAct) *write = row;
    }
  if (frames_ == nullptr) {
    pack_frames(batch, at(bucket.frame));
    return;
  }
  int64_t* from = indices(bucket.from, frames_->idle_place().from);
  int64_t* to = indices(bucket.to, frames_->idle_place().to);
  for (const Request& request : batch.requests)
    for (int agent = 0; agent < env_.num_agents; ++agent) {
      const SlabFrames::Place place = frames_->place_of(request, agent);
      *from++ = place.from;
      *to++ = place.to;
    }
}

void StagedForward::pack_frames(const Batch& batch, uint8_t* to) {
  const auto frame_bytes = static_cast<size_t>(env_.frame_bytes());
  const auto pack_rows = [&](int64_t part) {
    const auto first = static_cast<size_t>(part * kRowsPackedAtATime);
    const size_t last = std::min(batch.frames.size(), first + static_cast<size_t>(kRowsPackedAtATime));
    for (size_t row = first; row < last; ++row)
      std::memcpy(to + row * frame_bytes, batch.frames[row], frame_bytes);
  };
  packers_.run((batch.row_count() + kRowsPackedAtATime - 1) / kRowsPackedAtATime, pack_rows, nullptr);
  count_copied(batch.frames.size() * frame_bytes);
}

}  // namespace comrad::policy
