#include "learner/sources/batch_source.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "learner/sources/batch_queue.h"
#include "learner/sources/collate_slabs.h"
#include "learner/sources/journal_snapshot.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::learn {
namespace {

constexpr int kPopTimeoutMs = 50;
constexpr int kTellWithinMs = 20;  ///< others hear of new decisions so soon, where no batch is due
constexpr int64_t kSealedTimeoutUs = 50'000;
constexpr int kJournalTimeoutMs = 5000;

/// Counts the time from its making on as waiting of the (first) learner.
class WaitClock {
 public:
  explicit WaitClock(const SourceOptions& options) : options_(options) {}
  WaitClock(const WaitClock&) = delete;
  WaitClock& operator=(const WaitClock&) = delete;
  ~WaitClock() {
    if (options_.ranks.is_leader())
      options_.arena.learner_counters().wait_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - from_ns_));
  }

 private:
  const SourceOptions& options_;
  const int64_t from_ns_ = monotonic_ns();
};

/// On-policy, asynchronous: a thread fills batches while the learner trains.
class QueueSource final : public BatchSource {
 public:
  explicit QueueSource(const SourceOptions& options) : options_(options) {}

  Status start() override {
    queue_ = std::make_unique<BatchQueue>(
        options_.arena,
        slabs_per_batch(options_.config, options_.arena.shape().trajectory.env) / options_.ranks.count(),
        options_.config.collection.num_batches_to_accumulate, options_.device, options_.frames);
    return {};
  }
  uint64_t rollouts_allowed() const override { return kUnlimited; }

  Expected<bool> drain() override {
    const WaitClock clock(options_);
    next_ = queue_->pop(kPopTimeoutMs);
    if (next_ != nullptr) return true;
    if (const std::string failure = queue_->failure(); !failure.empty())
      return Error{ErrorCode::kSystem, "collating batches failed: " + failure};
    return false;
  }
  std::optional<Sample> sample(PolicyVersion) override {
    if (next_ == nullptr) return std::nullopt;
    return Sample{.inserted = {}, .rollout_batch = std::move(next_), .replay_batch = nullptr};
  }
  void finish(Sample sample) override {
    hand_back(*sample.rollout_batch, options_.device);
    queue_->recycle(std::move(sample.rollout_batch));
  }
  void stop() override {
    broken_decisions_ = broken_decisions();
    queue_.reset();
  }

  int waiting() const override { return queue_ ? queue_->waiting() : 0; }
  uint64_t broken_decisions() const override {
    return queue_ ? queue_->broken_decisions() : broken_decisions_;
  }

 private:
  const SourceOptions options_;
  std::unique_ptr<BatchQueue> queue_;
  std::unique_ptr<RolloutBatch> next_;
  uint64_t broken_decisions_ = 0;  ///< of the queue that was
};

/// Off-policy, asynchronous: one thread fills the replay, another draws from it.
class ReplaySource final : public BatchSource {
 public:
  ReplaySource(const SourceOptions& options, std::unique_ptr<ReplayFeed> feed)
      : options_(options), feed_(std::move(feed)) {}

  Status start() override {
    feed_->agree_on_pace();
    feed_->start(options_.arena);
    return {};
  }
  uint64_t rollouts_allowed() const override { return kUnlimited; }

  Expected<bool> drain() override {
    const WaitClock clock(options_);
    RankGroup& ranks = options_.ranks;
    feed_->meet_before_drain();
    if (!drawn_) drawn_ = feed_->pop(ranks.is_alone() ? kPopTimeoutMs : kTellWithinMs);
    next_.inserted = feed_->take_inserted();
    if (const std::string failure = feed_->failure(); !failure.empty())
      return Error{ErrorCode::kSystem, "replay: " + failure};
    // A batch that others have not drawn yet is kept until they have.
    if (ranks.all(drawn_ != nullptr)) next_.replay_batch = std::move(drawn_);
    if (ranks.failure()) next_ = {};
    return next_.has_batch() || next_.inserted.transitions > 0;
  }
  std::optional<Sample> sample(PolicyVersion) override {
    if (!next_.has_batch() && next_.inserted.transitions == 0) return std::nullopt;
    return std::exchange(next_, {});
  }
  void finish(Sample sample) override { feed_->finish(std::move(sample.replay_batch)); }

  ReplayFeed* feed() override { return feed_.get(); }
  int waiting() const override { return feed_->waiting(); }
  uint64_t broken_decisions() const override {
    return static_cast<uint64_t>(feed_->contents().broken_decisions);
  }

 private:
  const SourceOptions options_;
  std::unique_ptr<ReplayFeed> feed_;
  std::unique_ptr<ReplayBatch> drawn_;  ///< before it is agreed on
  Sample next_;
};

/// Lock step, on-policy or with a replay: waits for slab r of every environment, hands them out in the environments'
/// order, and only then lets rollout r + 1 begin. So the result does not depend on timing.
class LockStepSource final : public BatchSource {
 public:
  /// `feed` is null on-policy.
  LockStepSource(const SourceOptions& options, std::unique_ptr<ReplayFeed> feed)
      : options_(options),
        per_batch_(static_cast<std::size_t>(
            slabs_per_batch(options.config, options.arena.shape().trajectory.env) / options.ranks.count())),
        share_{.rank = options.ranks.rank(),
               .count = options.ranks.count(),
               .block = static_cast<int>(per_batch_) * options.ranks.count()},
        feed_(std::move(feed)) {}
  ~LockStepSource() override { release_slabs(); }

  Status start() override {
    if (feed_) feed_->agree_on_pace();
    return journals_ && options_.ranks.is_leader() ? journals_->restore(options_.arena) : Status();
  }
  uint64_t rollouts_allowed() const override { return next_rollout_ + 1; }

  Expected<bool> drain() override;
  std::optional<Sample> sample(PolicyVersion version) override;
  void finish(Sample sample) override;
  void close_rollout() override;
  bool resumes_exactly() const override { return journals_.has_value(); }
  void open_rollout(bool goes_on) override;

  Status load(const StateDict& state, const std::string& path, bool is_own) override;
  void save(StateDict& state) const override;

  ReplayFeed* feed() override { return feed_.get(); }
  int waiting() const override { return feed_ ? feed_->waiting() : 0; }
  uint64_t broken_decisions() const override {
    return feed_ ? static_cast<uint64_t>(feed_->contents().broken_decisions) : broken_decisions_;
  }

 private:
  Status take(uint32_t slab, std::vector<std::optional<uint32_t>>& slab_of);
  Expected<bool> collect();
  void capture_journals();
  std::unique_ptr<RolloutBatch> collate_next();
  void release_slabs();

  const SourceOptions options_;
  const std::size_t per_batch_;  ///< slabs
  const shm::EnvShare share_;    ///< a batch of all learners is one block
  std::unique_ptr<ReplayFeed> feed_;
  std::vector<std::unique_ptr<RolloutBatch>> free_;  ///< of a full batch, and of a shorter rest
  std::vector<uint32_t> slabs_;                      ///< of the rollout in hand, by environment
  std::size_t used_ = 0;                             ///< of them
  std::optional<JournalSnapshot> journals_;          ///< of the last boundary, deterministic mode
  std::optional<JournalSnapshot> boundary_;          ///< behind the rollout in hand
  uint64_t next_rollout_ = 0;
  uint64_t broken_decisions_ = 0;
};

Expected<bool> LockStepSource::drain() {
  if (feed_) feed_->meet_before_drain();
  COMRAD_TRY_ASSIGN(bool is_whole, collect());
  // Where a stop comes before some have theirs, none begins to train.
  if (feed_ && !options_.ranks.all(is_whole) && is_whole) {
    release_slabs();
    is_whole = false;
  }
  if (is_whole) capture_journals();
  return is_whole;
}

Status LockStepSource::take(uint32_t slab, std::vector<std::optional<uint32_t>>& slab_of) {
  const shm::SlabHeader& header = options_.arena.slabs().header(static_cast<int>(slab));
  const auto place = static_cast<std::size_t>(share_.place_of(header.env_index));
  if (place < slab_of.size() && header.rollout_index == next_rollout_ && !slab_of[place]) {
    slab_of[place] = slab;
    return {};
  }
  return Error{ErrorCode::kPeerLost,
               fmt::format("environment {} sealed rollout {} while the learner waits for rollout {}; a "
                           "simulator left lock step, resume from the last checkpoint",
                           header.env_index, header.rollout_index, next_rollout_)};
}

/// Waits for the rollout's slab of every environment; false, and all slabs back, when a stop came first.
Expected<bool> LockStepSource::collect() {
  const shm::Arena& arena = options_.arena;
  std::vector<std::optional<uint32_t>> slab_of(
      static_cast<std::size_t>(arena.shape().env_count() / options_.ranks.count()));
  std::size_t missing = slab_of.size();
  used_ = 0;
  while (missing > 0) {
    if (options_.stop.requested()) {
      release_slabs();
      return false;
    }
    {
      const WaitClock clock(options_);
      shm::Doorbell& sealed = arena.control().slab_sealed;
      const uint32_t heard = shm::listen(sealed);
      const std::vector<uint32_t> drained = arena.slabs().drain(static_cast<int>(missing), share_);
      slabs_.insert(slabs_.end(), drained.begin(), drained.end());
      for (const uint32_t slab : drained)
        if (const Status taken = take(slab, slab_of); !taken) {
          release_slabs();
          return taken.error();
        }
      missing -= drained.size();
      if (missing > 0 && drained.empty()) shm::wait(sealed, heard, kSealedTimeoutUs);
    }
    options_.poll();
  }
  std::ranges::transform(slab_of, slabs_.begin(), [](const std::optional<uint32_t>& slab) { return *slab; });
  return true;
}

void LockStepSource::capture_journals() {
  boundary_.reset();
  if (!options_.config.collection.deterministic || options_.arena.shape().journal_steps <= 0) return;
  if (!options_.ranks.is_leader()) return;
  Expected<JournalSnapshot> captured =
      JournalSnapshot::capture(options_.arena, next_rollout_ + 1, kJournalTimeoutMs);
  if (captured)
    boundary_ = std::move(captured).value();
  else
    spdlog::warn("{}; checkpoints of this boundary will not resume exactly", captured.error().message);
}

std::optional<Sample> LockStepSource::sample(PolicyVersion version) {
  Sample next;
  if (feed_ == nullptr) {
    if (used_ == slabs_.size()) return std::nullopt;
    next.rollout_batch = collate_next();
    return next;
  }
  // Every batch's worth of slabs is stored, and then trained on as often as it is due.
  if (used_ > 0 && feed_->is_update_due()) {
    next.replay_batch = feed_->sample();
    return next;
  }
  if (used_ == slabs_.size()) return std::nullopt;
  const std::size_t end = std::min(used_ + per_batch_, slabs_.size());
  for (; used_ < end; ++used_) feed_->insert(options_.arena, slabs_[used_], version);
  next.inserted = feed_->take_inserted();
  if (options_.ranks.failure()) return std::nullopt;
  return next;
}

std::unique_ptr<RolloutBatch> LockStepSource::collate_next() {
  const shm::Arena& arena = options_.arena;
  const auto count = static_cast<int64_t>(std::min(per_batch_, slabs_.size() - used_));
  std::unique_ptr<RolloutBatch> batch;
  if (const auto fits = std::ranges::find(free_, count, [](const auto& one) { return one->slab_count; });
      fits != free_.end()) {
    batch = std::move(*fits);
    free_.erase(fits);
    clear(*batch);
  } else {
    batch = std::make_unique<RolloutBatch>(
        make_rollout_batch(arena.shape().trajectory, count, options_.device, options_.frames != nullptr));
  }
  std::vector<PlacedSlab> slabs;
  for (int64_t i = 0; i < count; ++i, ++used_) slabs.push_back({.slab_index = slabs_[used_], .position = i});
  broken_decisions_ +=
      static_cast<uint64_t>(collate_slabs(*batch, slabs, arena, options_.frames, options_.device));
  return batch;
}

void LockStepSource::finish(Sample sample) {
  if (sample.replay_batch) feed_->finish(std::move(sample.replay_batch));
  if (!sample.rollout_batch) return;
  hand_back(*sample.rollout_batch, options_.device);
  free_.push_back(std::move(sample.rollout_batch));
}

void LockStepSource::close_rollout() {
  journals_ = std::exchange(boundary_, std::nullopt);
  ++next_rollout_;
}

void LockStepSource::open_rollout(bool goes_on) {
  release_slabs();
  if (!goes_on || !options_.ranks.is_leader()) return;
  options_.arena.control().rollouts_allowed = rollouts_allowed();
  shm::ring(options_.arena.control().slab_released);
}

void LockStepSource::release_slabs() {
  for (const uint32_t slab : slabs_) options_.arena.slabs().release(slab);
  slabs_.clear();
  used_ = 0;
}

Status LockStepSource::load(const StateDict& state, const std::string& path, bool is_own) {
  journals_.reset();
  next_rollout_ = 0;
  if (options_.config.collection.deterministic && JournalSnapshot::is_in(state)) {
    COMRAD_TRY_ASSIGN(journals_, JournalSnapshot::load(state));
    next_rollout_ = journals_->next_rollout;
  } else if (options_.config.collection.deterministic) {
    spdlog::warn("{} holds no journals; its environments begin anew, the run is not the uninterrupted one",
                 path);
  }
  return BatchSource::load(state, path, is_own);
}

void LockStepSource::save(StateDict& state) const {
  if (journals_) journals_->save(state);
  BatchSource::save(state);
}

}  // namespace

Status BatchSource::load(const StateDict& state, const std::string& path, bool is_own) {
  if (feed() == nullptr) return {};
  const std::size_t slash = path.rfind('/');
  return feed()->load(state, slash == std::string::npos ? "." : path.substr(0, slash), is_own);
}

void BatchSource::save(StateDict& state) const {
  if (feed() != nullptr) feed()->save_position(state);
}

Expected<UpdateStats> update_on(Sample& sample, Algorithm& algorithm, const UpdateContext& context) {
  return sample.rollout_batch ? algorithm.on_policy()->update(*sample.rollout_batch, context)
                              : algorithm.off_policy()->update(*sample.replay_batch, context);
}

int64_t slabs_per_batch(const RunConfig& config, const EnvShape& env) {
  return std::max<int64_t>(1, config.optimisation.batch_size * config.optimisation.num_batches_per_epoch /
                                  (config.collection.rollout * env.num_agents));
}

Expected<std::unique_ptr<BatchSource>> make_batch_source(const SourceOptions& options) {
  std::unique_ptr<ReplayFeed> feed;
  if (options.is_off_policy) {
    COMRAD_TRY_ASSIGN(feed, ReplayFeed::create(options.config, options.arena.shape().trajectory,
                                               options.arena.shape().weights_bytes, options.run_dir,
                                               options.device, &options.ranks));
  }
  std::unique_ptr<BatchSource> source;
  if (options.config.collection.deterministic || !options.config.collection.async_rl)
    source = std::make_unique<LockStepSource>(options, std::move(feed));
  else if (options.is_off_policy)
    source = std::make_unique<ReplaySource>(options, std::move(feed));
  else
    source = std::make_unique<QueueSource>(options);
  return source;
}

}  // namespace comrad::learn
