// A ViZDoom .cfg as a scenario: another way to write down what a frame, an action and a reward mean.
//
//   available_buttons           heads (action_heads.h)
//   available_game_variables    measurements, scaled to about 1
//   the script's reward         MAP_REWARD, delta
//   living_reward               MAP_TICS, delta          death_penalty, death_reward    DEATHCOUNT, event
//   map_exit_reward             MAP_EXIT, event          kill_reward ...                the variable's delta
//   health_reward, armor_reward the variable's rise
//   episode_timeout             truncates                 death of the only player, end of the map: terminate
//
// The score J is the return, whose ceiling is not known. Stage: what a frame, an action and a reward mean.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/scenario_spec.h"
#include "scenarios/spec/vizdoom_config.h"

namespace comrad::scenarios {

/// Reads a .cfg and looks at the WAD that it names: the map must be there, and its starts say how many may play.
/// Errors: those of load_vizdoom_config(); kNotFound, kBadFormat and kUnsupported as "path:line: what, and what to do".
Expected<ScenarioSpec> load_vizdoom_scenario(const std::string& path);
/// The same of a .cfg that is read already.
Expected<ScenarioSpec> vizdoom_scenario(const VizdoomConfig& config);

/// The reward terms that differ from 0, and the script's.
/// `pays_while_dead`: a death is paid for in every decision after which the player is dead, not once.
std::vector<RewardTerm> vizdoom_rewards(const VizdoomRewards& rewards, bool pays_while_dead = false);

}  // namespace comrad::scenarios
