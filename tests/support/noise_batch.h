// Small batches of noise, and what a learning algorithm made of them: for tests of the algorithms.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/batch/collate.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/settings/run_config.h"
#include "tests/support/slab_pool.h"

namespace comrad::test {

/// Four steps and batches of four worlds of `agents`, for a network of 16 units; no input statistics.
inline RunConfig small_config(const std::string& algo, int agents) {
  RunConfig config;
  config.run.algo = algo;
  config.collection.rollout = 4;
  config.optimisation.batch_size = 4 * agents * 4;
  config.network.rnn_size = 16;
  config.network.normalize_input = false;
  return config;
}

/// The smallest pictures that the encoder takes, and actions of two heads.
inline TrajectoryShape small_shape(const RunConfig& config, int agents) {
  TrajectoryShape shape;
  shape.env.num_agents = agents;
  shape.env.height = shape.env.width = 36;
  shape.env.head_count = 2;
  shape.env.head_sizes = {3, 2};
  shape.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.recurrent_state_count =
      static_cast<int32_t>(policy::NetworkOptions::from(config, shape.env).recurrent_state_count());
  return shape;
}

/// `slab_count` worlds of noise, in which every step is valid and nothing ends.
inline learn::RolloutBatch noise_batch(const TrajectoryShape& shape, int slab_count, uint64_t seed) {
  const SlabPool pool(shape, slab_count);
  pool.fill_with_noise(seed);
  learn::RolloutBatch batch = learn::make_rollout_batch(shape, slab_count);
  learn::clear(batch);
  for (int i = 0; i < slab_count; ++i)
    learn::collate_slab(batch, i, pool.view(i), static_cast<uint32_t>(shape.rollout_steps));
  return batch;
}

inline std::map<std::string, double> values_of(const learn::UpdateStats& stats) {
  return {stats.values.begin(), stats.values.end()};
}

inline std::vector<torch::Tensor> copies(const std::vector<torch::Tensor>& tensors) {
  std::vector<torch::Tensor> result;
  for (const torch::Tensor& tensor : tensors) result.push_back(tensor.detach().clone());
  return result;
}

inline bool all_equal(const std::vector<torch::Tensor>& a, const std::vector<torch::Tensor>& b) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!at::equal(a[i].detach(), b[i].detach())) return false;
  return a.size() == b.size();
}

/// Takes the gradients of all parameters and leaves zeros.
inline std::vector<torch::Tensor> gradients(const policy::ActorCritic& net) {
  std::vector<torch::Tensor> result;
  for (torch::Tensor& parameter : net.parameters()) {
    result.push_back(parameter.grad().defined() ? parameter.grad().clone() : at::zeros_like(parameter));
    if (parameter.grad().defined()) parameter.mutable_grad().zero_();
  }
  return result;
}

}  // namespace comrad::test
