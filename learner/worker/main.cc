// comrad-learner: trains (or serves) the policy of one run, or its benchmark.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <string>

#include "learner/worker/bench.h"
#include "learner/worker/learner.h"
#include "learner/worker/seat_server.h"
#include "policy_workers/policy/policy_net.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

void tune_math(const RunConfig& config) {
  policy::tune_math(static_cast<int>(std::max<int64_t>(1, config.collection.learner_threads)));
}

Status train_or_serve(const shm::WorkerShell& shell, const RunConfig& config, learn::LearnerOptions options,
                      bool serves_seats) {
  options.run_dir = shell.run_dir();
  tune_math(config);
  COMRAD_TRY_ASSIGN(shm::Arena arena, shell.join());
  if (serves_seats) return learn::serve_seats(shell.run_dir(), arena, shell.stop());
  COMRAD_TRY_ASSIGN(dds::Bus bus, dds::Bus::open(dds::bus_config_for_run(arena.run_id())));
  COMRAD_TRY_ASSIGN(const std::unique_ptr<learn::Learner> learner,
                    learn::Learner::start(options, config, std::move(arena), std::move(bus), shell.stop()));
  return learner->run();
}

Status bench(const RunConfig& config, const shm::BenchShape& shape, double seconds, bool counts_work) {
  COMRAD_TRY_ASSIGN(const EnvShape env, shape.env());
  tune_math(config);
  return learn::run_bench(config, env, seconds, counts_work);
}

}  // namespace

int main(int argc, char** argv) {
  shm::WorkerShell shell({.name = "comrad-learner",
                          .role = "learner",
                          .description = "Trains the policy of one run; normally started by `comrad train`.",
                          .is_single = true});
  policy::tune_allocator();
  learn::LearnerOptions options;
  std::string mode = "train";
  bool serves_seats = false, counts_work = false;
  shm::BenchShape shape;
  shell.flags()
      .add_option("--mode", mode, "train, or serve one checkpoint's weights")
      ->check(CLI::IsMember({"train", "serve"}));
  shell.flags().add_option("--checkpoint", options.checkpoint,
                           "serve: checkpoint to publish; train: where to begin when the run has none");
  shell.flags().add_flag("--seats", serves_seats,
                         "serve the weights of all networks of seats.toml in --run_dir");
  shell.flags().add_flag("--count_work", counts_work,
                         "bench: also what the networks' operators do on a GPU's path");
  shape.add_flags(shell.flags());
  return shell.run(argc, argv,
                   {.work =
                        [&](const RunConfig& config) {
                          options.serve = mode == "serve";
                          return train_or_serve(shell, config, options, serves_seats);
                        },
                    .bench = [&](const RunConfig& config,
                                 double seconds) { return bench(config, shape, seconds, counts_work); }});
}
