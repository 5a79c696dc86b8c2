#include "rollout_buffer/replay/snapshot_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::replay {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSummedHeaderBytes = offsetof(SectionHeader, header_sum);

Error disk_error(const std::string& what, const std::string& path) {
  return file_error(what + " replay snapshot " + path, errno);
}

std::string folder_of(const std::string& path) {
  const std::string folder = fs::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

std::span<const std::byte> as_bytes_of(const SectionHeader& header,
                                       std::size_t count = sizeof(SectionHeader)) {
  return {reinterpret_cast<const std::byte*>(&header), count};
}

}  // namespace

Expected<SnapshotWriter> SnapshotWriter::create(const std::string& path, int64_t expected_bytes) {
  struct statvfs facts {};
  if (statvfs(folder_of(path).c_str(), &facts) != 0) return disk_error("cannot write", path);
  const int64_t free_bytes = static_cast<int64_t>(facts.f_bavail) * static_cast<int64_t>(facts.f_frsize);
  if (expected_bytes > free_bytes)
    return Error{ErrorCode::kNoSpace, "replay snapshot " + path + " needs " + bytes_text(expected_bytes) +
                                          ", but only " + bytes_text(free_bytes) +
                                          " is free on its disk; free space, or lower --replay_gb"};
  SnapshotWriter writer;
  writer.path_ = path;
  writer.temporary_ = path + ".new";
  writer.descriptor_ = open(writer.temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (writer.descriptor_ < 0) return disk_error("cannot write", path);
  return writer;
}

SnapshotWriter::SnapshotWriter(SnapshotWriter&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_(std::move(other.temporary_)),
      descriptor_(std::exchange(other.descriptor_, -1)) {}

SnapshotWriter::~SnapshotWriter() {
  if (descriptor_ < 0) return;
  close(descriptor_);
  (void)unlink(temporary_.c_str());
}

Status SnapshotWriter::put(std::span<const std::byte> bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t count = ::write(descriptor_, bytes.data() + done, bytes.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return disk_error("cannot write", path_);
    done += static_cast<std::size_t>(count);
  }
  return {};
}

Status SnapshotWriter::write(SectionHeader header, std::span<const std::byte> bytes) {
  header.bytes = bytes.size();
  header.bytes_sum = checksum64(bytes);
  header.header_sum = checksum64(as_bytes_of(header, kSummedHeaderBytes));
  COMRAD_TRY(put(as_bytes_of(header)));
  return put(bytes);
}

Status SnapshotWriter::finish() {
  COMRAD_TRY(write({.tag = static_cast<uint32_t>(SectionTag::kEnd)}, {}));
  if (fsync(descriptor_) != 0) return disk_error("cannot fsync", path_);
  if (rename(temporary_.c_str(), path_.c_str()) != 0) return disk_error("cannot rename", path_);
  close(std::exchange(descriptor_, -1));
  const int folder = open(folder_of(path_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return disk_error("cannot fsync the folder of", path_);
  const bool synced = fsync(folder) == 0;
  close(folder);
  return synced ? Status() : Status(disk_error("cannot fsync the folder of", path_));
}

Expected<SnapshotReader> SnapshotReader::open(const std::string& path) {
  SnapshotReader reader;
  reader.path_ = path;
  reader.descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat facts {};
  if (reader.descriptor_ < 0 || fstat(reader.descriptor_, &facts) != 0)
    return disk_error("cannot read", path);
  if (!S_ISREG(facts.st_mode)) return Error{ErrorCode::kBadFormat, path + " is no file"};
  reader.left_bytes_ = facts.st_size;
  (void)posix_fadvise(reader.descriptor_, 0, 0, POSIX_FADV_SEQUENTIAL);
  return reader;
}

SnapshotReader::SnapshotReader(SnapshotReader&& other) noexcept
    : path_(std::move(other.path_)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      left_bytes_(other.left_bytes_) {}

SnapshotReader::~SnapshotReader() {
  if (descriptor_ >= 0) close(descriptor_);
}

Status SnapshotReader::get(std::span<std::byte> bytes) {
  const Error shortened{ErrorCode::kBadFormat, path_ + ": replay snapshot ends too early; it was cut short"};
  if (static_cast<int64_t>(bytes.size()) > left_bytes_) return shortened;
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t count = read(descriptor_, bytes.data() + done, bytes.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return disk_error("cannot read", path_);
    if (count == 0) return shortened;
    done += static_cast<std::size_t>(count);
  }
  left_bytes_ -= static_cast<int64_t>(bytes.size());
  return {};
}

Expected<SectionHeader> SnapshotReader::next(std::vector<std::byte>& bytes) {
  SectionHeader header;
  COMRAD_TRY(get({reinterpret_cast<std::byte*>(&header), sizeof header}));
  const Error damaged{ErrorCode::kBadFormat,
                      path_ + ": replay snapshot is damaged (a checksum does not match)"};
  if (header.header_sum != checksum64(as_bytes_of(header, kSummedHeaderBytes))) return damaged;
  if (header.bytes > static_cast<uint64_t>(left_bytes_))
    return Error{ErrorCode::kBadFormat, path_ + ": replay snapshot ends too early; it was cut short"};
  bytes.resize(static_cast<std::size_t>(header.bytes));
  COMRAD_TRY(get(bytes));
  if (header.bytes_sum != checksum64(bytes)) return damaged;
  return header;
}

bool SnapshotReader::peek(std::span<std::byte> bytes) const {
  return pread(descriptor_, bytes.data(), bytes.size(), sizeof(SectionHeader)) ==
         static_cast<ssize_t>(bytes.size());
}

Status SnapshotReader::expect_end() const {
  if (left_bytes_ == 0) return {};
  return Error{ErrorCode::kBadFormat, path_ + ": replay snapshot continues behind its end"};
}

}  // namespace comrad::replay
