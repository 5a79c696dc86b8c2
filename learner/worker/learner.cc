#include "learner/worker/learner.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "learner/algorithms/q_learning.h"
#include "policy_workers/policy/policy_net.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/futex.h"

namespace comrad::learn {
namespace {

constexpr double kStatsIntervalS = 1.0;
constexpr double kPollIntervalS = 0.05;
/// A stop lets the optimizer step in hand end; one that takes longer is given up, so that the process is gone
/// in 10 s.
constexpr double kAbandonStepAfterS = 4.0;
/// Lock step can only save at a boundary, so it gets more time to reach it.
constexpr double kAbandonRolloutAfterS = 7.5;
constexpr double kBestImprovement = 1e-3;
constexpr int kJournalTimeoutMs = 5000;
constexpr uint64_t kUnlimited = std::numeric_limits<uint64_t>::max();

/// The last episodes in a checkpoint, f64 [n, EpisodeWindow::kFields]; n is stats_avg at most.
constexpr const char* kEpisodesKey = "episodes/window";

/// The replay that belongs to a checkpoint, beside it.
std::string replay_file_name(uint64_t version, uint64_t env_frames) {
  return "replay_" + std::to_string(version) + "_" + std::to_string(env_frames) + ".bin";
}

std::string host_name() {
  char name[256] = {};
  return gethostname(name, sizeof(name) - 1) == 0 ? name : "localhost";
}

int64_t slabs_per_batch(const RunConfig& config, const EnvShape& env) {
  return std::max<int64_t>(
      1, config.batch_size * config.num_batches_per_epoch / (config.rollout * env.num_agents));
}

}  // namespace

Expected<torch::Device> choose_device(const std::string& name) {
  const bool has_cuda = at::hasCUDA();
  if (name == "cpu" || (name == "auto" && !has_cuda)) return torch::Device(torch::kCPU);
  if (!has_cuda)
    return Error{
        ErrorCode::kUnsupported,
        "device is \"" + name + "\", but this libtorch sees no CUDA device; use --device cpu or auto"};
  return torch::Device(name == "auto" ? "cuda" : name);
}

Learner::Learner(const LearnerOptions& options, const RunConfig& config, shm::Arena arena,
                 std::optional<dds::Bus> bus, const std::atomic<bool>& stop)
    : options_(options),
      config_(config),
      arena_(std::move(arena)),
      bus_(std::move(bus)),
      stop_(stop),
      store_(options.run_dir + "/checkpoint", config.keep_checkpoints),
      lock_step_(config.deterministic || !config.async_rl),
      episodes_(config.stats_avg),
      check_(config) {}

Expected<std::unique_ptr<Learner>> Learner::start(const LearnerOptions& options, const RunConfig& config,
                                                  shm::Arena arena, std::optional<dds::Bus> bus,
                                                  const std::atomic<bool>& stop) {
  std::unique_ptr<Learner> learner(new Learner(options, config, std::move(arena), std::move(bus), stop));
  learner->started_s_ = monotonic_s();
  shm::WorkerCounters& counters = learner->arena_.learner_counters();
  counters.begin_life();
  learner->set_state("starting");

  COMRAD_TRY(learner->check_arena());
  COMRAD_TRY_ASSIGN(const torch::Device device, choose_device(config.device));
  COMRAD_TRY_ASSIGN(learner->algorithm_,
                    make_algorithm(config, learner->arena_.shape().trajectory.env, device));
  learner->on_policy_ = dynamic_cast<OnPolicyAlgorithm*>(learner->algorithm_.get());
  learner->off_policy_ = dynamic_cast<OffPolicyAlgorithm*>(learner->algorithm_.get());
  const int64_t bytes = learner->algorithm_->weights_bytes();
  if (bytes > learner->arena_.shape().weights_bytes)
    return Error{ErrorCode::kBadInput, "the network has " + std::to_string(bytes) +
                                           " bytes of weights, the arena holds " +
                                           std::to_string(learner->arena_.shape().weights_bytes) +
                                           "; learner and supervisor must read the same config.toml"};
  if (!options.serve) {
    COMRAD_TRY_ASSIGN(learner->layouts_, LayoutService::open(config, options.run_dir));
    if (learner->off_policy_ != nullptr) {
      COMRAD_TRY_ASSIGN(learner->feed_,
                        ReplayFeed::create(config, learner->arena_.shape().trajectory, options.run_dir));
    }
  }
  COMRAD_TRY(learner->resume());

  shm::ControlBlock& control = learner->arena_.control();
  if (!options.serve) {
    COMRAD_TRY_ASSIGN(learner->metrics_, MetricsWriter::open(options.run_dir));
    if (learner->lock_step_ && control.rollouts_allowed.load() != 0)
      return Error{
          ErrorCode::kUnsupported,
          "a learner cannot join a lock-step run half way (its simulators have gone on); stop the run and "
          "resume it from its last checkpoint"};
    learner->arena_.reclaim_learner();
    if (learner->journals_) COMRAD_TRY(learner->journals_->restore(learner->arena_));
    if (learner->layouts_ && learner->journals_)
      COMRAD_TRY(learner->layouts_->restore_desks(learner->arena_));
    if (learner->layouts_) learner->layouts_->serve(learner->arena_);
  }
  learner->count(0);
  counters.decisions = learner->decisions_;
  counters.batches = learner->algorithm_->version();
  control.goal_reached = 0;
  control.saved_env_frames = learner->env_frames_;
  learner->publish();
  // Last of all: simulators read journals once this is above 0.
  control.rollouts_allowed = learner->lock_step_ && !options.serve ? learner->next_rollout_ + 1 : kUnlimited;
  shm::ring(control.slab_released);
  counters.state = shm::WorkerState::kRunning;
  learner->set_state("running");
  spdlog::info("learner: {} with {} parameters on {}, version {}, {} env frames so far", config.algo,
               learner->algorithm_->parameter_count(), device.str(), learner->algorithm_->version(),
               learner->env_frames_);
  if (!options.serve) learner->warn(learner->check_.judge_settings());
  return learner;
}

Status Learner::check_arena() const {
  const TrajectoryShape& shape = arena_.shape().trajectory;
  const int64_t state_count = policy::PolicyNetOptions::from(config_, shape.env).recurrent_state_count();
  if (shape.rollout_steps != config_.rollout || shape.recurrent_state_count != state_count)
    return Error{ErrorCode::kBadInput,
                 "the arena was made for rollout " + std::to_string(shape.rollout_steps) + " and " +
                     std::to_string(shape.recurrent_state_count) +
                     " floats of recurrent state, config.toml says " + std::to_string(config_.rollout) +
                     " and " + std::to_string(state_count)};
  const int64_t needed = lock_step_ ? arena_.shape().env_count() : slabs_per_batch(config_, shape.env);
  if (!options_.serve && arena_.shape().slab_count < needed)
    return Error{ErrorCode::kBadInput, "the arena has " + std::to_string(arena_.shape().slab_count) +
                                           " trajectory slabs, a batch needs " + std::to_string(needed) +
                                           "; raise --trajectory_slabs or lower --batch_size"};
  return {};
}

Status Learner::load(const std::string& path, bool is_own) {
  COMRAD_TRY_ASSIGN(const StateDict state, read_checkpoint(path));
  if (is_own && layouts_) {
    const Status restored = layouts_->load(state);
    if (!restored) return Error{restored.error().code, path + ": " + restored.error().message};
  }
  const Status loaded = algorithm_->load(state);
  if (!loaded) return Error{loaded.error().code, path + ": " + loaded.error().message};
  COMRAD_TRY_ASSIGN(const int64_t env_frames, state.integer("counters/env_frames"));
  COMRAD_TRY_ASSIGN(const int64_t decisions, state.integer("counters/decisions"));
  COMRAD_TRY_ASSIGN(train_seconds_before_, state.number("counters/train_seconds"));
  env_frames_ = static_cast<uint64_t>(env_frames);
  decisions_ = static_cast<uint64_t>(decisions);
  COMRAD_TRY(load_episodes(state, path, is_own));
  journals_.reset();
  next_rollout_ = 0;
  if (config_.deterministic && !options_.serve && JournalSnapshot::is_in(state)) {
    COMRAD_TRY_ASSIGN(journals_, JournalSnapshot::load(state));
    next_rollout_ = journals_->next_rollout;
  } else if (config_.deterministic && !options_.serve) {
    spdlog::warn("{} holds no journals; its environments begin anew, the run is not the uninterrupted one",
                 path);
  }
  if (feed_) COMRAD_TRY(feed_->load(state, options_.run_dir + "/checkpoint", is_own));
  saved_version_ = algorithm_->version();
  last_checkpoint_ = path;
  return {};
}

Status Learner::load_episodes(const StateDict& state, const std::string& path, bool is_own) {
  has_best_ = false;
  if (!is_own || !state.has(kEpisodesKey)) {
    // Before there was a window in checkpoints, the luckiest ten episodes made a best one.
    if (is_own && state.has("counters/best_score"))
      spdlog::info(
          "{} does not say over how many episodes its best score was taken; the best is looked for anew",
          path);
    return {};
  }
  COMRAD_TRY_ASSIGN(const Tensor saved, state.tensor(kEpisodesKey));
  if (saved.scalar_type() != torch::kFloat64)
    return Error{ErrorCode::kBadFormat,
                 path + ": " + kEpisodesKey + " has another type than this build writes"};
  const Tensor dense = saved.contiguous();
  const Status restored =
      episodes_.restore({dense.data_ptr<double>(), static_cast<std::size_t>(dense.numel())},
                        dense.dim() == 2 ? static_cast<std::size_t>(dense.size(1)) : EpisodeWindow::kFields);
  if (!restored) return Error{restored.error().code, path + ": " + restored.error().message};
  // Where stats_avg was raised since, the best was that of a shorter window.
  has_best_ = state.has("counters/best_score") && episodes_.is_full();
  if (has_best_) {
    COMRAD_TRY_ASSIGN(best_score_, state.number("counters/best_score"));
  }
  return {};
}

Status Learner::resume() {
  if (options_.serve && !options_.checkpoint.empty()) return load(options_.checkpoint);
  std::vector<std::string> candidates;
  if (config_.load_checkpoint_kind == "best" && !store_.best().empty()) candidates.push_back(store_.best());
  for (const CheckpointFile& file : store_.list()) candidates.push_back(file.path);
  for (const std::string& path : candidates) {
    const Expected<StateDict> readable = read_checkpoint(path);
    if (!readable && readable.error().code == ErrorCode::kBadFormat) {
      spdlog::warn("{}; trying the one before", readable.error().message);
      if (!options_.serve) store_.set_aside(path);
      continue;
    }
    COMRAD_TRY(load(path));
    spdlog::info("resumed from {}", path);
    return {};
  }
  // Those that an earlier start set aside count, too: a second start must not train from nothing.
  const std::size_t damaged = store_.set_aside_count() + (options_.serve ? candidates.size() : 0);
  if (damaged > 0)
    return Error{ErrorCode::kBadFormat,
                 "none of the " + std::to_string(damaged) + " checkpoints in " + options_.run_dir +
                     "/checkpoint can be read (damaged ones end in .broken); restore one, "
                     "or begin anew with --restart_behavior restart"};
  if (options_.serve)
    return Error{ErrorCode::kNotFound,
                 "no checkpoint in " + options_.run_dir + "/checkpoint; name one with --checkpoint"};
  if (!options_.checkpoint.empty()) return load(options_.checkpoint, /*is_own=*/false);
  return {};
}

Status Learner::run() {
  Status result = options_.serve           ? serve()
                  : lock_step_             ? run_lock_step()
                  : off_policy_ != nullptr ? run_replay()
                                           : run_asynchronous();
  queue_.reset();
  const bool diverged = !result;
  if (!diverged && !options_.serve && is_finished()) arena_.control().goal_reached = 1;
  set_state(diverged ? "failed" : "stopping");
  if (!options_.serve && !diverged && algorithm_->version() != saved_version_) {
    if (const Status saved = save_checkpoint(); !saved)
      result = Error{ErrorCode::kNotSaved, saved.error().message};
  }
  if (!options_.serve) {
    report_metrics();
    publish_stats();
  }
  arena_.learner_counters().state = shm::WorkerState::kStopped;
  return result;
}

Status Learner::serve() {
  spdlog::info("serving {} at version {}", last_checkpoint_, algorithm_->version());
  while (!stop_requested()) {
    shm::Doorbell& changed = arena_.control().run_state_changed;
    const uint32_t heard = shm::listen(changed);
    poll();
    if (!stop_requested()) shm::wait(changed, heard, 100'000);
  }
  return {};
}

Status Learner::run_asynchronous() {
  queue_ = std::make_unique<BatchQueue>(arena_, slabs_per_batch(config_, arena_.shape().trajectory.env),
                                        config_.num_batches_to_accumulate);
  while (!stop_requested() && !is_finished()) {
    if (!wait_while_paused()) break;
    const int64_t waited_from_ns = monotonic_ns();
    std::unique_ptr<Minibatch> batch = queue_->pop(50);
    arena_.learner_counters().wait_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - waited_from_ns));
    poll();
    broken_decisions_ = queue_->broken_decisions();
    if (batch == nullptr) {
      if (const std::string failure = queue_->failure(); !failure.empty())
        return Error{ErrorCode::kSystem, "collating batches failed: " + failure};
      COMRAD_TRY(save_if_due());
      continue;
    }
    COMRAD_TRY(train(*batch));
    queue_->recycle(std::move(batch));
    COMRAD_TRY(save_if_due());
  }
  return {};
}

Status Learner::run_replay() {
  feed_->start(arena_);
  while (!stop_requested() && !is_finished()) {
    if (!wait_while_paused()) break;
    const int64_t waited_from_ns = monotonic_ns();
    std::unique_ptr<ReplayBatch> batch = feed_->pop(50);
    arena_.learner_counters().wait_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - waited_from_ns));
    poll();
    take_inserted();
    if (const std::string failure = feed_->failure(); !failure.empty())
      return Error{ErrorCode::kSystem, "replay: " + failure};
    if (batch != nullptr) {
      COMRAD_TRY(train(*batch));
      feed_->finish(std::move(batch));
    }
    COMRAD_TRY(save_if_due());
  }
  return {};
}

Expected<std::vector<uint32_t>> Learner::collect_rollout(uint64_t rollout) {
  const int env_count = arena_.shape().env_count();
  std::vector<std::optional<uint32_t>> slab_of(static_cast<std::size_t>(env_count));
  int missing = env_count;
  const auto give_back = [&] {
    for (const auto& slab : slab_of)
      if (slab) arena_.release_slab(*slab);
    return std::vector<uint32_t>();
  };
  while (missing > 0) {
    if (stop_requested()) return give_back();
    const int64_t waited_from_ns = monotonic_ns();
    shm::Doorbell& sealed = arena_.control().slab_sealed;
    const uint32_t heard = shm::listen(sealed);
    const std::vector<uint32_t> drained = arena_.drain_slabs(missing);
    for (const uint32_t slab : drained) {
      const shm::SlabHeader& header = arena_.slab_header(static_cast<int>(slab));
      const uint32_t env_index = header.env_index;
      if (env_index >= static_cast<uint32_t>(env_count) || header.rollout_index != rollout ||
          slab_of[env_index]) {
        const std::string what = "environment " + std::to_string(env_index) + " sealed rollout " +
                                 std::to_string(header.rollout_index) +
                                 " while the learner waits for rollout " + std::to_string(rollout);
        arena_.release_slab(slab);
        give_back();
        return Error{ErrorCode::kPeerLost,
                     what + "; a simulator left lock step, resume from the last checkpoint"};
      }
      slab_of[env_index] = slab;
      --missing;
    }
    if (missing > 0 && drained.empty()) shm::wait(sealed, heard, 50'000);
    arena_.learner_counters().wait_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - waited_from_ns));
    poll();
  }
  std::vector<uint32_t> slabs;
  for (const auto& slab : slab_of) slabs.push_back(*slab);
  return slabs;
}

Expected<bool> Learner::train_rollout(const std::vector<uint32_t>& slabs) {
  const TrajectoryShape& shape = arena_.shape().trajectory;
  const int64_t per_batch = slabs_per_batch(config_, shape.env);
  const int64_t slab_count = static_cast<int64_t>(slabs.size());
  for (int64_t begin = 0; begin < slab_count; begin += per_batch) {
    const int64_t count = std::min(per_batch, slab_count - begin);
    auto batch = std::ranges::find(batches_, count, &Minibatch::slab_count);
    if (batch == batches_.end()) batch = batches_.insert(batches_.end(), make_minibatch(shape, count));
    clear(*batch);
    for (int64_t i = 0; i < count; ++i) {
      const int slab = static_cast<int>(slabs[static_cast<std::size_t>(begin + i)]);
      broken_decisions_ +=
          static_cast<uint64_t>(collate_slab(*batch, i, arena_.slab(slab), arena_.slab_header(slab).length));
    }
    COMRAD_TRY(train(*batch));
    if (last_update_.abandoned) return false;
  }
  return true;
}

Expected<bool> Learner::replay_rollout(const std::vector<uint32_t>& slabs) {
  const int64_t per_batch = slabs_per_batch(config_, arena_.shape().trajectory.env);
  int64_t in_batch = 0;
  for (std::size_t i = 0; i < slabs.size(); ++i) {
    feed_->insert(arena_, slabs[i], algorithm_->version());
    if (++in_batch < per_batch && i + 1 < slabs.size()) continue;
    in_batch = 0;
    take_inserted();
    while (feed_->is_update_due()) {
      std::unique_ptr<ReplayBatch> batch = feed_->sample();
      COMRAD_TRY(train(*batch));
      if (last_update_.abandoned) return false;
      feed_->finish(std::move(batch));
    }
  }
  return true;
}

Status Learner::run_lock_step() {
  while (!stop_requested() && !is_finished()) {
    if (!wait_while_paused()) break;
    COMRAD_TRY_ASSIGN(const std::vector<uint32_t> slabs, collect_rollout(next_rollout_));
    if (slabs.empty()) break;
    std::optional<JournalSnapshot> boundary;
    if (config_.deterministic && arena_.shape().journal_steps > 0) {
      Expected<JournalSnapshot> captured =
          JournalSnapshot::capture(arena_, next_rollout_ + 1, kJournalTimeoutMs);
      if (captured)
        boundary = std::move(captured).value();
      else
        spdlog::warn("{}; checkpoints of this boundary will not resume exactly", captured.error().message);
    }
    const Expected<bool> trained = on_policy_ != nullptr ? train_rollout(slabs) : replay_rollout(slabs);
    if (!trained || !*trained) {
      for (const uint32_t slab : slabs) arena_.release_slab(slab);
      if (!trained) return trained.error();
      // Weights of half a rollout belong to no boundary; the checkpoint before stays the newest.
      spdlog::warn("stopped within a rollout; the run resumes from {}",
                   last_checkpoint_.empty() ? "its beginning" : last_checkpoint_);
      saved_version_ = algorithm_->version();
      return {};
    }
    publish();
    if (layouts_) layouts_->serve(arena_), layouts_->capture_desks(arena_, boundary.has_value());
    journals_ = std::move(boundary);
    ++next_rollout_;
    COMRAD_TRY(save_if_due());
    for (const uint32_t slab : slabs) arena_.release_slab(slab);
    if (is_finished()) break;
    arena_.control().rollouts_allowed = next_rollout_ + 1;
    shm::ring(arena_.control().slab_released);
  }
  return {};
}

UpdateContext Learner::update_context() {
  UpdateContext context;
  context.env_frames = static_cast<double>(env_frames_);
  // Fresh weights after every optimizer step keep the lag low; lock step publishes at the boundary only.
  if (!lock_step_) context.after_step = [this] { publish(); };
  context.begin_step = [this] { return lock_step_ || !stop_requested(); };
  context.keep_going = [this] {
    poll();
    return !stop_requested() ||
           seconds_since_stop() < (lock_step_ ? kAbandonRolloutAfterS : kAbandonStepAfterS);
  };
  return context;
}

Status Learner::train(Minibatch& batch) {
  const int64_t began_ns = monotonic_ns();
  COMRAD_TRY_ASSIGN(last_update_, on_policy_->update(batch, update_context()));
  last_lag_ = last_update_.lag;
  skipped_steps_ += static_cast<uint64_t>(last_update_.skipped_steps);
  if (layouts_ && !last_update_.abandoned) layouts_->score(batch);
  if (last_update_.abandoned && last_update_.optimizer_steps == 0) return {};
  count(batch.transitions);
  arena_.learner_counters().busy_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - began_ns));
  poll();
  return {};
}

Status Learner::train(ReplayBatch& batch) {
  const int64_t began_ns = monotonic_ns();
  COMRAD_TRY_ASSIGN(last_update_, off_policy_->update(batch, update_context()));
  skipped_steps_ += static_cast<uint64_t>(last_update_.skipped_steps);
  count(0);
  arena_.learner_counters().busy_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - began_ns));
  poll();
  return {};
}

void Learner::take_inserted() {
  const Inserted inserted = feed_->take_inserted();
  if (inserted.transitions == 0) return;
  last_lag_ = inserted.lag;
  if (inserted.frame.defined()) off_policy_->observe(inserted.frame, inserted.measurement);
  broken_decisions_ = static_cast<uint64_t>(feed_->broken_decisions());
  count(inserted.transitions);
  feed_->set_env_frames(static_cast<double>(env_frames_));
}

void Learner::count(int64_t transitions) {
  decisions_ += static_cast<uint64_t>(transitions);
  env_frames_ += static_cast<uint64_t>(transitions * config_.env_frameskip);
  if (transitions > 0) rates_.add(monotonic_s(), env_frames_, decisions_);
  shm::ControlBlock& control = arena_.control();
  control.learner_env_frames = env_frames_;
  control.epsilon = static_cast<float>(epsilon_at(config_, static_cast<double>(env_frames_)));
  shm::WorkerCounters& counters = arena_.learner_counters();
  counters.decisions = decisions_;
  counters.batches = algorithm_->version();
}

void Learner::publish() {
  weights_.resize(static_cast<std::size_t>(algorithm_->weights_bytes()));
  algorithm_->write_weights(weights_);
  arena_.publish_weights(weights_, algorithm_->version());
  if (!bus_) return;
  const Status written = bus_->write(dds::WeightsUpdate{
      .version = algorithm_->version(), .bytes = weights_.size(), .checksum = checksum64(weights_)});
  if (!written) spdlog::warn("weights notice: {}", written.error().message);
}

bool Learner::is_finished() const {
  if (static_cast<double>(env_frames_) >= config_.train_for_env_steps) return true;
  return config_.train_for_seconds > 0 &&
         train_seconds_before_ + monotonic_s() - started_s_ >= config_.train_for_seconds;
}

bool Learner::stop_requested() {
  const bool stopping =
      stop_.load(std::memory_order_relaxed) || arena_.control().run_state.load() == shm::RunState::kStopping;
  if (stopping && stop_seen_s_ == 0) stop_seen_s_ = monotonic_s();
  return stopping;
}

double Learner::seconds_since_stop() const { return stop_seen_s_ == 0 ? 0 : monotonic_s() - stop_seen_s_; }

bool Learner::wait_while_paused() {
  while (arena_.control().run_state.load() == shm::RunState::kPaused) {
    if (stop_requested()) return false;
    if (state_name_ != "paused") set_state("paused");
    shm::Doorbell& changed = arena_.control().run_state_changed;
    const uint32_t heard = shm::listen(changed);
    shm::wait(changed, heard, 50'000);
    poll();
  }
  if (state_name_ == "paused") set_state("running");
  return true;
}

StateDict Learner::state() const {
  StateDict state;
  algorithm_->save(state);
  state.put("counters/env_frames", static_cast<int64_t>(env_frames_));
  state.put("counters/decisions", static_cast<int64_t>(decisions_));
  state.put("counters/train_seconds", train_seconds_before_ + monotonic_s() - started_s_);
  if (has_best_) state.put("counters/best_score", best_score_);
  const std::vector<double> episodes = episodes_.state();
  state.put(kEpisodesKey, torch::tensor(episodes, torch::kFloat64)
                              .view({static_cast<int64_t>(episodes_.size()),
                                     static_cast<int64_t>(EpisodeWindow::kFields)}));
  // Every random draw is a function of the seed and of counters above; there is no other generator state.
  state.put("rng/seed", config_.seed);
  state.put("config/toml", settings_to_toml(config_));
  if (journals_) journals_->save(state);
  if (layouts_) layouts_->save(state);
  if (feed_) feed_->save_position(state);
  return state;
}

Status Learner::save_replay(StateDict& state) {
  const std::string folder = options_.run_dir + "/checkpoint";
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  return feed_->save(state, folder, replay_file_name(algorithm_->version(), env_frames_));
}

void Learner::prune_replays() const {
  std::vector<std::string> kept;
  for (const CheckpointFile& file : store_.list())
    kept.push_back(replay_file_name(file.version, file.env_frames));
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(options_.run_dir + "/checkpoint", error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("replay_") && name.ends_with(".bin") && std::ranges::find(kept, name) == kept.end())
      std::filesystem::remove(entry.path(), error);
  }
}

Status Learner::save_checkpoint() {
  StateDict saved = state();
  if (feed_ && config_.save_replay) {
    if (const Status written = save_replay(saved); !written) {
      last_save_s_ = monotonic_s();
      spdlog::error("checkpoint: {}", written.error().message);
      return written;
    }
  }
  const Expected<std::string> path = store_.save(saved, algorithm_->version(), env_frames_);
  if (feed_) prune_replays();
  last_save_s_ = monotonic_s();
  if (!path) {
    spdlog::error("checkpoint: {}", path.error().message);
    return path.error();
  }
  saved_version_ = algorithm_->version();
  last_checkpoint_ = *path;
  arena_.control().saved_env_frames = env_frames_;
  spdlog::info("saved {}", *path);
  if (layouts_)
    if (const Status written = layouts_->write_file(options_.run_dir); !written)
      spdlog::error("{}", written.error().message);
  return {};
}

Status Learner::save_if_due() {
  const double now = monotonic_s();
  if (last_save_s_ == 0) last_save_s_ = last_best_look_s_ = now;
  const uint32_t checkpoint_seq = arena_.control().checkpoint_seq.load(std::memory_order_relaxed);
  const bool wanted = checkpoint_seq != checkpoint_seq_done_;
  if (wanted || (now - last_save_s_ >= config_.save_every_sec && algorithm_->version() != saved_version_)) {
    checkpoint_seq_done_ = checkpoint_seq;
    // A full disk costs this checkpoint, not the run; the last one, at the end, decides about the exit code.
    (void)save_checkpoint();
  }
  if (now - last_best_look_s_ >= config_.save_best_every_sec) {
    last_best_look_s_ = now;
    save_if_best();
  }
  return {};
}

void Learner::save_if_best() {
  if (static_cast<double>(env_frames_) < config_.save_best_after) return;
  if (!episodes_.is_full()) {
    if (!has_best_ && !told_of_no_best_)
      spdlog::info(
          "no best checkpoint before stats_avg {} episodes have ended ({} so far); a run that ends before "
          "leaves none, --stats_avg asks for fewer",
          config_.stats_avg, episodes_.size());
    told_of_no_best_ = true;
    return;
  }
  const double score = episodes_.score_mean();
  if (!std::isfinite(score) || (has_best_ && score <= best_score_ + kBestImprovement)) return;
  const double previous = best_score_;
  const bool had_best = has_best_;
  best_score_ = score;
  has_best_ = true;
  const Expected<std::string> path = store_.save_best(state(), score);
  if (path) {
    spdlog::info("saved {}", *path);
  } else {
    spdlog::error("best checkpoint: {}", path.error().message);
    best_score_ = previous;
    has_best_ = had_best;
  }
}

void Learner::poll() {
  const double now = monotonic_s();
  if (now - last_poll_s_ < kPollIntervalS) return;
  last_poll_s_ = now;
  while (const std::optional<shm::EpisodeRecord> episode = arena_.pop_forwarded_episode())
    episodes_.add(*episode, arena_.shape().trajectory.env.num_agents);
  // In lock step the desks are served between two rollouts alone, when no simulator is at them.
  if (layouts_ && !lock_step_) layouts_->serve(arena_);
  if (now - last_stats_s_ >= kStatsIntervalS) {
    last_stats_s_ = now;
    set_state(state_name_.c_str());
    if (!options_.serve) publish_stats();
  }
  if (last_report_s_ == 0) last_report_s_ = now;
  if (metrics_ && now - last_report_s_ >= config_.experiment_summaries_interval) report_metrics();
}

void Learner::publish_stats() {
  shm::LearnerReport report;
  report.time_s = train_seconds_before_ + monotonic_s() - started_s_;
  report.env_frames = env_frames_;
  report.decisions = decisions_;
  report.learner_version = algorithm_->version();
  report.env_frames_per_s = rates_.env_frames_per_s();
  report.decisions_per_s = rates_.decisions_per_s();
  report.score_mean = episodes_.score_mean();
  report.return_mean = episodes_.return_mean();
  report.episodes = episodes_.episodes();
  report.policy_lag_mean = last_lag_.mean;
  report.policy_lag_max = static_cast<uint32_t>(last_lag_.max);
  last_checkpoint_.copy(report.last_checkpoint, shm::kCheckpointPathBytes - 1);
  arena_.publish_report(report);
}

void Learner::append_replay(MetricValues& values) const {
  const double env_frames = static_cast<double>(env_frames_);
  values.emplace_back("train/epsilon", epsilon_at(config_, env_frames));
  if (config_.per) values.emplace_back("train/per_beta", feed_->beta());
  values.emplace_back("train/buffer_size", feed_->replay().unit_count());
  values.emplace_back("train/buffer_transitions", feed_->replay().transition_count());
  values.emplace_back("train/buffer_capacity", feed_->replay().capacity_transitions());
  values.emplace_back("train/buffer_bytes", feed_->replay().used_bytes());
  values.emplace_back("train/buffer_capacity_bytes", feed_->replay().capacity_bytes());
  values.emplace_back("train/version_diff_avg", last_lag_.mean);
  values.emplace_back("train/version_diff_min", static_cast<double>(last_lag_.min));
  values.emplace_back("train/version_diff_max", static_cast<double>(last_lag_.max));
}

void Learner::report_metrics() {
  if (!metrics_) return;
  const double now = monotonic_s();
  MetricValues values = last_update_.values;
  values.emplace_back("train/env_steps", static_cast<double>(env_frames_));
  values.emplace_back("train/skipped_sgd_steps", static_cast<double>(skipped_steps_));
  algorithm_->append_diagnostics(values);
  if (feed_) append_replay(values);
  episodes_.append_to(values);
  values.emplace_back("perf/_fps", rates_.env_frames_per_s());
  values.emplace_back("perf/decisions_per_s", rates_.decisions_per_s());
  uint64_t sampled = 0;
  for (int worker = 0; worker < arena_.shape().sim_worker_count; ++worker)
    sampled += arena_.sim_counters(worker).decisions.load();
  // A restarted simulator may count from 0 again; the rate of that one report is left out.
  if (last_sampled_s_ > 0 && now > last_sampled_s_ && sampled >= last_sampled_decisions_)
    values.emplace_back("perf/_sample_throughput",
                        static_cast<double>(sampled - last_sampled_decisions_) / (now - last_sampled_s_));
  last_sampled_s_ = now;
  last_sampled_decisions_ = sampled;
  const shm::WorkerCounters& counters = arena_.learner_counters();
  const double busy = static_cast<double>(counters.busy_ns.load()),
               wait = static_cast<double>(counters.wait_ns.load());
  if (busy + wait > 0) values.emplace_back("stats/learner_busy_fraction", busy / (busy + wait));
  values.emplace_back("stats/batches_waiting", queue_ ? queue_->waiting() : feed_ ? feed_->waiting() : 0);
  values.emplace_back("stats/slabs_sealed", arena_.sealed_count());
  values.emplace_back("stats/episodes", static_cast<double>(episodes_.episodes()));
  if (layouts_) layouts_->append_to(values);
  values.emplace_back("stats/broken_decisions", static_cast<double>(broken_decisions_));
  values.emplace_back("stats/env_frames_lost",
                      static_cast<double>(arena_.control().env_frames_lost.load(std::memory_order_relaxed)));
  last_report_s_ = now;
  warn(check_.judge(values));
  const Status written =
      metrics_->write(train_seconds_before_ + now - started_s_, env_frames_, decisions_, values);
  if (!written) spdlog::error("metrics: {}", written.error().message);
}

/// The supervisor reads warnings from standard error; those that begin with this word it shows the user as they
/// are (deploy/launch/worker_table.cc).
void Learner::warn(const std::vector<std::string>& findings) {
  for (const std::string& finding : findings) {
    last_warning_ = "warning: " + finding;
    spdlog::warn("{}", last_warning_);
  }
}

void Learner::set_state(const char* state) {
  state_name_ = state;
  if (!bus_) return;
  static const std::string host = host_name();
  const Status written = bus_->write(dds::WorkerStatus{.worker_id = "learner",
                                                       .host = host,
                                                       .pid = getpid(),
                                                       .role = "learner",
                                                       .state = state_name_,
                                                       .decisions_per_s = rates_.decisions_per_s(),
                                                       .message = last_warning_});
  if (!written) spdlog::warn("worker status: {}", written.error().message);
}

}  // namespace comrad::learn
