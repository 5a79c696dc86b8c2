// Replaces the three worker programs in supervisor_test: it joins the run, counts decisions, obeys the
// run state and misbehaves as `<run_dir>/fake.txt` orders. What it lives through goes to
// `<run_dir>/events.log`.
//
// Lines of fake.txt, `<name> <habit> [number]`, where name is sim-0, policy-0, learner, ...:
//   say TEXT...       print TEXT on standard error at the start
//   exit CODE         leave with CODE right after joining
//   deaf 0            ignore SIGTERM and the run state
//   finish MS         learner: reach the run's goal and leave with 0 after MS milliseconds of running
//   restored COUNT    counters begin at COUNT, as those of a resumed learner do, env frames at 4 x COUNT
//   episodes COUNT    sim: finish COUNT episodes, then play on
//   fill 0            sim: take a slab and hold it with 5 rows filled
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/arena_socket.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/learner_report.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace {

std::atomic<bool> terminated{false};

void append(const std::string& path, const std::string& line) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  [[maybe_unused]] const ssize_t written = write(file, line.data(), line.size());
  close(file);
}

const char* environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "-" : value;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace comrad;
  std::string run_dir, arena_name, all;
  int index = 0;
  for (int i = 1; i < argc; ++i) {
    all += std::string(" ") + argv[i];
    if (i + 1 == argc) continue;
    if (!std::strcmp(argv[i], "--run_dir")) run_dir = argv[i + 1];
    if (!std::strcmp(argv[i], "--arena")) arena_name = argv[i + 1];
    if (!std::strcmp(argv[i], "--worker_index")) index = std::atoi(argv[i + 1]);
  }
  const std::string program = argv[0];
  const std::string role = program.ends_with("sim-worker")      ? "sim"
                           : program.ends_with("policy-worker") ? "policy"
                                                                : "learner";
  const std::string name = role == "learner" ? role : role + "-" + std::to_string(index);
  const std::string events = run_dir + "/events.log";
  const auto tell = [&](const std::string& what) { append(events, name + " " + what + "\n"); };

  std::map<std::string, std::string> habits;
  std::ifstream script(run_dir + "/fake.txt");
  for (std::string line; std::getline(script, line);) {
    std::istringstream words(line);
    std::string who, habit, rest;
    words >> who >> habit;
    std::getline(words >> std::ws, rest);
    if (who == name) habits[habit] = rest;
  }
  signal(SIGTERM, [](int) { terminated = true; });
  if (habits.contains("deaf")) signal(SIGTERM, SIG_IGN);
  tell("start " + std::to_string(getpid()) + all);
  tell(std::string("threads ") + environment("OMP_NUM_THREADS") + " " + environment("LP_NUM_THREADS"));
  if (habits.contains("say")) std::fprintf(stderr, "%s\n", habits["say"].c_str());

  shm::JoinRequest request;
  std::strncpy(request.role, role.c_str(), sizeof request.role - 1);
  request.worker_index = static_cast<uint32_t>(index);
  auto arena = shm::join_arena(arena_name, request, 5000);
  if (!arena) {
    std::fprintf(stderr, "%s\n", arena.error().message.c_str());
    return 1;
  }
  if (habits.contains("exit")) return std::atoi(habits["exit"].c_str());

  shm::ControlBlock& control = arena->control();
  shm::WorkerCounters& counters = role == "sim"      ? arena->sim_counters(index)
                                  : role == "policy" ? arena->policy_counters(index)
                                                     : arena->learner_counters();
  counters.begin_life();
  TrainStats report;
  if (habits.contains("restored")) {
    counters.decisions = counters.batches = report.decisions = std::stoull(habits["restored"]);
    report.env_frames = 4 * report.decisions;
    control.learner_env_frames.store(report.env_frames);
    control.saved_env_frames.store(report.env_frames);
  }
  if (role == "learner") control.learner_decisions_before = counters.decisions.load();
  counters.state = shm::WorkerState::kRunning;
  if (habits.contains("fill")) {
    if (const auto slab = arena->slabs().acquire(index))
      arena->slabs().header(static_cast<int>(*slab)).length = 5;
    arena->accounts().of(index * arena->shape().envs_per_worker).made += 5;
  }
  const uint64_t episode_count = habits.contains("episodes") ? std::stoull(habits["episodes"]) : 0;
  double running_since_s = 0;
  uint64_t episodes = 0;
  const bool is_deaf = habits.contains("deaf");
  while (is_deaf || (!terminated && control.run_state.load() != shm::RunState::kStopping)) {
    if (control.run_state.load() == shm::RunState::kRunning) {
      if (running_since_s == 0) {
        running_since_s = monotonic_s();
        tell("running");
        if (role == "learner") usleep(300'000);  // simulators collect a first batch
      }
      // As if the simulators had sealed just what it takes.
      shm::EnvAccount& account = arena->accounts().of(arena->shape().env_count() - 1);
      if (role == "learner")
        for (auto* count : {&account.made, &account.sealed, &account.taken}) *count += 32;
      counters.decisions += role == "learner" ? 64 : 10;
      counters.batches += 1;
      for (; episodes < episode_count; ++episodes) {
        EpisodeRecord record{};
        record.episode_id = episodes;
        record.episode_seed = 1000 + episodes;
        record.env_index = static_cast<uint32_t>(index);
        record.length_steps = 100;
        record.length_tics = 400;
        record.terminated = 1;
        record.agent_count = static_cast<uint32_t>(arena->shape().trajectory.env.num_agents);
        record.score = static_cast<float>(episodes);
        record.agent_return[1] = -1.0f;
        arena->episodes().write(record);
      }
      if (role == "learner") {
        report.env_frames += 256;
        report.decisions += 64;
        report.learner_version += 1;
        report.score_mean = 123.5;
        report.episodes = 3;
        report.policy_lag_mean = 2.0;
        report.env_frames_per_s = 5120;
        report.decisions_per_s = 1280;
        std::strcpy(report.last_checkpoint, "checkpoint/fake.pt");
        control.learner_env_frames.store(report.env_frames);
        arena->learner_reports().publish(report);
      }
      if (habits.contains("finish") && monotonic_s() - running_since_s > 1e-3 * std::stod(habits["finish"])) {
        control.goal_reached = 1;
        tell("finished");
        return kExitDone;
      }
    }
    usleep(50'000);
  }
  tell(terminated ? "terminated" : "stopped");
  return 0;
}
