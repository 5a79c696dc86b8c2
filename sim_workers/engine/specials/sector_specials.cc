// What sectors do to players who stand on their floors: damage, healing, secrets, the end; and the specials
// that set a sector's numbers.
#include <algorithm>
#include <cstdint>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/specials/special_families.h"

namespace comrad::doom {
namespace {

// The low byte of a sector's special is its type, the bits above are Boom's.
constexpr int32_t kSectorTypeMask = 0xFF, kDamageBits = 0x300, kDamageShift = 8;
constexpr int32_t kSecretBit = 0x400, kFrictionBit = 0x800;

constexpr int32_t kClockTics = 32;           // floors hurt whenever the map clock is a multiple of this
constexpr int32_t kEveryTicFrom = 50;        // a sector's damage of at least this hurts every tic
constexpr int32_t kSuitLeaksFrom = 20;       // and from here a radiation suit leaks now and then
constexpr int32_t kLeak = 5, kAlways = 256;  // of 256
constexpr int32_t kExitHealth = 10;          // type 75 ends the level when so little health is left

/// Hurt by a floor: how much, how often, and how much of it gets through a radiation suit.
struct FloorDamage {
  int32_t amount = 0, interval = kClockTics, leak = 0;
  DamageType type = DamageType::kNormal;
};

enum SectorType : int32_t {
  kStrobeHurt = 68,
  kHellslime = 69,
  kNukage = 71,
  kDamageEnd = 75,
  kSuperHellslime = 80,
  kLavaWimpy = 82,
  kLavaHefty = 83,
  kScrollEastLava = 84,
  kSludge = 85,
  kStrifeHellslime = 105,
  kInstantDeath = 115,
  kStrifeSuperHellslime = 116,
  kHeal = 196,
};

FloorDamage damage_of_type(int32_t type) {
  switch (type) {
    case kNukage:
      return {.amount = 5, .type = DamageType::kSlime};
    case kHellslime:
      return {.amount = 10, .type = DamageType::kSlime};
    case kStrobeHurt:
    case kSuperHellslime:
      return {.amount = 20, .leak = kLeak, .type = DamageType::kSlime};
    case kSludge:
      return {.amount = 4, .type = DamageType::kSlime};
    case kLavaWimpy:
    case kScrollEastLava:
      return {.amount = 5, .leak = kAlways, .type = DamageType::kFire};
    case kLavaHefty:
      return {.amount = 8, .leak = kAlways, .type = DamageType::kFire};
    case kDamageEnd:
      return {.amount = 20, .leak = kAlways};
    case kStrifeHellslime:
      return {.amount = 2, .type = DamageType::kSlime};
    case kStrifeSuperHellslime:
      return {.amount = 4, .type = DamageType::kSlime};
    case kInstantDeath:
      return {.amount = kTelefragDamage, .interval = 1, .leak = kAlways, .type = DamageType::kInstantDeath};
    default:
      return {};
  }
}

FloorDamage damage_of_bits(int32_t special) {
  static constexpr FloorDamage kDamages[4] = {{},
                                              {.amount = 5, .type = DamageType::kSlime},
                                              {.amount = 10, .type = DamageType::kSlime},
                                              {.amount = 20, .leak = kLeak, .type = DamageType::kSlime}};
  return kDamages[(special & kDamageBits) >> kDamageShift];
}

/// What the map (damageamount) or a script (SetSectorDamage) gave the sector.
FloorDamage damage_of_fields(const Sector& sector) {
  FloorDamage damage{.amount = sector.damage_amount, .type = static_cast<DamageType>(sector.damage_type)};
  damage.interval = sector.damage_interval > 0              ? sector.damage_interval
                    : sector.damage_amount >= kEveryTicFrom ? 1
                                                            : kClockTics;
  damage.leak = sector.damage_leak > 0                  ? sector.damage_leak
                : sector.damage_amount < kSuitLeaksFrom ? 0
                : sector.damage_amount < kEveryTicFrom  ? kLeak
                                                        : kAlways;
  return damage;
}

void hurt(World& world, int player_index, const FloorDamage& damage) {
  if (damage.amount <= 0 || world.tic_count() % static_cast<uint64_t>(damage.interval) != 0) return;
  const Player& player = world.player(player_index);
  if (!player.alive) return;
  if (player.has_power(PowerKind::kIronFeet) && (damage.leak < kAlways) &&
      (damage.leak == 0 || world.random_byte() >= damage.leak))
    return;
  if (Actor* const body = world.body_of(player_index))
    damage_actor(world, *body, nullptr, nullptr, damage.amount, damage.type);
}

int32_t for_each_tag(World& world, const SpecialCall& call, void (*set)(Sector&, const SpecialCall&)) {
  for_each_tagged_sector(world, call.args[0],
                         [&](uint32_t index) { set(world.state().sectors[index], call); });
  return 1;
}

uint32_t color_from(int32_t red, int32_t green, int32_t blue) {
  const auto byte = [](int32_t value) { return static_cast<uint32_t>(std::clamp(value, 0, 255)); };
  return byte(red) << 16 | byte(green) << 8 | byte(blue);
}

}  // namespace

void start_sector_specials(World& world) {
  WorldState& state = world.state();
  state.secret_total = 0;
  for (Sector& sector : state.sectors) {
    if ((sector.special & kSecretBit) != 0) sector.secret = true;
    if ((sector.special & kFrictionBit) != 0) sector.special_friction = true;
    state.has_special_friction |= sector.special_friction;
    state.secret_total += sector.secret;
  }
}

void tic_player_in_sector(World& world, int player_index) {
  Actor* const body = world.body_of(player_index);
  if (body == nullptr) return;
  const uint32_t index = body->sector_index;
  const Sector& sector = world.sectors()[index];
  if (sector.special == 0 && sector.damage_amount <= 0 && !sector.secret) return;
  if (body->z > sector.floor_height) return;

  const int32_t special = sector.special, type = special & kSectorTypeMask;
  const FloorDamage fields = damage_of_fields(sector);
  const bool is_of_map = sector.damage_amount == world.level().sectors[index].damage_amount;
  if (sector.secret) {
    world.state().sectors[index].secret = false;
    ++world.state().players[static_cast<std::size_t>(player_index)].secret_count;
    ++world.state().secret_found;
  }
  if (type == kHeal && world.tic_count() % kClockTics == 0) heal_actor(world, *body, 1);
  // A sector hurts in one way: the map's field or a script's call before the special's bits before its type.
  if (sector.damage_amount > 0) {
    // The map's own damage counts from clock 0; what a script set at map start, from the first tic after it.
    if (world.tic_count() != 0 || is_of_map) hurt(world, player_index, fields);
  } else if ((special & kDamageBits) != 0) {
    hurt(world, player_index, damage_of_bits(special));
  } else {
    hurt(world, player_index, damage_of_type(type));
  }
  if (type == kDamageEnd && (special & kDamageBits) == 0) {
    Player& player = world.state().players[static_cast<std::size_t>(player_index)];
    player.god_mode = false;
    if (player.health <= kExitHealth) world.exit_level();
  }
}

void clear_special_damage(Sector& sector) {
  sector.special &= ~kDamageBits;
  if (damage_of_type(sector.special & kSectorTypeMask).amount > 0) sector.special &= ~kSectorTypeMask;
}

std::optional<int32_t> execute_sector_special(World& world, const SpecialCall& call) {
  switch (call.number) {
    case Special::kSector_SetColor:  // tag, red, green, blue
      return for_each_tag(world, call, [](Sector& sector, const SpecialCall& c) {
        sector.light_color = color_from(c.args[1], c.args[2], c.args[3]);
      });
    case Special::kSector_SetFade:
      return for_each_tag(world, call, [](Sector& sector, const SpecialCall& c) {
        sector.fade_color = color_from(c.args[1], c.args[2], c.args[3]);
      });
    case Special::kSector_SetDamage:  // tag, amount, kind, interval, leak
      return for_each_tag(world, call, [](Sector& sector, const SpecialCall& c) {
        clear_special_damage(sector);
        sector.damage_amount = c.args[1];
        sector.damage_type = static_cast<uint8_t>(damage_type_of(c.args[2]));
        sector.damage_interval = std::max(c.args[3], 0);
        sector.damage_leak = std::clamp(c.args[4], 0, kAlways);
      });
    case Special::kSector_SetGravity:  // tag, whole, hundredths
      return for_each_tag(world, call, [](Sector& sector, const SpecialCall& c) {
        sector.gravity =
            clamped_units(std::clamp(c.args[1], -100, 100)) + std::clamp(c.args[2], 0, 99) * kFracUnit / 100;
      });
    case Special::kSector_SetCeilingScale2:  // tag, x, y (16.16)
    case Special::kSector_SetFloorScale2: {
      for_each_tagged_sector(world, call.args[0], [&](uint32_t index) {
        Sector& sector = world.state().sectors[index];
        FlatPlacement& placement = call.number == Special::kSector_SetCeilingScale2 ? sector.ceiling_placement
                                                                                    : sector.floor_placement;
        if (call.args[1] > 0) placement.scale_x = to_float(call.args[1]);
        if (call.args[2] > 0) placement.scale_y = to_float(call.args[2]);
      });
      return 1;
    }
    default:
      return std::nullopt;
  }
}

}  // namespace comrad::doom
