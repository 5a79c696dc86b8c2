// What a game is made of, read from its WAD: the level, the actor types (built in, then DECORATE's), the
// scripts. Immutable and shared by all worlds of it. Stage: loading.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/actors/actor_catalog.h"
#include "sim_workers/engine/map/level.h"

namespace comrad::sim {

struct GameContent {
  std::shared_ptr<const doom::Level> level;
  std::shared_ptr<const doom::ActorCatalog> catalog;
  std::shared_ptr<const doom::acs::Behavior> behavior;  ///< null where the map has no scripts
  std::vector<std::string> warnings;                    ///< one line for each thing that is not served
};

/// Loads map `map` of `wad` (empty: its first), with every DECORATE lump and the map's BEHAVIOR. Messages call a DECORATE
/// lump `decorate_name` (empty: by the WAD's path).
/// Errors: kNotFound for the map; kBadFormat with the lump and the place in it.
Expected<GameContent> load_game_content(const wad::WadFile& wad, std::string_view map = {},
                                        const std::string& decorate_name = {});

}  // namespace comrad::sim
