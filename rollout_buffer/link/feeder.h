// The end of the trajectory link on a host that feeds: on the arena of that host it stands where the learner stands. It
// drains sealed slabs and sends them, and publishes the weights that come back. Stages: drain, publish.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/delivery_account.h"
#include "rollout_buffer/link/layout_grants.h"
#include "rollout_buffer/link/slab_stream.h"
#include "rollout_buffer/link/weights_stream.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

struct FeederOptions {
  uint64_t feeder_id = 0;     ///< of this arena; another run of this host has another one
  uint64_t fingerprint = 0;   ///< of the offer that this host plays
  std::string host;           ///< its name, for people
  double patience_s = 300;    ///< how long the learner's host may be silent
  int layout_count = 0;       ///< of the run's pool, from which this host draws evenly; 0: one map
  double resend_after_s = 3;  ///< without a word that what was sent is done
};

/// Nothing is lost where this process is killed and starts again on the same arena: what its predecessor had in hand is
/// sent again, and the other end knows what it has. Threads: one.
class Feeder {
 public:
  /// Arena and clock outlive it.
  Feeder(const shm::Arena& arena, dds::LinkBus bus, const FeederOptions& options,
         const Clock& clock = kMachineClock);

  /// Until `stop`, or this arena's run stops (then what is sealed is delivered, for a few seconds), or the run that is
  /// fed ends. Errors: kBadInput where this host is refused, kNotFound where nobody was heard for patience_s.
  Status run(const std::atomic<bool>& stop);

  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  FeederAccount account() const;
  /// The learner's host has places for this one.
  bool is_fed() const { return state_.has_value(); }
  /// Since something was heard of the learner's host.
  double silent_s() const;
  /// run() ended because the run that is fed has ended.
  bool has_run_ended() const { return has_run_ended_; }

 private:
  struct InHand {
    uint32_t slab = 0;
    bool was_sent = false;  ///< once at least
    bool is_sent = false;   ///< and not to be sent again for now
  };

  Status hear();
  void take_state(const dds::FeedState& state);
  void begin_anew(uint64_t session);
  void finish_first(bool is_delivered);
  void drain();
  bool send();
  void resend_if_stuck();
  void send_episodes();
  void report(bool is_leaving);

  const shm::Arena& arena_;
  const Clock& clock_;
  dds::LinkBus bus_;
  const FeederOptions options_;
  uint32_t epoch_ = 0;
  SlabCutter cutter_;
  WeightsAssembler weights_;
  std::optional<dds::FeedState> state_;  ///< the newest
  uint64_t session_ = 0;                 ///< of the other end; 0: not known yet
  std::deque<InHand> in_hand_;           ///< the first has index first_index_
  uint64_t first_index_ = 0;
  std::optional<uint64_t> cutting_;  ///< index of the slab that is being sent
  uint32_t next_fragment_ = 0;
  double heard_s_ = 0, progress_s_ = 0, reported_s_ = 0, told_s_ = 0;
  std::function<void()> every_second_;
  uint64_t beat_ = 0;
  DeliveryAccount deliveries_;
  uint64_t resent_ = 0;
  bool has_run_ended_ = false;
  LayoutGrants layouts_;
  std::string refusal_;
};

}  // namespace comrad::link
