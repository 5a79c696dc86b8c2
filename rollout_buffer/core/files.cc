#include "rollout_buffer/core/files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>

namespace comrad {

Error system_error(const std::string& what) {
  return Error{ErrorCode::kSystem, what + ": " + std::strerror(errno)};
}

Error file_error(const std::string& what, int code) {
  const bool is_full = code == ENOSPC || code == EDQUOT;
  return Error{
      is_full ? ErrorCode::kNoSpace : ErrorCode::kSystem,
      what + ": " + std::strerror(code) + (is_full ? "; free disk space or choose another --train_dir" : "")};
}

std::optional<std::string> read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  if (!file || !(bytes << file.rdbuf())) return std::nullopt;
  return std::move(bytes).str();
}

Status write_file_atomically(const std::string& path, std::string_view text, bool durable) {
  const std::string temporary = path + ".tmp";
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) return file_error("cannot write " + temporary, errno);
  int code = 0;
  for (std::size_t done = 0; done < text.size() && code == 0;) {
    const ssize_t written = write(file, text.data() + done, text.size() - done);
    if (written > 0) done += static_cast<std::size_t>(written);
    if (written < 0 && errno != EINTR) code = errno;
  }
  if (code == 0 && durable && fsync(file) != 0) code = errno;
  if (close(file) != 0 && code == 0) code = errno;
  if (code == 0 && rename(temporary.c_str(), path.c_str()) != 0) code = errno;
  if (code == 0) return {};
  unlink(temporary.c_str());
  return file_error("cannot write " + path, code);
}

}  // namespace comrad
