// The classic status bar: what it shows of a player, and how. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Everything a status bar shows.
struct StatusBarState {
  int health = 100;  ///< shown between 0 and 999
  int armor = 0;
  int ammo = -1;         ///< of the weapon in hand; -1 shows nothing
  uint32_t weapons = 0;  ///< bit k: a weapon of slot k is owned (slots 2..7 have a number)
  std::array<int, 4> ammo_owned{0, 0, 0, 0};  ///< bullets, shells, rockets, cells
  std::array<int, 4> ammo_max{200, 50, 50, 300};
  std::array<int8_t, 3> keys{-1, -1, -1};  ///< blue, yellow, red: -1 none, 0 a card, 1 a skull
  enum class Face : uint8_t {
    kRight,
    kAhead,
    kLeft,
    kHurt,       ///< from ahead, or firing on and on
    kTurnRight,  ///< hurt from the right
    kTurnLeft,
    kOuch,  ///< hurt badly
    kEvil,  ///< a new weapon
    kGod,
    kDead
  } face = Face::kAhead;
  bool team = false;  ///< several players: a coloured field behind the face

  /// A value equal for bars that look the same.
  uint64_t key() const;
};

/// The state of one player's bar in `world`. Doom's face follows chance and what it saw before; here it is a
/// function of the world alone.
StatusBarState status_bar_state(const World& world, int player);

class StatusBar {
 public:
  static constexpr int kWidth = 320, kHeight = 32, kScreenHeight = 200;

  /// Loads the graphics. Errors: kNotFound, kBadFormat naming the graphic.
  static Expected<StatusBar> create(const ArtArchive& archive);
  /// Size of the picture whose lowest rows the bar is: the whole picture's, and how many rows lie above it.
  struct Canvas {
    int width = kWidth, height = kScreenHeight, rows_above = kScreenHeight - kHeight;
    bool operator==(const Canvas&) const = default;
  };
  /// The bar as indices, [canvas.height - canvas.rows_above, canvas.width]. As in ZDoom each graphic is
  /// scaled by itself, from its upper left corner.
  void compose(const StatusBarState& state, const Canvas& canvas, std::vector<uint8_t>* indices);
  /// On Doom's own screen: [kHeight, kWidth].
  void compose(const StatusBarState& state, std::vector<uint8_t>* indices) { compose(state, {}, indices); }

 private:
  static constexpr std::size_t kLivingFaces = static_cast<std::size_t>(StatusBarState::Face::kGod);
  void draw(const IndexedImage& image, int x, int y, const Canvas& canvas,
            std::vector<uint8_t>* indices) const;
  void draw_number(std::span<const IndexedImage> digits, int number, int right, int y, int digit_count,
                   const Canvas& canvas, std::vector<uint8_t>* indices) const;

  IndexedImage bar_, arms_, percent_, team_field_, god_face_, dead_face_;
  std::array<IndexedImage, 10> large_, gray_, yellow_;
  std::array<IndexedImage, 6> keys_;                             ///< cards, then skulls: blue, yellow, red
  std::array<std::array<IndexedImage, kLivingFaces>, 5> faces_;  ///< [pain][Face below kGod]
  std::vector<uint8_t> empty_;                                   // the bar without its numbers and face
  Canvas empty_canvas_{.width = 0};
};

}  // namespace comrad::doom
