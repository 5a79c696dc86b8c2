// Ways through a level for a player's body: a grid of standing places, and for a goal the distance of each of
// them. It follows moving sectors. For oracles; the engine does not use it. Stage: step.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <queue>
#include <utility>
#include <vector>

#include "sim_workers/oracle/steering.h"

namespace comrad::sim {

struct NavigatorOptions {
  int cell_units = 16;
  double margin_units = 2.0;  ///< kept from walls, besides the body's radius of 16
  double step_units = 24;     ///< highest step up
  double drop_units = 1e9;    ///< deepest step down that it takes
  /// Extra cost, in cells, of standing in a sector; below 0: never enter. Null: none.
  std::function<double(const doom::World&, uint32_t sector)> sector_cost = nullptr;
};

class Navigator {
 public:
  explicit Navigator(NavigatorOptions options = {}) : options_(std::move(options)) {}

  /// Learns the level, or what has moved since the last call. Call it before a round of questions.
  void refresh(const doom::World& world);

  /// Steps to the goal from there, in map units along the way; nothing where there is no way.
  std::optional<double> way_length(Place from, Place goal);
  /// A place some cells ahead on the way from `from` to `goal`, in a straight line that can be walked; the
  /// goal itself when it is near. Nothing where there is no way.
  std::optional<Place> waypoint(Place from, Place goal);
  /// True where a body can stand.
  bool is_open(Place place) const;
  /// The open place nearest to `place`, within `reach_units`.
  std::optional<Place> nearest_open(Place place, double reach_units = 128) const;

 private:
  /// Dijkstra's search from a goal, as far as queries needed it.
  struct Field {
    using Entry = std::pair<float, int>;  // distance, cell
    std::vector<float> distance;          // [cell] units to the goal; infinite where no way is known
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  };
  int cell_of(Place place) const;
  Place centre_of(int cell) const;
  bool can_step(int from, int to) const;
  bool is_straight(Place from, Place to) const;
  Field& field_to(int goal_cell);
  /// Searches on until the distance of `cell`, and every shorter one, is known. False where there is no way.
  bool settle(Field& field, int cell) const;
  /// With `field`: the nearest from which there is a way.
  int open_cell_near(Place place, double reach_units, Field* field = nullptr) const;

  NavigatorOptions options_;
  const doom::Level* level_ = nullptr;
  uint64_t fingerprint_ = 0;
  double left_ = 0, bottom_ = 0;
  int columns_ = 0, rows_ = 0;
  std::vector<int32_t> sector_;  // [cell] of its centre, -1 in the void
  std::vector<float> floor_, cost_;
  std::vector<uint8_t> blocked_;
  std::map<int, Field> fields_;
};

}  // namespace comrad::sim
