// What scripts ask of lines, sectors, polyobjects and of the game itself. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "sim_workers/engine/acs/caller.h"

namespace comrad::doom::acs {

/// Visits the lines with an id.
template <typename Visit>
void each_line(World& world, int32_t line_id, Visit visit) {
  std::vector<LineState>& lines = world.state().lines;
  for (std::size_t i = 0; i < lines.size(); ++i)
    if (lines[i].id == line_id) visit(i, lines[i]);
}

void set_line_texture(const Caller& caller, int32_t line_id, int32_t side, int32_t part,
                      std::string_view texture);
/// 0 nothing, 1 creatures, 2 everything, 3 railing, 4 players.
void set_line_blocking(World& world, int32_t line_id, int32_t what);
void set_line_activation(World& world, int32_t line_id, int32_t activation);
int32_t get_line_activation(World& world, int32_t line_id);
void replace_textures(World& world, std::string_view from, std::string_view to, int32_t flags);
void change_flat(World& world, int32_t tag, std::string_view flat, bool ceiling);

/// Of the first sector with a tag; tag 0: of the one at (x, y), in map units.
Fixed sector_height(const World& world, int32_t tag, int32_t x, int32_t y, bool ceiling);
int32_t sector_light(const World& world, int32_t tag);
void damage_sector(const Caller& caller, int32_t tag, int32_t amount, int32_t type_name, int32_t protection,
                   int32_t flags);
bool tag_is_busy(const World& world, int32_t tag);
bool polyobject_is_busy(const World& world, int32_t number);

void watch_plane(const Caller& caller, int32_t tag, Fixed height, int32_t special,
                 const std::array<int32_t, 5>& args, bool ceiling);
void tic_plane_watchers(World& world);

/// LEVELINFO_ and PLAYERINFO_ numbers; 0 for unknown ones.
int32_t level_info(const World& world, int32_t what);
int32_t player_info(const World& world, int32_t player, int32_t what);
/// INPUT_ numbers.
int32_t player_input(const World& world, int32_t player, int32_t what);
/// BT_ bits, and what player_input() remembers. `before` of the same player in the tic before.
uint32_t button_bits(const World& world, const Buttons& buttons, uint32_t before);

}  // namespace comrad::doom::acs
