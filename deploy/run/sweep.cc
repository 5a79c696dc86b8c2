// `comrad sweep`: many runs from one file. This source parses words and finds the sweep that they name; what a sweep is and
// does lies in deploy/sweep.

#include <spdlog/fmt/fmt.h>

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <functional>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/content_hash.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/scenario_description.h"
#include "deploy/sweep/local_backend.h"
#include "deploy/sweep/search_program.h"
#include "deploy/sweep/slurm_backend.h"
#include "deploy/sweep/sweep_element.h"
#include "deploy/sweep/sweep_estimate.h"
#include "deploy/sweep/sweep_file.h"
#include "deploy/sweep/sweep_folder.h"
#include "deploy/sweep/sweep_plan.h"
#include "deploy/sweep/sweep_results.h"
#include "deploy/sweep/sweep_table.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr double kStopWaitS =
    60;  // a run has 10 s to save; one that has just started has its libraries to load first

/// Whether a sweep's report is drawn by this program's Python.
bool asks_for_a_report(const std::string& command) {
  return command.find("comrad report") != std::string::npos ||
         command.find("comrad plot") != std::string::npos;
}

struct Found {
  SweepFolder folder;
  std::string run;  ///< empty: the sweep as a whole
};

/// The sweep, or the run of one, that `name` means: a sweep's file or folder, a sweep's name below `train_dir`, a run's
/// name in any sweep there, or <sweep>/<run>. Errors: kNotFound naming the nearest.
Expected<Found> find_sweep(const std::string& name, const std::string& train_dir) {
  std::error_code failed;
  if (name.ends_with(".toml") && fs::is_regular_file(name, failed) &&
      fs::path(name).filename() != "sweep.toml") {
    COMRAD_TRY_ASSIGN(const SweepFile file, read_sweep_file(name));
    COMRAD_TRY_ASSIGN(SweepFolder folder, SweepFolder::open(file.train_dir + "/" + file.name));
    return Found{std::move(folder), ""};
  }
  std::vector<std::string> known;
  for (const fs::path& path : {fs::path(name), fs::path(train_dir) / name}) {
    if (fs::exists(path / "sweep.json", failed)) {
      COMRAD_TRY_ASSIGN(SweepFolder folder, SweepFolder::open(path.string()));
      return Found{std::move(folder), ""};
    }
    if (fs::exists(path.parent_path() / "sweep.json", failed)) {
      COMRAD_TRY_ASSIGN(SweepFolder folder, SweepFolder::open(path.parent_path().string()));
      const std::string run = path.filename().string();
      if (folder.find(run) != nullptr) return Found{std::move(folder), run};
    }
  }
  for (const auto& entry : fs::directory_iterator(train_dir, failed)) {
    if (!fs::exists(entry.path() / "sweep.json", failed)) continue;
    COMRAD_TRY_ASSIGN(SweepFolder folder, SweepFolder::open(entry.path().string()));
    if (folder.find(name) != nullptr) return Found{std::move(folder), name};
    known.push_back(entry.path().filename().string());
    for (const SweepRun& run : folder.runs()) known.push_back(run.name);
  }
  return Error{ErrorCode::kNotFound, "no sweep or run of a sweep '" + name +
                                         "' (no file or folder, and none in " + train_dir + ")" +
                                         did_you_mean(name, known)};
}

/// What `status`, `stop` and `logs` share.
struct Looking {
  explicit Looking(const std::string& usage, const std::string& about) : line(usage, about) {
    line.add_positional("NAME", name, "a sweep's file, folder or name, or one of its runs");
    line.add_option("train_dir", train_dir, "FOLDER", "folder that holds the sweeps (default train_dir)");
  }
  std::string name, train_dir = "train_dir";
  CommandLine line;
};

/// What Slurm reports; a warning where it gives no answer.
QueuedElements ask_queue(const SweepFolder& folder) {
  const Expected<QueuedElements> queued = queued_elements(folder);
  if (queued) return *queued;
  std::fprintf(stderr, "warning: %s; the states are what the runs wrote last\n",
               queued.error().message.c_str());
  return {.is_known = false};
}

int status_command(Arguments arguments) {
  Looking look(
      "sweep status NAME [--watch] [--json]",
      "Shows every run of a sweep: state, env frames, rate, score J, time left, host. The states "
      "are waiting,\n"
      "queued (with Slurm), running, interrupted (continues when the sweep is started again), failed, "
      "finished.");
  bool watch = false, json = false;
  look.line.add_switch("watch", watch, "show it again every two seconds until nothing runs");
  look.line.add_switch("json", json, "print one JSON object on stdout and nothing else");
  return run_command("sweep", look.line, arguments, [&]() -> Expected<int> {
    while (true) {
      COMRAD_TRY_ASSIGN(const Found found, find_sweep(look.name, look.train_dir));
      const std::vector<RunView> views = found.folder.look(ask_queue(found.folder));
      if (json)
        std::printf("%s\n", sweep_json(found.folder.name(), found.folder.path(), views).c_str());
      else
        std::printf("%s%s", watch && isatty(STDOUT_FILENO) ? "\033[H\033[2J" : "",
                    sweep_table(views).c_str());
      std::fflush(stdout);
      const bool is_at_work =
          found.folder.lock_owner() != 0 || std::ranges::any_of(views, [](const RunView& view) {
            return view.state == RunState::kRunning || view.state == RunState::kQueued;
          });
      if (!watch || !is_at_work) return kExitDone;
      usleep(2'000'000);
    }
  });
}

int stop_command(Arguments arguments) {
  Looking look(
      "sweep stop NAME",
      "Ends a sweep: its runs save a checkpoint and stop. The same `comrad sweep FILE` continues later.");
  return run_command("sweep", look.line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY_ASSIGN(const Found found, find_sweep(look.name, look.train_dir));
    const auto signal_runs = [&] {
      bool any = false;
      for (const RunView& view : found.folder.look({}))
        if (view.state == RunState::kRunning && view.record.job.empty())
          any |= kill(view.record.pid, SIGTERM) == 0;
      return any;
    };
    COMRAD_TRY_ASSIGN(const int jobs, stop_slurm(found.folder));
    if (jobs > 0) {
      std::fprintf(stderr, "jobs of %s that wait are out of the queue; those that run save and stop\n",
                   found.folder.name().c_str());
      return kExitDone;
    }
    const pid_t owner = found.folder.lock_owner();
    if (owner > 0 && kill(owner, SIGTERM) != 0)
      return system_error(fmt::format("cannot signal pid {}", owner));
    if (owner == 0 && !signal_runs()) {
      std::fprintf(stderr, "nothing of %s runs on this host\n", found.folder.path().c_str());
      return kExitDone;
    }
    for (const double give_up_s = monotonic_s() + kStopWaitS; monotonic_s() < give_up_s; usleep(200'000)) {
      const std::vector<RunView> views = found.folder.look({});
      if (found.folder.lock_owner() == 0 &&
          std::ranges::none_of(views, [](const RunView& view) { return view.state == RunState::kRunning; })) {
        std::fprintf(stderr, "stopped: %s\n", sweep_line(views).c_str());
        return kExitDone;
      }
    }
    return Error{ErrorCode::kTimeout,
                 found.folder.path() + " has not stopped yet; comrad sweep status shows which run"};
  });
}

/// The last `count` lines of a file.
std::string tail_of(const std::string& path, double count) {
  const std::string text = read_file(path).value_or("");
  std::size_t begin = text.size();
  for (double lines = 0; begin > 0; --begin)
    if (text[begin - 1] == '\n' && begin < text.size() && ++lines >= count) break;
  return text.substr(begin);
}

int logs_command(Arguments arguments) {
  Looking look("sweep logs NAME [--lines N]",
               "Prints the last lines that a run of a sweep has printed; of a sweep, those of every run that "
               "was started.");
  double lines = 0;
  look.line.add_option("lines", lines, "N", "how many lines (default 40 of a run, 5 of each run of a sweep)");
  return run_command("sweep", look.line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY_ASSIGN(const Found found, find_sweep(look.name, look.train_dir));
    if (!look.line.was_typed("lines")) lines = found.run.empty() ? 5 : 40;
    if (!(lines >= 1)) return Error{ErrorCode::kBadInput, "--lines must be at least 1"};
    bool any = false;
    for (const SweepRun& run : found.folder.runs()) {
      if (!found.run.empty() && run.name != found.run) continue;
      const std::string text = tail_of(found.folder.log_path(run), lines);
      if (text.empty()) continue;
      if (found.run.empty()) std::printf("%s== %s ==\n", any ? "\n" : "", run.name.c_str());
      std::fputs(text.c_str(), stdout);
      any = true;
    }
    if (!any) std::fprintf(stderr, "%s has printed nothing yet\n", look.name.c_str());
    return kExitDone;
  });
}

/// Started by the backends alone: one attempt of one run.
int element_command(Arguments arguments) {
  std::string path, name, cpus;
  CommandLine line("sweep element FOLDER RUN [--cpus LIST]",
                   "One attempt of one run of a sweep; `comrad sweep FILE` and its Slurm jobs start it.");
  line.add_positional("FOLDER", path, "the sweep's folder");
  line.add_positional("RUN", name, "the run's name");
  line.add_option("cpus", cpus, "LIST", "pin it to these cores, separated by commas");
  return run_command("sweep", line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY_ASSIGN(const SweepFolder folder, SweepFolder::open(path));
    const SweepRun* run = folder.find(name);
    if (run == nullptr) return Error{ErrorCode::kNotFound, path + " has no run " + name};
    ElementOptions options;
    for (std::size_t begin = 0; begin < cpus.size();) {
      const std::size_t end = std::min(cpus.find(',', begin), cpus.size());
      const auto [stop, error] =
          std::from_chars(cpus.data() + begin, cpus.data() + end, options.cpus.emplace_back());
      if (error != std::errc() || stop != cpus.data() + end)
        return Error{ErrorCode::kBadInput,
                     "--cpus=" + cpus + ": must be numbers of cores, separated by commas"};
      begin = end + 1;
    }
    options.takes_turns = !cpus.empty();  // the local backend, which shares its cores
    return run_element(folder, *run, options);
  });
}

/// The content hash of the map that settings make, kept below the sweep's records so that it is made once.
std::function<Expected<std::string>(const RunConfig&)> hash_of_map(const std::string& sweep_folder) {
  return [maps = sweep_folder + "/records/maps"](const RunConfig& config) -> Expected<std::string> {
    std::error_code failed;
    fs::create_directories(maps, failed);
    COMRAD_TRY_ASSIGN(const std::string path, ensure_layout(config, maps));
    return content_hash(path);
  };
}

int start_command(Arguments arguments) {
  std::string path;
  bool estimate = false, dry_run = false;
  double seconds = 10;
  CommandLine line("sweep FILE.toml [--dry_run] [--estimate]\n       comrad sweep status|stop|logs NAME",
                   "Makes every run that the file requests: all combinations of its [axes]. Each is an "
                   "ordinary `comrad train` in\n"
                   "<train_dir>/<name>/<run>. The same command again makes only what is missing, failed or "
                   "was interrupted.\n"
                   "deploy/SWEEPS.md describes the file.");
  line.add_positional("FILE", path, "the sweep, a TOML file");
  line.add_switch("dry_run", dry_run,
                  "check everything and print the command of every run, for Slurm the batch script too; "
                  "start nothing");
  line.add_switch(
      "estimate", estimate,
      "measure the rate of every algorithm on this machine and print the hours of the sweep; start nothing");
  line.add_option("seconds", seconds, "S", "with --estimate: how long each is measured (default 10)");
  return run_command("sweep", line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY_ASSIGN(SweepFile file, read_sweep_file(path));
    if (estimate && file.resources.cores > usable_cores()) {
      std::fprintf(stderr,
                   "a run of the sweep gets %lld cores, this process may use %d: the rates are those of %d\n",
                   static_cast<long long>(file.resources.cores), usable_cores(), usable_cores());
      file.resources.cores = usable_cores();
    }
    COMRAD_TRY(find_iwad());
    COMRAD_TRY_ASSIGN(const SweepPlan plan, plan_sweep(file, describe_scenario, usable_cores()));
    const std::string comrad = sibling_program("comrad");
    const bool is_slurm = file.backend == SweepBackend::kSlurm;
    if (estimate) {
      if (!(seconds >= 1) || seconds > 3600)
        return Error{ErrorCode::kBadInput, "--seconds must be 1 to 3600"};
      std::vector<EstimateGroup> groups = estimate_groups(plan);
      COMRAD_TRY(measure(groups, plan, seconds, comrad));
      std::fputs(estimate_text(groups, plan).c_str(), stdout);
      return kExitDone;
    }
    COMRAD_TRY(check_existing_runs(plan, describe_scenario));
    COMRAD_TRY(check_starts(plan, describe_scenario));
    if (asks_for_a_report(plan.file.report)) {
      COMRAD_TRY(python_that_imports(kReportModules));
    }
    if (file.search.has_trials()) {
      COMRAD_TRY(search_python());
    }
    if (dry_run) {
      for (const SearchedSetting& searched : file.search.space)
        std::printf("# %s searches %s: %s\n", word_of(file.search.method), searched.setting.c_str(),
                    searched.words().c_str());
      for (const SweepRun& run : plan.runs) {
        std::vector<std::string> words = run.command("comrad", plan.folder);
        std::ranges::transform(words, words.begin(), shell_word);
        std::printf("%s\n", joined(words, " ").c_str());
      }
      if (is_slurm) std::printf("\n%s", slurm_dry_run(plan, comrad).c_str());
      std::fprintf(stderr, "%zu runs in %s\n", plan.runs.size(), plan.folder.c_str());
      return kExitDone;
    }
    COMRAD_TRY_ASSIGN(const int stale, note_stale_results(plan, describe_scenario, hash_of_map(plan.folder)));
    if (stale > 0)
      std::fprintf(
          stderr,
          "%d results in %s are stale: recipe or map have changed since (comrad sweep status reports "
          "what). They stay;\nremove a run's folder there, and its run directory, to make it again\n",
          stale, plan.file.results.folder.c_str());
    COMRAD_TRY_ASSIGN(const std::string text, read_short_file(path, 1 << 20));
    COMRAD_TRY_ASSIGN(const Descriptor lock, SweepFolder::lock(plan.folder));
    COMRAD_TRY_ASSIGN(const SweepFolder folder,
                      SweepFolder::make(plan, text, facts_of_start(is_slurm ? "slurm" : "local")));
    COMRAD_TRY(begin_search(folder));
    return is_slurm ? run_slurm(plan, folder, comrad) : run_local(plan, folder, comrad);
  });
}

}  // namespace

int sweep_command(Arguments arguments) {
  const std::string first = arguments.empty() ? "" : arguments[0];
  if (first == "status") return status_command(arguments.subspan(1));
  if (first == "stop") return stop_command(arguments.subspan(1));
  if (first == "logs") return logs_command(arguments.subspan(1));
  if (first == "element") return element_command(arguments.subspan(1));
  return start_command(arguments);
}

}  // namespace comrad::deploy
