#include "deploy/hosts/run_offer.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/parts.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr const char* kOfferedSettings = "link_config.toml";  // in both folders
constexpr const char* kOfferedPool = "layouts/link_pool.toml";
constexpr const char* kOfferedMap = "layouts/map.wad";

uint64_t checksum_of(const std::string& bytes) { return checksum64(std::as_bytes(std::span(bytes))); }

Status add_file(link::Offer& offer, const std::string& name, const std::string& path) {
  const std::optional<std::string> bytes = read_file(path);
  if (!bytes) return Error{ErrorCode::kNotFound, path + ": cannot be read, so it cannot be offered"};
  offer.files.push_back(
      {.name = name, .path = path, .bytes = bytes->size(), .checksum = checksum_of(*bytes)});
  return {};
}

/// The folder of a scenario that is known by its name.
Expected<fs::path> scenario_folder(const std::string& scenario) {
  std::vector<std::string> roots;
  if (const char* path = std::getenv("COMRAD_SCENARIO_PATH")) roots = parts_of(path, ':');
  roots.push_back(data_dir() + "/scenarios");
  std::error_code ignored;
  for (const std::string& root : roots)
    if (fs::is_regular_file(fs::path(root) / scenario / "scenario.toml", ignored))
      return fs::path(root) / scenario;
  return Error{ErrorCode::kNotFound, "this host has no scenario '" + scenario +
                                         "'; install the same version as on the learner's host, or give it "
                                         "the scenario's folder (COMRAD_SCENARIO_PATH)"};
}

}  // namespace

RunConfig offered_settings(const RunConfig& config) {
  const RunConfig built_in;
  RunConfig offered = config;
  offered.run = built_in.run;
  offered.run.scenario = config.run.scenario;
  offered.run.algo = config.run.algo;
  offered.run.preset = config.run.preset;
  offered.run.seed = config.run.seed;
  CollectionSettings& mine = offered.collection;
  const CollectionSettings& any = built_in.collection;
  mine.num_workers = any.num_workers;
  mine.policy_workers = any.policy_workers;
  mine.min_batch = any.min_batch;
  mine.max_batch = any.max_batch;
  mine.trajectory_slabs = any.trajectory_slabs;
  mine.device = any.device;
  mine.policy_device = any.policy_device;
  mine.learner_threads = any.learner_threads;
  mine.learners = any.learners;
  mine.policy_threads = any.policy_threads;
  mine.set_workers_cpu_affinity = any.set_workers_cpu_affinity;
  offered.replay = built_in.replay;
  offered.hosts = built_in.hosts;
  // Layouts are drawn on each host; what the learner's curriculum needs stays there.
  offered.curriculum = built_in.curriculum;
  if (!config.environment.layout_pool.empty())
    offered.environment.layout_pool = "layouts";
  else
    offered.environment.wad = kOfferedMap;
  return offered;
}

Expected<uint64_t> scenario_checksum(const std::string& scenario) {
  COMRAD_TRY_ASSIGN(const fs::path folder, scenario_folder(scenario));
  std::vector<std::string> names;
  std::error_code failed;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, failed)) {
    const std::string kind = entry.path().extension().string();
    if (kind == ".toml" || kind == ".acs" || kind == ".decorate")
      names.push_back(entry.path().filename().string());
  }
  std::ranges::sort(names);
  std::string all;
  for (const std::string& name : names)
    all += name + "\n" + read_file((folder / name).string()).value_or("") + "\n";
  return checksum_of(all);
}

bool computes_on_cuda(const RunConfig& config) {
  std::error_code ignored;
  const std::string device = policy_device(config, 0);
  return device.starts_with("cuda") || (device == "auto" && fs::exists("/dev/nvidiactl", ignored));
}

Status check_can_be_offered(const RunConfig& config) {
  if (config.run.scenario.find('/') != std::string::npos)
    return Error{ErrorCode::kUnsupported,
                 "scenario is " + config.run.scenario +
                     ", a path of this host; hosts that join know scenarios by name: put its folder where "
                     "COMRAD_SCENARIO_PATH of every host finds it"};
  return {};
}

Status make_offer(const std::string& run_dir, const RunConfig& config, const std::string& iwad) {
  COMRAD_TRY(check_can_be_offered(config));
  link::Offer offer;
  offer.scenario = config.run.scenario;
  COMRAD_TRY_ASSIGN(offer.scenario_checksum, scenario_checksum(config.run.scenario));
  const std::optional<std::string> doom = read_file(iwad);
  if (!doom) return Error{ErrorCode::kNotFound, iwad + ": cannot be read"};
  offer.iwad_checksum = checksum_of(*doom);
  offer.has_cuda = computes_on_cuda(config);
  offer.frame_workers =
      static_cast<uint64_t>(config.hosts.serve_frame_workers +
                            (config.hosts.link == LinkKind::kDds ? config.collection.num_workers : 0));
  const std::string settings = run_dir + "/" + kOfferedSettings;
  COMRAD_TRY(write_file_atomically(settings, settings_to_toml(offered_settings(config)), /*durable=*/false));
  COMRAD_TRY(add_file(offer, kOfferedSettings, settings));
  if (config.environment.layout_pool.empty()) {
    COMRAD_TRY(add_file(offer, kOfferedMap, config.environment.wad));
  } else {
    COMRAD_TRY_ASSIGN(LayoutList list, read_layout_list(run_dir));
    list.interestingness_graph.clear();
    for (std::size_t index = 0; index < list.layouts.size(); ++index) {
      const std::string name = fmt::format("layouts/{}.wad", index);
      COMRAD_TRY(add_file(offer, name, list.layouts[index].path));
      list.layouts[index].path = name;
    }
    const std::string pool = run_dir + "/" + kOfferedPool;
    COMRAD_TRY(write_file_atomically(pool, layout_list_text(list), /*durable=*/false));
    COMRAD_TRY(add_file(offer, kOfferedPool, pool));
  }
  return link::write_offer(run_dir, offer);
}

Status compare_with(const link::Offer& offer, const std::string& iwad) {
  COMRAD_TRY_ASSIGN(const uint64_t mine, scenario_checksum(offer.scenario));
  if (mine != offer.scenario_checksum)
    return Error{ErrorCode::kBadInput,
                 "scenario " + offer.scenario +
                     " is another one here than on the learner's host (its rules, script or "
                     "actors differ); install the same version on both"};
  const std::optional<std::string> doom = read_file(iwad);
  if (!doom || checksum_of(*doom) != offer.iwad_checksum)
    return Error{ErrorCode::kBadInput,
                 "the IWAD " + iwad +
                     " is another one than on the learner's host, so agents would see other pictures; "
                     "install the same version of Debian's freedoom, or point COMRAD_IWAD to the same file"};
  return {};
}

Expected<RunConfig> joined_settings(const std::string& run_dir) {
  COMRAD_TRY_ASSIGN(RunConfig config, load_run_config(run_dir + "/" + kOfferedSettings));
  if (config.environment.layout_pool.empty()) {
    config.environment.wad = run_dir + "/" + kOfferedMap;
    return config;
  }
  const std::string pool = run_dir + "/" + kOfferedPool;
  const std::optional<std::string> text = read_file(pool);
  if (!text) return Error{ErrorCode::kBadFormat, "the run's offer has a pool of maps without its list"};
  COMRAD_TRY_ASSIGN(LayoutList list, parse_layout_list(*text, pool));
  std::error_code ignored;
  for (LayoutEntry& layout : list.layouts) {
    // Written by another host: a file of the offer, or nothing.
    const fs::path inside = fs::path(layout.path).lexically_normal();
    if (inside.is_absolute() || inside.begin() == inside.end() || *inside.begin() != "layouts" ||
        !fs::is_regular_file(fs::path(run_dir) / inside, ignored))
      return Error{ErrorCode::kBadFormat,
                   "the run's offer lists the map '" + layout.path + "', which was not sent"};
    layout.path = (fs::path(run_dir) / inside).string();
  }
  COMRAD_TRY(write_file_atomically(run_dir + "/" + kLayoutListFile, layout_list_text(list), false));
  config.environment.layout_pool = run_dir + "/layouts";
  return config;
}

}  // namespace comrad::deploy
