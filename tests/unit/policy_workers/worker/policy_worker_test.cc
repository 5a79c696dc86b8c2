#include "policy_workers/worker/policy_worker.h"

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <span>
#include <thread>
#include <tuple>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/seat_plan.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::policy {
namespace policy_worker_test {

void publish(const shm::Arena& arena, const ActorCritic& net, PolicyVersion version) {
  arena.weights().publish(net.weights(), version);
}

/// A policy worker that runs in a thread until the run stops.
class RunningWorker {
 public:
  RunningWorker(const RunConfig& config, const shm::Arena& arena, PolicyWorkerOptions options)
      : arena_(arena) {
    auto made = PolicyWorker::create(config, arena, options);
    EXPECT_TRUE(made) << made.error().message;
    worker_ = std::make_unique<PolicyWorker>(std::move(made).value());
    thread_ = std::thread([this] { result_ = worker_->run(stop_); });
  }
  Status stop() {
    arena_.control().run_state.store(shm::RunState::kStopping);
    shm::ring(arena_.control().run_state_changed);
    thread_.join();
    return result_;
  }

 private:
  const shm::Arena& arena_;
  std::unique_ptr<PolicyWorker> worker_;
  std::atomic<bool> stop_{false};
  Status result_;
  std::thread thread_;
};

TEST(PolicyWorker, WaitsForWeightsAndStampsTheVersionThatActed) {
  const NetworkOptions options = small_network();
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, learner.weights_bytes());
  FakeSplit split(arena, 0, 0);
  RunConfig config = small_config();
  config.collection.max_wait_us = 10'000'000;  // a split is one batch, however slowly it is committed
  RunningWorker worker(config, arena, {});
  split.commit_act(true);
  EXPECT_TRUE(test::wait_until([&] { return arena.control().weights_published.sleepers.load() == 1; }));
  EXPECT_FALSE(split.envs[0].has_answer()) << "no weights, no answer";
  for (const PolicyVersion version : {5u, 6u}) {
    publish(arena, learner, version);
    if (version == 6) split.commit_act();
    ASSERT_TRUE(split.await());
    for (FakeEnv& env : split.envs) EXPECT_EQ(env.slab().policy_version(env.step(), 1), version);
    const Tensor frame =
        torch::from_blob(split.envs[0].slab().frame(0, 0).data(), {1, 3, 40, 44}, torch::kUInt8);
    const PolicyOutput expected = learner.step(frame, torch::zeros({1, 3}), torch::zeros({1, 16}));
    EXPECT_NEAR(split.envs[0].slab().value(0, 0), expected.value.item<float>(), 1e-5);
    split.take_act();
  }
  EXPECT_TRUE(worker.stop());
  EXPECT_EQ(arena.policy_counters(0).decisions.load(), 8u);
  EXPECT_EQ(arena.policy_counters(0).batches.load(), 2u);
  EXPECT_EQ(arena.policy_counters(0).state.load(), shm::WorkerState::kStopped);
  EXPECT_GT(arena.policy_counters(0).busy_ns.load(), 0u);
}

TEST(PolicyWorker, EveryAgentActsWithItsOwnNetworkAndTheCriticsStateAdvancesToo) {
  RunConfig config = small_config();
  config.run.algo = "happo";
  config.network.critic_hidden_sizes = "12,6";
  const NetworkOptions options = NetworkOptions::from(config, small_network().env);
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, learner.weights_bytes());
  publish(arena, learner, 3);
  FakeSplit split(arena, 0, 0);
  RunningWorker worker(config, arena, {});
  Tensor state = torch::zeros({2, options.recurrent_state_count()});
  ASSERT_EQ(state.size(1), 2 * 16);
  for (int step = 0; step < 2; ++step) {
    split.commit_act(step == 0);
    ASSERT_TRUE(split.await());
    FakeEnv& env = split.envs[0];
    std::vector<Tensor> frames, measurements;
    for (int agent = 0; agent < 2; ++agent) {
      frames.push_back(
          torch::from_blob(env.slab().frame(env.step(), agent).data(), {3, 40, 44}, torch::kUInt8).clone());
      measurements.push_back(
          torch::from_blob(env.slab().measurement(env.step(), agent).data(), {3}, torch::kFloat32).clone());
    }
    const PolicyOutput expected = learner.step(torch::stack(frames), torch::stack(measurements), state);
    state = expected.recurrent_state;
    for (int agent = 0; agent < 2; ++agent) {
      EXPECT_NEAR(env.slab().value(env.step(), agent), expected.value[agent].item<float>(), 1e-5) << step;
      for (int choice = 0; choice < 5; ++choice)
        EXPECT_NEAR(env.slab().logits(env.step(), agent)[static_cast<size_t>(choice)],
                    expected.logits[agent][choice].item<float>(), 1e-5)
            << step << agent;
    }
    split.take_act();
  }
  EXPECT_TRUE(worker.stop());
}

TEST(PolicyWorker, AStagedWorkerAnswersAsTheNetworkDoes) {
  const NetworkOptions options = small_network();
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, learner.weights_bytes());
  publish(arena, learner, 3);
  FakeSplit split(arena, 0, 0);
  const device::OperatorPath as_on_a_gpu;
  RunningWorker worker(small_config(), arena, {});
  Tensor state = torch::zeros({1, 16});
  for (int step = 0; step < 3; ++step) {
    split.commit_act(step == 0);
    ASSERT_TRUE(split.await());
    FakeEnv& env = split.envs[0];
    const Tensor frame =
        torch::from_blob(env.slab().frame(env.step(), 0).data(), {1, 3, 40, 44}, torch::kUInt8);
    const PolicyOutput expected = learner.step(frame, torch::zeros({1, 3}), state);
    state = expected.recurrent_state;
    EXPECT_NEAR(env.slab().value(env.step(), 0), expected.value.item<float>(), 1e-5) << step;
    split.take_act();
  }
  EXPECT_TRUE(worker.stop());
}

/// Writes what the launcher does: the settings of the networks, and which player has which seat.
void write_seats(const test::ScratchFolder& folder, const std::vector<RunConfig>& networks,
                 const std::vector<Seat>& seats) {
  SeatPlan plan;
  for (const RunConfig& config : networks)
    plan.networks.push_back(
        {folder.write("network_" + std::to_string(plan.networks.size()) + ".toml", settings_to_toml(config)),
         "unused.pt"});
  plan.seats = seats;
  folder.write(kSeatPlanFile, seat_plan_text(plan));
}

TEST(PolicyWorker, EverySeatIsPlayedByItsOwnNetwork) {
  RunConfig first = small_config(), second = small_config();
  first.run.algo = "happo";
  first.network.critic_hidden_sizes = "12,6";
  second.run.algo = "vdn";
  second.network.rnn_type = RnnType::kLstm;
  second.network.rnn_size = 20;
  const EnvShape env = small_network().env;
  const ActorCritic happo = ActorCritic::create(NetworkOptions::from(first, env), 1, torch::kCPU),
                    vdn = ActorCritic::create(NetworkOptions::from(second, env), 2, torch::kCPU);
  const test::ScratchFolder folder;
  write_seats(folder, {first, second}, {{SeatPlayer::kNetwork, 1}, {SeatPlayer::kNetwork, 0}});
  NetworkOptions roomy = small_network("lstm");
  roomy.rnn_size = 20;  // the larger state: 40 floats
  const float epsilon = 0;
  std::vector<std::byte> bytes;
  for (const ActorCritic* net : {&happo, &vdn}) {
    std::ranges::copy(std::as_bytes(std::span(&epsilon, 1)), std::back_inserter(bytes));
    std::ranges::copy(net->weights(), std::back_inserter(bytes));
  }
  const shm::Arena arena = make_arena(roomy, {}, static_cast<int64_t>(bytes.size()));
  arena.weights().publish(bytes, 1);
  FakeSplit split(arena, 0, 0);
  RunningWorker worker(small_config(), arena, {.seats_of = folder.string(), .is_evaluation = true});
  Tensor happo_state = torch::zeros({2, 32}), vdn_state = torch::zeros({2, 40});
  for (int step = 0; step < 3; ++step) {
    split.commit_act(step == 0);
    ASSERT_TRUE(split.await());
    FakeEnv& played = split.envs[1];
    std::vector<Tensor> frames, measurements;
    for (int agent = 0; agent < 2; ++agent) {
      frames.push_back(
          torch::from_blob(played.slab().frame(played.step(), agent).data(), {3, 40, 44}, torch::kUInt8)
              .clone());
      measurements.push_back(
          torch::from_blob(played.slab().measurement(played.step(), agent).data(), {3}, torch::kFloat32)
              .clone());
    }
    const PolicyOutput by_happo = happo.step(torch::stack(frames), torch::stack(measurements), happo_state),
                       by_vdn = vdn.step(torch::stack(frames), torch::stack(measurements), vdn_state);
    happo_state = by_happo.recurrent_state;
    vdn_state = by_vdn.recurrent_state;
    for (int choice = 0; choice < 5; ++choice) {
      const auto of_agent = [&](int agent) {
        return played.slab().logits(played.step(), agent)[static_cast<size_t>(choice)];
      };
      EXPECT_NEAR(of_agent(0), by_vdn.logits[0][choice].item<float>(), 1e-5) << step;
      EXPECT_NEAR(of_agent(1), by_happo.logits[1][choice].item<float>(), 1e-5) << step;
    }
    split.take_act();
  }
  EXPECT_TRUE(worker.stop());
}

TEST(PolicyWorker, SeatsWithoutANetworkNeedNoWeights) {
  const test::ScratchFolder folder;
  write_seats(folder, {}, {{SeatPlayer::kNoop}, {SeatPlayer::kRandom}});
  const shm::Arena arena = make_arena(small_network(), {});
  FakeSplit split(arena, 0, 1);
  RunningWorker worker(small_config(), arena, {.is_greedy = true, .seats_of = folder.string()});
  int pressed = 0;
  for (int round = 0; round < 20; ++round) {
    split.commit_act();
    ASSERT_TRUE(split.await());
    const FakeEnv& env = split.envs[0];
    EXPECT_EQ(env.slab().action(env.step(), 0)[0], 0);
    EXPECT_EQ(env.slab().action(env.step(), 0)[1], 0);
    pressed += env.slab().action(env.step(), 1)[0] != 0;
    split.take_act();
  }
  EXPECT_GT(pressed, 5);
  EXPECT_TRUE(worker.stop());
}

TEST(PolicyWorker, RefusesSeatsThatDoNotFitTheArena) {
  RunConfig large = small_config();
  large.network.rnn_size = 64;
  const shm::Arena arena = make_arena(small_network(), {}, 1 << 24);
  for (const auto& [networks, seats, message] :
       std::vector<std::tuple<std::vector<RunConfig>, std::vector<Seat>, std::string>>{
           {{large}, {{SeatPlayer::kNetwork, 0}, {SeatPlayer::kNoop}}, "64 floats of recurrent state"},
           {{}, {{SeatPlayer::kNoop}}, "lists 1 seats, the team has 2 agents"}}) {
    const test::ScratchFolder folder;
    write_seats(folder, networks, seats);
    const auto worker = PolicyWorker::create(small_config(), arena, {.seats_of = folder.string()});
    ASSERT_FALSE(worker);
    EXPECT_NE(worker.error().message.find(message), std::string::npos) << worker.error().message;
  }
}

TEST(PolicyWorker, RandomPlayNeedsNoWeights) {
  const shm::Arena arena = make_arena(small_network(), {});
  FakeSplit split(arena, 0, 1);
  RunningWorker worker(small_config(), arena, {.is_random = true});
  for (int round = 0; round < 20; ++round) {
    split.commit_act();
    ASSERT_TRUE(split.await());
    EXPECT_EQ(split.envs[0].slab().value(split.envs[0].step(), 0), 0.0f);
    EXPECT_NEAR(split.envs[0].slab().log_prob(split.envs[0].step(), 0), -1.791759f, 1e-5f);
    split.take_act();
  }
  EXPECT_TRUE(worker.stop());
}

TEST(PolicyWorker, GreedyPlayTakesTheMostProbableChoices) {
  const NetworkOptions options = small_network("none");
  const ActorCritic learner = ActorCritic::create(options, 1, torch::kCPU);
  const shm::Arena arena = make_arena(options, {}, learner.weights_bytes());
  RunConfig config = small_config();
  config.network.use_rnn = false;
  publish(arena, learner, 1);
  FakeSplit split(arena, 0, 0);
  RunningWorker worker(config, arena, {.is_greedy = true});
  for (int round = 0; round < 10; ++round) {
    split.commit_act();
    ASSERT_TRUE(split.await());
    for (FakeEnv& env : split.envs) {
      const auto logits = env.slab().logits(env.step(), 0);
      EXPECT_EQ(env.slab().action(env.step(), 0)[0],
                std::max_element(logits.begin(), logits.begin() + 3) - logits.begin());
      EXPECT_EQ(env.slab().action(env.step(), 0)[1], logits[4] > logits[3] ? 1 : 0);
    }
    split.take_act();
  }
  EXPECT_TRUE(worker.stop());
}

TEST(PolicyWorker, RefusesARunWhoseShapesDoNotFitItsNetwork) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {}, 1 << 20);
  RunConfig config = small_config();
  config.network.rnn_type = RnnType::kLstm;
  EXPECT_EQ(PolicyWorker::create(config, arena, {}).error().code, ErrorCode::kBadInput);
  config = small_config();
  EXPECT_EQ(PolicyWorker::create(config, arena, {.worker_index = 1}).error().code, ErrorCode::kBadInput);
  config.collection.device = "tpu";
  EXPECT_EQ(PolicyWorker::create(config, arena, {}).error().code, ErrorCode::kBadInput);
  config.collection.policy_device = "cpu,tpu";
  EXPECT_TRUE(PolicyWorker::create(config, arena, {})) << "the first of them has its own device";
  const shm::Arena narrow = make_arena(options, {}, 64);
  EXPECT_EQ(PolicyWorker::create(small_config(), narrow, {}).error().code, ErrorCode::kBadInput);
}

/// Runs the program, returns its exit code and what it printed on stdout.
std::pair<int, std::string> run_program(const std::string& arguments) {
  const std::string command = fmt::format("{} {} 2>/dev/null", COMRAD_POLICY_WORKER_PROGRAM, arguments);
  FILE* pipe = popen(command.c_str(), "r");
  std::string output;
  char buffer[512];
  while (fgets(buffer, sizeof buffer, pipe) != nullptr) output += buffer;
  const int status = pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, output};
}

TEST(PolicyWorkerProgram, BenchPrintsOneObjectAndBadInputExitsWithTwo) {
  const test::ScratchFolder run_dir;
  RunConfig config = small_config();
  config.collection.num_envs_per_worker = 2;
  run_dir.write("config.toml", settings_to_toml(config));
  const auto [code, output] =
      run_program("--run_dir " + run_dir.string() + " --bench 0.05 --heads 3,2 --measurements 1");
  EXPECT_EQ(code, 0);
  EXPECT_NE(output.find("\"bench\":\"inference\""), std::string::npos) << output;
  EXPECT_NE(output.find("\"batch_rows\":4"), std::string::npos) << output;
  EXPECT_EQ(std::count(output.begin(), output.end(), '\n'), 1);
  for (const char* bad : {"--run_dir /nonexistent --bench 1", "--run_dir RUN",
                          "--run_dir RUN --bench 0.05 --heads 3,99", "--run_dir RUN --bogus"}) {
    std::string arguments = bad;
    if (const size_t at = arguments.find("RUN"); at != std::string::npos)
      arguments.replace(at, 3, run_dir.string());
    EXPECT_EQ(run_program(arguments).first, 2) << arguments;
  }
}

}  // namespace policy_worker_test
}  // namespace comrad::policy
