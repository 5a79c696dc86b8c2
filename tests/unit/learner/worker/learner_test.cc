#include "learner/worker/learner.h"

#include <ATen/record_function.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ringbuffer_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <tuple>
#include <variant>
#include <vector>

#include "learner/sources/batch_queue.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/documented_metrics.h"
#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::learn {
namespace learner_test {

namespace fs = std::filesystem;

RunConfig small_config() {
  RunConfig config;
  config.run.algo = "ippo";
  config.collection.device = "cpu";
  config.collection.rollout = 4;
  config.optimisation.batch_size = 4 * 2 * 2;  // two slabs
  config.network.rnn_size = 8;
  config.collection.num_workers = 1;
  config.collection.num_envs_per_worker = 4;
  config.run.experiment_summaries_interval = 0.2;
  config.run.save_every_sec = 1000;
  config.optimisation.learning_rate = 1e-3;
  return config;
}

shm::ArenaShape arena_shape(const RunConfig& config) {
  shm::ArenaShape shape;
  EnvShape& env = shape.trajectory.env;
  env.num_agents = 2;
  env.height = env.width = 36;
  env.head_count = 1;
  env.head_sizes = {3};
  const policy::NetworkOptions options = policy::NetworkOptions::from(config, env);
  shape.trajectory.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.trajectory.recurrent_state_count = static_cast<int32_t>(options.recurrent_state_count());
  shape.sim_worker_count = 1;
  shape.envs_per_worker = static_cast<int32_t>(config.collection.num_envs_per_worker);
  shape.slab_count = 16;
  shape.journal_steps = 64;
  shape.weights_bytes = policy::ActorCritic::create(options, 1, torch::kCPU).weights_bytes();
  return shape;
}

/// Writes what simulators and policy workers would have: a pure function of environment and rollout.
void fill_slab(const SlabView& slab, uint64_t env_index, uint64_t rollout, uint32_t version) {
  Rng rng(RngKey(99).split(env_index).split(rollout));
  const TrajectoryShape& shape = slab.shape();
  const auto number = [&rng] { return static_cast<float>(rng.uniform() - 0.5); };
  for (int agent = 0; agent < shape.env.num_agents; ++agent) {
    for (float& x : slab.recurrent_state(0, agent)) x = number();
    for (int t = 0; t <= shape.rollout_steps; ++t) {
      for (uint8_t& pixel : slab.frame(t, agent)) pixel = static_cast<uint8_t>(rng.next());
      for (uint8_t& allowed : slab.action_mask(t, agent)) allowed = 1;
      slab.agent_active(t, agent) = 1;
      slab.value(t, agent) = number();
      if (t == shape.rollout_steps) continue;
      for (float& x : slab.logits(t, agent)) x = number();
      slab.action(t, agent)[0] = static_cast<int32_t>(rng.below(3));
      slab.log_prob(t, agent) = -1.1f;
      slab.reward(t, agent) = number();
      slab.policy_version(t, agent) = version;
    }
  }
  for (int t = 0; t < shape.rollout_steps; ++t) {
    slab.terminated(t) = rng.below(8) == 0 ? 1 : 0;
    slab.truncated(t) = 0;
    slab.final_index(t) = -1;
    slab.valid(t) = 1;
  }
}

/// Plays all environments of an arena in one thread, as one simulator process with a policy worker would.
class FakeSimulator {
 public:
  /// `is_sound` false: no decision that it plays may be learned from.
  explicit FakeSimulator(const shm::Arena& arena, bool is_sound = true)
      : arena_(*shm::Arena::adopt(dup(arena.descriptor()))), is_sound_(is_sound) {
    thread_ = std::thread([this] { run(); });
  }
  ~FakeSimulator() {
    stop_ = true;
    thread_.join();
  }

 private:
  void run() {
    const int env_count = arena_.shape().env_count();
    std::vector<uint64_t> next(static_cast<std::size_t>(env_count), 0);
    bool has_begun = false;
    while (!stop_) {
      const uint64_t allowed = arena_.control().rollouts_allowed.load();
      if (allowed > 0 && !has_begun) {
        has_begun = true;
        for (int env = 0; env < env_count; ++env)
          if (arena_.journals().header(env).is_resume != 0)
            next[static_cast<std::size_t>(env)] = arena_.journals().header(env).rollout_index;
      }
      bool idle = true;
      for (int env = env_count - 1; env >= 0; --env) {  // sealed in an order that is not the learner's
        uint64_t& rollout = next[static_cast<std::size_t>(env)];
        if (rollout >= allowed) continue;
        const auto slab = arena_.slabs().acquire(0);
        if (!slab) break;
        idle = false;
        shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(*slab));
        header.env_index = static_cast<uint32_t>(env);
        header.length = static_cast<uint32_t>(arena_.shape().trajectory.rollout_steps);
        header.rollout_index = rollout;
        fill_slab(arena_.slabs().view(static_cast<int>(*slab)), static_cast<uint64_t>(env), rollout,
                  arena_.control().policy_version.load());
        if (!is_sound_) std::ranges::fill(valid_of(arena_.slabs().view(static_cast<int>(*slab))), uint8_t{0});
        ++rollout;
        shm::JournalHeader& journal = arena_.journals().header(env);
        journal.episode_seed = 1000 + static_cast<uint64_t>(env);
        journal.episode_id = 3;
        journal.length = 5;
        journal.step_id = rollout * 4;
        for (int step = 0; step < 5; ++step)
          for (uint8_t& action : arena_.journals().action(env, step)) action = static_cast<uint8_t>(step);
        for (float& x : arena_.step_slots().recurrent(env, 0)) x = static_cast<float>(rollout);
        std::atomic_ref<uint64_t>(journal.rollout_index).store(rollout);
        arena_.slabs().seal(*slab);
      }
      if (idle) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  static std::span<uint8_t> valid_of(const SlabView& slab) {
    return {&slab.valid(0), static_cast<std::size_t>(slab.shape().rollout_steps)};
  }

  shm::Arena arena_;
  const bool is_sound_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Raises `stop` after so many optimizer steps, by the first operator behind them in the thread that makes this: another thread
/// might be late.
class StopAtBatches {
 public:
  StopAtBatches(const shm::Arena& arena, uint64_t batches, std::atomic<bool>& stop) {
    look_ = [&arena, batches, &stop] {
      if (arena.learner_counters().batches.load() >= batches) stop = true;
    };
  }
  ~StopAtBatches() { at::removeCallback(handle_); }
  StopAtBatches(const StopAtBatches&) = delete;
  StopAtBatches& operator=(const StopAtBatches&) = delete;

 private:
  static std::unique_ptr<at::ObserverContext> begin(const at::RecordFunction&) {
    look_();
    return nullptr;
  }
  static inline std::function<void()> look_ = [] {};  // libtorch takes plain functions
  const at::CallbackHandle handle_ = at::addThreadLocalCallback(at::RecordFunctionCallback(&begin));
};

class LearnerTest : public ::testing::Test {
 protected:
  struct Outcome {
    Status status;
    uint64_t env_frames = 0;
    PolicyVersion version = 0;
    std::vector<std::byte> weights;
    PolicyVersion published = 0;
  };

  /// One process life of a learner against a fresh arena and simulator.
  Outcome live(const RunConfig& config, const std::string& run, const std::string& mode = "train") {
    fs::create_directories(folder_ / run);
    Expected<shm::Arena> arena = shm::Arena::create(arena_shape(config), 1);
    EXPECT_TRUE(arena);
    shm::Arena observer = *shm::Arena::adopt(dup(arena->descriptor()));
    observer.control().run_state = shm::RunState::kRunning;
    Outcome outcome;
    const LearnerOptions options{.run_dir = (folder_ / run).string(),
                                 .serve = mode == "serve",
                                 .checkpoint = "",
                                 .abandon_step_after_s = stop_at_batches_ > 0 ? 0.0 : 4.0};
    auto learner = Learner::start(options, config, std::move(*arena), stop_);
    if (!learner) {
      outcome.status = learner.error();
      return outcome;
    }
    if (before_run_) before_run_(observer);
    std::optional<FakeSimulator> simulator;
    if (mode == "train") simulator.emplace(observer, simulator_is_sound_);
    std::optional<StopAtBatches> stop_at_batches;
    if (stop_at_batches_ > 0) stop_at_batches.emplace(observer, stop_at_batches_, stop_);
    std::thread stopper;
    if (stop_when_)
      stopper = std::thread([&] {
        EXPECT_TRUE(test::wait_until([&] { return stop_when_(observer); }));
        stop_ = true;
      });
    outcome.status = (*learner)->run();
    if (stopper.joinable()) stopper.join();
    outcome.env_frames = (*learner)->env_frames();
    outcome.version = (*learner)->algorithm().version();
    outcome.weights = (*learner)->algorithm().weights();
    outcome.published = observer.control().policy_version.load();
    EXPECT_EQ(observer.weights().has_any(), config.collection.policy_processes || config.hosts.serve);
    if (!observer.weights().has_any()) return outcome;
    std::vector<std::byte> published;
    const auto version = observer.weights().read(published);
    EXPECT_TRUE(version);
    EXPECT_EQ(outcome.published, *version);
    // What was learned of an abandoned rollout is not published.
    EXPECT_TRUE(stop_at_batches_ > 0 || published == outcome.weights);
    return outcome;
  }

  /// Trains `rollouts` in one life, in a second one, and in two lives that meet after `first`: bit for bit
  /// the same weights, at `version`.
  void expect_the_same_twice_and_resumed(RunConfig config, int first, int rollouts, uint64_t& version) {
    config.run.train_for_env_frames = kFramesPerRollout * rollouts;
    const Outcome whole = live(config, config.run.algo.name() + "_whole"),
                  again = live(config, config.run.algo.name() + "_again");
    ASSERT_TRUE(whole.status) << whole.status.error().message;
    EXPECT_TRUE(whole.weights == again.weights) << config.run.algo.name();
    config.run.train_for_env_frames = kFramesPerRollout * first;
    ASSERT_TRUE(live(config, config.run.algo.name() + "_halves").status);
    config.run.train_for_env_frames = kFramesPerRollout * rollouts;
    const Outcome halves = live(config, config.run.algo.name() + "_halves");
    ASSERT_TRUE(halves.status) << halves.status.error().message;
    EXPECT_EQ(halves.version, whole.version);
    EXPECT_TRUE(halves.weights == whole.weights) << config.run.algo.name();
    version = whole.version;
  }

  static constexpr double kFramesPerRollout = 4 * 2 * 4 * 4;  ///< environments, agents, steps, tics
  const test::ScratchFolder folder_;
  std::atomic<bool> stop_{false};
  std::function<void(const shm::Arena&)> before_run_;
  bool simulator_is_sound_ = true;
  uint64_t stop_at_batches_ =
      0;  ///< raise stop_ after so many optimizer steps, and wait for no rollout; 0: never
  std::function<bool(const shm::Arena&)> stop_when_;  ///< raise stop_ then; empty: never
};

TEST_F(LearnerTest, TrainsUntilTheLastEnvFrameAndLeavesACheckpointAndMetrics) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 2;
  config.run.train_for_env_frames = 5 * 16 * 4;  // five batches of 16 decisions, four tics each
  const Outcome outcome = live(config, "run");
  ASSERT_TRUE(outcome.status) << outcome.status.error().message;
  EXPECT_EQ(outcome.env_frames, 5u * 16 * 4);
  EXPECT_EQ(outcome.version, 10u);
  EXPECT_EQ(outcome.published, 10u);
  CheckpointStore store((folder_ / "run/checkpoint").string(), 2);
  ASSERT_EQ(store.list().size(), 1u);
  EXPECT_EQ(store.list()[0].version, 10u);
  EXPECT_EQ(store.list()[0].env_frames, 320u);
  std::ifstream lines(folder_ / "run/metrics.jsonl");
  std::string line, last;
  while (std::getline(lines, line)) last = line;
  const auto report = nlohmann::json::parse(last);
  EXPECT_EQ(report["env_frames"], 320);
  EXPECT_EQ(report["decisions"], 80);
  for (const char* name : {"train/policy_loss", "train/value_loss", "train/kl_divergence", "train/grad_norm",
                           "train/num_sgd_steps", "train/version_diff_avg", "perf/_fps", "stats/slabs_sealed",
                           "train/adam_gain_core", "train/grad_norm_encoder"})
    EXPECT_TRUE(report.contains(name)) << name;
}

TEST_F(LearnerTest, WhosePolicyWorkersAreThreadsLeavesTheArenasWeightsToOtherHosts) {
  RunConfig config = small_config();
  config.collection.policy_processes = false;
  config.run.train_for_env_frames = 5 * 16 * 4;
  for (const bool serve : {false, true}) {
    config.hosts.serve = serve;
    const Outcome outcome = live(config, serve ? "with_hosts" : "alone");
    ASSERT_TRUE(outcome.status) << outcome.status.error().message;
    EXPECT_EQ(outcome.published, 5u);
  }
}

TEST_F(LearnerTest, WhoseFramesAreReadFromTheArenaLearnsTheSame) {
  const device::OperatorPath as_on_a_gpu;
  RunConfig config = small_config();
  config.collection.deterministic = true;
  config.run.train_for_env_frames = 3 * kFramesPerRollout;
  const Outcome copied = live(config, "copied");
  config.collection.policy_processes =
      false;  // no request comes: every frame is one that the threads have not seen
  const Outcome read = live(config, "read");
  ASSERT_TRUE(copied.status) << copied.status.error().message;
  ASSERT_TRUE(read.status) << read.status.error().message;
  EXPECT_TRUE(read.weights == copied.weights);
}

TEST_F(LearnerTest, TrainingThatCannotLearnIsBadInputAndLeavesNoCheckpoint) {
  simulator_is_sound_ = false;
  const Outcome outcome = live(small_config(), "run");
  ASSERT_FALSE(outcome.status);
  EXPECT_EQ(exit_code(outcome.status.error()), kExitBadInput) << "another start would end as this one did";
  EXPECT_EQ(outcome.version, 0u);
  EXPECT_TRUE(CheckpointStore((folder_ / "run/checkpoint").string(), 2).list().empty());
}

TEST_F(LearnerTest, ALastCheckpointThatCannotBeWrittenHasASeparateExitCode) {
  RunConfig config = small_config();
  config.run.train_for_env_frames = 2 * 16 * 4;
  fs::create_directories(folder_ / "run");
  std::ofstream(folder_ / "run/checkpoint") << "no folder";
  const Outcome outcome = live(config, "run");
  ASSERT_FALSE(outcome.status);
  EXPECT_EQ(exit_code(outcome.status.error()), kExitNotSaved);
  EXPECT_EQ(outcome.version, 2u) << "it is trained";
}

TEST_F(LearnerTest, ContinuesFromTheNewestCheckpointThatCanBeRead) {
  RunConfig config = small_config();
  config.run.train_for_env_frames = 2 * 16 * 4;
  ASSERT_TRUE(live(config, "run").status);
  config.run.train_for_env_frames = 4 * 16 * 4;
  const Outcome second = live(config, "run");
  ASSERT_TRUE(second.status);
  EXPECT_EQ(second.version, 4u);
  CheckpointStore store((folder_ / "run/checkpoint").string(), 2);
  ASSERT_EQ(store.list().size(), 2u);
  fs::resize_file(store.list()[0].path, fs::file_size(store.list()[0].path) / 2);
  config.run.train_for_env_frames = 3 * 16 * 4;
  const Outcome third = live(config, "run");  // from version 2, one more batch
  ASSERT_TRUE(third.status) << third.status.error().message;
  EXPECT_EQ(third.version, 3u);
  EXPECT_EQ(third.env_frames, 3u * 16 * 4);
}

TEST_F(LearnerTest, ABestCheckpointNeedsAFullWindowAndTheWindowOutlivesTheProcess) {
  RunConfig config = small_config();
  config.run.stats_avg = 12;
  config.run.save_best_every_sec = 1e-3;
  config.run.save_best_after_env_frames = 0;
  for (const auto& [episodes, best, is_saved] :
       {std::tuple(11, -1.0, false), {12, -1.0, true}, {12, 0.4999, false}, {12, 0.4, true}}) {
    const std::string run = "run" + std::to_string(episodes) + std::to_string(best);
    config.run.train_for_env_frames = 2 * 16 * 4;
    ASSERT_TRUE(live(config, run).status);
    const CheckpointStore store((folder_ / run / "checkpoint").string(), 2);
    EXPECT_EQ(store.best(), "") << "no episode has ended";
    // As if so many episodes had ended with scores 0 and 1, and the best window so far had `best`.
    StateDict state = *read_checkpoint(store.list().front().path);
    ASSERT_EQ(state.tensor("episodes/window")->sizes(), at::IntArrayRef({0, 6}));
    Tensor window = torch::zeros({episodes, 6}, torch::kFloat64);
    window.select(1, 0).slice(0, 1, c10::nullopt, 2).fill_(1);
    state.put("episodes/window", window);
    if (best >= 0) state.put("counters/best_score", best);
    ASSERT_TRUE(write_checkpoint(store.list().front().path, state));
    config.run.train_for_env_frames = 30 * 16 * 4;
    ASSERT_TRUE(live(config, run).status);
    EXPECT_EQ(!store.best().empty(), is_saved) << run;
    if (is_saved) {
      EXPECT_NE(store.best().find("best_0.500.pt"), std::string::npos) << store.best();
    }
    EXPECT_TRUE(torch::equal(*read_checkpoint(store.list().front().path)->tensor("episodes/window"), window));
  }
}

TEST_F(LearnerTest, ABestScoreOfACheckpointWithoutItsWindowIsForgotten) {
  RunConfig config = small_config();
  config.run.stats_avg = 1;
  config.run.train_for_env_frames = 2 * 16 * 4;
  ASSERT_TRUE(live(config, "run").status);
  const CheckpointStore store((folder_ / "run/checkpoint").string(), 2);
  StateDict state = *read_checkpoint(store.list().front().path), old;
  for (const auto& [key, value] : state.values())
    if (!key.starts_with("episodes/")) std::visit([&](const auto& held) { old.put(key, held); }, value);
  old.put("counters/best_score", 1e9);  // of the luckiest ten
  ASSERT_TRUE(write_checkpoint(store.list().front().path, old));
  config.run.train_for_env_frames = 4 * 16 * 4;
  const Outcome outcome = live(config, "run");
  ASSERT_TRUE(outcome.status) << outcome.status.error().message;
  EXPECT_EQ(outcome.version, 4u);
  EXPECT_FALSE(read_checkpoint(store.list().front().path)->has("counters/best_score"));
}

TEST_F(LearnerTest, RefusesToBeginAnewOverUnreadableCheckpoints) {
  const RunConfig config = small_config();
  fs::create_directories(folder_ / "run/checkpoint");
  std::ofstream(folder_ / "run/checkpoint/checkpoint_000000007_99.pt") << "rubbish";
  const Outcome outcome = live(config, "run");
  ASSERT_FALSE(outcome.status);
  EXPECT_NE(outcome.status.error().message.find("--restart_behavior"), std::string::npos)
      << outcome.status.error().message;
}

TEST_F(LearnerTest, LockStepGivesTheSameWeightsTwiceAndAcrossAResume) {
  for (const auto& [algo, networks] : {std::pair("ippo", 1u), {"mappo", 1u}, {"happo", 3u}}) {
    RunConfig config = small_config();
    config.run.algo = algo;
    config.network.critic_hidden_sizes = "16,8";
    config.collection.deterministic = true;
    config.collection.async_rl = false;
    config.optimisation.num_epochs = 2;
    config.optimisation.shuffle_minibatches = true;
    uint64_t version = 0;
    ASSERT_NO_FATAL_FAILURE(expect_the_same_twice_and_resumed(config, 2, 5, version));
    EXPECT_EQ(version, 20u * networks);  // 5 rollouts, 2 batches, 2 epochs
  }
}

TEST_F(LearnerTest, ALockStepRunThatIsStoppedWithinARolloutKeepsTheOneBefore) {
  RunConfig config = small_config();
  config.collection.deterministic = true;
  config.collection.async_rl = false;
  config.optimisation.num_epochs = 100;      // of two batches a rollout
  config.optimisation.learning_rate = 3e-2;  // epochs continue while the loss changes
  config.run.save_every_sec = 3600;
  config.run.train_for_env_frames = kFramesPerRollout;
  const Outcome first = live(config, "first");
  config.run.train_for_env_frames = kFramesPerRollout * 3;
  const Outcome whole = live(config, "whole");
  ASSERT_TRUE(first.status && whole.status);
  ASSERT_GT(whole.version, first.version);

  stop_at_batches_ = first.version + 1;  // the second batch of the second rollout is in hand
  const Outcome stopped = live(config, "stopped");
  ASSERT_TRUE(stopped.status) << stopped.status.error().message;
  CheckpointStore store((folder_ / "stopped/checkpoint").string(), 2);
  ASSERT_EQ(store.list().size(), 1u) << "the rollout that was trained on is lost";
  EXPECT_EQ(store.list()[0].version, first.version);
  EXPECT_EQ(store.list()[0].env_frames, static_cast<uint64_t>(kFramesPerRollout));
  EXPECT_EQ(stopped.env_frames, static_cast<uint64_t>(kFramesPerRollout));
  stop_ = false;
  stop_at_batches_ = 0;
  const Outcome resumed = live(config, "stopped");
  ASSERT_TRUE(resumed.status) << resumed.status.error().message;
  EXPECT_EQ(resumed.version, whole.version);
  EXPECT_TRUE(resumed.weights == whole.weights) << "as if it had never been stopped";
}

/// Q-learning with a replay of a few slabs, of which training begins with eight.
RunConfig small_q_config(const std::string& algo) {
  RunConfig config = small_config();
  config.run.algo = algo;
  config.mixers.mixer = algo == "vdn"       ? "vdn"
                        : algo == "qmix"    ? "qmix"
                        : algo == "qplex_q" ? "dmaq_qatten"
                                            : "";
  config.network.use_rnn = algo != "idqn";
  config.replay.per = algo == "idqn";
  config.q_learning.team_reward = TeamReward::kSum;
  config.replay.replay_gb = 1e-3;
  config.q_learning.learning_starts_decisions = 64;
  config.q_learning.replay_batch_size = algo == "idqn" ? 12 : 3;
  config.q_learning.dqn_max_updates_per_batch = 2;
  config.replay.per_beta_env_frames = 1000;
  config.q_learning.epsilon = Schedule::line(1, 0.01, 1000);
  return config;
}

TEST_F(LearnerTest, QLearningTrainsAtItsRateOnceTheReplayHasEnough) {
  for (const char* algo : {"vdn", "idqn"}) {
    RunConfig config = small_q_config(algo);
    config.run.train_for_env_frames = 40 * 16 * 4;  // forty batches' worth of 16 decisions, four tics each
    const Outcome outcome = live(config, algo);
    ASSERT_TRUE(outcome.status) << outcome.status.error().message;
    EXPECT_GE(outcome.env_frames, 40u * 16 * 4);
    // Two updates for every 16 decisions behind the first 64, and what may wait or run ahead.
    const double due = (static_cast<double>(outcome.env_frames) / 4 - 64) / 16 * 2;
    EXPECT_NEAR(static_cast<double>(outcome.version), due, 10) << algo;
    EXPECT_EQ(outcome.published, outcome.version);
    std::ifstream lines(folder_ / algo / "metrics.jsonl");
    std::string line, last;
    while (std::getline(lines, line)) last = line;
    const auto report = nlohmann::json::parse(last);
    EXPECT_NEAR(report["train/epsilon"].get<double>(), 0.01, 1e-9);
    EXPECT_GT(report["train/buffer_transitions"].get<double>(), 64);
    EXPECT_GT(report["train/grad_norm"].get<double>(), 0);
    EXPECT_TRUE(report.contains("train/version_diff_avg"));
  }
}

/// What dashboards made for COMRAD's runs under Sample Factory show.
const std::vector<std::string> kNamesOfAll = {"perf/_fps",
                                              "perf/_sample_throughput",
                                              "reward/reward",
                                              "reward/reward_min",
                                              "reward/reward_max",
                                              "len/len",
                                              "len/len_min",
                                              "len/len_max",
                                              "policy_stats/avg_true_objective",
                                              "policy_stats/avg_true_objective_min",
                                              "policy_stats/avg_true_objective_max",
                                              "stats/avg_request_count",
                                              "stats/wait_policy",
                                              "stats/step_policy",
                                              "train/env_steps",
                                              "train/lr",
                                              "train/loss",
                                              "train/grad_norm",
                                              "train/version_diff_avg",
                                              "train/version_diff_min",
                                              "train/version_diff_max"};
const std::vector<std::string> kNamesOfPpo = {"train/actual_lr",
                                              "train/policy_loss",
                                              "train/value_loss",
                                              "train/exploration_loss",
                                              "train/kl_loss",
                                              "train/kl_divergence",
                                              "train/kl_divergence_max",
                                              "train/entropy",
                                              "train/value",
                                              "train/value_delta",
                                              "train/value_delta_max",
                                              "train/ratio_mean",
                                              "train/ratio_min",
                                              "train/ratio_max",
                                              "train/fraction_clipped",
                                              "train/adv_min",
                                              "train/adv_max",
                                              "train/adv_mean",
                                              "train/adv_std",
                                              "train/act_min",
                                              "train/act_max",
                                              "train/max_abs_logprob",
                                              "train/valids_fraction",
                                              "train/same_policy_fraction",
                                              "train/num_sgd_steps",
                                              "train/obs_running_mean",
                                              "train/obs_running_std",
                                              "train/adam_max_second_moment",
                                              "train/returns_running_mean",
                                              "train/returns_running_std"};
const std::vector<std::string> kNamesOfHappo = {"happo/factor_m_mean",
                                                "happo/factor_m_max",
                                                "happo/agent_order_first",
                                                "happo/critic_grad_norm",
                                                "happo/agent_0_policy_loss",
                                                "happo/agent_0_grad_norm",
                                                "happo/agent_1_policy_loss",
                                                "happo/agent_1_grad_norm",
                                                "train/value_loss",
                                                "train/adv_mean",
                                                "train/adv_std"};
const std::vector<std::string> kNamesOfIdqn = {"train/dqn_num_updates",
                                               "train/dqn_steps_per_update",
                                               "train/dqn_pending_steps",
                                               "train/dqn_q_mean",
                                               "train/dqn_q_max",
                                               "train/dqn_q_min",
                                               "train/dqn_target_q_mean",
                                               "train/dqn_td_error_mean",
                                               "train/policy_lag_valid_frac",
                                               "train/policy_lag_dropped",
                                               "train/policy_lag_total"};
const std::vector<std::string> kNamesOfMixers = {
    "train/q_tot_mean",        "train/q_tot_max",           "train/td_error_mean",
    "train/agent_qs_mean",     "train/agent_qs_max",        "train/agent_qs_min",
    "train/target_q_tot_mean", "train/target_before_clamp", "train/q_std_across_actions",
    "train/done_ratio",        "train/timeout_ratio",       "train/num_updates",
    "train/buffer_size",       "train/buffer_transitions",  "train/pending_transition_debt"};
const std::vector<std::string> kNamesOfStateMixers = {"train/mixer_gain", "train/mixer_state_rms"};
const std::vector<std::string> kNamesOfQplexQ = {"train/attend_mag_regs", "train/head_entropy_mean"};

TEST_F(LearnerTest, ReportsUnderTheNamesThatDashboardsKnowAndTheDocumentExplains) {
  before_run_ = [](const shm::Arena& arena) {
    EpisodeRecord episode{};
    episode.score = 7, episode.ceiling = 14, episode.length_tics = 40;
    arena.episodes().write(episode);
    shm::WorkerCounters& inference = arena.policy_counters(0);
    inference.decisions = 60, inference.batches = 10;
    inference.wait_ns = 20'000'000, inference.busy_ns = 30'000'000;
  };
  const std::map<std::string, std::vector<std::vector<std::string>>> expected = {
      {"ippo", {kNamesOfPpo}},
      {"happo", {kNamesOfHappo}},
      {"idqn", {kNamesOfIdqn}},
      {"qmix", {kNamesOfMixers, kNamesOfStateMixers}},
      {"qplex_q", {kNamesOfMixers, kNamesOfStateMixers, kNamesOfQplexQ}}};
  const auto documented =
      test::documented_metrics({"train/", "happo/", "reward/", "len/", "policy_stats/", "stats/", "perf/"});
  std::vector<std::string> written;
  for (const auto& [algo, tables] : expected) {
    SCOPED_TRACE(algo);
    const bool is_on_policy = find_algorithm(algo)->family == Family::kOnPolicy;
    RunConfig config = is_on_policy ? small_config() : small_q_config(algo);
    config.run.algo = algo;
    config.network.critic_hidden_sizes = "16,8";
    if (!is_on_policy) config.q_learning.q_reset_every_updates = 4;
    config.run.experiment_summaries_interval = 1e-3;
    // Rates need two reports beside the last one.
    stop_when_ = [metrics = (folder_ / algo / "metrics.jsonl").string()](const shm::Arena& arena) {
      return arena.control().learner_env_frames >= 20 * 16 * 4 &&
             std::ranges::count(read_file(metrics).value_or(""), '\n') >= 2;
    };
    stop_ = false;
    const Outcome outcome = live(config, algo);
    ASSERT_TRUE(outcome.status) << outcome.status.error().message;

    std::set<std::string> names;
    nlohmann::json first;
    std::ifstream lines(folder_ / algo / "metrics.jsonl");
    for (std::string line; std::getline(lines, line);) {
      const auto report = nlohmann::json::parse(line);
      if (report.contains("stats/avg_request_count") && first.is_null()) first = report;
      for (const auto& [name, value] : report.items())
        if (name.find('/') != std::string::npos) names.insert(name);
    }
    EXPECT_EQ(first["stats/avg_request_count"], 6);
    EXPECT_EQ(first["stats/wait_policy"], 0.002);
    EXPECT_EQ(first["stats/step_policy"], 0.003);
    EXPECT_GT(first["stats/memory_learner"], 1);
    std::string events;
    for (const auto& entry : fs::directory_iterator(folder_ / algo))
      if (entry.path().filename().string().starts_with("events.out.tfevents."))
        events = read_file(entry.path().string()).value_or("");
    std::vector<std::string> all = kNamesOfAll;
    for (const auto& table : tables) all.insert(all.end(), table.begin(), table.end());
    for (const std::string& name : all) {
      EXPECT_TRUE(names.contains(name)) << name;
      // On the wire a tag stands behind its field number and its length.
      EXPECT_NE(events.find("\x0A" + std::string(1, static_cast<char>(name.size())) + name),
                std::string::npos)
          << name;
    }
    EXPECT_NE(events.find("_hparams_/session_start_info"), std::string::npos);
    const std::vector<std::string> of_run(names.begin(), names.end());
    EXPECT_THAT(test::undocumented(documented, of_run), ::testing::IsEmpty());
    written.insert(written.end(), of_run.begin(), of_run.end());
  }
  EXPECT_THAT(test::unwritten(documented, written), ::testing::IsEmpty());
}

TEST_F(LearnerTest, WarnsInWordsOfWhatReportsShowAndOfSettingsAtTheStart) {
  const auto heard = std::make_shared<spdlog::sinks::ringbuffer_sink_mt>(64);
  const auto before = spdlog::default_logger();
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("test", heard));
  const auto warnings = [&] {
    std::string all;
    for (const std::string& line : heard->last_formatted())
      if (line.find("warning: ") != std::string::npos) all += line;
    return all;
  };
  RunConfig config = small_config();
  config.on_policy.ppo_clip_ratio = 1e-9;  // every sample lies outside
  config.run.experiment_summaries_interval = 0.05;
  config.run.train_for_seconds = test::kPatienceSeconds;
  const std::string clipped = "warning: 100% of the samples lie outside PPO's clip interval";
  std::thread stopper([&] {  // six reports in a row are enough
    while (!stop_ && warnings().find(clipped) == std::string::npos)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    stop_ = true;
  });
  const Outcome outcome = live(config, "clipped");
  stop_ = true;
  stopper.join();
  stop_ = false;
  ASSERT_TRUE(outcome.status);
  EXPECT_THAT(warnings(), ::testing::HasSubstr(clipped));
  EXPECT_THAT(warnings(), ::testing::Not(::testing::HasSubstr("epsilon")));

  config = small_q_config("vdn");
  config.q_learning.epsilon = Schedule::line(1, 0.01, 1e6);
  config.run.train_for_env_frames = 4096;
  ASSERT_TRUE(live(config, "explores").status);
  spdlog::set_default_logger(before);
  EXPECT_THAT(warnings(), ::testing::HasSubstr("warning: the run ends at epsilon 1.00"));
}

TEST_F(LearnerTest, QLearningInLockStepIsTheSameTwiceAndAcrossAResume) {
  for (const char* algo : {"vdn", "qplex_q", "idqn"}) {
    RunConfig config = small_q_config(algo);
    config.collection.deterministic = true;
    config.collection.async_rl = false;
    config.replay.save_replay = true;
    config.network.normalize_input = true;
    uint64_t version = 0;
    ASSERT_NO_FATAL_FAILURE(expect_the_same_twice_and_resumed(config, 4, 8, version));
    EXPECT_GT(version, 10u);

    // The replay that belongs to the newest checkpoint is gone: said, not guessed.
    for (const auto& entry :
         fs::directory_iterator(folder_ / (config.run.algo.name() + "_halves") / "checkpoint"))
      if (entry.path().extension() == ".bin") fs::remove(entry.path());
    config.run.train_for_env_frames = kFramesPerRollout * 8;
    const Outcome refused = live(config, config.run.algo.name() + "_halves");
    ASSERT_FALSE(refused.status);
    EXPECT_NE(refused.status.error().message.find("replay_"), std::string::npos)
        << refused.status.error().message;
  }
}

TEST_F(LearnerTest, OnlyReplaysOfKeptCheckpointsStay) {
  RunConfig config = small_q_config("vdn");
  config.collection.deterministic = true;
  config.collection.async_rl = false;
  config.replay.save_replay = true;
  config.run.keep_checkpoints = 1;
  for (int life = 1; life <= 3; ++life) {
    config.run.train_for_env_frames = life * 2 * 4 * 2 * 4 * 4;
    ASSERT_TRUE(live(config, "run").status);
  }
  int replays = 0;
  for (const auto& entry : fs::directory_iterator(folder_ / "run/checkpoint"))
    replays += entry.path().extension() == ".bin";
  EXPECT_EQ(replays, 1);
}

TEST_F(LearnerTest, ADeterministicCheckpointBringsJournalsAndStatesBack) {
  RunConfig config = small_config();
  config.collection.deterministic = true;
  config.collection.async_rl = false;
  config.run.train_for_env_frames = 2 * 4 * 2 * 4 * 4;
  ASSERT_TRUE(live(config, "run").status);
  Expected<shm::Arena> arena = shm::Arena::create(arena_shape(config), 2);
  shm::Arena observer = *shm::Arena::adopt(dup(arena->descriptor()));
  const auto learner =
      Learner::start({.run_dir = (folder_ / "run").string(), .serve = false, .checkpoint = ""}, config,
                     std::move(*arena), stop_);
  ASSERT_TRUE(learner) << learner.error().message;
  EXPECT_EQ(observer.control().rollouts_allowed.load(), 3u);
  for (int env = 0; env < 4; ++env) {
    const shm::JournalHeader& journal = observer.journals().header(env);
    EXPECT_EQ(journal.is_resume, 1u);
    EXPECT_EQ(journal.episode_seed, 1000u + static_cast<uint64_t>(env));
    EXPECT_EQ(journal.rollout_index, 2u);
    EXPECT_EQ(journal.step_id, 8u);
    EXPECT_EQ(journal.length, 5u);
    EXPECT_EQ(observer.journals().action(env, 4)[1], 4);
    EXPECT_EQ(observer.step_slots().recurrent(env, 0)[3], 2.0f);
  }
}

TEST_F(LearnerTest, RefusesADeterministicResumeWithAnotherNumberOfEnvironments) {
  RunConfig config = small_config();
  config.collection.deterministic = true;
  config.collection.async_rl = false;
  config.run.train_for_env_frames = 4 * 2 * 4 * 4;
  ASSERT_TRUE(live(config, "run").status);
  config.collection.num_envs_per_worker = 6;
  const Outcome outcome = live(config, "run");
  ASSERT_FALSE(outcome.status);
  EXPECT_NE(outcome.status.error().message.find("--num_envs_per_worker"), std::string::npos);
}

TEST_F(LearnerTest, AStopEndsTheRunAndSaves) {
  RunConfig config = small_config();
  config.run.train_for_env_frames = 1e12;
  stop_when_ = [](const shm::Arena& arena) { return arena.control().policy_version.load() >= 3; };
  const Outcome outcome = live(config, "run");
  ASSERT_TRUE(outcome.status);
  EXPECT_GE(outcome.version, 3u);
  CheckpointStore store((folder_ / "run/checkpoint").string(), 2);
  ASSERT_EQ(store.list().size(), 1u);
  EXPECT_EQ(store.list()[0].version, outcome.version);
}

TEST_F(LearnerTest, ServeModePublishesTheCheckpointAndTouchesNothing) {
  RunConfig config = small_config();
  config.run.train_for_env_frames = 3 * 16 * 4;
  const Outcome trained = live(config, "run");
  ASSERT_TRUE(trained.status);
  stop_ = true;
  const auto metrics_before = fs::file_size(folder_ / "run/metrics.jsonl");
  const Outcome served = live(config, "run", "serve");
  ASSERT_TRUE(served.status) << served.status.error().message;
  EXPECT_EQ(served.published, trained.version);
  EXPECT_TRUE(served.weights == trained.weights);
  EXPECT_EQ(fs::file_size(folder_ / "run/metrics.jsonl"), metrics_before);
  const Outcome nothing = live(config, "empty", "serve");
  ASSERT_FALSE(nothing.status);
  EXPECT_EQ(nothing.status.error().code, ErrorCode::kNotFound);
}

TEST_F(LearnerTest, ASecondLearnerCannotJoinALockStepRunHalfWay) {
  RunConfig config = small_config();
  config.collection.deterministic = true;
  config.collection.async_rl = false;
  Expected<shm::Arena> arena = shm::Arena::create(arena_shape(config), 2);
  arena->control().rollouts_allowed = 4;
  const auto learner = Learner::start({.run_dir = folder_.string(), .serve = false, .checkpoint = ""}, config,
                                      std::move(*arena), stop_);
  ASSERT_FALSE(learner);
  EXPECT_NE(learner.error().message.find("lock-step"), std::string::npos);
}

TEST_F(LearnerTest, AStalledLearnerBoundsWhatIsCollected) {
  // Capacity 2: two full batches wait, a third is being filled; then slabs stay sealed and the arena
  // runs dry.
  const RunConfig config = small_config();
  Expected<shm::Arena> arena = shm::Arena::create(arena_shape(config), 3);
  arena->control().rollouts_allowed = UINT64_MAX;
  FakeSimulator simulator(*arena);
  BatchQueue queue(*arena, 2, 2);
  EXPECT_TRUE(test::wait_until([&] { return queue.waiting() >= 2 && arena->slabs().sealed_count() >= 16; }));
  EXPECT_FALSE(
      test::wait_until([&] { return queue.waiting() > 2 || arena->slabs().sealed_count() > 16; }, 0.1));
  EXPECT_EQ(queue.waiting(), 2);
  EXPECT_EQ(arena->slabs().sealed_count(), 16);
  std::unique_ptr<RolloutBatch> batch = queue.pop(1000);
  ASSERT_NE(batch, nullptr);
  EXPECT_EQ(batch->transitions, 16);
  queue.recycle(std::move(batch));
  EXPECT_TRUE(test::wait_until([&] { return queue.waiting() == 2; }));
}

}  // namespace learner_test
}  // namespace comrad::learn
