#include "scenarios/spec/scenario_files.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSearchPath = "COMRAD_SCENARIO_PATH";

/// Folders of scenarios, first come first served.
std::vector<fs::path> roots() {
  std::vector<fs::path> result;
  if (const char* path = std::getenv(kSearchPath); path != nullptr) {
    std::stringstream text(path);
    for (std::string one; std::getline(text, one, ':');)
      if (!one.empty()) result.emplace_back(one);
  }
  result.push_back(fs::path(data_dir()) / "scenarios");
  return result;
}

bool is_scenario(const fs::path& folder) {
  std::error_code ignored;
  return fs::is_regular_file(folder / "scenario.toml", ignored);
}

}  // namespace

bool scenario_file_exists(const std::string& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

Expected<std::string> read_scenario_file(const std::string& path, std::size_t most_megabytes) {
  std::ifstream file(path, std::ios::binary);
  if (!file.is_open()) return Error{ErrorCode::kSystem, path + ": cannot be read"};
  std::string text;
  std::string block(1 << 16, '\0');
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())), file.gcount() > 0) {
    text.append(block, 0, static_cast<std::size_t>(file.gcount()));
    if (text.size() > most_megabytes << 20)
      return Error{ErrorCode::kBadFormat, fmt::format("{}: longer than {} MB", path, most_megabytes)};
  }
  if (file.bad()) return Error{ErrorCode::kSystem, path + ": cannot be read"};
  return text;
}

ScenarioName split_variant(const std::string& name) {
  const std::size_t mark = find_variant(name);
  if (mark == std::string::npos) return {name, ""};
  const std::string variant = name.substr(mark + 1);
  return {name.substr(0, mark), variant == "default" ? "" : variant};
}

std::vector<std::string> list_variants(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code ignored;  // no folder: no variants
  for (const auto& entry : fs::directory_iterator(fs::path(folder) / "variants", ignored))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
  std::ranges::sort(names);
  return names;
}

Expected<std::string> find_variant_file(const std::string& folder, const std::string& variant) {
  std::vector<std::string> known = list_variants(folder);
  if (std::ranges::count(known, variant) == 1) return folder + "/variants/" + variant + ".toml";
  known.insert(known.begin(), "default");
  return Error{ErrorCode::kNotFound, "scenario " + fs::path(folder).filename().string() +
                                         " has no variant '" + variant + "'" + did_you_mean(variant, known) +
                                         "; known: " + joined(known)};
}

Expected<std::string> find_scenario_folder(const std::string& full_name) {
  const std::string name = split_variant(full_name).scenario;
  if (name.find('/') != std::string::npos) {
    fs::path folder = fs::path(name).lexically_normal();
    if (!folder.has_filename()) folder = folder.parent_path();  // "toy/"
    if (is_scenario(folder)) return folder.string();
    return Error{ErrorCode::kNotFound,
                 "there is no scenario in " + name +
                     ": the folder must hold a scenario.toml (scenarios/OWN_SCENARIO.md shows one)"};
  }
  for (const fs::path& root : roots())
    if (!name.empty() && name[0] != '.' && is_scenario(root / name)) return (root / name).string();
  const std::vector<std::string> known = list_scenarios();
  const bool is_here = !name.empty() && is_scenario(name);
  std::string text = "there is no scenario '" + name + "'" +
                     (is_here ? "; did you mean ./" + name + "?" : did_you_mean(name, known)) + "; ";
  text += known.empty() ? "none found below " + roots().back().string() + " (is COMRAD_HOME right?)"
                        : "known: " + joined(known);
  text += "; a folder of your own is named by its path or found through " + std::string(kSearchPath);
  return Error{ErrorCode::kNotFound, text};
}

std::vector<std::string> list_scenarios() {
  std::vector<std::string> names;
  std::error_code ignored;  // no folder: no scenarios
  for (const fs::path& root : roots())
    for (const auto& entry : fs::directory_iterator(root, ignored))
      if (is_scenario(entry.path())) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

}  // namespace comrad::scenarios
