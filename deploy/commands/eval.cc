// `comrad eval`: plays episodes, keyed by the evaluation seed, with a trained, a scripted or a random
// policy, through the same processes that training uses. Nothing is written into the run that is looked at.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "deploy/commands/command.h"
#include "deploy/commands/film_request.h"
#include "deploy/commands/output_check.h"
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
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

struct Evaluation {
  std::string policy;  ///< "random", "oracle" or a run
  double episodes = 100;
  std::string maps;  ///< "train", "held_out", or empty: what the run's kind of maps asks for
  bool greedy = true;
  bool stochastic = false;
  bool json = false;
  bool each = false;  ///< report every episode, too
  bool background = false;
  std::string checkpoint;  ///< file; empty without a network
  FilmRequest films;
  std::string positions;  ///< file to write; empty: none
  std::string run_dir;    ///< of the policy; empty where it is scripted
  bool is_scripted() const { return policy == "random" || policy == "oracle"; }
};

constexpr int64_t kEpisodesOfAFilm = 1;

/// The file of a film while it is made. It comes to its name when it is whole, and is removed when it never is.
class HalfWrittenFilm {
 public:
  explicit HalfWrittenFilm(const std::string& video) : video_(video) {
    const std::filesystem::path path = video;
    // The name's end tells the container.
    if (!video.empty())
      name_ = path.parent_path() /
              (std::string(kHalfWrittenMark) + std::to_string(getpid()) + "-" + path.filename().string());
  }
  HalfWrittenFilm(const HalfWrittenFilm&) = delete;
  HalfWrittenFilm& operator=(const HalfWrittenFilm&) = delete;
  ~HalfWrittenFilm() {
    std::error_code ignored;
    if (!name_.empty()) std::filesystem::remove(name_, ignored);
  }
  std::string name() const { return name_.string(); }
  /// Errors: as file_error, also where the simulator made no film.
  Status finish() {
    std::error_code failed;
    if (!name_.empty()) std::filesystem::rename(std::exchange(name_, {}), video_, failed);
    return failed ? file_error(video_ + " could not be made (what the simulator said stands above)",
                               failed.value())
                  : Status();
  }

 private:
  std::string video_;
  std::filesystem::path name_;
};

/// Which maps are played, where no flag names a map or a pool.
void choose_maps(const std::string& maps, RunConfig& config) {
  const bool has_pool = !config.environment.layout_pool.empty();
  if (maps == word_of(EvalMaps::kTrain) || (maps.empty() && !has_pool)) return;
  config.environment.layout_pool = kHeldOutPool;
  config.environment.wad.clear();
}

/// Errors: kBadInput for a word that --maps does not take, or maps that are named twice.
Status check_maps(const std::string& maps, const CommandLine& line) {
  if (maps.empty()) return {};
  const std::vector<std::string> known(Words<EvalMaps>::words.begin(), Words<EvalMaps>::words.end());
  if (std::ranges::find(known, maps) == known.end())
    return Error{ErrorCode::kBadInput, "--maps: " + unknown_word("maps", maps, known)};
  for (const char* other : {"layout_pool", "wad", "layout_seed"})
    if (line.was_typed(other))
      return Error{ErrorCode::kBadInput,
                   "--maps and --" + std::string(other) + " both name maps; leave one of them out"};
  return {};
}

Expected<std::string> checkpoint_of(const Evaluation& evaluation, CheckpointKind kind) {
  std::error_code error;
  if (evaluation.checkpoint.empty()) return find_checkpoint(evaluation.run_dir, kind);
  if (!std::filesystem::is_regular_file(evaluation.checkpoint, error))
    return Error{ErrorCode::kNotFound, "--checkpoint=" + evaluation.checkpoint +
                                           ": no such file; those of the run lie in " + evaluation.run_dir +
                                           "/checkpoint"};
  return std::filesystem::absolute(evaluation.checkpoint, error).string();
}

/// The settings to evaluate with: a run's own, or new ones where there is no run.
Expected<MergedSettings> settings_for(Evaluation& evaluation, const UserSettings& user,
                                      const RunConfig& typed, const CommandLine& line, int core_count) {
  if (evaluation.is_scripted()) {
    if (!evaluation.checkpoint.empty())
      return Error{ErrorCode::kBadInput,
                   "--checkpoint is of a run; --policy " + evaluation.policy + " has none"};
    UserSettings asked = user;
    if (evaluation.maps == word_of(EvalMaps::kHeldOut))
      asked.typed.values.emplace_back("layout_pool", kHeldOutPool);
    return merge_new(asked, describe_scenario, core_count);
  }
  COMRAD_TRY_ASSIGN(evaluation.run_dir, find_run(evaluation.policy, typed.run.train_dir));
  COMRAD_TRY_ASSIGN(RunConfig run, load_run_config(evaluation.run_dir + "/config.toml"));
  run.run.seed = RunConfig().run.seed;  // runs of different seeds meet the same evaluation episodes
  run.collection.deterministic = false;
  if (line.was_typed("layout_pool")) {
    run.environment.wad.clear();
  } else if (line.was_typed("wad") || line.was_typed("layout_seed")) {
    run.environment.layout_pool.clear();
  } else {
    choose_maps(evaluation.maps, run);
  }
  if (run.environment.layout_pool.empty())
    run.curriculum = RunConfig().curriculum;  // no curriculum draws in an evaluation
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_onto_run(run, user, describe_scenario, core_count));
  forget_stale_layout(run, merged.config);
  COMRAD_TRY_ASSIGN(evaluation.checkpoint, checkpoint_of(evaluation, merged.config.run.load_checkpoint_kind));
  return merged;
}

/// The list of a pool that the run has drawn already; empty where it has to be drawn or checked anew, for the run never
/// did, or its maps are no longer where they were.
std::string known_pool(const Evaluation& evaluation, const CommandLine& line, const RunConfig& config) {
  if (evaluation.run_dir.empty() || line.was_typed("layout_pool") || config.environment.layout_pool.empty())
    return "";
  const std::string path =
      evaluation.run_dir + "/" +
      (config.environment.layout_pool == kHeldOutPool ? kHeldOutListFile : kLayoutListFile);
  const std::string text = read_file(path).value_or("");
  const Expected<LayoutList> list = parse_layout_list(text, path);
  if (!list) return "";
  for (const LayoutEntry& layout : list->layouts)
    if (!check_wad(layout.path)) return "";
  return text;
}

/// What to play with: as many environments as there is something to do for, one where it is filmed.
Expected<MergedSettings> sized_settings(Evaluation& evaluation, UserSettings user, const RunConfig& typed,
                                        const CommandLine& line, bool is_filmed) {
  const int core_count = usable_cores();
  const auto set = [&](const char* name, int64_t value) {
    user.typed.values.emplace_back(name, std::to_string(value));
  };
  if (is_filmed)
    for (const char* name : {"num_workers", "num_envs_per_worker", "worker_num_splits"}) set(name, 1);
  COMRAD_TRY_ASSIGN(MergedSettings merged, settings_for(evaluation, user, typed, line, core_count));
  if (is_filmed || line.was_typed("num_envs_per_worker")) return merged;
  const CollectionSettings& collection = merged.config.collection;
  const int64_t enough =
      (static_cast<int64_t>(evaluation.episodes) + collection.num_workers - 1) / collection.num_workers;
  if (enough >= collection.num_envs_per_worker) return merged;
  set("num_envs_per_worker", enough);
  return settings_for(evaluation, user, typed, line, core_count);
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
           {"J_per_agent", episode.agent_score},
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

/// The absolute path of --positions_file; empty where none is wanted. Errors: kBadInput.
Expected<std::string> check_positions_file(const std::string& typed, const FilmPlan& film) {
  if (typed.empty()) return std::string();
  if (film.is_wanted())
    return Error{ErrorCode::kBadInput,
                 "--positions_file and films are made one at a time; start comrad eval twice"};
  return check_output_file("positions_file", typed, {".jsonl"});
}

/// Puts what the simulators wrote into one file, below a line that says who played what.
Status write_positions(const std::string& path, const LaunchPlan& plan,
                       const nlohmann::ordered_json& summary) {
  nlohmann::ordered_json head;
  for (const char* key :
       {"scenario", "policy", "num_agents", "episodes", "seed", "layout", "greedy", "checkpoint"})
    head[key] = summary[key];
  std::string text = head.dump() + "\n";
  for (int index = 0; index < plan.config.collection.num_workers; ++index)
    text += read_file(plan.positions_path(index)).value_or("");  // of one that had no episode to play: empty
  std::size_t episodes = 0;
  constexpr std::string_view kMark = "\"decisions\":";
  for (std::size_t at = text.find(kMark); at != std::string::npos; at = text.find(kMark, at + 1)) ++episodes;
  if (episodes != plan.episodes)
    return Error{ErrorCode::kPeerLost,
                 path + ": positions of " + std::to_string(episodes) + " of " +
                     std::to_string(plan.episodes) +
                     " episodes are there, because a simulator was started again; evaluate once more"};
  return write_file_atomically(path, text, /*durable=*/false);
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
  evaluation.each |= evaluation.json;
  COMRAD_TRY(check_maps(evaluation.maps, line));
  COMRAD_TRY_ASSIGN(const FilmPlan film, check_films(evaluation.films));
  if (film.is_wanted() && !line.was_typed("episodes")) evaluation.episodes = kEpisodesOfAFilm;
  if (evaluation.background) yield_to_others();

  const UserSettings user{line.config_file(), line.typed()};
  for (const std::string& text : flags_unused_by_eval(user.typed))
    std::fprintf(stderr, "comrad eval: note: %s\n", text.c_str());
  RunConfig typed;
  COMRAD_TRY(apply_layer(typed, user.typed));
  COMRAD_TRY_ASSIGN(const std::string positions, check_positions_file(evaluation.positions, film));
  COMRAD_TRY_ASSIGN(MergedSettings merged, sized_settings(evaluation, user, typed, line, film.is_wanted()));
  const auto episodes = static_cast<int64_t>(evaluation.episodes);

  const std::string layout = layout_text(merged.config);
  COMRAD_TRY_ASSIGN(const TemporaryRun run,
                    TemporaryRun::create(merged.config, known_pool(evaluation, line, merged.config)));
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
  HalfWrittenFilm video(film.video);
  plan.film = film;
  plan.keeps_positions = !positions.empty();
  plan.film.video = video.name();
  plan.show_progress = !evaluation.json || isatty(STDERR_FILENO) != 0;
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  if (outcome.interrupted || outcome.exit_code != 0 || outcome.episodes.size() != plan.episodes)
    return Error{ErrorCode::kPeerLost, "only " + std::to_string(outcome.episodes.size()) + " of " +
                                           std::to_string(episodes) + " episodes were played" +
                                           (outcome.message.empty() ? "" : ": " + outcome.message)};

  COMRAD_TRY(video.finish());
  nlohmann::ordered_json summary = summarise(evaluation, merged, layout, pool, outcome);
  if (!film.video.empty()) summary["video"] = film.video;
  if (!film.frames.empty()) summary["frames"] = film.frames;
  if (!positions.empty()) {
    COMRAD_TRY(write_positions(positions, plan, summary));
    summary["positions"] = positions;
  }
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
      "eval --policy random|oracle|RUN [--episodes N] [--save_video FILE] [--json] [settings]",
      "Plays N episodes and reports the score J with its 95% confidence interval over episodes (Student t).\n"
      "RUN is a run directory or the name of an experiment below --train_dir; its own settings are taken\n"
      "from its config.toml. A run that was trained on one map plays that map; one that was trained on a\n"
      "pool plays 20 maps that no training pool holds (--maps and --layout_pool say otherwise), all in "
      "turn.\n"
      "Episodes are keyed by --seed. J_share is J divided by the best score that each episode's map allows\n"
      "so many agents.");
  line.add_option("policy", evaluation.policy, "NAME",
                  "random, oracle (the scenario's scripted team), a run directory, or an experiment's name");
  line.add_option("episodes", evaluation.episodes, "N", "episodes to play (default 100, of a film 1)");
  line.add_option(
      "checkpoint", evaluation.checkpoint, "FILE",
      "the checkpoint to play, for example a milestone (default: --load_checkpoint_kind says which)");
  line.add_option("maps", evaluation.maps, "WORD",
                  "train (those that the run trains on) or held_out (20 that no training pool holds)");
  line.add_option("save_video", evaluation.films.video, "FILE",
                  "film the episodes: .mp4 or .mkv, all agents side by side, with actions and score");
  line.add_option("frames", evaluation.films.frames, "DIR",
                  "the same as one PNG a decision, in a new folder");
  line.add_option("size", evaluation.films.size, "WxH",
                  "of one agent's view in films (default 640x360); the network still sees 128x72");
  line.add_option(
      "positions_file", evaluation.positions, "FILE",
      "write where each agent was after every decision, and the map's lines: JSON lines (.jsonl), "
      "for the occupancy maps of comrad report");
  line.add_switch("greedy", evaluation.greedy, "take the most likely action (default True for a run)");
  line.add_switch("stochastic", evaluation.stochastic, "draw actions from the policy, as training does");
  line.add_switch("each", evaluation.each, "report every episode as well (--json always does)");
  line.add_switch("background", evaluation.background, "leave the cores to whatever else runs");
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
