#include "sim_workers/engine/acs/map_calls.h"

#include <algorithm>
#include <string>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/actor_calls.h"
#include "sim_workers/engine/acs/actor_properties.h"
#include "sim_workers/engine/acs/strings.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/player_thinker.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/specials/movers.h"

namespace comrad::doom::acs {
namespace {

std::string texture_name(std::string_view name) {
  return name.empty() ? "-" : upper_case(name.substr(0, 64));
}

// GetPlayerInput. BT_TURN180 shows in the first tic of a press alone, so another bit remembers that it is held.
constexpr uint32_t kTurnAroundHeld = 1u << 31, kCrouchBit = 1u << 3, kJumpAndCrouch = 1u << 2 | kCrouchBit;
constexpr int32_t kModifiedInput = 8;               // what MODINPUT_ adds to INPUT_
constexpr int32_t kMoveUnit = 256;                  // of 1/32 unit per tic^2
constexpr int32_t kRiseWalk = 256, kRiseRun = 768;  // flying

// Which bit of SetLineActivation means which flag of a line.
struct ActivationBit {
  int32_t bit;
  uint32_t flags;
};
constexpr std::array<ActivationBit, 11> kActivationBits = {{{1 << 0, kLinePlayerCross},
                                                            {1 << 1, kLinePlayerUse},
                                                            {1 << 2, kLineMonsterCross},
                                                            {1 << 3, kLineImpact},
                                                            {1 << 4, kLinePlayerPush},
                                                            {1 << 5, kLineMissileCross},
                                                            {1 << 6, kLinePlayerUse | kLinePassUse},
                                                            {1 << 7, kLineAnyCross},
                                                            {1 << 8, kLineMonsterUse},
                                                            {1 << 9, kLineMonsterPush},
                                                            {1 << 10, kLinePlayerUseBack}}};

}  // namespace

void set_line_texture(const Caller& caller, int32_t line_id, int32_t side, int32_t part,
                      std::string_view texture) {
  World& world = caller.world;
  const std::string name = texture_name(texture);
  each_line(world, line_id, [&](std::size_t line, LineState&) {
    const Linedef& linedef = world.level().linedefs[line];
    if (side != 0 && !linedef.back.has_value()) return;
    SideState& state = world.state().sides[side == 0 ? linedef.front : *linedef.back];
    switch (part) {
      case kSideTop:
        state.top = name;
        break;
      case kSideMiddle:
        state.middle = name;
        break;
      case kSideBottom:
        state.bottom = name;
        break;
      default:
        return;
    }
    state.retextured = true;
  });
}

void set_line_blocking(World& world, int32_t line_id, int32_t what) {
  constexpr uint32_t kAll = kLineBlocking | kLineBlockEverything | kLineRailing | kLineBlockPlayers;
  constexpr std::array<uint32_t, 5> kWhat = {0, kLineBlocking, kLineBlocking | kLineBlockEverything,
                                             kLineBlocking | kLineRailing, kLineBlockPlayers};
  const uint32_t set = what >= 0 && what < 5 ? kWhat[static_cast<std::size_t>(what)] : kLineBlocking;
  each_line(world, line_id, [&](std::size_t, LineState& line) { line.flags = (line.flags & ~kAll) | set; });
}

void set_line_activation(World& world, int32_t line_id, int32_t activation) {
  uint32_t flags = 0;
  for (const ActivationBit& entry : kActivationBits)
    if ((activation & entry.bit) != 0) flags |= entry.flags;
  each_line(world, line_id, [&](std::size_t, LineState& line) {
    line.flags = (line.flags & ~(kLineActivations | kLinePassUse)) | flags;
  });
}

int32_t get_line_activation(World& world, int32_t line_id) {
  int32_t activation = 0;
  bool found = false;
  each_line(world, line_id, [&](std::size_t, LineState& line) {
    if (found) return;
    found = true;
    for (const ActivationBit& entry : kActivationBits)
      if ((line.flags & entry.flags) == entry.flags) activation |= entry.bit;
  });
  return activation;
}

void replace_textures(World& world, std::string_view from_text, std::string_view to_text, int32_t flags) {
  constexpr int32_t kNotBottom = 1, kNotMiddle = 2, kNotTop = 4, kNotFloor = 8, kNotCeiling = 16;
  const std::string from = texture_name(from_text), to = texture_name(to_text);
  const auto replace = [&](std::string& name, int32_t unless, bool* changed) {
    if ((flags & unless) != 0 || name != from) return;
    name = to;
    if (changed != nullptr) *changed = true;
  };
  for (SideState& side : world.state().sides) {
    replace(side.bottom, kNotBottom, &side.retextured);
    replace(side.middle, kNotMiddle, &side.retextured);
    replace(side.top, kNotTop, &side.retextured);
  }
  for (Sector& sector : world.state().sectors) {
    replace(sector.floor_texture, kNotFloor, nullptr);
    replace(sector.ceiling_texture, kNotCeiling, nullptr);
  }
}

void change_flat(World& world, int32_t tag, std::string_view flat, bool ceiling) {
  if (flat.empty()) return;
  const std::string name = texture_name(flat);
  for (Sector& sector : world.state().sectors)
    if (sector.tag == tag) (ceiling ? sector.ceiling_texture : sector.floor_texture) = name;
}

Fixed sector_height(const World& world, int32_t tag, int32_t x, int32_t y, bool ceiling) {
  const Sector* found = nullptr;
  if (tag != 0) {
    for (const Sector& sector : world.sectors())
      if (sector.tag == tag) {
        found = &sector;
        break;
      }
  } else {
    const auto place = [](int32_t units) { return to_fixed(std::clamp(units, -32000, 32000)); };
    found = &world.sectors()[world.sector_at(place(x), place(y))];
  }
  if (found == nullptr) return 0;
  return ceiling ? found->ceiling_height : found->floor_height;
}

int32_t sector_light(const World& world, int32_t tag) {
  for (const Sector& sector : world.sectors())
    if (sector.tag == tag) return sector.light;
  return 0;
}

void damage_sector(const Caller& caller, int32_t tag, int32_t amount, int32_t type_name, int32_t protection,
                   int32_t flags) {
  constexpr int32_t kPlayers = 1, kOthers = 2, kInAir = 4;
  World& world = caller.world;
  const DamageType type =
      caller.world.catalog().find_damage_type(caller.text(type_name)).value_or(DamageType::kNormal);
  const bool can_be_protected = !caller.text(protection).empty();
  StableList<Actor>& actors = world.state().actors;
  const std::size_t end = actors.size();
  for (std::size_t slot = 0; slot < end; ++slot) {
    Actor& actor = actors[slot];
    if (actor.removed || !actor.has(ActorFlag::kShootable)) continue;
    const Sector& sector = world.sectors()[actor.sector_index];
    if (sector.tag != tag) continue;
    if ((flags & (actor.player_index >= 0 ? kPlayers : kOthers)) == 0) continue;
    if ((flags & kInAir) == 0 && actor.z != sector.floor_height) continue;
    if (can_be_protected && check_inventory(caller, &actor, protection) > 0) continue;
    damage_actor(world, actor, nullptr, nullptr, amount, type);
  }
}

bool tag_is_busy(const World& world, int32_t tag) {
  for (uint32_t i = 0; i < world.sectors().size(); ++i)
    if (world.sectors()[i].tag == tag && sector_is_moving(world, i)) return true;
  return false;
}

bool polyobject_is_busy(const World& world, int32_t number) {
  for (const Polyobject& polyobject : world.state().movers.polyobjects)
    if (polyobject.number == number) return polyobject.kind != 0;
  return false;
}

void watch_plane(const Caller& caller, int32_t tag, Fixed height, int32_t special,
                 const std::array<int32_t, 5>& args, bool ceiling) {
  constexpr std::size_t kWatchersMax = 1024;
  World& world = caller.world;
  std::vector<PlaneWatcher>& watchers = caller.machine().plane_watchers;
  if (watchers.size() >= kWatchersMax) return;
  for (uint32_t i = 0; i < world.sectors().size(); ++i) {
    const Sector& sector = world.sectors()[i];
    if (sector.tag != tag) continue;
    watchers.push_back({.sector = i,
                        .ceiling = ceiling,
                        .height = height,
                        .last = ceiling ? sector.ceiling_height : sector.floor_height,
                        .special = special,
                        .args = args,
                        .activator_id = caller.thread.activator_id,
                        .line = caller.thread.line,
                        .back_side = caller.thread.back_side});
    return;
  }
}

void tic_plane_watchers(World& world) {
  std::vector<PlaneWatcher>& watchers = world.state().scripts.plane_watchers;
  for (std::size_t i = 0; i < watchers.size();) {
    PlaneWatcher& watcher = watchers[i];
    const Sector& sector = world.sectors()[watcher.sector];
    const Fixed now = watcher.ceiling ? sector.ceiling_height : sector.floor_height;
    const bool passed = (watcher.last < watcher.height && now >= watcher.height) ||
                        (watcher.last > watcher.height && now <= watcher.height);
    watcher.last = now;
    if (!passed) {
      ++i;
      continue;
    }
    const PlaneWatcher due = watcher;
    watchers.erase(watchers.begin() + static_cast<std::ptrdiff_t>(i));
    world.events().run_special(world,
                               {.number = due.special,
                                .args = due.args,
                                .activator = due.activator_id != 0 ? world.actor(due.activator_id) : nullptr,
                                .line = due.line,
                                .back_side = due.back_side});
  }
}

int32_t level_info(const World& world, int32_t what) {
  const WorldState& state = world.state();
  switch (what) {
    case 2: {  // number of the map: 7 for MAP07 and E1M7
      int32_t number = 0;
      for (const char c : world.level().name) {
        if (c < '0' || c > '9') {
          number = 0;
        } else if (number < 100000) {
          number = number * 10 + (c - '0');
        }
      }
      return number;
    }
    case 3:
      return state.secret_total;
    case 4:
      return state.secret_found;
    case 5:
      return state.item_total;
    case 6:
      return state.item_taken;
    case 7:
      return state.monster_count;
    case 8:
      return state.kill_total;
    default:
      return 0;
  }
}

int32_t player_info(const World& world, int32_t player, int32_t what) {
  if (player < 0 || player >= world.player_count()) return -1;
  switch (what) {
    case 0:
      return 255;  // in no team
    case 1:
      return world.options().autoaim ? to_fixed(35) : 0;
    case 4:
      return 0;
    case 7:
      return 0;
    case 8:
    case 9:
      return to_fixed(90);
    default:
      return 0;
  }
}

uint32_t button_bits(const World& world, const Buttons& buttons, uint32_t before) {
  uint32_t bits = 0;
  const auto add = [&](bool pressed, int bit) { bits |= pressed ? 1u << bit : 0u; };
  add(buttons.attack, 0), add(buttons.use, 1), add(buttons.jump, 2), add(buttons.crouch, 3);
  add(buttons.turn_180 && (before & kTurnAroundHeld) == 0, 4), add(buttons.alt_attack, 5),
      add(buttons.reload, 6), add(buttons.zoom, 7);
  add(buttons.speed != world.options().always_run, 8),  // the key, not what it means
      add(buttons.strafe, 9), add(buttons.right, 10), add(buttons.left, 11);
  add(buttons.backward, 12), add(buttons.forward, 13), add(buttons.turn_right, 14),
      add(buttons.turn_left, 15);
  add(buttons.look_up, 16), add(buttons.look_down, 17), add(buttons.move_up, 18), add(buttons.move_down, 19);
  if (buttons.turn_180) bits |= kTurnAroundHeld;
  return bits;
}

int32_t player_input(const World& world, int32_t player, int32_t what) {
  if (player < 0 || player >= world.player_count()) return 0;
  const Player& one = world.player(player);
  const Buttons buttons = what >= kModifiedInput ? one.effective_buttons() : one.buttons;
  const std::vector<uint32_t>& all_before = world.state().scripts.old_buttons;
  const auto index = static_cast<std::size_t>(player);
  const uint32_t before = index < all_before.size() ? all_before[index] : 0;
  // MODINPUT_ shows what the game made of the buttons: of jump and crouch together, only the jump.
  const auto shown = [&](uint32_t bits) {
    const bool only_jumps = what >= kModifiedInput && (bits & kJumpAndCrouch) == kJumpAndCrouch;
    return static_cast<int32_t>(bits & ~kTurnAroundHeld & (only_jumps ? ~kCrouchBit : ~0u));
  };
  const bool held = what >= kModifiedInput && one.frozen;
  switch (what % kModifiedInput) {
    case 0:
      return shown(before);
    case 1:
      return shown(button_bits(world, buttons, before));
    case 2:
      return world.options().free_look ? static_cast<int16_t>(PlayerThinker::pitch_units(buttons)) : 0;
    case 3:
      return static_cast<int16_t>(PlayerThinker::yaw_units(one, buttons));
    case 5:
      return held ? 0 : PlayerThinker::forward_units(buttons) * kMoveUnit;
    case 6:
      return held ? 0 : PlayerThinker::side_units(buttons) * kMoveUnit;
    case 7:
      return (int32_t{buttons.move_up} - int32_t{buttons.move_down}) *
                 (buttons.speed ? kRiseRun : kRiseWalk) +
             buttons.up_delta;
    default:
      return 0;
  }
}

}  // namespace comrad::doom::acs
