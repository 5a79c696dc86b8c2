// Cuts overlapping outlines into the lines of a plane map: every edge once, with the shape that is uppermost
// on either side of it. Corners stay on whole units: where edges cross between them, the crossing is rounded
// and both edges bend to it, so that neighbours always agree.
#pragma once

#include <span>
#include <vector>

#include "doomgen/layout/geometry.h"

namespace comrad::doomgen {

/// A piece of the plane given to an owner. Later shapes lie over earlier ones.
struct Shape {
  Polygon outline;
  int owner = 0;           ///< below zero: rock
  bool only_rock = false;  ///< takes only what is rock before it
};

/// An edge between two owners; `right` lies to the right of start -> end.
struct PlaneEdge {
  Point start, end;
  int right = 0, left = 0;
};

/// All edges at which the owner changes. Edges of one owner (-1 outside everything) are left out and straight
/// runs are joined, so that no corner is there without need. Deterministic in the order of the shapes.
std::vector<PlaneEdge> subdivide(std::span<const Shape> shapes);

/// The owner of the point after all shapes were laid down, -1 outside of them.
int owner_at(std::span<const Shape> shapes, Point p);

/// Joins edges that continue each other in a straight line between the same owners.
std::vector<PlaneEdge> join_straight(std::vector<PlaneEdge> edges);

}  // namespace comrad::doomgen
