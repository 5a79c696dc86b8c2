#include "deploy/tools/machine_check.h"

#include <spdlog/fmt/fmt.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "deploy/process/child_program.h"
#include "deploy/process/process_start.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/temporary_run.h"
#include "deploy/tools/libtorch_check.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr double kGigabyte = 1024.0 * 1024 * 1024;
constexpr double kBytesPerTorchProcess = 0.6 * kGigabyte;  // resident size of a policy worker or learner
constexpr double kBytesPerSimulator = 0.2 * kGigabyte;

CheckResult ok(std::string name, std::string found) {
  return {std::move(name), CheckLevel::kOk, std::move(found), {}};
}
CheckResult warn(std::string name, std::string found, std::string action) {
  return {std::move(name), CheckLevel::kWarn, std::move(found), std::move(action)};
}
CheckResult fail(std::string name, std::string found, std::string action) {
  return {std::move(name), CheckLevel::kFail, std::move(found), std::move(action)};
}

std::string gigabytes(double bytes) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f GB", bytes / kGigabyte);
  return text;
}

/// The first number in a file of /proc or /sys, or `otherwise`.
double number_in(const std::string& path, double otherwise) {
  std::ifstream file(path);
  double number = 0;
  return file >> number ? number : otherwise;
}

double meminfo_bytes(const std::string& key) {
  std::ifstream file("/proc/meminfo");
  std::string word;
  double kilobytes = 0;
  while (file >> word)
    if (word == key + ":" && file >> kilobytes) return kilobytes * 1024;
  return 0;
}

Expected<MergedSettings> default_run() { return merge_new({}, describe_scenario, usable_cores()); }

/// Runs a worker's own bench for a second; the decisions per second it reports, or why not.
Expected<double> one_second(const std::string& program, const std::vector<std::string>& more) {
  COMRAD_TRY_ASSIGN(MergedSettings merged, default_run());
  COMRAD_TRY_ASSIGN(const TemporaryRun run, TemporaryRun::create(merged.config));
  std::vector<std::string> command = {sibling_program(program), "--run_dir", run.path(), "--bench", "1"};
  command.insert(command.end(), more.begin(), more.end());
  COMRAD_TRY_ASSIGN(const ProgramResult result,
                    run_program(command, {.timeout_s = 60, .environment = sleeping_threads()}));
  if (result.exit_code != 0)
    return Error{ErrorCode::kSystem, fmt::format("{} ended with exit code {}: {}", program, result.exit_code,
                                                 last_words(result))};
  const auto measured = nlohmann::json::parse(result.output, nullptr, false);
  if (!measured.is_object() || !measured.contains("decisions_per_s") ||
      !measured["decisions_per_s"].is_number())
    return Error{ErrorCode::kBadFormat, program + " reported no decisions_per_s"};
  return measured["decisions_per_s"].get<double>();
}

std::string per_second(double rate) {
  return fmt::format("{} decisions/s in a try of 1 s", static_cast<long>(rate));
}

/// The first word of each line of a list in deploy/: a package. Comments begin with #.
Expected<std::vector<std::string>> entries_of(const std::string& list) {
  const std::string path = data_dir() + "/" + list;
  std::ifstream file(path);
  if (!file) return Error{ErrorCode::kNotFound, "no " + path};
  std::vector<std::string> entries;
  for (std::string line; std::getline(file, line);) {
    line.erase(std::min(line.find_first_of("# \t\r"), line.size()));
    if (!line.empty()) entries.push_back(line);
  }
  return entries;
}

/// The folder of the PyTorch that the build was configured with; empty: Debian's libtorch, or an installed program.
std::string built_with_torch() {
  std::ifstream cache(build_folder() + "/CMakeCache.txt");
  const std::string key = "COMRAD_TORCH:PATH=";
  for (std::string line; std::getline(cache, line);)
    if (line.starts_with(key)) return line.substr(key.size());
  return "";
}

/// Which Debian packages of a list in deploy/ are installed. `action` stands before the command that installs the others.
CheckResult check_package_list(const std::string& name, const std::string& file, const std::string& action) {
  const std::string list = "deploy/" + file;
  auto wanted = entries_of(list);
  if (!wanted) return warn(name, wanted.error().message, "set COMRAD_HOME to the source folder");
  if (!built_with_torch().empty()) std::erase(*wanted, "libtorch-dev");
  std::vector<std::string> command = {"dpkg-query", "-W", "-f", "${Package} ${db:Status-Status}\n"};
  command.insert(command.end(), wanted->begin(), wanted->end());
  const auto listed = run_program(command);
  if (!listed) return warn(name, "no dpkg here", "install the packages that " + list + " lists");
  std::string missing;
  for (const std::string& package : *wanted)
    if (("\n" + listed->output).find("\n" + package + " installed") == std::string::npos)
      missing += " " + package;
  if (missing.empty()) return ok(name, fmt::format("{}: all {}", list, wanted->size()));
  return warn(name, list + ", missing:" + missing,
              action + "apt-get install --no-install-recommends" + missing);
}

}  // namespace

CheckResult check_packages() { return check_package_list("packages", "packages.txt", ""); }

CheckResult check_report_packages() {
  return check_package_list("report packages", "packages_report.txt",
                            is_installed() ? "" : "./comrad report installs them: ");
}

CheckResult check_test_packages() {
  return check_package_list("test packages", "packages_test.txt", "./comrad test installs them: ");
}

CheckResult check_test_python() {
  const std::string name = "test python", list = "deploy/requirements_test.txt";
  const auto wanted = entries_of(list);
  if (!wanted) return warn(name, wanted.error().message, "set COMRAD_HOME to the source folder");
  const char* chosen = std::getenv("COMRAD_TEST_PYTHON");
  std::error_code error;
  std::string python = build_folder() + "/test-python/bin/python";
  if (chosen != nullptr && *chosen != '\0') {
    python = chosen;
  } else if (!fs::exists(python, error)) {
    python = "python3";
  }
  // Prints those of its arguments, NAME==VERSION, that are not installed in that version (or in a build of it: 1.0+cpu).
  std::vector<std::string> command = {python, "-c", R"python(
import importlib.metadata, sys
for wanted in sys.argv[1:]:
    name, _, version = wanted.partition("==")
    try:
        found = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        found = ""
    if not found or version and found.partition("+")[0] != version:
        print(wanted + (" (there: " + found + ")" if found else ""))
)python"};
  ;
  command.insert(command.end(), wanted->begin(), wanted->end());
  const auto asked = run_program(command);
  const std::string action =
      "./comrad test installs them, or set COMRAD_TEST_PYTHON to a Python that has them";
  if (!asked || asked->exit_code != 0)
    return warn(
        name, list + ": " + python + " does not run: " + (asked ? last_words(*asked) : asked.error().message),
        action);
  std::vector<std::string> missing;
  std::istringstream lines(asked->output);
  for (std::string line; std::getline(lines, line);) missing.push_back(line);
  if (!missing.empty()) return warn(name, list + ", missing in " + python + ": " + joined(missing), action);
  return ok(name, fmt::format("{}: all {} in {}", list, wanted->size(), python));
}

CheckResult check_iwad() {
  const auto iwad = find_iwad();
  return iwad ? ok("iwad", *iwad) : fail("iwad", iwad.error().message, "apt-get install freedoom");
}

CheckResult check_blas() {
  const std::string name = "blas";
  if (const std::string torch = built_with_torch(); !torch.empty())
    return ok(name, "that of the PyTorch in " + torch);
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/etc/alternatives", error)) {
    const std::string link = entry.path().filename().string();
    if (!link.starts_with("libblas.so.3")) continue;
    const std::string target = fs::canonical(entry.path(), error).string();
    if (target.find("openblas") != std::string::npos || target.find("mkl") != std::string::npos)
      return ok(name, target);
    return warn(name, target + " (the reference BLAS: several times slower)",
                "apt-get install libopenblas0-openmp, then update-alternatives --auto " + link);
  }
  return warn(name, "no libblas.so.3 among the alternatives",
              "fine with a pip PyTorch; with Debian's libtorch install libopenblas0-openmp");
}

CheckResult check_memory() {
  const std::string name = "memory";
  const auto merged = default_run();
  double available = meminfo_bytes("MemAvailable");
  const double limit = number_in("/sys/fs/cgroup/memory.max", 0);  // "max" reads as 0: no limit
  if (limit > 0) available = std::min(available, limit - number_in("/sys/fs/cgroup/memory.current", 0));
  if (!merged)
    return fail(name, gigabytes(available) + " free; " + merged.error().message, "rebuild with ./comrad");
  const RunConfig& config = merged->config;
  shm::ArenaShape shape;
  shape.trajectory.env = merged->scenario.env;
  shape.trajectory.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.sim_worker_count = static_cast<int32_t>(config.collection.num_workers);
  shape.envs_per_worker = static_cast<int32_t>(config.collection.num_envs_per_worker);
  shape.slab_count = static_cast<int32_t>(config.collection.trajectory_slabs);
  const double needed = static_cast<double>(shm::Arena::size_bytes(shape)) +
                        static_cast<double>(config.collection.policy_workers + 1) * kBytesPerTorchProcess +
                        static_cast<double>(config.collection.num_workers) * kBytesPerSimulator;
  const std::string found = gigabytes(available) + " free, a default run takes about " + gigabytes(needed);
  if (available >= needed) return ok(name, found);
  return fail(name, found,
              "free memory, or lower --num_workers, --num_envs_per_worker or --trajectory_slabs");
}

CheckResult check_disk() {
  std::error_code error;
  const fs::space_info space = fs::space(fs::current_path(error), error);
  const std::string found = gigabytes(static_cast<double>(space.available)) + " free in the current folder";
  if (error) return warn("disk", error.message(), "");
  if (static_cast<double>(space.available) >= kGigabyte) return ok("disk", found);
  return warn("disk", found, "checkpoints and logs of a run take some hundred MB; see --train_dir");
}

std::vector<CheckResult> check_limits() {
  std::vector<CheckResult> results;
  rlimit files{};
  getrlimit(RLIMIT_NOFILE, &files);
  const std::string open_files = fmt::format("{} open files", files.rlim_cur);
  results.push_back(files.rlim_cur >= 1024 ? ok("open files", open_files)
                                           : warn("open files", open_files, "ulimit -n 4096"));

  constexpr double kReceiveBytes = 8 * 1024 * 1024;
  const double receive = number_in("/proc/sys/net/core/rmem_max", 0);
  const std::string buffer = fmt::format("net.core.rmem_max {}", static_cast<long>(receive));
  if (receive == 0)
    results.push_back(ok("receive buffers", "net.core.rmem_max is not readable here; enough for one host"));
  else if (receive >= kReceiveBytes)
    results.push_back(ok("receive buffers", buffer));
  else
    results.push_back(warn("receive buffers", buffer + " (enough for one host, slow between hosts)",
                           "sysctl -w net.core.rmem_max=10485760"));

  if (number_in("/proc/sys/vm/overcommit_memory", 0) == 2)
    results.push_back(warn("overcommit", "vm.overcommit_memory is 2: large mappings may be refused",
                           "sysctl -w vm.overcommit_memory=0, or raise vm.overcommit_ratio"));
  else
    results.push_back(ok("overcommit", "allowed"));

  const int memory_file = memfd_create("comrad-doctor", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (memory_file < 0 || ftruncate(memory_file, 1 << 20) != 0)
    results.push_back(
        fail("memfd", "memfd_create is refused", "allow memfd_create in the container's seccomp profile"));
  else
    results.push_back(ok("memfd", "works"));
  if (memory_file >= 0) close(memory_file);
  return results;
}

CheckResult check_dds() {
  const std::string name = "dds";
  const std::string action =
      "only runs of several hosts need it; for those the loopback interface must be up (ip link set lo up) "
      "and UDP on "
      "127.0.0.1 allowed";
  const dds::BusConfig config =
      dds::link_config(static_cast<uint64_t>(monotonic_ns()) ^ static_cast<uint64_t>(getpid()) << 40);
  auto sender = dds::LinkBus::open(config);
  if (!sender) return warn(name, sender.error().message, action);
  auto receiver = dds::LinkBus::open(config);
  if (!receiver) return warn(name, receiver.error().message, action);
  bool is_heard = false;
  const auto listen = [&] { receiver->take<dds::RunStats>([&](const dds::RunStats&) { is_heard = true; }); };
  listen();
  const double begin_s = monotonic_s();
  if (const Status sent = sender->write(dds::RunStats{}); !sent)
    return warn(name, sent.error().message, action);
  while (monotonic_s() - begin_s < 5) {
    receiver->wait(100);
    listen();
    if (!is_heard) continue;
    char text[64];
    std::snprintf(text, sizeof(text), "a message over loopback took %.1f ms",
                  (monotonic_s() - begin_s) * 1e3);
    return ok(name, text);
  }
  return warn(name, "two participants on loopback did not hear each other within 5 s", action);
}

CheckResult check_rendering() {
  const auto rate = one_second("comrad-sim-worker", {});
  return rate ? ok("rendering",
                   std::string("by ") + word_of(RunConfig().environment.renderer) + ", " + per_second(*rate))
              : fail("rendering", rate.error().message, "apt-get install freedoom, then ./comrad doctor");
}

CheckResult check_inference() {
  const auto rate =
      one_second("comrad-policy-worker", {"--num_agents", "2", "--heads", "3,3,3", "--measurements", "0"});
  return rate ? ok("inference", "libtorch, " + per_second(*rate))
              : fail("inference", rate.error().message,
                     built_with_torch().empty() ? "apt-get install libtorch-dev libopenblas0-openmp"
                                                : "see libtorch and cuda below");
}

std::vector<CheckResult> check_libtorch() {
  const auto described = [&]() -> Expected<LibtorchSeen> {
    COMRAD_TRY_ASSIGN(const MergedSettings merged, default_run());
    COMRAD_TRY_ASSIGN(const TemporaryFolder folder, TemporaryFolder::create());
    COMRAD_TRY(write_file_atomically(folder.path() + "/config.toml", settings_to_toml(merged.config),
                                     /*durable=*/false));
    COMRAD_TRY_ASSIGN(const ProgramResult result,
                      run_program({sibling_program("comrad-policy-worker"), "--run_dir", folder.path(),
                                   "--describe", "--libtorch"}));
    if (result.exit_code != 0) return Error{ErrorCode::kSystem, last_words(result)};
    return parse_libtorch(result.output);
  }();
  if (!described)
    return {fail("libtorch", described.error().message,
                 "the PyTorch that was built with must stay where it was: rebuild with ./comrad, or with "
                 "COMRAD_TORCH=FOLDER where it went")};
  std::string text;
  std::ifstream file("/proc/driver/nvidia/version");
  std::getline(file, text);
  return {judge_libtorch(*described),
          judge_cuda(*described, driver_version_in(text), std::getenv("CUDA_VISIBLE_DEVICES"))};
}

}  // namespace comrad::deploy
