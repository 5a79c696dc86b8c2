// Reads every #include of the sources and keeps the picture of the layers true: includes point left along
// rollout_buffer < doomgen < scenarios < sim_workers and rollout_buffer < policy_workers < learner, and down the layers
// inside each folder; deploy includes rollout_buffer alone, and a third-party library has one home and a package that ./comrad installs.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace comrad {
namespace layering_test {

namespace fs = std::filesystem;

struct Include {
  std::string file;  // from the repository root
  int line = 0;
  std::string target;  // what stands between the quotes or brackets
  bool quoted = false;
};

/// What a folder may include, itself apart. `tests` may include anything.
const std::map<std::string, std::set<std::string>>& allowed_folders() {
  static const std::map<std::string, std::set<std::string>> allowed = {
      {"rollout_buffer", {}},
      {"doomgen", {"rollout_buffer"}},
      {"scenarios", {"rollout_buffer", "doomgen"}},
      {"sim_workers", {"rollout_buffer", "doomgen", "scenarios"}},
      {"policy_workers", {"rollout_buffer"}},
      {"learner", {"rollout_buffer", "policy_workers"}},
      {"deploy", {"rollout_buffer"}},
  };
  return allowed;
}

/// The same inside a folder, lowest first; a name may stand for a folder in a folder. What is not named lies above
/// all of these, but for single files beside them (engine/fixed.h), which lie below.
const std::map<std::string, std::vector<std::string>>& layers_inside() {
  static const std::map<std::string, std::vector<std::string>> layers = {
      {"rollout_buffer",
       {"core", "settings", "schema", "shm", "dds", "link/session", "link/join", "link/frames",
        "link/trajectories"}},
      {"doomgen", {"wad", "layout", "acs"}},
      {"sim_workers",
       {"engine/actors", "engine/map", "engine/world", "engine/play", "engine/specials", "engine/acs",
        "engine/tic", "engine/render", "env", "oracle", "worker", "video", "watch", "trace", "python"}},
      {"policy_workers", {"device", "kernels", "network", "batching", "weights", "worker"}},
      {"learner",
       {"batch", "estimators", "critics", "checkpoint", "ranks", "losses", "schedules", "step", "algorithms",
        "curriculum", "sources", "reports", "worker"}},
      {"deploy",
       {"process", "settings", "launch", "hosts", "evaluation", "sweep", "run", "watch", "bench", "tools"}},
  };
  return layers;
}

struct Library {
  const char* name;
  std::string package;                // Debian's; behind kFromPypi one of pyproject.toml
  std::vector<std::string> prefixes;  // of the included header
  std::vector<std::string> homes;     // folders that may include it; none: all
};

constexpr std::string_view kFromPypi = "PyPI ";  ///< a package of pyproject.toml, not of Debian's
// Those of GPU hosts are in deploy/torch.txt, by their name there.
const std::string kOfGpuHosts = "gpu:";

const std::vector<Library>& libraries() {
  static const std::vector<Library> all = {
      {"Cyclone DDS",
       "cyclonedds-dev",
       {"dds/", "ddsc/", "org/eclipse/cyclonedds", "comrad.h"},
       {"rollout_buffer/dds/"}},
      {"OpenSSL", "libssl-dev", {"openssl/"}, {"rollout_buffer/dds/"}},
      {"OpenGL, OSMesa and EGL", "libosmesa6-dev", {"GL/", "EGL/", "GLES"}, {"sim_workers/engine/render/"}},
      {"FFmpeg's codecs", "libavcodec-dev", {"libavcodec/", "libavutil/"}, {"sim_workers/video/"}},
      {"FFmpeg's formats", "libavformat-dev", {"libavformat/"}, {"sim_workers/video/"}},
      {"OpenCV",
       "libopencv-imgproc-dev",
       {"opencv2/"},
       {"sim_workers/env/", "sim_workers/video/", "sim_workers/watch/"}},
      {"giflib", "libgif-dev", {"gif_lib.h"}, {"sim_workers/video/"}},
      {"libpng", "libpng-dev", {"png.h"}, {"sim_workers/engine/render/"}},
      {"CUDA", "libtorch-dev", {"c10/cuda/", "ATen/cuda/", "cuda"}, {"policy_workers/device/"}},
      {"libtorch", "libtorch-dev", {"torch/", "ATen/", "c10/", "caffe2/"}, {"policy_workers/", "learner/"}},
      {"CUDA", kOfGpuHosts + "cuda-toolkit[crt,cccl]", {"cuda_runtime_api.h"}, {"policy_workers/device/"}},
      {"oneDNN", "libdnnl-dev", {"oneapi/dnnl/"}, {"policy_workers/kernels/"}},
      {"Eigen", "libeigen3-dev", {"Eigen/"}, {"learner/estimators/", "deploy/evaluation/"}},
      {"toml++",
       "libtomlplusplus-dev",
       {"toml++/"},
       {"rollout_buffer/core/", "rollout_buffer/settings/", "scenarios/spec/"}},
      {"Boost", "libboost-dev", {"boost/"}, {"deploy/process/"}},
      {"lz4", "liblz4-dev", {"lz4.h"}, {"rollout_buffer/link/", "rollout_buffer/replay/"}},
      {"xxHash", "libxxhash-dev", {"xxhash.h"}, {"rollout_buffer/core/"}},
      {"zlib", "zlib1g-dev", {"zlib.h"}, {"doomgen/layout/"}},
      {"libzip", "libzip-dev", {"zip.h"}, {"learner/checkpoint/"}},
      {"nanobind", "PyPI nanobind", {"nanobind/"}, {"sim_workers/python/"}},
      {"CLI11", "libcli11-dev", {"CLI/"}, {}},
      {"spdlog", "libspdlog-dev", {"spdlog/"}, {}},
      {"nlohmann-json", "nlohmann-json3-dev", {"nlohmann/"}, {}},
      {"GoogleTest", "libgtest-dev", {"gtest/"}, {"tests/"}},
      {"GoogleMock", "libgmock-dev", {"gmock/"}, {"tests/"}},
      {"Google Benchmark", "libbenchmark-dev", {"benchmark/"}, {"tests/"}},
  };
  return all;
}

bool is_of(const Library& library, const Include& include) {
  return std::any_of(library.prefixes.begin(), library.prefixes.end(),
                     [&](const std::string& prefix) { return include.target.starts_with(prefix); });
}

/// Headers of C++, of the C library, of Linux and of the compiler.
bool is_of_the_system(const std::string& header) {
  static const std::set<std::string> names = {
      "cpuid.h",  "dirent.h", "dlfcn.h", "emmintrin.h", "fcntl.h", "ifaddrs.h", "immintrin.h",
      "malloc.h", "netdb.h",  "poll.h",  "pthread.h",   "pty.h",   "pwd.h",     "sched.h",
      "signal.h", "spawn.h",  "stdio.h", "termios.h",   "time.h",  "unistd.h"};
  for (const char* folder : {"arpa/", "sys/", "linux/", "net/", "netinet/"})
    if (header.starts_with(folder)) return true;
  return header.find_first_of("./") == std::string::npos || names.contains(header);
}

bool is_source(const fs::path& path) {
  const std::string extension = path.extension();
  return extension == ".h" || extension == ".cc" || extension == ".cpp" || extension == ".hpp" ||
         extension == ".c";
}

std::vector<Include> parse_includes(const std::string& file, std::istream& text) {
  std::vector<Include> found;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    std::size_t at = line.find_first_not_of(" \t");
    if (at == std::string::npos || line[at] != '#') continue;
    at = line.find_first_not_of(" \t", at + 1);
    if (at == std::string::npos || line.compare(at, 7, "include") != 0) continue;
    const std::size_t open = line.find_first_of("\"<", at + 7);
    if (open == std::string::npos) continue;
    const std::size_t close = line.find(line[open] == '"' ? '"' : '>', open + 1);
    if (close == std::string::npos) continue;
    found.push_back({file, number, line.substr(open + 1, close - open - 1), line[open] == '"'});
  }
  return found;
}

void add_includes_below(const std::string& folder, std::vector<Include>* all) {
  const fs::path root = COMRAD_SOURCE_DIR;
  if (!fs::exists(root / folder)) return;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
    if (!entry.is_regular_file() || !is_source(entry.path())) continue;
    std::ifstream text(entry.path());
    const std::vector<Include> found =
        parse_includes(fs::relative(entry.path(), root).generic_string(), text);
    all->insert(all->end(), found.begin(), found.end());
  }
}

/// Of the sources, not of the tests.
std::vector<Include> all_includes() {
  std::vector<Include> all;
  for (const auto& [folder, allowed] : allowed_folders()) add_includes_below(folder, &all);
  return all;
}

std::string folder_of(const std::string& path) { return path.substr(0, path.find('/')); }

/// The layer that a file belongs to: its folder, but for a scenario's oracle, which plays the simulator's
/// world and lies with its scenario.
std::string layer_of(const std::string& file) {
  return file.starts_with("scenarios/") && fs::path(file).stem() == "oracle" ? "sim_workers"
                                                                             : folder_of(file);
}

/// Place among its folder's layers.
std::size_t rank_of(const std::string& file) {
  // A scenario's oracle is one of the simulator's.
  const std::string path = layer_of(file) == folder_of(file) ? file : layer_of(file) + "/oracle/oracle.cc";
  const std::string inner = fs::path(path.substr(path.find('/') + 1)).parent_path().string();
  const std::vector<std::string>& layers = layers_inside().at(folder_of(path));
  for (std::size_t i = 0; i < layers.size(); ++i) {
    if ((inner + "/").starts_with(layers[i] + "/")) return i + 1;
    if (layers[i].starts_with(inner + "/")) return 0;
  }
  return layers.size() + 1;
}

/// Why an include breaks the layers, or nothing.
std::string fault_of(const Include& include) {
  const std::string from = layer_of(include.file), to = folder_of(include.target);
  if (to == "tests") return "sources do not include tests";
  if (allowed_folders().contains(to) && include.target.find('/') != std::string::npos && to != from &&
      !allowed_folders().at(from).contains(to))
    return from + " may not include " + to;
  if (from == to && layers_inside().contains(from) && rank_of(include.target) > rank_of(include.file))
    return from + ": " + fs::path(include.target).parent_path().string() + " lies above " +
           fs::path(include.file).parent_path().string();
  // The arena and the bus do not include each other; code that needs both joins them.
  if (include.file.starts_with("rollout_buffer/dds/") && include.target.starts_with("rollout_buffer/shm/"))
    return "rollout_buffer/dds may not include rollout_buffer/shm";
  if (include.quoted && include.target.starts_with("../"))
    return "includes are written from the repository root";
  for (const Library& library : libraries()) {
    const bool is_at_home = library.homes.empty() || std::any_of(library.homes.begin(), library.homes.end(),
                                                                 [&](const std::string& home) {
                                                                   return include.file.starts_with(home);
                                                                 });
    if (is_of(library, include) && !is_at_home)
      return std::string(library.name) + " belongs into " + library.homes.front();
  }
  return "";
}

TEST(Layering, EveryIncludePointsTheRightWay) {
  const std::vector<Include> includes = all_includes();
  ASSERT_GT(includes.size(), 200u) << "the sources were not found below " COMRAD_SOURCE_DIR;
  for (const Include& include : includes)
    EXPECT_EQ(fault_of(include), "") << include.file << ":" << include.line << " includes " << include.target;
}

// A header of a library that no package brings builds here and on no fresh machine.
TEST(Layering, EveryLibraryIsInstalledByTheBootstrap) {
  std::ifstream file(std::string(COMRAD_SOURCE_DIR) + "/deploy/packages.txt");
  std::set<std::string> packages;
  for (std::string line; std::getline(file, line);) packages.insert(line.substr(0, line.find(' ')));
  std::stringstream of_python;
  of_python << std::ifstream(std::string(COMRAD_SOURCE_DIR) + "/pyproject.toml").rdbuf();
  std::stringstream of_gpu_hosts;
  of_gpu_hosts << std::ifstream(std::string(COMRAD_SOURCE_DIR) + "/deploy/torch.txt").rdbuf();
  for (const Library& library : libraries()) {
    if (library.package.starts_with(kOfGpuHosts)) {
      EXPECT_NE(of_gpu_hosts.str().find(library.package.substr(kOfGpuHosts.size())), std::string::npos)
          << library.name << ": deploy/torch.txt lacks it";
      continue;
    }
    const bool is_python = library.package.starts_with(kFromPypi);
    EXPECT_TRUE(is_python ? of_python.str().find('"' + library.package.substr(kFromPypi.size())) !=
                                std::string::npos
                          : packages.contains(library.package))
        << library.name << ": " << (is_python ? "pyproject.toml" : "deploy/packages.txt") << " lacks it";
  }
  std::vector<Include> includes = all_includes();
  add_includes_below("tests", &includes);
  for (const Include& include : includes) {
    if (include.quoted || is_of_the_system(include.target)) continue;
    EXPECT_TRUE(std::any_of(libraries().begin(), libraries().end(),
                            [&](const Library& library) { return is_of(library, include); }))
        << include.file << ":" << include.line << " includes <" << include.target
        << ">: name its library and package above, and in deploy/packages.txt";
  }
}

// What -DCOMRAD_HOSTS=OFF leaves out is included by what it leaves out as well.
TEST(Layering, WhatABuildWithoutHostsCompilesContainsNoLink) {
  const std::set<std::string> ours = {"deploy/run/join.cc", "deploy/run/serve.cc",
                                      "deploy/tools/doctor_hosts.cc", "deploy/tools/doctor_hosts.h",
                                      "rollout_buffer/bench/frame_link.cc"};
  const std::set<std::string> in_every_build = {"rollout_buffer/link/session/accounts.h",
                                                "rollout_buffer/link/join/link_files.h",
                                                "rollout_buffer/link/join/link_address.h"};
  for (const Include& include : all_includes())
    if (include.target.starts_with("rollout_buffer/link/") && !ours.contains(include.file) &&
        !include.file.starts_with("rollout_buffer/link/") && !include.file.starts_with("deploy/hosts/")) {
      EXPECT_TRUE(in_every_build.contains(include.target))
          << include.file << ":" << include.line << " includes " << include.target;
    }
}

TEST(Layering, QuotedIncludesOfOursExist) {
  for (const Include& include : all_includes())
    if (include.quoted && allowed_folders().contains(folder_of(include.target)) &&
        include.target.find('/') != std::string::npos) {
      EXPECT_TRUE(fs::exists(fs::path(COMRAD_SOURCE_DIR) / include.target))
          << include.file << ":" << include.line << " includes " << include.target;
    }
}

/// Whether a test lies where its source lies: tests/unit/shm/x_test.cc for shm/x.h or shm/x.cc. The folders of
/// sim_workers/engine are in tests/unit/sim_workers.
bool mirrors_a_source(const fs::path& test) {
  const fs::path root = COMRAD_SOURCE_DIR;
  const std::string stem = test.stem().string();
  const fs::path folder = fs::relative(test.parent_path(), root / "tests/unit");
  const fs::path engine = "sim_workers/engine" / fs::relative(folder, "sim_workers");
  for (const fs::path& place : {folder, engine})
    for (const char* extension : {".h", ".cc"})
      if (fs::exists(root / place / (stem.substr(0, stem.size() - std::string("_test").size()) + extension)))
        return true;
  return false;
}

TEST(Layering, EveryTestMirrorsASourceOrNamesWhatItCovers) {
  int count = 0;
  for (const auto& entry : fs::recursive_directory_iterator(COMRAD_SOURCE_DIR "/tests/unit")) {
    if (!entry.path().string().ends_with("_test.cc")) continue;
    ++count;
    std::string first_line;
    std::getline(std::ifstream(entry.path()), first_line);
    EXPECT_TRUE(first_line.starts_with("// ") || mirrors_a_source(entry.path()))
        << entry.path()
        << ": no source of that name in the folder that it mirrors; say in its first line what it covers";
  }
  EXPECT_GT(count, 100);
}

TEST(Layering, TheRulesCatchWhatTheyAreFor) {
  const auto is_fault = [](const char* file, const char* target, bool quoted = true) {
    return !fault_of({file, 1, target, quoted}).empty();
  };
  EXPECT_TRUE(is_fault("rollout_buffer/shm/arena.cc", "sim_workers/env/environment.h"));
  EXPECT_TRUE(is_fault("doomgen/wad/wad_writer.cc", "scenarios/spec/scenario_spec.h"));
  EXPECT_TRUE(is_fault("policy_workers/worker/main.cc", "sim_workers/env/environment.h"));
  EXPECT_TRUE(is_fault("learner/worker/main.cc", "scenarios/spec/scenario_spec.h"));
  EXPECT_TRUE(is_fault("deploy/launch/supervisor.cc", "learner/checkpoint/checkpoint.h"));
  EXPECT_TRUE(is_fault("rollout_buffer/settings/layers.cc", "rollout_buffer/schema/spec.h"));
  EXPECT_TRUE(is_fault("rollout_buffer/schema/spec.cc", "rollout_buffer/shm/arena.h"));
  EXPECT_TRUE(is_fault("rollout_buffer/dds/link_bus.cc", "rollout_buffer/shm/arena.h"));
  EXPECT_TRUE(is_fault("sim_workers/engine/play/damage.cc", "sim_workers/engine/specials/line_specials.h"));
  EXPECT_TRUE(is_fault("sim_workers/engine/specials/floors.cc", "sim_workers/engine/acs/machine.h"));
  EXPECT_TRUE(is_fault("sim_workers/engine/world/world.h", "sim_workers/engine/tic/tic.h"));
  EXPECT_TRUE(is_fault("sim_workers/engine/fixed.cc", "sim_workers/engine/actors/actor_type.h"));
  EXPECT_TRUE(is_fault("scenarios/lava_pit/oracle.cc", "sim_workers/worker/sim_worker.h"));
  EXPECT_TRUE(is_fault("learner/estimators/gae.cc", "learner/algorithms/ippo.h"));
  EXPECT_TRUE(is_fault("learner/sources/replay_feed.cc", "learner/worker/learner.h"));
  EXPECT_TRUE(is_fault("doomgen/wad/udmf_reader.cc", "doomgen/layout/map_data.h"));
  EXPECT_TRUE(is_fault("policy_workers/network/core.cc", "policy_workers/batching/batcher.h"));
  EXPECT_TRUE(is_fault("deploy/evaluation/summary.cc", "deploy/run/command.h"));
  EXPECT_TRUE(is_fault("deploy/launch/supervisor.cc", "deploy/sweep/sweep_file.h"));
  EXPECT_FALSE(is_fault("sim_workers/engine/acs/map_calls.cc", "sim_workers/engine/specials/movers.h"));
  EXPECT_FALSE(is_fault("sim_workers/engine/actors/actor_type.h", "sim_workers/engine/fixed.h"));
  EXPECT_FALSE(is_fault("scenarios/lava_pit/oracle.cc", "sim_workers/oracle/steering.h"));
  EXPECT_FALSE(is_fault("learner/worker/main.cc", "learner/curriculum/curriculum.h"));
  EXPECT_FALSE(is_fault("deploy/run/eval.cc", "deploy/evaluation/play.h"));
  EXPECT_TRUE(is_fault("sim_workers/worker/main.cc", "torch/torch.h", false));
  EXPECT_TRUE(is_fault("learner/worker/main.cc", "dds/dds.h", false));
  EXPECT_TRUE(is_fault("deploy/watch/watch_server.cc", "boost/beast.hpp", false));
  EXPECT_TRUE(is_fault("sim_workers/env/doom_env.cc", "GL/osmesa.h", false));
  EXPECT_TRUE(is_fault("sim_workers/worker/main.cc", "libavformat/avformat.h", false));
  EXPECT_FALSE(is_fault("sim_workers/video/video_file.cc", "libavformat/avformat.h", false));
  EXPECT_TRUE(is_fault("learner/batch/collate.cc", "../estimators/gae.h"));
  EXPECT_TRUE(is_fault("sim_workers/env/doom_env.cc", "tests/support/toy_environment.h"));
  EXPECT_FALSE(is_fault("sim_workers/env/doom_env.cc", "scenarios/spec/scenario_spec.h"));
  EXPECT_FALSE(is_fault("learner/algorithms/ippo.cc", "policy_workers/network/actor_critic.h"));
  EXPECT_FALSE(is_fault("learner/algorithms/ippo.cc", "torch/torch.h", false));
  EXPECT_TRUE(is_fault("learner/algorithms/ippo.cc", "c10/cuda/CUDAStream.h", false));
  EXPECT_TRUE(is_fault("policy_workers/network/actor_critic.cc", "cuda_runtime_api.h", false));
  EXPECT_FALSE(is_fault("policy_workers/device/queue.cc", "cuda_runtime_api.h", false));
  EXPECT_FALSE(is_fault("rollout_buffer/shm/arena.h", "rollout_buffer/schema/trajectory.h"));
  EXPECT_FALSE(is_fault("deploy/launch/supervisor.cc", "rollout_buffer/dds/link_bus.h"));
}

TEST(Layering, TheReaderSeesEverySpelling) {
  std::istringstream text(
      "#include <a/b.h>\n  #  include \"c.h\" // why\n// #include \"no.h\"\nint x;\n#include broken\n");
  const std::vector<Include> found = parse_includes("f.cc", text);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].target, "a/b.h");
  EXPECT_FALSE(found[0].quoted);
  EXPECT_EQ(found[1].target, "c.h");
  EXPECT_EQ(found[1].line, 2);
}

}  // namespace layering_test
}  // namespace comrad
