#include "sim_workers/engine/specials/sector_neighbours.h"

#include <algorithm>

namespace comrad::doom {
namespace {

/// The best value of `pick` (sector -> value) over the neighbours, where better(new, old).
template <typename Pick, typename Accept, typename Better>
std::optional<Fixed> best_around(const World& world, uint32_t sector, Pick pick, Accept accept,
                                 Better better) {
  std::optional<Fixed> best;
  for_each_neighbour(world, sector, [&](uint32_t other) {
    const Fixed value = pick(world.sectors()[other]);
    if (accept(value) && (!best || better(value, *best))) best = value;
  });
  return best;
}

constexpr auto kFloor = [](const Sector& sector) { return sector.floor_height; };
constexpr auto kCeiling = [](const Sector& sector) { return sector.ceiling_height; };
constexpr auto kAny = [](Fixed) { return true; };
constexpr auto kLower = [](Fixed a, Fixed b) { return a < b; };
constexpr auto kHigher = [](Fixed a, Fixed b) { return a > b; };

}  // namespace

Fixed lowest_floor_around(const World& world, uint32_t sector) {
  const Fixed own = floor_of(world, sector);
  return std::min(own, best_around(world, sector, kFloor, kAny, kLower).value_or(own));
}

Fixed highest_floor_around(const World& world, uint32_t sector) {
  return best_around(world, sector, kFloor, kAny, kHigher).value_or(floor_of(world, sector));
}

Fixed next_higher_floor(const World& world, uint32_t sector) {
  const Fixed own = floor_of(world, sector);
  return best_around(
             world, sector, kFloor, [own](Fixed value) { return value > own; }, kLower)
      .value_or(own);
}

Fixed next_lower_floor(const World& world, uint32_t sector) {
  const Fixed own = floor_of(world, sector);
  return best_around(
             world, sector, kFloor, [own](Fixed value) { return value < own; }, kHigher)
      .value_or(own);
}

Fixed lowest_ceiling_around(const World& world, uint32_t sector) {
  return best_around(world, sector, kCeiling, kAny, kLower).value_or(ceiling_of(world, sector));
}

Fixed highest_ceiling_around(const World& world, uint32_t sector) {
  return best_around(world, sector, kCeiling, kAny, kHigher).value_or(ceiling_of(world, sector));
}

Fixed next_higher_ceiling(const World& world, uint32_t sector) {
  const Fixed own = ceiling_of(world, sector);
  return best_around(
             world, sector, kCeiling, [own](Fixed value) { return value > own; }, kLower)
      .value_or(own);
}

Fixed next_lower_ceiling(const World& world, uint32_t sector) {
  const Fixed own = ceiling_of(world, sector);
  return best_around(
             world, sector, kCeiling, [own](Fixed value) { return value < own; }, kHigher)
      .value_or(own);
}

int32_t min_light_around(const World& world, uint32_t sector, int32_t start) {
  int32_t light = start;
  for_each_neighbour(world, sector,
                     [&](uint32_t other) { light = std::min(light, world.sectors()[other].light); });
  return light;
}

int32_t max_light_around(const World& world, uint32_t sector) {
  int32_t light = 0;
  for_each_neighbour(world, sector,
                     [&](uint32_t other) { light = std::max(light, world.sectors()[other].light); });
  return light;
}

std::optional<uint32_t> neighbour_with_floor(const World& world, uint32_t sector, Fixed height) {
  std::optional<uint32_t> found;
  for_each_neighbour(world, sector, [&](uint32_t other) {
    if (!found && floor_of(world, other) == height) found = other;
  });
  return found;
}

std::optional<uint32_t> neighbour_with_ceiling(const World& world, uint32_t sector, Fixed height) {
  std::optional<uint32_t> found;
  for_each_neighbour(world, sector, [&](uint32_t other) {
    if (!found && ceiling_of(world, other) == height) found = other;
  });
  return found;
}

}  // namespace comrad::doom
