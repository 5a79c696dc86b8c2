// Games with known answers through the whole pipeline: simulator, policy worker and learner as the programs run
// them, asynchronously, in threads of one process. A test brings the game and the settings; train_game() plays,
// trains and reports what the episodes scored and what was learned.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "learner/worker/learner.h"
#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/worker/policy_worker.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "sim_workers/worker/sim_worker.h"
#include "tests/support/scratch_folder.h"

namespace comrad::test {

constexpr int kGameEnvironments = 16;

/// Two agents, one head of two choices, the smallest picture that the encoder impala takes.
inline EnvShape pipeline_game_shape() {
  EnvShape env;
  env.num_agents = 2;
  env.height = env.width = 20;
  env.head_count = 1;
  env.head_sizes = {2};
  return env;
}

/// A game of two agents that both see one shade of grey.
class PipelineGame : public sim::Environment {
 public:
  PipelineGame() {
    last_.reward.assign(2, 0);
    summary_.agent_count = 2, summary_.agent_score.fill(0), summary_.agent_return.fill(0);
  }
  const EnvShape& shape() const override { return shape_; }
  uint64_t layout_id() const override { return 1; }
  void reset(uint64_t episode_seed) override {
    state_ = 0, step_ = 0;
    last_.terminated = last_.truncated = false;
    begin(episode_seed);
  }
  void step(std::span<const int32_t> action) override {
    play(action);
    ++step_;
    summary_.length_steps = static_cast<uint32_t>(step_);
    summary_.length_tics = 4 * summary_.length_steps;
    summary_.score = last_.reward[0] + last_.reward[1];
  }
  const sim::Step& last_step() const override { return last_; }
  const EpisodeRecord& summary() const override { return summary_; }
  uint64_t state_hash() const override { return static_cast<uint64_t>(state_ * 1000 + step_); }
  /// What the agents see of a state, 0..2.
  static uint8_t shade(int state) { return static_cast<uint8_t>(40 + 80 * state); }
  void observe(const sim::ObservationTarget& target) const {
    std::fill_n(target.frame, 2 * shape_.frame_bytes(), shade(visible_state()));
    std::fill_n(target.action_mask, 4, uint8_t{1});
    std::fill_n(target.agent_active, 2, uint8_t{1});
    if (target.global_state != nullptr) write_global_state(target.global_state);
  }

 protected:
  virtual void begin(uint64_t /*episode_seed*/) {}
  /// One decision: pay() or last_.reward, and how the episode ends. The score of an episode is the team's
  /// last reward.
  virtual void play(std::span<const int32_t> action) = 0;
  virtual int visible_state() const { return state_; }
  /// f32 [S], of a game whose shape_ has a global state.
  virtual void write_global_state(float* /*state*/) const {}
  void pay(double team) { last_.reward.assign(2, static_cast<float>(team / 2)); }

  EnvShape shape_ = pipeline_game_shape();
  int state_ = 0, step_ = 0;
  sim::Step last_;
  EpisodeRecord summary_;
};

using GameMaker = std::function<std::unique_ptr<PipelineGame>()>;

class PipelineGameSet : public sim::EnvironmentSet {
 public:
  explicit PipelineGameSet(const GameMaker& make) {
    for (int i = 0; i < kGameEnvironments; ++i) games_.push_back(make());
  }
  int size() const override { return kGameEnvironments; }
  sim::Environment& at(int index) override { return *games_[static_cast<std::size_t>(index)]; }
  void observe(std::span<const int> indices, std::span<const sim::ObservationTarget> targets) override {
    for (std::size_t i = 0; i < indices.size(); ++i)
      games_[static_cast<std::size_t>(indices[i])]->observe(targets[i]);
  }

 private:
  std::vector<std::unique_ptr<PipelineGame>> games_;
};

/// What all games are trained with: feed-forward, the cheapest encoder, one simulator, no checkpoint before the
/// end. A test changes it and then calls resolve_settings.
inline RunConfig pipeline_game_config(const std::string& algo) {
  RunConfig config;
  config.run.algo = algo;
  config.environment.num_agents = 2;
  config.run.seed = 42;
  config.collection.device = "cpu";
  config.collection.precision = Precision::kFp32;  // the same numbers on every machine
  config.collection.num_workers = 1;
  config.collection.num_envs_per_worker = kGameEnvironments;
  config.network.use_rnn = false;
  config.network.encoder = "impala";
  config.network.share_parameters = algo != "happo";
  config.environment.shared_reward_alpha = 0;
  config.replay.replay_gb = 0.01;
  config.run.save_every_sec = 1e6;
  return config;
}

/// Where training may end before the configured number of env frames.
struct GameGoal {
  double score = 1e30;         ///< mean of the last `episodes` scores that is enough
  std::size_t episodes = 200;  ///< of the window
};

struct TrainedGame {
  std::unique_ptr<learn::Algorithm> algorithm;  ///< what a checkpoint of it loads
  double best_score = -1e30;  ///< highest mean over a full window of episodes; -1e30 where none was full
  double env_frames = 0;
  double seconds = 0;
};

/// Trains through the pipeline until `config.run.train_for_env_frames` or the goal.
inline TrainedGame train_game(const RunConfig& config, const GameMaker& make, const GameGoal& goal = {}) {
  const double began_s = monotonic_s();
  device::tune_math(1);
  const test::ScratchFolder folder;
  const EnvShape env = make()->shape();
  const auto network = policy::NetworkOptions::from(config, env);
  shm::ArenaShape shape;
  shape.trajectory.env = env;
  shape.trajectory.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.trajectory.recurrent_state_count = static_cast<int32_t>(network.recurrent_state_count());
  shape.sim_worker_count = 1;
  shape.envs_per_worker = kGameEnvironments;
  shape.slab_count = static_cast<int32_t>(config.collection.trajectory_slabs);
  shape.weights_bytes = policy::ActorCritic::create(network, 1, torch::kCPU).weights_bytes();
  Expected<shm::Arena> arena = shm::Arena::create(shape, 1);
  EXPECT_TRUE(arena) << arena.error().message;
  const shm::Arena of_workers = *shm::Arena::adopt(dup(arena->descriptor()));
  of_workers.control().run_state = shm::RunState::kRunning;
  of_workers.control().episodes_per_run = UINT64_MAX;

  std::atomic<bool> stop{false}, learner_stop{false};
  auto learner = learn::Learner::start({.run_dir = folder.string(), .serve = false, .checkpoint = ""}, config,
                                       std::move(*arena), learner_stop);
  EXPECT_TRUE(learner) << learner.error().message;
  PipelineGameSet games(make);
  auto simulator = sim::SimWorker::create(
      games, of_workers,
      {.rules = {.seed = static_cast<uint64_t>(config.run.seed), .rewards = sim::RewardRules::from(config)}});
  EXPECT_TRUE(simulator) << simulator.error().message;
  std::optional<policy::PolicyWorker> policy_worker;  // else the learner has threads of them
  if (config.collection.policy_processes) {
    auto made = policy::PolicyWorker::create(config, of_workers, {});
    EXPECT_TRUE(made) << made.error().message;
    policy_worker = *std::move(made);
  }
  TrainedGame trained;
  std::thread simulates([&] { EXPECT_TRUE((*simulator)->run(stop)); });
  std::thread answers([&] {
    device::tune_math(1);
    EXPECT_TRUE(!policy_worker || policy_worker->run(stop));
  });
  std::thread drains([&] {  // as the supervisor does
    std::deque<double> window;
    double sum = 0;
    while (!stop) {
      while (const auto episode = of_workers.episodes().read(shm::EpisodeReader::kSupervisor)) {
        window.push_back(static_cast<double>(episode->score));
        sum += window.back();
        if (window.size() > goal.episodes) sum -= window.front(), window.pop_front();
        if (window.size() < goal.episodes) continue;
        trained.best_score = std::max(trained.best_score, sum / static_cast<double>(goal.episodes));
        if (trained.best_score >= goal.score) learner_stop = true;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  const Status done = (*learner)->run();
  EXPECT_TRUE(done) << done.error().message;
  stop = true;
  simulates.join(), answers.join(), drains.join();

  learn::StateDict state;
  (*learner)->algorithm().save(state);
  auto loaded = learn::make_algorithm(config, env, torch::kCPU);
  EXPECT_TRUE((*loaded)->load(state));
  trained.algorithm = std::move(*loaded);
  trained.env_frames = static_cast<double>((*learner)->env_frames());
  trained.seconds = monotonic_s() - began_s;
  return trained;
}

}  // namespace comrad::test
