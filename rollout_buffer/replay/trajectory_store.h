// The replay's store: sealed trajectories of all agents of one environment, frames as uint8, each frame once
// (the next observation of step t is row t+1, not a copy). A ring of bytes in RAM or in a mapped file; items
// have the length they need, the oldest leave when a new one comes. Stage: seal > drain > replay > sample.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/replay/item_offsets.h"
#include "rollout_buffer/replay/post_death_reward.h"
#include "rollout_buffer/replay/ring_memory.h"
#include "rollout_buffer/replay/snapshot_file.h"
#include "rollout_buffer/schema/trajectory.h"

namespace comrad::replay {

/// Counts appended trajectories from 0, never reused.
using ItemId = int64_t;
constexpr ItemId kNoItem = -1;

struct StoreOptions {
  TrajectoryShape shape;
  int64_t capacity_bytes = 0;        ///< of trajectories; the index needs 0.3 % of it at most on top
  int64_t capacity_transitions = 0;  ///< agent decisions; 0: bytes alone decide
  std::string file = {};             ///< empty: RAM; else a file that is made at that size and mapped
  bool compress = false;             ///< each frame as an LZ4 block
  /// The recurrent state before step 0 is kept. Single transitions have no use for it.
  bool keep_recurrent_state = true;
  /// Where agents learn each on its own: what is paid to an agent that is out of the game in a later trajectory
  /// is added to the one that holds its last decision.
  std::optional<PostDeathReward> post_death_reward = {};
};

/// A view of one live item. Valid until the next append(), commit() or load().
class StoredTrajectory {
 public:
  StoredTrajectory(const TrajectoryShape& shape, const ItemForm& form, const std::byte* bytes,
                   int64_t byte_count, const uint8_t* all_ones)
      : shape_(&shape),
        form_(form),
        offsets_(shape, form),
        bytes_(bytes),
        byte_count_(byte_count),
        ones_(all_ones) {}

  int length() const { return form_.length; }  ///< L filled steps, 1..T
  int final_count() const { return form_.finals; }

  void copy_frames(int step, uint8_t* out) const;            ///< step 0..L: [N, C, H, W], all agents
  void copy_frame(int step, int agent, uint8_t* out) const;  ///< step 0..L: [C, H, W]
  std::span<const float> measurement(int step) const;        ///< [N*M], step 0..L
  std::span<const float> global_state(int step) const;       ///< [S], step 0..L
  std::span<const uint8_t> action_mask(
      int step) const;  ///< [N*A], step 0..L; ones where nothing was forbidden
  std::span<const uint8_t> agent_active(int step) const;  ///< [N], step 0..L
  std::span<const uint8_t> action(int step) const;        ///< [N*heads], step 0..L-1
  std::span<const float> reward(int step) const;          ///< [N]
  /// What was paid in later trajectories for the last decision in this one to an agent that is out of the game
  /// at its end, discounted to row L. 0 for others.
  float post_death_reward(int agent) const;
  bool terminated(int step) const;
  bool truncated(int step) const;
  bool valid(int step) const;     ///< may be learned from, for every agent
  int final_row(int step) const;  ///< -1, or the row of the true last observation of the episode cut here
  void copy_final_frames(int row, uint8_t* out) const;            ///< [N, C, H, W]
  void copy_final_frame(int row, int agent, uint8_t* out) const;  ///< [C, H, W]
  std::span<const float> final_measurement(int row) const;        ///< [N*M]
  std::span<const float> final_global_state(int row) const;       ///< [S]
  std::span<const float> recurrent_state(int agent) const;        ///< [H] before step 0; empty where not kept

  /// Where the frames of rows `first..last` (final rows follow row L) lie inside the item: {offset, bytes}.
  std::pair<int64_t, int64_t> frame_range(int first, int last) const;
  /// The same of one agent's frame.
  std::pair<int64_t, int64_t> frame_range_of_agent(int row, int agent) const;
  std::span<const std::byte> bytes() const { return {bytes_, static_cast<std::size_t>(byte_count_)}; }
  const ItemForm& form() const { return form_; }

 private:
  template <typename T>
  std::span<const T> field(int64_t offset, int row, int64_t width) const {
    return {reinterpret_cast<const T*>(bytes_ + offset) + row * width, static_cast<std::size_t>(width)};
  }
  uint8_t flag(int64_t offset, int step) const;
  void copy_cells(int64_t first, int64_t count, uint8_t* out) const;
  std::pair<int64_t, int64_t> cell_range(int64_t begin, int64_t end) const;
  int agents() const { return shape_->env.num_agents; }

  const TrajectoryShape* shape_;
  ItemForm form_;
  ItemOffsets offsets_;
  const std::byte* bytes_;
  int64_t byte_count_;
  const uint8_t* ones_;
};

/// Threads: starts none, holds no locks; `prepare` may run beside const calls, everything else that is not
/// const may not (Replay adds the locks).
class TrajectoryStore {
 public:
  /// Bytes of one whole trajectory of T steps, uncompressed, with `finals` last observations. `with_mask`:
  /// some choice was forbidden; a mask that forbids nothing is not stored.
  static int64_t item_bytes(const TrajectoryShape& shape, int finals, bool with_mask = true);

  /// Errors: kBadInput where the shape is unusable or the capacity holds not one trajectory, kNoSpace for
  /// disk or RAM (needed, there, flags), and those of RingMemory::in_file.
  static Expected<TrajectoryStore> create(const StoreOptions& options);
  TrajectoryStore(TrajectoryStore&&) = default;
  TrajectoryStore& operator=(TrajectoryStore&&) = default;

  /// Stores the `length` filled steps of a slab (more than T counts as T). What peers wrote is checked: see
  /// pack_item. Returns its id, or kNoItem where nothing was stored: no steps, or a failing disk
  /// (write_error()).
  /// `origin` ties it to the trajectory before it, for post_death_reward.
  ItemId append(const SlabView& slab, uint32_t length, const SlabOrigin& origin = {});
  /// append() in two halves: prepare checks and compresses and changes nothing a reader sees, commit takes
  /// the room and copies. The slab must not change between the two.
  void prepare(const SlabView& slab, uint32_t length);
  ItemId commit(const SlabView& slab, const SlabOrigin& origin = {});

  ItemId oldest() const { return end_ - item_count(); }
  ItemId end() const { return end_; }  ///< the next id
  bool contains(ItemId id) const { return id >= oldest() && id < end_; }
  StoredTrajectory item(ItemId id) const;

  int64_t item_count() const { return static_cast<int64_t>(slots_.size()); }
  int64_t transition_count() const { return transition_count_; }  ///< agent decisions of live items
  int64_t used_bytes() const { return used_bytes_; }              ///< of live items
  int64_t capacity_bytes() const { return options_.capacity_bytes; }
  int64_t broken_decisions() const { return broken_decisions_; }  ///< found so far
  /// Agent decisions that fit: from the bytes of what is stored, or of whole trajectories while it is empty.
  int64_t capacity_transitions() const;
  const StoreOptions& options() const { return options_; }
  const TrajectoryShape& shape() const { return options_.shape; }
  /// The first failure of the disk behind `file`; nothing is stored from then on where writing fails.
  const std::optional<Error>& write_error() const { return write_error_; }

  /// Requests an item's bytes ahead of time: all, its small fields, or the frames of rows first..last, of all
  /// agents or of one.
  void prefetch(ItemId id) const;
  void prefetch_head(ItemId id) const;
  void prefetch_rows(ItemId id, int first, int last, int agent = -1) const;
  /// Begins a measurement cold: see RingMemory.
  void forget_cached() const { memory_->forget_cached(); }
  /// The file behind the store, -1 in RAM.
  int descriptor() const { return memory_->descriptor(); }

  /// Writes the whole content beside `path` and renames it. Errors: kNoSpace, kNotFound, kSystem.
  Status save(const std::string& path) const;
  /// Replaces the content by a saved one; where it does not fit, the newest of it. Capacity, file and
  /// compression may differ from the saver's, the shape may not. Where capacity and compression agree, every
  /// byte comes back to its place, so that later evictions are the same. After an error the store is empty.
  /// Errors: kNotFound, kBadFormat (damaged, shortened, of another version), kBadInput (another shape),
  /// kNoSpace, kSystem.
  Status load(const std::string& path);

  /// The halves of save and load, for callers that add sections.
  int64_t snapshot_bytes() const;
  Status write(SnapshotWriter& writer) const;
  /// Reads header and items; the next section is the caller's.
  Status read(SnapshotReader& reader);
  void clear();

 private:
  struct Slot {
    int64_t offset = 0;
    int64_t bytes = 0;
    ItemForm form;
  };

  TrajectoryStore(const StoreOptions& options, RingMemory memory);
  std::optional<int64_t> take_room(int64_t byte_count, int64_t transitions);
  void evict_oldest();
  Status put_item(const ItemForm& form, std::span<const std::span<const std::byte>> parts,
                  int64_t offset = -1);
  void compress_frame(std::span<const uint8_t> frame, int64_t index);
  Status read_items(SnapshotReader& reader);
  Status adopt(const ItemForm& form, std::span<const std::byte> bytes, int64_t offset);
  Status add_late_reward(ItemId id, int agent, double amount);

  StoreOptions options_;
  std::unique_ptr<RingMemory> memory_;
  std::deque<Slot> slots_;  // oldest first
  std::vector<uint8_t> all_ones_;
  ItemId end_ = 0;
  int64_t write_offset_ = 0;
  int64_t transition_count_ = 0;
  int64_t used_bytes_ = 0;
  int64_t broken_decisions_ = 0;
  std::optional<Error> write_error_;
  PostDeathLedger ledger_;
  // What prepare() leaves for commit().
  PackedItem packed_;
  std::vector<std::byte> blocks_;
  int64_t block_bytes_ = 0;
};

}  // namespace comrad::replay
