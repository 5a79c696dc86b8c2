#include "deploy/sweep/sweep_results.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>
#include <vector>

#include "deploy/process/child_program.h"
#include "deploy/settings/game_files.h"
#include "deploy/sweep/sweep_folder.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::size_t kCurvePointsMax = 60;
constexpr double kEvaluationTimeoutS = 4 * 3600;
constexpr const char* kScore = "policy_stats/avg_true_objective";

/// Settings of the subject `run` and these follow from the machine, or say where and how long; what is learned does not
/// hang on them.
constexpr std::array<std::string_view, 19> kNoRecipe = {"wad",
                                                        "device",
                                                        "policy_device",
                                                        "precision",
                                                        "num_workers",
                                                        "worker_num_splits",
                                                        "policy_workers",
                                                        "policy_processes",
                                                        "max_wait_us",
                                                        "policy_threads",
                                                        "learner_threads",
                                                        "learners",
                                                        "trajectory_slabs",
                                                        "micro_batch_size",  // the gradient is the same
                                                        "set_workers_cpu_affinity",
                                                        "replay_gb",
                                                        "replay_file",
                                                        "replay_compress",
                                                        "save_replay"};

double with_five_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.5g", value);
  return std::strtod(text, nullptr);
}

ordered_json rounded(const ordered_json& value) {
  return value.is_number_float() ? ordered_json(with_five_digits(value.get<double>())) : value;
}

std::optional<ordered_json> object_in(const std::string& path) {
  ordered_json object = ordered_json::parse(read_file(path).value_or(""), nullptr, false);
  if (!object.is_object()) return std::nullopt;
  return object;
}

std::string text_of(const ordered_json& json) {
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

/// A JSON object with one member a line, arrays of episodes included.
std::string lines_of(const ordered_json& object) {
  std::string text;
  for (const auto& [name, value] : object.items())
    text += (text.empty() ? "{\n  " : ",\n  ") + text_of(name) + ": " + text_of(value);
  return text + "\n}\n";
}

double number_in(const ordered_json& object, const char* key, double fallback) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : fallback;
}

std::string result_path(const SweepResults& results, const std::string& run) {
  return results.folder + "/" + run + "/result.json";
}

/// `comrad eval` of a player; J and return of each episode are arrays of one member each. `more` are flags for a player
/// that is not a run.
Expected<ordered_json> evaluate(const SweepResults& results, const std::string& player, bool greedy,
                                const std::string& comrad, const std::vector<std::string>& more = {}) {
  std::vector<std::string> words = {comrad,       "eval",
                                    "--policy",   player,
                                    "--episodes", std::to_string(results.episodes),
                                    "--seed",     std::to_string(results.seed),
                                    "--json"};
  words.insert(words.end(), more.begin(), more.end());
  if (!greedy) words.push_back("--stochastic");
  COMRAD_TRY_ASSIGN(const ProgramResult played, run_program(words, {.timeout_s = kEvaluationTimeoutS}));
  if (played.interrupted) return Error{ErrorCode::kSystem, "interrupted"};
  if (played.exit_code != 0)
    return Error{ErrorCode::kPeerLost, fmt::format("the evaluation ended with exit code {}: {}",
                                                   played.exit_code, last_words(played))};
  ordered_json answer = ordered_json::parse(played.output, nullptr, false);
  if (!answer.is_object() || !answer.contains("J_mean") || !answer.contains("each") ||
      !answer["each"].is_array())
    return Error{ErrorCode::kBadFormat, "the evaluation printed no object with J_mean and each"};
  answer["policy"] = fs::path(player).filename().string();
  answer.erase("checkpoint");
  ordered_json scores = ordered_json::array(), returns = ordered_json::array();
  for (const ordered_json& one : answer["each"]) {
    scores.push_back(rounded(one.value("J", ordered_json())));
    returns.push_back(rounded(one.value("return", ordered_json())));
  }
  answer.erase("each");
  answer["J"] = std::move(scores);
  answer["return"] = std::move(returns);
  return answer;
}

/// Random play on the map of a run's evaluation by its team, once for each scenario. Runs on other pools have none: their
/// maps are many.
Status keep_random_play(const SweepResults& results, const RunConfig& config, const std::string& comrad) {
  const std::string path = results.folder + "/random_" + scenario_file_name(config) + ".json";
  std::error_code ignored;
  if (!is_evaluated_on_one_map(config) || fs::exists(path, ignored)) return {};
  COMRAD_TRY_ASSIGN(const ordered_json answer,
                    evaluate(results, "random", results.greedy, comrad,
                             {"--scenario=" + config.run.scenario,
                              fmt::format("--num_agents={}", config.environment.num_agents),
                              fmt::format("--layout_seed={}", config.environment.layout_seed)}));
  return write_file_atomically(path, lines_of(answer), /*durable=*/true);
}

}  // namespace

std::string curve_of(const std::string& metrics, std::size_t points_max) {
  std::vector<std::pair<double, double>> points;  // env frames, J
  std::istringstream source(metrics);
  for (std::string line; std::getline(source, line);) {
    const ordered_json report = ordered_json::parse(line, nullptr, false);
    if (!report.is_object()) continue;
    const double frames = number_in(report, "env_frames", std::nan("")),
                 score = number_in(report, kScore, std::nan(""));
    if (!std::isfinite(frames) || !std::isfinite(score)) continue;
    while (!points.empty() && points.back().first >= frames) points.pop_back();  // forgotten by a resumed run
    points.emplace_back(frames, score);
  }
  std::string curve = "env_frames,J\n";
  const std::size_t kept = std::min(points_max, points.size());
  for (std::size_t i = 0; i < kept; ++i) {
    const auto& [frames, score] = points[kept < 2 ? points.size() - 1 : i * (points.size() - 1) / (kept - 1)];
    char line[64];
    std::snprintf(line, sizeof line, "%.0f,%.5g\n", frames, score);
    curve += line;
  }
  return curve;
}

double trained_s(const std::string& metrics) {
  double seconds = 0;
  std::istringstream source(metrics);
  for (std::string line; std::getline(source, line);)
    if (const ordered_json report = ordered_json::parse(line, nullptr, false); report.is_object())
      seconds = std::max(seconds, number_in(report, "time_s", 0));
  return seconds;
}

std::string recipe_changes(const RunConfig& then, const RunConfig& now) {
  std::string changes;
  for (const SettingRow& row : setting_rows()) {
    if (row.subject == "run" || row.traits.is_of_the_start || row.traits.is_automatic_size ||
        std::ranges::find(kNoRecipe, row.name) != kNoRecipe.end() || !(row.applies(now) || row.applies(then)))
      continue;
    const std::string before = row.text(then), after = row.text(now);
    if (before == after) continue;
    changes += (changes.empty() ? "" : ", ") + std::string(row.name) + " " +
               (before.empty() ? "\"\"" : before) + " -> " + (after.empty() ? "\"\"" : after);
  }
  return changes;
}

std::optional<KeptResult> read_result(const SweepResults& results, const std::string& run) {
  const std::optional<ordered_json> json = object_in(result_path(results, run));
  if (!json) return std::nullopt;
  KeptResult kept;
  kept.goal_env_frames = number_in(*json, "train_for_env_frames", 0);
  kept.env_frames = number_in(*json, "env_frames", 0);
  kept.score = number_in(*json, "J_mean", std::nan(""));
  const auto stale = json->find("stale");
  if (stale != json->end() && stale->is_string()) kept.stale = stale->get<std::string>();
  return kept;
}

Status keep_result(const SweepFolder& folder, const SweepRun& run, const std::string& commit,
                   const std::string& comrad) {
  const SweepResults& results = folder.results();
  const std::string run_dir = folder.run_dir(run), target = results.folder + "/" + run.name;
  COMRAD_TRY_ASSIGN(RunConfig config, load_run_config(run_dir + "/config.toml"));
  const std::optional<std::string> metrics = read_file(run_dir + "/metrics.jsonl");
  const std::optional<ordered_json> status = object_in(run_dir + "/status.json");
  if (!metrics || !status)
    return Error{ErrorCode::kBadFormat, run_dir + " has no metrics.jsonl or no status.json that can be read"};
  COMRAD_TRY_ASSIGN(const ordered_json evaluation, evaluate(results, run_dir, results.greedy, comrad));
  COMRAD_TRY_ASSIGN(const ordered_json other, evaluate(results, run_dir, !results.greedy, comrad));

  std::error_code failed;
  fs::create_directories(target, failed);
  if (failed) return file_error("cannot make " + target, failed.value());
  COMRAD_TRY(keep_random_play(results, config, comrad));
  config.run.train_dir = RunConfig().run.train_dir;
  config.environment.wad.clear();
  const SweepStart machine = facts_of_start("local");
  std::string command;
  for (const std::string& word : run.command("./comrad", config.run.train_dir))
    command += (command.empty() ? "" : " ") + shell_word(word);
  ordered_json result = {
      {"run", run.name},
      {"scenario", config.run.scenario},
      {"scenario_version", config.environment.scenario_version},
      {"algo", config.run.algo.name()},
      {"seed", config.run.seed},
      {"num_agents", config.environment.num_agents},
      {"train_for_env_frames", run.goal_env_frames},
      {"env_frames", number_in(*status, "env_frames", 0)},
      {"train_s", rounded(std::max(trained_s(*metrics), number_in(*status, "elapsed_s", 0)))},
      {"command", command},
      {"commit", commit},
      {"date", utc_text(wall_s())},
      {"processor", machine.processor},
      {"cores", machine.cores},
      {"stale", ""},
      {results.greedy ? "J_mean_stochastic" : "J_mean_greedy", other["J_mean"]},
      {results.greedy ? "J_ci95_stochastic" : "J_ci95_greedy", other.value("J_ci95", ordered_json())}};
  for (const auto& [name, value] : evaluation.items())
    if (!result.contains(name)) result[name] = value;
  COMRAD_TRY(write_file_atomically(target + "/config.toml", changed_settings_to_toml(config), true));
  COMRAD_TRY(write_file_atomically(target + "/curve.csv", curve_of(*metrics, kCurvePointsMax), true));
  return write_file_atomically(target + "/result.json", lines_of(result), true);
}

Expected<int> note_stale_results(
    const SweepPlan& plan, const Describe& describe,
    const std::function<Expected<std::string>(const RunConfig& config)>& map_hash) {
  const SweepResults& results = plan.file.results;
  if (results.folder.empty()) return 0;
  int stale_count = 0;
  for (const SweepRun& run : plan.runs) {
    std::optional<ordered_json> result = object_in(result_path(results, run.name));
    if (!result) continue;
    std::string stale;
    const Expected<RunConfig> then = load_run_config(results.folder + "/" + run.name + "/config.toml");
    COMRAD_TRY_ASSIGN(const MergedSettings now,
                      merge_new({"", run.settings}, describe, static_cast<int>(plan.cores)));
    if (!then)
      stale = "its settings cannot be read any more: " + then.error().message;
    else
      stale = recipe_changes(*then, now.config);
    const auto hashes = result->find("map_hashes");
    if (is_evaluated_on_one_map(now.config) && now.config.environment.wad.empty() &&
        hashes != result->end() && hashes->is_object() && hashes->size() == 1) {
      const Expected<std::string> hash = map_hash(now.config);
      if (hash && hashes->begin().value() != *hash)
        stale += std::string(stale.empty() ? "" : ", ") + "the map";
    }
    stale_count += !stale.empty();
    if (result->value("stale", std::string()) == stale) continue;
    (*result)["stale"] = stale;
    COMRAD_TRY(write_file_atomically(result_path(results, run.name), lines_of(*result), true));
  }
  return stale_count;
}

}  // namespace comrad::deploy
