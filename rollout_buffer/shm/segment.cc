#include "rollout_buffer/shm/segment.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <vector>

#include "rollout_buffer/core/control_group.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::shm {
namespace {

constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;
constexpr int64_t kUnlimited = std::numeric_limits<int64_t>::max();

std::optional<int64_t> read_number(const std::string& path) {
  std::ifstream file(path);
  int64_t value = 0;
  if (!(file >> value)) return std::nullopt;
  return value;
}

/// The value behind `key` in a file of "key value" lines (memory.stat, /proc/meminfo).
std::optional<int64_t> read_entry(const std::string& path, const std::string& key) {
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) {
    std::istringstream words(line);
    std::string name;
    int64_t value = 0;
    if (words >> name >> value && name == key) return value;
  }
  return std::nullopt;
}

/// Bytes left below one control group's limit. Clean file cache counts as free: the kernel drops it first.
int64_t group_room(const std::string& folder, const char* limit_name, const char* usage_name,
                   const char* cache_key) {
  const std::optional<int64_t> limit = read_number(folder + "/" + limit_name);
  const std::optional<int64_t> usage = read_number(folder + "/" + usage_name);
  if (!limit || !usage) return kUnlimited;  // "max", or no such file
  return std::max<int64_t>(0, *limit - *usage + read_entry(folder + "/memory.stat", cache_key).value_or(0));
}

/// The tightest limit among this process's memory control group and its parents, version 1 and 2.
int64_t control_group_room() {
  int64_t room = kUnlimited;
  for (const ControlGroup& group : own_control_groups("memory"))
    room = std::min(room, group.is_version_2
                              ? group_room(group.folder, "memory.max", "memory.current", "inactive_file")
                              : group_room(group.folder, "memory.limit_in_bytes", "memory.usage_in_bytes",
                                           "total_inactive_file"));
  return room;
}

/// What may still be taken, read once: a second reading of a control group may differ from the first.
struct FreeMemory {
  int64_t bytes = 0;
  bool is_limited_by_group = false;
};

FreeMemory free_memory() {
  const std::optional<int64_t> available_kb = read_entry("/proc/meminfo", "MemAvailable:");
  const int64_t available = available_kb ? *available_kb * 1024 : kUnlimited;
  const int64_t room = control_group_room();
  return {std::min(available, room), room <= available};
}

}  // namespace

int64_t free_memory_bytes() { return free_memory().bytes; }

Expected<Segment> Segment::create(const std::string& name, int64_t size_bytes) {
  if (size_bytes <= 0)
    return Error{ErrorCode::kBadInput, "shared memory " + name + ": its size must be positive"};
  const FreeMemory free = free_memory();
  if (size_bytes > free.bytes)
    return Error{ErrorCode::kNoSpace,
                 "shared memory " + name + " needs " + bytes_text(size_bytes) + ", but only " +
                     bytes_text(free.bytes) + " is free" +
                     (free.is_limited_by_group ? " below the memory limit of the control group" : "") +
                     "; lower --trajectory_slabs, --num_workers, --num_envs_per_worker, "
                     "--batch_size or --rollout, or free memory"};
  Segment segment;
  segment.mapping_.descriptor = memfd_create(name.c_str(), MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (segment.mapping_.descriptor < 0) return system_error("memfd_create " + name);
  // Pages are taken on first touch; the size alone is fixed here, and for good.
  if (ftruncate(segment.mapping_.descriptor, size_bytes) != 0)
    return file_error("shared memory " + name + ", setting its size", errno);
  if (fcntl(segment.mapping_.descriptor, F_ADD_SEALS, kSeals) != 0)
    return system_error("shared memory " + name + ", sealing");
  COMRAD_TRY(segment.map(size_bytes));
  return segment;
}

Expected<Segment> Segment::adopt(int descriptor) {
  Segment segment;
  segment.mapping_.descriptor = descriptor;
  const int seals = fcntl(descriptor, F_GET_SEALS);
  if (seals < 0 || (seals & kSeals) != kSeals)
    return Error{ErrorCode::kBadFormat, "shared memory from a peer is not a memfd sealed against resizing"};
  struct stat facts {};
  if (fstat(descriptor, &facts) != 0) return system_error("shared memory from a peer");
  if (facts.st_size <= 0) return Error{ErrorCode::kBadFormat, "shared memory from a peer is empty"};
  COMRAD_TRY(segment.map(facts.st_size));
  return segment;
}

Status Segment::map(int64_t size_bytes) {
  void* address = mmap(nullptr, static_cast<std::size_t>(size_bytes), PROT_READ | PROT_WRITE, MAP_SHARED,
                       mapping_.descriptor, 0);
  if (address == MAP_FAILED) return system_error("mapping " + bytes_text(size_bytes) + " of shared memory");
  mapping_.data = static_cast<std::byte*>(address);
  mapping_.size_bytes = size_bytes;
  return {};
}

}  // namespace comrad::shm
