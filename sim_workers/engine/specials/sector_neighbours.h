// Heights and lights of the sectors round a sector: where doors, lifts and floors stop. Stage: tic.
#pragma once

#include <cstdint>
#include <optional>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

inline Fixed floor_of(const World& world, uint32_t sector) { return world.sectors()[sector].floor_height; }
inline Fixed ceiling_of(const World& world, uint32_t sector) {
  return world.sectors()[sector].ceiling_height;
}

/// Calls visit(sector index) for the sector across each two-sided line of `sector`; one may come more
/// than once.
template <typename Visit>
void for_each_neighbour(const World& world, uint32_t sector, Visit visit) {
  const Level& level = world.level();
  for (const uint32_t index : level.sector_linedefs[sector]) {
    const Linedef& line = level.linedefs[index];
    if (!line.back) continue;
    const uint32_t front = level.sidedefs[line.front].sector_index;
    const uint32_t back = level.sidedefs[*line.back].sector_index;
    if (front != back) visit(front == sector ? back : front);
  }
}

// The sector's own height where no neighbour qualifies.
Fixed lowest_floor_around(const World& world, uint32_t sector);   ///< its own counts as well
Fixed highest_floor_around(const World& world, uint32_t sector);  ///< of the neighbours alone
Fixed next_higher_floor(const World& world, uint32_t sector);
Fixed next_lower_floor(const World& world, uint32_t sector);
Fixed lowest_ceiling_around(const World& world, uint32_t sector);   ///< of the neighbours alone
Fixed highest_ceiling_around(const World& world, uint32_t sector);  ///< of the neighbours alone
Fixed next_higher_ceiling(const World& world, uint32_t sector);
Fixed next_lower_ceiling(const World& world, uint32_t sector);

int32_t min_light_around(const World& world, uint32_t sector, int32_t start);  ///< `start` or darker
int32_t max_light_around(const World& world, uint32_t sector);                 ///< of the neighbours alone; 0

/// The neighbour whose floor (or ceiling) lies at `height`: model for a numeric change of texture.
std::optional<uint32_t> neighbour_with_floor(const World& world, uint32_t sector, Fixed height);
std::optional<uint32_t> neighbour_with_ceiling(const World& world, uint32_t sector, Fixed height);

}  // namespace comrad::doom
