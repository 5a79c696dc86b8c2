// What the tables of built-in actors are written with. Stage: loading.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string_view>

#include "sim_workers/engine/actors/actor_catalog.h"

namespace comrad::doom {

using FlagList = std::initializer_list<ActorFlag>;

/// A descendant of `parent`, which must be in the catalog.
ActorType start_type(const ActorCatalog& catalog, std::string_view parent, std::string_view name,
                     int32_t editor_number = -1, int32_t spawn_id = 0);
void set_flags(ActorType* type, FlagList flags, bool on = true);
uint32_t type_index(const ActorCatalog& catalog, std::string_view name);  ///< must be there

/// Adds `type` with the states that `program` describes on top of those it inherits:
///
///   program = row ";" row ";" ...      row = [label ":"]... picture | link
///   picture = [sprite] letters tics ["*"] ["f"] [action ["(" integer | label | Type , ... ")"]]
///   link    = "again" (from the last label) | "stay" (in the last state) | "gone" | "to" label["+"n]
///
/// A picture stands for one state per letter, drawn bright with "*", half as long in fast skills with "f". A
/// picture without a sprite takes the one before it.
uint32_t add_type(ActorCatalog* catalog, ActorType type, std::string_view program);

// Each file's tables. Base classes first, what others name before them.
void add_base_types(ActorCatalog* catalog);
void add_effects(ActorCatalog* catalog);
void add_items(ActorCatalog* catalog);
void add_weapons(ActorCatalog* catalog);
void add_custom_items(ActorCatalog* catalog);  ///< after the weapons
void add_players(ActorCatalog* catalog);
void add_monsters(ActorCatalog* catalog);
void add_marines(ActorCatalog* catalog);
void add_scenery(ActorCatalog* catalog);
void add_markers(ActorCatalog* catalog);

}  // namespace comrad::doom
