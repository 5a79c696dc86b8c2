#include "rollout_buffer/replay/ring_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::replay {
namespace {

constexpr int64_t kPageBytes = 4096;

Error no_disk_space(const std::string& path, int64_t size_bytes, int64_t free_bytes) {
  return Error{ErrorCode::kNoSpace, "the replay's file " + path + " needs " + bytes_text(size_bytes) +
                                        ", but only " + bytes_text(free_bytes) +
                                        " is free on its disk; lower --replay_gb, or name another disk with "
                                        "--replay_file"};
}

int64_t free_disk_bytes(int descriptor) {
  struct statvfs facts {};
  if (fstatvfs(descriptor, &facts) != 0) return 0;
  return static_cast<int64_t>(facts.f_bavail) * static_cast<int64_t>(facts.f_frsize);
}

}  // namespace

Expected<RingMemory> RingMemory::in_ram(int64_t size_bytes) {
  const int64_t free_bytes = shm::free_memory_bytes();
  if (size_bytes > free_bytes)
    return Error{ErrorCode::kNoSpace,
                 "the replay needs " + bytes_text(size_bytes) + " of memory, but only " +
                     bytes_text(free_bytes) +
                     " is free; lower --replay_gb, or put it on a disk with --replay_file"};
  void* address = mmap(nullptr, static_cast<std::size_t>(size_bytes), PROT_READ | PROT_WRITE,
                       MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (address == MAP_FAILED) return system_error("mapping " + bytes_text(size_bytes) + " for the replay");
  (void)madvise(address, static_cast<std::size_t>(size_bytes), MADV_HUGEPAGE);  // fewer faults and TLB misses
  RingMemory memory;
  memory.mapping_.data = static_cast<std::byte*>(address);
  memory.mapping_.size_bytes = size_bytes;
  return memory;
}

Expected<RingMemory> RingMemory::in_file(const std::string& path, int64_t size_bytes) {
  RingMemory memory;
  memory.path_ = path;
  memory.mapping_.descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (memory.mapping_.descriptor < 0) {
    if (errno == EEXIST || errno == EISDIR)
      return Error{ErrorCode::kBadInput,
                   "--replay_file " + path +
                       ": there is something of that name; the replay makes its file anew, "
                       "so name a path that is free"};
    if (errno == ENOENT || errno == ENOTDIR)
      return Error{ErrorCode::kNotFound, "--replay_file " + path + ": its folder does not exist"};
    return system_error("--replay_file " + path + " cannot be made");
  }
  (void)unlink(path.c_str());
  const int64_t file_bytes = (size_bytes + kPageBytes - 1) / kPageBytes * kPageBytes;
  if (const int64_t free_bytes = free_disk_bytes(memory.mapping_.descriptor); file_bytes > free_bytes)
    return no_disk_space(path, file_bytes, free_bytes);
  int result = 0;
  do result = fallocate(memory.mapping_.descriptor, 0, 0, file_bytes);
  while (result != 0 && errno == EINTR);
  if (result != 0 && errno == ENOSPC)
    return no_disk_space(path, file_bytes, free_disk_bytes(memory.mapping_.descriptor));
  // A file system that cannot reserve blocks gives a sparse file; a full disk then shows in write().
  if (result != 0 && ftruncate(memory.mapping_.descriptor, file_bytes) != 0)
    return system_error("--replay_file " + path + ", setting its size to " + bytes_text(file_bytes));
  void* address = mmap(nullptr, static_cast<std::size_t>(file_bytes), PROT_READ, MAP_SHARED,
                       memory.mapping_.descriptor, 0);
  if (address == MAP_FAILED) return system_error("mapping --replay_file " + path);
  // Draws jump about; what a draw needs is requested in whole by prefetch().
  (void)madvise(address, static_cast<std::size_t>(file_bytes), MADV_RANDOM);
  memory.mapping_.data = static_cast<std::byte*>(address);
  memory.mapping_.size_bytes = file_bytes;
  return memory;
}

Status RingMemory::write(int64_t offset, std::span<const std::span<const std::byte>> parts) {
  for (const std::span<const std::byte> part : parts) {
    COMRAD_CHECK(offset >= 0 && offset + static_cast<int64_t>(part.size()) <= mapping_.size_bytes,
                 "an item lies inside the replay's memory");
    if (!is_file()) {
      std::memcpy(mapping_.data + offset, part.data(), part.size());
      offset += static_cast<int64_t>(part.size());
      continue;
    }
    for (std::size_t done = 0; done < part.size();) {
      const ssize_t count = pwrite(mapping_.descriptor, part.data() + done, part.size() - done, offset);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0 && errno == ENOSPC)
        return Error{ErrorCode::kNoSpace, "the disk of --replay_file " + path_ + " is full"};
      if (count <= 0) return system_error("writing --replay_file " + path_);
      done += static_cast<std::size_t>(count);
      offset += count;
    }
  }
  return {};
}

void RingMemory::prefetch(int64_t offset, int64_t byte_count) const {
  if (!is_file() || byte_count <= 0) return;
  const int64_t begin = offset / kPageBytes * kPageBytes;
  const int64_t end = std::min(mapping_.size_bytes, offset + byte_count);
  (void)madvise(mapping_.data + begin, static_cast<std::size_t>(end - begin), MADV_WILLNEED);
}

void RingMemory::forget_cached() const {
  if (!is_file()) return;
  (void)fdatasync(mapping_.descriptor);
  (void)madvise(mapping_.data, static_cast<std::size_t>(mapping_.size_bytes),
                MADV_DONTNEED);  // mapped pages are not dropped
  (void)posix_fadvise(mapping_.descriptor, 0, 0, POSIX_FADV_DONTNEED);
}

}  // namespace comrad::replay
