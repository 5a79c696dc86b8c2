// The files of `comrad eval --episodes_dir`: what simulators recorded, with all that is needed to play it again.
#pragma once

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

}  // namespace comrad::deploy
