// What both ends of the links on the learner's host do alike with hosts that play for it. Stage: beside the flow.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/seats.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {

/// By feeder id. A guest has a `record`, its `workers` of the arena, and `heard_s`, when it was heard last.
template <typename Guest>
using Guests = std::map<uint64_t, Guest>;
constexpr std::size_t kMostGuests = 64;

/// The guest of this id, which may be new. One that is gone makes room for it (`free_seat`); null where all are here.
template <typename Guest, typename FreeSeat>
Guest* guest_of(Guests<Guest>& guests, uint64_t feeder_id, FreeSeat free_seat) {
  if (!guests.contains(feeder_id) && guests.size() >= kMostGuests) {
    const auto gone =
        std::ranges::find_if(guests, [](const auto& entry) { return !entry.second.record.is_here; });
    if (gone == guests.end()) return nullptr;
    free_seat(gone->second);
    guests.erase(gone);
  }
  return &guests[feeder_id];
}

/// What records() of a predecessor said last, that hosts which have left are not forgotten.
template <typename Guest>
void remember_guests(Guests<Guest>& guests, const std::vector<FeederRecord>& records) {
  for (const FeederRecord& record : records) {
    if (record.feeder_id == 0 || guests.size() >= kMostGuests) continue;
    Guest& guest = guests[record.feeder_id];
    guest.record = record;
    guest.record.is_here = false;
  }
}

/// Hosts of which nothing is heard lose their free slabs (`give_back`), and later their places (`free_seat`).
template <typename Guest, typename GiveBack, typename FreeSeat>
void forget_silent_guests(Guests<Guest>& guests, double now_s, double silent_after_s, double seat_kept_s,
                          GiveBack give_back, FreeSeat free_seat) {
  for (auto& [id, guest] : guests) {
    const double silent_s = now_s - guest.heard_s;
    if (guest.record.is_here && silent_s > silent_after_s) {
      guest.record.is_here = false;
      give_back(guest);
      spdlog::warn("nothing is heard of {}; its free slabs go back, its places are kept for {} s",
                   guest.record.host, static_cast<int>(seat_kept_s));
    }
    if (!guest.record.is_here && !guest.workers.empty() && silent_s > seat_kept_s) free_seat(guest);
  }
}

/// Frees places of hosts that have been silent for long, where guest `id` needs them: as many hosts' as it takes.
template <typename Guest, typename FreeSeat>
void take_seats_of_silent(Guests<Guest>& guests, double now_s, const Seats& seats, uint64_t id, int wanted,
                          double silent_after_s, FreeSeat free_seat) {
  for (auto& [other_id, other] : guests)
    if (seats.free_count() < wanted && other_id != id && !other.record.is_here && !other.workers.empty() &&
        now_s - other.heard_s > silent_after_s)
      free_seat(other);
}

/// Why a host that asks for places, a FeedReport or a FrameBatch, plays another game; empty where it is this one.
template <typename Asked>
std::string other_game(const Asked& asked, uint64_t fingerprint, const shm::Arena& arena) {
  if (asked.feeder_id == 0) return "it has no id";
  if (asked.fingerprint != fingerprint)
    return "its settings, scenario or maps are no longer those of this run; join again";
  if (asked.slab_bytes != static_cast<uint64_t>(arena.slabs().offsets().slab_bytes) ||
      asked.envs_per_worker != static_cast<uint32_t>(arena.shape().envs_per_worker))
    return "its trajectories are of another shape; install the same version on both hosts";
  return "";
}

/// An episode of another host as of environment `env` of this arena; nothing for one that no simulator could have written.
inline std::optional<EpisodeRecord> own_episode(EpisodeRecord sent, int env, int num_agents) {
  const auto is_finite = [](float number) { return std::isfinite(number); };
  if (env < 0 || sent.agent_count != static_cast<uint32_t>(num_agents) || !is_finite(sent.score) ||
      !is_finite(sent.ceiling) || !std::ranges::all_of(sent.returns(), is_finite) ||
      !std::ranges::all_of(sent.scores(), is_finite))
    return std::nullopt;
  sent.env_index = static_cast<uint32_t>(env);
  sent.layout_index = kNoLayoutIndex;  // drawn there
  return sent;
}

/// Why so many places cannot be had. `kind` are the simulators they are for, `flag` gives the run more of them.
inline std::string no_room(const Seats& seats, int wanted, const std::string& kind, const std::string& flag) {
  return "of " + std::to_string(seats.count()) + " places for simulators of " + kind + " " +
         std::to_string(seats.free_count()) + " are free, it asks for " + std::to_string(wanted) +
         "; more can be had with " + flag + " where the run serves, fewer asked for with --num_workers here";
}

}  // namespace comrad::link
