// Plays the episodes of one team of an evaluation.
#pragma once

#include "deploy/evaluation/evaluation_game.h"
#include "deploy/launch/launch_plan.h"
#include "deploy/launch/supervisor.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What the workers do for `team`, whose files it puts into the game's folder. One that is all random play, all the
/// scripted team or all one network is played as such; every other one seat by seat. Errors: those of files.
Expected<LaunchPlan> plan_of(const EvaluationGame& game, const Team& team, bool greedy);

/// Plays them. Errors: those of deploy::run(); kPeerLost where some episodes are missing.
Expected<RunOutcome> play(const LaunchPlan& plan);

}  // namespace comrad::deploy
