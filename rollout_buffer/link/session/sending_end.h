// What both ends of the links on a host that plays for another one's learner have in common: on this host's arena they
// stand where the learner stands, drain sealed slabs and give them back once the other end is done with them. What they
// have delivered lies in the arena, so that a process that takes over from a dead one resumes there. Stage: drain.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/link/session/accounts.h"
#include "rollout_buffer/link/session/peer_session.h"
#include "rollout_buffer/link/session/timing.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

struct SendingOptions {
  uint64_t peer_id = 0;       ///< of this arena; another run of this host has another one
  uint64_t fingerprint = 0;   ///< of the offer that this host plays
  std::string host;           ///< its name, for people
  double patience_s = 300;    ///< how long the other end may be silent
  int layout_count = 0;       ///< of the run's pool, from which this host draws evenly; 0: one map
  double resend_after_s = 3;  ///< without a word that what was sent is done
};

/// Threads: one.
class SendingEnd {
 public:
  /// Arena and clock outlive it.
  SendingEnd(const shm::Arena& arena, dds::LinkBus bus, const SendingOptions& options, const Clock& clock);
  virtual ~SendingEnd() = default;

  /// Until `stop`, or this arena's run stops (then what is sealed is delivered, for a few seconds), or the run that is
  /// played for ends. Errors: kBadInput where this host is refused, kNotFound after patience_s of silence; the link's own.
  Status run(const std::atomic<bool>& stop);
  /// Called in run(), and at its end.
  void every_second(std::function<void()> report) { every_second_ = std::move(report); }

  SenderAccount account() const;
  virtual std::optional<FrameAccount> frames() const { return std::nullopt; }
  /// The other end has places for this host.
  bool is_open() const { return session_.is_open(); }
  /// Since something was heard of the other end.
  double silent_s() const { return session_.silent_s(clock_.now_s()); }
  /// run() ended because the run that is played for has ended.
  bool has_run_ended() const { return session_.has_ended(); }

  /// What run() does, for tests that have the time in their hands: begin(), then turn(), keep_up() and wait()
  /// again and again, then leave().
  virtual Status begin();
  virtual Status turn() = 0;
  /// Episodes, maps, the hello and the report. Errors: those of PeerSession::check().
  Status keep_up();
  virtual void wait() { bus_.wait(kWaitMs); }
  /// Sends the farewell: this host's places are free.
  void leave();

 protected:
  /// Sends what is in hand, once no more is played.
  virtual void deliver() = 0;
  virtual Status say_hello(bool is_leaving) = 0;
  /// Applies a state; a new session restarts the outbox. Whether the state is of the session and for this epoch.
  bool hear(const dds::PeerState& state);
  /// The other end has a new session.
  virtual void renew() = 0;
  /// Gives back, in order, what is done.
  void give_back_done();
  uint64_t decisions_of(uint32_t slab) const;

  const shm::Arena& arena_;
  const Clock& clock_;
  dds::LinkBus bus_;
  const double resend_after_s_;
  PeerSession session_;
  Outbox in_hand_;
  uint64_t resent_ = 0;

 private:
  void send_episodes();
  void adopt();

  const int layout_count_;
  Rng layout_draws_;
  uint64_t delivered_ = 0, lost_ = 0;  ///< agent decisions
  double told_s_ = 0, kept_up_s_ = 0;
  std::function<void()> every_second_;
};

}  // namespace comrad::link
