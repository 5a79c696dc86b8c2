#include "learner/worker/learner.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <limits>
#include <utility>

#include "learner/algorithms/q_learning.h"
#include "learner/checkpoint/architecture.h"
#include "learner/worker/rank_round.h"
#include "learner/worker/seat_server.h"
#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/applies_when.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::learn {
namespace {

constexpr double kPollIntervalS = 0.05;
constexpr double kEndIsKnownWithinS = 0.5;
/// Where policy workers are threads, weights in the arena are for other hosts alone: a copy at most every so many seconds.
constexpr double kWeightsOfHostsS = 0.5;
/// A stop lets the optimizer step in hand end; one that takes longer (LearnerOptions) is given up, so that the process is
/// gone in 10 s. Lock step can only save at a boundary; where the last one is not kept, it gets more time to reach the next.
constexpr double kAbandonRolloutAfterS = 7.5;

}  // namespace

Learner::Learner(const LearnerOptions& options, const RunConfig& config, shm::Arena arena,
                 const std::atomic<bool>& stop)
    : options_(options),
      config_(config),
      lock_step_(config.collection.deterministic || !config.collection.async_rl),
      has_policy_threads_(!config.collection.policy_processes && !options.serve),
      ranks_(options.ranks != nullptr ? *options.ranks : alone_),
      arena_(std::move(arena)),
      stop_(stop, arena_),
      reporter_(config_, totals_, arena_),
      checkpoints_(config_, options_.run_dir, totals_, reporter_.episodes()) {}

Expected<std::unique_ptr<Learner>> Learner::start(const LearnerOptions& options, const RunConfig& config,
                                                  shm::Arena arena, const std::atomic<bool>& stop) {
  std::unique_ptr<Learner> learner(new Learner(options, config, std::move(arena), stop));
  COMRAD_TRY(learner->open());
  return learner;
}

Status Learner::open() {
  shm::WorkerCounters& counters = arena_.learner_counters();
  counters.begin_life();
  COMRAD_TRY(check_arena());
  COMRAD_TRY(make_network());
  map_frames();
  if (!options_.serve) {
    COMRAD_TRY_ASSIGN(layouts_, LayoutService::open(config_, options_.run_dir));
    COMRAD_TRY_ASSIGN(source_,
                      make_batch_source({.config = config_,
                                         .arena = arena_,
                                         .stop = stop_,
                                         .poll = [this] { poll(); },
                                         .run_dir = options_.run_dir,
                                         .is_off_policy = algorithm_->off_policy() != nullptr,
                                         .device = device_,
                                         .ranks = ranks_,
                                         .frames = algorithm_->on_policy() ? frames_.get() : nullptr}));
  }
  COMRAD_TRY(resume());
  COMRAD_TRY(expect_same_weights(ranks_, *algorithm_));
  if (!options_.serve) COMRAD_TRY(prepare_training());
  shm::ControlBlock& control = arena_.control();
  control.learner_decisions_before = totals_.decisions;
  count(0);
  control.goal_reached = 0;
  failed_before_ = control.checkpoints_failed.load();
  control.saved_env_frames = totals_.env_frames;
  offer_weights();
  weights_->finish();
  // Last of all: simulators read journals once this is above 0.
  control.rollouts_allowed = source_ ? source_->rollouts_allowed() : kUnlimited;
  shm::ring(control.slab_released);
  if (has_policy_threads_)
    policies_ = std::make_unique<policy::PolicyThreads>(config_, arena_, local_weights_, frames_.get());
  counters.state = shm::WorkerState::kRunning;
  spdlog::info("learner: {} with {} parameters, version {}, {} env frames so far", config_.run.algo.name(),
               algorithm_->parameter_count(), algorithm_->version(), totals_.env_frames);
  if (!options_.serve) reporter_.judge_settings();
  return {};
}

Status Learner::make_network() {
  if (options_.ranks != nullptr) {
    device_ = ranks_.device();
  } else {
    COMRAD_TRY_ASSIGN(device_, policy::choose_device(config_.collection.device));
  }
  COMRAD_TRY(policy::check_encoder(config_.network.encoder, arena_.shape().trajectory.env));
  COMRAD_TRY_ASSIGN(architecture_, architecture_of(config_));
  COMRAD_TRY_ASSIGN(algorithm_, make_algorithm(config_, arena_.shape().trajectory.env, device_));
  weights_ = std::make_unique<WeightsPublisher>(
      *algorithm_,
      [this](std::span<const std::byte> weights, PolicyVersion version) { publish(weights, version); },
      has_policy_threads_ ? kWeightsOfHostsS : 0);
  if (!ranks_.is_alone()) COMRAD_TRY(algorithm_->learn_with(ranks_));
  ranks_.set_watch([this] { return check_others(); });
  spdlog::info("learner: trains on {}{}", device_.str(),
               ranks_.is_alone() ? "" : fmt::format(", the first of {}", ranks_.count()));
  if (const int64_t bytes = algorithm_->weights_bytes(); bytes > arena_.shape().weights_bytes)
    return Error{ErrorCode::kBadInput, fmt::format("the network has {} bytes of weights, the arena holds {}; "
                                                   "learner and supervisor must read the same config.toml",
                                                   bytes, arena_.shape().weights_bytes)};
  return {};
}

void Learner::map_frames() {
  if (!has_policy_threads_ || device::has_own_kernels(device_)) return;
  const bool keeps_frames = algorithm_->on_policy() != nullptr;
  auto frames = policy::SlabFrames::create(arena_, device_, keeps_frames);
  if (!frames) {
    spdlog::warn("learner: frames are copied on the host and go up twice: {}", frames.error().message);
    return;
  }
  frames_ = std::move(*frames);
  spdlog::info("learner: {} reads frames from shared memory{}", device_.str(),
               keeps_frames ? fmt::format(" and keeps {} of them",
                                          bytes_text(policy::SlabFrames::bytes_of(arena_.shape())))
                            : "");
}

Status Learner::check_arena() const {
  const TrajectoryShape& shape = arena_.shape().trajectory;
  const int64_t state_count = policy::NetworkOptions::from(config_, shape.env).recurrent_state_count();
  if (shape.rollout_steps != config_.collection.rollout || shape.recurrent_state_count != state_count)
    return Error{ErrorCode::kBadInput, fmt::format("the arena was made for rollout {} and {} floats of "
                                                   "recurrent state, config.toml states {} and {}",
                                                   shape.rollout_steps, shape.recurrent_state_count,
                                                   config_.collection.rollout, state_count)};
  const int64_t needed = lock_step_ ? arena_.shape().env_count() : slabs_per_batch(config_, shape.env);
  if (!options_.serve && arena_.shape().slab_count < needed)
    return Error{ErrorCode::kBadInput, fmt::format("the arena has {} trajectory slabs, a batch needs {}; "
                                                   "raise --trajectory_slabs or lower --batch_size",
                                                   arena_.shape().slab_count, needed)};
  return {};
}

Status Learner::resume() {
  if (options_.serve && !options_.checkpoint.empty()) return load(options_.checkpoint, /*is_own=*/true);
  COMRAD_TRY_ASSIGN(const std::optional<CheckpointKeeper::Found> found, checkpoints_.find(options_.serve));
  if (found) {
    COMRAD_TRY(load(*found, /*is_own=*/true));
    spdlog::info("resumed from {}", found->path);
    return tell_checkpoint(ranks_, {.path = found->path, .is_own = true});
  }
  if (options_.serve)
    return Error{ErrorCode::kNotFound,
                 "no checkpoint in " + checkpoints_.folder() + "; name one with --checkpoint"};
  if (!options_.checkpoint.empty()) COMRAD_TRY(load(options_.checkpoint, /*is_own=*/false));
  return tell_checkpoint(ranks_, {.path = options_.checkpoint, .is_own = false});
}

Status Learner::load(const std::string& path, bool is_own) {
  COMRAD_TRY_ASSIGN(StateDict state, read_checkpoint(path));
  return load(CheckpointKeeper::Found{.path = path, .state = std::move(state)}, is_own);
}

Status Learner::load(const CheckpointKeeper::Found& found, bool is_own) {
  const StateDict& state = found.state;
  const auto of_file = [&](const Status& status) {
    return status ? status : Error{status.error().code, found.path + ": " + status.error().message};
  };
  if (options_.serve) COMRAD_TRY(check_trained_for(state, found.path, config_));
  if (is_own && layouts_) COMRAD_TRY(of_file(layouts_->load(state)));
  COMRAD_TRY(of_file(algorithm_->load(state)));
  COMRAD_TRY_ASSIGN(const int64_t env_frames, state.integer("counters/env_frames"));
  COMRAD_TRY_ASSIGN(const int64_t decisions, state.integer("counters/decisions"));
  COMRAD_TRY_ASSIGN(totals_.seconds_before, state.number("counters/train_seconds"));
  totals_.env_frames = static_cast<uint64_t>(env_frames);
  totals_.decisions = static_cast<uint64_t>(decisions);
  if (source_) COMRAD_TRY(source_->load(state, found.path, is_own));
  COMRAD_TRY(checkpoints_.resumed_from(found, algorithm_->version(), is_own));
  reporter_.saved(found.path);
  return {};
}

Status Learner::prepare_training() {
  COMRAD_TRY(reporter_.open(options_.run_dir, *algorithm_, *source_, layouts_.get()));
  CheckpointContents contents;
  contents.state = [this] { return state(); };
  contents.was_saved = [this] { note_saved(); };
  if (ReplayFeed* feed = source_->feed())
    contents.save_replay = [feed](StateDict& state, const std::string& folder, const std::string& file) {
      return feed->save(state, folder, file);
    };
  checkpoints_.write(std::move(contents));
  if (lock_step_ && arena_.control().rollouts_allowed.load() != 0)
    return Error{
        ErrorCode::kUnsupported,
        "a learner cannot join a lock-step run half way (its simulators have gone on); stop the run and "
        "resume it from its last checkpoint"};
  arena_.reclaim_learner();
  COMRAD_TRY(source_->start());
  if (layouts_ && source_->resumes_exactly()) COMRAD_TRY(layouts_->restore_mailboxes(arena_));
  if (layouts_) layouts_->serve(arena_);
  return {};
}

Status Learner::run() {
  Status result = options_.serve ? serve() : train();
  weights_->finish();
  const bool has_failed = !result;
  if (source_) {
    source_->stop();
    if (!has_failed && is_finished()) arena_.control().goal_reached = 1;
    const PolicyVersion version = gave_up_ ? boundary_->version : algorithm_->version();
    if (!has_failed && !checkpoints_.is_settled(version))
      if (const Status saved = checkpoints_.save(version); !saved)
        result = Error{ErrorCode::kNotSaved, saved.error().message};
    reporter_.report_now();
  }
  arena_.learner_counters().state = shm::WorkerState::kStopped;
  return result;
}

Status Learner::train() {
  while (!stop_.requested() && !is_finished()) {
    if (!wait_while_paused()) break;
    COMRAD_TRY_ASSIGN(const bool has_drained, source_->drain());  // sealed slabs -> batches or the replay
    poll();
    if (const Status live = check_others(); !live) {
      if (stop_.requested()) break;
      return live;
    }
    while (std::optional<Sample> sample = source_->sample(algorithm_->version())) {
      take_in(sample->inserted);
      if (!sample->has_batch()) continue;
      COMRAD_TRY_ASSIGN(const UpdateStats stats, update(*sample));  // publishes after every optimizer step
      if (stats.abandoned && lock_step_) {
        give_up_rollout();
        return {};
      }
      source_->finish(std::move(*sample));
    }
    if (ranks_.failure()) {
      COMRAD_TRY(left_by_others(*ranks_.failure(), {}));
      if (lock_step_) give_up_rollout();
      return {};
    }
    if (lock_step_ && has_drained) close_rollout();  // publishes here alone
    save_if_due();
    if (lock_step_ && has_drained) source_->open_rollout(!is_finished());
  }
  return {};
}

Status Learner::serve() {
  spdlog::info("serving {} at version {}", checkpoints_.last_path(), algorithm_->version());
  while (!stop_.requested()) {
    shm::Doorbell& changed = arena_.control().run_state_changed;
    const uint32_t heard = shm::listen(changed);
    poll();
    if (!stop_.requested()) shm::wait(changed, heard, 100'000);
  }
  return {};
}

/// Counts and observes what came into the replay.
void Learner::take_in(const Inserted& inserted) {
  if (inserted.transitions == 0) return;
  reporter_.heard_lag(inserted.lag);
  algorithm_->off_policy()->observe(inserted.frame, inserted.measurement, inserted.global_state);
  count(inserted.transitions);
  source_->feed()->set_env_frames(static_cast<double>(totals_.env_frames));
}

Expected<UpdateStats> Learner::update(Sample& sample) {
  const int64_t began_ns = monotonic_ns();
  const Expected<int64_t> transitions = begin_round(
      ranks_, sample.rollout_batch ? sample.rollout_batch->transitions : 0, algorithm_->version());
  if (!transitions) return left_by_others(transitions.error(), {});
  const UpdateContext context = update_context();
  const auto updated = [&]() -> Expected<UpdateStats> {
    const ProcessStage stage(Stage::kForwardBackward, {Stage::kCollate, Stage::kOptimizer, Stage::kPublish,
                                                       Stage::kGather, Stage::kForward, Stage::kScatter});
    return update_on(sample, *algorithm_, context);
  };
  COMRAD_TRY_ASSIGN(UpdateStats stats, updated());
  // Others are still in the midst of the step: later replies belong to earlier requests.
  if (stats.abandoned) ranks_.leave({ErrorCode::kTimeout, "the run stops within an optimizer step"});
  if (ranks_.failure()) {
    COMRAD_TRY_ASSIGN(stats, left_by_others(*ranks_.failure(), stats));
  }
  reporter_.updated(stats);
  if (sample.rollout_batch) {
    reporter_.heard_lag(stats.lag);
    if (layouts_ && !stats.abandoned) layouts_->score(*sample.rollout_batch, ranks_);
    if (stats.abandoned && stats.optimizer_steps == 0) return stats;  // nothing was learned from it
  }
  count(*transitions);
  arena_.learner_counters().busy_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - began_ns));
  poll();
  return stats;
}

/// The step in hand was not taken. Where the run stops, others may go first; else this learner ends, too.
Expected<UpdateStats> Learner::left_by_others(const Error& why, UpdateStats stats) {
  if (stop_.requested()) {
    stats.abandoned = true;
    return stats;
  }
  // The system reports how a learner ended, a moment after its connections closed.
  for (const double until_s = monotonic_s() + kEndIsKnownWithinS;
       options_.check_others && monotonic_s() < until_s;) {
    COMRAD_TRY(options_.check_others());
    usleep(5000);
  }
  return why;
}

/// Asked while an exchange with the others waits, too.
Status Learner::check_others() {
  if (policies_) COMRAD_TRY(policies_->check());
  if (ranks_.is_alone()) return {};
  poll();
  if (options_.check_others) COMRAD_TRY(options_.check_others());
  if (stop_.requested() && stop_.seconds_since() > options_.abandon_step_after_s)
    return Error{ErrorCode::kTimeout, "the run stops, and other learners are still at work"};
  return {};
}

UpdateContext Learner::update_context() {
  UpdateContext context;
  context.reports = !ranks_.is_alone() || reporter_.wants_values();  // a report is made by all
  context.env_frames = static_cast<double>(totals_.env_frames);
  // Fresh weights after every optimizer step keep the lag low; lock step publishes at the boundary only.
  if (!lock_step_) context.after_step = [this] { offer_weights(); };
  context.begin_step = [this] { return lock_step_ || !stop_.requested(); };
  context.keep_going = [this] {
    poll();
    return !stop_.requested() ||
           stop_.seconds_since() <
               (lock_step_ && !boundary_ ? kAbandonRolloutAfterS : options_.abandon_step_after_s);
  };
  return context;
}

/// To policy workers, here and on other hosts.
void Learner::offer_weights() {
  arena_.control().policy_version = algorithm_->version();
  if (has_policy_threads_) {
    StageClock stage;
    stage.begin();
    local_weights_.publish(algorithm_->weight_tensors(), algorithm_->version());
    stage.end(Stage::kPublish);
  }
  if (!has_policy_threads_ || with::join_endpoint.holds(config_)) weights_->offer();
}

/// In the arena, for processes.
void Learner::publish(std::span<const std::byte> weights, PolicyVersion version) {
  arena_.weights().publish(weights, version);
  count_copied(2 * weights.size());  // out of the network and into the arena
}

/// Lock step: the rollout in hand is trained on.
void Learner::close_rollout() {
  offer_weights();
  weights_->finish();
  source_->close_rollout();
  if (layouts_) layouts_->serve(arena_), layouts_->capture_mailboxes(arena_, source_->resumes_exactly());
  // A replay has gone on by the time it would be saved; without one a boundary is some megabytes.
  if (source_->feed() == nullptr)
    boundary_ = Boundary{.state = state(),
                         .version = algorithm_->version(),
                         .env_frames = totals_.env_frames,
                         .decisions = totals_.decisions};
}

/// Weights of half a rollout belong to no boundary: the last one is saved, or the checkpoint before stays the newest.
void Learner::give_up_rollout() {
  source_->open_rollout(/*goes_on=*/false);
  if (boundary_) {
    gave_up_ = true;
    totals_.env_frames = boundary_->env_frames;
    totals_.decisions = boundary_->decisions;
    count(0);
    spdlog::info("stopped within a rollout; the one before is the last");
    return;
  }
  const std::string& last = checkpoints_.last_path();
  spdlog::warn("stopped within a rollout; the run resumes from {}", last.empty() ? "its beginning" : last);
  checkpoints_.settle(algorithm_->version());
}

/// Waiting does not count as training time.
bool Learner::wait_while_paused() {
  for (double seen_s = monotonic_s(); arena_.control().run_state.load() == shm::RunState::kPaused;) {
    const double now_s = monotonic_s();
    totals_.started_s += now_s - std::exchange(seen_s, now_s);
    if (stop_.requested()) return false;
    shm::Doorbell& changed = arena_.control().run_state_changed;
    const uint32_t heard = shm::listen(changed);
    shm::wait(changed, heard, 50'000);
    poll();
    save_if_due();  // the state is that of the last boundary
  }
  return true;
}

void Learner::count(int64_t transitions) {
  totals_.decisions += static_cast<uint64_t>(transitions);
  totals_.env_frames += static_cast<uint64_t>(transitions * config_.environment.env_frameskip);
  if (transitions > 0) reporter_.counted();
  shm::ControlBlock& control = arena_.control();
  control.learner_env_frames = totals_.env_frames;
  control.schedule_env_frames = totals_.env_frames;
  shm::WorkerCounters& counters = arena_.learner_counters();
  counters.decisions = totals_.decisions;
  counters.batches = algorithm_->version();
}

void Learner::poll() {
  weights_->deliver();
  const double now_s = monotonic_s();
  if (now_s - last_poll_s_ < kPollIntervalS) return;
  last_poll_s_ = now_s;
  reporter_.hear_episodes();
  // In lock step the mailboxes are served between two rollouts alone, when no simulator looks into them.
  if (layouts_ && !lock_step_) layouts_->serve(arena_);
  reporter_.report_if_due();
}

StateDict Learner::state() const {
  if (gave_up_) return boundary_->state;
  StateDict state;
  algorithm_->settle();
  algorithm_->save(state);
  state.put("counters/env_frames", static_cast<int64_t>(totals_.env_frames));
  state.put("counters/decisions", static_cast<int64_t>(totals_.decisions));
  state.put("counters/train_seconds", totals_.train_seconds());
  // Every random draw is a function of the seed and of counters above; there is no other generator state.
  state.put("rng/seed", config_.run.seed);
  state.put("config/toml", settings_to_toml(config_));
  state.put_all(architecture_);
  checkpoints_.append_to(state);
  source_->save(state);
  if (layouts_) layouts_->save(state);
  return state;
}

void Learner::save_if_due() {
  shm::ControlBlock& control = arena_.control();
  const uint32_t request = control.checkpoint_seq.load();
  checkpoints_.save_if_due(algorithm_->version(), request);
  control.checkpoints_failed = failed_before_ + checkpoints_.failures();
  if (control.checkpoint_done.load() == request) return;
  reporter_.publish_stats();  // with the file's name, before the answer
  control.checkpoint_done = request;
}

void Learner::note_saved() {
  reporter_.saved(checkpoints_.last_path());
  arena_.control().saved_env_frames = totals_.env_frames;
  if (layouts_)
    if (const Status written = layouts_->write_file(options_.run_dir); !written)
      spdlog::error("{}", written.error().message);
}

}  // namespace comrad::learn
