#include "rollout_buffer/link/session/peer_session.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "rollout_buffer/link/session/timing.h"

namespace comrad::link {
namespace {

constexpr double kHelloIntervalS = 0.5;
constexpr int kMostDoublings = 5;
constexpr double kSilentAfterS = 2.0;  // without a state of the other end nothing is sent again

}  // namespace

PeerSession::PeerSession(const dds::PeerHello& hello, double patience_s, double now_s)
    : hello_(hello), patience_s_(patience_s), heard_s_(now_s) {}

PeerSession::Heard PeerSession::hear(const dds::PeerState& state, double now_s) {
  if (state.peer_id != hello_.peer_id) return Heard::kNothing;
  const bool was_silent = !is_heard(now_s);
  heard_s_ = now_s;
  if (state.epoch != hello_.epoch) return Heard::kNothing;  // for a predecessor, or an earlier session
  if (state.run == dds::PeerRun::kRefused) {
    refusal_ = state.message.str().empty() ? "no reason was given" : state.message.str();
    return Heard::kNothing;
  }
  newest_ = state;
  if (session_ != 0 && session_ != state.session) {
    session_before_ = session_;
    session_ = state.session;
    is_open_ = false;  // until a state of the new epoch comes
    ++hello_.epoch;
    said_s_ = -1;
    return Heard::kNewSession;
  }
  session_ = state.session;
  is_open_ = true;
  return was_silent ? Heard::kBackFromSilence : Heard::kState;
}

bool PeerSession::is_heard(double now_s) const { return silent_s(now_s) <= kSilentAfterS; }

bool PeerSession::is_hello_due(double now_s) const {
  return said_s_ < 0 || now_s - said_s_ >= kHelloIntervalS;
}

dds::PeerHello PeerSession::hello(double now_s, bool is_leaving) {
  said_s_ = now_s;
  dds::PeerHello said = hello_;
  said.is_leaving = is_leaving;
  return said;
}

Status PeerSession::check(const std::string& other_end, double now_s) const {
  if (!refusal_.empty())
    return Error{ErrorCode::kBadInput, "the run does not take this host in: " + refusal_};
  if (silent_s(now_s) > patience_s_)
    return Error{ErrorCode::kNotFound,
                 fmt::format("nothing was heard of {} for {} s; is the run still alive, and the network up?",
                             other_end, static_cast<int>(patience_s_))};
  return {};
}

void Outbox::sent(uint64_t index, double now_s) {
  at(index).was_sent = at(index).is_sent = true;
  progress_s_ = now_s;
}

void Outbox::pop_front(double now_s) {
  if (items_.front().is_delivered) progress_s_ = now_s, stuck_ = 0;
  items_.pop_front();
  ++first_index_;
}

void Outbox::restart() {
  first_index_ = 0;
  resend_all();
}

void Outbox::resend_all() {
  for (Item& item : items_) item.is_sent = false;
}

bool Outbox::resend_if_stuck(double now_s, double after_s) {
  if (items_.empty() || !items_.front().is_sent || items_.front().is_done ||
      now_s - progress_s_ < after_s * (1 << stuck_))
    return false;
  stuck_ = std::min(stuck_ + 1, kMostDoublings);
  resend_all();
  progress_s_ = now_s;
  return true;
}

ServedSession::Heard ServedSession::hear(const dds::PeerHello& hello, double now_s) {
  if (hello.epoch < epoch_) return Heard::kOutdated;  // it was under way for long
  heard_s_ = now_s;
  if (hello.is_leaving != 0) return Heard::kLeaves;
  if (epoch_ == hello.epoch) return Heard::kHere;
  epoch_ = hello.epoch;
  begun_ = done_ = 0;
  is_state_due_ = true;
  return Heard::kNewEpoch;
}

void ServedSession::open(uint64_t session) {
  is_open_ = is_state_due_ = true;
  session_ = session;
  begun_ = done_ = 0;
  refusal_.clear();
}

bool ServedSession::refuse(const std::string& why) {
  is_state_due_ = true;
  return std::exchange(refusal_, why) != why;
}

void ServedSession::close() {
  is_open_ = is_asked_to_leave_ = false;
  epoch_ = 0;
}

bool ServedSession::is_state_due(uint64_t credits, bool is_here, double now_s) const {
  return is_state_due_ || told_done_ != done_ || told_credit_ != begun_ + credits ||
         (is_here && now_s - told_s_ >= kTellIntervalS);
}

dds::PeerState ServedSession::state(uint64_t peer_id, uint64_t credits, dds::PeerRun run) const {
  return {.peer_id = peer_id,
          .session = session_,
          .done_index = done_,
          .credit_index = begun_ + credits,
          .epoch = epoch_,
          .run = !refusal_.empty()                                      ? dds::PeerRun::kRefused
                 : is_asked_to_leave_ && run != dds::PeerRun::kStopping ? dds::PeerRun::kLeaving
                                                                        : run,
          .message = refusal_};
}

void ServedSession::told(const dds::PeerState& state, double now_s) {
  told_s_ = now_s;
  told_done_ = state.done_index;
  told_credit_ = state.credit_index;
  is_state_due_ = false;
}

}  // namespace comrad::link
