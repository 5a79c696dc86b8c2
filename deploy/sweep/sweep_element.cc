#include "deploy/sweep/sweep_element.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "deploy/launch/signal_queue.h"
#include "deploy/process/child_program.h"
#include "deploy/sweep/search_program.h"
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
  sched_setaffinity(0, sizeof mask, &mask);  // best effort: a container may forbid it
}

/// Of status.json.
struct Standing {
  std::string state;
  double env_frames = 0;
  double score = std::nan("");  ///< J
};

Standing standing_of(const std::string& run_dir) {
  const std::optional<std::string> text = read_file(run_dir + "/status.json");
  const auto json = nlohmann::json::parse(text.value_or(""), nullptr, false);
  Standing standing;
  if (!json.is_object()) return standing;
  const auto state = json.find("state"), frames = json.find("env_frames"), score = json.find("J_mean");
  if (state != json.end() && state->is_string()) standing.state = state->get<std::string>();
  if (frames != json.end() && frames->is_number()) standing.env_frames = frames->get<double>();
  if (score != json.end() && score->is_number()) standing.score = score->get<double>();
  return standing;
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
void wait_for_the_end(SignalQueue& signals) {
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

RunRecord judge_attempt(RunRecord record, const ExitStatus& how, bool was_stopped,
                        const std::string& status_state, double frames, const std::string& last_error,
                        bool killed_may_go_on) {
  record.exit_code = how.signal == 0 ? how.code : 128 + how.signal;
  record.error.clear();
  if (how.signal == 0 && how.code == kExitDone) {
    record.state = status_state == "finished" ? RunState::kFinished : RunState::kInterrupted;
  } else if (how.signal != 0) {
    const bool got_somewhere = frames > record.env_frames_at_start;
    record.state =
        was_stopped || (killed_may_go_on && got_somewhere) ? RunState::kInterrupted : RunState::kFailed;
    record.error = "comrad train was " + how.text() + (got_somewhere ? "" : " before it got any further");
  } else {
    record.state = RunState::kFailed;
    record.error = last_error.empty() ? how.text() : last_error;
  }
  return record;
}

namespace {

/// One attempt at work.
class Element {
 public:
  Element(const SweepFolder& folder, const SweepRun& run, const ElementOptions& options)
      : folder_(folder), run_(run), options_(options), run_dir_(folder.run_dir(run)), job_(slurm_element()) {}

  Expected<int> run() {
    if (signals_.descriptor() < 0) return system_error("signalfd");
    COMRAD_TRY(begin());
    if (const Status worked = work(); !worked) {
      hear_signals();
      record_.state = was_stopped_ ? RunState::kInterrupted : RunState::kFailed;
      record_.error = was_stopped_ ? "" : worked.error().message;
    }
    return end();
  }

 private:
  Status begin() {
    pin_to(options_.cpus);
    record_ = folder_.read_record(run_).value_or(RunRecord{});
    record_.state = RunState::kRunning;
    ++record_.attempts;
    record_.host = host_name();
    record_.pid = getpid();
    record_.pid_start_tics = start_tics_of(record_.pid).value_or(0);
    record_.job = job_;
    record_.commit = commit_of_sources();
    record_.started_s = wall_s();
    record_.ended_s = 0;
    record_.exit_code = 0;
    record_.error.clear();
    record_.goal_env_frames = run_.goal_env_frames;
    COMRAD_TRY(folder_.write_record(run_, record_));
    log_ = Descriptor(open(folder_.log_path(run_).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
    const std::string heading = fmt::format("== attempt {} on {}{} ==\n", record_.attempts, record_.host,
                                            (job_.empty() ? "" : ", job " + job_));
    (void)!write(log_.get(), heading.data(), heading.size());
    return {};
  }

  /// Step after step, until the run is finished or something ends it.
  Status work() {
    while (true) {
      COMRAD_TRY_ASSIGN(const SearchStep step, begin_step(folder_, run_, record_));
      record_.env_frames_at_start = standing_of(run_dir_).env_frames;
      COMRAD_TRY(folder_.write_record(run_, record_));
      hear_signals();
      if (was_stopped_) {
        record_.state = RunState::kInterrupted;
        return {};
      }
      COMRAD_TRY(train(step));
      if (record_.state != RunState::kFinished) return {};
      const Standing standing = standing_of(run_dir_);
      COMRAD_TRY_ASSIGN(const bool goes_on,
                        end_step(folder_, run_, record_, standing.env_frames, standing.score));
      if (!goes_on) return keep();
      const bool is_turn_over = options_.takes_turns && folder_.search().method == SearchMethod::kPbt;
      record_.state = is_turn_over ? RunState::kWaiting : RunState::kRunning;
      if (is_turn_over) return {};
    }
  }

  /// One `comrad train`. Errors: it cannot be started.
  Status train(const SearchStep& step) {
    std::vector<std::string> words = run_.command(program(), folder_.path(), step.settings);
    ChildOptions child;
    child.program = words[0];
    child.arguments.assign(words.begin() + 1, words.end());
    COMRAD_TRY_ASSIGN(ChildProcess train, ChildProcess::spawn(child));
    std::vector<std::string> kept;
    while (!train.poll_exit()) {
      pollfd sources[2] = {{.fd = signals_.descriptor(), .events = POLLIN, .revents = 0},
                           {.fd = train.output_descriptor(), .events = POLLIN, .revents = 0}};
      poll(sources, 2, kElementTickMs);
      take_lines(train, log_.get(), kept);
      if (hear_signals()) train.send_signal(SIGTERM);
    }
    take_lines(train, log_.get(), kept);
    const Standing standing = standing_of(run_dir_);
    record_ = judge_attempt(record_, *train.poll_exit(), was_stopped_, standing.state, standing.env_frames,
                            quoted_error(kept), !job_.empty());
    return {};
  }

  /// What a finished run gave, where the sweep keeps that.
  Status keep() {
    record_.ended_s = wall_s();
    if (folder_.results().folder.empty() || is_kept(folder_, run_)) return {};
    if (const Status written = keep_result(folder_, run_, record_.commit, program()); !written)
      return Error{written.error().code,
                   "it finished, but its result could not be kept: " + written.error().message};
    return {};
  }

  Expected<int> end() {
    if (record_.state == RunState::kFailed)
      if (const Status told = give_up(folder_, run_, record_); !told && record_.error != told.error().message)
        record_.error += "; " + told.error().message;
    record_.ended_s = wall_s();
    const bool is_killed =
        record_.state == RunState::kInterrupted && record_.exit_code > 128 && !was_stopped_;
    const bool is_queued_again =
        !job_.empty() && record_.state == RunState::kInterrupted && (time_is_up_ || is_killed);
    if (is_queued_again && record_.error.empty()) record_.error = "the time limit was near; queued again";
    COMRAD_TRY(folder_.write_record(run_, record_));
    if (is_queued_again) {
      if (const Status queued = requeue(job_); !queued) {
        record_.error += "; " + queued.error().message;
        COMRAD_TRY(folder_.write_record(run_, record_));
        return kExitFailed;
      }
      wait_for_the_end(signals_);
    }
    std::fprintf(stderr, "%s: %s%s%s\n", run_.name.c_str(), word_of(record_.state),
                 record_.error.empty() ? "" : ": ", record_.error.c_str());
    return record_.state == RunState::kFailed ? kExitFailed : kExitDone;
  }

  /// Whether one came that requests the run to stop.
  bool hear_signals() {
    bool came = false;
    for (int number; (number = signals_.next()) != 0;) {
      if (number == SIGCHLD) continue;
      time_is_up_ |= number == SIGUSR1;
      came = was_stopped_ = true;
    }
    return came;
  }

  std::string program() const {
    return options_.train_program.empty() ? sibling_program("comrad") : options_.train_program;
  }

  const SweepFolder& folder_;
  const SweepRun& run_;
  const ElementOptions& options_;
  SignalQueue signals_;
  const std::string run_dir_, job_;
  RunRecord record_;
  Descriptor log_;
  bool was_stopped_ = false, time_is_up_ = false;
};

}  // namespace

Expected<int> run_element(const SweepFolder& folder, const SweepRun& run, const ElementOptions& options) {
  return Element(folder, run, options).run();
}

}  // namespace comrad::deploy
