#include "rollout_buffer/shm/worker_shell.h"

#include <spdlog/fmt/fmt.h>

#include <signal.h>
#include <sys/prctl.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <limits>
#include <optional>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::shm {
namespace {

constexpr int kJoinTimeoutMs = 20'000;

std::atomic<bool> stop_signalled{false};  // a signal handler has no other way to speak
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler writes it");

void take_signals_of_a_run() {
  struct sigaction on_term {};
  on_term.sa_handler = [](int) { stop_signalled.store(true); };
  sigaction(SIGTERM, &on_term, nullptr);  // without SA_RESTART: a waiting worker wakes at once
  signal(SIGINT, SIG_IGN);                // Ctrl-C reaches the whole process group; the supervisor decides
  prctl(PR_SET_PDEATHSIG, SIGTERM);
}

}  // namespace

WorkerShell::WorkerShell(WorkerProgram program)
    : program_(std::move(program)), flags_(program_.description, program_.name) {
  prepare_process();
  flags_.add("--run_dir", run_dir_, "the run's folder, with config.toml").required();
  arena_flag_ = flags_.add("--arena", arena_, "name of the run's socket");
  if (!program_.is_single)
    flags_.add("--worker_index", worker_index_, "which of its kind this is, from 0")
        .range(0, std::numeric_limits<int>::max());
  if (program_.has_bench) {
    bench_flag_ = flags_.add("--bench", bench_seconds_,
                             "no run: measures for so many seconds alone, prints one JSON object");
    bench_flag_->range(0.01, 86400.0);
  }
  if (program_.describes)
    flags_.add("--describe", is_description_,
               "no run: prints the size of its part of config.toml, as one JSON object");
}

std::string words_of_failure(std::string_view what) {
  const bool is_full = what.find("CUDA out of memory") != std::string_view::npos ||
                       what.find("CUBLAS_STATUS_ALLOC_FAILED") != std::string_view::npos;
  if (!is_full) return std::string(what);
  return std::string(what.substr(0, what.find('\n'))) +
         "; lower --micro_batch_size (what is in training at a time), --num_envs_per_worker or "
         "--policy_workers, or end what else uses this GPU";
}

const std::atomic<bool>& WorkerShell::stop() const { return stop_signalled; }

int WorkerShell::run(int argc, char** argv, const WorkerJobs& jobs) {
  if (const std::optional<int> code = flags_.parse(argc, argv)) return *code;
  is_bench_ = bench_flag_ && bench_flag_->is_given();
  if (is_in_a_run() && !arena_flag_->is_given())
    return fail(
        std::string("give --arena NAME to join a run") + (program_.has_bench ? ", or --bench SECONDS" : ""),
        kExitBadInput);
  if (is_in_a_run()) take_signals_of_a_run();
  try {
    const std::string index = std::to_string(worker_index_);
    const std::string name = program_.is_single ? program_.role : program_.role + "-" + index;
    // The standard output of the others is for their one JSON object.
    const Status log =
        init_log(name, !is_in_a_run() ? "" : run_dir_ + "/logs/" + program_.role + "-" + index + ".log");
    if (!log) return fail(log.error().message, exit_code(log.error()));
    has_log_ = true;
    const Status done = do_job(jobs);
    if (!done) return fail(done.error().message, exit_code(done.error()));
    if (is_in_a_run()) spdlog::info("stopped");
    return kExitDone;
  } catch (const std::exception& failure) {  // from libraries; ours do not throw
    return fail(words_of_failure(failure.what()), kExitFailed);
  }
}

Status WorkerShell::do_job(const WorkerJobs& jobs) const {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(run_dir_ + "/config.toml"));
  if (is_description_) return jobs.describe(config);
  return is_bench_ ? jobs.bench(config, bench_seconds_) : jobs.work(config);
}

int WorkerShell::fail(const std::string& message, int code) const {
  if (has_log_ && is_in_a_run())
    spdlog::error("{}", message);  // init_log sends errors to standard error as well
  else
    std::fprintf(stderr, "%s: %s\n", program_.name.c_str(), message.c_str());
  return code;
}

Expected<Arena> WorkerShell::join() const {
  COMRAD_TRY(
      share_stages(run_dir_ + "/" + kStagesFolder, fmt::format("{}-{}", program_.role, worker_index_)));
  JoinRequest request;
  std::strncpy(request.role, program_.role.c_str(), sizeof request.role - 1);
  request.worker_index = static_cast<uint32_t>(worker_index_);
  return join_arena(arena_, request, kJoinTimeoutMs);
}

void BenchShape::add_flags(Flags& flags) {
  flags.add("--num_agents", num_agents, "bench, describe: agents per environment").range(1, kMaxAgents);
  flags.add("--heads", heads, "bench, describe: sizes of the action heads, 3,3,3").separated_by(',');
  flags.add("--measurements", measurements, "bench, describe: length of the measurement vector")
      .range(0, 1024);
  flags
      .add("--global_state", global_state,
           "bench, describe: numbers of the true state that critics see with critic_state global")
      .range(0, 1024);
}

Expected<EnvShape> BenchShape::env() const {
  if (heads.empty() || heads.size() > static_cast<std::size_t>(kMaxHeads))
    return Error{ErrorCode::kBadInput,
                 fmt::format("--heads has {} entries; it needs 1 to {}", heads.size(), kMaxHeads)};
  TrajectoryShape shape;
  shape.env.num_agents = num_agents;
  shape.env.measurement_count = measurements;
  shape.env.global_state_count = global_state;
  shape.env.head_count = static_cast<int32_t>(heads.size());
  std::ranges::copy(heads, shape.env.head_sizes.begin());
  COMRAD_TRY(validate(shape));
  return shape.env;
}

}  // namespace comrad::shm
