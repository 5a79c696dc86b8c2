// What both ends of the links on the learner's host have in common: on its arena they stand where simulators stand. They
// give other hosts places of simulators, take free slabs before they promise them, and seal what comes as simulators do.
// Stages: acquire, seal.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/session/accounts.h"
#include "rollout_buffer/link/session/peer_session.h"
#include "rollout_buffer/link/session/remote_workers.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

constexpr std::size_t kMostPeers = 64;

struct ServingOptions {
  int first_worker = 0;      ///< simulators of the arena from this one on are played by other hosts,
  int worker_count = 1;      ///< so many
  uint64_t fingerprint = 0;  ///< of the offer; other games are refused
  double silent_after_s =
      5;  ///< then a host's free slabs go back, and another that needs its places has them
  double places_kept_s = 600;  ///< then its simulators' places are free
  std::string kind = {};       ///< for a host without a place: whose simulators the places are for,
  std::string flag = {};       ///< and which setting gives the run more of them
  std::size_t most_peers = kMostPeers;
};

/// A host that plays for this one's learner, or did.
struct Peer {
  virtual ~Peer() = default;
  PeerRecord record;
  ServedSession session;
  std::vector<int> workers;       ///< of this arena; its simulator k plays workers[k]
  std::deque<uint32_t> reserved;  ///< free slabs in our hands, its credits
};

/// An episode of another host as of environment `env` of this arena; nothing for one that no simulator could have written.
std::optional<EpisodeRecord> own_episode(EpisodeRecord sent, int env, int num_agents);

/// Threads: one.
class ServingEnd {
 public:
  /// Arena and clock outlive it.
  ServingEnd(const shm::Arena& arena, dds::LinkBus bus, const ServingOptions& options, const Clock& clock);
  virtual ~ServingEnd() = default;

  /// Until `stop`, or the run stops; then the hosts that play are notified.
  Status run(const std::atomic<bool>& stop);
  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  std::vector<PeerRecord> records() const;
  /// What records() of a predecessor said last, that hosts which have left are not forgotten. Call before run().
  void remember(const std::vector<PeerRecord>& records);
  /// Hosts of this name deliver what they have played, and go. They may join again.
  void ask_to_leave(const std::string& host);

  /// What run() does, for tests that have the time in their hands: begin(), then turn() again and again.
  virtual void begin();
  void turn();

 protected:
  /// Takes what has arrived. Whether anything has.
  virtual bool take_all() = 0;
  /// Throws away what arrives at the end of a run.
  virtual void drop_all() = 0;
  virtual void wait();
  virtual Status send_state(Peer& peer, const dds::PeerState& state) = 0;
  virtual std::unique_ptr<Peer> make_peer() const = 0;
  /// It has places; it counts from 0; it loses its places.
  virtual void opened(Peer& peer) = 0;
  virtual void renewed(Peer& peer) = 0;
  virtual void closing(Peer&) {}
  /// Its free slabs are gone.
  virtual void gave_back(Peer&) {}
  /// So many free slabs are kept for it.
  virtual std::size_t wanted_slabs(const Peer& peer) const = 0;
  virtual bool has_news(const Peer&) const { return false; }

  /// Gives places, refuses, or sends the farewell. The peer where it plays, else null.
  Peer* hear(const dds::PeerHello& hello);
  Peer* find(uint64_t peer_id);
  void take_episodes();
  /// The environment of this arena; -1: the host has no such one.
  int env_of(const Peer& peer, uint32_t env_index) const;
  /// Counts what no simulator could have sent, and logs the first.
  void refuse(Peer& peer, const std::string& what) const;

  const shm::Arena& arena_;
  const Clock& clock_;
  dds::LinkBus bus_;
  const ServingOptions options_;
  RemoteWorkers places_;
  std::map<uint64_t, std::unique_ptr<Peer>> peers_;
  bool has_moved_ = false;

 private:
  Peer* peer_of(uint64_t peer_id);
  std::string seat(Peer& peer, const dds::PeerHello& hello);
  void close(Peer& peer);
  void give_back(Peer& peer);
  void reserve();
  void forget_silent(double now_s);
  void tell(Peer& peer);

  uint32_t sessions_ = 0;
  uint64_t reserved_last_ = 0;  ///< the peer that got the last slab
  bool is_stopping_ = false;
  double looked_s_ = 0, reported_s_ = 0;
  std::function<void()> every_second_;
};

}  // namespace comrad::link
