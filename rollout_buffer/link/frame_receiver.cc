#include "rollout_buffer/link/frame_receiver.h"

#include <lz4.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/guests.h"
#include "rollout_buffer/link/timing.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::link {
namespace {

using shm::RequestKind;
using shm::SlotState;

constexpr std::size_t kSpareSlabs = 2;    // of a host, beyond one for each environment that has none
constexpr std::size_t kMostWhole = 4;     // copies of an environment that wait to be sealed
constexpr std::size_t kAnsweredKept = 8;  // rollouts of an environment
constexpr std::size_t kMostRawBytes = dds::kFrameBatchBytes;

bool is_same(const FrameRequest& a, const FrameRequest& b) {
  return a.step_id == b.step_id && a.rollout_index == b.rollout_index && a.kind == b.kind && a.step == b.step;
}

}  // namespace

FrameReceiver::FrameReceiver(const shm::Arena& arena, dds::LinkBus bus, const FrameReceiverOptions& options,
                             const Clock& clock)
    : arena_(arena),
      clock_(clock),
      bus_(std::move(bus)),
      options_(options),
      seats_(arena, options.first_worker, options.worker_count) {
  const shm::ArenaShape& shape = arena.shape();
  round_.resize(static_cast<std::size_t>(shape.sim_worker_count * shape.splits_per_worker));
}

Status FrameReceiver::run(const std::atomic<bool>& stop) {
  // What a predecessor was filling is lost: its hosts' next rows find no slab that begins where they do.
  for (int worker = options_.first_worker; worker < options_.first_worker + options_.worker_count; ++worker) {
    (void)arena_.reclaim_sim_worker(worker);
    arena_.sim_counters(worker).begin_life();
    arena_.sim_counters(worker).state = shm::WorkerState::kRunning;
  }
  double looked_s = 0;
  while (!shm::is_stopping(stop, arena_)) {
    const uint32_t heard =
        waiting_for_ < 0
            ? 0
            : shm::listen(arena_.step_slots().acted(waiting_for_ / arena_.shape().splits_per_worker,
                                                    waiting_for_ % arena_.shape().splits_per_worker));
    bool has_moved = false;
    reserve();
    bus_.take_frames([&](const dds::FrameBatch& batch) {
      has_moved = true;
      hear(batch);
    });
    has_moved |= collect();
    const double now_s = clock_.now_s();
    bus_.take_episodes([&](const dds::FeederEpisode& episode) {
      const auto guest = guests_.find(episode.feeder_id);
      const uint32_t env_index = episode.record.env_index;
      if (guest == guests_.end() || env_index >= guest->second.mirrors.size()) return;
      if (const auto record = own_episode(episode.record, guest->second.mirrors[env_index].env,
                                          arena_.shape().trajectory.env.num_agents))
        arena_.episodes().write(*record);
    });
    if (now_s - looked_s > 0.1) {
      looked_s = now_s;
      forget_silent();
    }
    if (every_second_ && now_s - reported_s_ >= 1) reported_s_ = now_s, every_second_();
    for (auto& [id, guest] : guests_)
      if (guest.is_to_be_told || !guest.payload.empty() ||
          guest.told_credit != guest.begun + guest.reserved.size() ||
          (guest.record.is_here && now_s - guest.told_s >= kTellIntervalS))
        tell(id, guest);
    if (has_moved) continue;
    if (out_count_ == 0 || waiting_for_ < 0)
      bus_.wait(kWaitMs);
    else
      shm::wait(arena_.step_slots().acted(waiting_for_ / arena_.shape().splits_per_worker,
                                          waiting_for_ % arena_.shape().splits_per_worker),
                heard, kPollUs);
  }
  is_stopping_ = arena_.control().run_state.load() == shm::RunState::kStopping;
  for (const double end_s = clock_.now_s() + kTellOfEndS;
       is_stopping_ && !guests_.empty() && clock_.now_s() < end_s;) {
    for (auto& [id, guest] : guests_) tell(id, guest);
    bus_.take_frames([](const dds::FrameBatch&) {});
    bus_.take_episodes([](const dds::FeederEpisode&) {});
    bus_.wait(100);
  }
  for (auto& [id, guest] : guests_) give_back(guest);
  if (every_second_) every_second_();
  for (int worker = options_.first_worker; worker < options_.first_worker + options_.worker_count; ++worker)
    arena_.sim_counters(worker).state = shm::WorkerState::kStopped;
  return {};
}

void FrameReceiver::hear(const dds::FrameBatch& batch) {
  Guest* known = guest_of(guests_, batch.feeder_id, [this](Guest& gone) { free_seat(gone); });
  if (known == nullptr) return;
  Guest& guest = *known;
  guest.heard_s = clock_.now_s();
  guest.record.feeder_id = batch.feeder_id;
  guest.record.host = batch.host;
  if (batch.is_leaving) {
    if (std::exchange(guest.record.is_here, false))
      spdlog::info("{} leaves: {} decisions were played with it", guest.record.host, guest.record.decisions);
    give_back(guest);
    free_seat(guest);
    guest.epoch = 0;
    guest.is_asked_to_leave = false;
    return;
  }
  if (guest.epoch != batch.epoch) {
    guest.epoch = batch.epoch;
    guest.begun = guest.next_batch = 0;
  }
  if (guest.workers.empty()) {
    std::string refusal = seat(guest, batch);
    if (!refusal.empty() && refusal != guest.refusal)
      spdlog::warn("{} is refused: {}", guest.record.host, refusal);
    guest.refusal = std::move(refusal);
    guest.is_to_be_told = true;
  }
  if (!guest.refusal.empty()) {
    guest.is_to_be_told = true;
    return;
  }
  if (!std::exchange(guest.record.is_here, true))
    spdlog::info("{} plays with {} simulators", guest.record.host, guest.record.workers);
  if (batch.request_count > 0) take(guest, batch);
}

std::string FrameReceiver::seat(Guest& guest, const dds::FrameBatch& batch) {
  const shm::ArenaShape& shape = arena_.shape();
  if (std::string other = other_game(batch, options_.fingerprint, arena_); !other.empty()) return other;
  const auto wanted = static_cast<int>(std::min<uint32_t>(batch.sim_workers, INT32_MAX));
  guest.workers = seats_.of(batch.feeder_id);
  if (wanted > 0 && static_cast<int>(guest.workers.size()) == wanted) {
    guest.record.decisions = seats_.sealed_for(batch.feeder_id);  // for a predecessor of this process
  } else {
    seats_.free(batch.feeder_id);
    guest.workers.clear();
    take_seats_of_silent(guests_, clock_.now_s(), seats_, batch.feeder_id, wanted, options_.silent_after_s,
                         [this](Guest& gone) { free_seat(gone); });
    if (wanted == 0 || seats_.free_count() < wanted)
      return no_room(seats_, wanted, "hosts without a policy", "--serve_frame_workers");
    guest.workers = seats_.take(batch.feeder_id, wanted);
  }
  guest.record.workers = wanted;
  const auto agents = static_cast<std::size_t>(shape.trajectory.env.num_agents);
  guest.mirrors.clear();
  for (const int worker : guest.workers)
    for (int local = 0; local < shape.envs_per_worker; ++local) {
      Mirror& one = guest.mirrors.emplace_back();
      one.env = worker * shape.envs_per_worker + local;
      one.choices.resize(agents * static_cast<std::size_t>(shape.trajectory.env.head_count));
    }
  guest.session = static_cast<uint64_t>(monotonic_ns());
  guest.begun = 0;
  return "";
}

/// Requests that a policy worker has in hand are waited for by reclaim_sim_worker().
void FrameReceiver::free_seat(Guest& guest) {
  for (Mirror& one : guest.mirrors) {
    const auto agents = static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
    if (one.has_slab && one.is_whole) guest.record.lost_there += one.next_step * agents;
    for (const Copy& copy : one.whole) guest.record.lost_there += copy.length * agents;
    out_count_ -= std::exchange(one.is_out, false);
    one.has_slab = false;
  }
  guest.reserved.clear();
  for (const int worker : guest.workers) (void)arena_.reclaim_sim_worker(worker);
  seats_.free(guest.record.feeder_id);
  guest.workers.clear();
  guest.mirrors.clear();
  guest.payload.clear();
}

void FrameReceiver::give_back(Guest& guest) {
  for (const uint32_t slab : guest.reserved) arena_.slabs().abandon(slab);
  guest.reserved.clear();
}

/// Free slabs are taken before they are promised.
void FrameReceiver::reserve() {
  for (auto& [id, guest] : guests_) {
    if (!guest.record.is_here || guest.workers.empty()) continue;
    const auto without = static_cast<std::size_t>(
        std::ranges::count_if(guest.mirrors, [](const Mirror& one) { return !one.has_slab; }));
    while (guest.reserved.size() < without + kSpareSlabs) {
      const std::optional<uint32_t> slab = arena_.slabs().acquire(guest.workers[0]);
      if (!slab) return;
      guest.reserved.push_back(*slab);
    }
  }
}

void FrameReceiver::take(Guest& guest, const dds::FrameBatch& batch) {
  const auto refuse = [&](const std::string& what) {
    if (++guest.record.refused == 1) spdlog::warn("{} sent {}", guest.record.host, what);
  };
  if (batch.batch_index > guest.next_batch) guest.record.missing += batch.batch_index - guest.next_batch;
  guest.next_batch = std::max(guest.next_batch, batch.batch_index + 1);
  std::span<const std::byte> raw = batch.payload;
  if (batch.raw_bytes == 0 || batch.raw_bytes > kMostRawBytes)
    return refuse("a batch of frames of " + std::to_string(batch.raw_bytes) + " bytes");
  if (batch.is_compressed) {
    raw_.resize(batch.raw_bytes);
    if (LZ4_decompress_safe(reinterpret_cast<const char*>(batch.payload.data()),
                            reinterpret_cast<char*>(raw_.data()), static_cast<int>(batch.payload.size()),
                            static_cast<int>(batch.raw_bytes)) != static_cast<int>(batch.raw_bytes))
      return refuse("a batch of frames that does not decompress");
    raw = raw_;
  }
  if (raw.size() != batch.raw_bytes || checksum64(raw) != batch.checksum)
    return refuse("a batch of frames with another length or checksum");
  std::ranges::fill(round_, 0u);
  FrameUnpacker frames(arena_.slabs().offsets(), static_cast<uint32_t>(guest.mirrors.size()), raw);
  while (true) {
    const Expected<std::optional<FrameRequest>> request = frames.next();
    if (!request) {
      refuse(request.error().message);
      break;
    }
    if (!*request) break;
    mirror(guest, **request, frames);
  }
  const int splits = arena_.shape().splits_per_worker;
  for (std::size_t place = 0; place < round_.size(); ++place) {
    if (round_[place] == 0) continue;
    const int worker = static_cast<int>(place) / splits, split = static_cast<int>(place) % splits;
    waiting_for_ = static_cast<int>(place);
    shm::ring(arena_.step_slots().ready(arena_.shape().policy_worker_of(worker, split)));
  }
}

void FrameReceiver::abandon(Guest& guest, Mirror& one) {
  if (!one.has_slab) return;
  lose(guest, one.slab, one.next_step);
  one.has_slab = false;
}

void FrameReceiver::lose(Guest& guest, uint32_t slab, uint64_t steps) {
  guest.record.lost_there += steps * static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
  arena_.slabs().abandon(slab);
}

/// The simulator has sealed a rollout. Older ones of which nothing was said it never sealed.
void FrameReceiver::confirm(Guest& guest, Mirror& one, const FrameRequest& request) {
  const auto known =
      std::ranges::find(one.answered, request.rollout_index, &std::pair<uint64_t, bool>::first);
  bool is_sealed = known != one.answered.end() && known->second;
  if (known == one.answered.end()) {
    const auto copy = std::ranges::find(one.whole, request.rollout_index, &Copy::rollout_index);
    if (copy != one.whole.end()) {
      is_sealed = copy->length == request.step && seal(guest, one, *copy);
      if (!is_sealed) lose(guest, copy->slab, copy->length);
      for (auto old = one.whole.begin(); old != copy; ++old) lose(guest, old->slab, old->length);
      one.whole.erase(one.whole.begin(), copy + 1);
    }
    one.answered.emplace_back(request.rollout_index, is_sealed);
    if (one.answered.size() > kAnsweredKept) one.answered.pop_front();
  } else {
    ++guest.record.duplicates;
  }
  if (guest.payload.size() >= dds::kChunkBytes / 2) return;  // it is asked again
  add_answer(guest.payload,
             {.step_id = request.step_id,
              .rollout_index = request.rollout_index,
              .env_index = request.env_index,
              .kind = kSealedKind,
              .step = request.step,
              .is_sealed = is_sealed},
             {});
}

/// Takes a promised slab. False where there is none: more was begun than promised.
bool FrameReceiver::begin(Guest& guest, Mirror& one, const FrameRequest& request) {
  abandon(guest, one);
  if (guest.reserved.empty()) return false;
  one.slab = guest.reserved.front();
  guest.reserved.pop_front();
  one.has_slab = true;
  one.is_whole = request.step == 0;
  one.next_step = 0;
  one.layout_id = request.layout_id;
  one.first_episode_id = request.first_episode_id;
  one.first_episode_seed = request.first_episode_seed;
  shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(one.slab));
  header.env_index = static_cast<uint32_t>(one.env);
  header.length = 0;
  arena_.slabs().view(static_cast<int>(one.slab)).clear();
  return true;
}

void FrameReceiver::mirror(Guest& guest, const FrameRequest& request, const FrameUnpacker& frames) {
  Mirror& one = guest.mirrors[request.env_index];
  if (request.kind == kSealedKind) {
    confirm(guest, one, request);
    return;
  }
  const bool is_first = request.step == 0 && request.kind == static_cast<uint32_t>(RequestKind::kAct);
  const bool is_known = (one.is_out || one.is_answered) && is_same(request, one.request);
  if (is_known || one.is_out) {  // what a new simulator asks in place of a dead one comes again in time
    ++guest.record.duplicates;
    if (is_known && is_first && std::exchange(one.counted_epoch, guest.epoch) != guest.epoch) ++guest.begun;
    if (is_known && one.is_answered) answer(guest, one);
    return;
  }
  const bool follows = one.has_slab && request.rollout_index == one.request.rollout_index &&
                       request.step == one.next_step && one.next_step > 0;
  if (!follows && !begin(guest, one, request)) return;
  if (is_first) {
    ++guest.begun;
    one.counted_epoch = guest.epoch;
  }
  const SlabView slab = arena_.slabs().view(static_cast<int>(one.slab));
  frames.copy_to(slab);
  if (request.step > 0) {
    const int last = static_cast<int>(request.step) - 1;
    slab.valid(last) = 1;
    if (slab.terminated(last) && slab.final_index(last) >= 0) {  // nobody asks for it; it is worth nothing
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
  const int worker = one.env / shape.envs_per_worker, local = one.env % shape.envs_per_worker;
  const int split = shape.splits_per_worker > 1 && local >= shape.split_begin(1) ? 1 : 0;
  uint32_t& count = round_[static_cast<std::size_t>(worker * shape.splits_per_worker + split)];
  arena_.step_slots().round(worker, split).request_count.store(++count, std::memory_order_relaxed);
  shm::StepSlot& slot = arena_.step_slots().slot(one.env);
  slot.step_id = request.step_id;
  slot.episode_id = request.episode_id;
  slot.episode_step = request.episode_step;
  slot.slab_index = one.slab;
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
  for (auto& [id, guest] : guests_)
    for (Mirror& one : guest.mirrors)
      if (one.is_out &&
          shm::advance(arena_.step_slots().slot(one.env), SlotState::kActed, SlotState::kIdle)) {
        finish(guest, one);
        has_moved = true;
      }
  return has_moved;
}

void FrameReceiver::finish(Guest& guest, Mirror& one) {
  one.is_out = false;
  one.is_answered = true;
  --out_count_;
  const FrameRequest& request = one.request;
  one.answer = {.step_id = request.step_id,
                .rollout_index = request.rollout_index,
                .env_index = request.env_index,
                .kind = request.kind,
                .step = request.step};
  const SlabView slab = arena_.slabs().view(static_cast<int>(one.slab));
  switch (static_cast<RequestKind>(request.kind)) {
    case RequestKind::kAct:
      std::copy_n(slab.action(static_cast<int>(request.step), 0).data(), one.choices.size(),
                  one.choices.data());
      one.next_step = request.step + 1;
      break;
    case RequestKind::kFinal:
      break;
    case RequestKind::kValue:
      if (!one.is_whole || one.next_step != request.step) {
        abandon(guest, one);
        break;
      }
      if (!one.whole.empty() && one.whole.back().rollout_index == request.rollout_index) {
        lose(guest, one.whole.back().slab,
             one.whole.back().length);  // its simulator died before it sealed it
        one.whole.pop_back();
      }
      one.whole.push_back({.slab = one.slab,
                           .length = one.next_step,
                           .rollout_index = request.rollout_index,
                           .layout_id = one.layout_id,
                           .first_episode_id = one.first_episode_id,
                           .first_episode_seed = one.first_episode_seed});
      one.has_slab = false;
      if (one.whole.size() > kMostWhole) {
        lose(guest, one.whole.front().slab, one.whole.front().length);
        one.whole.pop_front();
      }
      break;
  }
  answer(guest, one);
}

/// What does not fit is asked for again.
void FrameReceiver::answer(Guest& guest, const Mirror& one) {
  if (guest.payload.size() < dds::kChunkBytes / 2) add_answer(guest.payload, one.answer, one.choices);
}

/// False for a rollout that the host has played before.
bool FrameReceiver::seal(Guest& guest, const Mirror& one, const Copy& copy) {
  const uint64_t rollout_index = seats_.rollout_of(one.env, copy.rollout_index);
  if (seats_.ahead(one.env, rollout_index) < 0) return false;
  arena_.slabs().view(static_cast<int>(copy.slab)).pad(static_cast<int>(copy.length));
  guest.record.decisions += seats_.seal(
      one.env, copy.slab,
      {.rollout_index = rollout_index,
       .length = copy.length,
       .layout_id = copy.layout_id,
       .first_episode = {.episode_id = copy.first_episode_id, .episode_seed = copy.first_episode_seed}});
  ++guest.record.slabs;
  return true;
}

void FrameReceiver::ask_to_leave(const std::string& host) {
  for (auto& [id, guest] : guests_)
    if (guest.record.host == host && guest.record.is_here)
      guest.is_asked_to_leave = guest.is_to_be_told = true;
}

void FrameReceiver::forget_silent() {
  forget_silent_guests(
      guests_, clock_.now_s(), options_.silent_after_s, options_.seat_kept_s,
      [this](Guest& guest) { give_back(guest); }, [this](Guest& guest) { free_seat(guest); });
}

void FrameReceiver::tell(uint64_t id, Guest& guest) {
  dds::ActionBatch batch{
      .feeder_id = id, .session = guest.session, .epoch = guest.epoch, .batch_index = guest.answers};
  batch.run_state = !guest.refusal.empty()                                        ? "refused"
                    : is_stopping_                                                ? "stopping"
                    : guest.is_asked_to_leave                                     ? "leaving"
                    : arena_.control().run_state.load() == shm::RunState::kPaused ? "paused"
                                                                                  : "running";
  batch.message = guest.refusal;
  batch.credit_index = guest.begun + guest.reserved.size();
  batch.schedule_env_frames = arena_.control().schedule_env_frames.load();
  batch.payload = guest.payload;
  if (!bus_.write(batch)) return;  // again in the next turn
  guest.told_s = clock_.now_s();
  guest.told_credit = batch.credit_index;
  guest.is_to_be_told = false;
  ++guest.answers;
  guest.payload.clear();
}

std::vector<FeederRecord> FrameReceiver::records() const {
  std::vector<FeederRecord> records;
  for (const auto& [id, guest] : guests_) {
    FeederRecord& record = records.emplace_back(guest.record);
    record.credits = guest.reserved.size();
    record.played_there = record.decisions + record.lost_there;
  }
  return records;
}

void FrameReceiver::remember(const std::vector<FeederRecord>& records) { remember_guests(guests_, records); }

}  // namespace comrad::link
