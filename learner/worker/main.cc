// comrad-learner: trains (or serves) the policy of one run.
#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "learner/worker/bench.h"
#include "learner/worker/learner.h"
#include "policy_workers/policy/policy_net.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::learn {
namespace {

constexpr int kJoinTimeoutMs = 15'000;

bool has_log = false;
std::atomic<bool> stop_signalled{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may write it");

struct CommandLine {
  LearnerOptions learner;
  std::string arena;
  std::string mode = "train";
  double bench_seconds = 0;
  int32_t num_agents = 2;
  std::vector<int32_t> heads = {3, 3, 3};
  int32_t measurements = 0;
};

int exit_code(const Error& error) {
  switch (error.code) {
    case ErrorCode::kBadInput:
    case ErrorCode::kBadFormat:
    case ErrorCode::kNotFound:
    case ErrorCode::kUnsupported:
      return kExitBadInput;
    default:
      return kExitFailed;
  }
}

/// Before there is a log.
int fail(const Error& error, int code) {
  std::fprintf(stderr, "comrad-learner: %s\n", error.message.c_str());
  return code;
}

Expected<EnvShape> bench_shape(const CommandLine& command) {
  EnvShape env;
  env.num_agents = command.num_agents;
  env.measurement_count = command.measurements;
  if (command.heads.empty() || command.heads.size() > static_cast<std::size_t>(kMaxHeads))
    return Error{ErrorCode::kBadInput, "--heads needs 1 to " + std::to_string(kMaxHeads) + " sizes"};
  env.head_count = static_cast<int32_t>(command.heads.size());
  std::copy(command.heads.begin(), command.heads.end(), env.head_sizes.begin());
  TrajectoryShape shape;
  shape.env = env;
  COMRAD_TRY(validate(shape));
  return env;
}

Status train_or_serve(const CommandLine& command, const RunConfig& config, bool& is_unsaved) {
  shm::JoinRequest request;
  std::snprintf(request.role, sizeof(request.role), "learner");
  COMRAD_TRY_ASSIGN(shm::Arena arena, shm::join_arena(command.arena, request, kJoinTimeoutMs));
  COMRAD_TRY_ASSIGN(dds::Bus bus, dds::Bus::open(dds::bus_config_for_run(arena.run_id())));
  COMRAD_TRY_ASSIGN(
      const std::unique_ptr<Learner> learner,
      Learner::start(command.learner, config, std::move(arena), std::move(bus), stop_signalled));
  const Status result = learner->run();
  is_unsaved = learner->is_unsaved();
  // A run that diverged is no user's mistake that another start would repair.
  if (!result) return Error{ErrorCode::kSystem, result.error().message};
  return {};
}

int run(const CommandLine& command) {
  Expected<RunConfig> config = load_run_config(command.learner.run_dir + "/config.toml");
  if (!config) return fail(config.error(), exit_code(config.error()));
  policy::tune_math(static_cast<int>(std::max<int64_t>(1, config->learner_threads)));
  if (command.bench_seconds > 0) {
    // stdout is for the one JSON object.
    if (const Status logging = init_log("learner", ""); !logging) return fail(logging.error(), 1);
    const Expected<EnvShape> env = bench_shape(command);
    if (!env) return fail(env.error(), 2);
    const Status done = run_bench(*config, *env, command.bench_seconds);
    return done ? 0 : fail(done.error(), exit_code(done.error()));
  }
  const Status logging = init_log("learner", command.learner.run_dir + "/logs/learner-0.log");
  if (!logging) return fail(logging.error(), 1);
  has_log = true;
  bool is_unsaved = false;
  const Status done = train_or_serve(command, *config, is_unsaved);
  if (!done) {
    spdlog::error("{}", done.error().message);  // init_log sends errors to stderr as well
    spdlog::default_logger()->flush();
    return is_unsaved ? kExitNotSaved : exit_code(done.error());
  }
  spdlog::info("learner: stopped");
  spdlog::default_logger()->flush();
  return 0;
}

}  // namespace
}  // namespace comrad::learn

int main(int argc, char** argv) {
  comrad::prepare_process();
  comrad::policy::tune_allocator();
  comrad::learn::CommandLine command;
  CLI::App app("Trains the policy of one COMRAD run; normally started by `comrad train`.", "comrad-learner");
  app.add_option("--run_dir", command.learner.run_dir, "run directory with config.toml")->required();
  auto* arena = app.add_option("--arena", command.arena, "name of the run's arena socket");
  app.add_option("--mode", command.mode, "train, or serve one checkpoint's weights")
      ->check(CLI::IsMember({"train", "serve"}));
  app.add_option("--checkpoint", command.learner.checkpoint,
                 "serve: checkpoint to publish; train: where to begin when the run has none");
  auto* bench =
      app.add_option("--bench", command.bench_seconds, "train on synthetic data for so many seconds")
          ->check(CLI::PositiveNumber);
  app.add_option("--num_agents", command.num_agents, "bench: agents");
  app.add_option("--heads", command.heads, "bench: sizes of the action heads")->delimiter(',');
  app.add_option("--measurements", command.measurements, "bench: length of the measurement vector");
  try {
    app.parse(argc, argv);
    if (arena->empty() && bench->empty()) throw CLI::RequiredError("--arena (or --bench)");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  command.learner.serve = command.mode == "serve";

  struct sigaction action {};
  action.sa_handler = [](int) { comrad::learn::stop_signalled = true; };
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGINT, SIG_IGN);  // the supervisor decides
  try {
    return comrad::learn::run(command);
  } catch (const std::exception& error) {
    // The log, once there is one, sends this to stderr too.
    if (comrad::learn::has_log)
      spdlog::critical("{}", error.what());
    else
      std::fprintf(stderr, "comrad-learner: %s\n", error.what());
    return 1;
  }
}
