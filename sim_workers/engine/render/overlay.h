// What lies flat on the picture: the classic status bar, boxes of a scenario's HUD and the crosshair, written
// by the CPU into the finished planar picture. A bar is drawn once per state it can show and copied from then
// on. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/play/world.h"
#include "sim_workers/engine/render/art_archive.h"

namespace comrad::doom {

/// Everything a status bar shows.
struct StatusBarState {
  int health = 100;  ///< shown between 0 and 999
  int armor = 0;
  int ammo = -1;         ///< of the weapon in hand; -1 shows nothing
  uint32_t weapons = 0;  ///< bit k: the weapon of slot k is owned (slots 2..7 have a number)
  std::array<int, 4> ammo_owned{0, 0, 0, 0};  ///< bullets, shells, rockets, cells
  std::array<int, 4> ammo_max{200, 50, 50, 300};
  enum class Face : uint8_t { kRight, kAhead, kLeft, kHurt, kDead } face = Face::kAhead;
  bool team = false;  ///< several players: a coloured field behind the face

  /// A value equal for bars that look the same.
  uint64_t key() const;
};

/// The state of one player's bar in `world`.
StatusBarState status_bar_state(const World& world, int player);
/// Index into PLAYPAL for a player's flashes: red for damage, gold for pickups, 0 for none.
int flash_palette(int damage_flash, int bonus_flash);

class StatusBar {
 public:
  static constexpr int kWidth = 320, kHeight = 32;

  /// Loads the graphics. Errors: kNotFound, kBadFormat naming the graphic.
  static Expected<StatusBar> create(const ArtArchive& archive);
  /// The bar as indices, [kHeight, kWidth].
  void compose(const StatusBarState& state, std::vector<uint8_t>* indices) const;

 private:
  void draw(const IndexedImage& image, int x, int y, std::vector<uint8_t>* indices) const;
  void draw_number(std::span<const IndexedImage> digits, int number, int right, int y, int digit_count,
                   std::vector<uint8_t>* indices) const;

  IndexedImage bar_, arms_, percent_, team_field_, dead_face_;
  std::array<IndexedImage, 10> large_, gray_, yellow_;
  std::array<std::array<IndexedImage, 4>, 5> faces_;  ///< [pain][Face below kDead]
};

/// Writes overlays into pictures of one size. Without a bar, draw_status_bar() must not be called.
class Overlay {
 public:
  Overlay(std::optional<StatusBar> bar, int width, int height, int view_rows)
      : bar_(std::move(bar)), width_(width), height_(height), view_rows_(view_rows) {}

  /// Copies the bar below the view. `colors`: the 256 packed colours (0xBBGGRR) of the present palette.
  void draw_status_bar(const StatusBarState& state, int palette, const uint32_t* colors, uint8_t* picture);
  void draw_boxes(std::span<const HudBox> boxes, int player, uint8_t* picture) const;
  void draw_crosshair(int health, uint8_t* picture) const;

 private:
  void fill(int left, int top, int right, int bottom, const std::array<uint8_t, 3>& color,
            uint8_t* picture) const;

  std::optional<StatusBar> bar_;
  int width_, height_, view_rows_;
  std::unordered_map<uint64_t, std::vector<uint8_t>> bars_;  // planar RGB, [3, height - view_rows, width]
  std::vector<uint8_t> indices_;
};

}  // namespace comrad::doom
