// The session of both links, alone: two state machines, a simulated network and a clock that is moved by hand.
#include "rollout_buffer/link/session/peer_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <vector>

#include "tests/support/simulated_network.h"

namespace comrad::link {
namespace peer_session_test {

using ::testing::HasSubstr;

constexpr uint64_t kCredits = 4;
constexpr double kTickS = 0.05;
constexpr double kPatienceS = 300, kResendAfterS = 3;

/// What travels: an item is a trajectory, by its number on the sending host and its index in the epoch.
struct Item {
  uint32_t epoch = 0;
  uint64_t index = 0, number = 0;
};

/// Both ends, and what lies in their arenas and so outlives them.
class Link {
 public:
  Link(uint64_t seed, const test::LineTraits& traits)
      : random_(seed),
        hellos_(traits, Rng(seed * 4 + 1)),
        items_(traits, Rng(seed * 4 + 2)),
        states_(traits, Rng(seed * 4 + 3)) {
    begin_sender();
    begin_server();
  }

  void begin_sender() {
    sender_ = std::make_unique<PeerSession>(
        dds::PeerHello{.peer_id = 7, .epoch = ++lives_ << 16, .sim_workers = 1, .host = "there"}, kPatienceS,
        now_s_);
    outbox_ = Outbox();
    for (uint64_t number = finished_; number < drained_; ++number)
      outbox_.add(static_cast<uint32_t>(number), /*was_sent=*/true);
  }
  void begin_server() { served_ = std::make_unique<ServedSession>(); }
  void cut(bool is_cut) { hellos_.cut(is_cut), items_.cut(is_cut), states_.cut(is_cut); }

  /// One turn of both ends; `wanted` items are to be carried in all.
  void turn(uint64_t wanted) {
    now_s_ += kTickS;
    serve();
    send(wanted);
  }
  void serve() {
    while (const auto hello = hellos_.receive(now_s_)) {
      if (served_->hear(*hello, now_s_) == ServedSession::Heard::kLeaves)
        served_->close();
      else if (!served_->is_open() && hello->epoch == served_->epoch()) {
        if (refusal_.empty())
          served_->open(++sessions_);
        else
          served_->refuse(refusal_);
      }
    }
    while (const auto item = items_.receive(now_s_)) {
      if (!served_->is_due(item->epoch, item->index)) continue;
      served_->touch(now_s_);
      served_->finish_one();
      // Sequence numbers in the arena are duplicates. Others come in the order of its numbers.
      if (item->number < sealed_) continue;
      EXPECT_EQ(item->number, sealed_) << "an item was left out";
      ++sealed_;
    }
    if (!served_->is_state_due(kCredits, served_->is_open(), now_s_)) return;
    const dds::PeerState state = served_->state(7, kCredits, run_);
    states_.send(state, now_s_);
    served_->told(state, now_s_);
  }
  void send(uint64_t wanted) {
    while (const auto state = states_.receive(now_s_)) {
      const PeerSession::Heard heard = sender_->hear(*state, now_s_);
      if (heard == PeerSession::Heard::kNothing) continue;
      if (heard == PeerSession::Heard::kBackFromSilence) outbox_.resend_all();
      if (heard == PeerSession::Heard::kNewSession) {
        outbox_.restart();
        continue;
      }
      while (!outbox_.empty() && outbox_.first_index() < state->done_index && outbox_.front().was_sent) {
        outbox_.front().is_delivered = true;
        outbox_.pop_front(now_s_);
        ++finished_;
        EXPECT_LE(finished_, sealed_) << "an item counts as done that the other end does not have";
      }
    }
    while (drained_ < wanted && sender_->has_credit(outbox_.end_index()))
      outbox_.add(static_cast<uint32_t>(drained_++));
    for (uint64_t index = outbox_.first_index(); index < outbox_.end_index(); ++index) {
      if (outbox_.at(index).is_sent || !sender_->has_credit(index)) continue;
      EXPECT_LT(index, sender_->newest().credit_index);
      items_.send({sender_->epoch(), index, outbox_.at(index).slab}, now_s_);
      outbox_.sent(index, now_s_);
    }
    if (sender_->is_heard(now_s_)) outbox_.resend_if_stuck(now_s_, kResendAfterS);
    if (sender_->is_hello_due(now_s_)) hellos_.send(sender_->hello(now_s_), now_s_);
  }
  void leave() { hellos_.send(sender_->hello(now_s_, /*is_leaving=*/true), now_s_); }

  Rng random_;
  double now_s_ = 1;
  std::unique_ptr<PeerSession> sender_;
  std::unique_ptr<ServedSession> served_;
  Outbox outbox_;
  test::SimulatedLine<dds::PeerHello> hellos_;
  test::SimulatedLine<Item> items_;
  test::SimulatedLine<dds::PeerState> states_;
  dds::PeerRun run_ = dds::PeerRun::kRunning;
  std::string refusal_;
  uint32_t lives_ = 0;
  uint64_t sessions_ = 1ull << 32;
  uint64_t drained_ = 0, finished_ = 0;  // on the sending host
  uint64_t sealed_ = 0;                  // on the other one
};

TEST(PeerSession, CarriesEveryItemOnceAndInOrderOverAGoodLine) {
  Link link(1, {});
  for (int tick = 0; tick < 400 && link.finished_ < 100; ++tick) link.turn(100);
  EXPECT_EQ(link.finished_, 100u);
  EXPECT_EQ(link.items_.sent(), 100u) << "nothing is sent twice where nothing is lost";
}

TEST(PeerSession, CarriesEveryItemOnceAndInOrderOverAnyLineAndAnyDeath) {
  for (uint64_t seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Rng draws(seed + 1000);
    Link link(seed, {.loss = draws.uniform() * 0.3,
                     .duplication = draws.uniform() * 0.2,
                     .delay_s = draws.uniform() * 0.2,
                     .jitter_s = draws.uniform() * 3});
    constexpr uint64_t kItems = 60;
    double trouble_until_s = 0;
    // An hour at most: with a third of all lost and each loss sent again after 3 s it takes minutes.
    for (int tick = 0; tick < 72'000 && link.finished_ < kItems && !HasFailure(); ++tick) {
      link.turn(kItems);
      if (link.now_s_ < trouble_until_s) continue;
      link.cut(false);
      switch (draws.below(120)) {
        case 0:
          link.begin_sender();
          break;
        case 1:
          link.begin_server();
          break;
        case 2:
          link.cut(true);
          trouble_until_s = link.now_s_ + 20 * draws.uniform();
          break;
        case 3:
          link.leave();  // and comes back with its next hello
          break;
        default:
          break;
      }
    }
    ASSERT_EQ(link.finished_, kItems);
    ASSERT_EQ(link.sealed_, kItems);
  }
}

TEST(PeerSession, ARefusalIsAnErrorInTheOtherEndsWords) {
  Link link(1, {});
  link.refusal_ = "there is no room";
  for (int tick = 0; tick < 20; ++tick) link.turn(10);
  const Status checked = link.sender_->check("the learner's host", link.now_s_);
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(checked.error().message, HasSubstr("there is no room"));
  EXPECT_EQ(link.items_.sent(), 0u);
}

TEST(PeerSession, SilenceIsAnErrorOnlyAfterTheGivenPatience) {
  Link link(1, {});
  for (int tick = 0; tick < 20; ++tick) link.turn(1);
  ASSERT_TRUE(link.sender_->is_open());
  link.cut(true);
  const double cut_s = link.now_s_;
  while (link.now_s_ < cut_s + kPatienceS - 1) {
    link.turn(10);
    ASSERT_TRUE(link.sender_->check("the learner's host", link.now_s_));
  }
  EXPECT_GT(link.served_->silent_s(link.now_s_), kPatienceS - 3) << "the other end hears nothing either";
  while (link.now_s_ < cut_s + kPatienceS + 2) link.turn(10);
  const Status checked = link.sender_->check("the learner's host", link.now_s_);
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().code, ErrorCode::kNotFound);
}

TEST(PeerSession, WithoutProgressNothingIsSentIntoASilence) {
  Link link(1, {});
  for (int tick = 0; tick < 20; ++tick) link.turn(0);
  link.cut(true);
  for (int tick = 0; tick < 2000; ++tick) link.turn(100);
  EXPECT_LE(link.items_.sent(), kCredits) << "what there was credit for, once";
}

TEST(PeerSession, TheEndOfARunAndARequestToLeaveReachTheSender) {
  Link link(1, {});
  for (int tick = 0; tick < 20; ++tick) link.turn(1);
  link.served_->ask_to_leave();
  for (int tick = 0; tick < 20; ++tick) link.turn(1);
  EXPECT_TRUE(link.sender_->is_asked_to_leave());
  EXPECT_FALSE(link.sender_->has_ended());
  link.run_ = dds::PeerRun::kStopping;
  for (int tick = 0; tick < 20; ++tick) link.turn(1);
  EXPECT_TRUE(link.sender_->has_ended());
}

TEST(PeerSession, AnotherSessionOfTheServingEndIsAnotherEpoch) {
  Link link(1, {});
  for (int tick = 0; tick < 20; ++tick) link.turn(3);
  const uint32_t epoch = link.sender_->epoch();
  link.begin_server();
  for (int tick = 0; tick < 40; ++tick) link.turn(6);
  EXPECT_EQ(link.sender_->epoch(), epoch + 1);
  EXPECT_FALSE(link.served_->is_due(epoch, 0)) << "what was under way to the session before";
  EXPECT_EQ(link.finished_, 6u);
  EXPECT_EQ(link.outbox_.first_index(), 3u) << "indices count from 0 again";
}

}  // namespace peer_session_test
}  // namespace comrad::link
