#include "sim_workers/engine/tic/tic.h"

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/acs/script_specials.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/player_thinker.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/specials/movers.h"

namespace comrad::doom {
namespace {

/// Specials and scripts, for the systems below them.
class Systems final : public WorldEvents {
 public:
  int32_t run_special(World& world, const SpecialCall& call) const override {
    if (const std::optional<int32_t> result = acs::execute_script_special(world, call)) return *result;
    return execute_special(world, call);
  }
  bool activate_line(World& world, uint32_t line, Actor& activator, bool back_side,
                     Activation how) const override {
    return doom::activate_line(world, line, activator, back_side, how);
  }
  void start_named_script(World& world, std::string_view name, uint32_t activator_id,
                          const std::array<int32_t, 4>& args) const override {
    acs::start_script(world, name, {.args = args, .activator_id = activator_id, .always = true});
  }
  int32_t script_number(const World& world, std::string_view name) const override {
    return acs::script_number(world, name);
  }
  void player_died(World& world, int /*player*/, uint32_t body_id) const override {
    acs::start_scripts_of_type(world, acs::ScriptType::kDeath, body_id);
  }
  void player_respawned(World& world, int /*player*/, uint32_t body_id) const override {
    acs::start_scripts_of_type(world, acs::ScriptType::kRespawn, body_id);
  }
};
const Systems kSystems{};

void tic_actor(World& world, std::size_t slot) {
  Actor& actor = world.state().actors[slot];
  if (actor.removed) return;
  Movement movement(world);
  const int player = actor.player_index;
  const Player* owner = player >= 0 ? &world.state().players[static_cast<std::size_t>(player)] : nullptr;
  const bool alive_player = owner != nullptr && owner->alive;
  const bool pushing = alive_player && PlayerThinker::pushes(owner->buttons);
  const Fixed floor_before = actor.floor_z;
  // A quirk of ViZDoom's: no missile stands still, so that it strikes what comes to it.
  if (actor.has(ActorFlag::kMissile) && actor.velocity_x == 0 && actor.velocity_y == 0) actor.velocity_x = 1;
  // What leaves a body is held back once more as on it, and falls no faster at first: it is no ledge.
  const bool stood_on_body =
      actor.z == floor_before && floor_before > actor.ground_z && actor.velocity_z <= 0;
  if (actor.velocity_x != 0 || actor.velocity_y != 0 || actor.has(ActorFlag::kSkullFly))
    movement.move_horizontally(slot, pushing, stood_on_body);
  if (actor.removed) return;
  const bool left_ledge = !stood_on_body && actor.floor_z < floor_before && actor.z == floor_before;
  // Above the floor of its sector a body looks anew, each tic, whether another body holds it. Its ground does
  // not change while it stands still.
  const Fixed sector_floor = world.state().sectors[actor.sector_index].floor_height;
  if ((player >= 0 || actor.has(ActorFlag::kIsMonster)) &&
      (actor.floor_z != sector_floor || actor.z > sector_floor))
    movement.look_for_bodies(slot);
  if (actor.velocity_z != 0 || actor.z != actor.floor_z) {
    if (actor.velocity_z != 0 || actor.z < actor.floor_z || !actor.has(ActorFlag::kNoGravity) ||
        actor.has(ActorFlag::kFloat))
      movement.move_vertically(slot, left_ledge);
  }
  if (actor.removed) return;
  if (alive_player && actor.velocity_x == 0 && actor.velocity_y == 0 && !pushing &&
      PlayerThinker::is_walking(world, actor))
    set_label(world, actor, StateLabel::kSpawn);
  if (actor.has(ActorFlag::kDormant) && actor.health > 0) return;  // it moves, and does nothing
  if (actor.tics < 0) return respawn_monster(world, actor);
  if (--actor.tics > 0) return;
  if (actor.state == kNoState) return return_item(world, actor);
  set_state(world, actor, world.catalog().state(actor.state).next);
}

/// The last actor that is neither a player nor an item; the count of actors where there is none.
std::size_t last_plain_actor(const World& world) {
  const StableList<Actor>& actors = world.actors();
  for (std::size_t slot = actors.size(); slot-- > 0;)
    if (actors[slot].player_index < 0 && world.type_of(actors[slot]).item_class == ItemClass::kNone)
      return slot;
  return actors.size();
}

/// Powers act as the actors that they are in ViZDoom: after the players, and already in the tic that gives them.
void tic_all_powers(World& world, bool fresh) {
  for (int player = 0; player < world.player_count(); ++player)
    if (world.player(player).alive) tic_powers(world, player, fresh);
}

bool reaches_frag_limit(const World& world) {
  const WorldOptions& options = world.options();
  if (!options.deathmatch || options.frag_limit <= 0) return false;
  for (const Player& player : world.state().players)
    if (player.frag_count >= options.frag_limit) return true;
  return false;
}

}  // namespace

void reset_world(World& world, const WorldOptions& options) {
  world.start(options, &kSystems);
  acs::reset_machine(world);
  start_sector_specials(world);
  start_movers(world);
  spawn_players(world);
  spawn_map_things(world);
  // The newest script runs first, so that OPEN comes before ENTER in the first tic; in a deathmatch, whose players come last, after.
  const bool is_deathmatch = world.options().deathmatch;
  if (is_deathmatch) acs::start_scripts_of_type(world, acs::ScriptType::kOpen, 0);
  for (const Player& player : world.state().players)
    acs::start_scripts_of_type(world, acs::ScriptType::kEnter, player.actor_id);
  if (!is_deathmatch) acs::start_scripts_of_type(world, acs::ScriptType::kOpen, 0);
  world.compact();
}

void run_tic(World& world, std::span<const Buttons> buttons) {
  if (world.level_exited()) return;
  if (world.state().leaves_level) {
    world.state().level_exited = true;
    ++world.state().tic_count;
    return;
  }
  static constexpr Buttons kNothing{};
  std::size_t old_movers = world.state().movers.sectors.size();
  const std::size_t old_actors = world.actors().size();
  PlayerThinker thinker(world);
  for (int player = 0; player < world.player_count(); ++player) {
    const auto index = static_cast<std::size_t>(player);
    if (!thinker.think(player, index < buttons.size() ? buttons[index] : kNothing)) continue;
    if (world.player(player).alive && world.body_of(player) != nullptr) tic_player_in_sector(world, player);
    thinker.tic_hand(player);
  }
  carry_bodies(world);
  // A quirk of ViZDoom's: what actors start in the first tic acts before the scripts, but for what the last of them starts.
  const std::size_t last = world.tic_count() == 0 ? last_plain_actor(world) : old_actors;
  std::size_t before_scripts = old_actors;
  for (std::size_t slot = 0; slot < old_actors; ++slot) {
    if (slot == last)
      old_movers = world.state().movers.sectors.size(), before_scripts = world.actors().size();
    tic_actor(world, slot);
  }
  for (std::size_t slot = old_actors; slot < before_scripts; ++slot) tic_actor(world, slot);
  tic_all_powers(world, false);
  const std::size_t first_new_mover = tic_movers(world, old_movers);
  const std::size_t old_scrollers = world.state().movers.scrollers.size();
  acs::tic_machine(world);
  // What spawned in this tic acts in it too, after the scripts, as in ViZDoom; the list grows meanwhile.
  for (std::size_t slot = before_scripts; slot < world.actors().size(); ++slot) tic_actor(world, slot);
  tic_all_powers(world, true);
  tic_new_movers(world, first_new_mover, old_scrollers);
  if (reaches_frag_limit(world)) world.exit_level();
  world.compact();
  ++world.state().tic_count;
}

}  // namespace comrad::doom
