// A replay on disk between two runs: sections with a checksum each, written beside the old file and renamed
// when all is on the disk. A reader believes nothing that it did not check.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::replay {

enum class SectionTag : uint32_t { kHeader = 1, kItem = 2, kSampler = 3, kEnd = 4 };

/// Stands before the bytes of a section.
struct SectionHeader {
  uint32_t tag = 0;
  uint32_t flags = 0;       ///< of an item: bit 0 mask, 1 recurrent state, 2 compressed, 3 late rewards
  int32_t length = 0;       ///< of an item
  int32_t finals = 0;       ///< of an item
  int64_t id = 0;           ///< of an item
  int64_t offset = 0;       ///< of an item, in the ring it was in
  uint64_t bytes = 0;       ///< that follow
  uint64_t bytes_sum = 0;   ///< checksum64 of them; another checksum bumps kSnapshotVersion
  uint64_t header_sum = 0;  ///< checksum64 of the fields above
};
static_assert(sizeof(SectionHeader) == 56, "changing this bumps kSnapshotVersion");

class SnapshotWriter {
 public:
  /// Opens `path`.new. `expected_bytes` must be free on the disk.
  /// Errors: kNoSpace (needed, free, what to do), kNotFound (no such folder), kSystem.
  static Expected<SnapshotWriter> create(const std::string& path, int64_t expected_bytes);
  SnapshotWriter(SnapshotWriter&& other) noexcept;
  SnapshotWriter& operator=(SnapshotWriter&&) = delete;
  /// Removes what was not finished.
  ~SnapshotWriter();

  /// Appends a section; sums and sizes are filled in here. Errors: kNoSpace, kSystem.
  Status write(SectionHeader header, std::span<const std::byte> bytes);
  /// Ends the file, syncs it and gives it its name. Errors: kNoSpace, kSystem.
  Status finish();

 private:
  SnapshotWriter() = default;
  Status put(std::span<const std::byte> bytes);
  std::string path_;
  std::string temporary_;
  int descriptor_ = -1;
};

class SnapshotReader {
 public:
  /// Errors: kNotFound, kSystem.
  static Expected<SnapshotReader> open(const std::string& path);
  SnapshotReader(SnapshotReader&& other) noexcept;
  SnapshotReader& operator=(SnapshotReader&&) = delete;
  ~SnapshotReader();

  /// The next section; `bytes` gets its content. A section longer than what is left of the file is refused
  /// before anything is allocated. Errors: kBadFormat (damaged, shortened), kSystem.
  Expected<SectionHeader> next(std::vector<std::byte>& bytes);
  /// The first bytes of the first section's content, unchecked: which decides how the rest is checked. False where
  /// the file is shorter. The next section stays the next one.
  bool peek(std::span<std::byte> bytes) const;
  /// Nothing follows. Errors: kBadFormat.
  Status expect_end() const;
  const std::string& path() const { return path_; }

 private:
  SnapshotReader() = default;
  Status get(std::span<std::byte> bytes);
  std::string path_;
  int descriptor_ = -1;
  int64_t left_bytes_ = 0;
};

}  // namespace comrad::replay
