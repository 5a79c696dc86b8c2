// Lights: changes at once, fades, glows, flickers, strobes, waves of light through rooms.
#include "sim_workers/engine/specials/mover_families.h"
#include "sim_workers/engine/specials/sector_neighbours.h"

namespace comrad::doom {
namespace {

constexpr int32_t kStrobeBrightTics = 5, kStrobeFastTics = 15, kStrobeSlowTics = 35;
constexpr int32_t kGlowStep = 8;
constexpr int32_t kFireTics = 4, kFireStep = 16;
constexpr int32_t kPhaseCount = 64;  // tics of one wave

/// Sector types with a light, in ZDoom's numbering.
enum LightType : int32_t {
  kTypePhased = 1,
  kTypeSequenceStart = 2,
  kTypeSequence1 = 3,
  kTypeSequence2 = 4,
  kTypeFlicker = 65,
  kTypeStrobeFast = 66,
  kTypeStrobeSlow = 67,
  kTypeStrobeHurt = 68,
  kTypeGlow = 72,
  kTypeStrobeSlowSync = 76,
  kTypeStrobeFastSync = 77,
  kTypeFireFlicker = 81,
  kTypeScrollStrobeHurt = 104,
  kTypeSequenceSpecial1 = 197,
};

Sector& sector_of(World& world, const LightEffect& light) { return world.state().sectors[light.sector]; }

void stop_lights(World& world, uint32_t sector) {
  for (LightEffect& light : world.state().movers.lights)
    if (light.sector == sector) light.removed = true;
}

/// A new effect takes the place of the sector's old one.
void start_light(World& world, const LightEffect& light) {
  stop_lights(world, light.sector);
  for (LightEffect& slot : world.state().movers.lights) {
    if (!slot.removed || slot.sector != light.sector) continue;
    slot = light;
    return;
  }
  world.state().movers.lights.push_back(light);
}

/// Low and high of an effect between the sector's own light and the darkest around.
LightEffect between_neighbours(const World& world, uint32_t sector, LightKind kind) {
  LightEffect light;
  light.sector = sector, light.kind = kind;
  light.high = world.sectors()[sector].light;
  light.low = min_light_around(world, sector, light.high);
  return light;
}

void start_strobe(World& world, uint32_t sector, int32_t bright_tics, int32_t dark_tics, bool in_step) {
  LightEffect light = between_neighbours(world, sector, LightKind::kStrobe);
  if (light.low == light.high) light.low = 0;
  light.bright_tics = bright_tics, light.dark_tics = dark_tics;
  light.left_tics = in_step ? 1 : (world.random_byte() & 7) + 1;
  start_light(world, light);
}

void start_glow(World& world, uint32_t sector) {
  LightEffect light = between_neighbours(world, sector, LightKind::kGlow);
  light.direction = -1;
  start_light(world, light);
}

void start_flash(World& world, uint32_t sector) {
  LightEffect light = between_neighbours(world, sector, LightKind::kFlash);
  light.bright_tics = 64, light.dark_tics = 7;  // masks of the random lengths
  light.left_tics = (world.random_byte() & light.bright_tics) + 1;
  start_light(world, light);
}

void start_fire(World& world, uint32_t sector) {
  LightEffect light = between_neighbours(world, sector, LightKind::kFireFlicker);
  light.low += kFireStep;
  light.left_tics = kFireTics;
  start_light(world, light);
}

void start_phase(World& world, uint32_t sector, int32_t base, int32_t phase) {
  LightEffect light;
  light.sector = sector, light.kind = LightKind::kPhased;
  light.low = base;
  light.start = phase & (kPhaseCount - 1);
  start_light(world, light);
}

/// A sequence runs from its start through sectors that are marked in turn; each lags behind the one before.
void start_sequence(World& world, uint32_t first) {
  std::vector<uint32_t> chain = {first};
  int32_t wanted = kTypeSequence1;
  while (chain.size() <= world.sectors().size()) {
    std::optional<uint32_t> next;
    const uint32_t previous = chain.size() > 1 ? chain[chain.size() - 2] : first;
    for_each_neighbour(world, chain.back(), [&](uint32_t other) {
      if (!next && other != previous && other != chain.back() &&
          (world.sectors()[other].special & kTypeMask) == wanted &&
          std::find(chain.begin(), chain.end(), other) == chain.end())
        next = other;
    });
    if (!next) break;
    chain.push_back(*next);
    wanted = wanted == kTypeSequence1 ? kTypeSequence2 : kTypeSequence1;
  }
  const int32_t base = world.sectors()[first].light;
  for (std::size_t i = 0; i < chain.size(); ++i)
    start_phase(world, chain[i], base,
                kPhaseCount - 1 - static_cast<int32_t>(i * kPhaseCount / chain.size()));
  for (const uint32_t sector : chain) world.state().sectors[sector].special &= ~kTypeMask;
}

/// How much light a wave adds `phase` tics after its crest.
int32_t wave_at(int32_t phase) {
  const int32_t distance = std::min(phase, kPhaseCount - phase);
  return std::max(0, 128 - 11 * distance);
}

void start_flicker_between(World& world, uint32_t sector, int32_t high, int32_t low) {
  LightEffect light;
  light.sector = sector, light.kind = LightKind::kFlicker;
  light.high = std::clamp(high, 0, 255), light.low = std::clamp(low, 0, 255);
  light.left_tics = (world.random_byte() & 64) + 1;
  world.state().sectors[sector].light = light.high;
  start_light(world, light);
}

void start_strobe_between(World& world, uint32_t sector, int32_t high, int32_t low, int32_t high_tics,
                          int32_t low_tics) {
  LightEffect light;
  light.sector = sector, light.kind = LightKind::kStrobe;
  light.high = std::clamp(high, 0, 255), light.low = std::clamp(low, 0, 255);
  light.bright_tics = std::max(high_tics, 1), light.dark_tics = std::max(low_tics, 1);
  light.left_tics = 1;
  start_light(world, light);
}

/// From `start` to `end` in `tics`; a glow then turns round, for ever.
void start_ramp(World& world, uint32_t sector, int32_t start, int32_t end, int32_t tics, bool glows) {
  LightEffect light;
  light.sector = sector, light.kind = LightKind::kFade;
  light.start = std::clamp(start, 0, 255), light.end = std::clamp(end, 0, 255);
  light.dark_tics = tics;
  light.direction = glows ? 1 : 0;
  if (tics <= 0 || (!glows && light.start == light.end)) {
    stop_lights(world, sector);
    world.state().sectors[sector].light = light.end;
    return;
  }
  start_light(world, light);
}

template <typename Change>
int32_t change_lights(World& world, int32_t tag, Change change) {
  for_each_tagged_sector(world, tag, [&](uint32_t sector) { change(sector); });
  return 1;
}

void tic_light(World& world, LightEffect& light) {
  Sector& sector = sector_of(world, light);
  switch (light.kind) {
    case LightKind::kFlash:
    case LightKind::kFlicker: {
      if (--light.left_tics > 0) return;
      const bool flash = light.kind == LightKind::kFlash;
      if (sector.light == light.high) {
        sector.light = light.low;
        light.left_tics = (world.random_byte() & 7) + 1;
      } else {
        sector.light = light.high;
        light.left_tics = (world.random_byte() & (flash ? light.bright_tics : 31)) + 1;
      }
      return;
    }
    case LightKind::kStrobe:
      if (--light.left_tics > 0) return;
      if (sector.light == light.low) {
        sector.light = light.high;
        light.left_tics = light.bright_tics;
      } else {
        sector.light = light.low;
        light.left_tics = light.dark_tics;
      }
      return;
    case LightKind::kGlow:
      sector.light += light.direction * kGlowStep;
      if (light.direction < 0 ? sector.light <= light.low : sector.light >= light.high) {
        sector.light -= light.direction * kGlowStep;
        light.direction = -light.direction;
      }
      return;
    case LightKind::kFireFlicker: {
      if (--light.left_tics > 0) return;
      const int32_t amount = (world.random_byte() & 3) * kFireStep;
      sector.light = std::max(light.low, light.high - amount);
      light.left_tics = kFireTics;
      return;
    }
    case LightKind::kFade:
      if (light.elapsed++ >= light.dark_tics) {
        if (light.direction == 0) {
          sector.light = light.end;
          light.removed = true;
          return;
        }
        light.elapsed -= light.dark_tics;
        std::swap(light.start, light.end);
      }
      sector.light = light.start +
                     static_cast<int32_t>(int64_t{light.end - light.start} * light.elapsed / light.dark_tics);
      return;
    case LightKind::kPhased:
      light.elapsed = (light.elapsed + 1) & (kPhaseCount - 1);
      sector.light = std::min(255, light.low + wave_at((light.start + light.elapsed) & (kPhaseCount - 1)));
      return;
  }
}

}  // namespace

std::optional<int32_t> execute_light(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  auto& sectors = world.state().sectors;
  const auto set = [&](uint32_t sector, int64_t light) {
    sectors[sector].light = static_cast<int32_t>(std::clamp<int64_t>(light, 0, 255));
  };
  switch (call.number) {
    case Special::kLight_ForceLightning:  // there is no lightning
      return 0;
    case Special::kLight_RaiseByValue:  // tag, value
      return change_lights(world, a[0], [&](uint32_t i) { set(i, int64_t{sectors[i].light} + a[1]); });
    case Special::kLight_LowerByValue:
      return change_lights(world, a[0], [&](uint32_t i) { set(i, int64_t{sectors[i].light} - a[1]); });
    case Special::kLight_ChangeToValue:
      return change_lights(world, a[0], [&](uint32_t i) { set(i, a[1]); });
    case Special::kLight_Fade:  // tag, value, tics
      return change_lights(world, a[0],
                           [&](uint32_t i) { start_ramp(world, i, sectors[i].light, a[1], a[2], false); });
    case Special::kLight_Glow:  // tag, upper, lower, tics
      return change_lights(world, a[0], [&](uint32_t i) { start_ramp(world, i, a[1], a[2], a[3], true); });
    case Special::kLight_Flicker:  // tag, upper, lower
      return change_lights(world, a[0], [&](uint32_t i) { start_flicker_between(world, i, a[1], a[2]); });
    case Special::kLight_Strobe:  // tag, upper, lower, upper tics, lower tics
      return change_lights(world, a[0],
                           [&](uint32_t i) { start_strobe_between(world, i, a[1], a[2], a[3], a[4]); });
    case Special::kLight_Stop:  // tag
      return change_lights(world, a[0], [&](uint32_t i) { stop_lights(world, i); });
    case Special::kLight_StrobeDoom:  // tag, upper tics, lower tics
      return change_lights(world, a[0], [&](uint32_t i) {
        start_strobe(world, i, std::max(a[1], 1), std::max(a[2], 1), false);
      });
    case Special::kLight_MinNeighbor:  // tag
      return change_lights(world, a[0],
                           [&](uint32_t i) { set(i, min_light_around(world, i, sectors[i].light)); });
    case Special::kLight_MaxNeighbor:
      return change_lights(world, a[0], [&](uint32_t i) { set(i, max_light_around(world, i)); });
    default:
      return std::nullopt;
  }
}

void start_lights(World& world) {
  for (uint32_t index = 0; index < world.sectors().size(); ++index) {
    Sector& sector = world.state().sectors[index];
    switch (sector.special & kTypeMask) {
      case kTypePhased:
        start_phase(world, index, 48, kPhaseCount - 1 - (sector.light & (kPhaseCount - 1)));
        break;
      case kTypeSequenceStart:
        start_sequence(world, index);
        break;
      case kTypeFlicker:
        start_flash(world, index);
        break;
      case kTypeStrobeFast:
      case kTypeStrobeHurt:
        start_strobe(world, index, kStrobeBrightTics, kStrobeFastTics, false);
        break;
      case kTypeStrobeSlow:
        start_strobe(world, index, kStrobeBrightTics, kStrobeSlowTics, false);
        break;
      case kTypeGlow:
        start_glow(world, index);
        break;
      case kTypeStrobeSlowSync:
        start_strobe(world, index, kStrobeBrightTics, kStrobeSlowTics, true);
        break;
      case kTypeStrobeFastSync:
      case kTypeScrollStrobeHurt:
        start_strobe(world, index, kStrobeBrightTics, kStrobeFastTics, true);
        break;
      case kTypeFireFlicker:
        start_fire(world, index);
        break;
      default:
        break;
    }
  }
}

void tic_lights(World& world) {
  std::vector<LightEffect>& lights = world.state().movers.lights;
  for (LightEffect& light : lights)
    if (!light.removed) tic_light(world, light);
  std::erase_if(lights, [](const LightEffect& light) { return light.removed; });
}

}  // namespace comrad::doom
