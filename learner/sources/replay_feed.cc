#include "learner/sources/replay_feed.h"

#include <spdlog/fmt/fmt.h>

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>

#include "learner/algorithms/q_learning.h"
#include "learner/ranks/lag_of_ranks.h"
#include "learner/sources/stop_signal.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/metrics/learner_messages.h"
#include "rollout_buffer/replay/replay_plan.h"
#include "rollout_buffer/settings/drawn_batch.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::learn {
namespace {

constexpr int64_t kEmptyNapUs = 1000;
constexpr std::size_t kBatchesAhead = 1;
/// Of a resumed run without its replay: fewer, and a batch would be the same few decisions again and again.
constexpr int64_t kBatchesBeforeTraining = 4;

replay::Unit unit_of(DrawnBatch::Unit drawn) {
  switch (drawn) {
    case DrawnBatch::Unit::kSequence:
      return replay::Unit::kSequence;
    case DrawnBatch::Unit::kJointDecision:
      return replay::Unit::kJointStep;
    case DrawnBatch::Unit::kDecisionOfOne:
      return replay::Unit::kAgentStep;
  }
  return replay::Unit::kSequence;
}

/// Learners go by what the first one found free on their host.
Expected<replay::ReplayPlan> plan_of_first(replay::ReplayPlan plan, RankGroup& ranks) {
  if (ranks.is_alone()) return plan;
  const Tensor all = ranks.gather(torch::tensor({plan.capacity_bytes, int64_t{plan.compress},
                                                 plan.fitting_decisions, plan.decisions_before_training},
                                                torch::kInt64)
                                      .unsqueeze(0),
                                  0);
  plan.file = ranks.from_leader(plan.file);
  COMRAD_TRY(ranks.status());
  const int64_t* first = all.data_ptr<int64_t>();
  plan.capacity_bytes = first[0];
  plan.compress = first[1] != 0;
  plan.fitting_decisions = first[2];
  plan.decisions_before_training = first[3];
  return plan;
}

/// Where learner `rank` keeps its part of a replay that the first one saves as `path`.
std::string path_of_rank(const std::string& path, int rank) {
  if (rank == 0) return path;
  const std::size_t dot = path.rfind('.');
  return fmt::format("{}.{}{}", path.substr(0, dot), rank, path.substr(dot));
}

}  // namespace

Expected<std::unique_ptr<ReplayFeed>> ReplayFeed::create(const RunConfig& config,
                                                         const TrajectoryShape& shape, int64_t weights_bytes,
                                                         const std::string& run_dir, torch::Device device,
                                                         RankGroup* ranks) {
  RankGroup alone;
  RankGroup& all = ranks != nullptr ? *ranks : alone;
  const int64_t agents = shape.env.num_agents, learners = all.count();
  const bool learns_alone = config.run.algo->learns_alone();
  const DrawnBatch drawn = drawn_batch(config, agents);
  if (drawn.units % learners != 0)
    return Error{ErrorCode::kBadInput, "learners do not divide replay_batch_size"};
  const ReplayBatchOptions batch_options{
      .shape = shape,
      .unit = unit_of(drawn.unit),
      .world_count = drawn.units / learners,
      .n_step = config.q_learning.n_step.rounded_at(0),
      .pay = {.gamma = config.optimisation.gamma,
              .reward_clip = learns_alone ? config.q_learning.dqn_reward_clip : 0.0},
      .agents_end = learns_alone,
      .device = device};
  const replay::Unit unit = batch_options.unit;
  COMRAD_TRY_ASSIGN(replay::ReplayPlan free_here,
                    replay::replay_plan(config, shape, replay::probe_space(run_dir),
                                        replay::reserved_bytes(config, shape, weights_bytes), run_dir));
  COMRAD_TRY_ASSIGN(const replay::ReplayPlan plan, plan_of_first(std::move(free_here), all));
  const replay::ReplayPlan share = plan.share_of(all.rank(), all.count());
  COMRAD_TRY_ASSIGN(
      std::unique_ptr<replay::Replay> replay,
      replay::Replay::create(
          {.store = {.shape = shape,
                     .capacity_bytes = share.capacity_bytes,
                     .capacity_transitions = share.capacity_transitions,
                     .file = share.file,
                     .compress = share.compress,
                     .post_death_reward = learns_alone ? std::optional(batch_options.pay) : std::nullopt},
           .unit = unit,
           .prioritized = config.replay.per,
           .omega = config.replay.per_omega}));
  const int64_t capacity = learners * replay->capacity_transitions();
  if (all.is_leader())
    tell_user(
        {UserMessage::Kind::kNote,
         plan.words() +
             (all.is_alone() ? "" : fmt::format("; each of {} learners holds a part of it", learners))});
  const int64_t samples = drawn.units * (unit == replay::Unit::kSequence ? config.collection.rollout * agents
                                         : unit == replay::Unit::kJointStep ? agents
                                                                            : 1);
  if (capacity < 10 * samples)
    spdlog::warn("replay: only {:.1f} batches of {} decisions fit; raise --replay_gb or lower the batch",
                 static_cast<double>(capacity) / static_cast<double>(samples), samples);
  const double updates_per_batch = static_cast<double>(
      std::min(std::max<int64_t>(1, config.optimisation.batch_size / config.q_learning.train_every_decisions),
               config.q_learning.dqn_max_updates_per_batch));
  const double ratio = config.q_learning.replay_ratio > 0
                           ? config.q_learning.replay_ratio
                           : updates_per_batch * static_cast<double>(samples) /
                                 static_cast<double>(config.optimisation.batch_size);
  const int64_t piece = learners * config.collection.rollout * agents;  // a slab of each
  const double ahead =
      static_cast<double>(config.collection.num_batches_to_accumulate * config.optimisation.batch_size) *
      ratio;
  const replay::RateLimiterOptions rate{
      .samples_per_insert = ratio,
      .min_size_to_sample = plan.decisions_before_training,
      .error_buffer = std::max(ahead, static_cast<double>(piece) * ratio + static_cast<double>(samples))};
  COMRAD_TRY(replay::validate(rate, piece, samples));
  spdlog::info("replay: {:.3g} decisions are trained on for each new one, {} in an update", ratio, samples);
  return std::unique_ptr<ReplayFeed>(
      new ReplayFeed(config, batch_options, std::move(replay), rate, samples, ranks));
}

ReplayFeed::ReplayFeed(const RunConfig& config, const ReplayBatchOptions& batch_options,
                       std::unique_ptr<replay::Replay> replay, const replay::RateLimiterOptions& rate,
                       int64_t samples_per_update, RankGroup* ranks)
    : config_(config),
      ranks_(ranks != nullptr ? *ranks : alone_),
      batch_options_(batch_options),
      samples_per_update_(samples_per_update),
      replay_(std::move(replay)),
      limiter_(rate),
      min_size_to_sample_(rate.min_size_to_sample),
      beta_(config.replay.per_beta_start, 1.0, config.replay.per_beta_env_frames) {}

ReplayFeed::~ReplayFeed() {
  stop_ = true;
  limiter_.stop();
  changed_.notify_all();
  if (feed_thread_.joinable()) feed_thread_.join();
  if (sample_thread_.joinable()) sample_thread_.join();
}

void ReplayFeed::insert(const shm::Arena& arena, uint32_t slab, PolicyVersion learner_version) {
  const int index = static_cast<int>(slab);
  const shm::SlabHeader& header = arena.slabs().header(index);
  insert(arena.slabs().view(index), header.length, learner_version,
         {.env_index = header.env_index,
          .rollout_index = header.rollout_index,
          .first_episode_id = header.first_episode.episode_id});
}

void ReplayFeed::insert(const SlabView& slab, uint32_t length, PolicyVersion learner_version,
                        const replay::SlabOrigin& origin) {
  const int64_t inserted = replay_->insert(slab, length, origin);
  {
    const std::lock_guard lock(inserted_mutex_);
    const int agents = batch_options_.shape.env.num_agents;
    const int steps = static_cast<int>(inserted / agents);
    inserted_transitions_ += inserted;
    for (int t = 0; t < steps; ++t) {
      if (config_.network.normalize_input) {
        const auto frames = slab.frames(t);
        inserted_frames_.insert(inserted_frames_.end(), frames.begin(), frames.end());
      }
      for (const float number : slab.global_state(t))
        inserted_states_.push_back(std::isfinite(number) ? number : 0.0f);
      for (int agent = 0; agent < agents; ++agent) {
        if (config_.network.normalize_input)
          for (const float number : slab.measurement(t, agent))
            inserted_measurements_.push_back(std::isfinite(number) ? number : 0.0f);
        const int64_t lag =
            std::max<int64_t>(0, int64_t{learner_version} - int64_t{slab.policy_version(t, agent)});
        lag_.max = std::max(lag_.max, lag);
        lag_.min = lag_sum_ == 0 && t == 0 ? lag : std::min(lag_.min, lag);
        lag_sum_ += static_cast<double>(lag);
      }
    }
  }
  if (ranks_.is_alone()) limiter_.inserted(inserted);
}

Inserted ReplayFeed::take_inserted() {
  Inserted taken = take_own();
  if (!ranks_.is_alone()) tell_others(taken);
  return taken;
}

void ReplayFeed::tell_others(Inserted& taken) {
  const ReplayContents own = own_contents();
  const Tensor all =
      ranks_.gather(torch::tensor({taken.transitions, own.units, own.transitions, own.capacity_transitions,
                                   own.used_bytes, own.capacity_bytes, own.broken_decisions},
                                  torch::kInt64)
                        .unsqueeze(0),
                    0);
  const Tensor sum = all.sum(0);
  const int64_t* sums = sum.data_ptr<int64_t>();
  contents_ = {.units = sums[1],
               .transitions = sums[2],
               .capacity_transitions = sums[3],
               .used_bytes = sums[4],
               .capacity_bytes = sums[5],
               .broken_decisions = sums[6]};
  all_can_draw_ = all.select(1, 1).min().item<int64_t>() > 0;
  if (sums[0] == 0) return;
  taken.lag.valid_fraction = 1;
  taken.lag = lag_of_ranks(taken.lag, taken.transitions, ranks_);
  taken.transitions = sums[0];
  limiter_.inserted(taken.transitions);
}

ReplayContents ReplayFeed::own_contents() const {
  return {.units = replay_->unit_count(),
          .transitions = replay_->transition_count(),
          .capacity_transitions = replay_->capacity_transitions(),
          .used_bytes = replay_->used_bytes(),
          .capacity_bytes = replay_->capacity_bytes(),
          .broken_decisions = replay_->broken_decisions()};
}

Inserted ReplayFeed::take_own() {
  const std::lock_guard lock(inserted_mutex_);
  Inserted taken;
  taken.transitions = inserted_transitions_;
  taken.lag = lag_;
  if (inserted_transitions_ > 0) taken.lag.mean = lag_sum_ / static_cast<double>(inserted_transitions_);
  const EnvShape& env = batch_options_.shape.env;
  const int64_t rows = static_cast<int64_t>(inserted_frames_.size()) / env.frame_bytes();
  if (config_.network.normalize_input) {
    taken.frame = torch::empty({rows, env.channels, env.height, env.width}, torch::kUInt8);
    std::ranges::copy(inserted_frames_, taken.frame.data_ptr<uint8_t>());
    if (env.measurement_count > 0) {
      taken.measurement = torch::empty({rows, env.measurement_count}, torch::kFloat32);
      std::ranges::copy(inserted_measurements_, taken.measurement.data_ptr<float>());
    }
  }
  if (env.global_state_count > 0) {
    const int64_t states = static_cast<int64_t>(inserted_states_.size()) / env.global_state_count;
    taken.global_state =
        torch::tensor(inserted_states_, torch::kFloat32).view({states, env.global_state_count});
  }
  inserted_transitions_ = 0;
  inserted_frames_.clear(), inserted_measurements_.clear(), inserted_states_.clear();
  lag_ = {};
  lag_sum_ = 0;
  return taken;
}

bool ReplayFeed::is_update_due() const { return can_draw() && limiter_.can_sample(samples_per_update_); }

std::unique_ptr<ReplayBatch> ReplayFeed::free_batch() {
  const std::lock_guard lock(mutex_);
  if (free_.empty()) return std::make_unique<ReplayBatch>(make_replay_batch(batch_options_));
  std::unique_ptr<ReplayBatch> batch = std::move(free_.back());
  free_.pop_back();
  return batch;
}

void ReplayFeed::fill_next(ReplayBatch& batch) {
  RngKey key =
      RngKey(static_cast<uint64_t>(config_.run.seed)).split("replay").split(static_cast<uint64_t>(draws_++));
  if (!ranks_.is_leader()) key = key.split(static_cast<uint64_t>(ranks_.rank()));
  Rng rng(key);
  const double exponent = beta();
  const std::vector<replay::Draw> draws =
      replay_->draw(batch_options_.world_count, exponent, rng, &batch.least_probability);
  batch.weight_exponent = config_.replay.per ? exponent : 1;
  ReplayBatchOptions options = batch_options_;
  options.n_step = config_.q_learning.n_step.rounded_at(env_frames_);
  fill(batch, options, *replay_, draws);
  limiter_.sampled(samples_per_update_);
}

std::unique_ptr<ReplayBatch> ReplayFeed::sample() {
  std::unique_ptr<ReplayBatch> batch = free_batch();
  fill_next(*batch);
  return batch;
}

void ReplayFeed::agree_on_pace() {
  if (ranks_.is_alone()) return;
  const Tensor all = ranks_.gather(
      torch::tensor({limiter_.insert_count(), limiter_.sample_count(), limiter_.min_size_to_sample()},
                    torch::kInt64)
          .unsqueeze(0),
      0);
  if (all.eq(all.narrow(0, 0, 1)).all().item<bool>()) return;
  limiter_.restore(0, 0);
  limiter_.set_min_size(all.select(1, 2).min().item<int64_t>());
}

void ReplayFeed::start(const shm::Arena& arena) {
  arena_ = &arena;
  feed_thread_ = std::thread([this] { run("replay-feed", &ReplayFeed::feed); });
  sample_thread_ = std::thread([this] { run("replay-draw", &ReplayFeed::draw); });
}

void ReplayFeed::run(const char* name, void (ReplayFeed::*work)()) {
  pthread_setname_np(pthread_self(), name);
  try {
    (this->*work)();
  } catch (const std::exception& error) {
    const std::lock_guard lock(mutex_);
    failure_ = error.what();
  }
  changed_.notify_all();
}

/// How much more the pace has counted once another slab is in; others insert as much in the meantime.
int64_t ReplayFeed::counts_before_insert() {
  const int64_t slab_transitions = config_.collection.rollout * batch_options_.shape.env.num_agents;
  if (ranks_.is_alone()) return slab_transitions;
  const std::lock_guard lock(inserted_mutex_);
  return ranks_.count() * (inserted_transitions_ + slab_transitions);
}

void ReplayFeed::feed() {
  // An environment stays with one learner, where the trajectory before this one is.
  const shm::EnvShare share{.rank = ranks_.rank(), .count = ranks_.count(), .block = ranks_.count()};
  StageClock stage;
  stage.begin();
  while (!stop_) {
    stage.end(Stage::kCollate);
    // Slabs stay sealed while the learner is behind, so that simulators wait in the end.
    if (can_draw() &&
        limiter_.wait_to_insert(counts_before_insert(), kPollUs / 1000) != replay::WaitResult::kReady)
      continue;
    shm::Doorbell& sealed = arena_->control().slab_sealed;
    const uint32_t heard = shm::listen(sealed);
    const std::vector<uint32_t> slabs = arena_->slabs().drain(1, share);
    for (const uint32_t slab : slabs) {
      insert(*arena_, slab, arena_->control().policy_version.load());
      arena_->slabs().release(slab);
    }
    if (const std::optional<Error> error = replay_->write_error()) {
      const std::lock_guard lock(mutex_);
      failure_ = error->message;
      return;
    }
    if (slabs.empty()) shm::wait(sealed, heard, kPollUs);
  }
}

void ReplayFeed::draw() {
  StageClock stage;
  stage.begin();
  while (!stop_) {
    stage.end(Stage::kCollate);
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, std::chrono::microseconds(kPollUs),
                        [this] { return stop_ || full_.size() < kBatchesAhead; });
      if (full_.size() >= kBatchesAhead) continue;
    }
    if (limiter_.wait_to_sample(samples_per_update_, kPollUs / 1000) != replay::WaitResult::kReady) continue;
    if (!can_draw()) {
      std::this_thread::sleep_for(std::chrono::microseconds(kEmptyNapUs));
      continue;
    }
    std::unique_ptr<ReplayBatch> batch = sample();
    {
      const std::lock_guard lock(mutex_);
      full_.push_back(std::move(batch));
    }
    changed_.notify_all();
  }
}

std::unique_ptr<ReplayBatch> ReplayFeed::pop(int timeout_ms) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::milliseconds(timeout_ms),
                    [this] { return !full_.empty() || !failure_.empty(); });
  if (full_.empty()) return nullptr;
  std::unique_ptr<ReplayBatch> batch = std::move(full_.front());
  full_.pop_front();
  lock.unlock();
  changed_.notify_all();
  return batch;
}

void ReplayFeed::finish(std::unique_ptr<ReplayBatch> batch) {
  if (config_.replay.per && batch->abs_td.defined())
    replay_->set_priorities(batch->serial, {batch->abs_td.data_ptr<float>(), batch->serial.size()});
  hand_back(*batch, batch_options_.device);
  const std::lock_guard lock(mutex_);
  free_.push_back(std::move(batch));
}

int ReplayFeed::waiting() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(full_.size());
}

std::string ReplayFeed::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

Status ReplayFeed::save(StateDict& state, const std::string& folder, const std::string& file) {
  const std::string path = ranks_.from_leader(folder + "/" + file);
  const Status saved = replay_->save(path);
  const bool have_all_saved = ranks_.all(saved.has_value());
  COMRAD_TRY(saved);
  if (ranks_.failure()) {
    spdlog::warn("replay: another learner is gone ({}); the checkpoint holds none",
                 ranks_.failure()->message);
    return {};
  }
  if (!have_all_saved)
    return Error{ErrorCode::kNotSaved, "another learner could not write its replay; its log states why"};
  state.put("replay/file", file);
  state.put("replay/learners", int64_t{ranks_.count()});
  state.put("replay/inserted", limiter_.insert_count());
  state.put("replay/sampled", limiter_.sample_count());
  state.put("replay/draws", draws_);
  state.put("replay/capacity_bytes", replay_->capacity_bytes());
  state.put("replay/compressed", int64_t{replay_->options().store.compress});
  return {};
}

void ReplayFeed::meet_before_drain() {
  if (ranks_.is_alone() || !config_.replay.save_replay) return;
  for (std::string path = ranks_.from_leader(""); !path.empty() && !ranks_.failure();
       path = ranks_.from_leader("")) {
    const Status saved = replay_->save(path_of_rank(path, ranks_.rank()));
    if (!saved) spdlog::error("{}", saved.error().message);
    (void)ranks_.all(saved.has_value());
  }
}

void ReplayFeed::save_position(StateDict& state) const { beta_.save(state, "replay/per_beta"); }

Status ReplayFeed::begin_without_replay(const StateDict& state, const std::string& reason) {
  COMRAD_TRY_ASSIGN(const int64_t version, state.integer("algorithm/version"));
  if (version > 0)
    limiter_.set_min_size(std::min(min_size_to_sample_, kBatchesBeforeTraining * samples_per_update_));
  const std::string begins =
      version == 0 ? fmt::format("{} decisions", min_size_to_sample_)
                   : fmt::format("the first {} batches of new decisions, since its policy is trained",
                                 kBatchesBeforeTraining);
  spdlog::warn("{}; training begins again with {}, its agents act with an epsilon of {:.3g}", reason, begins,
               config_.q_learning.epsilon.at(env_frames_));
  return {};
}

Status ReplayFeed::load(const StateDict& state, const std::string& folder, bool is_own) {
  COMRAD_TRY_ASSIGN(const int64_t env_frames, state.integer("counters/env_frames"));
  env_frames_ = static_cast<double>(env_frames);
  COMRAD_TRY(beta_.load(state, "replay/per_beta", env_frames_));
  if (!is_own) return begin_without_replay(state, "the replay of another run's checkpoint is not read");
  if (!state.has("replay/file"))
    return begin_without_replay(state, "the checkpoint holds no replay (--save_replay was off)");
  COMRAD_TRY_ASSIGN(const std::string file, state.text("replay/file"));
  COMRAD_TRY_ASSIGN(const int64_t inserted, state.integer("replay/inserted"));
  COMRAD_TRY_ASSIGN(const int64_t sampled, state.integer("replay/sampled"));
  COMRAD_TRY_ASSIGN(const int64_t draws, state.integer("replay/draws"));
  int64_t learners = 1;  // a checkpoint without it is of the time when there was one
  if (state.has("replay/learners")) {
    COMRAD_TRY_ASSIGN(learners, state.integer("replay/learners"));
  }
  if (learners != ranks_.count())
    return begin_without_replay(
        state, fmt::format("the checkpoint's replay is that of {} learners, now they are {}", learners,
                           ranks_.count()));
  if (file.find('/') != std::string::npos)
    return Error{ErrorCode::kBadFormat, "replay/file is \"" + file + "\"; it must be a file of the folder"};
  if (config_.collection.deterministic && state.has("replay/capacity_bytes")) {
    // What was free when the run began decided when its items leave; the same now is another number.
    replay::ReplayOptions options = replay_->options();
    COMRAD_TRY_ASSIGN(options.store.capacity_bytes, state.integer("replay/capacity_bytes"));
    COMRAD_TRY_ASSIGN(const int64_t compressed, state.integer("replay/compressed"));
    options.store.compress = compressed != 0;
    if (options.store.capacity_bytes != replay_->capacity_bytes() ||
        options.store.compress != replay_->options().store.compress) {
      COMRAD_TRY_ASSIGN(replay_, replay::Replay::create(options));
    }
  }
  if (const Status loaded = replay_->load(path_of_rank(folder + "/" + file, ranks_.rank())); !loaded) {
    if (config_.collection.deterministic)
      return Error{loaded.error().code,
                   loaded.error().message +
                       "; without it the run is not the uninterrupted one: restore the file, or "
                       "begin anew with --restart_behavior restart"};
    return begin_without_replay(state, loaded.error().message);
  }
  limiter_.restore(inserted, sampled);
  draws_ = draws;
  spdlog::info("replay: {} agent decisions restored", replay_->transition_count());
  return {};
}

}  // namespace comrad::learn
