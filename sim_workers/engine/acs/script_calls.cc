#include "sim_workers/engine/acs/script_calls.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/actor_calls.h"
#include "sim_workers/engine/acs/actor_properties.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/acs/map_calls.h"
#include "sim_workers/engine/acs/strings.h"
#include "sim_workers/engine/actors/flag_names.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/sight.h"
#include "sim_workers/engine/specials/line_specials.h"

namespace comrad::doom::acs {

using bytecode::BuiltIn;

namespace {

constexpr const char* kTooManyTexts = "more texts than the machine keeps";
constexpr int32_t kFullAirTics = 20 * 35;

CallResult text_result(const Caller& caller, std::string_view text) {
  const std::optional<int32_t> index = add_string(caller.world, text);
  return index ? CallResult{*index} : CallResult{0, kTooManyTexts};
}

/// A count below zero means all there is (measured).
CallResult sub_text(const Caller& caller, int32_t index, int64_t first, int64_t count) {
  const std::string text(caller.text(index));
  if (count < 0) count = static_cast<int64_t>(text.size());
  first = std::clamp<int64_t>(first, 0, static_cast<int64_t>(text.size()));
  count = std::clamp<int64_t>(count, 0, static_cast<int64_t>(text.size()) - first);
  return text_result(caller, std::string_view(text).substr(static_cast<std::size_t>(first),
                                                           static_cast<std::size_t>(count)));
}

int32_t check_sight(const Caller& caller, int32_t source_id, int32_t target_id) {
  bool sees = false;
  caller.each_actor(source_id, [&](Actor& source) {
    caller.each_actor(target_id,
                      [&](Actor& target) { sees = sees || can_see(caller.world, source, target); });
  });
  return sees ? 1 : 0;
}

int32_t check_proximity(const Caller& caller, std::span<const int32_t> args) {
  const Actor* center = caller.pointer_of(caller.one_actor(args[0]), args[5]);
  const std::optional<uint32_t> type = caller.type_named(args[1]);
  if (center == nullptr || !type) return 0;
  const int64_t reach = args[2] >> kFracBits;
  const int32_t wanted = args[3] != 0 ? args[3] : 1;
  int32_t count = 0;
  for (const Actor& actor : caller.world.actors()) {
    if (actor.removed || &actor == center || actor.health <= 0 || actor.type != *type) continue;
    const int64_t dx = (int64_t{actor.x} - center->x) >> kFracBits,
                  dy = (int64_t{actor.y} - center->y) >> kFracBits;
    const int64_t dz = (int64_t{actor.z} - center->z) >> kFracBits;
    if (dx * dx + dy * dy + dz * dz <= reach * reach) ++count;
  }
  return count >= wanted ? 1 : 0;
}

int32_t line_attack_from(const Caller& caller, std::span<const int32_t> args) {
  const auto pitch = static_cast<int32_t>(to_angle(args[2]));
  uint32_t puff = caller.world.catalog().known().bullet_puff;
  if (!caller.text(args[4]).empty())
    if (const std::optional<uint32_t> named = caller.type_named(args[4])) puff = *named;
  const DamageType type =
      caller.world.catalog().find_damage_type(caller.text(args[5])).value_or(DamageType::kNormal);
  const Fixed range = args[6] != 0 ? std::clamp(args[6], 0, to_fixed(8192)) : to_fixed(2048);
  caller.each_actor(args[0], [&](Actor& shooter) {
    line_attack(caller.world, shooter, to_angle(args[1]), range, pitch, args[3], type, puff);
  });
  return 0;
}

int32_t start_named(const Caller& caller, int32_t name, std::array<int32_t, 4> args, bool always,
                    bool immediate) {
  const StartOptions options{.args = args,
                             .activator_id = caller.thread.activator_id,
                             .line = caller.thread.line,
                             .back_side = caller.thread.back_side,
                             .always = always,
                             .immediate = immediate};
  return start_script(caller.world, caller.text(name), options);
}

int32_t armor_info(const Caller& caller, int32_t what) {
  const int index = caller.activator_player();
  if (index < 0) return 0;
  const Player& player = caller.world.player(index);
  switch (what) {
    case 1: {  // what it may grow to, of one that others add to
      if (player.armor_type == kNoType) return 0;
      const ActorType& type = caller.world.catalog()[player.armor_type];
      return std::max(type.save_amount, type.max_save_amount);
    }
    case 2:
      return player.armor_save;
    case 5:
      return player.armor;
    default:
      return 0;
  }
}

}  // namespace

uint32_t integer_root(uint64_t value) {
  uint64_t root = 0;
  for (uint64_t bit = uint64_t{1} << 31; bit != 0; bit >>= 1)
    if ((root | bit) * (root | bit) <= value) root |= bit;
  return static_cast<uint32_t>(root);
}

namespace {

/// The root to the nearest whole number.
uint32_t nearest_root(uint64_t value) {
  const uint64_t root = integer_root(value);
  return static_cast<uint32_t>(value - root * root > root ? root + 1 : root);
}

}  // namespace

CallResult call_function(const Caller& caller, int32_t number, std::span<const int32_t> given) {
  std::array<int32_t, 16> padded{};
  std::copy_n(given.begin(), std::min(given.size(), padded.size()), padded.begin());
  const std::span<const int32_t> args(padded);
  World& world = caller.world;
  const auto value = [](int32_t result) { return CallResult{result}; };
  const auto player_at = [&](int32_t player) { return player >= 0 && player < world.player_count(); };

  switch (static_cast<BuiltIn>(number)) {
    // ---- actors
    case BuiltIn::kGetActorVelX:
    case BuiltIn::kGetActorVelY:
    case BuiltIn::kGetActorVelZ: {
      const Actor* actor = caller.one_actor(args[0]);
      if (actor == nullptr) return {};
      return value(number == static_cast<int32_t>(BuiltIn::kGetActorVelX)   ? actor->velocity_x
                   : number == static_cast<int32_t>(BuiltIn::kGetActorVelY) ? actor->velocity_y
                                                                            : actor->velocity_z);
    }
    case BuiltIn::kSetActorVelocity:
      return value(caller.each_actor(args[0], [&](Actor& actor) {
        // What moves faster than the map is wide comes from a broken script.
        constexpr Fixed kFastest = to_fixed(4096);
        const auto clamped = [&](int64_t velocity) {
          return static_cast<Fixed>(std::clamp<int64_t>(velocity, -kFastest, kFastest));
        };
        const bool add = args[4] != 0;
        actor.velocity_x = clamped(int64_t{add ? actor.velocity_x : 0} + args[1]);
        actor.velocity_y = clamped(int64_t{add ? actor.velocity_y : 0} + args[2]);
        actor.velocity_z = clamped(int64_t{add ? actor.velocity_z : 0} + args[3]);
        if (Player* const player = world.player_of(actor)) {
          const bool bob = args[5] != 0;
          player->walk_x = clamped(int64_t{add ? player->walk_x : 0} + (bob ? args[1] : 0));
          player->walk_y = clamped(int64_t{add ? player->walk_y : 0} + (bob ? args[2] : 0));
        }
      }) != 0);
    case BuiltIn::kSetActivator: {
      const Actor* actor = args[0] == 0 ? nullptr : world.find_thing(args[0]);
      if (args[1] != 0) actor = caller.pointer_of(caller.one_actor(args[0]), args[1]);
      caller.thread.activator_id = actor != nullptr ? actor->id : 0;
      return value(actor != nullptr);
    }
    case BuiltIn::kSetActivatorToTarget: {
      Actor* actor = caller.one_actor(args[0]);
      if (actor == nullptr) return {};
      Actor* target =
          actor->player_index >= 0 ? aim_bullet(world, *actor).target : world.actor(actor->target_id);
      if (target == nullptr) return {};
      caller.thread.activator_id = target->id;
      return value(1);
    }
    case BuiltIn::kGetActorViewHeight: {
      const Actor* actor = caller.one_actor(args[0]);
      if (actor == nullptr) return {};
      if (actor->player_index >= 0 && player_at(actor->player_index))
        return value(fixed_mul(world.player(actor->player_index).eye_height,
                               world.player(actor->player_index).crouch_factor));
      return value(actor->height / 2);
    }
    case BuiltIn::kCheckActorProperty:
      return value(check_actor_property(caller, caller.one_actor(args[0]), args[1], args[2]));
    case BuiltIn::kCheckActorClass: {
      const Actor* actor = caller.one_actor(args[0]);
      return value(actor != nullptr && same_ignoring_case(world.type_of(*actor).name, caller.text(args[1])));
    }
    case BuiltIn::kGetActorClass: {
      const Actor* actor = caller.one_actor(args[0]);
      return text_result(caller, actor != nullptr ? std::string_view(world.type_of(*actor).name) : "None");
    }
    case BuiltIn::kCheckFlag: {
      const Actor* actor = caller.one_actor(args[0]);
      const std::optional<ActorFlag> flag = doom::find_flag(caller.text(args[1]));
      const bool is_set = actor != nullptr && flag &&
                          (actor->has(*flag) || (*flag == ActorFlag::kFriendly && actor->player_index >= 0));
      return value(is_set);
    }
    case BuiltIn::kSetPointer: {
      Actor* self = caller.activator();
      if (self == nullptr) return {};
      const Actor* other = caller.pointer_of(caller.one_actor(args[1]), args[2]);
      if (other == self) other = nullptr;
      const uint32_t id = other != nullptr ? other->id : 0;
      if (args[0] == 2) self->target_id = id;
      if (args[0] == 4) self->master_id = id;
      if (args[0] == 8) self->tracer_id = id;
      return value(other != nullptr);
    }
    case BuiltIn::kIsPointerEqual: {
      const Actor* first = caller.pointer_of(caller.one_actor(args[2]), args[0]);
      const Actor* second = caller.pointer_of(caller.one_actor(args[3]), args[1]);
      return value(first == second);
    }
    case BuiltIn::kCheckSight:
      return value(check_sight(caller, args[0], args[1]));
    case BuiltIn::kCheckProximity:
      return value(check_proximity(caller, args));
    case BuiltIn::kCheckActorState: {
      const Actor* actor = caller.one_actor(args[0]);
      return value(actor != nullptr &&
                   find_state(caller, *actor, caller.text(args[1]), args[2] != 0) != kNoState);
    }
    case BuiltIn::kCanRaiseActor: {
      bool all = true;
      const int32_t count = caller.each_actor(args[0], [&](Actor& actor) {
        all = all && actor.is_corpse() && actor.health <= 0 && actor.tics == -1 &&
              world.type_of(actor).state(StateLabel::kRaise) != kNoState;
      });
      return value(count != 0 && all);
    }
    case BuiltIn::kUniqueTID:
      return value(unique_thing_id(world, args[0], args[1]));
    case BuiltIn::kIsTIDUsed:
      return value(world.find_thing(args[0]) != nullptr);
    case BuiltIn::kSpawnForced:
      return value(spawn_thing(caller, args[0], args[1], args[2], args[3], args[4],
                               static_cast<uint32_t>(args[5]) << 24, true));
    case BuiltIn::kSpawnSpotForced:
      return value(spawn_at_spots(caller, args[0], args[1], args[2], static_cast<uint32_t>(args[3]) << 24,
                                  false, true));
    case BuiltIn::kSpawnSpotFacingForced:
      return value(spawn_at_spots(caller, args[0], args[1], args[2], 0, true, true));
    case BuiltIn::kChangeActorAngle:
      caller.each_actor(args[0], [&](Actor& actor) { world.set_angle(actor.id, to_angle(args[1])); });
      return {};
    case BuiltIn::kChangeActorPitch:
      caller.each_actor(args[0], [&](Actor& actor) { actor.pitch = to_angle(args[1]); });
      return {};
    case BuiltIn::kPickActor:
      return value(pick_actor(caller, args));
    case BuiltIn::kWarp:
      return value(warp(caller, given.first(std::min(given.size(), padded.size()))));
    case BuiltIn::kLineAttack:
      return value(line_attack_from(caller, args));
    case BuiltIn::kSetActorTeleFog:
    case BuiltIn::kSwapActorTeleFog:
    case BuiltIn::kSetActorRoll:
    case BuiltIn::kChangeActorRoll:
    case BuiltIn::kGetActorRoll:
      return {};

    // ---- inventory
    case BuiltIn::kGetWeapon: {
      const int player = caller.activator_player();
      const uint32_t weapon = player >= 0 ? world.player(player).ready_weapon : kNoType;
      return text_result(caller, weapon != kNoType ? std::string_view(world.catalog()[weapon].name) : "None");
    }
    case BuiltIn::kGetArmorType: {
      if (!player_at(args[1])) return {};
      const Player& player = world.player(args[1]);
      const bool same = player.armor_type != kNoType &&
                        same_ignoring_case(world.catalog()[player.armor_type].name, caller.text(args[0]));
      return value(same ? player.armor : 0);
    }
    case BuiltIn::kGetArmorInfo: {
      if (args[0] != 0) return value(armor_info(caller, args[0]));
      const int player = caller.activator_player();
      const uint32_t armor = player >= 0 ? world.player(player).armor_type : kNoType;
      return text_result(caller, armor != kNoType ? std::string_view(world.catalog()[armor].name) : "None");
    }
    case BuiltIn::kGetActorPowerupTics: {
      const Actor* actor = caller.one_actor(args[0]);
      const std::optional<uint32_t> type = caller.type_named(args[1]);
      if (actor == nullptr || actor->player_index < 0 || !player_at(actor->player_index) || !type) return {};
      for (const Power& power : world.player(actor->player_index).powers)
        if (power.type == *type) return value(power.tics);
      return {};
    }
    case BuiltIn::kGetMaxInventory: {
      const Actor* actor = caller.one_actor(args[0]);
      if (actor == nullptr) return {};
      const std::optional<uint32_t> type = caller.type_named(args[1]);
      if (!type || actor->player_index < 0 || !player_at(actor->player_index)) return {};
      return value(max_item(world, actor->player_index, *type));
    }
    case BuiltIn::kDropItem: {
      const std::optional<uint32_t> type = caller.type_named(args[1]);
      if (!type) return {};
      const int32_t amount = given.size() > 2 ? args[2] : -1, chance = given.size() > 3 ? args[3] : 256;
      return value(
          caller.each_actor(args[0], [&](Actor& actor) { drop_item(world, actor, *type, amount, chance); }));
    }
    case BuiltIn::kDropInventory: {
      const std::optional<uint32_t> type = caller.type_named(args[1]);
      if (!type) return {};
      caller.each_actor(args[0], [&](Actor& actor) {
        if (actor.player_index < 0 || !player_at(actor.player_index)) return;
        const int32_t taken = take_item(world, actor.player_index, *type, 0);
        if (taken > 0) drop_item(world, actor, *type, taken, 256);
      });
      return {};
    }

    // ---- numbers and texts
    case BuiltIn::kSqrt:
      return value(args[0] <= 0 ? 0 : static_cast<int32_t>(integer_root(static_cast<uint64_t>(args[0]))));
    case BuiltIn::kFixedSqrt:
      return value(
          args[0] <= 0 ? 0 : static_cast<int32_t>(nearest_root(static_cast<uint64_t>(args[0]) << kFracBits)));
    case BuiltIn::kVectorLength: {
      const int64_t x = args[0], y = args[1];  // too long ones wrap (measured)
      return value(
          static_cast<int32_t>(nearest_root(static_cast<uint64_t>(x * x) + static_cast<uint64_t>(y * y))));
    }
    case BuiltIn::kGetChar: {
      const std::string_view text = caller.text(args[0]);
      const bool inside = args[1] >= 0 && static_cast<std::size_t>(args[1]) < text.size();
      return value(inside ? static_cast<unsigned char>(text[static_cast<std::size_t>(args[1])]) : 0);
    }
    case BuiltIn::kStrCmp:
    case BuiltIn::kStrICmp: {
      const std::size_t count = given.size() > 2 ? static_cast<std::size_t>(std::max(args[2], 0)) : SIZE_MAX;
      return value(compare_text(caller.text(args[0]), caller.text(args[1]),
                                number == static_cast<int32_t>(BuiltIn::kStrICmp), count));
    }
    case BuiltIn::kStrLeft:
      return sub_text(caller, args[0], 0, args[1]);
    case BuiltIn::kStrRight: {
      const int64_t size = static_cast<int64_t>(caller.text(args[0]).size());
      const int64_t count = args[1] < 0 ? size : std::min<int64_t>(args[1], size);
      return sub_text(caller, args[0], size - count, count);
    }
    case BuiltIn::kStrMid:
      if (args[1] < 0) return sub_text(caller, args[0], 0, 0);
      return sub_text(caller, args[0], args[1], args[2]);

    // ---- scripts
    case BuiltIn::kACS_NamedExecute:
      return value(start_named(caller, args[0], {args[2], args[3], args[4]}, false, false));
    case BuiltIn::kACS_NamedExecuteAlways:
      return value(start_named(caller, args[0], {args[2], args[3], args[4]}, true, false));
    case BuiltIn::kACS_NamedExecuteWithResult:
      return value(start_named(caller, args[0], {args[1], args[2], args[3], args[4]}, true, true));
    case BuiltIn::kACS_NamedLockedExecute:
    case BuiltIn::kACS_NamedLockedExecuteDoor: {
      const Actor* actor = caller.activator();
      if (args[4] != 0 && (actor == nullptr || !has_key(world, *actor, args[4]))) return {};
      return value(start_named(caller, args[0], {args[2], args[3], 0}, false, false));
    }
    case BuiltIn::kACS_NamedSuspend:
    case BuiltIn::kACS_NamedTerminate: {
      const Script* script = caller.behavior.find_script(caller.text(args[0]));
      if (script == nullptr) return {};
      if (number == static_cast<int32_t>(BuiltIn::kACS_NamedSuspend)) {
        suspend_script(world, script->number);
      } else {
        terminate_script(world, script->number);
      }
      return value(1);
    }

    // ---- lines, sectors, polyobjects
    case BuiltIn::kSetLineActivation:
      set_line_activation(world, args[0], args[1]);
      return {};
    case BuiltIn::kGetLineActivation:
      return value(get_line_activation(world, args[0]));
    case BuiltIn::kSetSectorDamage:
      // Measured: an interval that is given counts even as 0, which hurts every tic; one left out is 32.
      world.set_sector_damage(args[0], args[1], given.size() > 3 ? std::max(args[3], 1) : 32);
      for (Sector& sector : world.state().sectors) {
        if (sector.tag != args[0]) continue;
        clear_special_damage(sector);
        const std::string_view type = given.size() > 2 ? caller.text(args[2]) : std::string_view();
        sector.damage_type =
            static_cast<uint8_t>(world.catalog().find_damage_type(type).value_or(DamageType::kNormal));
        sector.damage_leak = std::clamp(args[4], 0, 256);
      }
      return {};
    case BuiltIn::kGetPolyobjX:
    case BuiltIn::kGetPolyobjY:
      for (const Polyobject& polyobject : world.state().movers.polyobjects)
        if (polyobject.number == args[0])
          return value(number == static_cast<int32_t>(BuiltIn::kGetPolyobjX) ? polyobject.x : polyobject.y);
      return value(INT32_MAX);
    case BuiltIn::kRadius_Quake2:
    case BuiltIn::kQuakeEx: {
      // Quakes in all axes shake as plain ones do.
      const bool wide = number == static_cast<int32_t>(BuiltIn::kQuakeEx);
      world.events().run_special(world, {.number = Special::kRadius_Quake,
                                         .args = {args[1], wide ? args[4] : args[2], wide ? args[5] : args[3],
                                                  wide ? args[6] : args[4], args[0]},
                                         .activator = caller.activator(),
                                         .line = caller.thread.line,
                                         .back_side = caller.thread.back_side});
      return value(1);
    }

    // ---- the screen
    case BuiltIn::kSetHUDClipRect:
      for (std::size_t i = 0; i < 4; ++i) caller.thread.clip[i] = args[i];
      caller.thread.wrap_width = args[4];
      return {};
    case BuiltIn::kSetHUDWrapWidth:
      caller.thread.wrap_width = args[0];
      return {};
    case BuiltIn::kCheckFont: {
      const std::string_view font = caller.text(args[0]);
      return value(same_ignoring_case(font, "SMALLFONT") || same_ignoring_case(font, "BIGFONT") ||
                   same_ignoring_case(font, "CONFONT"));
    }

    // ---- air: nobody drowns here
    case BuiltIn::kGetAirSupply:
      return value(player_at(args[0]) ? kFullAirTics : 0);
    case BuiltIn::kSetAirSupply:
      return value(player_at(args[0]));

    // ---- heard or seen only in passing
    case BuiltIn::kSetSkyScrollSpeed:
    case BuiltIn::kSoundSequenceOnActor:
    case BuiltIn::kSoundSequenceOnSector:
    case BuiltIn::kSoundSequenceOnPolyobj:
    case BuiltIn::kAnnouncerSound:
    case BuiltIn::kPlaySound:
    case BuiltIn::kStopSound:
    case BuiltIn::kSoundVolume:
    case BuiltIn::kPlayActorSound:
    case BuiltIn::kSpawnDecal:
    case BuiltIn::kSetSectorTerrain:
    case BuiltIn::kSpawnParticle:
    case BuiltIn::kSetMusicVolume:
      return {};

    default:
      break;
  }
  const std::string_view name = bytecode::built_in_name(number);
  const std::size_t index = number >= 0 && number < 256 ? static_cast<std::size_t>(number) : 255;
  caller.unsupported(kWarnFunction + index,
                     name.empty() ? fmt::format("function {} of CallFunc", number) : std::string(name));
  return {};
}

}  // namespace comrad::doom::acs
