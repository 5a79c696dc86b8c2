// Both ends of the trajectory link in separate processes, between two arenas. The test plays the simulators of the
// one and the learner of the other, and the supervisors: it kills, stops and starts the ends, and pulls the cable.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <map>
#include <random>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/trajectories/trajectory_receiver.h"
#include "rollout_buffer/link/trajectories/trajectory_sender.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/network_pair.h"
#include "tests/support/patience.h"
#include "tests/support/small_arena.h"

namespace comrad::link {
namespace link_test {

constexpr uint64_t kPeerId = 77;
constexpr int kRemoteWorkers = 3;
constexpr int kOwnWorkers = 1;
constexpr int kRefusedExit = 40, kSilentExit = 41, kEndedExit = 42;

uint64_t fresh_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

shm::Arena make_arena(int sim_workers, int slabs, int remote_workers = 0) {
  shm::ArenaShape shape = test::small_arena_shape();
  shape.trajectory.env.height = 40;  // slabs of several fragments' worth of pages
  shape.trajectory.env.width = 60;
  shape.sim_worker_count = sim_workers;
  shape.remote_worker_count = remote_workers;
  shape.slab_count = slabs;
  shape.journal_steps = 0;
  auto arena = shm::Arena::create(shape, fresh_id());
  EXPECT_TRUE(arena) << arena.error().message;
  arena->control().run_state = shm::RunState::kRunning;
  return std::move(*arena);
}

Offer small_offer() {
  Offer offer;
  offer.scenario = "stag_hunt_arena";
  return offer;
}

class Link : public ::testing::Test {
 protected:
  ~Link() override {
    for (pid_t* pid : {&sender_, &receiver_})
      if (*pid > 0) kill_end(*pid);
  }

  /// Starts a process that does `work` and exits with what it gives.
  pid_t start(int host, const std::function<int()>& work) {
    const auto guarded = [&] {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      spdlog::set_level(spdlog::level::off);
      return work();
    };
    if (network_) return network_->start(host, guarded);
    const pid_t pid = fork();
    if (pid == 0) _exit(guarded());
    return pid;
  }
  dds::BusConfig config(int host) const {
    if (!network_)
      return host == 0 ? serving_config(link_id_, {}) : joining_config({.link_id = link_id_}, {}, kLoopback);
    HostSettings settings;
    settings.interface = network_->device(host);
    settings.insecure_network = true;
    return host == 0 ? serving_config(link_id_, settings)
                     : joining_config({.host = network_->address(0), .link_id = link_id_}, settings, "");
  }

  void start_receiver(uint64_t bf16_parameters = 0) {
    receiver_ = start(0, [&] {
      auto bus = dds::LinkBus::open(config(0));
      if (!bus) return 1;
      static std::atomic<bool> stop{false};
      TrajectoryReceiver receiver(learner_, std::move(*bus),
                                  {.first_worker = kOwnWorkers,
                                   .offer = small_offer(),
                                   .silent_after_s = 2,
                                   .bf16_parameters = bf16_parameters});
      return receiver.run(stop) ? 0 : 1;
    });
  }
  void start_sender(uint64_t fingerprint = fingerprint_of(small_offer()), double patience_s = 60) {
    sender_ = start(1, [&] {
      auto bus = dds::LinkBus::open(config(1));
      if (!bus) return 1;
      static std::atomic<bool> stop{false};
      TrajectorySender sender(player_, std::move(*bus),
                              {.peer_id = kPeerId,
                               .fingerprint = fingerprint,
                               .host = "player",
                               .patience_s = patience_s,
                               .resend_after_s = 1});
      const Status done = sender.run(stop);
      if (!done) return done.error().code == ErrorCode::kBadInput ? kRefusedExit : kSilentExit;
      return sender.has_run_ended() ? kEndedExit : 0;
    });
  }
  static void kill_end(pid_t& pid) {
    kill(pid, SIGKILL);
    waitpid(pid, nullptr, 0);
    pid = -1;
  }
  static int exit_code_of(pid_t& pid) {
    int status = 0;
    waitpid(pid, &status, 0);
    pid = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  /// As the supervisor of the learner's host does.
  void reclaim_receiver() {
    for (int worker = kOwnWorkers; worker < kOwnWorkers + kRemoteWorkers; ++worker)
      learner_.reclaim_sim_worker(worker);
  }

  /// One slab of each environment that gets one. Lengths differ, so that decisions are counted and not slabs.
  void play() {
    const int envs = player_.shape().env_count();
    for (int env = 0; env < envs; ++env) {
      const int worker = env / player_.shape().envs_per_worker;
      const auto slab = player_.slabs().acquire(worker);
      if (!slab) return;
      shm::SlabHeader& header = player_.slabs().header(static_cast<int>(*slab));
      const uint64_t rollout = rollouts_[env]++;
      header.env_index = static_cast<uint32_t>(env);
      header.length = 1 + static_cast<uint32_t>(rollout + static_cast<uint64_t>(env)) % 8;
      header.rollout_index = rollout;
      header.first_episode = {.episode_id = rollout, .episode_seed = rollout * 1000};
      const SlabView view = player_.slabs().view(static_cast<int>(*slab));
      std::memset(view.at<std::byte>(0), 0, static_cast<std::size_t>(view.offsets().slab_bytes));
      std::memset(view.frames(0).data(), mark(env, rollout), view.frames(0).size() * 9);
      for (int step = 0; step < 8; ++step) view.final_index(step) = -1, view.valid(step) = 1;
      player_.sim_counters(worker).decisions.fetch_add(header.length * 2);
      played_ += header.length * 2;
      player_.slabs().seal(*slab);
    }
  }
  static int mark(int env, uint64_t rollout) { return 1 + (env * 31 + static_cast<int>(rollout) * 7) % 250; }

  /// Takes what arrived, and checks it.
  void learn(int most = 1 << 20) {
    for (const uint32_t slab : learner_.slabs().drain(most)) {
      const shm::SlabHeader& header = learner_.slabs().header(static_cast<int>(slab));
      const int env = static_cast<int>(header.env_index) - kOwnWorkers * learner_.shape().envs_per_worker;
      ASSERT_GE(env, 0);
      const uint64_t rollout = header.first_episode.episode_id;
      ++times_learned_[{env, rollout}];
      if (learned_rollouts_.contains(env)) {
        EXPECT_EQ(header.rollout_index, learned_rollouts_[env] + 1) << "this arena's own count has no gap";
        EXPECT_GT(rollout, last_rollout_[env]) << "in the order of sealing";
      }
      learned_rollouts_[env] = header.rollout_index;
      last_rollout_[env] = rollout;
      EXPECT_EQ(header.first_episode.episode_seed, rollout * 1000);
      const SlabView view = learner_.slabs().view(static_cast<int>(slab));
      EXPECT_EQ(view.frame(8, 1)[10], mark(env, rollout));
      learned_ += header.length * 2;
      learner_.slabs().release(slab);
    }
  }
  static bool eventually(const std::function<bool()>& done) {
    return test::wait_until(done, test::kPatienceSeconds, 5000);
  }
  /// Plays and learns until `rollouts` of every environment are played, and then until all are learned.
  void play_and_learn(uint64_t rollouts) {
    EXPECT_TRUE(eventually([&] {
      if (rollouts_[player_.shape().env_count() - 1] < rollouts) play();
      learn();
      return rollouts_[player_.shape().env_count() - 1] >= rollouts && learned_ == played_;
    })) << learned_
        << " of " << played_ << " decisions learned";
  }
  void expect_exactly_once() {
    EXPECT_EQ(learned_, played_);
    for (const auto& [slab, times] : times_learned_)
      EXPECT_EQ(times, 1) << "environment " << slab.first << " rollout " << slab.second;
    uint64_t slabs = 0;
    for (const auto& [env, count] : rollouts_) slabs += count;
    EXPECT_EQ(times_learned_.size(), slabs);
  }

  const uint64_t link_id_ = fresh_id();
  shm::Arena player_ = make_arena(2, 24),
             learner_ = make_arena(kOwnWorkers + kRemoteWorkers, 12, kRemoteWorkers);
  std::unique_ptr<test::NetworkPair> network_;
  pid_t sender_ = -1, receiver_ = -1;
  std::map<int, uint64_t> rollouts_, learned_rollouts_, last_rollout_;
  std::map<std::pair<int, uint64_t>, int> times_learned_;
  uint64_t played_ = 0, learned_ = 0;
};

TEST_F(Link, WhatIsPlayedOnOneHostIsLearnedOnTheOtherToTheDecision) {
  start_receiver();
  start_sender();
  play_and_learn(20);
  expect_exactly_once();
  EXPECT_TRUE(eventually([&] { return player_.learner_counters().decisions == played_; }))
      << "the feeding host records what became of it";
  uint64_t counted = 0;
  for (int worker = kOwnWorkers; worker < kOwnWorkers + kRemoteWorkers; ++worker)
    counted += learner_.sim_counters(worker).decisions;
  EXPECT_EQ(counted, played_);
  EXPECT_EQ(player_.slabs().drain(100).size(), 0u);
}

TEST_F(Link, WithoutAFreeSlabNothingIsSentAndNothingIsLost) {
  start_receiver();
  start_sender();
  // Without a learner: the learner's arena has room for what is promised, and then the feeding host's fills up.
  EXPECT_TRUE(eventually([&] {
    play();
    return learner_.slabs().sealed_count() == learner_.shape().slab_count && !player_.slabs().acquire(0);
  })) << learner_.slabs().sealed_count();
  EXPECT_FALSE(
      test::wait_until([&] { return learner_.slabs().sealed_count() != learner_.shape().slab_count; }, 0.3));
  EXPECT_EQ(learned_, 0u);
  EXPECT_TRUE(eventually([&] {
    learn(2);
    return learned_ == played_;
  }));
  expect_exactly_once();
}

TEST_F(Link, EndsThatAreKilledLoseNothingAndSendNothingTwice) {
  start_receiver();
  start_sender();
  const uint64_t seed = 20261124;
  Rng rng(seed);
  for (uint64_t round = 1; round <= 6; ++round) {
    const uint64_t goal = learned_ + 40;
    ASSERT_TRUE(eventually([&] {
      play();
      learn(3);
      return learned_ >= goal;
    })) << "round "
        << round;
    usleep(rng.below(20'000));
    if (round % 2 == 0) {
      kill_end(sender_);
      start_sender();
    } else {
      kill_end(receiver_);
      reclaim_receiver();
      start_receiver();
    }
  }
  play_and_learn(rollouts_[0] + 2);
  expect_exactly_once();
}

TEST_F(Link, AReceiverThatStandsStillForAWhileContinuesWhereItWas) {
  start_receiver();
  start_sender();
  play_and_learn(2);
  kill(receiver_, SIGSTOP);
  const double stopped_s = monotonic_s();
  while (monotonic_s() - stopped_s < 4) play(), usleep(10'000);
  kill(receiver_, SIGCONT);
  play_and_learn(rollouts_[0] + 2);
  expect_exactly_once();
}

using LinkLong = Link;
TEST_F(LinkLong, ACableThatIsPulledForTwelveSecondsCostsNoDecision) {
  network_ = std::make_unique<test::NetworkPair>(3);
  if (!network_->is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  start_receiver();
  start_sender();
  play_and_learn(3);
  ASSERT_TRUE(network_->set_up(false));
  const double pulled_s = monotonic_s();
  while (monotonic_s() - pulled_s < 12)
    play(), learn(), usleep(10'000);  // longer than DDS takes a peer for alive
  EXPECT_LT(learned_, played_);
  ASSERT_TRUE(network_->set_up(true));
  play_and_learn(rollouts_[0] + 3);
  expect_exactly_once();
}

TEST_F(Link, WeightsAndTheRunsEnvFramesReachTheFeedingHost) {
  std::vector<std::byte> weights(4000, std::byte{3});
  learner_.weights().publish(weights, 5);
  learner_.control().schedule_env_frames = 2'400'000;
  start_receiver();
  start_sender();
  ASSERT_TRUE(eventually([&] { return player_.weights().has_any() && player_.weights().version() == 5; }));
  std::vector<std::byte> arrived;
  ASSERT_TRUE(player_.weights().read(arrived));
  EXPECT_EQ(arrived, weights);
  EXPECT_TRUE(eventually([&] { return player_.control().schedule_env_frames == 2'400'000; }));
  weights[17] = std::byte{9};
  learner_.weights().publish(weights, 6);
  ASSERT_TRUE(eventually([&] { return player_.weights().version() == 6; }));
  ASSERT_TRUE(player_.weights().read(arrived));
  EXPECT_EQ(arrived, weights);
}

TEST_F(Link, RoundedWeightsArriveWithTheSameBytesInEveryVersion) {
  constexpr std::size_t kParameters = 700, kStatistics = 100;
  std::vector<float> parameters(kParameters, 1.0f / 3);
  const std::vector<double> statistics(kStatistics, 1.0 / 3);
  std::vector<std::byte> weights(kParameters * sizeof(float) + kStatistics * sizeof(double)), arrived;
  start_receiver(kParameters);
  start_sender();
  for (const uint32_t version : {5u, 6u}) {
    parameters[0] = static_cast<float>(version);
    std::memcpy(weights.data(), parameters.data(), kParameters * sizeof(float));
    std::memcpy(weights.data() + kParameters * sizeof(float), statistics.data(),
                kStatistics * sizeof(double));
    learner_.weights().publish(weights, version);
    ASSERT_TRUE(
        eventually([&] { return player_.weights().has_any() && player_.weights().version() == version; }));
    ASSERT_TRUE(player_.weights().read(arrived));
    ASSERT_EQ(arrived.size(), weights.size());
    float first = 0, third = 0;
    double statistic = 0;
    std::memcpy(&first, arrived.data(), sizeof first);
    std::memcpy(&third, arrived.data() + sizeof first, sizeof third);
    std::memcpy(&statistic, arrived.data() + arrived.size() - sizeof statistic, sizeof statistic);
    EXPECT_EQ(first, static_cast<float>(version));
    EXPECT_EQ(third, 0.333984375f);  // 1/3 in bfloat16
    EXPECT_EQ(statistic, static_cast<double>(static_cast<float>(1.0 / 3)));
  }
}

TEST_F(Link, EpisodesOfTheOtherHostAreThisHostsEpisodes) {
  start_receiver();
  start_sender();
  play_and_learn(1);
  EpisodeRecord record{};
  record.env_index = 5;
  record.episode_id = 9;
  record.score = 12.5f;
  record.agent_return[1] = 2;
  record.agent_count = 2;
  record.layout_index = 3;
  player_.episodes().write(record);
  std::optional<EpisodeRecord> heard;
  ASSERT_TRUE(eventually(
      [&] { return (heard = learner_.episodes().read(shm::EpisodeReader::kCurriculum)).has_value(); }));
  EXPECT_EQ(heard->env_index, 5u + kOwnWorkers * 4);
  EXPECT_EQ(heard->episode_id, 9u);
  EXPECT_EQ(heard->layout_index, kNoLayoutIndex) << "that host has drawn it";
  EXPECT_EQ(heard->score, 12.5f);
  EXPECT_EQ(heard->agent_return[1], 2);
}

TEST_F(Link, AnotherGameIsRefused) {
  start_receiver();
  start_sender(/*fingerprint=*/1234);
  EXPECT_EQ(exit_code_of(sender_), kRefusedExit);
}

TEST_F(Link, AHostWithMoreSimulatorsThanPlacesIsRefused) {
  player_ = make_arena(kRemoteWorkers + 1, 8);
  start_receiver();
  start_sender();
  EXPECT_EQ(exit_code_of(sender_), kRefusedExit);
}

TEST_F(Link, ARunThatEndsInformsItsSenders) {
  start_receiver();
  start_sender();
  play_and_learn(1);
  learner_.control().run_state = shm::RunState::kStopping;
  EXPECT_EQ(exit_code_of(sender_), kEndedExit);
  EXPECT_EQ(exit_code_of(receiver_), 0);
  EXPECT_EQ(learner_.slabs().sealed_count(), 0);
  for (int slab = 0; slab < learner_.shape().slab_count; ++slab)
    EXPECT_EQ(learner_.slabs().header(slab).state.load(), shm::SlabState::kFree) << "slab " << slab;
}

TEST_F(Link, AHostThatLeavesDeliversWhatIsSealedAndItsPlacesAreFree) {
  start_receiver();
  start_sender();
  play_and_learn(1);
  play();
  player_.control().run_state = shm::RunState::kStopping;
  ASSERT_TRUE(eventually([&] {
    learn();
    return learned_ == played_;
  }));
  EXPECT_EQ(exit_code_of(sender_), 0);
  expect_exactly_once();
  // Another host of as many simulators as there are places.
  player_ = make_arena(kRemoteWorkers, 24);
  rollouts_.clear(), times_learned_.clear(), last_rollout_.clear(), learned_rollouts_.clear();
  played_ = learned_ = 0;
  start_sender();
  play_and_learn(2);
  expect_exactly_once();
}

TEST_F(Link, WithoutTheLearnersHostAFeedingHostGivesUpInTime) {
  start_sender(fingerprint_of(small_offer()), /*patience_s=*/1);
  EXPECT_EQ(exit_code_of(sender_), kSilentExit);
}

}  // namespace link_test
}  // namespace comrad::link
