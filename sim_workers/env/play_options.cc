#include "sim_workers/env/play_options.h"

#include <array>
#include <span>

#include "rollout_buffer/schema/spec.h"
#include "sim_workers/engine/tic/tic.h"

namespace comrad::sim {

doom::WorldOptions world_options(const scenarios::GameRules& rules) {
  doom::WorldOptions options;
  options.skill = rules.skill;
  options.no_monsters = rules.no_monsters;
  options.autoaim = rules.autoaim;
  options.free_look = rules.free_look;
  options.allow_crouch = rules.allow_crouch;
  options.allow_jump = rules.allow_jump;
  options.deathmatch = rules.deathmatch;
  options.infinite_ammo = rules.infinite_ammo;
  options.network_game = rules.network_game;
  options.always_run = rules.always_run;
  options.start_at_deathmatch_starts = true;
  options.flags = rules.flags;
  options.frag_limit = rules.frag_limit;
  options.gravity = static_cast<doom::Fixed>(rules.gravity * doom::kFracUnit);
  if (rules.air_control) options.air_control = static_cast<doom::Fixed>(*rules.air_control * doom::kFracUnit);
  return options;
}

void run_start_tics(doom::World& world, const scenarios::GameRules& rules) {
  const std::array<doom::Buttons, kMaxAgents> nothing{};
  const std::span pressed(nothing.data(), static_cast<std::size_t>(world.player_count()));
  while (world.tic_count() < static_cast<uint64_t>(rules.start_tics) && !world.level_exited())
    run_tic(world, pressed);
}

}  // namespace comrad::sim
