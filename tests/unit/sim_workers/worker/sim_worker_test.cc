#include "sim_workers/worker/sim_worker.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/layout_mailbox.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <thread>

#include "tests/support/allocation_count.h"
#include "tests/support/fake_policy.h"
#include "tests/support/patience.h"
#include "tests/support/small_arena.h"
#include "tests/support/toy_environment.h"

namespace comrad::sim {
namespace sim_worker_test {

using shm::Arena;
using shm::ArenaShape;
using shm::SlabState;
using test::FakePolicy;
using test::small_arena_shape;
using test::ToyEnvironment;
using test::ToyEnvironmentSet;
using test::ToyOptions;
using ::testing::HasSubstr;

constexpr uint64_t kSeed = 42;

ToyOptions toy(uint32_t min_length, uint32_t max_length, double truncated_share = 0.5) {
  return {.shape = small_arena_shape().trajectory.env,
          .min_length = min_length,
          .max_length = max_length,
          .truncated_share = truncated_share};
}

uint64_t training_seed(int env, uint64_t episode_id) {
  return RngKey(kSeed).split("episode").split(static_cast<uint64_t>(env)).split(episode_id).bits();
}

/// One simulator in a thread, with its environments.
class RunningWorker {
 public:
  RunningWorker(const Arena& arena, const ToyOptions& options, int index, const PortRules& rules)
      : environments(options, arena.shape().envs_per_worker) {
    Expected<std::unique_ptr<SimWorker>> made =
        SimWorker::create(environments, arena, {.worker_index = index, .rules = rules});
    EXPECT_TRUE(made) << made.error().message;
    worker_ = *std::move(made);
  }
  ~RunningWorker() { stop(); }
  void start() {
    thread_ = std::thread([this] { status = worker_->run(stop_); });
  }
  void stop() {
    stop_ = true;
    join();
  }
  void join() {
    if (thread_.joinable()) thread_.join();
  }

  ToyEnvironmentSet environments;
  Status status;

 private:
  std::unique_ptr<SimWorker> worker_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// A whole host without a learner: arena, simulators, one fake policy worker.
struct Host {
  Host(const ArenaShape& shape, const ToyOptions& options, bool lock_step = false,
       PortRules rules = {.seed = kSeed})
      : arena(*Arena::create(shape, 1)), policy(arena, 0, lock_step) {
    for (int index = 0; index < shape.sim_worker_count; ++index)
      workers.push_back(std::make_unique<RunningWorker>(arena, options, index, rules));
  }
  void start(uint64_t rollouts_allowed = UINT64_MAX) {
    arena.control().rollouts_allowed = rollouts_allowed;
    arena.control().run_state = shm::RunState::kRunning;
    shm::ring(arena.control().run_state_changed);
    for (auto& worker : workers) worker->start();
  }
  void stop() {
    arena.control().run_state = shm::RunState::kStopping;
    shm::ring(arena.control().run_state_changed);
    for (auto& worker : workers) worker->join();
  }
  void allow(uint64_t rollouts) {
    arena.control().rollouts_allowed = rollouts;
    shm::ring(arena.control().slab_released);
  }
  /// Waits until `condition` holds.
  void await(const std::function<bool()>& condition, const char* what) const {
    ASSERT_TRUE(test::wait_until(condition, test::kPatienceSeconds, 200)) << what;
  }
  /// Waits until all simulators sleep at the same doorbell.
  void await_sleepers(const shm::Doorbell& doorbell) const {
    await([&] { return doorbell.sleepers.load() == workers.size(); }, "all simulators asleep");
  }
  /// Waits until every simulator has waited in vain and looked again, twice.
  void await_looks_in_vain() const {
    for (std::size_t worker = 0; worker < workers.size(); ++worker)
      for (int look = 0; look < 2; ++look) {
        const auto& waited_ns = arena.sim_counters(static_cast<int>(worker)).wait_ns;
        const uint64_t before = waited_ns.load();
        await([&] { return waited_ns.load() > before; }, "a look in vain");
      }
  }
  ~Host() { stop(); }

  Arena arena;
  std::vector<std::unique_ptr<RunningWorker>> workers;
  FakePolicy policy;  // last: stops first
};

/// Replays what an environment did from the actions in its slabs and compares every byte that the
/// simulator wrote.
class Shadow {
 public:
  Shadow(int env, const ToyOptions& options, RewardRules rules) : env_(env), rules_(rules), world_(options) {
    world_.reset(training_seed(env_, 0));
  }

  void check(const Arena& arena, uint32_t slab_index) {
    const shm::SlabHeader& header = arena.slabs().header(static_cast<int>(slab_index));
    const SlabView slab = arena.slabs().view(static_cast<int>(slab_index));
    const int steps = slab.shape().rollout_steps, capacity = slab.shape().final_capacity;
    const std::size_t agents = static_cast<std::size_t>(slab.shape().env.num_agents);
    ASSERT_EQ(header.env_index, static_cast<uint32_t>(env_));
    ASSERT_EQ(header.rollout_index, rollout_index_++) << "no rollout is skipped";
    EXPECT_EQ(header.layout_id, 77u);
    EXPECT_EQ(header.first_episode.episode_id, episode_id_);
    EXPECT_EQ(header.first_episode.episode_seed, training_seed(env_, episode_id_));
    int finals = 0;
    const int length = static_cast<int>(header.length);
    ASSERT_GE(length, 1);
    for (int agent = 0; agent < static_cast<int>(agents); ++agent)
      EXPECT_EQ(slab.recurrent_state(0, agent)[0], static_cast<float>(episode_step_))
          << "the state before row 0";
    for (int step = 0; step < length; ++step) {
      check_row(slab, step);
      for (int agent = 0; agent < static_cast<int>(agents); ++agent) {
        EXPECT_EQ(slab.policy_version(step, agent), episode_step_)
            << "the slot contained the decision's number";
        EXPECT_EQ(slab.value(step, agent),
                  test::fake_value(slab.frame(step, agent), static_cast<float>(episode_step_)));
      }
      world_.step({slab.action(step, 0).data(), agents * slab.action(step, 0).size()});
      ++episode_step_;
      const Step& last = world_.last_step();
      std::vector<float> reward(agents);
      shape_rewards(last.reward, rules_, reward);
      for (std::size_t agent = 0; agent < agents; ++agent)
        EXPECT_EQ(slab.reward(step, static_cast<int>(agent)), reward[agent]);
      EXPECT_EQ(slab.terminated(step), last.terminated);
      EXPECT_EQ(slab.truncated(step), last.truncated);
      EXPECT_EQ(slab.valid(step), 1);
      if (!last.episode_over()) {
        EXPECT_EQ(slab.final_index(step), -1);
        continue;
      }
      ASSERT_EQ(slab.final_index(step), finals);
      check_final(slab, finals++, last.truncated);
      ++episodes_;
      world_.reset(training_seed(env_, ++episode_id_));
      episode_step_ = 0;
    }
    check_row(slab, length);
    for (int agent = 0; agent < static_cast<int>(agents); ++agent)
      EXPECT_EQ(slab.value(length, agent),
                test::fake_value(slab.frame(length, agent), static_cast<float>(episode_step_)));
    EXPECT_TRUE(length == steps || finals == capacity) << "sealed early only where the finals ran out";
    for (int step = length; step < steps; ++step) {
      EXPECT_EQ(slab.valid(step), 0);
      EXPECT_EQ(slab.reward(step, 0), 0.0f);
      EXPECT_EQ(slab.terminated(step) + slab.truncated(step), 0);
      EXPECT_EQ(slab.final_index(step), -1);
      EXPECT_EQ(slab.action(step, 0)[0], slab.action(length - 1, 0)[0])
          << "nothing of an older rollout stays";
      check_row(slab, step + 1);
    }
    rows_ += length;
    early_ += length < steps;
    most_finals_ = std::max(most_finals_, finals);
  }

  int episodes() const { return episodes_; }
  int rows() const { return rows_; }
  int early() const { return early_; }
  int most_finals() const { return most_finals_; }
  uint64_t rollouts() const { return rollout_index_; }

 private:
  struct Observation {
    explicit Observation(const EnvShape& shape)
        : frame(static_cast<std::size_t>(shape.frame_bytes() * shape.num_agents)),
          mask(static_cast<std::size_t>(shape.logit_count() * shape.num_agents)),
          active(static_cast<std::size_t>(shape.num_agents)),
          measurement(static_cast<std::size_t>(shape.measurement_count * shape.num_agents)),
          global_state(static_cast<std::size_t>(shape.global_state_count)) {}
    std::vector<uint8_t> frame, mask, active;
    std::vector<float> measurement, global_state;
  };

  Observation observe() const {
    Observation seen(world_.shape());
    world_.observe({seen.frame.data(), seen.measurement.data(), seen.mask.data(), seen.active.data(),
                    seen.global_state.data()});
    return seen;
  }

  void check_row(const SlabView& slab, int step) const {
    const Observation seen = observe();
    EXPECT_EQ(std::memcmp(slab.frames(step).data(), seen.frame.data(), seen.frame.size()), 0)
        << "frame of environment " << env_ << ", rollout " << rollout_index_ - 1 << ", row " << step;
    EXPECT_EQ(
        std::memcmp(slab.measurement(step, 0).data(), seen.measurement.data(), 4 * seen.measurement.size()),
        0);
    EXPECT_EQ(std::memcmp(slab.action_mask(step, 0).data(), seen.mask.data(), seen.mask.size()), 0);
    EXPECT_EQ(std::memcmp(&slab.agent_active(step, 0), seen.active.data(), seen.active.size()), 0);
    EXPECT_TRUE(std::ranges::equal(slab.global_state(step), seen.global_state));
  }

  void check_final(const SlabView& slab, int row, bool truncated) const {
    const Observation seen = observe();
    EXPECT_EQ(std::memcmp(slab.final_frame(row, 0).data(), seen.frame.data(), seen.frame.size()), 0);
    EXPECT_EQ(std::memcmp(slab.final_measurement(row, 0).data(), seen.measurement.data(),
                          4 * seen.measurement.size()),
              0);
    EXPECT_TRUE(std::ranges::equal(slab.final_global_state(row), seen.global_state));
    for (int agent = 0; agent < slab.shape().env.num_agents; ++agent)
      EXPECT_EQ(slab.final_value(row, agent),
                truncated ? test::fake_value(slab.final_frame(row, agent), static_cast<float>(episode_step_))
                          : 0.0f)
          << "a true end is worth nothing, a cut-off one the policy's value with its state kept";
  }

  const int env_;
  const RewardRules rules_;
  ToyEnvironment world_;
  uint64_t rollout_index_ = 0, episode_id_ = 0;
  uint32_t episode_step_ = 0;
  int episodes_ = 0, rows_ = 0, early_ = 0, most_finals_ = 0;
};

/// Drains, checks and releases until every environment has sealed `rollouts` slabs.
std::vector<Shadow> check_rollouts(Host& host, const ToyOptions& options, uint64_t rollouts,
                                   RewardRules rules = {}) {
  std::vector<Shadow> shadows;
  for (int env = 0; env < host.arena.shape().env_count(); ++env) shadows.emplace_back(env, options, rules);
  const double deadline_s = test::deadline_s();
  const auto is_done = [&] {
    return std::all_of(shadows.begin(), shadows.end(),
                       [&](const Shadow& shadow) { return shadow.rollouts() >= rollouts; });
  };
  while (!is_done() && !::testing::Test::HasFailure()) {
    if (monotonic_s() > deadline_s) {
      ADD_FAILURE() << "the simulators stopped making progress";
      break;
    }
    const uint32_t heard = shm::listen(host.arena.control().slab_sealed);
    const std::vector<uint32_t> drained = host.arena.slabs().drain(4);
    for (const uint32_t slab : drained) {
      shadows[host.arena.slabs().header(static_cast<int>(slab)).env_index].check(host.arena, slab);
      host.arena.slabs().release(slab);
    }
    if (drained.empty()) shm::wait(host.arena.control().slab_sealed, heard, 20'000);
  }
  EXPECT_EQ(host.policy.faults(), 0);
  return shadows;
}

int sum(const std::vector<Shadow>& shadows, int (Shadow::*number)() const) {
  int total = 0;
  for (const Shadow& shadow : shadows) total += (shadow.*number)();
  return total;
}

TEST(SimWorker, EveryRowOfEverySlabIsWhatTheEnvironmentShowed) {
  const ToyOptions options = toy(1, 30);
  Host host(small_arena_shape(), options);
  host.start();
  const std::vector<Shadow> shadows = check_rollouts(host, options, 40);
  EXPECT_GT(sum(shadows, &Shadow::episodes), 50);
}

TEST(SimWorker, SeveralEpisodesEndInsideOneSlab) {
  const ToyOptions options = toy(2, 4);
  Host host(small_arena_shape(), options);
  host.start();
  const std::vector<Shadow> shadows = check_rollouts(host, options, 30);
  int most = 0;
  for (const Shadow& shadow : shadows) most = std::max(most, shadow.most_finals());
  EXPECT_GE(most, 3);
}

TEST(SimWorker, ASlabIsSealedEarlyWhenItsFinalsRunOut) {
  for (const double truncated_share : {0.0, 0.5, 1.0}) {
    const ToyOptions options = toy(1, 1, truncated_share);
    ArenaShape shape = small_arena_shape();
    shape.trajectory.final_capacity = 3;
    Host host(shape, options);
    host.start();
    const std::vector<Shadow> shadows = check_rollouts(host, options, 20);
    EXPECT_EQ(sum(shadows, &Shadow::rows), 3 * sum(shadows, &Shadow::early))
        << "three decisions, three ends, each time";
  }
}

TEST(SimWorker, AnEpisodeThatEndsOnTheLastRowIsClosedAndValued) {
  for (const double truncated_share : {0.0, 1.0}) {
    const ToyOptions options = toy(8, 8, truncated_share);  // exactly one rollout
    Host host(small_arena_shape(), options);
    host.start();
    const std::vector<Shadow> shadows = check_rollouts(host, options, 10);
    EXPECT_EQ(sum(shadows, &Shadow::episodes), sum(shadows, &Shadow::rows) / 8);
  }
}

TEST(SimWorker, FewSlabsParkEnvironmentsButStarveNone) {
  const ToyOptions options = toy(1, 30);
  ArenaShape shape = small_arena_shape();
  shape.slab_count = 3;  // for eight environments
  Host host(shape, options);
  host.start();
  check_rollouts(host, options, 12);
}

TEST(SimWorker, WithoutFreeSlabsItWaitsAndContinuesWhenOneComes) {
  ArenaShape shape = small_arena_shape();
  shape.slab_count = 8;
  const ToyOptions options = toy(100, 100);
  Host host(shape, options);
  host.start();
  host.await([&] { return host.arena.slabs().sealed_count() == 8; }, "all slabs sealed");
  const uint64_t answers = host.policy.answers();
  host.await_looks_in_vain();
  EXPECT_EQ(host.policy.answers(), answers) << "no agent acts without a slab";
  check_rollouts(host, options, 3);
}

TEST(SimWorker, RewardsAreSharedScaledAndClippedOnTheWay) {
  const RewardRules rules{.share = 0.25f, .share_is_mean = true, .scale = 2.0f, .clip = 7.0f};
  const ToyOptions options = toy(3, 9);
  Host host(small_arena_shape(), options, false, {.seed = kSeed, .rewards = rules});
  host.start();
  check_rollouts(host, options, 10, rules);
}

TEST(SimWorker, OneSplitWorksLikeTwo) {
  ArenaShape shape = small_arena_shape();
  shape.splits_per_worker = 1;
  const ToyOptions options = toy(1, 12);
  Host host(shape, options);
  host.start();
  check_rollouts(host, options, 10);
}

TEST(SimWorker, EpisodeRecordsTellTheRawReturnAndTheScore) {
  const ToyOptions options = toy(5, 5, 0.0);
  ArenaShape shape = small_arena_shape();
  shape.sim_worker_count =
      1;  // alone, so that no other simulator takes all slabs before environment 0 has its first
  Host host(shape, options, false, {.seed = kSeed, .rewards = {.scale = 10.0f}});
  host.start();
  // Replay environment 0's first episode from its first slab.
  ToyEnvironment world(options);
  world.reset(training_seed(0, 0));
  std::optional<EpisodeRecord> record;
  host.await(
      [&] {
        for (int slab = 0; slab < host.arena.shape().slab_count; ++slab) {
          const shm::SlabHeader& header = host.arena.slabs().header(slab);
          if (header.state.load() == SlabState::kSealed && header.env_index == 0 && header.rollout_index == 0)
            return true;
        }
        return false;
      },
      "environment 0's first slab");
  while ((record = host.arena.episodes().read(shm::EpisodeReader::kSupervisor)) &&
         !(record->env_index == 0 && record->episode_id == 0)) {
  }
  ASSERT_TRUE(record);
  for (const uint32_t slab_index : host.arena.slabs().drain(100)) {
    if (host.arena.slabs().header(static_cast<int>(slab_index)).env_index != 0 ||
        host.arena.slabs().header(static_cast<int>(slab_index)).rollout_index != 0)
      continue;
    const SlabView slab = host.arena.slabs().view(static_cast<int>(slab_index));
    for (int step = 0; step < 5; ++step) world.step({slab.action(step, 0).data(), 4});
  }
  EXPECT_EQ(record->episode_seed, training_seed(0, 0));
  EXPECT_EQ(record->layout_id, 77u);
  EXPECT_EQ(record->length_steps, 5u);
  EXPECT_EQ(record->length_tics, 20u);
  EXPECT_EQ(record->terminated, 1u);
  EXPECT_EQ(record->score, world.summary().score);
  for (std::size_t agent = 0; agent < 2; ++agent) {
    EXPECT_EQ(record->agent_return[agent], world.summary().agent_return[agent]);
    EXPECT_EQ(record->agent_score[agent], world.summary().agent_score[agent]);
  }
}

TEST(SimWorker, LockStepPassesTheGateOncePerRollout) {
  const ToyOptions options = toy(1, 20);
  Host host(small_arena_shape(), options, /*lock_step=*/true);
  host.start(0);
  host.await_sleepers(host.arena.control().slab_released);
  EXPECT_EQ(host.policy.answers(), 0u) << "the gate is shut until the learner opens it";
  std::vector<Shadow> shadows;
  for (int env = 0; env < 8; ++env) shadows.emplace_back(env, options, RewardRules{});
  for (uint64_t rollout = 0; rollout < 6; ++rollout) {
    host.allow(rollout + 1);
    host.await([&] { return host.arena.slabs().sealed_count() == 8; }, "one slab of every environment");
    const uint64_t answers = host.policy.answers();
    host.await_looks_in_vain();
    EXPECT_EQ(host.policy.answers(), answers) << "no agent runs ahead";
    for (const uint32_t slab : host.arena.slabs().drain(100)) {
      EXPECT_EQ(host.arena.slabs().header(static_cast<int>(slab)).rollout_index, rollout);
      shadows[host.arena.slabs().header(static_cast<int>(slab)).env_index].check(host.arena, slab);
      host.arena.slabs().release(slab);
    }
  }
  EXPECT_EQ(host.policy.faults(), 0);
}

TEST(SimWorker, EveryTrajectoryBeginsWithTheEnvFramesOfTheRun) {
  Host host(small_arena_shape(), toy(1, 20), /*lock_step=*/true);
  const auto told = [&](uint64_t env_frames) {
    return [&host, env_frames] {
      for (const auto& worker : host.workers)
        for (int env = 0; env < worker->environments.size(); ++env)
          if (worker->environments.at(env).env_frames() != env_frames) return false;
      return true;
    };
  };
  host.arena.control().schedule_env_frames = 1000;
  host.start(/*rollouts_allowed=*/1);
  host.await([&] { return host.arena.slabs().sealed_count() == 8; }, "one slab of every environment");
  host.arena.control().schedule_env_frames = 2000;
  host.await_looks_in_vain();
  EXPECT_TRUE(told(1000)()) << "it holds until the next one";
  for (const uint32_t slab : host.arena.slabs().drain(100)) host.arena.slabs().release(slab);
  host.allow(2);
  host.await(told(2000), "the second trajectory's");
}

TEST(SimWorker, LockStepGivesTheSameBatchesEveryTime) {
  const ToyOptions options = toy(1, 20);
  const auto play = [&options] {
    ArenaShape shape = small_arena_shape();
    shape.sim_worker_count = 1;
    shape.splits_per_worker = 1;
    Host host(shape, options, /*lock_step=*/true);
    host.start(1);
    for (uint64_t rollout = 0; rollout < 8; ++rollout) {
      host.await([&] { return host.arena.slabs().sealed_count() == 4; }, "one slab of every environment");
      if (rollout % 2 == 1) usleep(5000);
      for (const uint32_t slab : host.arena.slabs().drain(100)) host.arena.slabs().release(slab);
      host.allow(rollout + 2);
    }
    host.await([&] { return host.arena.slabs().sealed_count() == 4; }, "the last rollout");
    host.stop();
    return host.policy.batch_sizes();
  };
  const std::vector<uint32_t> first = play();
  EXPECT_GT(first.size(), 60u);
  EXPECT_EQ(first, play());
}

TEST(SimWorker, EvaluationPlaysEveryEpisodeOnceAndGivesItsSlabsBack) {
  const ToyOptions options = toy(1, 25);
  Host host(small_arena_shape(), options, false, {.seed = kSeed, .evaluate = true});
  host.arena.control().episodes_per_run = 21;  // for eight environments
  host.start(0);                               // no learner, no gate
  std::map<uint64_t, EpisodeRecord> records;
  host.await(
      [&] {
        while (const auto record = host.arena.episodes().read(shm::EpisodeReader::kSupervisor)) {
          EXPECT_EQ(record->env_index, record->episode_id % 8);
          EXPECT_TRUE(records.emplace(record->episode_id, *record).second)
              << "episode " << record->episode_id << " twice";
        }
        return records.size() >= 21;
      },
      "all episodes");
  host.await_looks_in_vain();
  EXPECT_FALSE(host.arena.episodes().read(shm::EpisodeReader::kSupervisor));
  EXPECT_EQ(records.rbegin()->first, 20u);
  for (const auto& [id, record] : records) {
    EXPECT_EQ(record.episode_seed, RngKey(kSeed).split("evaluation").split(id).bits());
    // The toy's length follows from the seed, so a record that belongs to another episode shows.
    ToyEnvironment world(options);
    world.reset(record.episode_seed);
    const std::array<int32_t, 4> none{};
    do world.step(none);
    while (!world.last_step().episode_over());
    EXPECT_EQ(record.length_steps, world.summary().length_steps);
    EXPECT_EQ(record.terminated, world.last_step().terminated);
  }
  EXPECT_EQ(host.arena.slabs().sealed_count(), 0);
  host.await(
      [&] {
        for (int slab = 0; slab < host.arena.shape().slab_count; ++slab)
          if (host.arena.slabs().header(slab).state.load() != SlabState::kFree) return false;
        return true;
      },
      "all slabs free");
  EXPECT_EQ(host.policy.faults(), 0);
}

TEST(SimWorker, EvaluationWithFewerEpisodesThanEnvironmentsOrSlabsEnds) {
  ArenaShape shape = small_arena_shape();
  shape.slab_count = 2;
  const ToyOptions options = toy(1, 25);
  Host host(shape, options, false, {.seed = kSeed, .evaluate = true});
  host.arena.control().episodes_per_run = 5;
  host.start(0);
  int count = 0;
  host.await(
      [&] {
        while (host.arena.episodes().read(shm::EpisodeReader::kSupervisor)) ++count;
        return count >= 5;
      },
      "all episodes");
}

TEST(SimWorker, AResumedJournalContinuesAsIfNothingHadHappened) {
  const ToyOptions options = toy(3, 40);
  ArenaShape shape = small_arena_shape();
  shape.trajectory.rollout_steps = 7;  // an odd number of decisions: the state's parity counts
  struct Sealed {
    std::vector<uint8_t> frames;
    std::vector<int32_t> actions;
    std::vector<float> values;
    bool operator==(const Sealed&) const = default;
  };
  const auto content_of = [](const Arena& arena, uint32_t index) {
    const SlabView slab = arena.slabs().view(static_cast<int>(index));
    Sealed sealed;
    for (int step = 0; step <= slab.shape().rollout_steps; ++step) {
      sealed.frames.insert(sealed.frames.end(), slab.frames(step).begin(), slab.frames(step).end());
      for (int agent = 0; agent < 2; ++agent) {
        sealed.values.push_back(slab.value(step, agent));
        if (step < slab.shape().rollout_steps)
          sealed.actions.insert(sealed.actions.end(), slab.action(step, agent).begin(),
                                slab.action(step, agent).end());
      }
    }
    return sealed;
  };
  const auto play_rollout = [&](Host& host, std::map<int, Sealed>& out) {
    host.await([&] { return host.arena.slabs().sealed_count() == 8; }, "one slab of every environment");
    for (const uint32_t slab : host.arena.slabs().drain(100)) {
      out[static_cast<int>(host.arena.slabs().header(static_cast<int>(slab)).env_index)] =
          content_of(host.arena, slab);
      host.arena.slabs().release(slab);
    }
  };

  // The uninterrupted run; a checkpoint is taken on the boundary after rollout 2.
  struct Saved {
    shm::JournalHeader header;
    std::vector<uint8_t> actions;
    std::vector<float> recurrent[2];
  };
  std::vector<Saved> checkpoint;
  std::map<int, Sealed> expected[3];
  {
    Host host(shape, options, /*lock_step=*/true);
    host.start(1);
    std::map<int, Sealed> ignored;
    for (uint64_t rollout = 0; rollout < 3; ++rollout) {
      play_rollout(host, ignored);
      if (rollout == 2) {
        for (int env = 0; env < 8; ++env) {
          Saved saved{host.arena.journals().header(env), {}, {}};
          ASSERT_LE(saved.header.length, 64u);
          EXPECT_EQ(saved.header.rollout_index, 3u);
          for (uint32_t step = 0; step < saved.header.length; ++step) {
            const auto action = host.arena.journals().action(env, static_cast<int>(step));
            saved.actions.insert(saved.actions.end(), action.begin(), action.end());
          }
          for (uint64_t parity = 0; parity < 2; ++parity)
            saved.recurrent[parity].assign(host.arena.step_slots().recurrent(env, parity).begin(),
                                           host.arena.step_slots().recurrent(env, parity).end());
          checkpoint.push_back(std::move(saved));
        }
      }
      host.allow(rollout + 2);
    }
    for (auto& rollout : expected) {
      play_rollout(host, rollout);
      host.allow(host.arena.control().rollouts_allowed + 1);
    }
  }
  ASSERT_TRUE(std::any_of(checkpoint.begin(), checkpoint.end(),
                          [](const Saved& saved) { return saved.header.length > 8; }));

  // The resumed one.
  Host host(shape, options, /*lock_step=*/true);
  for (int env = 0; env < 8; ++env) {
    const Saved& saved = checkpoint[static_cast<std::size_t>(env)];
    host.arena.journals().header(env) = saved.header;
    host.arena.journals().header(env).is_resume = 1;
    for (std::size_t index = 0; index < saved.actions.size(); ++index)
      host.arena.journals().action(env, static_cast<int>(index / 4))[index % 4] = saved.actions[index];
    for (uint64_t parity = 0; parity < 2; ++parity)
      std::copy(saved.recurrent[parity].begin(), saved.recurrent[parity].end(),
                host.arena.step_slots().recurrent(env, parity).begin());
  }
  host.start(4);
  for (const auto& rollout : expected) {
    std::map<int, Sealed> resumed;
    play_rollout(host, resumed);
    EXPECT_TRUE(resumed == rollout);
    host.allow(host.arena.control().rollouts_allowed + 1);
  }
  EXPECT_EQ(host.arena.journals().header(0).is_resume, 0u);
}

TEST(SimWorker, AJournalThatDoesNotFitTheEnvironmentIsRefused) {
  Host host(small_arena_shape(), toy(3, 3));
  host.arena.journals().header(2) = {.episode_seed = 5,
                                     .episode_id = 9,
                                     .step_id = 70,
                                     .rollout_index = 2,
                                     .length = 10,
                                     .is_resume = 1,
                                     .in_use = 0};
  host.start();
  host.workers[0]->join();
  ASSERT_FALSE(host.workers[0]->status);
  EXPECT_THAT(host.workers[0]->status.error().message, HasSubstr("journal of environment 2 does not replay"));
  host.stop();

  Host other(small_arena_shape(), toy(3, 3));
  other.arena.journals().header(0) = {.episode_seed = 5,
                                      .episode_id = 9,
                                      .step_id = 70,
                                      .rollout_index = 2,
                                      .length = 1000,
                                      .is_resume = 1,
                                      .in_use = 0};
  other.start();
  other.workers[0]->join();
  ASSERT_FALSE(other.workers[0]->status);
  EXPECT_THAT(other.workers[0]->status.error().message, HasSubstr("1000 decisions of at most 64"));
}

TEST(SimWorker, ARestartedWorkerNeverPlaysAnEpisodeTwice) {
  const ToyOptions options = toy(2, 9);
  Host host(small_arena_shape(), options);
  host.start();
  std::set<uint64_t> seeds;
  std::map<uint32_t, uint64_t> last_rollout;
  const auto drain = [&](std::size_t count) {
    std::size_t seen = 0;
    host.await(
        [&] {
          while (const auto record = host.arena.episodes().read(shm::EpisodeReader::kSupervisor))
            EXPECT_TRUE(seeds.insert(record->episode_seed).second) << "an episode came twice";
          for (const uint32_t slab : host.arena.slabs().drain(100)) {
            const shm::SlabHeader& header = host.arena.slabs().header(static_cast<int>(slab));
            const auto [entry, is_first] = last_rollout.emplace(header.env_index, 0);
            EXPECT_EQ(header.rollout_index, is_first ? 0 : entry->second + 1);
            entry->second = header.rollout_index;
            seen += header.env_index < 4;  // of the worker that is restarted
            host.arena.slabs().release(slab);
          }
          return seen >= count;
        },
        "slabs");
  };
  drain(40);
  for (int restart = 0; restart < 3; ++restart) {
    host.workers[0]->stop();  // leaves slabs in kFilling and slots under way, as a kill does
    host.workers[0] = std::make_unique<RunningWorker>(host.arena, options, 0, PortRules{.seed = kSeed});
    host.workers[0]->start();
    drain(40);
  }
  EXPECT_EQ(host.arena.sim_counters(0).epoch.load(), 4u);
}

TEST(SimWorker, StopsEvenWithoutAnAnswer) {
  const Arena arena = *Arena::create(small_arena_shape(), 1);
  arena.control().rollouts_allowed = UINT64_MAX;
  arena.control().run_state = shm::RunState::kRunning;
  RunningWorker worker(arena, toy(5, 5), 0, {.seed = kSeed});
  worker.start();
  ASSERT_TRUE(
      test::wait_until([&] { return arena.step_slots().slot(0).state.load() == shm::SlotState::kReady; }));
  arena.control().run_state = shm::RunState::kStopping;
  worker.join();
  EXPECT_TRUE(worker.status);
  EXPECT_EQ(arena.sim_counters(0).state.load(), shm::WorkerState::kStopped);
}

TEST(SimWorker, StopsWhileItWaitsForTheStart) {
  const Arena arena = *Arena::create(small_arena_shape(), 1);
  RunningWorker worker(arena, toy(5, 5), 0, {.seed = kSeed});
  worker.start();
  EXPECT_TRUE(test::wait_until([&] { return arena.control().run_state_changed.sleepers.load() == 1; }));
  EXPECT_EQ(arena.step_slots().slot(0).state.load(), shm::SlotState::kIdle);
  worker.stop();
  EXPECT_TRUE(worker.status);
}

TEST(SimWorker, APausedRunStandsStillAndContinues) {
  const ToyOptions options = toy(1, 30);
  Host host(small_arena_shape(), options);
  host.start();
  host.await([&] { return host.policy.answers() > 50; }, "a start");
  host.arena.control().run_state = shm::RunState::kPaused;
  host.await(
      [&] {  // what was asked before is still answered
        for (int env = 0; env < host.arena.shape().env_count(); ++env) {
          const shm::SlotState state = host.arena.step_slots().slot(env).state.load();
          if (state == shm::SlotState::kReady || state == shm::SlotState::kInBatch) return false;
        }
        return host.arena.control().run_state_changed.sleepers.load() == host.workers.size();
      },
      "a stand");
  const uint64_t answers = host.policy.answers();
  for (int split = 0; split < 2; ++split)
    for (int worker = 0; worker < 2; ++worker) shm::ring(host.arena.step_slots().acted(worker, split));
  host.await_sleepers(host.arena.control().run_state_changed);
  EXPECT_EQ(host.policy.answers(), answers);
  host.arena.control().run_state = shm::RunState::kRunning;
  shm::ring(host.arena.control().run_state_changed);
  check_rollouts(host, options, 10);
}

TEST(SimWorker, CountsAgentDecisions) {
  ArenaShape shape = small_arena_shape();
  shape.slab_count = 8;
  Host host(shape, toy(100, 100));
  host.start();
  host.await([&] { return host.arena.slabs().sealed_count() == 8; }, "all slabs sealed");
  host.stop();
  EXPECT_EQ(host.arena.sim_counters(0).decisions.load() + host.arena.sim_counters(1).decisions.load(),
            8u * 8u * 2u)
      << "slabs x rows x agents";
}

TEST(SimWorker, TheStepPathDoesNotAllocate) {
  const ToyOptions options = toy(1, 12);
  Host host(small_arena_shape(), options);
  uint64_t calls = 0, first = 0, last = 0;
  host.workers[0]->environments.on_observe = [&] {
    last = test::allocations_of_this_thread();
    if (++calls == 50) first = last;
  };
  host.start();
  check_rollouts(host, options, 40);
  host.stop();
  EXPECT_GT(calls, 300u);
  EXPECT_EQ(last - first, 0u);
}

TEST(SimWorker, RefusesEnvironmentsThatDoNotFitTheArena) {
  const Arena arena = *Arena::create(small_arena_shape(), 1);
  ToyOptions wrong = toy(1, 2);
  wrong.shape.head_sizes[1] = 3;
  ToyEnvironmentSet set(wrong, 4);
  const auto shape = SimWorker::create(set, arena, {});
  ASSERT_FALSE(shape);
  EXPECT_THAT(shape.error().message, HasSubstr("heads 3,3; the arena was made for 2 agents, frame 3x4x6"));
  wrong = toy(1, 2);
  wrong.shape.global_state_count = 4;
  ToyEnvironmentSet other_state(wrong, 4);
  const auto state = SimWorker::create(other_state, arena, {});
  ASSERT_FALSE(state);
  EXPECT_THAT(state.error().message, HasSubstr("4 numbers of global state"));
  ToyEnvironmentSet few(toy(1, 2), 3);
  const auto count = SimWorker::create(few, arena, {});
  ASSERT_FALSE(count);
  EXPECT_THAT(count.error().message, HasSubstr("made 3 environments"));
  ToyEnvironmentSet good(toy(1, 2), 4);
  EXPECT_FALSE(SimWorker::create(good, arena, {.worker_index = 2, .rules = {}}));
  EXPECT_TRUE(SimWorker::create(good, arena, {.worker_index = 1, .rules = {}}));
}

/// Assigns layouts by a rule, as the learner would, and collects what was played.
class LayoutClerk {
 public:
  explicit LayoutClerk(const Arena& arena) : arena_(arena) {}

  /// The k-th assignment of an environment is layout (env + k) % count.
  void serve(uint32_t count) {
    while (const auto record = arena_.episodes().read(shm::EpisodeReader::kCurriculum))
      layouts_played[static_cast<int>(record->env_index)].push_back(record->layout_index);
    for (int env = 0; env < arena_.shape().env_count(); ++env) {
      shm::LayoutMailbox& mailbox = arena_.layout_mailboxes().of(env);
      if (mailbox.is_due()) mailbox.assign((static_cast<uint32_t>(env) + mailbox.assigned.load()) % count);
    }
  }
  std::map<int, std::vector<uint32_t>> layouts_played;

 private:
  const Arena& arena_;
};

TEST(SimWorker, LayoutsComeFromTheMailboxEveryFewEpisodes) {
  ToyOptions options = toy(5, 5);
  options.layout_count = 3;
  ArenaShape shape = small_arena_shape();
  Host host(shape, options, /*lock_step=*/true, {.seed = kSeed, .layout_count = 3, .layout_swap_every = 2});
  LayoutClerk clerk(host.arena);
  clerk.serve(3);
  host.start(0);
  std::map<uint32_t, std::vector<int>> rows;  // layout of every decision of an environment
  for (uint64_t rollout = 0; rollout < 10; ++rollout) {
    host.allow(rollout + 1);
    host.await([&] { return host.arena.slabs().sealed_count() == 8; }, "one slab of every environment");
    for (const uint32_t index : host.arena.slabs().drain(100)) {
      const shm::SlabHeader& header = host.arena.slabs().header(static_cast<int>(index));
      for (int step = 0; step < static_cast<int>(header.length); ++step)
        rows[header.env_index].push_back(host.arena.slabs().view(static_cast<int>(index)).layout_index(step));
      host.arena.slabs().release(index);
    }
    clerk.serve(3);
  }
  ASSERT_EQ(rows.size(), 8u);
  for (const auto& [env, layouts] : rows) {
    ASSERT_EQ(layouts.size(), 80u);
    for (int decision = 0; decision < 80; ++decision)  // two episodes of five decisions on each grant
      ASSERT_EQ(layouts[static_cast<std::size_t>(decision)], (static_cast<int>(env) + decision / 10) % 3)
          << "environment " << env << ", decision " << decision;
    const auto& played = clerk.layouts_played[static_cast<int>(env)];
    ASSERT_GE(played.size(), 15u);
    for (std::size_t k = 0; k < played.size(); ++k)
      EXPECT_EQ(played[k], (env + k / 2) % 3) << "the episode is reported under the layout it was played on";
    EXPECT_EQ(host.arena.layout_mailboxes().of(static_cast<int>(env)).late.load(), 0u);
  }
}

TEST(SimWorker, WithoutANewAssignmentTheLayoutIsPlayedOnceMore) {
  ToyOptions options = toy(4, 4);
  options.layout_count = 2;
  ArenaShape shape = small_arena_shape();
  shape.sim_worker_count = 1;
  Host host(shape, options, true, {.seed = kSeed, .layout_count = 2, .layout_swap_every = 1});
  LayoutClerk clerk(host.arena);
  clerk.serve(2);  // once and never again
  host.start(3);
  host.await([&] { return host.arena.slabs().sealed_count() == 12; }, "three rollouts of four environments");
  for (const uint32_t index : host.arena.slabs().drain(100)) {
    const shm::SlabHeader& header = host.arena.slabs().header(static_cast<int>(index));
    for (int step = 0; step < 8; ++step)
      EXPECT_EQ(host.arena.slabs().view(static_cast<int>(index)).layout_index(step),
                static_cast<int>(header.env_index % 2));
  }
  EXPECT_GE(host.arena.layout_mailboxes().of(0).late.load(), 5u);
}

TEST(SimWorker, ALayoutThatCannotBeLoadedEndsTheWorkerWithItsWords) {
  ToyOptions options = toy(3, 3);
  options.layout_count = 2;
  options.broken_layout = 1;
  ArenaShape shape = small_arena_shape();
  shape.sim_worker_count = 1;
  Host host(shape, options, false, {.seed = kSeed, .layout_count = 2, .layout_swap_every = 1});
  for (int env = 0; env < shape.env_count(); ++env) host.arena.layout_mailboxes().of(env).assigned = 1;
  host.start(1);
  host.await([&] { return host.arena.layout_mailboxes().of(0).taken.load() == 1; },
             "the first grant is taken");
  for (int env = 0; env < shape.env_count(); ++env) {
    host.arena.layout_mailboxes().of(env).layout_index = 1;
    host.arena.layout_mailboxes().of(env).assigned = 2;
  }
  host.allow(5);
  host.workers[0]->join();
  ASSERT_FALSE(host.workers[0]->status);
  EXPECT_THAT(host.workers[0]->status.error().message, HasSubstr("toy layout 1 is not there"));
}

TEST(SimWorker, EvaluationPlaysTheLayoutsInTurn) {
  ToyOptions options = toy(3, 6);
  options.layout_count = 3;
  ArenaShape shape = small_arena_shape();
  shape.slab_count = shape.env_count();
  Host host(shape, options, false,
            {.seed = kSeed, .evaluate = true, .episodes = 30, .layout_count = 3, .layout_swap_every = 5});
  host.arena.control().episodes_per_run = 30;
  host.start();
  std::map<uint64_t, uint64_t> layout_of;
  host.await(
      [&] {
        while (const auto record = host.arena.episodes().read(shm::EpisodeReader::kSupervisor))
          layout_of[record->episode_id] = record->layout_id;
        return layout_of.size() == 30;
      },
      "thirty episodes");
  for (const auto& [episode, layout] : layout_of) EXPECT_EQ(layout, 77 + episode % 3) << episode;
}

}  // namespace sim_worker_test
}  // namespace comrad::sim
