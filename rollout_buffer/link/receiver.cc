#include "rollout_buffer/link/receiver.h"

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/guests.h"
#include "rollout_buffer/link/narrow_weights.h"
#include "rollout_buffer/link/timing.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::link {
Receiver::Receiver(const shm::Arena& arena, dds::LinkBus bus, ReceiverOptions options, const Clock& clock)
    : arena_(arena),
      clock_(clock),
      bus_(std::move(bus)),
      options_(std::move(options)),
      door_(options_.offer),
      fingerprint_(fingerprint_of(options_.offer)),
      seats_(arena, options_.first_worker, arena.shape().sim_worker_count - options_.first_worker),
      weights_pace_(options_.weights) {
  shm::WorkerCounters& counters = arena_.sim_counters(options_.first_worker);
  counters.begin_life();
  counters.state = shm::WorkerState::kRunning;
  session_ = (arena_.run_id() & 0xFFFFFFFFu) << 32 | counters.epoch.load();
}

Status Receiver::run(const std::atomic<bool>& stop) {
  while (!shm::is_stopping(stop, arena_)) {
    turn();
    if (every_second_ && clock_.now_s() - reported_s_ >= 1) reported_s_ = clock_.now_s(), every_second_();
    bus_.wait(kWaitMs);
  }
  // Only the end of the run is told; a receiver that is restarted says nothing.
  is_stopping_ = arena_.control().run_state.load() == shm::RunState::kStopping;
  for (auto& [id, guest] : guests_) give_back(guest);
  for (const double end_s = clock_.now_s() + kTellOfEndS;
       is_stopping_ && clock_.now_s() < end_s && !guests_.empty();) {
    for (auto& [id, guest] : guests_) tell(guest);
    bus_.take_reports([](const dds::FeedReport&) {});
    bus_.take_fragments([](const dds::TrajectoryFragment&) {});
    bus_.wait(100);
  }
  if (every_second_) every_second_();
  arena_.sim_counters(options_.first_worker).state = shm::WorkerState::kStopped;
  return {};
}

void Receiver::turn() {
  bus_.take_questions([this](const dds::DoorQuestion& question) {
    if (const Status written = bus_.write(door_.answer(question)); !written)
      spdlog::warn("a question at the door is not answered: {}", written.error().message);
  });
  bus_.take_reports([this](const dds::FeedReport& report) { hear(report); });
  reserve();
  bus_.take_fragments([this](const dds::TrajectoryFragment& fragment) { take(fragment); });
  bus_.take_episodes([this](const dds::FeederEpisode& episode) { take_episode(episode); });
  send_weights_if_due();
  forget_silent();
  const double now_s = clock_.now_s();
  for (auto& [id, guest] : guests_) {
    const bool has_news = guest.is_to_be_told || guest.told_done != guest.done_index ||
                          guest.told_credit != guest.done_index + guest.reserved.size();
    if (has_news || (guest.record.is_here && now_s - guest.told_s >= kTellIntervalS)) tell(guest);
  }
}

void Receiver::hear(const dds::FeedReport& report) {
  Guest* known = guest_of(guests_, report.feeder_id, [this](Guest& gone) { free_seat(gone); });
  if (known == nullptr) return;
  Guest& guest = *known;
  FeederRecord& record = guest.record;
  record.feeder_id = report.feeder_id;
  record.host = report.host;
  record.played_there = report.decisions_played;
  record.lost_there = report.decisions_lost;
  guest.heard_s = clock_.now_s();
  if (report.is_leaving) {
    if (std::exchange(record.is_here, false))
      spdlog::info("{} leaves: {} decisions in {} trajectories were taken from it, it played {}", record.host,
                   record.decisions, record.slabs, record.played_there);
    give_back(guest);
    free_seat(guest);
    guest.epoch = 0;
    return;
  }
  if (guest.epoch != report.epoch) {
    guest.epoch = report.epoch;
    guest.done_index = 0;
    guest.is_assembling = false;
  }
  if (guest.workers.empty()) {
    std::string refusal = seat(guest, report);
    if (!refusal.empty() && refusal != guest.refusal) spdlog::warn("{} is refused: {}", record.host, refusal);
    guest.refusal = std::move(refusal);
  }
  if (guest.refusal.empty() && !std::exchange(record.is_here, true))
    spdlog::info("{} feeds with {} simulators", record.host, record.workers);
  guest.is_to_be_told = true;
}

/// Gives the guest places of simulators. Says why not, or nothing.
std::string Receiver::seat(Guest& guest, const dds::FeedReport& report) {
  const uint64_t id = report.feeder_id;
  guest.workers.clear();
  if (std::string other = other_game(report, fingerprint_, arena_); !other.empty()) return other;
  const auto wanted = static_cast<int>(std::min<uint32_t>(report.sim_workers, INT32_MAX));
  guest.workers = seats_.of(id);
  const bool is_known = wanted > 0 && static_cast<int>(guest.workers.size()) == wanted;
  if (is_known) {
    guest.record.decisions = seats_.sealed_for(id);  // a predecessor of this process did not say goodbye
  } else {
    seats_.free(id);
    take_seats_of_silent(guests_, clock_.now_s(), seats_, id, wanted, options_.silent_after_s,
                         [this](Guest& gone) { free_seat(gone); });
    if (wanted == 0 || seats_.free_count() < wanted)
      return no_room(seats_, wanted, "other hosts", "--serve_workers");
    guest.workers = seats_.take(id, wanted);
  }
  guest.record.workers = wanted;
  guest.assembler = std::make_unique<SlabAssembler>(arena_.slabs().offsets());
  return "";
}

void Receiver::remember(const std::vector<FeederRecord>& records) { remember_guests(guests_, records); }

void Receiver::free_seat(Guest& guest) {
  seats_.free(guest.record.feeder_id);
  guest.workers.clear();
}

/// Free slabs are taken before they are promised, one for each host in turn.
void Receiver::reserve() {
  for (int round = 0; round < options_.window; ++round)
    for (auto& [id, guest] : guests_) {
      if (!guest.record.is_here || guest.workers.empty() ||
          guest.reserved.size() > static_cast<std::size_t>(round))
        continue;
      const std::optional<uint32_t> slab = arena_.slabs().acquire(guest.workers[0]);
      if (!slab) return;
      guest.reserved.push_back(*slab);
    }
}

void Receiver::give_back(Guest& guest) {
  for (const uint32_t slab : guest.reserved) arena_.slabs().abandon(slab);
  guest.reserved.clear();
  guest.is_assembling = false;
}

void Receiver::take(const dds::TrajectoryFragment& fragment) {
  const auto found = guests_.find(fragment.feeder_id);
  if (found == guests_.end()) return;
  Guest& guest = found->second;
  // What is not due is sent again in time: it was lost with a network, or comes from before.
  if (guest.workers.empty() || fragment.epoch != guest.epoch || fragment.send_index != guest.done_index ||
      guest.reserved.empty())
    return;
  guest.heard_s = clock_.now_s();
  if (fragment.fragment_index == 0) {
    guest.assembler->begin(arena_.slabs().view(static_cast<int>(guest.reserved.front())));
    guest.is_assembling = true;
  }
  if (!guest.is_assembling || fragment.fragment_index != guest.assembler->next_index()) {
    guest.is_assembling = false;
    return;
  }
  const Expected<bool> whole = guest.assembler->take(fragment);
  if (whole && !*whole) return;
  guest.is_assembling = false;
  ++guest.done_index;
  if (!whole) {
    if (++guest.record.refused == 1) spdlog::warn("{} sent {}", guest.record.host, whole.error().message);
    return;
  }
  seal(guest, fragment);
}

int Receiver::remote_env(const Guest& guest, uint32_t env_index) const {
  const auto per_worker = static_cast<uint32_t>(arena_.shape().envs_per_worker);
  const uint32_t place = env_index / per_worker;
  if (place >= guest.workers.size()) return -1;
  return guest.workers[place] * static_cast<int>(per_worker) + static_cast<int>(env_index % per_worker);
}

void Receiver::seal(Guest& guest, const dds::TrajectoryFragment& fragment) {
  const int env = remote_env(guest, fragment.env_index);
  if (env < 0) {
    if (++guest.record.refused == 1)
      spdlog::warn("{} sent a trajectory of environment {}, which it does not have", guest.record.host,
                   fragment.env_index);
    return;
  }
  const uint64_t rollout_index = seats_.rollout_of(env, fragment.rollout_index);
  const int64_t ahead = seats_.ahead(env, rollout_index);
  if (ahead < 0) {
    ++guest.record.duplicates;
    return;
  }
  guest.record.missing += static_cast<uint64_t>(ahead);

  const uint32_t index = guest.reserved.front();
  guest.reserved.pop_front();
  const SlabView slab = arena_.slabs().view(static_cast<int>(index));
  for (int step = 0; step < arena_.shape().trajectory.rollout_steps; ++step) slab.layout_index(step) = 0;
  guest.record.decisions += seats_.seal(env, index,
                                        {.rollout_index = rollout_index,
                                         .length = fragment.length,
                                         .layout_id = fragment.layout_id,
                                         .first_episode = {.episode_id = fragment.first_episode_id,
                                                           .episode_seed = fragment.first_episode_seed}});
  ++guest.record.slabs;
}

void Receiver::take_episode(const dds::FeederEpisode& episode) {
  const auto found = guests_.find(episode.feeder_id);
  if (found == guests_.end()) return;
  const int env = remote_env(found->second, episode.record.env_index);
  if (const auto record = own_episode(episode.record, env, arena_.shape().trajectory.env.num_agents))
    arena_.episodes().write(*record);
}

void Receiver::send_weights_if_due() {
  const auto guests_here = static_cast<std::size_t>(
      std::ranges::count_if(guests_, [](const auto& entry) { return entry.second.record.is_here; }));
  if (guests_here == 0 || !arena_.weights().has_any()) return;
  if (are_weights_sent_ && arena_.weights().version() == weights_version_) return;
  const double now_s = clock_.now_s();
  if (!weights_pace_.is_due(now_s, guests_here)) return;
  // On a bad line a newer version in the place of one that is half there would never let any arrive.
  if (weights_pace_.since_sent_s(now_s) < options_.weights_wait_s && !bus_.has_sent_weights()) return;
  weights_pace_.sent(now_s, weights_.size(), guests_here, 0);  // what fails below is not tried at once again
  const Stopwatch watch;                                       // Cyclone writes in this thread
  const Expected<PolicyVersion> version = arena_.weights().read(weights_);
  if (!version) {
    spdlog::warn("{}", version.error().message);
    return;
  }
  if (options_.bf16_parameters > 0) {
    std::swap(weights_, as_in_arena_);
    if (const Status narrowed = narrow_weights(as_in_arena_, options_.bf16_parameters, weights_); !narrowed) {
      spdlog::warn("{}", narrowed.error().message);
      return;
    }
  }
  const Status sent = send_weights(bus_, weights_, *version, options_.bf16_parameters);
  weights_pace_.sent(now_s, weights_.size(), guests_here, watch.cpu_elapsed());
  are_weights_sent_ = sent.has_value();  // else all of them once more, a little later
  weights_version_ = *version;
  if (!sent && sent.error().code != ErrorCode::kTimeout) spdlog::warn("{}", sent.error().message);
}

void Receiver::forget_silent() {
  forget_silent_guests(
      guests_, clock_.now_s(), options_.silent_after_s, options_.seat_kept_s,
      [this](Guest& guest) { give_back(guest); }, [this](Guest& guest) { free_seat(guest); });
}

void Receiver::tell(Guest& guest) {
  guest.is_to_be_told = false;
  guest.told_s = clock_.now_s();
  guest.told_done = guest.done_index;
  guest.told_credit = guest.done_index + guest.reserved.size();
  const shm::ControlBlock& control = arena_.control();
  const std::string run_state = !guest.refusal.empty()                               ? "refused"
                                : is_stopping_                                       ? "stopping"
                                : guest.is_asked_to_leave                            ? "leaving"
                                : control.run_state.load() == shm::RunState::kPaused ? "paused"
                                                                                     : "running";
  const Status written =
      bus_.write(dds::FeedState{.feeder_id = guest.record.feeder_id,
                                .session = session_,
                                .epoch = guest.epoch,
                                .beat = ++beat_,
                                .run_state = run_state,
                                .message = guest.refusal,
                                .done_index = guest.told_done,
                                .credit_index = guest.told_credit,
                                .schedule_env_frames = control.schedule_env_frames.load()});
  if (!written) guest.is_to_be_told = true;
}

std::vector<FeederRecord> Receiver::records() const {
  std::vector<FeederRecord> records;
  for (const auto& [id, guest] : guests_) {
    records.push_back(guest.record);
    records.back().credits = guest.reserved.size();
  }
  return records;
}

void Receiver::ask_to_leave(const std::string& host) {
  for (auto& [id, guest] : guests_)
    if (guest.record.is_here && guest.record.host == host)
      guest.is_asked_to_leave = guest.is_to_be_told = true;
}

}  // namespace comrad::link
