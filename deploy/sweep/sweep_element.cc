#include "deploy/sweep/sweep_element.h"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "deploy/launch/signal_desk.h"
#include "deploy/process/child_program.h"
#include "deploy/sweep/sweep_results.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

constexpr int kElementTickMs = 200;
constexpr std::size_t kErrorBytesMax = 500;
constexpr std::size_t kLinesKept = 20;

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// "123_4", or the job's number where it is no array; empty outside of Slurm.
std::string slurm_element() {
  const std::string array = environment("SLURM_ARRAY_JOB_ID"), index = environment("SLURM_ARRAY_TASK_ID");
  return array.empty() || index.empty() ? environment("SLURM_JOB_ID") : array + "_" + index;
}

void pin_to(const std::vector<int>& cpus) {
  if (cpus.empty()) return;
  cpu_set_t mask;
  CPU_ZERO(&mask);
  for (const int cpu : cpus)
    if (cpu >= 0 && cpu < CPU_SETSIZE) CPU_SET(static_cast<std::size_t>(cpu), &mask);
  sched_setaffinity(0, sizeof mask, &mask);  // a wish: a container may forbid it
}

/// Of status.json.
std::pair<std::string, double> state_and_frames(const std::string& run_dir) {
  const std::optional<std::string> text = read_file(run_dir + "/status.json");
  const auto json = nlohmann::json::parse(text.value_or(""), nullptr, false);
  if (!json.is_object()) return {"", 0};
  const auto state = json.find("state"), frames = json.find("env_frames");
  return {state != json.end() && state->is_string() ? state->get<std::string>() : "",
          frames != json.end() && frames->is_number() ? frames->get<double>() : 0.0};
}

/// Queues this element again; it is ended by Slurm then. A controller that is busy is asked again.
/// Errors: those of scontrol, in its words.
Status requeue(const std::string& element) {
  constexpr int kTimes = 3;
  constexpr std::chrono::seconds kPause(2);
  for (int time = 1;; ++time) {
    COMRAD_TRY_ASSIGN(const ProgramResult asked, run_program({"scontrol", "requeue", element}));
    if (asked.exit_code == 0) return {};
    if (time == kTimes)
      return Error{ErrorCode::kSystem, "scontrol requeue " + element + ": " + last_words(asked)};
    std::this_thread::sleep_for(kPause);
  }
}

/// Until Slurm ends this element, which it does after a requeue. An element that leaves first may be taken for one that is
/// complete, and is not queued again.
void wait_for_the_end(SignalDesk& signals) {
  constexpr int kSeconds = 60;
  for (int second = 0; second < kSeconds; ++second) {
    pollfd source{.fd = signals.descriptor(), .events = POLLIN, .revents = 0};
    poll(&source, 1, 1000);
    for (int number; (number = signals.next()) != 0;)
      if (number == SIGTERM) return;
  }
}

/// Appends the lines that the program has printed to the log, and keeps the last ones.
void take_lines(ChildProcess& train, int log, std::vector<std::string>& kept) {
  std::string text;
  for (std::string& line : train.read_lines()) {
    text += line + "\n";
    if (trimmed(line).empty()) continue;
    kept.push_back(std::move(line));
    if (kept.size() > 2 * kLinesKept) kept.erase(kept.begin(), kept.end() - kLinesKept);
  }
  if (!text.empty() && log >= 0) (void)!write(log, text.data(), text.size());
}

bool is_kept(const SweepFolder& folder, const SweepRun& run) {
  const std::optional<KeptResult> kept = read_result(folder.results(), run.name);
  return kept && kept->goal_env_frames >= run.goal_env_frames;
}

}  // namespace

std::string quoted_error(const std::vector<std::string>& lines) {
  std::string chosen = lines.empty() ? "" : lines.back();
  for (const std::string& line : lines)
    if (const std::size_t place = line.find("error: "); place != std::string::npos)
      chosen = line.substr(place + 7);
  if (chosen.size() > kErrorBytesMax) chosen = chosen.substr(0, kErrorBytesMax) + "...";
  return chosen;
}

RunRecord judge_attempt(RunRecord record, const ExitStatus& how, bool was_told,
                        const std::string& status_state, double frames, const std::string& last_error,
                        bool killed_may_go_on) {
  record.exit_code = how.signal == 0 ? how.code : 128 + how.signal;
  record.error.clear();
  if (how.signal == 0 && how.code == kExitDone) {
    record.state = status_state == "finished" ? RunState::kFinished : RunState::kInterrupted;
  } else if (how.signal != 0) {
    const bool got_somewhere = frames > record.env_frames_at_start;
    record.state =
        was_told || (killed_may_go_on && got_somewhere) ? RunState::kInterrupted : RunState::kFailed;
    record.error = "comrad train was " + how.text() + (got_somewhere ? "" : " before it got any further");
  } else {
    record.state = RunState::kFailed;
    record.error = last_error.empty() ? how.text() : last_error;
  }
  return record;
}

Expected<int> run_element(const SweepFolder& folder, const SweepRun& run, const ElementOptions& options) {
  SignalDesk signals;
  if (signals.descriptor() < 0) return system_error("signalfd");
  const std::string element = slurm_element(), run_dir = folder.run_dir(run);
  pin_to(options.cpus);

  RunRecord record = folder.read_record(run).value_or(RunRecord{});
  record.state = RunState::kRunning;
  ++record.attempts;
  record.host = host_name();
  record.pid = getpid();
  record.pid_start_tics = start_tics_of(record.pid).value_or(0);
  record.job = element;
  record.started_s = wall_s();
  record.ended_s = 0;
  record.exit_code = 0;
  record.error.clear();
  record.goal_env_frames = run.goal_env_frames;
  record.env_frames_at_start = state_and_frames(run_dir).second;
  COMRAD_TRY(folder.write_record(run, record));

  const Descriptor log(open(folder.log_path(run).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
  const std::string heading = "== attempt " + std::to_string(record.attempts) + " on " + record.host +
                              (element.empty() ? "" : ", job " + element) + " ==\n";
  (void)!write(log.get(), heading.data(), heading.size());

  std::vector<std::string> words = run.command(
      options.train_program.empty() ? sibling_program("comrad") : options.train_program, folder.path());
  ChildOptions child;
  child.program = words[0];
  child.arguments.assign(words.begin() + 1, words.end());
  Expected<ChildProcess> train = ChildProcess::spawn(child);
  if (!train) {
    record.state = RunState::kFailed;
    record.error = train.error().message;
    record.ended_s = wall_s();
    COMRAD_TRY(folder.write_record(run, record));
    return kExitFailed;
  }

  bool was_told = false, time_is_up = false;
  std::vector<std::string> kept;
  while (!train->poll_exit()) {
    pollfd sources[2] = {{.fd = signals.descriptor(), .events = POLLIN, .revents = 0},
                         {.fd = train->output_descriptor(), .events = POLLIN, .revents = 0}};
    poll(sources, 2, kElementTickMs);
    take_lines(*train, log.get(), kept);
    for (int number; (number = signals.next()) != 0;) {
      if (number == SIGCHLD) continue;
      time_is_up |= number == SIGUSR1;
      was_told = true;
      train->send_signal(SIGTERM);
    }
  }
  take_lines(*train, log.get(), kept);

  const auto [state, frames] = state_and_frames(run_dir);
  record = judge_attempt(record, *train->poll_exit(), was_told, state, frames, quoted_error(kept),
                         !element.empty());
  record.ended_s = wall_s();
  if (record.state == RunState::kFinished && !folder.results().folder.empty() && !is_kept(folder, run)) {
    if (const Status written = keep_result(folder, run, words[0]); !written) {
      record.state = RunState::kFailed;
      record.error = "it finished, but its result could not be kept: " + written.error().message;
    }
    record.ended_s = wall_s();
  }
  const bool is_killed = record.state == RunState::kInterrupted && record.exit_code > 128 && !was_told;
  const bool goes_on =
      !element.empty() && record.state == RunState::kInterrupted && (time_is_up || is_killed);
  if (goes_on && record.error.empty()) record.error = "the time limit was near; queued again";
  COMRAD_TRY(folder.write_record(run, record));
  if (goes_on) {
    if (const Status queued = requeue(element); !queued) {
      record.error += "; " + queued.error().message;
      COMRAD_TRY(folder.write_record(run, record));
      return kExitFailed;
    }
    wait_for_the_end(signals);
  }
  std::fprintf(stderr, "%s: %s%s%s\n", run.name.c_str(), word_of(record.state),
               record.error.empty() ? "" : ": ", record.error.c_str());
  return record.state == RunState::kFailed ? kExitFailed : kExitDone;
}

}  // namespace comrad::deploy
