#include "sim_workers/engine/render/overlay.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace comrad::doom {
namespace {

constexpr std::size_t kBarsKept = 1024;
constexpr int kFaceTics = 17;  // Doom's face looks elsewhere every half second

// Places in the 320x32 bar (Doom's screen coordinates less 168 rows); numbers are right-aligned.
constexpr int kNumberRow = 3, kAmmoRight = 44, kHealthRight = 90, kArmorRight = 221, kArmsLeft = 104;
constexpr int kArmsNumberLeft = 111, kArmsNumberTop = 4, kArmsStepX = 12, kArmsStepY = 10;
constexpr int kFaceLeft = 143, kFaceTop = 0, kTeamFieldTop = 1;
constexpr int kOwnedRight = 288, kMaxRight = 314;
constexpr int kOwnedRow[4] = {5, 11, 17, 23};  // bullets, shells, rockets, cells as printed on the bar

void mix(uint64_t value, uint64_t* hash) {
  *hash = (*hash ^ value) * 0x9E3779B97F4A7C15ull;
  *hash ^= *hash >> 29;
}

}  // namespace

uint64_t StatusBarState::key() const {
  uint64_t hash = 0x243F6A8885A308D3ull;
  mix(static_cast<uint32_t>(health) | static_cast<uint64_t>(static_cast<uint32_t>(armor)) << 32, &hash);
  mix(static_cast<uint32_t>(ammo) | static_cast<uint64_t>(weapons) << 32, &hash);
  for (std::size_t i = 0; i < 4; ++i)
    mix(static_cast<uint32_t>(ammo_owned[i]) | static_cast<uint64_t>(static_cast<uint32_t>(ammo_max[i]))
                                                   << 32,
        &hash);
  mix(static_cast<uint64_t>(face) | (team ? 256u : 0u), &hash);
  return hash;
}

StatusBarState status_bar_state(const World& world, int player_index) {
  const Player& player = world.player(player_index);
  StatusBarState state;
  state.health = std::max(0, player.health);
  state.armor = player.armor;
  state.team = world.player_count() > 1;
  if (!player.alive || player.health <= 0) {
    state.face = StatusBarState::Face::kDead;
  } else if (player.damage_flash > 0) {
    state.face = StatusBarState::Face::kHurt;
  } else {
    // Where the face looks is chance in Doom; here it is a function of the clock, so that a picture is one of
    // the world.
    uint64_t hash = 0x13198A2E03707344ull;
    mix(world.tic_count() / kFaceTics * 64 + static_cast<uint64_t>(player_index), &hash);
    state.face = static_cast<StatusBarState::Face>(hash % 3);
  }
  return state;
}

int flash_palette(int damage_flash, int bonus_flash) {
  if (damage_flash > 0) return std::min((damage_flash + 7) / 8, 8);
  if (bonus_flash > 0) return 8 + std::min((bonus_flash + 7) / 8, 4);
  return 0;
}

Expected<StatusBar> StatusBar::create(const ArtArchive& archive) {
  StatusBar bar;
  COMRAD_TRY_ASSIGN(bar.bar_, archive.graphic("STBAR"));
  COMRAD_TRY_ASSIGN(bar.arms_, archive.graphic("STARMS"));
  COMRAD_TRY_ASSIGN(bar.percent_, archive.graphic("STTPRCNT"));
  COMRAD_TRY_ASSIGN(bar.team_field_, archive.graphic("STFB0"));
  COMRAD_TRY_ASSIGN(bar.dead_face_, archive.graphic("STFDEAD0"));
  for (std::size_t digit = 0; digit < 10; ++digit) {
    const std::string number = std::to_string(digit);
    COMRAD_TRY_ASSIGN(bar.large_[digit], archive.graphic("STTNUM" + number));
    COMRAD_TRY_ASSIGN(bar.gray_[digit], archive.graphic("STGNUM" + number));
    COMRAD_TRY_ASSIGN(bar.yellow_[digit], archive.graphic("STYSNUM" + number));
  }
  for (std::size_t pain = 0; pain < 5; ++pain) {
    const std::string level = std::to_string(pain);
    for (std::size_t look = 0; look < 3; ++look) {
      COMRAD_TRY_ASSIGN(bar.faces_[pain][look], archive.graphic("STFST" + level + std::to_string(look)));
    }
    COMRAD_TRY_ASSIGN(bar.faces_[pain][3], archive.graphic("STFKILL" + level));
  }
  return bar;
}

void StatusBar::draw(const IndexedImage& image, int x, int y, std::vector<uint8_t>* indices) const {
  for (int row = 0; row < image.height; ++row) {
    const int to_y = y - image.top_offset + row;
    if (to_y < 0 || to_y >= kHeight) continue;
    for (int column = 0; column < image.width; ++column) {
      const int to_x = x - image.left_offset + column;
      const uint8_t index = image.at(column, row);
      if (to_x < 0 || to_x >= kWidth || index == kTransparentIndex) continue;
      (*indices)[static_cast<std::size_t>(to_y) * kWidth + static_cast<std::size_t>(to_x)] = index;
    }
  }
}

void StatusBar::draw_number(std::span<const IndexedImage> digits, int number, int right, int y,
                            int digit_count, std::vector<uint8_t>* indices) const {
  int limit = 1;
  for (int i = 0; i < digit_count; ++i) limit *= 10;
  number = std::clamp(number, 0, limit - 1);
  do {
    right -= digits[0].width;
    draw(digits[static_cast<std::size_t>(number % 10)], right, y, indices);
    number /= 10;
  } while (number > 0);
}

void StatusBar::compose(const StatusBarState& state, std::vector<uint8_t>* indices) const {
  indices->assign(static_cast<std::size_t>(kWidth) * kHeight, kTransparentIndex);
  draw(bar_, 0, 0, indices);
  draw(arms_, kArmsLeft, 0, indices);
  if (state.ammo >= 0) draw_number(large_, state.ammo, kAmmoRight, kNumberRow, 3, indices);
  draw_number(large_, state.health, kHealthRight, kNumberRow, 3, indices);
  draw(percent_, kHealthRight, kNumberRow, indices);
  draw_number(large_, state.armor, kArmorRight, kNumberRow, 3, indices);
  draw(percent_, kArmorRight, kNumberRow, indices);
  for (int slot = 2; slot <= 7; ++slot) {
    const bool owned = (state.weapons >> slot & 1u) != 0;
    draw((owned ? yellow_ : gray_)[static_cast<std::size_t>(slot)],
         kArmsNumberLeft + (slot - 2) % 3 * kArmsStepX, kArmsNumberTop + (slot - 2) / 3 * kArmsStepY,
         indices);
  }
  if (state.team) draw(team_field_, kFaceLeft, kTeamFieldTop, indices);
  const auto pain = static_cast<std::size_t>((100 - std::clamp(state.health, 0, 100)) * 5 / 101);
  const bool dead = state.face == StatusBarState::Face::kDead;
  draw(dead ? dead_face_ : faces_[pain][static_cast<std::size_t>(state.face)], kFaceLeft, kFaceTop, indices);
  for (std::size_t kind = 0; kind < 4; ++kind) {
    draw_number(yellow_, state.ammo_owned[kind], kOwnedRight, kOwnedRow[kind], 3, indices);
    draw_number(yellow_, state.ammo_max[kind], kMaxRight, kOwnedRow[kind], 3, indices);
  }
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
    bar_->compose(state, &indices_);
    std::vector<uint8_t> scaled(3 * bar_plane);
    for (int row = 0; row < bar_rows; ++row) {
      // Screen rows are 200 to the picture; the bar is the last 32 of them.
      const int from_y =
          std::clamp((2 * (view_rows_ + row) + 1) * 100 / height_ - 168, 0, StatusBar::kHeight - 1);
      for (int column = 0; column < width_; ++column) {
        const int from_x = (2 * column + 1) * StatusBar::kWidth / (2 * width_);
        const uint32_t color = colors[indices_[static_cast<std::size_t>(from_y) * StatusBar::kWidth +
                                               static_cast<std::size_t>(from_x)]];
        const std::size_t at = static_cast<std::size_t>(row) * width_ + static_cast<std::size_t>(column);
        for (std::size_t channel = 0; channel < 3; ++channel)
          scaled[channel * bar_plane + at] = static_cast<uint8_t>(color >> (8 * channel));
      }
    }
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
