#include "deploy/sweep/sweep_folder.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <thread>

#include "deploy/process/child_program.h"
#include "deploy/settings/existing_run.h"
#include "deploy/sweep/sweep_results.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr const char* kStateWords[] = {"waiting", "queued", "running", "interrupted", "failed", "finished"};

template <typename T>
T value_or(const ordered_json& object, const char* key, T fallback) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  if constexpr (std::is_same_v<T, std::string>) return found->is_string() ? found->get<T>() : fallback;
  if constexpr (!std::is_same_v<T, std::string>) return found->is_number() ? found->get<T>() : fallback;
}

std::string dumped(const ordered_json& json) {
  return json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

/// The object in a file; nothing where there is none.
std::optional<ordered_json> read_object(const std::string& path) {
  const std::optional<std::string> text = read_file(path);
  if (!text) return std::nullopt;
  ordered_json object = ordered_json::parse(*text, nullptr, false);
  if (!object.is_object()) return std::nullopt;
  return object;
}

ordered_json run_json(const SweepRun& run) {
  ordered_json json = {{"name", run.name},
                       {"train_for_env_frames", run.goal_env_frames},
                       {"settings", to_json(run.settings.values)}};
  if (!run.study.empty()) json["study"] = run.study, json["number"] = run.number;
  return json;
}

ordered_json results_json(const SweepResults& results) {
  if (results.folder.empty()) return nullptr;
  return {{"folder", results.folder},
          {"episodes", results.episodes},
          {"seed", results.seed},
          {"greedy", results.greedy}};
}

SweepResults results_from(const ordered_json& json) {
  SweepResults results;
  if (!json.is_object()) return results;
  results.folder = value_or<std::string>(json, "folder", "");
  results.episodes = value_or<int64_t>(json, "episodes", results.episodes);
  results.seed = value_or<int64_t>(json, "seed", results.seed);
  const auto greedy = json.find("greedy");
  results.greedy = greedy != json.end() && greedy->is_boolean() && greedy->get<bool>();
  return results;
}

std::optional<SweepRun> run_from(const ordered_json& json) {
  if (!json.is_object()) return std::nullopt;
  SweepRun run;
  run.name = value_or<std::string>(json, "name", "");
  run.goal_env_frames = value_or<double>(json, "train_for_env_frames", 0);
  run.study = value_or<std::string>(json, "study", "");
  run.number = value_or<int64_t>(json, "number", 0);
  Expected<SettingValues> settings = setting_values_from_json(json.value("settings", ordered_json()));
  if (run.name.empty() || run.name.find('/') != std::string::npos ||
      run.study.find('/') != std::string::npos || !settings)
    return std::nullopt;
  run.settings.values = *std::move(settings);
  return run;
}

/// A run continues with the settings that it has; one that the file no longer names would silently stay.
Status check_nothing_forgotten(const SweepPlan& plan, const std::vector<SweepRun>& before) {
  for (const SweepRun& run : plan.runs) {
    const auto old = std::ranges::find(before, run.name, &SweepRun::name);
    if (old == before.end() || !find_checkpoint(plan.folder + "/" + run.name, CheckpointKind::kLatest))
      continue;
    for (const auto& [setting, value] : old->settings.values)
      if (std::ranges::find(run.settings.values, setting, &std::pair<std::string, std::string>::first) ==
          run.settings.values.end())
        return Error{ErrorCode::kBadInput,
                     plan.file.path + ": " + run.name + " was made with " + setting + " = " + value +
                         ", which the file no longer contains; put it back, or give the "
                         "sweep another name"};
  }
  return {};
}

/// What a search has chosen holds for what it searched and how long runs are: only its runs may become more.
Status check_same_search(const SweepPlan& plan, const SweepFolder& before) {
  const auto words_of = [](SweepSearch search) {
    search.runs = 0;
    return to_json(search).dump();
  };
  const bool is_another = words_of(plan.file.search) != words_of(before.search());
  for (const SweepRun& old : before.runs()) {
    if (!before.read_record(old)) continue;
    const auto run = std::ranges::find(plan.runs, old.name, &SweepRun::name);
    const bool has_same_goal = run == plan.runs.end() || run->goal_env_frames == old.goal_env_frames;
    if (is_another || (plan.file.search.has_trials() && !has_same_goal))
      return Error{ErrorCode::kBadInput,
                   plan.file.at(std::max(plan.file.search.line, 1)) +
                       "[search] has begun, and what it searches, how, and the length of its trials may not "
                       "change; only its "
                       "runs may become more. Put it back, or give the sweep another name"};
  }
  return {};
}

/// What follows "key ... :" in the first line of a file of /proc that begins so.
std::string proc_entry(const std::string& path, const std::string& key) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(key))
      if (const std::size_t colon = line.find(':'); colon != std::string::npos)
        return std::string(trimmed(std::string_view(line).substr(colon + 1)));
  return "";
}

std::string lock_path(const std::string& folder) { return folder + "/.sweep.lock"; }

/// The pid that is in a lock file; 0 if none.
pid_t owner_of(const Descriptor& lock) {
  char text[32] = {};
  if (pread(lock.get(), text, sizeof text - 1, 0) <= 0) return 0;
  return static_cast<pid_t>(std::strtol(text, nullptr, 10));
}

/// Whether something lies in the folder beside a sweep's lock.
bool holds_files(const std::string& folder) {
  std::error_code failed;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, failed))
    if (entry.path().string() != lock_path(folder)) return true;
  return false;
}

bool is_alive(const RunRecord& record) {
  if (record.host != host_name()) return false;
  const std::optional<uint64_t> started = start_tics_of(record.pid);
  return started && *started == record.pid_start_tics;
}

}  // namespace

const char* word_of(RunState state) { return kStateWords[static_cast<std::size_t>(state)]; }

std::string host_name() {
  utsname system{};
  return uname(&system) == 0 ? system.nodename : "localhost";
}

std::string utc_text(double seconds) {
  const std::time_t whole = static_cast<std::time_t>(seconds);
  std::tm utc{};
  gmtime_r(&whole, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

std::optional<uint64_t> start_tics_of(pid_t pid) {
  if (pid <= 0) return std::nullopt;
  std::ifstream file(fmt::format("/proc/{}/stat", pid));
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  // The second field is the program's name in brackets, which may hold anything. A zombie is no more.
  const std::size_t name_end = text.rfind(')');
  if (name_end == std::string::npos || name_end + 2 >= text.size() || text[name_end + 2] == 'Z')
    return std::nullopt;
  std::size_t place = name_end + 1;
  for (int field = 3; field <= 22 && place != std::string::npos; ++field)
    place = text.find(' ', place + (field > 3));
  if (place == std::string::npos) return std::nullopt;
  return std::strtoull(text.c_str() + place, nullptr, 10);
}

std::string commit_of_sources() {
  if (is_installed()) return "";  // a repository around the prefix is not ours
  const std::string folder = data_dir();
  const auto git = [&](const std::vector<std::string>& words) {
    std::vector<std::string> command = {"git", "-c", "safe.directory=" + folder, "-C", folder};
    command.insert(command.end(), words.begin(), words.end());
    return run_program(command, {.timeout_s = 20});
  };
  const Expected<ProgramResult> head = git({"rev-parse", "HEAD"});
  if (!head || head->exit_code != 0) return "";
  const Expected<ProgramResult> changes =
      git({"status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude,glob)**/*results/**"});
  const bool is_changed = changes && changes->exit_code == 0 && !changes->output.empty();
  return std::string(trimmed(head->output)) + (is_changed ? "-changed" : "");
}

SweepStart facts_of_start(const std::string& backend) {
  utsname system{};
  uname(&system);
  return {.time = utc_text(wall_s()),
          .backend = backend,
          .commit = commit_of_sources(),
          .host = host_name(),
          .kernel = std::string(system.sysname) + " " + system.release,
          .processor = proc_entry("/proc/cpuinfo", "model name"),
          .cores = static_cast<int64_t>(std::thread::hardware_concurrency()),
          .memory_bytes = 1024 * std::strtoll(proc_entry("/proc/meminfo", "MemTotal").c_str(), nullptr, 10)};
}

SweepFolder SweepFolder::planned(const SweepPlan& plan) {
  SweepFolder folder;
  folder.path_ = plan.folder;
  folder.name_ = plan.file.name;
  folder.runs_ = plan.runs;
  folder.results_ = plan.file.results;
  folder.search_ = plan.file.search;
  return folder;
}

Expected<SweepFolder> SweepFolder::make(const SweepPlan& plan, const std::string& file_text,
                                        const SweepStart& start) {
  SweepFolder folder = planned(plan);
  const std::string index_path = plan.folder + "/sweep.json";
  std::error_code failed;
  const std::optional<ordered_json> before = read_object(index_path);
  if (!before && holds_files(plan.folder) && !fs::exists(plan.folder + "/records", failed))
    return Error{ErrorCode::kBadInput, plan.folder +
                                           " is no folder of a sweep; give the sweep another name, or "
                                           "another train_dir"};
  ordered_json starts = ordered_json::array();
  if (before) {
    COMRAD_TRY_ASSIGN(const SweepFolder old, open(plan.folder));
    COMRAD_TRY(check_nothing_forgotten(plan, old.runs()));
    COMRAD_TRY(check_same_search(plan, old));
    if (before->contains("starts") && (*before)["starts"].is_array()) starts = (*before)["starts"];
  }
  fs::create_directories(plan.folder + "/records", failed);
  if (failed) return file_error("cannot make " + plan.folder + "/records", failed.value());

  starts.push_back({{"time", start.time},
                    {"backend", start.backend},
                    {"commit", start.commit},
                    {"host", start.host},
                    {"kernel", start.kernel},
                    {"processor", start.processor},
                    {"cores", start.cores},
                    {"memory_bytes", start.memory_bytes}});
  ordered_json index = {{"name", plan.file.name},
                        {"file", plan.file.path},
                        {"cores_per_run", plan.cores},
                        {"memory_gb_per_run", plan.file.resources.memory_gb},
                        {"gpus_per_run", plan.file.resources.gpus},
                        {"starts", starts},
                        {"results", results_json(folder.results_)},
                        {"search", to_json(folder.search_)},
                        {"runs", ordered_json::array()}};
  for (const SweepRun& run : plan.runs) index["runs"].push_back(run_json(run));
  COMRAD_TRY(write_file_atomically(plan.folder + "/sweep.toml", file_text, /*durable=*/true));
  COMRAD_TRY(write_file_atomically(index_path, dumped(index), /*durable=*/true));
  return folder;
}

Expected<SweepFolder> SweepFolder::open(const std::string& path) {
  std::error_code failed;
  SweepFolder folder;
  folder.path_ = fs::absolute(path, failed).lexically_normal().string();
  if (folder.path_.ends_with('/')) folder.path_.pop_back();
  const std::string index_path = folder.path_ + "/sweep.json";
  if (!fs::exists(index_path, failed))
    return Error{ErrorCode::kNotFound, path + " is no folder of a sweep (it holds no sweep.json)"};
  const std::optional<ordered_json> index = read_object(index_path);
  const auto damaged = [&] {
    return Error{ErrorCode::kBadFormat,
                 index_path + " is damaged; start the sweep again, which writes it anew"};
  };
  if (!index || !index->contains("runs") || !(*index)["runs"].is_array()) return damaged();
  folder.name_ = value_or<std::string>(*index, "name", fs::path(folder.path_).filename().string());
  if (const auto results = index->find("results"); results != index->end())
    folder.results_ = results_from(*results);
  Expected<SweepSearch> search = search_from_json(index->value("search", ordered_json()));
  if (!search) return damaged();
  folder.search_ = *std::move(search);
  for (const ordered_json& one : (*index)["runs"]) {
    std::optional<SweepRun> run = run_from(one);
    if (!run) return damaged();
    folder.runs_.push_back(*std::move(run));
  }
  return folder;
}

const SweepRun* SweepFolder::find(const std::string& run) const {
  const auto found = std::ranges::find(runs_, run, &SweepRun::name);
  return found == runs_.end() ? nullptr : &*found;
}

std::optional<RunRecord> SweepFolder::read_record(const SweepRun& run) const {
  const std::optional<ordered_json> json = read_object(record_path(run));
  if (!json) return std::nullopt;
  RunRecord record;
  const std::string state = value_or<std::string>(*json, "state", "");
  const auto word = std::ranges::find(kStateWords, state);
  if (word == std::end(kStateWords)) return std::nullopt;
  record.state = static_cast<RunState>(word - std::begin(kStateWords));
  record.attempts = value_or<int64_t>(*json, "attempts", 0);
  record.host = value_or<std::string>(*json, "host", "");
  record.pid = value_or<pid_t>(*json, "pid", 0);
  record.pid_start_tics = value_or<uint64_t>(*json, "pid_start_tics", 0);
  record.job = value_or<std::string>(*json, "job", "");
  record.commit = value_or<std::string>(*json, "commit", "");
  record.started_s = value_or<double>(*json, "started_s", 0);
  record.ended_s = value_or<double>(*json, "ended_s", 0);
  record.exit_code = value_or<int>(*json, "exit_code", 0);
  record.error = value_or<std::string>(*json, "error", "");
  record.goal_env_frames = value_or<double>(*json, "train_for_env_frames", 0);
  record.env_frames_at_start = value_or<double>(*json, "env_frames_at_start", 0);
  record.trial = value_or<int64_t>(*json, "trial", -1);
  record.steps = value_or<int64_t>(*json, "steps", 0);
  record.pruned_at_env_frames = value_or<double>(*json, "pruned_at_env_frames", 0);
  if (Expected<SettingValues> searched = setting_values_from_json(json->value("searched", ordered_json()))) {
    record.settings = *std::move(searched);
  }
  return record;
}

Status SweepFolder::write_record(const SweepRun& run, const RunRecord& record) const {
  ordered_json json = {{"state", word_of(record.state)},
                       {"attempts", record.attempts},
                       {"host", record.host},
                       {"pid", record.pid},
                       {"pid_start_tics", record.pid_start_tics},
                       {"job", record.job},
                       {"commit", record.commit},
                       {"started_s", record.started_s},
                       {"ended_s", record.ended_s},
                       {"exit_code", record.exit_code},
                       {"error", record.error},
                       {"train_for_env_frames", record.goal_env_frames},
                       {"env_frames_at_start", record.env_frames_at_start}};
  if (search_.is_on()) {
    json["trial"] = record.trial;
    json["steps"] = record.steps;
    json["searched"] = to_json(record.settings);
    json["pruned_at_env_frames"] = record.pruned_at_env_frames;
  }
  return write_file_atomically(record_path(run), dumped(json), /*durable=*/true);
}

RunView SweepFolder::look(const SweepRun& run, const QueuedElements& queued) const {
  RunView view;
  view.name = run.name;
  view.study = run.study;
  view.goal_env_frames = run.goal_env_frames;
  const std::optional<RunRecord> record = read_record(run);
  if (record) view.record = *record;
  bool is_at_goal =
      record && record->state == RunState::kFinished && record->goal_env_frames >= run.goal_env_frames;
  if (const std::optional<ordered_json> status = read_object(run_dir(run) + "/status.json")) {
    view.env_frames = value_or<double>(*status, "env_frames", 0);
    view.env_frames_per_s = value_or<double>(*status, "env_frames_per_s", 0);
    view.score_mean = value_or<double>(*status, "J_mean", std::nan(""));
    // It may have been brought there by hand. A search counts its elements' reports.
    is_at_goal |= run.study.empty() && value_or<std::string>(*status, "state", "") == "finished" &&
                  view.env_frames >= run.goal_env_frames;
  }
  const bool is_running =
      record && record->state == RunState::kRunning &&
      (record->job.empty() ? is_alive(*record) : !queued.is_known || queued.running_runs.contains(run.name));
  if (!results_.folder.empty()) {
    const std::optional<KeptResult> kept = read_result(results_, run.name);
    view.is_kept = kept && kept->goal_env_frames >= run.goal_env_frames;
    is_at_goal = view.is_kept;  // a run whose result is not kept yet is not done
    if (view.is_kept)
      view.env_frames = kept->env_frames, view.score_mean = kept->score, view.stale = kept->stale;
  }
  if (is_running)
    view.state = RunState::kRunning;
  else if (is_at_goal)
    view.state = RunState::kFinished;
  else if (queued.pending_runs.contains(run.name) || queued.running_runs.contains(run.name))
    view.state = RunState::kQueued;  // one that Slurm has just started has not said so yet
  else if (record && record->state == RunState::kRunning)
    view.state = RunState::kInterrupted, view.record.error = "its process ended without a word";
  else if (record && record->state == RunState::kFinished)
    view.state = RunState::kWaiting;  // the goal has grown
  else if (record)
    view.state = record->state;
  if (view.state != RunState::kRunning) view.env_frames_per_s = 0;
  return view;
}

std::vector<RunView> SweepFolder::look(const QueuedElements& queued) const {
  std::vector<RunView> views;
  for (const SweepRun& run : runs_) views.push_back(look(run, queued));
  return views;
}

Expected<Descriptor> SweepFolder::lock(const std::string& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) return file_error("cannot make " + folder, failed.value());
  const std::string path = lock_path(folder);
  Descriptor lock(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!lock.is_open()) return file_error(path, errno);
  bool is_ours = false;
  for (int tries = 0; !is_ours && tries < 10; ++tries) {  // `comrad sweep status` looks at it for a moment
    if (tries > 0) usleep(20'000);
    is_ours = flock(lock.get(), LOCK_EX | LOCK_NB) == 0;
  }
  if (!is_ours) {
    if (errno != EWOULDBLOCK) return file_error("cannot lock " + path, errno);
    return Error{ErrorCode::kBadInput, fmt::format("the sweep in {} is at work already (pid {}); look at it "
                                                   "with comrad sweep status, end it with comrad sweep stop",
                                                   folder, owner_of(lock))};
  }
  const std::string pid = fmt::format("{}\n", getpid());
  if (ftruncate(lock.get(), 0) != 0 || pwrite(lock.get(), pid.data(), pid.size(), 0) < 0)
    return file_error(path, errno);
  return lock;
}

pid_t SweepFolder::lock_owner() const {
  const Descriptor lock(::open(lock_path(path_).c_str(), O_RDONLY | O_CLOEXEC));
  if (!lock.is_open() || flock(lock.get(), LOCK_SH | LOCK_NB) == 0) return 0;
  return owner_of(lock);
}

}  // namespace comrad::deploy
