// The scripted team of Lava Maze: the navigator follows the path that the map exports, the signaler flashes
// the side that the next step leads to.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr double kCell = 128;
constexpr std::array<int, 4> kLampOfDirection = {1, 3, 2,
                                                 4};  // east green, north yellow, west red, south blue
constexpr int kBitsPerVariable = 27;

/// The exports that are read, by their numbers.
struct MazeExports {
  int maze_side = 0, goal_x = 0, goal_y = 0, flash_active = 0;
  std::vector<int> open;  // of each kBitsPerVariable cells
};

class MazePair final : public Oracle {
 public:
  explicit MazePair(MazeExports exports) : exports_(std::move(exports)) {}

  void reset(const doom::World&) override { told_ = -1; }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    const int side = world.exported(exports_.maze_side);
    if (side <= 0 || buttons.size() < 2) return;
    const Place here = place_of(world.body(0));
    const double half = side * kCell / 2;
    const int column = std::clamp(static_cast<int>((here.x + half) / kCell), 0, side - 1);
    const int row = std::clamp(static_cast<int>((here.y + half) / kCell), 0, side - 1);
    const int cell = row * side + column;
    const int goal = world.exported(exports_.goal_y) * side + world.exported(exports_.goal_x);
    const std::vector<int> way = distances(world, side, goal);
    int next = cell, direction = -1;
    for (int d = 0; d < 4; ++d) {
      const int other = neighbour(cell, d, side);
      if (other >= 0 && way[other] >= 0 && (way[cell] < 0 || way[other] < way[cell]) &&
          (next == cell || way[other] < way[next]))
        next = other, direction = d;
    }
    const Place target{-half + (next % side + 0.5) * kCell, -half + (next / side + 0.5) * kCell};
    // The navigator always looks east: forward is east, right is south.
    walk_to(world.body(0), target, {}, buttons[0]);
    if (direction >= 0 && direction != told_ && world.exported(exports_.flash_active) == 0) {
      buttons[1].select_weapon = static_cast<int8_t>(kLampOfDirection[direction]);
      buttons[1].attack = true;
      told_ = direction;
    }
  }

 private:
  static int neighbour(int cell, int direction, int side) {
    constexpr int kDx[4] = {1, 0, -1, 0}, kDy[4] = {0, 1, 0, -1};
    const int x = cell % side + kDx[direction], y = cell / side + kDy[direction];
    return x < 0 || y < 0 || x >= side || y >= side ? -1 : y * side + x;
  }

  /// Steps to the goal over open cells, -1 where there is no way.
  std::vector<int> distances(const doom::World& world, int side, int goal) const {
    std::vector<int> way(static_cast<std::size_t>(side * side), -1), queue{goal};
    const auto is_open = [&](int cell) {
      return (world.exported(exports_.open[static_cast<std::size_t>(cell / kBitsPerVariable)]) >>
                  cell % kBitsPerVariable &
              1) != 0;
    };
    way[goal] = 0;
    for (std::size_t i = 0; i < queue.size(); ++i)
      for (int d = 0; d < 4; ++d) {
        const int other = neighbour(queue[i], d, side);
        if (other < 0 || way[other] >= 0 || !is_open(other)) continue;
        way[other] = way[queue[i]] + 1;
        queue.push_back(other);
      }
    return way;
  }

  MazeExports exports_;
  int told_ = -1;  // the direction flashed last
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_lava_maze_oracle(const DoomGame& game) {
  MazeExports exports;
  COMRAD_TRY_ASSIGN(exports.maze_side, game.spec.user_number("maze_side"));
  COMRAD_TRY_ASSIGN(exports.goal_x, game.spec.user_number("goal_x"));
  COMRAD_TRY_ASSIGN(exports.goal_y, game.spec.user_number("goal_y"));
  COMRAD_TRY_ASSIGN(exports.flash_active, game.spec.user_number("flash_active"));
  COMRAD_TRY_ASSIGN(exports.open, game.spec.user_numbers({"open_low", "open_middle", "open_high"}));
  return std::unique_ptr<Oracle>(std::make_unique<MazePair>(std::move(exports)));
}

}  // namespace comrad::sim
