#include "deploy/sweep/search_program.h"

#include <spdlog/fmt/fmt.h>

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/sweep/population.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr double kProgramTimeoutS = 300;  // of a busy machine with a cold disk
constexpr const char* kImports = "import optuna; from optuna.storages.journal import JournalFileBackend";

/// A signal that ended the program is for our own loop, too.
Expected<ProgramResult> run_python(const std::vector<std::string>& command) {
  Expected<ProgramResult> done = run_program(command, {.timeout_s = kProgramTimeoutS});
  if (done && done->interrupted) kill(getpid(), SIGTERM);
  return done;
}

/// Runs search.py with these words. Errors: its own, as kBadFormat.
Expected<ordered_json> ask_program(const std::vector<std::string>& words) {
  COMRAD_TRY_ASSIGN(const std::string python, search_python());
  std::vector<std::string> command = {python, "-B", data_dir() + "/deploy/sweep/search.py"};
  command.insert(command.end(), words.begin(), words.end());
  COMRAD_TRY_ASSIGN(const ProgramResult done, run_python(command));
  if (done.exit_code != 0) return Error{ErrorCode::kBadFormat, last_words(done)};
  return ordered_json::parse(done.output, nullptr, false);
}

/// Errors: kBadFormat for an answer of another shape, or settings outside of the space.
Expected<std::pair<int64_t, SettingValues>> ask_trial(const SweepFolder& folder, const SweepRun& run,
                                                      int64_t trial) {
  std::vector<std::string> words = {"ask", folder.path(), run.name};
  if (trial >= 0) words.push_back(fmt::format("--trial={}", trial));
  COMRAD_TRY_ASSIGN(const ordered_json answer, ask_program(words));
  const Error odd{ErrorCode::kBadFormat,
                  "search.py gave an answer that is none: " + answer.dump().substr(0, 200)};
  if (!answer.is_object() || !answer.contains("trial") || !answer["trial"].is_number_integer() ||
      !answer.contains("settings"))
    return odd;
  COMRAD_TRY_ASSIGN(const SettingValues settings, setting_values_from_json(answer["settings"]));
  COMRAD_TRY(check_in_space(folder.search(), settings, "the study of " + run.name));
  return std::pair(answer["trial"].get<int64_t>(), settings);
}

std::vector<std::string> words_of(const char* command, const SweepFolder& folder, const SweepRun& run,
                                  const RunRecord& record) {
  return {command, folder.path(), run.name, fmt::format("--trial={}", record.trial)};
}

Expected<bool> end_trial_step(const SweepFolder& folder, const SweepRun& run, RunRecord& record,
                              double score) {
  if (!std::isfinite(score))
    return Error{ErrorCode::kNotFound,
                 "it has no score J, because no episode has ended; train for more env frames"};
  const double end = folder.search().end_of_step(record.steps, run.goal_env_frames);
  std::vector<std::string> words = words_of("report", folder, run, record);
  words.push_back("--score=" + real_text(score));
  if (end >= run.goal_env_frames) {
    words[0] = "tell";
    COMRAD_TRY(ask_program(words));
    return false;
  }
  words.push_back(fmt::format("--env_frames={}", static_cast<int64_t>(end)));
  COMRAD_TRY_ASSIGN(const ordered_json answer, ask_program(words));
  const bool is_pruned = answer.is_object() && answer.value("pruned", false);
  if (is_pruned) record.pruned_at_env_frames = end;
  return !is_pruned;
}

std::size_t place_of(const std::vector<Member>& members, const SweepRun& run) {
  return static_cast<std::size_t>(std::ranges::find(members, run.name, &Member::name) - members.begin());
}

}  // namespace

Expected<std::string> search_python() {
  static const Expected<std::string> found = python_of_environment(
      "COMRAD_SEARCH_PYTHON", "search-python", kImports,
      "[search] needs Optuna 4 or later: no Python here can import it; ./comrad sweep installs it in the "
      "build folder, "
      "or make an environment with `pip install optuna` and name its python: COMRAD_SEARCH_PYTHON=FILE");
  return found;
}

Status begin_search(const SweepFolder& folder) {
  if (!folder.search().is_on()) return {};
  std::error_code failed;
  fs::create_directories(folder.path() + "/search", failed);
  if (failed) return file_error("cannot make " + folder.path() + "/search", failed.value());
  if (!folder.search().has_trials()) return {};
  for (const SweepRun& run : folder.runs()) {
    const std::string path = folder.path() + "/search/" + run.study + ".log";
    const std::optional<RunRecord> record = folder.read_record(run);
    if (record && record->trial >= 0 && !fs::exists(path, failed))
      return Error{ErrorCode::kNotFound, "the study file " + path +
                                             " is missing, which has chosen the settings of " + run.name +
                                             "; restore it, or give the sweep another name"};
  }
  COMRAD_TRY(ask_program({"create", folder.path()}));
  return {};
}

Expected<SearchStep> begin_step(const SweepFolder& folder, const SweepRun& run, RunRecord& record) {
  const SweepSearch& search = folder.search();
  if (!search.is_on()) return SearchStep{.settings = {}, .end_env_frames = run.goal_env_frames};
  if (search.has_trials()) {
    // The record's settings count. The study is asked all the same, so that a lost one is seen before anything is trained.
    COMRAD_TRY_ASSIGN(const auto trial, ask_trial(folder, run, record.trial));
    if (record.trial < 0) record.settings = trial.second;
    record.trial = trial.first;
    COMRAD_TRY(check_in_space(search, record.settings, folder.record_path(run)));
  } else {
    COMRAD_TRY_ASSIGN(std::vector<Member> members, read_members(folder, run));
    const std::size_t index = place_of(members, run);
    Member& own = members[index];
    if (own.generations.empty() || own.generations.back().is_over()) {
      own.generations.push_back(next_generation(search, members, index));
      COMRAD_TRY(write_member(folder, own));
    }
    const std::size_t number = own.generations.size() - 1;
    const Generation& now = own.generations.back();
    if (!now.parent.empty()) COMRAD_TRY(take_checkpoint(folder, run, number, now.parent));
    record.steps = static_cast<int64_t>(number);
    record.settings = now.settings;
  }
  const double end = search.end_of_step(record.steps, run.goal_env_frames);
  return SearchStep{.settings = with_settings(record.settings, {{"train_for_env_frames", real_text(end)}}),
                    .end_env_frames = end};
}

Expected<bool> end_step(const SweepFolder& folder, const SweepRun& run, RunRecord& record, double env_frames,
                        double score) {
  const SweepSearch& search = folder.search();
  if (!search.is_on()) return false;
  bool goes_on = search.end_of_step(record.steps, run.goal_env_frames) < run.goal_env_frames;
  if (search.has_trials()) {
    COMRAD_TRY_ASSIGN(goes_on, end_trial_step(folder, run, record, score));
  } else {
    COMRAD_TRY_ASSIGN(std::vector<Member> members, read_members(folder, run));
    Member& own = members[place_of(members, run)];
    if (own.generations.empty())
      return Error{ErrorCode::kBadFormat,
                   folder.path() + "/search/" + run.name + ".json was removed; restore it"};
    if (!(env_frames > 0))
      return Error{ErrorCode::kBadFormat, folder.run_dir(run) + "/status.json contains no env frames"};
    COMRAD_TRY(keep_checkpoint(folder, run, own.generations.size() - 1));
    own.generations.back().env_frames = env_frames;
    own.generations.back().score = score;
    COMRAD_TRY(write_member(folder, own));
  }
  ++record.steps;
  return goes_on;
}

Status give_up(const SweepFolder& folder, const SweepRun& run, const RunRecord& record) {
  if (!folder.search().has_trials() || record.trial < 0) return {};
  COMRAD_TRY(ask_program(words_of("tell", folder, run, record)));
  return {};
}

}  // namespace comrad::deploy
