#include "deploy/settings/game_files.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>

#include "deploy/process/child_program.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDebianIwad = "/usr/share/games/doom/freedoom2.wad";
constexpr int64_t kHeaderBytes = 12;
constexpr int64_t kDirectoryEntryBytes = 16;

std::string layout_name(const RunConfig& config) {
  return fmt::format("{}_{}.wad", scenario_file_name(config), config.environment.layout_seed);
}

/// What `train:<count>`, `eval:<count>` and `curriculum` request.
struct PoolToDraw {
  std::string word;
  std::optional<int64_t> count = {};  ///< of layouts; a curriculum has as many as its stages
};

std::optional<PoolToDraw> parse_pool(const std::string& layout_pool) {
  if (layout_pool == kCurriculumPool) return PoolToDraw{layout_pool};
  for (const char* word : {"train", "eval"}) {
    const std::string begin = std::string(word) + ":";
    if (!layout_pool.starts_with(begin)) continue;
    int64_t count = 0;
    const char *first = layout_pool.data() + begin.size(), *last = layout_pool.data() + layout_pool.size();
    const auto [end, failure] = std::from_chars(first, last, count);
    if (failure != std::errc() || end != last) count = 0;
    return PoolToDraw{word, count};
  }
  return std::nullopt;
}

/// Whether `layout_pool` is a WAD, whose maps are the pool, rather than a folder of WADs.
bool names_wad(const std::string& layout_pool) {
  std::error_code error;
  return same_ignoring_case(fs::path(layout_pool).extension().string(), ".wad") &&
         !fs::is_directory(layout_pool, error);
}

int32_t little_endian(const unsigned char* bytes) {
  uint32_t value = 0;
  for (int i = 3; i >= 0; --i) value = value << 8 | bytes[i];
  return static_cast<int32_t>(value);
}

}  // namespace

Expected<std::string> find_iwad() {
  const char* chosen = std::getenv("COMRAD_IWAD");
  const std::string path = chosen != nullptr && *chosen != '\0' ? chosen : kDebianIwad;
  std::error_code error;
  if (!fs::is_regular_file(path, error))
    return Error{ErrorCode::kNotFound,
                 "no IWAD at " + path +
                     (chosen != nullptr
                          ? " (from COMRAD_IWAD); correct or unset that variable"
                          : "; install Debian's freedoom package, or set COMRAD_IWAD to a freedoom2.wad")};
  COMRAD_TRY(check_wad(path));
  return path;
}

Status check_wad(const std::string& path) {
  std::error_code error;
  if (!fs::exists(path, error)) return Error{ErrorCode::kNotFound, path + ": no such WAD"};
  std::ifstream file(path, std::ios::binary);
  const auto size = static_cast<int64_t>(fs::file_size(path, error));
  unsigned char header[kHeaderBytes];
  if (error || !file) return Error{ErrorCode::kNotFound, path + ": cannot be read; check its permissions"};
  if (!file.read(reinterpret_cast<char*>(header), kHeaderBytes))
    return Error{ErrorCode::kBadFormat,
                 path + ": shorter than a WAD header (12 bytes); it is cut off or no WAD"};
  if (std::memcmp(header, "IWAD", 4) != 0 && std::memcmp(header, "PWAD", 4) != 0)
    return Error{ErrorCode::kBadFormat, path + ": starts with neither IWAD nor PWAD; it is no WAD"};
  const int64_t lumps = little_endian(header + 4), directory = little_endian(header + 8);
  if (lumps < 1 || directory < kHeaderBytes || directory + lumps * kDirectoryEntryBytes > size)
    return Error{ErrorCode::kBadFormat, fmt::format("{}: its directory of {} lumps at byte {} does not fit "
                                                    "into {} bytes; the file is cut off, get it again",
                                                    path, lumps, directory, size)};
  file.seekg(directory);
  for (int64_t lump = 0; lump < lumps; ++lump) {
    unsigned char entry[kDirectoryEntryBytes];
    if (!file.read(reinterpret_cast<char*>(entry), kDirectoryEntryBytes)) break;
    const int64_t offset = little_endian(entry), bytes = little_endian(entry + 4);
    if (bytes != 0 && (offset < 0 || bytes < 0 || offset + bytes > size))
      return Error{ErrorCode::kBadFormat, fmt::format("{}: lump {} ({} bytes at byte {}) does not fit into "
                                                      "{} bytes; the file is cut off, get it again",
                                                      path, lump, bytes, offset, size)};
  }
  return {};
}

bool is_evaluated_on_one_map(const RunConfig& config) {
  const std::string& pool = config.environment.layout_pool;
  return pool.empty() || pool == kCurriculumPool;
}

bool is_pool_to_draw(const std::string& layout_pool) { return parse_pool(layout_pool).has_value(); }

bool is_pool_to_make(const std::string& layout_pool) {
  return is_pool_to_draw(layout_pool) || names_wad(layout_pool);
}

Status check_pool_to_draw(const std::string& layout_pool, bool for_training) {
  const auto pool = parse_pool(layout_pool);
  if (!pool || !pool->count) return {};
  if (*pool->count < 1 || *pool->count > 100'000)
    return Error{ErrorCode::kBadInput,
                 "layout_pool is " + layout_pool + "; the number of layouts must be 1 to 100000"};
  if (for_training && pool->word == "eval")
    return Error{ErrorCode::kBadInput,
                 fmt::format("layout_pool is {}; those layouts are for evaluation, train on train:{}",
                             layout_pool, *pool->count)};
  return {};
}

Expected<std::string> ensure_layout_pool(const RunConfig& config, const std::string& made_in,
                                         bool for_training) {
  std::string folder = config.environment.layout_pool;
  std::error_code error;
  COMRAD_TRY(check_pool_to_draw(config.environment.layout_pool, for_training));
  const auto pool = parse_pool(config.environment.layout_pool);
  std::vector<std::string> words;
  if (pool) {
    folder = made_in + "/" + scenario_file_name(config) + "_" + pool->word;
    words = {sibling_program("comrad-doomgen"), config.run.scenario, "--pool", pool->word};
    if (pool->count) {
      folder += fmt::format("_{}", *pool->count);
      words.insert(words.end(), {"--count", std::to_string(*pool->count)});
    }
    words.insert(words.end(), {"--num_agents", std::to_string(config.environment.num_agents), "-o", folder});
  } else if (names_wad(folder)) {
    folder = made_in + "/" + fs::path(folder).stem().string() + "_maps";
    words = {sibling_program("comrad-doomgen"), "split", config.environment.layout_pool, "-o", folder};
  } else if (!fs::is_directory(folder, error)) {
    return Error{ErrorCode::kNotFound,
                 "layout_pool is " + folder + ", which is no folder; make one with `comrad doomgen " +
                     scenario_file_name(config) + " --pool train --count 100 -o " + folder +
                     "`, or say train:<count>, curriculum, or the path of a .wad with several maps"};
  }
  if (!words.empty() && !fs::exists(folder + "/batch_registry.json", error)) {
    COMRAD_TRY_ASSIGN(
        const ProgramResult made,
        run_program(words, {.timeout_s = 120.0 + static_cast<double>(pool ? pool->count.value_or(0) : 0)}));
    if (made.interrupted) return Error{ErrorCode::kSystem, "interrupted while layouts were made"};
    if (made.exit_code != 0)
      return Error{ErrorCode::kBadInput,
                   "comrad-doomgen: " + last_words(made) + " (--layout_pool takes a folder of WADs, too)"};
  }
  COMRAD_TRY_ASSIGN(
      const ProgramResult checked,
      run_program({sibling_program("comrad-doomgen"), "check", folder, "--scenario", config.run.scenario,
                   "--num_agents", std::to_string(config.environment.num_agents), "--for",
                   for_training ? "train" : "eval", "--toml"},
                  {.timeout_s = 600}));
  if (checked.interrupted) return Error{ErrorCode::kSystem, "interrupted while layouts were checked"};
  if (checked.exit_code != 0) return Error{ErrorCode::kBadInput, "layout_pool: " + last_words(checked)};
  return checked.output;
}

Status write_layout_list(const std::string& run_dir, const std::string& text, const std::string& file) {
  const fs::path path = fs::path(run_dir) / file;
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  return write_file_atomically(path.string(), text, /*durable=*/false);
}

std::string scenario_file_name(const RunConfig& config) {
  std::string name = config.run.scenario;
  while (!name.empty() && name.back() == '/') name.pop_back();
  name = name.substr(name.find_last_of('/') + 1);
  return names_vizdoom_config(name) ? name.substr(0, name.size() - 4) : name;
}

bool is_generated_layout(const RunConfig& config) {
  const fs::path path = config.environment.wad;
  return path.filename() == layout_name(config) && path.parent_path().filename() == "layouts";
}

void forget_stale_layout(const RunConfig& run, RunConfig& config) {
  if (!is_generated_layout(run) || config.environment.wad != run.environment.wad) return;
  std::error_code error;
  if (config.environment.layout_seed != run.environment.layout_seed ||
      !fs::exists(config.environment.wad, error))
    config.environment.wad.clear();
}

std::string layout_text(const RunConfig& config) {
  if (!config.environment.layout_pool.empty()) return "pool " + config.environment.layout_pool;
  if (config.environment.wad.empty() || is_generated_layout(config))
    return fmt::format("seed {}", config.environment.layout_seed);
  return config.environment.wad;
}

Expected<std::string> ensure_layout(const RunConfig& config, const std::string& folder) {
  std::error_code error;
  if (!config.environment.wad.empty()) {
    COMRAD_TRY(check_wad(config.environment.wad));
    return fs::absolute(config.environment.wad, error).string();
  }
  fs::create_directories(folder, error);
  if (error) return Error{ErrorCode::kSystem, folder + ": cannot be made: " + error.message()};
  const fs::path path = fs::absolute(fs::path(folder) / layout_name(config), error);
  if (fs::exists(path, error) && check_wad(path.string())) return path.string();

  // It writes its file beside the place and renames it: no reader sees half a map.
  COMRAD_TRY_ASSIGN(const ProgramResult made,
                    run_program({sibling_program("comrad-doomgen"), config.run.scenario, "--seed",
                                 std::to_string(config.environment.layout_seed), "--num_agents",
                                 std::to_string(config.environment.num_agents), "-o", path.string()},
                                {.timeout_s = 120}));
  if (made.exit_code != 0) return Error{ErrorCode::kBadInput, "comrad-doomgen: " + last_words(made)};
  return path.string();
}

Status check_layout(const RunConfig& config) {
  const std::string& pool = config.environment.layout_pool;
  if (!pool.empty() && !is_pool_to_draw(pool)) return {};
  COMRAD_TRY_ASSIGN(const TemporaryFolder folder, TemporaryFolder::create());
  RunConfig first = config;
  if (!pool.empty() && pool != kCurriculumPool) first.environment.layout_pool = "train:1";
  const Expected<std::string> drawn = pool.empty()
                                          ? ensure_layout(config, folder.path())
                                          : ensure_layout_pool(first, folder.path(), /*for_training=*/true);
  return drawn ? Status() : drawn.error();
}

}  // namespace comrad::deploy
