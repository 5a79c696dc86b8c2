#include "learner/worker/seat_server.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/q_learning.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/seat_plan.h"
#include "rollout_buffer/settings/trained_game.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::learn {
namespace {

constexpr int64_t kLookUs = 100'000;

/// One network's block of the published bytes.
Status append_network(const SeatNetwork& network, const EnvShape& env, std::vector<std::byte>& bytes) {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(network.settings));
  COMRAD_TRY_ASSIGN(const StateDict state, read_checkpoint(network.checkpoint));
  COMRAD_TRY(check_trained_for(state, network.checkpoint, config));
  COMRAD_TRY_ASSIGN(const std::unique_ptr<Algorithm> algorithm, make_algorithm(config, env, torch::kCPU));
  if (const Status loaded = algorithm->load(state); !loaded)
    return Error{loaded.error().code, network.checkpoint + ": " + loaded.error().message};
  COMRAD_TRY_ASSIGN(const int64_t env_frames, state.integer("counters/env_frames"));
  const auto epsilon = static_cast<float>(config.q_learning.epsilon.at(static_cast<double>(env_frames)));
  std::ranges::copy(std::as_bytes(std::span(&epsilon, 1)), std::back_inserter(bytes));
  std::ranges::copy(algorithm->weights(), std::back_inserter(bytes));
  spdlog::info("serving {} ({}, version {})", network.checkpoint, config.run.algo.name(),
               algorithm->version());
  return {};
}

}  // namespace

Status check_trained_for(const StateDict& checkpoint, const std::string& path, const RunConfig& played) {
  COMRAD_TRY_ASSIGN(const std::string text, checkpoint.text("config/toml"));
  COMRAD_TRY_ASSIGN(const RunConfig trained, settings_of_checkpoint(text, path + " (config/toml)"));
  if (const std::string difference = game_difference(trained, played); !difference.empty())
    return Error{ErrorCode::kBadInput, path + " was trained for another game: " + difference};
  return {};
}

Status serve_seats(const std::string& run_dir, const shm::Arena& arena, const std::atomic<bool>& stop) {
  arena.learner_counters().begin_life();
  const EnvShape& env = arena.shape().trajectory.env;
  COMRAD_TRY_ASSIGN(const SeatPlan plan, read_seat_plan(run_dir, env.num_agents));
  std::vector<std::byte> bytes;
  for (const SeatNetwork& network : plan.networks) COMRAD_TRY(append_network(network, env, bytes));
  if (static_cast<int64_t>(bytes.size()) > arena.shape().weights_bytes)
    return Error{ErrorCode::kBadInput,
                 fmt::format("the weights of all seats need {} bytes, the arena holds {}", bytes.size(),
                             arena.shape().weights_bytes)};
  arena.weights().publish(bytes, 1);
  shm::ControlBlock& control = arena.control();
  control.rollouts_allowed = std::numeric_limits<uint64_t>::max();
  shm::ring(control.slab_released);
  arena.learner_counters().state = shm::WorkerState::kRunning;
  while (!shm::is_stopping(stop, arena)) {
    const uint32_t heard = shm::listen(control.run_state_changed);
    if (!shm::is_stopping(stop, arena)) shm::wait(control.run_state_changed, heard, kLookUs);
  }
  arena.learner_counters().state = shm::WorkerState::kStopped;
  return {};
}

}  // namespace comrad::learn
