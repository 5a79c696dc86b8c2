#include "deploy/launch/run_report.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "deploy/launch/progress.h"
#include "rollout_buffer/core/score_text.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::deploy {
namespace {

constexpr double kSilentS = 3;  // of a learner's host, which speaks twice a second

/// "512 env frames/s, 128 decisions/s".
std::string rates_text(double decisions_per_s, int64_t frame_skip) {
  char text[96];
  std::snprintf(text, sizeof text, "%.0f env frames/s, %.0f decisions/s",
                decisions_per_s * static_cast<double>(frame_skip), decisions_per_s);
  return text;
}

}  // namespace

std::string RunReport::evaluation_line() const {
  std::string text;
  if (plan_.episodes > 0) {
    text = fmt::format("episodes {}/{}", meter_.episodes().size(), plan_.episodes);
    if (!meter_.episodes().empty()) text += " | J " + score_text(meter_.episode_score_mean());
    text += " | " + video_text();
  }
  if (plan_.feeds()) {
    const std::optional<link::Feed> feed = link::read_feed(plan_.run_dir);
    text = !feed || !feed->is_fed ? "waits for the learner's host to give it a place | "
           : feed->silent_s > kSilentS
               ? "hears nothing of the learner's host for " + duration_text(feed->silent_s) + " | "
               : count_text(static_cast<double>(feed->account.delivered)) + " decisions delivered | ";
  }
  const double elapsed_s = std::max(clock_.now_s() - meter_.running_since_s(), 1e-3);
  return text + rates_text(static_cast<double>(meter_.played_decisions()) / elapsed_s,
                           plan_.config.environment.env_frameskip);
}

/// "video 700/700 tics | "; empty where nothing is recorded.
std::string RunReport::video_text() const {
  if (!plan_.recording.is_wanted()) return "";
  const auto limit = std::llround(kTicRateHz * plan_.recording.seconds);
  const int64_t played_tics = static_cast<int64_t>(meter_.played_decisions()) *
                              plan_.config.environment.env_frameskip / std::max(1, plan_.env.num_agents);
  if (limit == 0) return "video " + whole_text(played_tics) + " tics | ";
  return "video " + whole_text(std::min<int64_t>(played_tics, limit)) + "/" + whole_text(limit) + " tics | ";
}

std::string RunReport::progress_line() const {
  if (!plan_.trains()) return evaluation_line();
  const TrainStats& stats = meter_.last_stats();
  if (stats.learner_version == 0 && stats.env_frames == 0)
    return "collecting the first batch: " + count_text(static_cast<double>(meter_.played_decisions())) +
           " decisions played";
  TrainingProgress progress;
  progress.env_frames = static_cast<double>(meter_.env_frames());
  progress.env_frames_lost = static_cast<double>(meter_.env_frames_lost());
  progress.env_frames_total = plan_.seconds > 0 ? 0 : plan_.config.run.train_for_env_frames;
  progress.env_frames_per_s = stats.env_frames_per_s;
  progress.decisions_per_s = stats.decisions_per_s;
  if (stats.episodes > 0) {
    progress.score_mean = stats.score_mean;
    progress.return_mean = stats.return_mean;
  } else {
    progress.decision_limit = plan_.decision_limit;
  }
  progress.evaluated = evaluator_.last_text();
  progress.lag_mean = stats.policy_lag_mean;
  progress.lag_max = stats.policy_lag_max;
  progress.replay_filled = meter_.replay_filled();
  progress.hosts = hosts_text();
  progress.silence = workers_.silence_text();
  if (workers_.stands_still()) progress.env_frames_per_s = progress.decisions_per_s = 0;
  return training_line(progress);
}

/// "2 hosts", "no host"; empty where none may join.
std::string RunReport::hosts_text() const {
  if (!plan_.serves()) return "";
  const std::vector<link::PeerRecord> peers = link::all_peers(plan_.run_dir);
  const auto here = std::ranges::count_if(peers, &link::PeerRecord::is_here);
  return here == 1 ? "1 host feeds" : fmt::format("{} hosts feed", here);
}

RunStatus RunReport::status(const std::string& state, const std::string& message) const {
  const TrainStats& stats = meter_.last_stats();
  RunStatus status;
  status.state = state;
  status.learner_version = stats.learner_version;
  status.message = message;
  status.elapsed_s = clock_.now_s() - began_s_;
  for (const Role role : {Role::kSim, Role::kPolicy, Role::kLearner, Role::kTrajectoryReceiver,
                          Role::kFrameReceiver, Role::kTrajectorySender})
    if (workers_.has(role) || role <= Role::kLearner)
      status.cpu_s.emplace_back(name_of(role), workers_.cpu_seconds(role));
  status.cpu_s.emplace_back("supervisor", process_cpu_s() - cpu_began_s_);
  if (plan_.drains()) status.accounts = meter_.accounts();
  if (plan_.serves()) status.peers = link::all_peers(plan_.run_dir);
  if (plan_.sends_frames)
    if (const std::optional<link::Feed> feed = link::read_feed(plan_.run_dir)) status.frames = feed->frames;
  if (plan_.trains()) {
    status.env_frames = meter_.env_frames();
    status.decisions = meter_.decisions_of_run();
    if (stats.episodes > 0) status.score_mean = stats.score_mean;
    status.env_frames_per_s = workers_.stands_still() ? 0 : stats.env_frames_per_s;
  } else {
    status.decisions = meter_.played_decisions();
    status.env_frames = status.decisions * static_cast<uint64_t>(plan_.config.environment.env_frameskip);
    status.score_mean = meter_.episode_score_mean();
    const double elapsed_s = clock_.now_s() - meter_.running_since_s();
    if (meter_.running_since_s() > 0 && elapsed_s > 0)
      status.env_frames_per_s = static_cast<double>(status.env_frames) / elapsed_s;
  }
  return status;
}

std::string RunReport::summary(const std::string& how_it_ended, double worked_s) const {
  const double decisions = static_cast<double>(meter_.decisions());
  // What the run has learned from, and, where earlier runs or a learner that went back make a difference, what this
  // process trained on.
  const std::string worked =
      count_text(decisions * static_cast<double>(plan_.config.environment.env_frameskip));
  const std::string learned = plan_.trains() ? count_text(static_cast<double>(meter_.env_frames())) : worked;
  std::string text =
      how_it_ended + ": " + learned + " env frames" +
      (worked == learned ? "" : ", " + worked + " trained on") + " in " + duration_text(worked_s) + ", " +
      rates_text(worked_s > 0 ? decisions / worked_s : 0, plan_.config.environment.env_frameskip);
  const TrainStats& stats = meter_.last_stats();
  if (plan_.trains() && stats.episodes > 0 && std::isfinite(stats.score_mean))
    text += ", J " + score_text(stats.score_mean);
  if (plan_.trains() && stats.learner_version == 0) text += "; no update was made, so nothing was learned";
  if (const std::string lost = meter_.going_back_text(); !lost.empty()) text += "; " + lost;
  if (stats.last_checkpoint[0] != 0) text += std::string("; checkpoint ") + stats.last_checkpoint;
  return text;
}

}  // namespace comrad::deploy
