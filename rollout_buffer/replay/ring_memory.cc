#include "rollout_buffer/replay/ring_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::replay {
namespace {

constexpr int64_t kPageBytes = 4096;

Error system_error(const std::string& what) {
  return Error{ErrorCode::kSystem, what + ": " + std::strerror(errno)};
}

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

std::string bytes_text(int64_t bytes) {
  std::array<char, 32> text{};
  const double mega = static_cast<double>(bytes) * 1e-6;
  std::snprintf(text.data(), text.size(), mega < 1e3 ? "%.1f MB" : "%.1f GB",
                mega < 1e3 ? mega : mega * 1e-3);
  return text.data();
}

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
  memory.data_ = static_cast<std::byte*>(address);
  memory.size_bytes_ = size_bytes;
  return memory;
}

Expected<RingMemory> RingMemory::in_file(const std::string& path, int64_t size_bytes) {
  RingMemory memory;
  memory.path_ = path;
  memory.descriptor_ = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (memory.descriptor_ < 0) {
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
  if (const int64_t free_bytes = free_disk_bytes(memory.descriptor_); file_bytes > free_bytes)
    return no_disk_space(path, file_bytes, free_bytes);
  int result = 0;
  do result = fallocate(memory.descriptor_, 0, 0, file_bytes);
  while (result != 0 && errno == EINTR);
  if (result != 0 && errno == ENOSPC)
    return no_disk_space(path, file_bytes, free_disk_bytes(memory.descriptor_));
  // A file system that cannot reserve blocks gives a sparse file; a full disk then shows in write().
  if (result != 0 && ftruncate(memory.descriptor_, file_bytes) != 0)
    return system_error("--replay_file " + path + ", setting its size to " + bytes_text(file_bytes));
  void* address =
      mmap(nullptr, static_cast<std::size_t>(file_bytes), PROT_READ, MAP_SHARED, memory.descriptor_, 0);
  if (address == MAP_FAILED) return system_error("mapping --replay_file " + path);
  // Draws jump about; what a draw needs is asked for in whole by prefetch().
  (void)madvise(address, static_cast<std::size_t>(file_bytes), MADV_RANDOM);
  memory.data_ = static_cast<std::byte*>(address);
  memory.size_bytes_ = file_bytes;
  return memory;
}

RingMemory::RingMemory(RingMemory&& other) noexcept
    : path_(std::move(other.path_)),
      data_(std::exchange(other.data_, nullptr)),
      size_bytes_(std::exchange(other.size_bytes_, 0)),
      descriptor_(std::exchange(other.descriptor_, -1)) {}

RingMemory& RingMemory::operator=(RingMemory&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(data_, other.data_);
  std::swap(size_bytes_, other.size_bytes_);
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

RingMemory::~RingMemory() {
  if (data_ != nullptr) munmap(data_, static_cast<std::size_t>(size_bytes_));
  if (descriptor_ >= 0) close(descriptor_);
}

Status RingMemory::write(int64_t offset, std::span<const std::span<const std::byte>> parts) {
  for (const std::span<const std::byte> part : parts) {
    COMRAD_CHECK(offset >= 0 && offset + static_cast<int64_t>(part.size()) <= size_bytes_,
                 "an item lies inside the replay's memory");
    if (!is_file()) {
      std::memcpy(data_ + offset, part.data(), part.size());
      offset += static_cast<int64_t>(part.size());
      continue;
    }
    for (std::size_t done = 0; done < part.size();) {
      const ssize_t count = pwrite(descriptor_, part.data() + done, part.size() - done, offset);
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
  const int64_t end = std::min(size_bytes_, offset + byte_count);
  (void)madvise(data_ + begin, static_cast<std::size_t>(end - begin), MADV_WILLNEED);
}

void RingMemory::forget_cached() const {
  if (!is_file()) return;
  (void)fdatasync(descriptor_);
  (void)madvise(data_, static_cast<std::size_t>(size_bytes_), MADV_DONTNEED);  // mapped pages are not dropped
  (void)posix_fadvise(descriptor_, 0, 0, POSIX_FADV_DONTNEED);
}

}  // namespace comrad::replay
