// `comrad eval`: plays fresh episodes, keyed by the evaluation seed, with a trained, a scripted or a random
// policy, through the same processes that training uses. Nothing is written into the run that is looked at.

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "deploy/commands/command.h"
#include "deploy/commands/statistics.h"
#include "deploy/launch/supervisor.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/existing_run.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/network_description.h"
#include "deploy/settings/start_notes.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

struct Evaluation {
  std::string policy;  ///< "random", "oracle" or a run
  double episodes = 100;
  bool greedy = true;
  bool stochastic = false;
  bool json = false;
  bool each = false;       ///< report every episode, too
  std::string checkpoint;  ///< file; empty without a network
  bool is_scripted() const { return policy == "random" || policy == "oracle"; }
};

/// Layouts that a run trained on a pool is evaluated on: fresh ones of the evaluation pool, which no training
/// pool shares.
constexpr const char* kEvaluationPool = "eval:20";

/// The settings to evaluate with: a run's own, or new ones where there is no run.
Expected<MergedSettings> settings_for(Evaluation& evaluation, const UserSettings& user,
                                      const RunConfig& typed, const CommandLine& line, int core_count) {
  if (evaluation.is_scripted()) return merge_new(user, describe_scenario, core_count);
  COMRAD_TRY_ASSIGN(const std::string run_dir, find_run(evaluation.policy, typed.run.train_dir));
  COMRAD_TRY_ASSIGN(RunConfig run, load_run_config(run_dir + "/config.toml"));
  run.run.seed = RunConfig().run.seed;  // runs of different seeds meet the same evaluation episodes
  run.collection.deterministic = false;
  if (line.was_typed("layout_pool")) {
    run.environment.wad.clear();
  } else if (line.was_typed("wad") || line.was_typed("layout_seed")) {
    run.environment.layout_pool.clear();
  } else if (!run.environment.layout_pool.empty()) {
    run.environment.layout_pool = kEvaluationPool;
  }
  if (run.environment.layout_pool.empty())
    run.curriculum = RunConfig().curriculum;  // no curriculum draws in an evaluation
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_onto_run(run, user, describe_scenario, core_count));
  forget_stale_layout(run, merged.config);
  COMRAD_TRY_ASSIGN(evaluation.checkpoint, find_checkpoint(run_dir, merged.config.run.load_checkpoint_kind));
  return merged;
}

nlohmann::ordered_json summarise(const Evaluation& evaluation, const MergedSettings& merged,
                                 const std::string& layout, const LayoutList& pool,
                                 const RunOutcome& outcome) {
  const size_t agents = static_cast<size_t>(merged.config.environment.num_agents);
  std::vector<double> scores, returns, lengths, ceilings, shares;
  std::vector<double> agent_scores(agents, 0.0);
  for (const dds::EpisodeResult& episode : outcome.episodes) {
    scores.push_back(episode.score);
    returns.push_back(mean(episode.agent_return));
    lengths.push_back(episode.length_tics);
    for (size_t agent = 0; agent < agents; ++agent)
      agent_scores[agent] += agent < episode.agent_score.size() ? episode.agent_score[agent] : std::nan("");
    if (!(episode.ceiling > 0)) continue;
    ceilings.push_back(episode.ceiling);
    shares.push_back(episode.score / episode.ceiling);
  }
  for (double& score : agent_scores) score /= static_cast<double>(outcome.episodes.size());
  nlohmann::ordered_json summary = {{"scenario", merged.config.run.scenario},
                                    {"policy", evaluation.policy},
                                    {"episodes", outcome.episodes.size()},
                                    {"seed", merged.config.run.seed},
                                    {"num_agents", merged.config.environment.num_agents},
                                    {"layout", layout},
                                    {"J_mean", mean(scores)},
                                    {"J_ci95", confidence_95(scores)},
                                    {"J_per_agent", agent_scores},
                                    {"return_mean", mean(returns)},
                                    {"length_tics_mean", mean(lengths)},
                                    {"ceiling", ceilings.empty() ? 0.0 : mean(ceilings)},
                                    {"J_share", nullptr},
                                    {"greedy", evaluation.greedy},
                                    {"checkpoint", evaluation.checkpoint}};
  if (!shares.empty()) summary["J_share"] = mean(shares);
  // Simulators play the layouts of a pool in turn, by the number of the episode.
  if (evaluation.each)
    for (const dds::EpisodeResult& episode : outcome.episodes)
      summary["each"].push_back(
          {{"episode", episode.episode_id},
           {"layout",
            pool.layouts.empty() ? layout : pool.layouts[episode.episode_id % pool.layouts.size()].id},
           {"J", episode.score},
           {"ceiling", episode.ceiling},
           {"length_tics", episode.length_tics},
           {"terminated", episode.terminated},
           {"return", mean(episode.agent_return)}});
  if (pool.layouts.empty()) return summary;
  std::vector<std::vector<double>> by_layout(pool.layouts.size());
  for (const dds::EpisodeResult& episode : outcome.episodes)
    by_layout[episode.episode_id % by_layout.size()].push_back(episode.score);
  std::vector<double> means;
  nlohmann::ordered_json layouts = nlohmann::ordered_json::object(), allowed = layouts;
  for (std::size_t i = 0; i < by_layout.size(); ++i) {
    if (by_layout[i].empty()) continue;
    means.push_back(mean(by_layout[i]));
    layouts[pool.layouts[i].id] = means.back();
    if (pool.layouts[i].ceiling > 0) allowed[pool.layouts[i].id] = pool.layouts[i].ceiling;
  }
  summary["layouts"] = means.size();
  summary["J_ci95_layouts"] = confidence_95(means);
  summary["J_by_layout"] = layouts;
  summary["ceiling_by_layout"] = allowed;
  return summary;
}

void print_table(const nlohmann::ordered_json& summary, const std::string& score_name) {
  if (summary.contains("each"))
    for (const auto& one : summary["each"])
      std::printf("episode %llu  %s  J %.4g of %.4g  %u tics  return %.4g\n",
                  one["episode"].get<unsigned long long>(), one["layout"].get<std::string>().c_str(),
                  one["J"].get<double>(), one["ceiling"].get<double>(), one["length_tics"].get<unsigned>(),
                  one["return"].get<double>());
  for (const auto& [key, value] : summary.items()) {
    if (key == "each") continue;
    if ((key == "checkpoint" && value == "") || value.is_object() || value.is_null()) continue;
    std::string text = value.is_string() ? value.get<std::string>() : value.dump();
    if (value.is_number_float()) {
      char rounded[32];
      std::snprintf(rounded, sizeof(rounded), "%.4g", value.get<double>());
      text = rounded;
    }
    if (key == "J_mean") text += "  (" + score_name + ")";
    if (key == "J_share") text += "  (of what each episode's map allows)";
    std::printf("%-18s %s\n", key.c_str(), text.c_str());
  }
  if (!summary.contains("J_by_layout")) return;
  for (const auto& [layout, score] : summary["J_by_layout"].items()) {
    std::printf("  %-32s %.4g", layout.c_str(), score.get<double>());
    if (summary["ceiling_by_layout"].contains(layout))
      std::printf(" of %.4g", summary["ceiling_by_layout"][layout].get<double>());
    std::puts("");
  }
}

Expected<int> evaluate(Evaluation& evaluation, const CommandLine& line) {
  if (evaluation.policy.empty())
    return Error{ErrorCode::kBadInput, "--policy is missing; give --policy random, oracle or RUN"};
  if (!(evaluation.episodes >= 1) || evaluation.episodes > 1e7)
    return Error{ErrorCode::kBadInput, "--episodes must be from 1 to 1e7"};
  evaluation.greedy = !evaluation.is_scripted() && evaluation.greedy && !evaluation.stochastic;

  UserSettings user{line.config_file(), line.typed()};
  for (const std::string& text : flags_unused_by_eval(user.typed))
    std::fprintf(stderr, "comrad eval: note: %s\n", text.c_str());
  const int core_count = usable_cores();
  RunConfig typed;
  COMRAD_TRY(apply_layer(typed, user.typed));
  COMRAD_TRY_ASSIGN(MergedSettings merged, settings_for(evaluation, user, typed, line, core_count));
  const auto episodes = static_cast<int64_t>(evaluation.episodes);
  const int64_t enough =
      (episodes + merged.config.collection.num_workers - 1) / merged.config.collection.num_workers;
  if (!line.was_typed("num_envs_per_worker") && enough < merged.config.collection.num_envs_per_worker) {
    user.typed.values.emplace_back("num_envs_per_worker", std::to_string(enough));
    COMRAD_TRY_ASSIGN(merged, settings_for(evaluation, user, typed, line, core_count));
  }

  const std::string layout = layout_text(merged.config);
  COMRAD_TRY_ASSIGN(const TemporaryRun run, TemporaryRun::create(merged.config));
  LayoutList pool;
  if (!merged.config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(pool, read_layout_list(run.path()));
    if (static_cast<std::size_t>(episodes) < pool.layouts.size())
      std::fprintf(stderr, "comrad eval: %lld episodes reach the first %lld of %zu layouts alone\n",
                   static_cast<long long>(episodes), static_cast<long long>(episodes), pool.layouts.size());
  }
  LaunchPlan plan;
  plan.config = merged.config;
  plan.env = merged.scenario.env;
  plan.decision_limit = merged.scenario.decision_limit;
  plan.run_dir = run.path();
  plan.policy = evaluation.policy == "oracle"   ? PolicySource::kOracle
                : evaluation.policy == "random" ? PolicySource::kRandom
                                                : PolicySource::kCheckpoint;
  if (plan.has_learner()) {
    COMRAD_TRY_ASSIGN(plan.network, describe_network(merged.config, plan.env));
  }
  plan.checkpoint = evaluation.checkpoint;
  plan.greedy = evaluation.greedy;
  plan.episodes = static_cast<uint64_t>(episodes);
  plan.show_progress = !evaluation.json || isatty(STDERR_FILENO) != 0;
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  if (outcome.interrupted || outcome.exit_code != 0 || outcome.episodes.size() != plan.episodes)
    return Error{ErrorCode::kPeerLost, "only " + std::to_string(outcome.episodes.size()) + " of " +
                                           std::to_string(episodes) + " episodes were played" +
                                           (outcome.message.empty() ? "" : ": " + outcome.message)};

  const nlohmann::ordered_json summary = summarise(evaluation, merged, layout, pool, outcome);
  if (evaluation.json)
    std::printf("%s\n", summary.dump().c_str());
  else
    print_table(summary, merged.scenario.score);
  return kExitDone;
}

}  // namespace

int eval_command(Arguments arguments) {
  Evaluation evaluation;
  CommandLine line(
      "eval --policy random|oracle|RUN [--episodes N] [--json] [settings]",
      "Plays N fresh episodes and reports the score J with its 95% confidence interval over episodes\n"
      "(Student t). RUN is a run directory or the name of an experiment below --train_dir; its own\n"
      "settings are taken from its config.toml. Episodes are keyed by --seed. With --layout_pool all its\n"
      "layouts are played in turn; a run that was trained on a pool plays eval:20 unless told otherwise,\n"
      "fresh layouts that no training pool holds. J_share is J divided by the best score that each "
      "episode's\n"
      "map allows so many agents.");
  line.add_option("policy", evaluation.policy, "NAME",
                  "random, oracle (the scenario's scripted team), a run directory, or an experiment's name");
  line.add_option("episodes", evaluation.episodes, "N", "episodes to play (default 100)");
  line.add_switch("greedy", evaluation.greedy, "take the most likely action (default True for a run)");
  line.add_switch("stochastic", evaluation.stochastic, "draw actions from the policy, as training does");
  line.add_switch("each", evaluation.each, "report every episode as well");
  line.add_switch("json", evaluation.json, "print one JSON object on stdout and nothing else");
  line.add_settings(SettingsListed::kUsedByEval);
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("eval", parsed.error());
  if (line.help_requested()) {
    std::fputs(line.help().c_str(), stdout);
    return kExitDone;
  }
  const Expected<int> done = evaluate(evaluation, line);
  return done ? *done : report_error("eval", done.error());
}

}  // namespace comrad::deploy
