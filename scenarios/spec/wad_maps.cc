#include "scenarios/spec/wad_maps.h"

#include <algorithm>
#include <filesystem>

#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/files.h"

namespace comrad::scenarios {
namespace {

namespace fs = std::filesystem;

/// Lumps of an IWAD that say how its maps are played.
bool rules_maps(const std::string& lump) {
  return lump == "MAPINFO" || lump == "ZMAPINFO" || lump == "DECORATE" || lump == "LOADACS";
}

/// `wad` without the maps that are not `name`.
Expected<std::string> wad_of_map(const wad::WadFile& wad, const std::vector<std::string>& names,
                                 const std::string& name) {
  std::vector<bool> is_left_out(wad.lump_count(), false), is_of_map(wad.lump_count(), false);
  for (const std::string& one : names) {
    COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(one));
    std::fill(is_left_out.begin() + static_cast<std::ptrdiff_t>(lumps.marker),
              is_left_out.begin() + static_cast<std::ptrdiff_t>(lumps.end), one != name);
    if (one == name)
      std::fill(is_of_map.begin() + static_cast<std::ptrdiff_t>(lumps.marker),
                is_of_map.begin() + static_cast<std::ptrdiff_t>(lumps.end), true);
  }
  doomgen::WadWriter split;
  for (std::size_t lump = 0; lump < wad.lump_count(); ++lump)
    if (is_of_map[lump] || (!is_left_out[lump] && (!wad.is_iwad() || rules_maps(wad.lump(lump).name))))
      COMRAD_TRY(split.add(wad.lump(lump).name, wad.text(lump)));
  return split.bytes();
}

}  // namespace

Expected<std::vector<PoolEntry>> split_wad(const std::string& path, const std::string& folder) {
  COMRAD_TRY_ASSIGN(const wad::WadFile wad, wad::WadFile::open(path));
  const std::vector<std::string> names = wad.map_names();
  if (names.empty()) return Error{ErrorCode::kBadFormat, path + ": there is no map in it"};
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) return Error{ErrorCode::kSystem, folder + ": cannot be made: " + failed.message()};
  std::vector<PoolEntry> entries;
  for (const std::string& name : names) {
    PoolEntry entry;
    entry.id = fs::path(path).stem().string() + "_" + name;
    entry.filename = entry.id + ".wad";
    if (std::ranges::count(entries, entry.id, &PoolEntry::id) > 0) continue;  // the last of a name counts
    COMRAD_TRY_ASSIGN(const std::string bytes, wad_of_map(wad, names, name));
    entry.content_hash = doomgen::content_hash(bytes);
    COMRAD_TRY(write_file_atomically((fs::path(folder) / entry.filename).string(), bytes, /*durable=*/false));
    entries.push_back(std::move(entry));
  }
  COMRAD_TRY(write_file_atomically((fs::path(folder) / kPoolRegistryName).string(),
                                   pool_registry_text(PoolKind::kGrid, entries), /*durable=*/true));
  return entries;
}

}  // namespace comrad::scenarios
