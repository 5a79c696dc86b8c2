#include "doomgen/layout/node_builder.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "rollout_buffer/core/files.h"

extern char** environ;

namespace comrad::doomgen {
namespace {

namespace fs = std::filesystem;

/// A folder that goes when it is no longer needed.
struct WorkFolder {
  std::string path;
  ~WorkFolder() {
    std::error_code ignored;
    if (!path.empty()) fs::remove_all(path, ignored);
  }
};

std::string read_all(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r' || text.back() == ' ')) text.pop_back();
  const std::size_t start = text.find_last_of("\r\n");
  return start == std::string::npos ? text : text.substr(start + 1);
}

}  // namespace

Expected<std::string> build_nodes(const std::string& wad) {
  std::error_code error;
  const fs::path parent = fs::temp_directory_path(error);
  if (error) return Error{ErrorCode::kSystem, "no folder for the node builder: " + error.message()};
  std::string pattern = (parent / "comrad-nodes-XXXXXX").string();
  WorkFolder folder;
  if (mkdtemp(pattern.data()) == nullptr) return system_error("no folder for the node builder: " + pattern);
  folder.path = pattern;
  const std::string input = folder.path + "/in.wad", output = folder.path + "/out.wad",
                    words = folder.path + "/words";
  COMRAD_TRY(write_file_atomically(input, wad, /*durable=*/false));

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, words.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                   0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  std::string program = "zdbsp", option = "-o", out = output, in = input;
  const std::array<char*, 5> arguments{program.data(), option.data(), out.data(), in.data(), nullptr};
  pid_t child = 0;
  const int spawned = posix_spawnp(&child, "zdbsp", &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (spawned == ENOENT)
    return Error{
        ErrorCode::kNotFound,
        "zdbsp is not installed, which --nodes needs; install the package zdbsp, or leave --nodes out "
        "(neither COMRAD nor ViZDoom needs nodes)"};
  if (spawned != 0)
    return Error{ErrorCode::kSystem, "zdbsp cannot be started: " + std::string(std::strerror(spawned))};
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
    return Error{ErrorCode::kBadInput, "zdbsp refuses the map: " + last_line(read_all(words))};
  std::string bytes = read_all(output);
  if (bytes.empty()) return Error{ErrorCode::kBadInput, "zdbsp wrote nothing: " + last_line(read_all(words))};
  return bytes;
}

}  // namespace comrad::doomgen
