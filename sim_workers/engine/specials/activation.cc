// Who may activate which line, and how; switches that flip.
#include <algorithm>
#include <string>

#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/specials/special_families.h"

namespace comrad::doom {
namespace {

constexpr int32_t kButtonTics = 35;     // until a switch that works again flips back
constexpr int32_t kSlowDoorBelow = 64;  // speed: monsters open doors that are slower than this

/// What the activator is to a line.
enum class Kind : uint8_t { kPlayer, kMonster, kMissile };

Kind kind_of(const Actor& activator) {
  if (activator.player_index >= 0) return Kind::kPlayer;
  return activator.has(ActorFlag::kMissile) ? Kind::kMissile : Kind::kMonster;
}

/// Whatever called: the flag of the line that must be set for this activator.
uint32_t wanted_flag(Activation how, Kind kind, bool back_side) {
  switch (how) {
    case Activation::kCross:
    case Activation::kMonsterCross:
    case Activation::kMissileCross:
    case Activation::kAnyCross:
      if (kind == Kind::kMissile) return kLineMissileCross;  // also not "any"
      return kLineAnyCross | (kind == Kind::kPlayer ? kLinePlayerCross : kLineMonsterCross);
    case Activation::kUse:
    case Activation::kUseBack:
    case Activation::kMonsterUse:
      if (kind == Kind::kPlayer)
        return back_side || how == Activation::kUseBack ? kLinePlayerUseBack : kLinePlayerUse;
      return kLineMonsterUse;
    case Activation::kPush:
      return kind == Kind::kPlayer ? kLinePlayerPush : kLineMonsterPush;
    case Activation::kImpact:
      return kLineImpact;
  }
  return 0;
}

/// Monsters at lines that are made for players.
bool monster_may(const LineState& line, Activation how) {
  const bool crosses =
      how == Activation::kCross || how == Activation::kMonsterCross || how == Activation::kAnyCross;
  const bool uses = how == Activation::kUse || how == Activation::kMonsterUse;
  const uint32_t players = crosses                      ? kLinePlayerCross
                           : uses                       ? kLinePlayerUse
                           : how == Activation::kPush   ? kLinePlayerPush
                           : how == Activation::kImpact ? kLineImpact
                                                        : 0u;
  if ((line.flags & players) == 0) return false;
  if ((line.flags & kLineMonsterActivate) != 0) return true;
  // Plain doors and teleporters are theirs as well.
  if (uses) return line.special == Special::kDoor_Raise && line.args[0] == 0 && line.args[1] < kSlowDoorBelow;
  return crosses && (line.special == Special::kTeleport || line.special == Special::kTeleport_NoFog);
}

bool may_activate(const LineState& line, Kind kind, bool back_side, Activation how) {
  if (back_side && (line.flags & kLineFirstSideOnly) != 0) return false;
  if (kind == Kind::kMonster) {
    // A secret is for players to find.
    if ((line.flags & kLineSecret) != 0) return false;
    if (how == Activation::kImpact) return monster_may(line, how);
    return (line.flags & wanted_flag(how, kind, back_side)) != 0 || monster_may(line, how);
  }
  return (line.flags & wanted_flag(how, kind, back_side)) != 0;
}

// ---------------------------------------------------------------- switches

std::string* part_of(SideState& side, int32_t part) {
  return part == kSideTop ? &side.top : part == kSideMiddle ? &side.middle : &side.bottom;
}

/// The other picture of a switch; empty where `texture` is none.
std::string other_picture(const std::string& texture) {
  std::string other;
  if (texture.size() > 3 && texture.compare(0, 2, "SW") == 0 && (texture[2] == '1' || texture[2] == '2')) {
    other = texture;
    other[2] = texture[2] == '1' ? '2' : '1';
  }
  return other;
}

/// Turns the switch on a line's front, if it shows one.
void flip_switch(World& world, uint32_t line, bool returns) {
  const uint32_t index = world.level().linedefs[line].front;
  SideState& side = world.state().sides[index];
  auto& timers = world.state().movers.switches;
  for (const int32_t part : {kSideTop, kSideMiddle, kSideBottom}) {
    std::string* const texture = part_of(side, part);
    std::string other = other_picture(*texture);
    if (other.empty()) continue;
    const bool is_turning = std::any_of(timers.begin(), timers.end(), [&](const SwitchTimer& timer) {
      return timer.side == index && timer.part == part;
    });
    if (is_turning) return;
    std::string before = std::move(*texture);
    *texture = std::move(other);
    side.retextured = true;
    if (returns)
      timers.push_back(
          {.side = index, .part = part, .left_tics = kButtonTics, .back_texture = std::move(before)});
    return;
  }
}

/// True where the switch of a line that cares is within reach of `activator`: it does not hang above its head
/// or below its feet.
bool switch_in_reach(const World& world, uint32_t line, const Actor& activator) {
  const Linedef& linedef = world.level().linedefs[line];
  const SideState& side = world.sides()[linedef.front];
  const Sector& front = world.sectors()[world.level().sidedefs[linedef.front].sector_index];
  int64_t bottom = front.floor_height, top = front.ceiling_height;
  if (linedef.back) {
    const Sector& back = world.sectors()[world.level().sidedefs[*linedef.back].sector_index];
    if (!other_picture(side.top).empty()) {
      bottom = back.ceiling_height;
    } else if (!other_picture(side.bottom).empty()) {
      top = back.floor_height;
    }
  }
  return activator.z <= top && int64_t{activator.z} + activator.height >= bottom;
}

}  // namespace

bool activate_line(World& world, uint32_t line, Actor& activator, bool back_side, Activation how) {
  if (line >= world.lines().size()) return false;
  const LineState before = world.lines()[line];
  if (before.special == 0) return false;
  const Kind kind = kind_of(activator);
  if (!may_activate(before, kind, back_side, how)) return false;
  const Linedef& linedef = world.level().linedefs[line];
  // To what a missile does, its shooter is the one.
  Actor* who = &activator;
  if (kind == Kind::kMissile && how == Activation::kImpact)
    if (Actor* const shooter = world.actor(activator.target_id)) who = shooter;
  if (linedef.lock_number != 0 && !has_key(world, *who, linedef.lock_number)) return false;
  const bool by_hand = how == Activation::kUse || how == Activation::kUseBack ||
                       how == Activation::kMonsterUse || how == Activation::kPush ||
                       how == Activation::kImpact;
  if ((before.flags & kLineCheckSwitchRange) != 0 && how != Activation::kImpact && by_hand &&
      !switch_in_reach(world, line, activator))
    return false;
  const int32_t done = world.events().run_special(world, {.number = before.special,
                                                          .args = before.args,
                                                          .activator = who,
                                                          .line = static_cast<int32_t>(line),
                                                          .back_side = back_side});
  if (done == 0) return false;
  const bool repeats = (before.flags & kLineRepeatable) != 0;
  LineState& after = world.state().lines[line];
  // A script may have given it another special meanwhile, which stays.
  if (!repeats && after.special == before.special && after.args == before.args) after.special = 0;
  if (by_hand) flip_switch(world, line, repeats);
  return true;
}

void tic_switches(World& world) {
  auto& timers = world.state().movers.switches;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < timers.size(); ++i) {
    SwitchTimer& timer = timers[i];
    if (--timer.left_tics <= 0) {
      SideState& side = world.state().sides[timer.side];
      *part_of(side, timer.part) = std::move(timer.back_texture);
      side.retextured = true;
      continue;
    }
    if (kept != i) timers[kept] = std::move(timer);
    ++kept;
  }
  timers.resize(kept);
}

}  // namespace comrad::doom
