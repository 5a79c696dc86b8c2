// What lies flat on the picture: the classic status bar and the crosshair, written
// by the CPU into the finished planar picture. A bar is drawn once per state it can show and copied from then
// on. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "sim_workers/engine/render/picture.h"
#include "sim_workers/engine/render/status_bar.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// Index into PLAYPAL for a player's flashes: red for damage, gold for pickups, 0 for none.
int flash_palette(int damage_flash, int bonus_flash);
/// The same with what its powers do: green in a radiation suit.
int screen_palette(const Player& player);
/// True while a power is to be seen: its last tics blink.
bool power_shows(const Player& player, PowerKind kind);
Sight player_sight(const Player& player);

/// Writes overlays into pictures of one size. Without a bar, draw_status_bar() must not be called.
class Overlay {
 public:
  Overlay(std::optional<StatusBar> bar, int width, int height, int view_rows)
      : bar_(std::move(bar)), width_(width), height_(height), view_rows_(view_rows) {}

  /// Copies the bar below the view. `colors`: the 256 packed colours (0xBBGGRR) of the present palette.
  void draw_status_bar(const StatusBarState& state, int palette, const uint32_t* colors, uint8_t* picture);
  /// A see-through plus in the middle of the view, from red to green with the player's health.
  void draw_crosshair(int health, int palette, const uint32_t* colors, uint8_t* picture);

 private:
  /// The packed colour of the present palette that is nearest to another one. A search through 256; earlier answers
  /// are kept (each view's crosshair needs a dozen, mostly the same ones).
  uint32_t nearest(int palette, const uint32_t* colors, int red, int green, int blue);
  /// Smaller than any screen of the reference engine.
  bool is_small() const;

  std::optional<StatusBar> bar_;
  int width_, height_, view_rows_;
  std::unordered_map<uint64_t, std::vector<uint8_t>> bars_;  // planar RGB, [3, height - view_rows, width]
  std::vector<uint8_t> indices_;

  static constexpr int kNearestBits = 10;
  struct NearestColor {
    uint32_t wanted =
        UINT32_MAX;  // palette << 24 | blue << 16 | green << 8 | red; no palette has the number 255
    uint32_t found = 0;
  };
  std::array<NearestColor, 1 << kNearestBits> nearest_{};
};

}  // namespace comrad::doom
