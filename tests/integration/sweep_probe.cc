// A sweep without games, for the tests of its backends.
//
//   sweep_probe start FILE           `comrad sweep FILE`, with one scenario that needs no programs
//   sweep_probe sweep element ...    an attempt, as the backends start it
//   sweep_probe eval --policy RUN_DIR ...   what keeps a result requests: two episodes that scored 1 and 3;
//                                        a mean of 4 where it is greedy
//   sweep_probe train --train_dir D --experiment R --seed S --train_for_env_frames N ...
//
// The last replaces `comrad train`: it holds the run directory's lock, counts 100 env frames every 20 ms from where it
// stopped, notes it in status.json and, when SIGTERM comes, saves and leaves. What it lives through goes to D/events.log
// ("<run> begins 300 cpus 0,1", "<run> ends paused 700"). Seeds from 600 misbehave: 6xx fails at once with a message, 7xx is
// killed by SIGKILL after its first 1000 frames, and 8xx does not end before it was signalled to save once. The
// evaluation of a run of seed 5.. fails. With --learning_rate it has a score, 1000 times that rate, and each end leaves a
// checkpoint that it continues from: its text is the name of every run that went into it.
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/launch/run_directory.h"
#include "deploy/launch/signal_queue.h"
#include "deploy/process/child_program.h"
#include "deploy/settings/existing_run.h"
#include "deploy/sweep/local_backend.h"
#include "deploy/sweep/search_program.h"
#include "deploy/sweep/slurm_backend.h"
#include "deploy/sweep/sweep_element.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"

namespace {

using namespace comrad;
using namespace comrad::deploy;

std::string own_path() { return sibling_program("sweep_probe"); }

Expected<ScenarioDescription> describe(const RunConfig& config) {
  const std::string& name = config.run.scenario;
  const int64_t num_agents = config.environment.num_agents;
  if (name != "field") return Error{ErrorCode::kBadInput, "unknown scenario '" + name + "'"};
  ScenarioDescription scenario;
  scenario.name = name;
  scenario.env.num_agents = num_agents == 0 ? 2 : static_cast<int32_t>(num_agents);
  scenario.env.head_count = 1;
  scenario.env.head_sizes[0] = 3;
  scenario.supported_agents = {2, 3};
  return scenario;
}

int fail(const Error& error) {
  std::fprintf(stderr, "comrad sweep: error: %s\n", error.message.c_str());
  return exit_code(error);
}

Expected<int> start(const std::string& path) {
  COMRAD_TRY_ASSIGN(const SweepFile file, read_sweep_file(path));
  COMRAD_TRY_ASSIGN(const SweepPlan plan, plan_sweep(file, describe, usable_cores()));
  COMRAD_TRY_ASSIGN(const Descriptor lock, SweepFolder::lock(plan.folder));
  COMRAD_TRY_ASSIGN(const SweepFolder folder,
                    SweepFolder::make(plan, *read_file(path), facts_of_start("local")));
  COMRAD_TRY(begin_search(folder));
  return file.backend == SweepBackend::kSlurm ? run_slurm(plan, folder, own_path())
                                              : run_local(plan, folder, own_path());
}

Expected<int> element(const std::string& path, const std::string& name, const std::string& cpus) {
  COMRAD_TRY_ASSIGN(const SweepFolder folder, SweepFolder::open(path));
  ElementOptions options{.cpus = {}, .takes_turns = !cpus.empty(), .train_program = own_path()};
  for (std::size_t begin = 0; begin < cpus.size(); begin = std::min(cpus.find(',', begin), cpus.size()) + 1)
    options.cpus.push_back(std::atoi(cpus.c_str() + begin));
  return run_element(folder, *folder.find(name), options);
}

int train(const std::vector<std::string>& words) {
  std::map<std::string, std::string> flags;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::size_t equals = words[i].find('=');
    if (!words[i].starts_with("--")) continue;
    if (equals == std::string::npos && i + 1 < words.size())
      flags[words[i].substr(2)] = words[i + 1];
    else
      flags[words[i].substr(2, equals - 2)] = words[i].substr(equals + 1);
  }
  const std::string folder = flags["train_dir"], run = flags["experiment"], run_dir = folder + "/" + run;
  const auto note = [&](const std::string& text) {
    const int log = open((folder + "/events.log").c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    const std::string line = run + " " + text + "\n";
    (void)!write(log, line.data(), line.size());
    close(log);
  };
  SignalQueue signals;
  std::filesystem::create_directories(run_dir + "/checkpoint");
  const int lock = open((run_dir + "/.lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (flock(lock, LOCK_EX | LOCK_NB) != 0) {
    note("meets another");
    std::fprintf(stderr, "comrad train: error: run directory is used by a live run\n");
    return 2;
  }
  const int seed = std::atoi(flags["seed"].c_str());
  if (seed >= 600 && seed < 700) {
    note("fails");
    std::fprintf(stderr, "something before\ncomrad train: error: seed %d is unlucky\n", seed);
    return 2;
  }
  RunStatus status;
  status.env_frames_per_s = 5000;
  if (const auto before =
          nlohmann::json::parse(read_file(run_dir + "/status.json").value_or(""), nullptr, false);
      before.is_object())
    status.env_frames = before["env_frames"];
  std::string lineage;
  if (const auto rate = flags.find("learning_rate"); rate != flags.end()) {
    status.score_mean = 1000 * std::atof(rate->second.c_str());
    if (const auto checkpoint = find_checkpoint(run_dir, CheckpointKind::kLatest)) {
      lineage = read_file(*checkpoint).value_or("");
      status.env_frames =
          static_cast<uint64_t>(std::atol(checkpoint->substr(checkpoint->rfind('_') + 1).c_str()));
    }
  }
  note("begins " + std::to_string(status.env_frames) + (lineage.empty() ? "" : " from " + lineage) +
       " cpus " + joined(allowed_cpus(), ",") + " gpus " +
       (std::getenv("CUDA_VISIBLE_DEVICES") == nullptr ? "-" : std::getenv("CUDA_VISIBLE_DEVICES")));
  const double goal = std::atof(flags["train_for_env_frames"].c_str());
  const bool will_be_killed = seed >= 700 && seed < 800 && status.env_frames < 1000;
  const bool waits_for_signal = seed >= 800 && status.env_frames == 0;
  status.state = "running";
  while (waits_for_signal || static_cast<double>(status.env_frames) < goal) {
    pollfd source{.fd = signals.descriptor(), .events = POLLIN, .revents = 0};
    poll(&source, 1, 20);
    status.env_frames += 100;
    if (!write_status(run_dir, status)) return 1;
    if (will_be_killed && status.env_frames >= 1000) kill(getpid(), SIGKILL);
    if (signals.next() == 0) continue;
    status.state = "paused";
    break;
  }
  if (status.state == "running") status.state = "finished";
  RunConfig config;
  config.run.scenario = "field";
  config.run.seed = seed;
  config.run.train_dir = folder;
  (void)write_file_atomically(run_dir + "/config.toml", settings_to_toml(config), false);
  if (std::isfinite(status.score_mean)) {
    const std::string frames = std::to_string(status.env_frames);
    (void)write_file_atomically(run_dir + "/checkpoint/checkpoint_" + frames + "_" + frames + ".pt",
                                (lineage.empty() ? "" : lineage + ",") + run, false);
  }
  (void)write_file_atomically(run_dir + "/metrics.jsonl",
                              "{\"time_s\": 1.5, \"env_frames\": 100, \"policy_stats/avg_true_objective\": "
                              "0.123456789, \"perf/other\": 1}\n",
                              false);
  if (!write_status(run_dir, status)) return 1;
  note("ends " + status.state + " " + std::to_string(status.env_frames));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() >= 2 && words[0] == "start") {
    const Expected<int> done = start(words[1]);
    return done ? *done : fail(done.error());
  }
  if (words.size() >= 4 && words[0] == "sweep") {
    const Expected<int> done = element(words[2], words[3], words.size() > 4 ? words[4].substr(7) : "");
    return done ? *done : fail(done.error());
  }
  if (!words.empty() && words[0] == "train") return train(words);
  if (words.size() >= 3 && words[0] == "eval") {
    const bool greedy = std::ranges::find(words, "--stochastic") == words.end();
    std::printf(R"({"policy": "%s", "scenario": "field", "episodes": 2, "J_mean": %s, "return_mean": 0.5,
                    "checkpoint": "/somewhere", "map_hashes": {"seed 42": "xxh3:1"},
                    "each": [{"J": 1.0, "return": 0.25, "length_tics": 9}, {"J": 3.000001, "return": 0.75}]})",
                words[2].c_str(), greedy ? "4.0" : "2.0");
    return words[2].find("seed5") != std::string::npos ? 1 : 0;
  }
  return 2;
}
