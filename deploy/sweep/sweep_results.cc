#include "deploy/sweep/sweep_results.h"

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

constexpr std::size_t kRowsMax = 200;
constexpr double kEvaluationTimeoutS = 4 * 3600;

/// What curves, tables and the question why nothing was learned need of a report.
constexpr std::array<std::string_view, 41> kNamesKept = {
    "time_s", "env_frames", "decisions",
    // play
    "policy_stats/avg_true_objective", "policy_stats/avg_true_objective_share", "reward/reward", "len/len",
    "stats/rewarded_episodes_fraction", "stats/episodes", "perf/_fps", "perf/decisions_per_s",
    "stats/learner_busy_fraction",
    // every algorithm
    "train/loss", "train/actual_lr", "train/grad_norm", "train/version_diff_avg", "train/num_sgd_steps",
    "train/skipped_sgd_steps", "train/adam_gain_encoder", "train/adam_gain_core", "train/adam_gain_heads",
    // on-policy
    "train/policy_loss", "train/value_loss", "train/exploration_loss", "train/entropy",
    "train/explained_variance", "train/kl_divergence", "train/fraction_clipped",
    "train/fraction_clipped_first", "train/value_clip_fraction", "happo/factor_m_mean",
    // Q-learning
    "train/q_tot_mean", "train/target_q_tot_mean", "train/td_error_mean", "train/dqn_q_mean",
    "train/dqn_td_error_mean", "train/q_std_across_actions", "train/epsilon",
    "train/targets_clipped_fraction", "train/rewards_clipped_fraction", "train/buffer_transitions"};

/// Settings of the subject `run` and these follow from the machine, or say where and how long; what is learned does not
/// hang on them.
constexpr std::array<std::string_view, 18> kNoRecipe = {"wad",
                                                        "device",
                                                        "policy_device",
                                                        "precision",
                                                        "num_workers",
                                                        "worker_num_splits",
                                                        "policy_workers",
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

std::string dumped(const ordered_json& json, int indent) {
  return json.dump(indent, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

double number_in(const ordered_json& object, const char* key, double fallback) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : fallback;
}

std::string result_path(const SweepResults& results, const std::string& run) {
  return results.folder + "/" + run + "/result.json";
}

/// `comrad eval` of a player, with what does not fit into a repository left out. `more` are flags for one that is no run.
Expected<ordered_json> evaluate(const SweepResults& results, const std::string& player,
                                const std::string& comrad, const std::vector<std::string>& more = {}) {
  std::vector<std::string> words = {comrad,       "eval",
                                    "--policy",   player,
                                    "--episodes", std::to_string(results.episodes),
                                    "--seed",     std::to_string(results.seed),
                                    "--json"};
  words.insert(words.end(), more.begin(), more.end());
  if (!results.greedy) words.push_back("--stochastic");
  COMRAD_TRY_ASSIGN(const ProgramResult played, run_program(words, {.timeout_s = kEvaluationTimeoutS}));
  if (played.interrupted) return Error{ErrorCode::kSystem, "interrupted"};
  if (played.exit_code != 0)
    return Error{ErrorCode::kPeerLost, "the evaluation ended with exit code " +
                                           std::to_string(played.exit_code) + ": " + last_words(played)};
  ordered_json answer = ordered_json::parse(played.output, nullptr, false);
  if (!answer.is_object() || !answer.contains("J_mean") || !answer.contains("each") ||
      !answer["each"].is_array())
    return Error{ErrorCode::kBadFormat, "the evaluation printed no object with J_mean and each"};
  answer["policy"] = fs::path(player).filename().string();
  answer.erase("checkpoint");
  ordered_json episodes = ordered_json::array();
  for (const ordered_json& one : answer["each"])
    episodes.push_back({{"J", rounded(one.value("J", ordered_json()))},
                        {"return", rounded(one.value("return", ordered_json()))}});
  answer["each"] = std::move(episodes);
  return answer;
}

/// Random play on the map of a run's evaluation by its team, once for each scenario. Runs on other pools have none: their
/// maps are many.
Status keep_random_play(const SweepResults& results, const RunConfig& config, const std::string& comrad) {
  const std::string path = results.folder + "/eval/random_" + scenario_file_name(config) + ".json";
  std::error_code ignored;
  if (!is_evaluated_on_one_map(config) || fs::exists(path, ignored)) return {};
  COMRAD_TRY_ASSIGN(const ordered_json answer,
                    evaluate(results, "random", comrad,
                             {"--scenario=" + config.run.scenario,
                              "--num_agents=" + std::to_string(config.environment.num_agents),
                              "--layout_seed=" + std::to_string(config.environment.layout_seed)}));
  return write_file_atomically(path, dumped(answer, -1), /*durable=*/true);
}

}  // namespace

std::string thin_metrics(const std::string& text, std::size_t rows_max) {
  std::vector<std::string> lines;
  std::istringstream source(text);
  for (std::string line; std::getline(source, line);) {
    const ordered_json report = ordered_json::parse(line, nullptr, false);
    if (!report.is_object()) continue;
    ordered_json kept = ordered_json::object();
    for (const auto& [name, value] : report.items())
      if (std::ranges::find(kNamesKept, name) != kNamesKept.end()) kept[name] = rounded(value);
    lines.push_back(dumped(kept, -1));
  }
  std::string thin;
  const std::size_t rows = std::min(rows_max, lines.size());
  for (std::size_t row = 0; row < rows; ++row)
    thin += lines[rows < 2 ? lines.size() - 1 : row * (lines.size() - 1) / (rows - 1)];
  return thin;
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
        std::ranges::find(kNoRecipe, row.name) != kNoRecipe.end() || !(row.counts(now) || row.counts(then)))
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

Status keep_result(const SweepFolder& folder, const SweepRun& run, const std::string& comrad) {
  const SweepResults& results = folder.results();
  const std::string run_dir = folder.run_dir(run), target = results.folder + "/" + run.name;
  COMRAD_TRY_ASSIGN(RunConfig config, load_run_config(run_dir + "/config.toml"));
  const std::optional<std::string> metrics = read_file(run_dir + "/metrics.jsonl");
  const std::optional<ordered_json> status = object_in(run_dir + "/status.json");
  if (!metrics || !status)
    return Error{ErrorCode::kBadFormat, run_dir + " has no metrics.jsonl or no status.json that can be read"};
  COMRAD_TRY_ASSIGN(const ordered_json evaluation, evaluate(results, run_dir, comrad));

  std::error_code failed;
  for (const std::string& made : {target, results.folder + "/eval"}) {
    fs::create_directories(made, failed);
    if (failed) return file_error("cannot make " + made, failed.value());
  }
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
      {"algo", config.run.algo.name()},
      {"seed", config.run.seed},
      {"num_agents", config.environment.num_agents},
      {"train_for_env_frames", run.goal_env_frames},
      {"env_frames", number_in(*status, "env_frames", 0)},
      {"train_s", rounded(std::max(trained_s(*metrics), number_in(*status, "elapsed_s", 0)))},
      {"episodes", evaluation.value("episodes", ordered_json(0))},
      {"J_mean", evaluation.value("J_mean", ordered_json())},
      {"J_ci95", evaluation.value("J_ci95", ordered_json())},
      {"return_mean", evaluation.value("return_mean", ordered_json())},
      {"map_hashes", evaluation.value("map_hashes", ordered_json::object())},
      {"command", command},
      {"commit", machine.commit},
      {"date", utc_text(wall_s())},
      {"processor", machine.processor},
      {"cores", machine.cores},
      {"stale", ""}};
  COMRAD_TRY(write_file_atomically(target + "/config.toml", changed_settings_to_toml(config), true));
  COMRAD_TRY(write_file_atomically(target + "/metrics.jsonl", thin_metrics(*metrics, kRowsMax), true));
  COMRAD_TRY(write_file_atomically(target + "/status.json", dumped(*status, 2), true));
  COMRAD_TRY(
      write_file_atomically(results.folder + "/eval/" + run.name + ".json", dumped(evaluation, -1), true));
  return write_file_atomically(target + "/result.json", dumped(result, 2), true);
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
    COMRAD_TRY(write_file_atomically(result_path(results, run.name), dumped(*result, 2), true));
  }
  return stale_count;
}

}  // namespace comrad::deploy
