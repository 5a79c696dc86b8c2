// The replay as the learner sees it: sealed slabs go in, units come out by chance. A unit is a whole sequence
// (VDN, QMIX, QPLEX with a recurrent core), one step of all agents (the same without one) or one step of one
// agent (IDQN). Stage: drain > sample.
//
// Three threads meet here: one inserts, one draws and reads, one writes priorities back. Reading and
// inserting exclude each other for the time of one copy; compressing and checking a slab happens outside the
// lock. An item that was drawn may be evicted before it is read: then read() finds that the store no longer
// contains it.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/replay/samplers/sampler.h"
#include "rollout_buffer/replay/trajectory_store.h"

namespace comrad::replay {

enum class Unit {
  kSequence,   ///< a trajectory with at least one valid step
  kJointStep,  ///< a valid step of all agents
  kAgentStep,  ///< a valid step of one agent that was active in it
};

/// One drawn unit.
struct Draw {
  ItemId item = kNoItem;
  int32_t step = 0;    ///< -1 where the unit is a sequence
  int32_t agent = -1;  ///< -1 where the unit has all agents
  double weight = 1;   ///< importance weight, 1 when uniform
  int64_t serial = 0;  ///< handle for priorities
};

struct ReplayOptions {
  StoreOptions store;  ///< keep_recurrent_state is set by the unit: only sequences keep it
  Unit unit = Unit::kSequence;
  bool prioritized = false;
  double omega = 0.6;  ///< exponent of priorities, 0 (uniform) to 1
};

class Replay {
 public:
  /// Errors: those of TrajectoryStore::create; kBadInput where the exponent lies outside [0, 1].
  static Expected<std::unique_ptr<Replay>> create(const ReplayOptions& options);

  /// Stores a sealed slab. Returns the agent decisions that went in: 0 where it had no steps or the disk
  /// failed (write_error()). Threads: one inserting thread.
  int64_t insert(const SlabView& slab, uint32_t length, const SlabOrigin& origin = {});

  /// `count` units with replacement; none while unit_count() is 0. Prioritised: one from each of `count`
  /// segments of equal probability mass, with weights of exponent `beta`. `least_probability` becomes that of the
  /// unit which is drawn least often.
  std::vector<Draw> draw(int64_t count, double beta, Rng& rng, double* least_probability = nullptr);

  /// Calls `use(store)` under the lock that keeps items alive. Not for long: an insert waits meanwhile. No
  /// call of this object from inside.
  void read(const std::function<void(const TrajectoryStore&)>& use) const;
  /// Reads drawn units one after the other, each under the lock for itself, and requests those that come
  /// next while it does (mapped files). `use(index, trajectory)`; the trajectory is null where it was
  /// evicted meanwhile.
  void read_each(std::span<const Draw> draws,
                 const std::function<void(std::size_t index, const StoredTrajectory* trajectory)>& use) const;
  /// Requests what these draws will read; nothing to do in RAM.
  void prefetch(std::span<const Draw> draws) const;

  /// p = (|td| + 1e-6)^omega; units that were evicted meanwhile are passed over.
  void set_priorities(std::span<const int64_t> serials, std::span<const float> abs_td);

  int64_t unit_count() const;
  int64_t item_count() const;
  int64_t transition_count() const;      ///< agent decisions that are there
  int64_t capacity_transitions() const;  ///< agent decisions that fit, see TrajectoryStore
  int64_t used_bytes() const;
  int64_t capacity_bytes() const { return options_.store.capacity_bytes; }
  int64_t broken_decisions() const;
  std::optional<Error> write_error() const;
  const ReplayOptions& options() const { return options_; }

  /// Content and priorities. A replay restored into the same options draws on as the saved one would have.
  /// Errors: see TrajectoryStore::save and load. After a failed load the replay is empty.
  Status save(const std::string& path) const;
  Status load(const std::string& path);

 private:
  struct UnitPlace {
    ItemId item;
    int32_t step;
    int32_t agent;
  };

  Replay(const ReplayOptions& options, TrajectoryStore store);
  std::shared_lock<std::shared_mutex> lock_for_reading() const;
  std::unique_lock<std::shared_mutex> lock_for_writing();
  void list_units(ItemId id, std::vector<UnitPlace>& units) const;
  Status load_sampler(SnapshotReader& reader);
  void prefetch_draw(const Draw& draw) const;

  const ReplayOptions options_;
  TrajectoryStore store_;
  mutable std::shared_mutex store_mutex_;
  mutable std::mutex turn_;        // keeps a writer from waiting for readers that follow each other
  mutable std::mutex unit_mutex_;  // taken after store_mutex_ where both are
  std::unique_ptr<Sampler> sampler_;
  std::deque<UnitPlace> units_;  // of sampler_'s serials, oldest first
};

}  // namespace comrad::replay
