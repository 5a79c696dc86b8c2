#include "rollout_buffer/link/frames/frame_sender.h"

#include <spdlog/fmt/fmt.h>

#include <lz4.h>

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/session/timing.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {

using shm::RequestKind;
using shm::SlotState;

FrameSender::FrameSender(const shm::Arena& arena, dds::LinkBus bus, const FrameSenderOptions& options,
                         const Clock& clock)
    : SendingEnd(arena, std::move(bus), options, clock),
      compression_(options.compression),
      batch_bytes_(options.batch_bytes),
      packer_(arena.slabs().offsets()),
      choices_(static_cast<std::size_t>(arena.shape().trajectory.env.num_agents *
                                        arena.shape().trajectory.env.head_count)),
      pending_(static_cast<std::size_t>(arena.shape().env_count())),
      is_split_acted_(
          static_cast<std::size_t>(arena.shape().sim_worker_count * arena.shape().splits_per_worker)) {}

Status FrameSender::begin() {
  if (const std::size_t largest = largest_request_bytes(arena_.slabs().offsets());
      largest > dds::kFrameBatchBytes)
    return Error{ErrorCode::kBadInput,
                 fmt::format("the observations of one environment take {} bytes, more than the frame link "
                             "carries at once ({}); give this host its own policy workers",
                             largest, dds::kFrameBatchBytes)};
  shm::WorkerCounters& counters = arena_.policy_counters(0);
  counters.begin_life();
  if (const int orphans = arena_.reclaim_policy_worker(0); orphans > 0)
    spdlog::warn("{} requests of this worker's predecessor are sent again", orphans);
  COMRAD_TRY(SendingEnd::begin());
  counters.state = shm::WorkerState::kRunning;
  take_actions();  // the reader is there before the other end is asked
  return {};
}

Status FrameSender::turn() {
  heard_ready_ = shm::listen(arena_.step_slots().ready(0));
  has_moved_ = take_actions();
  drain();
  has_moved_ |= send_ready();
  if (const double now_s = clock_.now_s(); now_s - looked_s_ > 0.1) looked_s_ = now_s, resend_due();
  return {};
}

void FrameSender::wait() {
  if (has_moved_) return;
  if (out_count_ == static_cast<int>(pending_.size()))
    bus_.wait(kWaitMs);
  else
    shm::wait(arena_.step_slots().ready(0), heard_ready_, out_count_ > 0 ? kPollUs : 1000);
}

void FrameSender::deliver() {
  take_actions();
  drain();
  resend_due();
  if (send_sealed()) send_batch();
}

Status FrameSender::say_hello(bool is_leaving) {
  if (is_leaving) arena_.policy_counters(0).state = shm::WorkerState::kStopped;
  return bus_.write(
      dds::FrameBatch{.hello = session_.hello(clock_.now_s(), is_leaving), .batch_index = batch_index_});
}

FrameRequest FrameSender::request_of(const shm::StepSlot& slot, int env) const {
  const shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slot.slab_index));
  return {.step_id = slot.step_id,
          .episode_id = slot.episode_id,
          .rollout_index = header.rollout_index,
          .layout_id = header.layout_id,
          .first_episode_id = header.first_episode.episode_id,
          .first_episode_seed = header.first_episode.episode_seed,
          .env_index = static_cast<uint32_t>(env),
          .kind = static_cast<uint32_t>(slot.kind),
          .step = slot.step,
          .final_row = slot.final_row,
          .episode_step = slot.episode_step,
          .reset_state = slot.reset_state};
}

/// A first row begins a trajectory on the other end, which limits how many it has room for.
bool FrameSender::may_begin(const shm::StepSlot& slot) const {
  return slot.step > 0 || slot.kind != RequestKind::kAct || session_.has_credit(begun_);
}

bool FrameSender::send_ready() {
  const shm::ArenaShape& shape = arena_.shape();
  bool has_sent = send_sealed();  // first: the next rollout of an environment follows
  for (int env = 0; env < shape.env_count(); ++env) {
    shm::StepSlot& slot = arena_.step_slots().slot(env);
    if (slot.state.load(std::memory_order_acquire) != SlotState::kReady || !may_begin(slot)) continue;
    // Simulators of this host are ours, but a wild one must not make this process read outside of the slab.
    if (slot.slab_index >= static_cast<uint32_t>(shape.slab_count) ||
        slot.step > static_cast<uint32_t>(shape.trajectory.rollout_steps) ||
        slot.final_row >= static_cast<uint32_t>(std::max(1, shape.trajectory.final_capacity)) ||
        slot.kind > RequestKind::kFinal)
      continue;
    if (!shm::advance(slot, SlotState::kReady, SlotState::kInBatch)) continue;
    Pending& pending = pending_[static_cast<std::size_t>(env)];
    // A new simulator may ask in place of a dead one, even the same.
    const FrameRequest request = request_of(slot, env);
    const bool is_again = pending.is_out && is_same(request, pending.request);
    out_count_ += !std::exchange(pending.is_out, true);
    pending.request = request;
    pending.slab = slot.slab_index;
    begun_ += request.step == 0 && !is_again;
    const SlabView slab = arena_.slabs().view(static_cast<int>(pending.slab));
    make_room(pending.request);
    packer_.add(pending.request, slab);
    packed_.push_back(env);
    has_sent = true;
  }
  if (packer_.count() > 0) send_batch();
  return has_sent;
}

void FrameSender::make_room(const FrameRequest& request) {
  if (packer_.count() > 0 &&
      packer_.bytes().size() + bytes_of(request, arena_.slabs().offsets()) > batch_bytes_)
    send_batch();
}

/// What cannot be written now is sent by resend_due().
bool FrameSender::send_batch() {
  dds::FrameBatch batch{.hello = session_.hello(clock_.now_s()), .batch_index = batch_index_};
  batch.request_count = packer_.count();
  batch.raw_bytes = static_cast<uint32_t>(packer_.bytes().size());
  batch.checksum = checksum64(packer_.bytes());
  batch.payload = packer_.bytes();
  batch.is_compressed =
      compression_ == Compression::kAlways || (compression_ == Compression::kAuto && choice_.is_compressed());
  if (batch.is_compressed) {
    compressed_.resize(static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(batch.raw_bytes))));
    const int bytes = LZ4_compress_default(
        reinterpret_cast<const char*>(batch.payload.data()), reinterpret_cast<char*>(compressed_.data()),
        static_cast<int>(batch.raw_bytes), static_cast<int>(compressed_.size()));
    batch.is_compressed = bytes > 0 && bytes < static_cast<int>(batch.raw_bytes);
    if (batch.is_compressed) batch.payload = {compressed_.data(), static_cast<std::size_t>(bytes)};
  }
  const double now_s = clock_.now_s();
  const Status written = bus_.write(batch);
  if (written) {
    ++batch_index_;
    account_.raw_bytes += batch.raw_bytes;
    account_.sent_bytes += batch.payload.size();
    account_.is_compressed = batch.is_compressed != 0;
  } else if (written.error().code != ErrorCode::kTimeout) {
    spdlog::warn("{}", written.error().message);
  }
  for (const int env : packed_) {
    Pending& pending = pending_[static_cast<std::size_t>(env)];
    pending.sent_s = written ? now_s : now_s - resend_after_s_;
  }
  has_failed_ |= !written;
  packer_.clear();
  packed_.clear();
  return written.has_value();
}

void FrameSender::resend_due() {
  const double now_s = clock_.now_s();
  const bool is_silent = session_.silent_s(now_s) > 2 * resend_after_s_;
  std::size_t bytes = 0;
  if (std::exchange(has_failed_, false)) in_hand_.resend_all();
  if (in_hand_.resend_if_stuck(now_s, resend_after_s_)) resent_ += in_hand_.size();
  send_sealed();
  for (std::size_t env = 0; env < pending_.size(); ++env) {
    Pending& pending = pending_[env];
    if (!pending.is_out || now_s - pending.sent_s < resend_after_s_) continue;
    if (arena_.step_slots().slot(static_cast<int>(env)).state.load(std::memory_order_acquire) !=
        SlotState::kInBatch) {
      pending.is_out = false;  // its simulator died
      --out_count_;
      continue;
    }
    packer_.add(pending.request, arena_.slabs().view(static_cast<int>(pending.slab)));
    packed_.push_back(static_cast<int>(env));
    ++resent_;
    bytes = packer_.bytes().size();
    if (bytes > batch_bytes_ / 2 && (!send_batch() || is_silent)) return;  // a dead link gets one batch
  }
  if (packer_.count() > 0) send_batch();
}

bool FrameSender::take_actions() {
  bool has_moved = false;
  bus_.take<dds::ActionBatch>([&](const dds::ActionBatch& batch) {
    if (hear(batch.state)) has_moved |= take_answers(batch.payload);
  });
  return has_moved;
}

/// The other end has given this host other places: it has no record of earlier requests, and counts from 0.
void FrameSender::renew() {
  begun_ = batch_index_ = 0;
  for (Pending& pending : pending_) {
    if (!pending.is_out) continue;
    begun_ += pending.request.step == 0;
    pending.sent_s = 0;
  }
}

bool FrameSender::take_answers(std::span<const std::byte> payload) {
  const shm::ArenaShape& shape = arena_.shape();
  const double now_s = clock_.now_s();
  const auto agents = static_cast<uint64_t>(shape.trajectory.env.num_agents);
  uint64_t decisions = 0;
  bool has_moved = false;
  is_split_acted_.assign(is_split_acted_.size(), false);
  while (true) {
    const Expected<std::optional<FrameAnswer>> taken = take_answer(payload, shape.trajectory.env, choices_);
    if (!taken) {
      if (++account_.refused == 1) spdlog::warn("the other end sent {}", taken.error().message);
      break;
    }
    if (!*taken) break;
    const FrameAnswer& answer = **taken;
    if (answer.kind == kSealedKind) {
      take_sealed(answer);
      continue;
    }
    Pending* pending = answer.env_index < pending_.size() ? &pending_[answer.env_index] : nullptr;
    if (pending == nullptr || !pending->is_out || !is_same(pending->request, answer)) {
      ++account_.duplicates;
      continue;
    }
    const int env = static_cast<int>(answer.env_index);
    shm::StepSlot& slot = arena_.step_slots().slot(env);
    pending->is_out = false;
    --out_count_;
    if (answer.kind == static_cast<uint32_t>(RequestKind::kAct)) {
      const SlabView slab = arena_.slabs().view(static_cast<int>(pending->slab));
      std::ranges::copy(choices_, slab.action(static_cast<int>(answer.step), 0).data());
      decisions += agents;
    }
    if (pending->sent_s > 0) latency_.add((now_s - pending->sent_s) * 1e6);
    if (!shm::advance(slot, SlotState::kInBatch, SlotState::kActed)) continue;  // its simulator died
    has_moved = true;
    is_split_acted_[static_cast<std::size_t>(split_of(shape, env))] = true;
  }
  for (std::size_t place = 0; place < is_split_acted_.size(); ++place)
    if (is_split_acted_[place])
      shm::ring(arena_.step_slots().acted(static_cast<int>(place) / shape.splits_per_worker,
                                          static_cast<int>(place) % shape.splits_per_worker));
  account_.decisions += decisions;
  arena_.policy_counters(0).decisions.fetch_add(decisions, std::memory_order_relaxed);
  if (compression_ == Compression::kAuto) choice_.count(decisions, now_s);
  return has_moved;
}

void FrameSender::drain() {
  for (const uint32_t slab : arena_.slabs().drain(arena_.shape().slab_count)) in_hand_.add(slab);
  for (Outbox::Item& item : in_hand_)
    if (decisions_of(item.slab) == 0) item.is_done = item.is_delivered = true;
  give_back_done();
}

/// Reports that the simulator has sealed its slab.
FrameRequest FrameSender::sealed_request_of(uint32_t slab) const {
  const shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slab));
  return {.rollout_index = header.rollout_index,
          .env_index = header.env_index,
          .kind = kSealedKind,
          .step = header.length};
}

/// Puts into the batch what the other end has to seal and was not notified of. Whether there was any.
bool FrameSender::send_sealed() {
  bool has_any = false;
  for (uint64_t index = in_hand_.first_index(); index < in_hand_.end_index(); ++index) {
    const Outbox::Item& item = in_hand_.at(index);
    if (item.is_done || item.is_sent) continue;
    const FrameRequest request = sealed_request_of(item.slab);
    make_room(request);
    packer_.add(request, arena_.slabs().view(static_cast<int>(item.slab)));
    in_hand_.sent(index, clock_.now_s());
    has_any = true;
  }
  return has_any;
}

void FrameSender::take_sealed(const FrameAnswer& answer) {
  const auto found = std::ranges::find_if(in_hand_, [&](const Outbox::Item& item) {
    const FrameRequest request = sealed_request_of(item.slab);
    return !item.is_done && request.env_index == answer.env_index &&
           request.rollout_index == answer.rollout_index;
  });
  if (found == in_hand_.end()) {
    ++account_.duplicates;
    return;
  }
  found->is_done = true;
  found->is_delivered = answer.is_sealed == 1;
  give_back_done();
}

std::optional<FrameAccount> FrameSender::frames() const {
  FrameAccount account = account_;
  account.resent = resent_;
  account.latency_us_p50 = latency_.quantile_us(0.5);
  account.latency_us_p90 = latency_.quantile_us(0.9);
  account.latency_us_p99 = latency_.quantile_us(0.99);
  return account;
}

}  // namespace comrad::link
