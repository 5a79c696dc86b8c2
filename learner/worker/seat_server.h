// The learner's part in an evaluation: a checkpoint may only play the game that its network was trained for, and where
// the agents have different players the weights of all their networks are published together. Stage: publish.
#pragma once

#include <atomic>
#include <string>

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

/// Whether the network of a checkpoint read from `path` was trained for the game of `played`.
/// Errors: kBadInput naming the setting that differs, with both values; kBadFormat where its settings cannot be read.
Status check_trained_for(const StateDict& checkpoint, const std::string& path, const RunConfig& played);

/// Publishes the weights of the networks of `<run_dir>/seats.toml`, each behind its epsilon (f32), as version 1, and
/// waits for `stop` or the end of the run. Errors: those of read_seat_plan(), load_run_config(), read_checkpoint(),
/// check_trained_for() and Algorithm::load(), naming the file; kBadInput where the arena has no room.
Status serve_seats(const std::string& run_dir, const shm::Arena& arena, const std::atomic<bool>& stop);

}  // namespace comrad::learn
