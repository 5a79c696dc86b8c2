#include "rollout_buffer/core/files.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "rollout_buffer/core/descriptor.h"

namespace comrad {

namespace {

/// A rename is on the disk when its folder is.
Status sync_folder(const std::string& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const int code = descriptor < 0 || fsync(descriptor) != 0 ? errno : 0;
  if (descriptor >= 0) close(descriptor);
  return code == 0 ? Status() : file_error("cannot write folder " + folder, code);
}

}  // namespace

Error system_error(const std::string& what) {
  return Error{ErrorCode::kSystem, what + ": " + std::strerror(errno)};
}

Error file_error(const std::string& what, int code) {
  const bool is_full = code == ENOSPC || code == EDQUOT || code == EFBIG;
  const bool is_missing = code == ENOENT || code == ENOTDIR;
  const char* what_to_do = code == EFBIG ? "; raise the limit of file size (ulimit -f)"
                           : is_full     ? "; free disk space or write elsewhere"
                                         : "";
  return Error{is_full      ? ErrorCode::kNoSpace
               : is_missing ? ErrorCode::kNotFound
                            : ErrorCode::kSystem,
               what + ": " + std::strerror(code) + what_to_do};
}

std::optional<std::string> read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  if (!file || !(bytes << file.rdbuf())) return std::nullopt;
  return std::move(bytes).str();
}

Expected<std::string> read_short_file(const std::string& path, std::size_t max_bytes) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.is_open()) return file_error("cannot read " + path, errno);
  struct stat kind {};
  if (fstat(file.get(), &kind) != 0) return file_error("cannot read " + path, errno);
  if (!S_ISREG(kind.st_mode) && !S_ISFIFO(kind.st_mode))
    return Error{ErrorCode::kBadFormat, path + ": is no file"};
  std::string bytes;
  char block[65536];
  while (bytes.size() <= max_bytes) {
    const ssize_t count = ::read(file.get(), block, sizeof block);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return file_error("cannot read " + path, errno);
    if (count == 0) return bytes;
    bytes.append(block, static_cast<std::size_t>(count));
  }
  return Error{ErrorCode::kBadFormat, fmt::format("{}: longer than {} kB", path, max_bytes >> 10)};
}

Status write_all(int descriptor, std::string_view bytes, const std::string& path) {
  while (!bytes.empty()) {
    const ssize_t count = ::write(descriptor, bytes.data(), bytes.size());
    if (count < 0 && errno != EINTR) return file_error("cannot write " + path, errno);
    if (count > 0) bytes.remove_prefix(static_cast<std::size_t>(count));
  }
  return {};
}

Status write_file_atomically(const std::string& path, std::string_view bytes, bool durable) {
  const std::size_t slash = path.find_last_of('/');
  const std::string folder = slash == std::string::npos ? "./" : path.substr(0, slash + 1);
  const std::string temporary =
      fmt::format("{}{}{}-{}", folder, kHalfWrittenMark, getpid(), path.substr(slash + 1));  // npos + 1 is 0
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) return file_error("cannot write " + path, errno);
  Status written = write_all(file, bytes, path);
  const auto require = [&](int result) {
    if (written && result != 0) written = file_error("cannot write " + path, errno);
  };
  if (written && durable) require(fsync(file));
  require(close(file));
  if (written) require(rename(temporary.c_str(), path.c_str()));
  if (!written) {
    unlink(temporary.c_str());
    return written;
  }
  return durable ? sync_folder(folder) : Status();
}

Expected<std::vector<std::string>> files_with_extension(const std::string& folder,
                                                        std::string_view extension) {
  std::vector<std::string> paths;
  std::error_code failed;
  for (const auto& entry : std::filesystem::directory_iterator(folder, failed))
    if (entry.path().extension() == extension) paths.push_back(entry.path().string());
  if (failed) return file_error(folder, failed.value());
  std::ranges::sort(paths);
  return paths;
}

std::string data_dir() {
  if (const char* home = std::getenv("COMRAD_HOME"); home != nullptr && *home != '\0') return home;
  // An installed prefix may be moved, so its place is requested, not compiled in.
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  if (folder.filename() == "comrad" && folder.parent_path().filename() == "libexec")
    return (folder.parent_path().parent_path() / "share/comrad").string();
  return COMRAD_SOURCE_DIR;
}

}  // namespace comrad
