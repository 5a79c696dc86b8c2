#include "deploy/sweep/local_backend.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <limits>
#include <optional>

#include "deploy/launch/progress.h"
#include "deploy/launch/signal_queue.h"
#include "deploy/process/child_process.h"
#include "deploy/process/child_program.h"
#include "deploy/sweep/report_step.h"
#include "deploy/sweep/sweep_table.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::deploy {
namespace {

constexpr int kTickMs = 200;
constexpr double kLineIntervalS = 5;

std::string gigabytes(double bytes) { return real_text(std::round(bytes / 1e8) / 10) + " GB"; }

/// Whether a live process has the run's directory.
bool is_taken(const std::string& run_dir) {
  const Descriptor lock(open((run_dir + "/.lock").c_str(), O_RDONLY | O_CLOEXEC));
  return lock.is_open() && flock(lock.get(), LOCK_SH | LOCK_NB) != 0;
}

/// The sweep at work: its slots, the runs in them, the runs that wait.
class LocalSweep {
 public:
  LocalSweep(const SweepFolder& folder, std::vector<LocalSlot> slots, std::vector<const SweepRun*> to_do,
             std::string program)
      : folder_(folder),
        slots_(std::move(slots)),
        attempts_(slots_.size()),
        waiting_(to_do.begin(), to_do.end()),
        program_(std::move(program)),
        printer_(STDERR_FILENO, /*show=*/true) {}

  Expected<bool> run() {
    if (signals_.descriptor() < 0) return system_error("signalfd");
    while (is_busy() || (!waiting_.empty() && !is_stopping_)) {
      fill_slots();
      wait_for_news();
      hear_signals();
      reap();
      show();
    }
    printer_.end();
    return !is_stopping_;
  }

 private:
  struct Attempt {
    const SweepRun* run = nullptr;
    std::optional<ChildProcess> process;
    std::vector<std::string> last_lines;
  };

  bool is_busy() const {
    return std::ranges::any_of(attempts_, [](const Attempt& one) { return one.process.has_value(); });
  }

  void fill_slots() {
    if (is_stopping_) return;
    for (std::size_t slot = 0; slot < slots_.size(); ++slot) {
      if (attempts_[slot].process) continue;
      const auto next = next_run();
      if (next == waiting_.end()) return;  // those that are left are still held by others
      const SweepRun* run = *next;
      waiting_.erase(next);
      start(slot, *run);
    }
  }

  /// The first that no other process has; of the members of a population the one with the fewest env frames.
  std::deque<const SweepRun*>::iterator next_run() {
    auto next = waiting_.end();
    double fewest = std::numeric_limits<double>::infinity();
    for (auto run = waiting_.begin(); run != waiting_.end(); ++run) {
      if (is_taken(folder_.run_dir(**run))) continue;
      if (!is_population()) return run;
      const double env_frames = folder_.look(**run, {}).env_frames;
      if (env_frames < fewest) fewest = env_frames, next = run;
    }
    return next;
  }

  bool is_population() const { return folder_.search().method == SearchMethod::kPbt; }

  void start(std::size_t slot, const SweepRun& run) {
    ChildOptions options;
    options.program = program_;
    options.arguments = {"sweep", "element", folder_.path(), run.name,
                         "--cpus=" + joined(slots_[slot].cpus, ",")};
    if (!slots_[slot].gpus.empty()) options.environment = {{"CUDA_VISIBLE_DEVICES", slots_[slot].gpus}};
    Expected<ChildProcess> process = ChildProcess::spawn(options);
    if (!process) {
      printer_.note(run.name + " cannot be started: " + process.error().message);
      return;
    }
    printer_.note(run.name + " starts on core" + (slots_[slot].cpus.size() > 1 ? "s " : " ") +
                  joined(slots_[slot].cpus));
    attempts_[slot].run = &run;
    attempts_[slot].process = std::move(*process);
    attempts_[slot].last_lines.clear();
  }

  void wait_for_news() {
    std::vector<pollfd> sources{{.fd = signals_.descriptor(), .events = POLLIN, .revents = 0}};
    for (const Attempt& one : attempts_)
      if (one.process)
        sources.push_back({.fd = one.process->output_descriptor(), .events = POLLIN, .revents = 0});
    poll(sources.data(), sources.size(), kTickMs);
  }

  void hear_signals() {
    for (int number; (number = signals_.next()) != 0;) {
      if (number == SIGCHLD || number == SIGUSR1) continue;
      if (!is_stopping_)
        printer_.note("stopping: the runs save a checkpoint; the same command continues later");
      is_stopping_ = true;
      for (Attempt& one : attempts_)
        if (one.process) one.process->send_signal(SIGTERM);
    }
  }

  void reap() {
    for (Attempt& one : attempts_) {
      if (!one.process) continue;
      for (std::string& line : one.process->read_lines()) one.last_lines.push_back(std::move(line));
      const std::optional<ExitStatus>& how = one.process->poll_exit();
      if (!how) continue;
      for (std::string& line : one.process->read_lines()) one.last_lines.push_back(std::move(line));
      const RunView view = folder_.look(*one.run, {});
      std::string words = one.run->name + " " + word_of(view.state);
      if (!view.record.error.empty()) words += ": " + view.record.error;
      // The attempt itself could not work: its record lacks that.
      if (view.state == RunState::kInterrupted && how->code != 0 && !one.last_lines.empty())
        words += " (" + one.last_lines.back() + ")";
      printer_.note(words);
      if (view.state == RunState::kWaiting && how->code == 0 && is_population())
        waiting_.push_back(one.run);  // its next generation
      one.process.reset();
    }
  }

  void show() {
    if (monotonic_s() < next_line_s_) return;
    next_line_s_ = monotonic_s() + kLineIntervalS;
    printer_.line(sweep_line(folder_.look({})));
  }

  const SweepFolder& folder_;
  SignalQueue signals_;
  std::vector<LocalSlot> slots_;
  std::vector<Attempt> attempts_;  // of each slot
  std::deque<const SweepRun*> waiting_;
  std::string program_;
  ProgressPrinter printer_;
  bool is_stopping_ = false;
  double next_line_s_ = 0;
};

}  // namespace

std::vector<std::string> visible_gpus() {
  std::vector<std::string> gpus;
  if (const char* named = std::getenv("CUDA_VISIBLE_DEVICES")) {
    std::string_view rest = named;
    while (!rest.empty()) {
      const std::size_t comma = std::min(rest.find(','), rest.size());
      if (comma > 0) gpus.emplace_back(trimmed(rest.substr(0, comma)));
      rest.remove_prefix(std::min(comma + 1, rest.size()));
    }
    return gpus;
  }
  std::error_code failed;
  while (std::filesystem::exists(fmt::format("/dev/nvidia{}", gpus.size()), failed))
    gpus.push_back(std::to_string(gpus.size()));
  return gpus;
}

Expected<std::vector<LocalSlot>> local_slots(const SweepPlan& plan, std::size_t run_count,
                                             const std::vector<int>& cpus, int usable_cores,
                                             int64_t free_memory_bytes,
                                             const std::vector<std::string>& gpus) {
  const auto refuse = [&](std::string message) {
    return Error{ErrorCode::kBadInput, plan.file.path + ": " + std::move(message)};
  };
  const std::size_t at_once =
      std::min(static_cast<std::size_t>(plan.file.local_at_once), std::max<std::size_t>(run_count, 1));
  const std::size_t cores = static_cast<std::size_t>(plan.cores);
  const std::size_t room = std::min(cpus.size(), static_cast<std::size_t>(std::max(usable_cores, 1)));
  const std::string many = fmt::format("{}{}", at_once, (at_once == 1 ? " run" : " runs at once"));
  if (at_once * cores > room)
    return refuse(fmt::format(
        "{} of {} cores need {}, this process may use {}; lower [local] at_once or [resources] cores", many,
        cores, at_once * cores, room));
  const double wanted = static_cast<double>(at_once) * plan.file.resources.memory_gb * 1e9;
  if (wanted > static_cast<double>(free_memory_bytes))
    return refuse(many + " of " + real_text(plan.file.resources.memory_gb) + " GB need " + gigabytes(wanted) +
                  ", " + gigabytes(static_cast<double>(free_memory_bytes)) +
                  " is free; lower [local] at_once or [resources] memory_gb");
  const std::size_t gpus_each = static_cast<std::size_t>(plan.file.resources.gpus);
  if (at_once * gpus_each > gpus.size())
    return refuse(fmt::format(
        "{} of {} GPUs need {}, this process may use {}; lower [local] at_once or [resources] gpus", many,
        gpus_each, at_once * gpus_each, gpus.size()));
  std::vector<LocalSlot> slots(at_once);
  for (std::size_t slot = 0; slot < at_once; ++slot) {
    const auto first_cpu = cpus.begin() + static_cast<std::ptrdiff_t>(slot * cores);
    slots[slot].cpus.assign(first_cpu, first_cpu + static_cast<std::ptrdiff_t>(cores));
    const auto first_gpu = gpus.begin() + static_cast<std::ptrdiff_t>(slot * gpus_each);
    slots[slot].gpus =
        joined(std::vector<std::string>(first_gpu, first_gpu + static_cast<std::ptrdiff_t>(gpus_each)), ",");
  }
  return slots;
}

Expected<int> run_local(const SweepPlan& plan, const SweepFolder& folder, const std::string& program) {
  std::vector<const SweepRun*> to_do;
  for (const SweepRun& run : folder.runs())
    if (const RunState state = folder.look(run, {}).state; state != RunState::kFinished)
      to_do.push_back(&run);
  if (!to_do.empty()) {
    COMRAD_TRY_ASSIGN(std::vector<LocalSlot> slots,
                      local_slots(plan, to_do.size(), allowed_cpus(), usable_cores(),
                                  shm::free_memory_bytes(), visible_gpus()));
    COMRAD_TRY_ASSIGN(const bool is_complete, LocalSweep(folder, std::move(slots), to_do, program).run());
    if (!is_complete) {
      std::fprintf(stderr, "%s\n", sweep_line(folder.look({})).c_str());
      return kExitDone;
    }
  }
  const std::vector<RunView> views = folder.look({});
  std::fputs(sweep_table(views).c_str(), stdout);
  std::fflush(stdout);
  COMRAD_TRY(run_report(folder, plan.file.report));
  return std::ranges::all_of(views, [](const RunView& view) { return view.state == RunState::kFinished; })
             ? kExitDone
             : kExitFailed;
}

}  // namespace comrad::deploy
