// What recipes ask of a finished map, each with a message that names the place: starts that are there and
// apart, room for bodies, ways that lead somewhere and barriers that bar.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "doomgen/layout/map_data.h"
#include "doomgen/layout/reachability.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// The start of player 1, 2, ... as far as there are any.
std::vector<Point> start_points(const MapData& map);
/// Positions of map spots with an id in [first, last], by id.
std::vector<Point> spot_points(const MapData& map, int32_t first, int32_t last);
/// The sector that `p` lies in, or -1 in rock.
int sector_at(const MapData& map, Point p);

/// Starts for players 1..`players` are there, each with room for a body, no two bodies touching.
Status check_starts(const MapData& map, int players);

/// A body has room at every one of `points`: it crosses no line that stops it, and the sector is high enough.
/// `what` names them in messages ("an item spot").
Status check_room(const MapData& map, std::span<const Point> points, const std::string& what,
                  const Body& body = {});

/// A body that starts at any of `starts` can walk to every one of `goals`.
Status check_reaches(const MapData& map, std::span<const Point> starts, std::span<const Point> goals,
                     const std::string& what, const Body& body = {});
/// It can walk to none of them: a barrier bars.
Status check_separated(const MapData& map, std::span<const Point> starts, std::span<const Point> goals,
                       const std::string& what, const Body& body = {});

/// The map with its scripted doors open: sectors with one of the tags get their highest neighbour's ceiling.
MapData with_open_sectors(MapData map, const std::vector<int32_t>& tags);
/// The map with the floors of these tags at `height`: bridges up, lifts down.
MapData with_floors_at(MapData map, const std::vector<int32_t>& tags, int32_t height);

}  // namespace comrad::doomgen
