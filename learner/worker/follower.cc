#include "learner/worker/follower.h"

#include <unistd.h>

#include <optional>
#include <utility>

#include "learner/checkpoint/checkpoint.h"
#include "learner/worker/rank_round.h"
#include "rollout_buffer/core/log.h"

namespace comrad::learn {
namespace {

/// A stop of the run is the first learner's to carry out; one that never speaks again is not waited for.
constexpr double kGiveUpAfterS = 8;
constexpr useconds_t kNapUs = 1000;

}  // namespace

Follower::Follower(const RunConfig& config, shm::Arena arena, const std::atomic<bool>& stop, RankGroup& ranks)
    : config_(config),
      lock_step_(config.collection.deterministic || !config.collection.async_rl),
      arena_(std::move(arena)),
      stop_requested_(stop),
      stop_(stop, arena_),
      ranks_(ranks) {}

Expected<std::unique_ptr<Follower>> Follower::start(const std::string& run_dir, const RunConfig& config,
                                                    shm::Arena arena, const std::atomic<bool>& stop,
                                                    RankGroup& ranks) {
  std::unique_ptr<Follower> follower(new Follower(config, std::move(arena), stop, ranks));
  COMRAD_TRY(follower->open(run_dir));
  return follower;
}

Status Follower::open(const std::string& run_dir) {
  ranks_.set_watch([this] { return watch(); });
  COMRAD_TRY_ASSIGN(algorithm_, make_algorithm(config_, arena_.shape().trajectory.env, ranks_.device()));
  COMRAD_TRY(algorithm_->learn_with(ranks_));
  COMRAD_TRY_ASSIGN(layouts_, LayoutService::open(config_, run_dir));
  COMRAD_TRY_ASSIGN(source_, make_batch_source({.config = config_,
                                                .arena = arena_,
                                                .stop = stop_,
                                                .poll = [] {},
                                                .run_dir = run_dir,
                                                .is_off_policy = algorithm_->off_policy() != nullptr,
                                                .device = ranks_.device(),
                                                .ranks = ranks_}));
  COMRAD_TRY(begin());
  COMRAD_TRY(expect_same_weights(ranks_, *algorithm_));
  COMRAD_TRY(source_->start());
  spdlog::info("learner {} of {} trains on {}, from version {}", ranks_.rank(), ranks_.count(),
               ranks_.device().str(), algorithm_->version());
  return {};
}

Status Follower::begin() {
  COMRAD_TRY_ASSIGN(const BeginsFrom from, hear_checkpoint(ranks_));
  if (from.path.empty()) return {};
  COMRAD_TRY_ASSIGN(const StateDict state, read_checkpoint(from.path));
  COMRAD_TRY(algorithm_->load(state));
  COMRAD_TRY_ASSIGN(const int64_t env_frames, state.integer("counters/env_frames"));
  totals_.env_frames = static_cast<uint64_t>(env_frames);
  return source_->load(state, from.path, from.is_own);
}

Status Follower::run() {
  Status result;
  while (result && !stop_requested_.load()) {
    const Expected<bool> drained = source_->drain();
    result = drained ? ranks_.status() : Status(drained.error());
    if (!result) break;
    if (!*drained) {
      usleep(kNapUs);  // in lock step a stop of the run ends drain() at once
      continue;
    }
    while (std::optional<Sample> sample = source_->sample(algorithm_->version())) {
      take_in(sample->inserted);
      if (!sample->has_batch()) continue;
      result = update(*sample);
      if (!result) break;
      source_->finish(std::move(*sample));
    }
    if (result) result = ranks_.status();
    if (!result || !lock_step_) continue;
    source_->close_rollout();
    source_->open_rollout(/*goes_on=*/true);
  }
  source_->stop();
  // Where the run ends, others may have left in the midst of a round.
  return stop_.requested() ? Status() : result;
}

/// Observes its own part of what came into the replays, and counts all of it.
void Follower::take_in(const Inserted& inserted) {
  if (inserted.transitions == 0) return;
  algorithm_->off_policy()->observe(inserted.frame, inserted.measurement, inserted.global_state);
  count(inserted.transitions);
  source_->feed()->set_env_frames(static_cast<double>(totals_.env_frames));
}

Status Follower::update(Sample& sample) {
  COMRAD_TRY_ASSIGN(const int64_t transitions,
                    begin_round(ranks_, sample.rollout_batch ? sample.rollout_batch->transitions : 0,
                                algorithm_->version()));
  UpdateContext context;
  context.env_frames = static_cast<double>(totals_.env_frames);
  context.keep_going = [this] { return !stop_requested_.load(); };
  COMRAD_TRY_ASSIGN(const UpdateStats stats, update_on(sample, *algorithm_, context));
  COMRAD_TRY(ranks_.status());
  if (layouts_ && sample.rollout_batch && !stats.abandoned) layouts_->score(*sample.rollout_batch, ranks_);
  count(transitions);
  return {};
}

void Follower::count(int64_t transitions) {
  totals_.env_frames += static_cast<uint64_t>(transitions * config_.environment.env_frameskip);
}

/// While it waits for the others.
Status Follower::watch() {
  if (stop_requested_.load() || (stop_.requested() && stop_.seconds_since() > kGiveUpAfterS))
    return Error{ErrorCode::kTimeout, "the run stops"};
  return {};
}

}  // namespace comrad::learn
