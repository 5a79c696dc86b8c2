// The session between a host that plays for a learner and the end that serves it, as both links have it: hello, credits,
// sequence, resending, refusal, leaving, silence. State machines without a network: the caller passes in what arrives,
// sends what they return, and passes the time. Stage: beside the flow.
//
//   PeerSession                                                  ServedSession
//   joining   ── hello (epoch, what it plays, how many) ──▶      unknown
//     │       ◀── state refused ── no places, another game ──    refused
//     ▼       ◀── state (session, done, credit) ──────────       open
//   open      ── item index < credit ─────────────────────▶      accepts `done`, then done + 1, ...
//             ◀── state done + 1, at a change and each 0.5 s ─
//             a session that it does not know, or no progress: sends again what is not done
//   leaving   ── hello (is_leaving) ──────────────────────▶      unknown, its places are free
//             silence: 5 s, then its credits go back; 600 s, then its places
//
// Indices count from 0 in every epoch. A new session of the serving end starts a new epoch, so that nothing of an earlier
// one is taken for an item of it.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <utility>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"

namespace comrad::link {

/// The end that sends. Threads: one.
class PeerSession {
 public:
  /// `hello` names the host and its request; each life of its process begins with an epoch that is higher than all before.
  PeerSession(const dds::PeerHello& hello, double patience_s, double now_s);

  enum class Heard { kNothing, kState, kBackFromSilence, kNewSession };
  Heard hear(const dds::PeerState& state, double now_s);

  bool is_hello_due(double now_s) const;
  /// To be sent now.
  dds::PeerHello hello(double now_s, bool is_leaving = false);

  /// Has places at the other end, and may send what it has credit for.
  bool is_open() const { return is_open_; }
  bool has_ended() const { return newest_.run == dds::PeerRun::kStopping; }
  bool is_asked_to_leave() const { return newest_.run == dds::PeerRun::kLeaving; }
  /// Errors: kBadInput with the other end's words where it refuses, kNotFound after `patience_s` of silence.
  Status check(const std::string& other_end, double now_s) const;

  /// Trajectory `index` of this epoch may be begun, or sent.
  bool has_credit(uint64_t index) const { return is_open_ && index < newest_.credit_index; }

  const dds::PeerState& newest() const { return newest_; }
  uint64_t session() const { return session_; }
  uint64_t session_before() const { return session_before_; }
  uint32_t epoch() const { return hello_.epoch; }
  double silent_s(double now_s) const { return now_s - heard_s_; }
  bool is_heard(double now_s) const;

 private:
  dds::PeerHello hello_;
  const double patience_s_;
  dds::PeerState newest_;
  std::string refusal_;
  bool is_open_ = false;
  uint64_t session_ = 0, session_before_ = 0;
  double heard_s_, said_s_ = -1;
};

/// What a sending end has in hand, first in, first out: sent until it is done, in order. Threads: one.
class Outbox {
 public:
  struct Item {
    uint32_t slab = 0;
    bool was_sent = false;  ///< once at least
    bool is_sent = false;   ///< and not to be sent again for now
    bool is_done = false, is_delivered = false;
  };

  bool empty() const { return items_.empty(); }
  std::size_t size() const { return items_.size(); }
  uint64_t first_index() const { return first_index_; }
  uint64_t end_index() const { return first_index_ + items_.size(); }
  Item& front() { return items_.front(); }
  Item& at(uint64_t index) { return items_[index - first_index_]; }
  auto begin() { return items_.begin(); }
  auto end() { return items_.end(); }

  Item& add(uint32_t slab, bool was_sent = false) { return items_.emplace_back(Item{slab, was_sent}); }
  void sent(uint64_t index, double now_s);
  void pop_front(double now_s);
  /// Indices begin at 0 again.
  void restart();
  void resend_all();
  /// Everything once more where the oldest one, which was sent, has not been done for `after_s`; doubled each time, to
  /// 32 times as long: an end that serves many may need longer, and what it gets again costs it more.
  bool resend_if_stuck(double now_s, double after_s);

 private:
  std::deque<Item> items_;
  uint64_t first_index_ = 0;
  double progress_s_ = 0;
  int stuck_ = 0;  ///< times, since something was delivered
};

/// The end that serves, for one peer. Threads: one.
class ServedSession {
 public:
  enum class Heard { kOutdated, kHere, kNewEpoch, kLeaves };
  Heard hear(const dds::PeerHello& hello, double now_s);
  /// Something else of it has arrived.
  void touch(double now_s) { heard_s_ = now_s; }
  /// It has places, under a number that no session of this arena had.
  void open(uint64_t session);
  /// True where that is news.
  bool refuse(const std::string& why);
  void close();

  bool is_open() const { return is_open_; }
  const std::string& refusal() const { return refusal_; }
  uint32_t epoch() const { return epoch_; }

  /// Whether item `index` of `epoch` is the one that is due.
  bool is_due(uint32_t epoch, uint64_t index) const { return is_open_ && epoch == epoch_ && index == done_; }
  void begin_one() { ++begun_; }
  void finish_one() { ++begun_, ++done_; }

  void ask_to_leave() { is_asked_to_leave_ = is_state_due_ = true; }
  void tell_soon() { is_state_due_ = true; }
  /// `credits` more trajectories may come.
  bool is_state_due(uint64_t credits, bool is_here, double now_s) const;
  dds::PeerState state(uint64_t peer_id, uint64_t credits, dds::PeerRun run) const;
  void told(const dds::PeerState& state, double now_s);
  double silent_s(double now_s) const { return now_s - heard_s_; }

 private:
  uint32_t epoch_ = 0;
  bool is_open_ = false, is_state_due_ = false, is_asked_to_leave_ = false;
  uint64_t session_ = 0, begun_ = 0, done_ = 0, told_done_ = 0, told_credit_ = 0;
  std::string refusal_;
  double heard_s_ = 0, told_s_ = 0;
};

}  // namespace comrad::link
