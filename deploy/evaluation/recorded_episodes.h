// The files of `comrad eval --episodes_dir`: what simulators recorded, with all that is needed to play it again.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "deploy/evaluation/evaluation_game.h"
#include "deploy/evaluation/summary.h"
#include "deploy/launch/launch_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Makes the folder that simulators record into. Errors: kSystem, kNoSpace.
Status make_episodes_folder(const LaunchPlan& plan);

/// Puts every episode of `played` into `folder` as episode_<number>.comrad, its map beside it as maps/<hash>.wad. A file is a line of
/// JSON, that of sim_workers/worker/episode_recorder.h behind format, version, scenario, heads, map, map_hash, policy and episode,
/// and the choices u8 [decisions, N, heads]. Errors: kPeerLost where a simulator that was started again kept one to
/// itself; kNoSpace, kSystem.
Status keep_episodes(const std::string& folder, const EvaluationGame& game, const LaunchPlan& plan,
                     const PlayedTeam& played);

/// What the episodes of a folder say of themselves (comrad eval --episodes_dir, comrad play --save), with the keys of `comrad eval
/// --json`: scenario, policy, episodes, num_agents, J_mean, J_ci95, return_mean, length_tics_mean and, with
/// `each`, every episode. They are not played again. Errors: kNotFound, kBadFormat naming the file, kBadInput where they are of
/// several scenarios.
Expected<nlohmann::ordered_json> summarise_recorded(const std::string& folder, bool each);

}  // namespace comrad::deploy
