// One button of ViZDoom's, held or given a number, onto what a player presses. Stage: step.
#pragma once

#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/world/player.h"

namespace comrad::sim {

/// Adds `button` to `buttons`. A binary button is held where `value` is not 0. A delta button takes `value`
/// as ViZDoom does: degrees (TURN_LEFT_RIGHT_DELTA: positive right, LOOK_UP_DOWN_DELTA: positive up) become
/// floor(value * 32768 / 180) units of 1/65536 turn, moves are floored to whole units (25 walks, 50 is the
/// most; positive is forward, right, up). Values that are no number count as 0.
void press(doom::Buttons& buttons, const scenarios::Button& button, double value = 1.0);

}  // namespace comrad::sim
