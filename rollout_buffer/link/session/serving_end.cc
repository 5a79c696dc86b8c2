#include "rollout_buffer/link/session/serving_end.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/session/timing.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {
std::optional<EpisodeRecord> own_episode(EpisodeRecord sent, int env, int num_agents) {
  const auto is_finite = [](float number) { return std::isfinite(number); };
  if (env < 0 || sent.agent_count != static_cast<uint32_t>(num_agents) || !is_finite(sent.score) ||
      !is_finite(sent.ceiling) || !std::ranges::all_of(sent.returns(), is_finite) ||
      !std::ranges::all_of(sent.scores(), is_finite))
    return std::nullopt;
  sent.env_index = static_cast<uint32_t>(env);
  sent.layout_index = kNoLayoutIndex;  // drawn there
  return sent;
}

ServingEnd::ServingEnd(const shm::Arena& arena, dds::LinkBus bus, const ServingOptions& options,
                       const Clock& clock)
    : arena_(arena),
      clock_(clock),
      bus_(std::move(bus)),
      options_(options),
      places_(arena, options.first_worker, options.worker_count) {}

void ServingEnd::begin() {
  arena_.sim_counters(options_.first_worker).begin_life();
  arena_.sim_counters(options_.first_worker).state = shm::WorkerState::kRunning;
}

Status ServingEnd::run(const std::atomic<bool>& stop) {
  begin();
  while (!shm::is_stopping(stop, arena_)) {
    turn();
    if (every_second_ && clock_.now_s() - reported_s_ >= 1) reported_s_ = clock_.now_s(), every_second_();
    wait();
  }
  // Only the end of the run is sent; a process that is restarted sends nothing.
  is_stopping_ = arena_.control().run_state.load() == shm::RunState::kStopping;
  for (auto& [id, peer] : peers_) give_back(*peer);
  for (const double end_s = clock_.now_s() + kTellOfEndS;
       is_stopping_ && !peers_.empty() && clock_.now_s() < end_s;) {
    for (auto& [id, peer] : peers_) tell(*peer);
    drop_all();
    bus_.wait(100);
  }
  if (every_second_) every_second_();
  for (int worker = 0; worker < options_.worker_count; ++worker)
    arena_.sim_counters(options_.first_worker + worker).state = shm::WorkerState::kStopped;
  return {};
}

void ServingEnd::turn() {
  reserve();
  has_moved_ = take_all();
  const double now_s = clock_.now_s();
  if (now_s - looked_s_ > 0.1) looked_s_ = now_s, forget_silent(now_s);
  for (auto& [id, peer] : peers_)
    if (has_news(*peer) || peer->session.is_state_due(peer->reserved.size(), peer->record.is_here, now_s))
      tell(*peer);
}

void ServingEnd::wait() { bus_.wait(kWaitMs); }

/// The peer of this id, which may be new. One that is gone makes room for it; null where all are here.
Peer* ServingEnd::peer_of(uint64_t peer_id) {
  if (!peers_.contains(peer_id) && peers_.size() >= options_.most_peers) {
    const auto gone =
        std::ranges::find_if(peers_, [](const auto& entry) { return !entry.second->record.is_here; });
    if (gone == peers_.end()) return nullptr;
    close(*gone->second);
    peers_.erase(gone);
  }
  std::unique_ptr<Peer>& peer = peers_[peer_id];
  if (peer == nullptr) peer = make_peer();
  peer->record.peer_id = peer_id;
  return peer.get();
}

Peer* ServingEnd::find(uint64_t peer_id) {
  const auto found = peers_.find(peer_id);
  return found == peers_.end() ? nullptr : found->second.get();
}

Peer* ServingEnd::hear(const dds::PeerHello& hello) {
  Peer* const peer = peer_of(hello.peer_id);
  if (peer == nullptr) return nullptr;
  PeerRecord& record = peer->record;
  record.host = hello.host.str();
  switch (peer->session.hear(hello, clock_.now_s())) {
    case ServedSession::Heard::kLeaves:
      if (std::exchange(record.is_here, false))
        spdlog::info("{} leaves: {} decisions in {} trajectories were taken from it", record.host,
                     record.decisions, record.slabs);
      give_back(*peer);
      close(*peer);
      return nullptr;
    case ServedSession::Heard::kNewEpoch:
      renewed(*peer);
      break;
    case ServedSession::Heard::kOutdated:
    case ServedSession::Heard::kHere:
      break;
  }
  if (peer->workers.empty()) {
    if (const std::string refusal = seat(*peer, hello); !refusal.empty()) {
      if (peer->session.refuse(refusal)) spdlog::warn("{} is refused: {}", record.host, refusal);
      return nullptr;
    }
    opened(*peer);
  }
  if (!std::exchange(record.is_here, true))
    spdlog::info("{} plays with {} simulators", record.host, record.workers);
  return peer;
}

/// Gives the peer places of simulators. Returns the reason if not, or nothing.
std::string ServingEnd::seat(Peer& peer, const dds::PeerHello& hello) {
  const uint64_t id = hello.peer_id;
  if (id == 0) return "it has no id";
  if (hello.fingerprint != options_.fingerprint)
    return "its settings, scenario or maps are no longer those of this run; join again";
  if (hello.slab_bytes != static_cast<uint64_t>(arena_.slabs().offsets().slab_bytes) ||
      hello.envs_per_worker != static_cast<uint32_t>(arena_.shape().envs_per_worker))
    return "its trajectories are of another shape; install the same version on both hosts";
  const auto wanted = static_cast<int>(std::min<uint32_t>(hello.sim_workers, INT32_MAX));
  peer.workers = places_.of(id);
  if (wanted > 0 && static_cast<int>(peer.workers.size()) == wanted) {
    peer.record.decisions = places_.sealed_for(id);  // a predecessor of this process did not say goodbye
  } else {
    places_.free(id);
    peer.workers.clear();
    // Hosts that have been silent for long make room, as many as it takes.
    for (auto& [other_id, other] : peers_)
      if (places_.free_count() < wanted && other_id != id && !other->record.is_here &&
          !other->workers.empty() && other->session.silent_s(clock_.now_s()) > options_.silent_after_s)
        close(*other);
    if (wanted == 0 || places_.free_count() < wanted)
      return fmt::format(
          "of {} places for simulators of {} {} are free, it requests {}; add places with {} where the run "
          "serves, or lower --num_workers here",
          places_.count(), options_.kind, places_.free_count(), wanted, options_.flag);
    peer.workers = places_.take(id, wanted);
  }
  peer.record.workers = wanted;
  const uint64_t life = arena_.sim_counters(options_.first_worker).epoch.load();
  peer.session.open((arena_.run_id() & 0xFFFFFFFFu) << 32 | (life & 0xFFFFu) << 16 | (++sessions_ & 0xFFFFu));
  return "";
}

void ServingEnd::close(Peer& peer) {
  closing(peer);
  peer.session.close();
  places_.free(peer.record.peer_id);
  peer.workers.clear();
}

void ServingEnd::give_back(Peer& peer) {
  for (const uint32_t slab : peer.reserved) arena_.slabs().abandon(slab);
  peer.reserved.clear();
  gave_back(peer);
}

/// Free slabs are taken before they are promised, first for hosts that have few, and in turn: where slabs are scarce no
/// host waits for another one's next.
void ServingEnd::reserve() {
  bool is_short = true;
  for (std::size_t round = 0; is_short; ++round) {
    is_short = false;
    auto next = peers_.upper_bound(reserved_last_);
    for (std::size_t count = 0; count < peers_.size(); ++count, ++next) {
      if (next == peers_.end()) next = peers_.begin();
      Peer& peer = *next->second;
      if (!peer.record.is_here || peer.workers.empty() || wanted_slabs(peer) <= round) continue;
      is_short = true;
      if (peer.reserved.size() > round) continue;
      const std::optional<uint32_t> slab = arena_.slabs().acquire(peer.workers[0]);
      if (!slab) return;
      peer.reserved.push_back(*slab);
      reserved_last_ = next->first;
    }
  }
}

/// Hosts of which nothing is heard lose their free slabs, and later their places.
void ServingEnd::forget_silent(double now_s) {
  for (auto& [id, peer] : peers_) {
    const double silent_s = peer->session.silent_s(now_s);
    if (peer->record.is_here && silent_s > options_.silent_after_s) {
      peer->record.is_here = false;
      give_back(*peer);
      spdlog::warn("nothing is heard of {}; its free slabs go back, its places are kept for {} s",
                   peer->record.host, static_cast<int>(options_.places_kept_s));
    }
    if (!peer->record.is_here && !peer->workers.empty() && silent_s > options_.places_kept_s) close(*peer);
  }
}

void ServingEnd::take_episodes() {
  bus_.take<dds::PeerEpisode>([this](const dds::PeerEpisode& episode) {
    const Peer* const peer = find(episode.peer_id);
    if (peer == nullptr) return;
    if (const auto record = own_episode(episode.record, env_of(*peer, episode.record.env_index),
                                        arena_.shape().trajectory.env.num_agents))
      arena_.episodes().write(*record);
  });
}

int ServingEnd::env_of(const Peer& peer, uint32_t env_index) const {
  const auto per_worker = static_cast<uint32_t>(arena_.shape().envs_per_worker);
  const uint32_t place = env_index / per_worker;
  if (place >= peer.workers.size()) return -1;
  return peer.workers[place] * static_cast<int>(per_worker) + static_cast<int>(env_index % per_worker);
}

void ServingEnd::refuse(Peer& peer, const std::string& what) const {
  if (++peer.record.refused == 1) spdlog::warn("{} sent {}", peer.record.host, what);
}

void ServingEnd::tell(Peer& peer) {
  const dds::PeerRun run = is_stopping_ ? dds::PeerRun::kStopping
                           : arena_.control().run_state.load() == shm::RunState::kPaused
                               ? dds::PeerRun::kPaused
                               : dds::PeerRun::kRunning;
  dds::PeerState state = peer.session.state(peer.record.peer_id, peer.reserved.size(), run);
  state.schedule_env_frames = arena_.control().schedule_env_frames.load();
  if (send_state(peer, state))
    peer.session.told(state, clock_.now_s());
  else
    peer.session.tell_soon();
}

std::vector<PeerRecord> ServingEnd::records() const {
  std::vector<PeerRecord> records;
  for (const auto& [id, peer] : peers_) {
    records.push_back(peer->record);
    records.back().credits = peer->reserved.size();
  }
  return records;
}

void ServingEnd::remember(const std::vector<PeerRecord>& records) {
  for (const PeerRecord& record : records)
    if (record.peer_id != 0 && peers_.size() < options_.most_peers) {
      Peer& peer = *peer_of(record.peer_id);
      peer.record = record;
      peer.record.is_here = false;
    }
}

void ServingEnd::ask_to_leave(const std::string& host) {
  for (auto& [id, peer] : peers_)
    if (peer->record.is_here && peer->record.host == host) peer->session.ask_to_leave();
}

}  // namespace comrad::link
