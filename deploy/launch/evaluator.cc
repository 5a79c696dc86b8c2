#include "deploy/launch/evaluator.h"

#include <spdlog/fmt/fmt.h>

#include <signal.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "deploy/launch/progress.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/score_text.h"

namespace comrad::deploy {
namespace {

constexpr double kCheckpointLookIntervalS = 1.0;
constexpr double kEvaluationKillAfterS = 4.0;  // of a stop, so that the run is gone in 10 s
constexpr int64_t kMostEnvironments = 10;      // one small simulator

// What is seen of a policy in TensorBoard: some megabytes a video, so not whole episodes.
constexpr const char *kVideoSize = "320x180", *kVideoSeconds = "20";

std::string at_text(const Snapshot& snapshot) {
  return "at " + count_text(static_cast<double>(snapshot.env_frames)) + " env frames";
}

std::string name_of(const Snapshot& snapshot, bool is_video) {
  return (is_video ? "video " : "evaluation ") + at_text(snapshot);
}

}  // namespace

Expected<MetricValues> evaluation_metrics(const std::string& json) {
  const nlohmann::json result = nlohmann::json::parse(json, nullptr, /*allow_exceptions=*/false);
  MetricValues values;
  for (const auto& [name, key] : {std::pair{kScoreKey, "J_mean"},
                                  {"eval/J_ci95", "J_ci95"},
                                  {"eval/J_share", "J_share"},
                                  {"eval/return", "return_mean"},
                                  {"eval/length", "length_tics_mean"},
                                  {"eval/episodes", "episodes"}}) {
    if (!result.is_object() || !result.contains(key) || !(result[key].is_number() || result[key].is_null()))
      return Error{ErrorCode::kBadFormat, "comrad eval gave no number " + std::string(key)};
    if (result[key].is_number()) values.emplace_back(name, result[key].get<double>());
  }
  if (values.front().first != kScoreKey) return Error{ErrorCode::kBadFormat, "comrad eval gave no score"};
  std::vector<double> scores;
  if (result.contains("each") && result["each"].is_array())
    for (const auto& one : result["each"])
      if (one.is_object() && one.contains("J") && one["J"].is_number()) scores.push_back(one["J"]);
  if (!scores.empty()) {
    values.emplace_back("eval/J_min", *std::ranges::min_element(scores));
    values.emplace_back("eval/J_max", *std::ranges::max_element(scores));
  }
  return values;
}

Evaluator::Evaluator(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes,
                     EvaluationFolder& folder)
    : plan_(plan),
      clock_(clock),
      processes_(processes),
      folder_(folder),
      is_wanted_(plan.trains() && plan.seconds <= 0 && is_played_beside(plan.config.run)),
      scores_(plan.config.run.eval_every_env_frames),
      videos_(plan.config.run.video_every_env_frames) {
  if (!is_wanted_) return;
  folder_.clear_scratch();  // of a run that was killed
  for (const uint64_t env_frames : folder_.recorded()) scores_.add(env_frames);
  for (const uint64_t env_frames : folder_.recorded_videos()) videos_.add(env_frames);
}

Evaluator::~Evaluator() {
  if (!is_wanted_) return;
  current_.reset();
  folder_.clear_scratch();
}

std::vector<std::string> Evaluator::tick() {
  std::vector<std::string> words;
  if (!is_wanted_) return words;
  const double now_s = clock_.now_s();
  if (current_) {
    for (const std::string& line : current_->process->read_lines()) {
      current_->last_line = line;
      spdlog::info("{}: {}", name_of(current_->snapshot, current_->is_video), line);
    }
    if (kill_at_s_ > 0 && now_s >= kill_at_s_) current_->process->send_signal(SIGKILL);
    if (const std::optional<ExitStatus>& how = current_->process->poll_exit()) {
      std::string said = finish(*how);
      if (!said.empty()) words.push_back(std::move(said));
    }
  }
  if (is_stopped_) return words;
  if (now_s >= next_look_s_) {
    next_look_s_ = now_s + kCheckpointLookIntervalS;
    look(words);
  }
  if (current_ || waiting_.empty()) return words;
  const Snapshot next = waiting_.front();
  waiting_.erase(waiting_.begin());
  if (Status started = start(next); !started) {
    words.push_back("the evaluation " + at_text(next) + " could not be started (" + started.error().message +
                    "); the run continues without evaluations");
    is_stopped_ = true;
  }
  return words;
}

void Evaluator::look(std::vector<std::string>& words) {
  std::vector<Snapshot> found = folder_.snapshots();
  if (current_)
    std::erase_if(found, [this](const Snapshot& one) { return one.path == current_->snapshot.path; });
  std::ranges::sort(found, {}, &Snapshot::env_frames);
  EvaluationPoints scores = scores_, videos = videos_;
  const auto claim = [&](const Snapshot& snapshot) {
    const bool is_due = scores.is_due(snapshot.env_frames) || videos.is_due(snapshot.env_frames);
    scores.add(snapshot.env_frames), videos.add(snapshot.env_frames);
    return is_due;
  };
  if (current_) claim(current_->snapshot);
  waiting_.clear();
  for (Snapshot& snapshot : found) {
    // A learner that went back to an older checkpoint passes a point once more.
    if (claim(snapshot))
      waiting_.push_back(std::move(snapshot));
    else
      folder_.remove(snapshot);
  }
  while (waiting_.size() > kMostWaiting) {
    words.push_back(
        "the evaluation " + at_text(waiting_.front()) +
        " is left out: the ones before take longer than the run; raise --eval_every_env_frames (or "
        "--video_every_env_frames) or lower --eval_episodes");
    folder_.remove(waiting_.front());
    waiting_.erase(waiting_.begin());
  }
}

Status Evaluator::start(const Snapshot& snapshot) {
  const RunSettings& run = plan_.config.run;
  const bool is_video = !scores_.is_due(snapshot.env_frames);
  const int64_t episodes = is_video ? 1 : run.eval_episodes;
  COMRAD_TRY_ASSIGN(const Descriptor output, folder_.open_scratch());
  // Small, on the CPU and on no reserved core: it takes what the run leaves.
  ChildOptions options;
  options.program = plan_.program("comrad");
  options.arguments = {"eval",
                       "--policy",
                       plan_.run_dir,
                       "--checkpoint",
                       snapshot.path,
                       "--episodes",
                       std::to_string(episodes),
                       "--maps",
                       word_of(run.eval_maps),
                       "--background",
                       "--json",
                       "--num_workers",
                       "1",
                       "--num_envs_per_worker",
                       std::to_string(std::min(episodes, kMostEnvironments)),
                       "--policy_workers",
                       "1",
                       "--policy_threads",
                       "1",
                       "--device",
                       "cpu",
                       "--policy_device",
                       "cpu",
                       "--set_workers_cpu_affinity",
                       "False"};
  if (is_video)
    options.arguments.insert(options.arguments.end(), {"--save_video", folder_.video_path(), "--size",
                                                       kVideoSize, "--seconds", kVideoSeconds});
  // What a killed one leaves is found there.
  options.environment = {{"TMPDIR", folder_.scratch()}};
  options.output = output.get();
  COMRAD_TRY_ASSIGN(std::unique_ptr<Process> process, processes_.spawn(options));
  spdlog::info("{} begins (pid {})", name_of(snapshot, is_video), process->pid());
  current_.emplace(Playing{.snapshot = snapshot,
                           .is_video = is_video,
                           .process = std::move(process),
                           .began_s = clock_.now_s(),
                           .last_line = {}});
  return {};
}

/// Takes the result in. Returns what the user should read.
std::string Evaluator::finish(const ExitStatus& how) {
  for (const std::string& line : current_->process->read_lines()) current_->last_line = line;
  const Snapshot snapshot = current_->snapshot;
  const bool is_video = current_->is_video;
  Expected<std::string> said = Error{ErrorCode::kPeerLost, ""};
  if (how.signal == 0 && how.code == 0) {
    said = is_video ? record_video() : record();
  } else {
    const std::string& words = current_->last_line;
    said = Error{ErrorCode::kPeerLost, how.text() + (words.empty() ? "" : "; its last line: " + words)};
  }
  current_.reset();
  if (is_stopped_ && !said) return "";  // it was stopped; its checkpoint waits for the next start
  // One that could not be evaluated would fail the next time as well.
  (is_video ? videos_ : scores_).add(snapshot.env_frames);
  if (!said) videos_.add(snapshot.env_frames);
  if (!videos_.is_due(snapshot.env_frames)) folder_.remove(snapshot);
  next_look_s_ = 0;
  if (said) return *said;
  return "the " + name_of(snapshot, is_video) + " failed (" + said.error().message + "); the run continues";
}

Expected<std::string> Evaluator::record_video() {
  const Snapshot& snapshot = current_->snapshot;
  COMRAD_TRY_ASSIGN(const std::string kept, folder_.keep_video(snapshot));
  return "recorded a video " + at_text(snapshot) + ": " + kept;
}

Expected<std::string> Evaluator::record() {
  const Snapshot& snapshot = current_->snapshot;
  COMRAD_TRY_ASSIGN(MetricValues values, evaluation_metrics(folder_.result()));
  values.emplace_back("eval/version", static_cast<double>(snapshot.version));
  values.emplace_back("eval/seconds", clock_.now_s() - current_->began_s);
  const auto skip = static_cast<uint64_t>(std::max<int64_t>(1, plan_.config.environment.env_frameskip));
  COMRAD_TRY(folder_.record(snapshot, snapshot.env_frames / skip, values));
  const std::string score = score_text(values.front().second);
  last_text_ = "eval J " + score + " at " + count_text(static_cast<double>(snapshot.env_frames));
  const bool has_interval = values[1].first == std::string("eval/J_ci95");
  return fmt::format("evaluated {}: J {}{} over {} greedy episodes on {} maps", at_text(snapshot), score,
                     (has_interval ? " +- " + score_text(values[1].second) : ""),
                     plan_.config.run.eval_episodes,
                     (plan_.config.run.eval_maps == EvalMaps::kTrain ? "the run's" : "held-out"));
}

void Evaluator::stop(int signal) {
  if (!is_wanted_) return;
  is_stopped_ = true;
  if (!current_) return;
  current_->process->send_signal(signal);
  if (kill_at_s_ == 0) kill_at_s_ = clock_.now_s() + kEvaluationKillAfterS;
}

}  // namespace comrad::deploy
