// comrad-learner: trains (or serves) the policy of one run, or its benchmark.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "learner/checkpoint/checkpoint.h"
#include "learner/ranks/rank_group.h"
#include "learner/ranks/rank_processes.h"
#include "learner/worker/bench.h"
#include "learner/worker/follower.h"
#include "learner/worker/learner.h"
#include "learner/worker/seat_server.h"
#include "policy_workers/device/cpu_tuning.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

void tune_math(const RunConfig& config) {
  device::tune_math(static_cast<int>(std::max<int64_t>(1, config.collection.learner_threads)));
}

Status train_or_serve(const shm::WorkerShell& shell, const RunConfig& config, learn::LearnerOptions options,
                      bool serves_seats) {
  options.run_dir = shell.run_dir();
  COMRAD_TRY_ASSIGN(shm::Arena arena, shell.join());
  if (serves_seats) {
    tune_math(config);
    return learn::serve_seats(shell.run_dir(), arena, shell.stop());
  }
  const int learners = options.serve ? 1 : static_cast<int>(config.collection.learners);
  COMRAD_TRY_ASSIGN(learn::RankProcesses processes, learn::RankProcesses::fork(learners));
  const int rank = processes.rank();
  if (rank > 0) {
    const std::string name = fmt::format("learner-{}", rank);
    COMRAD_TRY(init_log(name, shell.run_dir() + "/logs/" + name + ".log"));
  }
  tune_math(config);
  options.check_others = [&] { return processes.check(); };
  COMRAD_TRY_ASSIGN(
      const learn::RankGroup::Options rank_options,
      learn::RankGroup::Options::of(config.collection.device, rank, learners, processes.rendezvous()));
  COMRAD_TRY_ASSIGN(const std::unique_ptr<learn::RankGroup> ranks,
                    learn::RankGroup::join(rank_options, options.check_others));
  if (rank > 0) {
    COMRAD_TRY_ASSIGN(
        const std::unique_ptr<learn::Follower> follower,
        learn::Follower::start(shell.run_dir(), config, std::move(arena), shell.stop(), *ranks));
    return follower->run();
  }
  options.ranks = ranks.get();
  COMRAD_TRY_ASSIGN(const std::unique_ptr<learn::Learner> learner,
                    learn::Learner::start(options, config, std::move(arena), shell.stop()));
  const Status result = learner->run();
  processes.stop();  // before their connections to this one close
  return result;
}

Status bench(const RunConfig& config, const shm::BenchShape& shape, double seconds) {
  COMRAD_TRY_ASSIGN(const EnvShape env, shape.env());
  tune_math(config);
  return learn::run_bench(config, env, seconds);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 5 && std::string_view(argv[1]) == "--to_be_played") {  // comrad pack-policies
    const std::optional<std::string> settings = read_file(argv[4]);
    const Status written = settings
                               ? learn::write_to_be_played(argv[2], argv[3], *settings)
                               : Status(Error{ErrorCode::kNotFound, std::string("cannot read ") + argv[4]});
    if (!written) std::fprintf(stderr, "comrad-learner: error: %s\n", written.error().message.c_str());
    return written ? 0 : exit_code(written.error());
  }
  shm::WorkerShell shell({.name = "comrad-learner",
                          .role = "learner",
                          .description = "Trains the policy of one run; normally started by `comrad train`.",
                          .is_single = true});
  device::tune_allocator();
  learn::LearnerOptions options;
  std::string mode = "train";
  bool serves_seats = false;
  shm::BenchShape shape;
  shell.flags().add("--mode", mode, "train, or serve one checkpoint's weights").one_of({"train", "serve"});
  shell.flags().add("--checkpoint", options.checkpoint,
                    "serve: checkpoint to publish; train: where to begin when the run has none");
  shell.flags().add("--seats", serves_seats, "serve the weights of all networks of seats.toml in --run_dir");
  shape.add_flags(shell.flags());
  return shell.run(
      argc, argv,
      {.work =
           [&](const RunConfig& config) {
             options.serve = mode == "serve";
             return train_or_serve(shell, config, options, serves_seats);
           },
       .bench = [&](const RunConfig& config, double seconds) { return bench(config, shape, seconds); }});
}
