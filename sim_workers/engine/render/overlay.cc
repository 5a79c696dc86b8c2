#include "sim_workers/engine/render/overlay.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace comrad::doom {
namespace {

constexpr std::size_t kBarsKept = 1024;
constexpr int kFlashTail = 4 * 32;  // a power's last tics blink: on for 8, off for 8
constexpr int kRadiationPalette = 13;

// The smallest screen of the reference engine. A smaller picture shows what that screen shows, made smaller by
// taking the nearest pixels, because numbers of the bar that are drawn at 128x72 directly are hard to tell apart.
constexpr int kReferenceWidth = 160, kReferenceHeight = 120, kReferenceViewRows = 100;

// The crosshair is a plus of 5 x 5, of 9 x 9 with wide arms on screens from 640 on, and lets the view shine
// through (shares of 256, and the colours below, were fitted to ViZDoom 1.3.2 at 160x120 and 640x480).
constexpr int kCrosshairReach = 2, kLargeCrosshairReach = 4, kLargeCrosshairFrom = 640;
constexpr int kCrosshairShare = 192, kFaintShare = 58;
constexpr int kGreenFrom = 85, kRedBelow = 25, kYellowBand = 30;  // points of health

struct Rgb {
  int red = 0, green = 0, blue = 0;
};

Rgb unpack(uint32_t color) {
  return {static_cast<int>(color & 255), static_cast<int>(color >> 8 & 255),
          static_cast<int>(color >> 16 & 255)};
}

/// From red over yellow to green.
Rgb crosshair_color(int health) {
  if (health >= kGreenFrom) return {0, 255, 0};
  const int above = std::clamp(health - kRedBelow, 0, 2 * kYellowBand);
  return above < kYellowBand ? Rgb{255, above * 255 / kYellowBand, 0}
                             : Rgb{(2 * kYellowBand - above) * 255 / kYellowBand, 255, 0};
}

/// Of 256 packed colours the one nearest to `wanted`; the first one is a hole.
uint32_t search_nearest(const uint32_t* colors, const Rgb& wanted) {
  int best = INT32_MAX;
  uint32_t found = 0;
  for (std::size_t i = 1; i < 256; ++i) {
    const Rgb color = unpack(colors[i]);
    const int red = color.red - wanted.red, green = color.green - wanted.green,
              blue = color.blue - wanted.blue;
    const int distance = red * red + green * green + blue * blue;
    if (distance < best) best = distance, found = colors[i];
  }
  return found;
}

/// Of the crosshair's colour at (x, y) from its middle, in 256ths; 0 outside.
int crosshair_share(int x, int y, bool large) {
  const int across = std::abs(x), down = std::abs(y);
  const int reach = large ? kLargeCrosshairReach : kCrosshairReach;
  if (across > reach || down > reach) return 0;
  if (x == 0 && y == 0) return kFaintShare;
  if (x == 0 || y == 0) return kCrosshairShare;
  return large && std::min(across, down) == 1 ? kFaintShare : 0;
}

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
    const StatusBar::Canvas canvas =
        is_small() ? StatusBar::Canvas{kReferenceWidth, kReferenceHeight, kReferenceViewRows}
                   : StatusBar::Canvas{width_, height_, view_rows_};
    bar_->compose(state, canvas, &indices_);
    std::vector<uint8_t> scaled(3 * bar_plane);
    for (int row = 0; row < bar_rows; ++row) {
      const int from_row =
          std::max((view_rows_ + row) * canvas.height / height_ - canvas.rows_above, 0) * canvas.width;
      for (int column = 0; column < width_; ++column) {
        const uint32_t color =
            colors[indices_[static_cast<std::size_t>(from_row + column * canvas.width / width_)]];
        for (std::size_t channel = 0; channel < 3; ++channel)
          scaled[channel * bar_plane + static_cast<std::size_t>(row * width_ + column)] =
              static_cast<uint8_t>(color >> (8 * channel));
      }
    }
    found = bars_.emplace(key, std::move(scaled)).first;
  }
  for (std::size_t channel = 0; channel < 3; ++channel)
    std::memcpy(picture + channel * plane + static_cast<std::size_t>(view_rows_) * width_,
                found->second.data() + channel * bar_plane, bar_plane);
}

uint32_t Overlay::nearest(int palette, const uint32_t* colors, int red, int green, int blue) {
  const auto wanted = static_cast<uint32_t>(red | green << 8 | blue << 16 | palette << 24);
  // Multiplied by 2^32 / golden ratio, neighbouring colours come to places far apart.
  NearestColor& known = nearest_[(wanted * 0x9E3779B9u) >> (32 - kNearestBits)];
  if (known.wanted != wanted) known = {wanted, search_nearest(colors, {red, green, blue})};
  return known.found;
}

bool Overlay::is_small() const { return width_ < kReferenceWidth || height_ < kReferenceHeight; }

void Overlay::draw_crosshair(int health, int palette, const uint32_t* colors, uint8_t* picture) {
  const int width = is_small() ? kReferenceWidth : width_, height = is_small() ? kReferenceHeight : height_;
  const int view_rows = is_small() ? view_rows_ * kReferenceHeight / height_ : view_rows_;
  const bool large = width >= kLargeCrosshairFrom;
  const int reach = large ? kLargeCrosshairReach : kCrosshairReach;
  const int middle_x = width / 2, middle_y = view_rows / 2;
  const Rgb own = crosshair_color(health);
  const Rgb paint = unpack(nearest(palette, colors, own.red, own.green, own.blue));
  const std::size_t plane = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  for (int row = (middle_y - reach) * height_ / height; row <= (middle_y + reach) * height_ / height; ++row) {
    for (int column = (middle_x - reach) * width_ / width; column <= (middle_x + reach) * width_ / width;
         ++column) {
      const int share =
          crosshair_share(column * width / width_ - middle_x, row * height / height_ - middle_y, large);
      if (share == 0 || row < 0 || column < 0 || row >= view_rows_ || column >= width_) continue;
      uint8_t* const at = picture + static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
                          static_cast<std::size_t>(column);
      const auto mix = [&](std::size_t channel, int painted) {
        return (at[channel * plane] * (256 - share) + painted * share) / 256;
      };
      const Rgb mixed =
          unpack(nearest(palette, colors, mix(0, paint.red), mix(1, paint.green), mix(2, paint.blue)));
      at[0] = static_cast<uint8_t>(mixed.red);
      at[plane] = static_cast<uint8_t>(mixed.green);
      at[2 * plane] = static_cast<uint8_t>(mixed.blue);
    }
  }
}

}  // namespace comrad::doom
