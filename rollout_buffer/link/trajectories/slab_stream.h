// A trajectory slab on its way to another host: cut into fragments of LZ4 here, put together again in a slab of the
// learner's arena there. What arrives is hostile until it is whole and checked. Stages: seal, drain.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {

/// Cuts one slab after the other. Final observations that no episode of the slab used stay at home. Threads: one.
class SlabCutter {
 public:
  explicit SlabCutter(const SlabOffsets& offsets) : offsets_(offsets) {}

  /// From now on fragments of this slab are cut, whose bytes stay unchanged meanwhile. Ids and counts of `name` but for
  /// what begins with fragment, offset, raw, checksum and payload are those of all its fragments.
  void begin(const SlabView& slab, const shm::SlabHeader& header, const dds::TrajectoryFragment& name);
  uint32_t fragment_count() const { return static_cast<uint32_t>(pieces_.size()); }
  /// Valid until the next call.
  dds::TrajectoryFragment cut(uint32_t index);

 private:
  struct Piece {
    int64_t offset_bytes;
    int64_t bytes;
  };
  const SlabOffsets& offsets_;
  const std::byte* base_ = nullptr;
  dds::TrajectoryFragment name_;
  std::vector<Piece> pieces_;
  std::vector<std::byte> payload_;
};

/// Puts one slab after the other together. Threads: one.
class SlabAssembler {
 public:
  explicit SlabAssembler(const SlabOffsets& offsets) : offsets_(offsets) {}

  /// What comes next goes into `slab`, which is not read until take() returns true.
  void begin(const SlabView& slab);
  /// The fragment that take() waits for.
  uint32_t next_index() const { return next_index_; }

  /// Takes the fragments of one slab in their order. True once it is whole and sound. Never writes outside of the slab.
  /// Errors: kBadFormat for a fragment that does not continue the slab, is damaged, or ends one that could not have been
  /// played; the slab must begin anew.
  Expected<bool> take(const dds::TrajectoryFragment& fragment);

 private:
  Status place(const dds::TrajectoryFragment& fragment);
  Status check(uint32_t length) const;

  const SlabOffsets& offsets_;
  std::byte* base_ = nullptr;
  uint32_t next_index_ = 0, fragment_count_ = 0;
  int64_t position_ = 0;  // bytes before it are there
  int finals_ = 0;        // final observations that came
};

/// What of the slab's final observations lies between two parts that travel: [begin, end), for `finals` that are used.
struct Hole {
  int64_t begin;
  int64_t end;
};
Hole hole_of(const SlabOffsets& offsets, int finals);

}  // namespace comrad::link
