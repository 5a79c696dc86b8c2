// Straight lines through the world: what they cross, whom they aim at, what a bullet or a fist meets. Stage:
// tic.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Something that a path crosses.
struct PathCrossing {
  Fixed fraction = 0;  ///< of the way, 0..1
  int32_t line = -1;   ///< linedef index, or -1
  Actor* actor = nullptr;
};

/// Visits lines and/or shootable and solid actors that the way from (x, y) by (dx, dy) crosses, nearest
/// first, until `visit` returns false. Returns false when it was stopped. Actors count where the way crosses a
/// diagonal of their box, as in Doom.
bool trace_path(World& world, Fixed x, Fixed y, Fixed dx, Fixed dy, bool lines, bool actors,
                const std::function<bool(const PathCrossing&)>& visit);

/// The angle of a vector by Doom's table of 2 048 slopes, with its edges (measured in ViZDoom: north is a quarter of a turn less
/// one, slopes of less than 512 count as one eighth of a turn).
Angle vector_angle(Fixed x, Fixed y);

/// What a shot would aim at within `distance`, and the pitch to it (positive down): halfway between the pitches to the top and
/// the bottom of what is seen of its near side, by Doom's table of slopes. Without a target: nobody, the shooter's pitch.
/// `vertical_range` are degrees (16.16) up and down; 0: 35, or half a degree for a player who looks freely without auto-aim.
struct Aim {
  Actor* target = nullptr;
  int32_t pitch = 0;
};
Aim aim_line(World& world, Actor& shooter, Angle angle, Fixed distance, Fixed vertical_range = 0);
/// The player's aim: its direction, then 5.6 degrees to either side; range 1024.
Aim aim_bullet(World& world, Actor& shooter);

/// A bullet or a blow: hurts the first body, or marks the wall (puff, blood, lines that act when shot).
/// Returns whom it hit. Unlike aiming it meets the sides, the top and the bottom of boxes, as ZDoom's.
Actor* line_attack(World& world, Actor& shooter, Angle angle, Fixed distance, int32_t pitch, int32_t damage,
                   DamageType type, uint32_t puff_type);
/// A rail: everything on the way.
void rail_attack(World& world, Actor& shooter, int32_t damage, Angle angle_offset, uint32_t puff_type);

/// The opening of a two-sided line at present.
struct Opening {
  Fixed top = 0, bottom = 0, low_floor = 0;
  Fixed range() const { return top - bottom; }
};
Opening opening_of(const World& world, uint32_t line_index);

/// The use key: the nearest line within 64 units that can be used. True when one answered.
bool use_lines(World& world, Actor& user);

}  // namespace comrad::doom
