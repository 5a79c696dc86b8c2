#include "sim_workers/engine/render/status_bar.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>

namespace comrad::doom {
namespace {

constexpr int kFaceTics = 17;      // Doom's face looks elsewhere every half second
constexpr int kOuchFlash = 21;     // a red flash as strong as more than 20 points of damage leave
constexpr int kRampageShots = 10;  // of one burst: the face of one who fires on and on

// Places in the 320x32 bar (Doom's screen coordinates less 168 rows); numbers are right-aligned.
constexpr int kNumberRow = 3, kAmmoRight = 44, kHealthRight = 90, kArmorRight = 221, kArmsLeft = 104;
constexpr int kArmsNumberLeft = 111, kArmsNumberTop = 4, kArmsStepX = 12, kArmsStepY = 10;
constexpr int kFaceLeft = 143, kFaceTop = 0, kTeamFieldTop = 1, kTeamFieldWidth = 35, kTeamFieldHeight = 31;
constexpr int kKeyLeft = 239, kKeyTop = 3, kKeyStep = 10;
constexpr int kOwnedRight = 288, kMaxRight = 314;
constexpr int kOwnedRow[4] = {5, 11, 17, 23};  // bullets, shells, rockets, cells as printed on the bar

void mix(uint64_t value, uint64_t* hash) {
  *hash = (*hash ^ value) * 0x9E3779B97F4A7C15ull;
  *hash ^= *hash >> 29;
}

/// Where the one who hurt the player last is, as Doom's face looks at it.
StatusBarState::Face pained_face(const World& world, const Player& player, const Actor& body) {
  using Face = StatusBarState::Face;
  if (player.damage_flash >= kOuchFlash) return Face::kOuch;
  const Actor* attacker = player.attacker_id == 0 ? nullptr : world.find_actor(player.attacker_id);
  if (attacker == nullptr || attacker->id == body.id) return Face::kHurt;
  const Angle aside = angle_to(body.x, body.y, attacker->x, attacker->y) - body.angle;
  if (aside < kAngle45 || aside > 0u - kAngle45) return Face::kHurt;
  return aside < kAngle180 ? Face::kTurnLeft : Face::kTurnRight;
}

/// Behind the face in a game of several: the player's colour, which is the same bright green for all (measured: what
/// ViZDoom 1.3.2 draws there; the IWAD's own STFB0 is dark).
IndexedImage team_field(const ArtArchive& archive) {
  IndexedImage field;
  field.width = kTeamFieldWidth, field.height = kTeamFieldHeight;
  const uint8_t inside = archive.nearest({95, 207, 87}), left_top = archive.nearest({91, 191, 79}),
                right = archive.nearest({83, 175, 71}), bottom = archive.nearest({75, 159, 63});
  for (int y = 0; y < field.height; ++y)
    for (int x = 0; x < field.width; ++x)
      field.texels.push_back(y == field.height - 1  ? bottom
                             : x == 0 || y == 0     ? left_top
                             : x == field.width - 1 ? right
                                                    : inside);
  return field;
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
  for (const int8_t held : keys) mix(static_cast<uint64_t>(held + 1), &hash);
  mix(static_cast<uint64_t>(face) | (team ? 256u : 0u), &hash);
  return hash;
}

StatusBarState status_bar_state(const World& world, int player_index) {
  using Face = StatusBarState::Face;
  const Player& player = world.player(player_index);
  const ActorCatalog& catalog = world.catalog();
  const ActorCatalog::Known& known = catalog.known();
  StatusBarState state;
  state.health = std::max(0, player.health);
  state.armor = player.armor;
  state.team = world.player_count() > 1;

  const uint32_t kinds[4] = {known.clip, known.shell, known.rocket_ammo, known.cell};
  for (std::size_t kind = 0; kind < 4; ++kind) {
    if (kinds[kind] == kNoType) continue;
    const ActorType& type = catalog[kinds[kind]];
    state.ammo_max[kind] =
        player.has_backpack ? std::max(type.max_amount, type.backpack_max_amount) : type.max_amount;
  }
  const uint32_t wanted =
      player.ready_weapon < catalog.size() ? catalog[player.ready_weapon].weapon.ammo_type : kNoType;
  if (wanted != kNoType) state.ammo = 0;
  for (const InventoryItem& item : player.inventory) {
    if (item.type >= catalog.size() || item.amount <= 0) continue;
    const ActorType& type = catalog[item.type];
    if (item.type == wanted) state.ammo = item.amount;
    for (std::size_t kind = 0; kind < 4; ++kind)
      if (item.type == kinds[kind]) {
        state.ammo_owned[kind] = item.amount;
        if (item.max_amount > 0) state.ammo_max[kind] = item.max_amount;
      }
    if (type.item_class == ItemClass::kWeapon && type.weapon.slot >= 0 && type.weapon.slot < 10)
      state.weapons |= 1u << type.weapon.slot;
    if (type.item_class == ItemClass::kKey && type.lock_key >= 1 && type.lock_key <= 6) {
      // Locks count red, blue, yellow; the bar shows blue, yellow, red.
      const std::size_t row[3] = {2, 0, 1};
      int8_t& held = state.keys[row[(type.lock_key - 1) % 3]];
      held = std::max(held, static_cast<int8_t>(type.lock_key > 3 ? 1 : 0));
    }
  }

  if (!player.alive || player.health <= 0) {
    state.face = Face::kDead;
  } else if (player.god_mode || player.has_power(PowerKind::kInvulnerable)) {
    state.face = Face::kGod;
  } else if (player.bonus_flash > 0 && player.pending_weapon != kNoType) {
    state.face = Face::kEvil;
  } else if (player.damage_flash > 0) {
    state.face = pained_face(world, player, world.body(player_index));
  } else if (player.refire >= kRampageShots) {
    state.face = Face::kHurt;
  } else {
    // Where the face looks is chance in Doom; here it is a function of the clock, so that a picture is one of
    // the world.
    uint64_t hash = 0x13198A2E03707344ull;
    mix(world.tic_count() / kFaceTics * 64 + static_cast<uint64_t>(player_index), &hash);
    state.face = static_cast<Face>(hash % 3);
  }
  return state;
}

Expected<StatusBar> StatusBar::create(const ArtArchive& archive) {
  StatusBar bar;
  COMRAD_TRY_ASSIGN(bar.bar_, archive.graphic("STBAR"));
  COMRAD_TRY_ASSIGN(bar.arms_, archive.graphic("STARMS"));
  COMRAD_TRY_ASSIGN(bar.percent_, archive.graphic("STTPRCNT"));
  bar.team_field_ = team_field(archive);
  COMRAD_TRY_ASSIGN(bar.god_face_, archive.graphic("STFGOD0"));
  COMRAD_TRY_ASSIGN(bar.dead_face_, archive.graphic("STFDEAD0"));
  for (std::size_t digit = 0; digit < 10; ++digit) {
    const std::string number = std::to_string(digit);
    COMRAD_TRY_ASSIGN(bar.large_[digit], archive.graphic("STTNUM" + number));
    COMRAD_TRY_ASSIGN(bar.gray_[digit], archive.graphic("STGNUM" + number));
    COMRAD_TRY_ASSIGN(bar.yellow_[digit], archive.graphic("STYSNUM" + number));
  }
  for (std::size_t key = 0; key < 6; ++key) {
    COMRAD_TRY_ASSIGN(bar.keys_[key], archive.graphic(fmt::format("STKEYS{}", key)));
  }
  for (std::size_t pain = 0; pain < 5; ++pain) {
    const std::string level = std::to_string(pain);
    const std::string names[kLivingFaces] = {
        "STFST" + level + "0", "STFST" + level + "1", "STFST" + level + "2", "STFKILL" + level,
        "STFTR" + level + "0", "STFTL" + level + "0", "STFOUCH" + level,     "STFEVL" + level};
    for (std::size_t face = 0; face < kLivingFaces; ++face) {
      COMRAD_TRY_ASSIGN(bar.faces_[pain][face], archive.graphic(names[face]));
    }
  }
  return bar;
}

void StatusBar::draw(const IndexedImage& image, int x, int y, const Canvas& canvas,
                     std::vector<uint8_t>* indices) const {
  x -= image.left_offset, y += kScreenHeight - kHeight - image.top_offset;
  const auto place = [](int at, int pixels, int units) {
    const int cut = at * pixels / units;
    return cut - (cut * units > at * pixels ? 1 : 0);  // rounded down
  };
  const int left = place(x, canvas.width, kWidth), right = place(x + image.width, canvas.width, kWidth);
  const int top = place(y, canvas.height, kScreenHeight);
  const int bottom = place(y + image.height, canvas.height, kScreenHeight);
  // Texels per pixel in 16.16, cut off: a pixel on the border of two texels shows the first.
  const int64_t step_x = (int64_t{kWidth} << 16) / canvas.width,
                step_y = (int64_t{kScreenHeight} << 16) / canvas.height;
  const int bar_rows = canvas.height - canvas.rows_above;
  for (int row = std::max(top, canvas.rows_above); row < std::min(bottom, canvas.height); ++row) {
    const int from_y = std::min(static_cast<int>((row - top) * step_y >> 16), image.height - 1);
    for (int column = std::max(left, 0); column < std::min(right, canvas.width); ++column) {
      const int from_x = std::min(static_cast<int>((column - left) * step_x >> 16), image.width - 1);
      const uint8_t index = image.at(from_x, from_y);
      if (index == kTransparentIndex || row - canvas.rows_above >= bar_rows) continue;
      (*indices)[static_cast<std::size_t>(row - canvas.rows_above) * static_cast<std::size_t>(canvas.width) +
                 static_cast<std::size_t>(column)] = index;
    }
  }
}

void StatusBar::draw_number(std::span<const IndexedImage> digits, int number, int right, int y,
                            int digit_count, const Canvas& canvas, std::vector<uint8_t>* indices) const {
  int limit = 1;
  for (int i = 0; i < digit_count; ++i) limit *= 10;
  number = std::clamp(number, 0, limit - 1);
  do {
    right -= digits[0].width;
    draw(digits[static_cast<std::size_t>(number % 10)], right, y, canvas, indices);
    number /= 10;
  } while (number > 0);
}

void StatusBar::compose(const StatusBarState& state, const Canvas& canvas, std::vector<uint8_t>* indices) {
  if (canvas != empty_canvas_) {
    empty_canvas_ = canvas;
    empty_.assign(
        static_cast<std::size_t>(canvas.width) * static_cast<std::size_t>(canvas.height - canvas.rows_above),
        kTransparentIndex);
    draw(bar_, 0, 0, canvas, &empty_);
    draw(arms_, kArmsLeft, 0, canvas, &empty_);
  }
  *indices = empty_;
  if (state.ammo >= 0) draw_number(large_, state.ammo, kAmmoRight, kNumberRow, 3, canvas, indices);
  draw_number(large_, state.health, kHealthRight, kNumberRow, 3, canvas, indices);
  draw(percent_, kHealthRight, kNumberRow, canvas, indices);
  draw_number(large_, state.armor, kArmorRight, kNumberRow, 3, canvas, indices);
  draw(percent_, kArmorRight, kNumberRow, canvas, indices);
  for (int slot = 2; slot <= 7; ++slot) {
    const bool owned = (state.weapons >> slot & 1u) != 0;
    draw((owned ? yellow_ : gray_)[static_cast<std::size_t>(slot)],
         kArmsNumberLeft + (slot - 2) % 3 * kArmsStepX, kArmsNumberTop + (slot - 2) / 3 * kArmsStepY, canvas,
         indices);
  }
  if (state.team) draw(team_field_, kFaceLeft, kTeamFieldTop, canvas, indices);
  const auto pain = static_cast<std::size_t>((100 - std::clamp(state.health, 0, 100)) * 5 / 101);
  using Face = StatusBarState::Face;
  draw(state.face == Face::kDead  ? dead_face_
       : state.face == Face::kGod ? god_face_
                                  : faces_[pain][static_cast<std::size_t>(state.face)],
       kFaceLeft, kFaceTop, canvas, indices);
  for (std::size_t row = 0; row < 3; ++row)
    if (state.keys[row] >= 0)
      draw(keys_[static_cast<std::size_t>(state.keys[row]) * 3 + row], kKeyLeft,
           kKeyTop + static_cast<int>(row) * kKeyStep, canvas, indices);
  for (std::size_t kind = 0; kind < 4; ++kind) {
    draw_number(yellow_, state.ammo_owned[kind], kOwnedRight, kOwnedRow[kind], 3, canvas, indices);
    draw_number(yellow_, state.ammo_max[kind], kMaxRight, kOwnedRow[kind], 3, canvas, indices);
  }
}

}  // namespace comrad::doom
