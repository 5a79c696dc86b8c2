#include "sim_workers/env/game_content.h"

#include <spdlog/fmt/fmt.h>

#include <optional>
#include <set>
#include <span>
#include <sstream>
#include <utility>

#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/env/map_info.h"

namespace comrad::sim {
namespace {

/// Editor numbers that are places rather than actors: deathmatch starts, anchors and starts of polyobjects.
bool is_place(int32_t editor_number) {
  return doom::player_of_start(editor_number) || editor_number == doom::kDeathmatchStart ||
         (editor_number >= 3000 && editor_number <= 3002) || (editor_number >= 9300 && editor_number <= 9303);
}

/// The libraries that LOADACS lumps name, one or more in a line.
std::vector<std::string> library_names(const wad::WadFile& wad) {
  std::vector<std::string> names;
  for (std::size_t lump = 0; lump < wad.lump_count(); ++lump) {
    if (wad.lump(lump).name != "LOADACS") continue;
    std::istringstream lines{std::string(wad.text(lump))};
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line.substr(0, line.find("//")));
      for (std::string word; words >> word;) names.push_back(word);
    }
  }
  return names;
}

/// The kinds of blocks of a patch that change play, such as "Thing" of "Thing 1 (Player)". Texts, sounds, cheats, par times and the
/// pictures of frames do not.
std::set<std::string> patched_kinds(std::string_view patch) {
  static const std::set<std::string> kBlocks = {"Thing", "Frame", "Pointer", "Ammo", "Weapon", "Misc"};
  std::set<std::string> kinds;
  bool in_frame = false;
  std::istringstream lines{std::string(patch)};
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string kind, number;
    words >> kind >> number;
    const bool is_block = !number.empty() && number[0] >= '0' && number[0] <= '9';
    if (is_block || kind.starts_with("[")) in_frame = kind == "Frame";
    if (kind == "[CODEPTR]" || (is_block && !in_frame && kBlocks.contains(kind))) kinds.insert(kind);
    if (in_frame && !is_block && kind != "Sprite" && line.find('=') != std::string::npos)
      kinds.insert("Frame");
  }
  return kinds;
}

void warn_of_patches(const wad::WadFile& wad, std::vector<std::string>* warnings) {
  for (std::size_t lump = 0; lump < wad.lump_count(); ++lump) {
    if (wad.lump(lump).name != "DEHACKED") continue;
    std::string kinds;
    for (const std::string& kind : patched_kinds(wad.text(lump))) kinds += (kinds.empty() ? "" : ", ") + kind;
    if (!kinds.empty())
      warnings->push_back(wad.path() +
                          " DEHACKED: patches are not supported; these blocks are left out: " + kinds);
  }
}

void warn_of_unknown_things(const doom::Level& level, const doom::ActorCatalog& catalog,
                            const std::string& label, std::vector<std::string>* warnings) {
  std::set<int32_t> unknown;
  for (const doom::MapThing& thing : level.things)
    if (!is_place(thing.editor_number) && !catalog.find_editor_number(thing.editor_number))
      unknown.insert(thing.editor_number);
  for (const int32_t number : unknown)
    warnings->push_back(fmt::format("{}: nothing is known of things with editor number {}; they are left out",
                                    label, number));
}

}  // namespace

Expected<GameContent> load_game_content(const wad::WadFile& wad, std::string_view map,
                                        const std::string& decorate_name) {
  GameContent content;
  COMRAD_TRY_ASSIGN(content.level, doom::load_level(wad, map));
  const std::string label = wad.path() + " " + content.level->name;

  const auto lump_text = [&](std::string_view name) -> std::optional<std::string_view> {
    const std::optional<std::size_t> lump = wad.find(name);
    if (!lump) return std::nullopt;
    return wad.text(*lump);
  };
  auto catalog = std::make_shared<doom::ActorCatalog>();
  for (std::size_t lump = 0; lump < wad.lump_count(); ++lump)
    if (wad.lump(lump).name == "DECORATE")
      COMRAD_TRY(doom::parse_decorate(wad.text(lump),
                                      decorate_name.empty() ? wad.path() + " DECORATE" : decorate_name,
                                      catalog.get(), &content.warnings, lump_text));
  MapInfo info;
  for (const char* name : {"ZMAPINFO", "MAPINFO"})
    if (const std::optional<std::size_t> lump = wad.find(name)) {
      read_map_info(wad.text(*lump), wad.path() + " " + name, content.level->name, &info, &content.warnings);
      break;  // MAPINFO is for engines that do not know the other one
    }
  if (const std::optional<std::size_t> lump = wad.find("KEYCONF"))
    read_key_conf(wad.text(*lump), wad.path() + " KEYCONF", &info, &content.warnings);
  if (!info.player_class.empty() && !catalog->set_player(info.player_class))
    content.warnings.push_back(wad.path() + ": the player class '" + info.player_class +
                               "' is no PlayerPawn; players are DoomPlayers");
  if (info.rules != content.level->rules) {  // of few maps: the others are not copied
    auto level = std::make_shared<doom::Level>(*content.level);
    level->rules = info.rules;
    content.level = std::move(level);
  }
  content.catalog = std::move(catalog);

  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(content.level->name));
  const auto library = [&](std::string_view name) -> std::optional<std::span<const uint8_t>> {
    const std::optional<std::size_t> lump = wad.find(name);
    if (!lump) return std::nullopt;
    return wad.bytes(*lump);
  };
  const std::vector<std::string> loadacs = library_names(wad);
  const auto scripts = lumps.behavior ? wad.bytes(*lumps.behavior) : std::span<const uint8_t>();
  if (!scripts.empty() || !loadacs.empty()) {
    COMRAD_TRY_ASSIGN(content.behavior,
                      doom::acs::Behavior::load(scripts, label + " BEHAVIOR", library, loadacs));
    if (content.behavior->scripts().empty()) content.behavior = nullptr;
  }
  warn_of_patches(wad, &content.warnings);
  warn_of_unknown_things(*content.level, *content.catalog, label, &content.warnings);
  return content;
}

}  // namespace comrad::sim
