#include "sim_workers/engine/render/overlay.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace comrad::doom {
namespace {

constexpr std::size_t kBarsKept = 1024;
constexpr int kFlashTail = 4 * 32;  // a power's last tics blink: on for 8, off for 8
constexpr int kRadiationPalette = 13;

}  // namespace

int flash_palette(int damage_flash, int bonus_flash) {
  if (damage_flash > 0) return std::min((damage_flash + 7) / 8, 8);
  if (bonus_flash > 0) return 8 + std::min((bonus_flash + 7) / 8, 4);
  return 0;
}

bool power_shows(const Player& player, PowerKind kind) {
  for (const Power& power : player.powers)
    if (power.kind == kind && power.tics != 0 &&
        (power.tics < 0 || power.tics > kFlashTail || (power.tics & 8) != 0))
      return true;
  return false;
}

int screen_palette(const Player& player) {
  const int flash = flash_palette(player.damage_flash, player.bonus_flash);
  if (flash == 0 && power_shows(player, PowerKind::kIronFeet)) return kRadiationPalette;
  return flash;
}

Sight player_sight(const Player& player) {
  if (power_shows(player, PowerKind::kInvulnerable)) return Sight::kInverse;
  if (power_shows(player, PowerKind::kLightAmp)) return Sight::kLightAmp;
  return Sight::kPlain;
}

void Overlay::draw_status_bar(const StatusBarState& state, int palette, const uint32_t* colors,
                              uint8_t* picture) {
  const int bar_rows = height_ - view_rows_;
  const std::size_t plane = static_cast<std::size_t>(width_) * height_;
  const std::size_t bar_plane = static_cast<std::size_t>(width_) * bar_rows;
  const uint64_t key = state.key() * 16 + static_cast<uint64_t>(palette);
  auto found = bars_.find(key);
  if (found == bars_.end()) {
    if (bars_.size() >= kBarsKept) bars_.clear();
    bar_->compose(state, {.width = width_, .height = height_, .rows_above = view_rows_}, &indices_);
    std::vector<uint8_t> scaled(3 * bar_plane);
    for (std::size_t at = 0; at < bar_plane; ++at)
      for (std::size_t channel = 0; channel < 3; ++channel)
        scaled[channel * bar_plane + at] = static_cast<uint8_t>(colors[indices_[at]] >> (8 * channel));
    found = bars_.emplace(key, std::move(scaled)).first;
  }
  for (std::size_t channel = 0; channel < 3; ++channel)
    std::memcpy(picture + channel * plane + static_cast<std::size_t>(view_rows_) * width_,
                found->second.data() + channel * bar_plane, bar_plane);
}

void Overlay::fill(int left, int top, int right, int bottom, const std::array<uint8_t, 3>& color,
                   uint8_t* picture) const {
  left = std::max(left, 0), top = std::max(top, 0);
  right = std::min(right, width_), bottom = std::min(bottom, height_);
  if (left >= right) return;
  const std::size_t plane = static_cast<std::size_t>(width_) * height_;
  for (std::size_t channel = 0; channel < 3; ++channel)
    for (int row = top; row < bottom; ++row)
      std::memset(picture + channel * plane + static_cast<std::size_t>(row) * width_ + left, color[channel],
                  static_cast<std::size_t>(right - left));
}

void Overlay::draw_boxes(std::span<const HudBox> boxes, int player, uint8_t* picture) const {
  for (const HudBox& box : boxes) {
    if (box.player >= 0 && box.player != player) continue;
    const auto edge = [](float center, float size, float side, int pixels) {
      const float at = std::clamp((center + side * 0.5f * size) * static_cast<float>(pixels), -1e6f, 1e6f);
      return static_cast<int>(std::lround(at));
    };
    const int left = edge(box.x, box.width, -1, width_), top = edge(box.y, box.height, -1, height_);
    fill(left, top, std::max(left + 1, edge(box.x, box.width, 1, width_)),
         std::max(top + 1, edge(box.y, box.height, 1, height_)), box.color, picture);
  }
}

void Overlay::draw_crosshair(int health, uint8_t* picture) const {
  // A small plus, from red over yellow to green with the player's health.
  const int level = std::clamp(health, 0, 100);
  const std::array<uint8_t, 3> color{static_cast<uint8_t>(level >= 50 ? (100 - level) * 255 / 50 : 255),
                                     static_cast<uint8_t>(level >= 50 ? 255 : level * 255 / 50), 0};
  const int x = width_ / 2, y = view_rows_ / 2;
  const int arm = std::max(1, width_ / 80), thickness = std::max(1, width_ / 160);
  fill(x - arm, y, x + arm + thickness, y + thickness, color, picture);
  fill(x, y - arm, x + thickness, y + arm + thickness, color, picture);
}

}  // namespace comrad::doom
