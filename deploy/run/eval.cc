// `comrad eval`: plays episodes, keyed by the evaluation seed, with trained, scripted or random players, alone or
// together, through the same processes that training uses. Nothing is written into the runs that are looked at.

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "deploy/evaluation/cross_play.h"
#include "deploy/evaluation/csv.h"
#include "deploy/evaluation/evaluation_game.h"
#include "deploy/evaluation/play.h"
#include "deploy/evaluation/recorded_episodes.h"
#include "deploy/evaluation/summary.h"
#include "deploy/evaluation/video_request.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/output_check.h"
#include "deploy/settings/start_notes.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/score_text.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using Json = nlohmann::ordered_json;

constexpr int64_t kEpisodesOfAVideo = 1;
constexpr double kEpisodesOfAPage = 1e7;  // until it is closed

/// The files to write, with absolute paths; empty: none.
struct OutputFiles {
  VideoPlan recording;
  std::string positions, episodes, episodes_dir;
};

/// What can be refused before a player is looked for. Errors: kBadInput, naming the flag.
Expected<OutputFiles> check_request(EvaluationRequest& request, const CommandLine& line) {
  COMRAD_TRY(check_teams(request));
  if (!(request.episodes >= 1) || request.episodes > 1e7)
    return Error{ErrorCode::kBadInput, "--episodes must be from 1 to 1e7"};
  if (request.json && request.csv)
    return Error{ErrorCode::kBadInput, "--json and --csv both go to standard output; leave one of them out"};
  request.each |= request.json;
  COMRAD_TRY(check_maps(request.maps, line));
  OutputFiles files;
  COMRAD_TRY_ASSIGN(files.recording, check_videos(request.videos));
  if (files.recording.is_wanted() && !line.was_typed("episodes")) request.episodes = kEpisodesOfAVideo;
  if (!request.positions.empty()) {
    if (files.recording.is_wanted())
      return Error{ErrorCode::kBadInput,
                   "--positions_file and videos are made one at a time; start comrad eval twice"};
    COMRAD_TRY_ASSIGN(files.positions, check_output_file("positions_file", request.positions, {".jsonl"}));
  }
  if (!request.episodes_file.empty()) {
    COMRAD_TRY_ASSIGN(files.episodes,
                      check_output_file("episodes_file", request.episodes_file, {".csv", ".jsonl"}));
  }
  if (!request.episodes_dir.empty()) {
    if (files.recording.is_wanted() || !files.positions.empty())
      return Error{ErrorCode::kBadInput,
                   "--episodes_dir is made without videos and --positions_file; start comrad eval twice"};
    COMRAD_TRY_ASSIGN(files.episodes_dir,
                      check_new_folder("episodes_dir", request.episodes_dir, "; name a new one"));
  }
  if (!request.page.empty()) {
    if (files.recording.is_wanted() || !files.positions.empty())
      return Error{ErrorCode::kBadInput, "a page is shown without videos and --positions_file"};
    if (!line.was_typed("episodes")) request.episodes = kEpisodesOfAPage;
  }
  const bool has_several_teams = request.policies.size() > 1 || !request.cross_play.empty();
  if (has_several_teams && (files.recording.is_wanted() || !files.positions.empty() ||
                            !files.episodes_dir.empty() || !request.page.empty()))
    return Error{
        ErrorCode::kBadInput,
        "videos, pages, --positions_file and --episodes_dir are of one team; start comrad eval once for each "
        "policy"};
  return files;
}

/// Puts what the simulators wrote into one file, below a line that names each agent's player.
Status write_positions(const std::string& path, const LaunchPlan& plan, const Json& summary) {
  Json head;
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
    return Error{ErrorCode::kPeerLost, fmt::format("{}: positions of {} of {} episodes are there, because a "
                                                   "simulator was started again; evaluate once more",
                                                   path, episodes, plan.episodes)};
  return write_file_atomically(path, text, /*durable=*/false);
}

/// "12.35"; "-" for null.
std::string rounded(const Json& value) { return value.is_number() ? score_text(value.get<double>()) : "-"; }

void print_episodes(const Json& summary) {
  if (!summary.contains("each")) return;
  for (const auto& one : summary["each"])
    std::printf("episode %llu  %s  J %s of %s  %u tics  return %s\n",
                one["episode"].get<unsigned long long>(), one["layout"].get<std::string>().c_str(),
                rounded(one["J"]).c_str(), rounded(one["ceiling"]).c_str(),
                one["length_tics"].get<unsigned>(), rounded(one["return"]).c_str());
}

/// Why a score is not normalised, and what normalises it.
constexpr const char* kNoReference =
    "-  (random play and the scripted team were not measured on these maps with this team; add --policy "
    "random,oracle)";

void print_one(const Json& summary, const std::string& score_name) {
  print_episodes(summary);
  for (const auto& [key, value] : summary.items()) {
    if (key == "J_normalised" && value.is_null()) std::printf("%-18s %s\n", key.c_str(), kNoReference);
    if (key == "each" || key == "seats" || (key == "checkpoint" && value == "") || value.is_object() ||
        value.is_null())
      continue;
    std::string text = value.is_string()         ? value.get<std::string>()
                       : value.is_number_float() ? rounded(value)
                                                 : value.dump();
    if (key == "J_mean") text += "  (" + score_name + ")";
    if (key == "J_share") text += "  (of what each episode's map allows)";
    if (key == "J_normalised")
      text += "  (0: random play, 1: the scripted team; from " +
              summary["references"]["from"].get<std::string>() + ")";
    std::printf("%-18s %s\n", key.c_str(), text.c_str());
  }
  if (!summary.contains("J_by_layout")) return;
  for (const auto& [layout, score] : summary["J_by_layout"].items()) {
    std::printf("  %-32s %s", layout.c_str(), rounded(score).c_str());
    if (summary["ceiling_by_layout"].contains(layout))
      std::printf(" of %s", rounded(summary["ceiling_by_layout"][layout]).c_str());
    std::puts("");
  }
}

/// A row a policy.
void print_several(const std::vector<Json>& summaries, const std::string& score_name) {
  std::size_t width = 6;
  for (const Json& summary : summaries) {
    print_episodes(summary);
    width = std::max(width, summary["policy"].get<std::string>().size());
  }
  std::printf("%-*s  %10s  %10s  %8s  %12s  %10s  %10s\n", static_cast<int>(width), "policy", "J", "+-",
              "J_share", "J_normalised", "return", "tics");
  for (const Json& summary : summaries)
    std::printf("%-*s  %10s  %10s  %8s  %12s  %10s  %10s\n", static_cast<int>(width),
                summary["policy"].get<std::string>().c_str(), rounded(summary["J_mean"]).c_str(),
                rounded(summary["J_ci95"]).c_str(), rounded(summary["J_share"]).c_str(),
                rounded(summary["J_normalised"]).c_str(), rounded(summary["return_mean"]).c_str(),
                rounded(summary["length_tics_mean"]).c_str());
  const Json& first = summaries.front();
  std::printf("J: %s; %llu episodes each of %s, %s, seed %lld\n", score_name.c_str(),
              first["episodes"].get<unsigned long long>(), first["scenario"].get<std::string>().c_str(),
              first["layout"].get<std::string>().c_str(), first["seed"].get<long long>());
  if (first["J_normalised"].is_null()) std::printf("J_normalised: %s\n", kNoReference);
}

/// What all teams of an evaluation share.
Json game_json(const Json& summary) {
  Json shared;
  for (const char* key : {"scenario", "episodes", "seed", "num_agents", "layout"}) shared[key] = summary[key];
  return shared;
}

void print_results(const EvaluationRequest& request, const std::vector<PlayedTeam>& played,
                   const std::vector<Json>& summaries, const std::string& score_name) {
  if (!request.cross_play.empty()) {
    std::vector<std::vector<double>> scores;
    for (const PlayedTeam& one : played) {
      scores.emplace_back();
      for (const EpisodeRecord& episode : one.episodes) scores.back().push_back(episode.score);
    }
    const CrossPlay result = cross_play_of(request.cross_play, scores);
    const std::size_t count = request.cross_play.size();
    std::vector<Json> cells;
    for (std::size_t cell = 0; cell < summaries.size(); ++cell) {
      cells.push_back(
          {{"row", request.cross_play[cell / count]}, {"column", request.cross_play[cell % count]}});
      cells.back().update(request.csv ? summary_row(summaries[cell]) : summaries[cell]);
    }
    if (request.csv) {
      std::fputs(csv_text(cells).c_str(), stdout);
    } else if (request.json) {
      Json all = game_json(summaries.front());
      all.update(cross_play_json(result));
      all["cells"] = cells;
      std::printf("%s\n", all.dump().c_str());
    } else {
      for (const Json& summary : summaries) print_episodes(summary);
      std::printf("J: %s, +- half of its 95%% interval over %zu episodes\n", score_name.c_str(),
                  scores.front().size());
      std::fputs(cross_play_table(result).c_str(), stdout);
    }
  } else if (request.csv) {
    std::vector<Json> rows;
    for (const Json& summary : summaries) rows.push_back(summary_row(summary));
    std::fputs(csv_text(rows).c_str(), stdout);
  } else if (summaries.size() == 1) {
    if (request.json)
      std::printf("%s\n", summaries.front().dump().c_str());
    else
      print_one(summaries.front(), score_name);
  } else if (request.json) {
    Json all = game_json(summaries.front());
    all["policies"] = summaries;
    std::printf("%s\n", all.dump().c_str());
  } else {
    print_several(summaries, score_name);
  }
}

/// Whether a team's networks take their most likely actions; false for a team without one.
bool plays_greedily(const EvaluationRequest& request, const EvaluationGame& game, const Team& team) {
  return request.greedy && !request.stochastic &&
         std::ranges::any_of(team.players,
                             [&game](const std::string& name) { return game.player(name).is_network(); });
}

/// Plays for a page until that is closed. Episodes that are to be kept are written as each one ends.
Expected<int> show(const EvaluationRequest& request, const OutputFiles& files, const EvaluationGame& game) {
  const Team& team = game.teams.front();
  COMRAD_TRY_ASSIGN(LaunchPlan plan, plan_of(game, team, plays_greedily(request, game, team)));
  plan.page.socket = request.page;
  plan.page.size = request.page_size;
  plan.page.pictures_per_s = request.pictures_per_s;
  plan.show_progress = false;
  plan.keeps_episodes = !files.episodes_dir.empty();
  Status kept;
  if (plan.keeps_episodes) {
    COMRAD_TRY(make_episodes_folder(plan));
    plan.on_episode = [&](const EpisodeRecord& episode) {
      const Status written = keep_episodes(files.episodes_dir, game, plan, {&team, {episode}});
      if (kept && !written) std::fprintf(stderr, "comrad eval: error: %s\n", written.error().message.c_str());
      if (kept) kept = written;
    };
  }
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  COMRAD_TRY(kept);
  if (outcome.reason == StopReason::kFailed) return Error{ErrorCode::kPeerLost, outcome.message};
  return kExitDone;
}

/// Scores episodes that were played already, by people or policies.
Expected<int> score_recorded(const EvaluationRequest& request, const CommandLine& line) {
  if (!request.policies.empty() || !request.seats.empty() || !request.cross_play.empty() ||
      !line.typed().values.empty())
    return Error{ErrorCode::kBadInput,
                 "--recorded scores episodes that were played already; leave out players and settings"};
  COMRAD_TRY_ASSIGN(const Json summary, summarise_recorded(request.recorded, request.json));
  if (request.json)
    std::printf("%s\n", summary.dump().c_str());
  else if (request.csv)
    std::fputs(csv_text({summary}).c_str(), stdout);
  else
    for (const auto& [key, value] : summary.items())
      if (!value.is_array())
        std::printf("%-18s %s\n", key.c_str(),
                    value.is_string() ? value.get<std::string>().c_str() : rounded(value).c_str());
  return kExitDone;
}

Expected<int> evaluate(EvaluationRequest& request, const CommandLine& line) {
  if (!request.recorded.empty()) return score_recorded(request, line);
  COMRAD_TRY_ASSIGN(const OutputFiles files, check_request(request, line));
  if (request.background) yield_to_others();
  for (const std::string& text : flags_unused_by_eval(line.typed()))
    std::fprintf(stderr, "comrad eval: note: %s\n", text.c_str());
  COMRAD_TRY_ASSIGN(const EvaluationGame game,
                    prepare_game(request, line, files.recording.is_wanted() || !request.page.empty()));
  if (!request.page.empty()) return show(request, files, game);

  std::vector<PlayedTeam> played;
  LaunchPlan plan;
  HalfWrittenVideo video(files.recording.video);
  for (const Team& team : game.teams) {
    COMRAD_TRY_ASSIGN(plan, plan_of(game, team, plays_greedily(request, game, team)));
    plan.recording = files.recording;
    plan.recording.video = video.name();
    plan.recording.finished_video = video.finished_name();
    plan.keeps_positions = !files.positions.empty();
    plan.keeps_episodes = !files.episodes_dir.empty();
    if (plan.keeps_episodes) COMRAD_TRY(make_episodes_folder(plan));
    plan.show_progress = !(request.json || request.csv) || isatty(STDERR_FILENO) != 0;
    if (plan.show_progress && game.teams.size() > 1)
      std::fprintf(stderr, "comrad eval: %zu of %zu: %s\n", played.size() + 1, game.teams.size(),
                   team.name.c_str());
    COMRAD_TRY_ASSIGN(RunOutcome outcome, play(plan));
    played.push_back({&team, std::move(outcome.episodes)});
  }

  COMRAD_TRY(video.finish());
  const ScoreScale scale = scale_of(game, played);
  std::vector<Json> summaries, rows;
  for (const PlayedTeam& one : played) {
    summaries.push_back(summarise(game, one, scale, plays_greedily(request, game, *one.team), request.each));
    for (Json& row : episode_rows(game, one, scale)) rows.push_back(std::move(row));
  }
  if (!files.recording.video.empty()) summaries.front()["video"] = files.recording.video;
  if (!files.recording.frames.empty()) summaries.front()["frames"] = files.recording.frames;
  if (!files.positions.empty()) {
    COMRAD_TRY(write_positions(files.positions, plan, summaries.front()));
    summaries.front()["positions"] = files.positions;
  }
  if (!files.episodes_dir.empty()) {
    COMRAD_TRY(keep_episodes(files.episodes_dir, game, plan, played.front()));
    summaries.front()["episodes_dir"] = files.episodes_dir;
  }
  if (!files.episodes.empty()) {
    const bool is_csv = lower_case(files.episodes).ends_with(".csv");
    COMRAD_TRY(write_file_atomically(files.episodes, is_csv ? csv_text(rows) : json_lines(rows),
                                     /*durable=*/false));
  }
  print_results(request, played, summaries, game.merged.scenario.score);
  return kExitDone;
}

}  // namespace

int eval_command(Arguments arguments) {
  EvaluationRequest request;
  CommandLine line(
      "eval --policy PLAYERS [--seat AGENT=PLAYER] | --cross_play PLAYERS [--episodes N] [--json|--csv] "
      "[settings]",
      "Plays N episodes and reports the score J with its 95% confidence interval over episodes (Student t).\n"
      "PLAYER is random, oracle (the scenario's scripted team), noop (presses nothing), or a network: RUN, a "
      "run\n"
      "directory or the name of an experiment below --train_dir, or the path of a checkpoint in a run "
      "directory.\n"
      "The first named run decides what is played: its settings are taken from its config.toml.\n"
      "A run that was trained on one map plays that map, one of a curriculum the scenario's own; one that\n"
      "was trained on a pool plays 20 maps that no training pool holds, all in turn (--maps and\n"
      "--layout_pool say otherwise). Other runs must have been trained for the same scenario, team size\n"
      "and observation.\n"
      "J_share is J divided by the best score that each episode's map allows so many agents; J_normalised is "
      "0 for\n"
      "random play and 1 for the scripted team, on the default map and team or where both play in this "
      "command.\n"
      "Episodes are keyed by --seed and their number alone, and all players meet the same ones. The same "
      "command\n"
      "plays them again to the bit on the same machine. Where no network plays, also with other numbers of "
      "workers\n"
      "and environments; a network's sums round otherwise in a batch of another size, so that an action may "
      "change.");
  line.add_option("policy", request.policies, "PLAYERS",
                  "players; may be given several times or separated by commas: one after the other");
  line.add_option("seat", request.seats, "AGENT=PLAYER",
                  "the player of one agent, counted from 0; --policy plays those that are not named. A run "
                  "with a network "
                  "for each agent plays agent i with network i");
  line.add_option(
      "cross_play", request.cross_play, "PLAYERS",
      "each player with each: a matrix of J, the row's player at seat 0, the column's at all others; "
      "means of self-play and cross-play, and the gap between them");
  line.add_option("episodes", request.episodes, "N", "episodes of each team (default 100, of a video 1)");
  line.add_option(
      "checkpoint", request.checkpoint, "FILE",
      "the checkpoint to play, for example a milestone (default: as --load_checkpoint_kind selects)");
  line.add_option("maps", request.maps, "WORD",
                  "train (those that the run trains on) or held_out (20 that no training pool holds)");
  line.add_option(
      "save_video", request.videos.video, "FILE",
      "record the episodes: .mp4, .mkv or .gif (8.75 pictures a second), all agents side by side, with "
      "actions and score");
  line.add_option("frames", request.videos.frames, "DIR", "the same as one PNG a decision, in a new folder");
  line.add_option("size", request.videos.size, "WxH",
                  "of one agent's view in videos (default 640x360); the network still sees 128x72");
  line.add_option("seconds", request.videos.seconds, "S",
                  "end videos after S seconds; the episodes are played to their end for the score");
  line.add_option(
      "positions_file", request.positions, "FILE",
      "write where each agent was after every decision, and the map's lines: JSON lines (.jsonl), "
      "for the occupancy maps of comrad report");
  line.add_option("episodes_file", request.episodes_file, "FILE",
                  "write a row an episode, with hashes of maps, settings and checkpoints: .csv or .jsonl");
  line.add_option("episodes_dir", request.episodes_dir, "DIR",
                  "write each episode's map and actions into a new folder, to be played again in Python "
                  "(comrad.load_episode)");
  line.add_option("recorded", request.recorded, "DIR",
                  "play nothing: score the episodes of this folder (--episodes_dir, comrad play --save)");
  line.add_option("page", request.page, "SOCKET",
                  "show what is played at this socket, one environment, until it is closed (comrad watch and "
                  "comrad play start this)");
  line.add_option("page_size", request.page_size, "WxH", "of one agent's view there (default 640x360)");
  line.add_option("page_rate", request.pictures_per_s, "N", "views a second there at most (default 17.5)");
  line.add_switch("greedy", request.greedy, "networks take the most likely action (default True)");
  line.add_switch("stochastic", request.stochastic, "draw actions from the policy, as training does");
  line.add_switch("each", request.each, "report every episode as well (--json always does)");
  line.add_switch("background", request.background, "leave the cores to whatever else runs");
  line.add_switch("json", request.json, "print one JSON object on stdout and nothing else");
  line.add_switch("csv", request.csv,
                  "print a header and a row a policy (a row a cell of --cross_play) instead");
  line.add_settings(SettingsListed::kUsedByEval);
  return run_command("eval", line, arguments, [&] { return evaluate(request, line); });
}

}  // namespace comrad::deploy
