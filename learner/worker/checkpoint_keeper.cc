#include "learner/worker/checkpoint_keeper.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <utility>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/metrics/learner_messages.h"

namespace comrad::learn {
namespace {

constexpr double kBestImprovement = 1e-3;
constexpr double kLongSaveS = 1, kLongSaveShare = 0.1;  // of save_every_sec: the user hears of it
constexpr const char* kBestScoreKey = "counters/best_score";

/// The last episodes, f64 [n, EpisodeWindow::kFields]; n is stats_avg at most.
constexpr const char* kEpisodesKey = "episodes/window";

void warn(std::string text) { tell_user({UserMessage::Kind::kWarning, std::move(text)}); }

/// The replay that belongs to a checkpoint, beside it.
std::string replay_file_name(uint64_t version, uint64_t env_frames) {
  return fmt::format("replay_{}_{}.bin", version, env_frames);
}

}  // namespace

CheckpointKeeper::CheckpointKeeper(const RunConfig& config, const std::string& run_dir,
                                   const RunTotals& totals, EpisodeWindow& episodes)
    : config_(config),
      totals_(totals),
      episodes_(episodes),
      folder_(run_dir + "/checkpoint"),
      store_(folder_, config.run.keep_checkpoints),
      milestone_seconds_(config.run.save_milestones_sec),
      milestone_frames_(config.run.save_milestones_env_frames),
      evaluation_frames_(config.run.eval_every_env_frames),
      video_frames_(config.run.video_every_env_frames) {}

Expected<std::optional<CheckpointKeeper::Found>> CheckpointKeeper::find(bool is_reader) {
  std::vector<std::string> candidates;
  if (config_.run.load_checkpoint_kind == CheckpointKind::kBest && !store_.best().empty())
    candidates.push_back(store_.best());
  for (const CheckpointFile& file : store_.list()) candidates.push_back(file.path);
  for (const std::string& path : candidates) {
    Expected<StateDict> state = read_checkpoint(path);
    if (state) return std::optional<Found>({.path = path, .state = std::move(state).value()});
    if (state.error().code != ErrorCode::kBadFormat) return state.error();
    spdlog::warn("{}; trying the one before", state.error().message);
    if (!is_reader) store_.set_aside(path);
  }
  // Those that an earlier start set aside count, too: a second start must not train from nothing.
  const std::size_t damaged = store_.set_aside_count() + (is_reader ? candidates.size() : 0);
  if (damaged > 0)
    return Error{ErrorCode::kBadFormat,
                 fmt::format("none of the {} checkpoints in {} can be read (damaged ones end in .broken); "
                             "restore one, or begin anew with --restart_behavior restart",
                             damaged, folder_)};
  return std::optional<Found>();
}

Status CheckpointKeeper::resumed_from(const Found& found, PolicyVersion version, bool is_own) {
  last_path_ = found.path;
  settled_version_ = version;
  best_score_.reset();
  const double env_frames = static_cast<double>(totals_.env_frames);
  milestone_seconds_.start_from(totals_.train_seconds());
  milestone_frames_.start_from(env_frames);
  evaluation_frames_.start_from(env_frames);
  video_frames_.start_from(env_frames);
  if (!is_own) return {};
  if (found.state.has(kEpisodesKey)) return restore_episodes(found);
  // Before there was a window in checkpoints, the luckiest ten episodes made a best one.
  if (found.state.has(kBestScoreKey))
    spdlog::info(
        "{} does not say over how many episodes its best score was taken; the best is looked for anew",
        found.path);
  return {};
}

Status CheckpointKeeper::restore_episodes(const Found& found) {
  COMRAD_TRY_ASSIGN(const torch::Tensor saved, found.state.tensor(kEpisodesKey));
  if (saved.scalar_type() != torch::kFloat64)
    return Error{ErrorCode::kBadFormat,
                 found.path + ": " + kEpisodesKey + " has another type than this build writes"};
  const torch::Tensor dense = saved.contiguous();
  const Status restored =
      episodes_.restore({dense.data_ptr<double>(), static_cast<std::size_t>(dense.numel())},
                        dense.dim() == 2 ? static_cast<std::size_t>(dense.size(1)) : EpisodeWindow::kFields);
  if (!restored) return Error{restored.error().code, found.path + ": " + restored.error().message};
  // Where stats_avg was raised since, the best was that of a shorter window.
  if (found.state.has(kBestScoreKey) && episodes_.is_full()) {
    COMRAD_TRY_ASSIGN(best_score_, found.state.number(kBestScoreKey));
  }
  return {};
}

void CheckpointKeeper::append_to(StateDict& state) const {
  if (best_score_) state.put(kBestScoreKey, *best_score_);
  state.put(kEpisodesKey, torch::tensor(episodes_.state(), torch::kFloat64)
                              .view({static_cast<int64_t>(episodes_.size()),
                                     static_cast<int64_t>(EpisodeWindow::kFields)}));
}

Status CheckpointKeeper::save(PolicyVersion version) {
  const auto write_both = [&]() -> Expected<std::string> {
    StateDict state = contents_.state();
    if (contents_.save_replay && config_.replay.save_replay) {
      std::error_code error;
      std::filesystem::create_directories(folder_, error);
      COMRAD_TRY(contents_.save_replay(state, folder_, replay_file_name(version, totals_.env_frames)));
    }
    Expected<std::string> path = store_.save(state, version, totals_.env_frames);
    if (contents_.save_replay) prune_replays();
    return path;
  };
  const double began_s = monotonic_s();
  const Expected<std::string> path = write_both();
  last_save_s_ = monotonic_s();
  if (const double took_s = last_save_s_ - began_s;
      took_s > kLongSaveS && took_s > kLongSaveShare * config_.run.save_every_sec) {
    char text[200];
    std::snprintf(
        text, sizeof text,
        "writing a checkpoint took %.1f s, in which nothing was learned; is the disk slow? A longer "
        "--save_every_sec than %.0f requests fewer",
        took_s, config_.run.save_every_sec);
    warn(text);
  }
  if (!path) {
    ++failures_;
    // Shown to the user once in a run (deploy/launch/worker_table.cc); the log has every one.
    warn("no checkpoint was written: " + path.error().message + "; " +
         (last_path_.empty() ? "the run has none yet" : "the last good one stays: " + last_path_));
    return path.error();
  }
  settled_version_ = version;
  last_path_ = *path;
  spdlog::info("saved {}", *path);
  contents_.was_saved();
  return {};
}

void CheckpointKeeper::prune_replays() const {
  // Learners beside the first have files of theirs, with a number before the ending.
  std::vector<std::string> kept;
  for (const CheckpointFile& file : store_.list()) {
    const std::string name = replay_file_name(file.version, file.env_frames);
    kept.push_back(name.substr(0, name.rfind('.') + 1));
  }
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    const bool is_kept =
        std::ranges::any_of(kept, [&](const std::string& stem) { return name.starts_with(stem); });
    if (name.starts_with("replay_") && name.ends_with(".bin") && !is_kept)
      std::filesystem::remove(entry.path(), error);
  }
}

void CheckpointKeeper::save_beside(const std::string& file) {
  const Expected<std::string> path = store_.save_beside(contents_.state(), file);
  if (path)
    spdlog::info("saved {}", *path);
  else
    spdlog::error("{}: {}", file, path.error().message);
}

void CheckpointKeeper::save_to_evaluate(PolicyVersion version) {
  const RequestedEvaluation request = {
      .file = checkpoint_file_name("evaluate", version, totals_.env_frames),
      .version = version,
      .env_frames = totals_.env_frames,
      .train_seconds = static_cast<uint64_t>(std::llround(totals_.train_seconds()))};
  if (const Status requested = request_evaluation(folder_, request); !requested)
    return spdlog::error("{}: {}", request.file, requested.error().message);
  save_beside(request.file);
}

void CheckpointKeeper::save_if_due(PolicyVersion version, uint32_t request) {
  const double now_s = monotonic_s();
  const double env_frames = static_cast<double>(totals_.env_frames), seconds = totals_.train_seconds();
  // Before the periodic one: a run that continues from there has these already.
  const bool is_milestone = milestone_seconds_.pass(seconds);
  if (milestone_frames_.pass(env_frames) || is_milestone)
    save_beside(checkpoint_file_name("milestone", version, totals_.env_frames));
  const bool is_recorded = video_frames_.pass(env_frames);
  if (evaluation_frames_.pass(env_frames) || is_recorded) save_to_evaluate(version);
  if (last_save_s_ == 0) last_save_s_ = last_best_look_s_ = now_s;
  const bool is_wanted = std::exchange(request_done_, request) != request;
  if (is_wanted || (now_s - last_save_s_ >= config_.run.save_every_sec && !is_settled(version)))
    (void)save(version);  // it is in the log; the last one, at the end, decides about the exit code
  if (now_s - last_best_look_s_ >= config_.run.save_best_every_sec) {
    last_best_look_s_ = now_s;
    save_if_best();
  }
}

void CheckpointKeeper::save_if_best() {
  if (static_cast<double>(totals_.env_frames) < config_.run.save_best_after_env_frames) return;
  if (!episodes_.is_full()) {
    if (!best_score_ && !std::exchange(reported_no_best_, true))
      spdlog::info(
          "no best checkpoint before stats_avg {} episodes have ended ({} so far); a run that ends before "
          "leaves none, --stats_avg requests fewer",
          config_.run.stats_avg, episodes_.size());
    return;
  }
  const double score = episodes_.score_mean();
  if (!std::isfinite(score) || (best_score_ && score <= *best_score_ + kBestImprovement)) return;
  const std::optional<double> previous = std::exchange(best_score_, score);
  const Expected<std::string> path = store_.save_best(contents_.state(), score);
  if (path) {
    spdlog::info("saved {}", *path);
  } else {
    spdlog::error("best checkpoint: {}", path.error().message);
    best_score_ = previous;
  }
}

}  // namespace comrad::learn
