#include "rollout_buffer/link/frames/frame_receiver.h"

#include <spdlog/fmt/fmt.h>

#include <lz4.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/link/session/timing.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::link {
namespace {

using shm::RequestKind;
using shm::SlotState;

constexpr std::size_t kSpareSlabs = 2;    // of a host, beyond one for each environment that has none
constexpr std::size_t kMostWhole = 4;     // copies of an environment that wait to be sealed
constexpr std::size_t kAnsweredKept = 8;  // rollouts of an environment

FrameAnswer answer_to(const FrameRequest& request) {
  return {.step_id = request.step_id,
          .rollout_index = request.rollout_index,
          .env_index = request.env_index,
          .kind = request.kind,
          .step = request.step};
}

}  // namespace

FrameReceiver::FrameReceiver(const shm::Arena& arena, dds::LinkBus bus, ServingOptions options,
                             const Clock& clock)
    : ServingEnd(arena, std::move(bus),
                 (options.kind = "hosts without a policy", options.flag = "--serve_frame_workers", options),
                 clock) {
  const shm::ArenaShape& shape = arena.shape();
  round_.resize(static_cast<std::size_t>(shape.sim_worker_count * shape.splits_per_worker));
}

/// What a predecessor was filling is lost: its hosts' next rows find no slab that begins where they do.
void FrameReceiver::begin() {
  for (int index = 0; index < options_.worker_count; ++index) {
    const int worker = options_.first_worker + index;
    (void)arena_.reclaim_sim_worker(worker);
    arena_.sim_counters(worker).begin_life();
    arena_.sim_counters(worker).state = shm::WorkerState::kRunning;
  }
}

shm::Doorbell& FrameReceiver::acted() const {
  const int splits = arena_.shape().splits_per_worker;
  return arena_.step_slots().acted(waiting_for_ / splits, waiting_for_ % splits);
}

bool FrameReceiver::take_all() {
  heard_acted_ = waiting_for_ < 0 ? 0 : shm::listen(acted());
  bool has_moved = false;
  bus_.take<dds::FrameBatch>([&](const dds::FrameBatch& batch) {
    has_moved = true;
    if (Peer* const peer = hear(batch.hello); peer != nullptr && batch.request_count > 0)
      take(static_cast<FramePeer&>(*peer), batch);
  });
  has_moved |= collect();
  take_episodes();
  return has_moved;
}

void FrameReceiver::drop_all() {
  bus_.take<dds::FrameBatch>([](const dds::FrameBatch&) {});
  bus_.take<dds::PeerEpisode>([](const dds::PeerEpisode&) {});
}

void FrameReceiver::wait() {
  if (has_moved_) return;
  if (out_count_ == 0 || waiting_for_ < 0)
    bus_.wait(kWaitMs);
  else
    shm::wait(acted(), heard_acted_, kPollUs);
}

Status FrameReceiver::send_state(Peer& peer, const dds::PeerState& state) {
  std::vector<std::byte>& payload = static_cast<FramePeer&>(peer).payload;
  COMRAD_TRY(
      bus_.write(dds::ActionBatch{.state = state, .payload = payload}));  // else again in the next turn
  payload.clear();
  return {};
}

void FrameReceiver::opened(Peer& peer) {
  const shm::ArenaShape& shape = arena_.shape();
  std::vector<Mirror>& mirrors = static_cast<FramePeer&>(peer).mirrors;
  mirrors.clear();
  mirrors.resize(peer.workers.size() * static_cast<std::size_t>(shape.envs_per_worker));
  for (std::size_t env = 0; env < mirrors.size(); ++env) {
    mirrors[env].env = env_of(peer, static_cast<uint32_t>(env));
    mirrors[env].choices.resize(static_cast<std::size_t>(shape.trajectory.env.num_agents) *
                                static_cast<std::size_t>(shape.trajectory.env.head_count));
  }
}

/// Requests that a policy worker has in hand are waited for by reclaim_sim_worker().
void FrameReceiver::closing(Peer& closed) {
  auto& peer = static_cast<FramePeer&>(closed);
  for (Mirror& one : peer.mirrors) {
    if (one.has_slab && one.is_whole) count_lost(peer, one.copy.rollout.length);
    for (const Copy& copy : one.whole) count_lost(peer, copy.rollout.length);
    out_count_ -= one.is_out;
  }
  peer.reserved.clear();
  for (const int worker : peer.workers) (void)arena_.reclaim_sim_worker(worker);
  peer.mirrors.clear();
  peer.payload.clear();
}

std::size_t FrameReceiver::wanted_slabs(const Peer& peer) const {
  return kSpareSlabs +
         static_cast<std::size_t>(std::ranges::count_if(static_cast<const FramePeer&>(peer).mirrors,
                                                        [](const Mirror& one) { return !one.has_slab; }));
}

void FrameReceiver::take(FramePeer& peer, const dds::FrameBatch& batch) {
  if (batch.batch_index > peer.next_batch) peer.record.missing += batch.batch_index - peer.next_batch;
  peer.next_batch = std::max(peer.next_batch, batch.batch_index + 1);
  std::span<const std::byte> raw = batch.payload;
  if (batch.raw_bytes == 0 || batch.raw_bytes > dds::kFrameBatchBytes)
    return refuse(peer, fmt::format("a batch of frames of {} bytes", batch.raw_bytes));
  if (batch.is_compressed != 0) {
    raw_.resize(batch.raw_bytes);
    if (LZ4_decompress_safe(reinterpret_cast<const char*>(batch.payload.data()),
                            reinterpret_cast<char*>(raw_.data()), static_cast<int>(batch.payload.size()),
                            static_cast<int>(batch.raw_bytes)) != static_cast<int>(batch.raw_bytes))
      return refuse(peer, "a batch of frames that does not decompress");
    raw = raw_;
  }
  if (raw.size() != batch.raw_bytes || checksum64(raw) != batch.checksum)
    return refuse(peer, "a batch of frames with another length or checksum");
  std::ranges::fill(round_, 0u);
  FrameUnpacker frames(arena_.slabs().offsets(), static_cast<uint32_t>(peer.mirrors.size()), raw);
  while (true) {
    const Expected<std::optional<FrameRequest>> request = frames.next();
    if (!request) {
      refuse(peer, request.error().message);
      break;
    }
    if (!*request) break;
    mirror(peer, **request, frames);
  }
  const int splits = arena_.shape().splits_per_worker;
  for (std::size_t place = 0; place < round_.size(); ++place) {
    if (round_[place] == 0) continue;
    const int worker = static_cast<int>(place) / splits, split = static_cast<int>(place) % splits;
    waiting_for_ = static_cast<int>(place);
    shm::ring(arena_.step_slots().ready(arena_.shape().policy_worker_of(worker, split)));
  }
}

void FrameReceiver::abandon(FramePeer& peer, Mirror& one) {
  if (!one.has_slab) return;
  lose(peer, one.copy);
  one.has_slab = false;
}

void FrameReceiver::lose(FramePeer& peer, const Copy& copy) {
  count_lost(peer, copy.rollout.length);
  arena_.slabs().abandon(copy.slab);
}

void FrameReceiver::count_lost(FramePeer& peer, uint64_t steps) const {
  const uint64_t decisions = steps * static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
  peer.record.lost_there += decisions;
  peer.record.played_there += decisions;
}

/// The simulator has sealed a rollout. Older ones of which nothing was said it never sealed.
void FrameReceiver::confirm(FramePeer& peer, Mirror& one, const FrameRequest& request) {
  const auto known =
      std::ranges::find(one.answered, request.rollout_index, &std::pair<uint64_t, bool>::first);
  bool is_sealed = known != one.answered.end() && known->second;
  if (known == one.answered.end()) {
    const auto copy = std::ranges::find_if(one.whole, [&](const Copy& known_copy) {
      return known_copy.rollout.rollout_index == request.rollout_index;
    });
    if (copy != one.whole.end()) {
      is_sealed = copy->rollout.length == request.step && seal(peer, one, *copy);
      if (!is_sealed) lose(peer, *copy);
      for (auto old = one.whole.begin(); old != copy; ++old) lose(peer, *old);
      one.whole.erase(one.whole.begin(), copy + 1);
    }
    one.answered.emplace_back(request.rollout_index, is_sealed);
    if (one.answered.size() > kAnsweredKept) one.answered.pop_front();
  } else {
    ++peer.record.duplicates;
  }
  FrameAnswer told = answer_to(request);
  told.is_sealed = is_sealed;
  answer(peer, told, {});
}

/// Takes a promised slab. False where there is none: more was begun than promised.
bool FrameReceiver::begin_slab(FramePeer& peer, Mirror& one, const FrameRequest& request) {
  abandon(peer, one);
  if (peer.reserved.empty()) return false;
  const uint32_t slab = peer.reserved.front();
  peer.reserved.pop_front();
  one.has_slab = true;
  one.is_whole = request.step == 0;
  one.copy = {.slab = slab,
              .rollout = {.rollout_index = request.rollout_index,
                          .layout_id = request.layout_id,
                          .first_episode = {.episode_id = request.first_episode_id,
                                            .episode_seed = request.first_episode_seed}}};
  shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slab));
  header.env_index = static_cast<uint32_t>(one.env);
  header.length = 0;
  arena_.slabs().view(static_cast<int>(slab)).clear();
  return true;
}

void FrameReceiver::mirror(FramePeer& peer, const FrameRequest& request, const FrameUnpacker& frames) {
  Mirror& one = peer.mirrors[request.env_index];
  if (request.kind == kSealedKind) {
    confirm(peer, one, request);
    return;
  }
  const bool is_first = request.step == 0 && request.kind == static_cast<uint32_t>(RequestKind::kAct);
  const bool is_known = (one.is_out || one.is_answered) && is_same(request, one.request);
  if (is_known || one.is_out) {  // requests of a dead simulator's successor come again in time
    ++peer.record.duplicates;
    if (is_known && is_first &&
        std::exchange(one.counted_epoch, peer.session.epoch()) != peer.session.epoch())
      peer.session.begin_one();
    if (is_known && one.is_answered) answer(peer, one.answer, one.choices);
    return;
  }
  const uint32_t next_step = one.copy.rollout.length;
  const bool follows = one.has_slab && request.rollout_index == one.request.rollout_index &&
                       request.step == next_step && next_step > 0;
  if (!follows && !begin_slab(peer, one, request)) return;
  if (is_first) {
    peer.session.begin_one();
    one.counted_epoch = peer.session.epoch();
  }
  const SlabView slab = arena_.slabs().view(static_cast<int>(one.copy.slab));
  frames.copy_to(slab);
  if (request.step > 0) {
    const int last = static_cast<int>(request.step) - 1;
    slab.valid(last) = 1;
    if (slab.terminated(last) && slab.final_index(last) >= 0) {  // no request reads it; it is worth nothing
      const int row = slab.final_index(last);
      for (int agent = 0; agent < slab.shape().env.num_agents; ++agent) {
        slab.final_value(row, agent) = 0;
        std::ranges::fill(slab.final_frame(row, agent), uint8_t{0});
      }
    }
  }
  one.request = request;
  one.is_out = true;
  one.is_answered = false;
  ++out_count_;
  const shm::ArenaShape& shape = arena_.shape();
  const int place = split_of(shape, one.env);
  arena_.step_slots()
      .round(place / shape.splits_per_worker, place % shape.splits_per_worker)
      .request_count.store(++round_[static_cast<std::size_t>(place)], std::memory_order_relaxed);
  shm::StepSlot& slot = arena_.step_slots().slot(one.env);
  slot.step_id = request.step_id;
  slot.episode_id = request.episode_id;
  slot.episode_step = request.episode_step;
  slot.slab_index = one.copy.slab;
  slot.step = request.step;
  slot.final_row = request.final_row;
  slot.kind = static_cast<RequestKind>(request.kind);
  slot.reset_state = request.reset_state != 0;
  slot.state.store(SlotState::kReady, std::memory_order_release);
}

/// Takes what policy workers have answered.
bool FrameReceiver::collect() {
  if (out_count_ == 0) return false;
  bool has_moved = false;
  for (auto& [id, known] : peers_)
    for (auto& peer = static_cast<FramePeer&>(*known); Mirror & one : peer.mirrors)
      if (one.is_out &&
          shm::advance(arena_.step_slots().slot(one.env), SlotState::kActed, SlotState::kIdle)) {
        finish(peer, one);
        has_moved = true;
      }
  return has_moved;
}

void FrameReceiver::finish(FramePeer& peer, Mirror& one) {
  one.is_out = false;
  one.is_answered = true;
  --out_count_;
  const FrameRequest& request = one.request;
  one.answer = answer_to(request);
  const SlabView slab = arena_.slabs().view(static_cast<int>(one.copy.slab));
  uint32_t& length = one.copy.rollout.length;
  switch (static_cast<RequestKind>(request.kind)) {
    case RequestKind::kAct:
      std::copy_n(slab.action(static_cast<int>(request.step), 0).data(), one.choices.size(),
                  one.choices.data());
      length = request.step + 1;
      break;
    case RequestKind::kFinal:
      break;
    case RequestKind::kValue:
      if (!one.is_whole || length != request.step) {
        abandon(peer, one);
        break;
      }
      if (!one.whole.empty() && one.whole.back().rollout.rollout_index == request.rollout_index) {
        lose(peer, one.whole.back());  // its simulator died before it sealed it
        one.whole.pop_back();
      }
      one.copy.rollout.rollout_index = request.rollout_index;
      one.whole.push_back(one.copy);
      one.has_slab = false;
      if (one.whole.size() > kMostWhole) {
        lose(peer, one.whole.front());
        one.whole.pop_front();
      }
      break;
  }
  answer(peer, one.answer, one.choices);
}

/// What does not fit is requested again.
void FrameReceiver::answer(FramePeer& peer, const FrameAnswer& given, std::span<const int32_t> choices) {
  if (peer.payload.size() < dds::kChunkBytes / 2) add_answer(peer.payload, given, choices);
}

/// False for a rollout that the host has played before.
bool FrameReceiver::seal(FramePeer& peer, const Mirror& one, const Copy& copy) {
  RemoteRollout rollout = copy.rollout;
  rollout.rollout_index = places_.rollout_of(one.env, rollout.rollout_index);
  if (places_.ahead(one.env, rollout.rollout_index) < 0) return false;
  arena_.slabs().view(static_cast<int>(copy.slab)).pad(static_cast<int>(rollout.length));
  const uint64_t decisions = places_.seal(one.env, copy.slab, rollout);
  peer.record.decisions += decisions;
  peer.record.played_there += decisions;
  ++peer.record.slabs;
  return true;
}

}  // namespace comrad::link
