#include "deploy/process/process_time.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <system_error>

#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxGenerations = 8;  // what /proc contains may change while it is read

double seconds_of(pid_t pid, int generations) {
  const fs::path folder = fmt::format("/proc/{}", pid);
  double seconds = process_seconds(read_file((folder / "stat").string()).value_or(""));
  std::error_code ended;
  for (fs::directory_iterator thread(folder / "task", ended), last;
       !ended && generations > 0 && thread != last; thread.increment(ended)) {
    std::ifstream children(thread->path() / "children");
    for (pid_t child = 0; children >> child;) seconds += seconds_of(child, generations - 1);
  }
  return seconds;
}

}  // namespace

double process_seconds(std::string_view proc_pid_stat) {
  // The name may hold spaces and parentheses; the numbers begin behind the last one.
  const std::size_t name_end = proc_pid_stat.rfind(')');
  if (name_end == std::string_view::npos) return 0;
  std::istringstream words{std::string(proc_pid_stat.substr(name_end + 1))};
  std::string skipped;
  for (int field = 3; field < 14; ++field) words >> skipped;  // numbered as in proc(5)
  double user = 0, system = 0, children_user = 0, children_system = 0;
  if (!(words >> user >> system >> children_user >> children_system)) return 0;
  return (user + system + children_user + children_system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

double family_seconds(pid_t pid) { return seconds_of(pid, kMaxGenerations); }

}  // namespace comrad::deploy
