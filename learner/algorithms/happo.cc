#include "learner/algorithms/happo.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <numeric>

#include "learner/batch/masked.h"
#include "learner/losses/ppo_loss.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {

Tensor happo_ratio(const Tensor& new_log_prob, const Tensor& old_log_prob, const Tensor& valid,
                   double clamp) {
  const Tensor ratio = (new_log_prob - old_log_prob).exp();
  const Tensor bounded = clamp > 0 ? ratio.clamp(1.0 / clamp, clamp) : ratio;
  return torch::where(valid.to(torch::kBool), bounded, torch::ones({}, bounded.options()));
}

Happo::Happo(const RunConfig& config, const EnvShape& env, torch::Device device)
    : OnPolicy(config, env, device) {
  const AdamSettings settings = AdamSettings::from(config);
  for (int64_t agent = 0; agent < env.num_agents; ++agent)
    optimizers_.emplace_back(fmt::format("agent{}.", agent),
                             AdamOptimizer(net_.actor_parameters(agent), settings));
  optimizers_.emplace_back("critic.", AdamOptimizer(net_.joint_critic_parameters(), settings));
}

std::vector<int64_t> Happo::agent_order() const {
  std::vector<int64_t> order(static_cast<std::size_t>(env_.num_agents));
  std::iota(order.begin(), order.end(), 0);
  if (config_.on_policy.happo_agent_order == AgentOrder::kFixed) return order;
  Rng rng(RngKey(static_cast<uint64_t>(config_.run.seed)).split("agent_order").split(uint64_t{version()}));
  for (std::size_t i = order.size() - 1; i > 0; --i)
    std::swap(order[i], order[rng.below(static_cast<uint32_t>(i + 1))]);
  return order;
}

OnPolicy::Phase Happo::phase_of(int64_t agent) {
  return {.optimizer = optimizers_[static_cast<std::size_t>(agent)].second,
          .forward =
              [this, agent](const policy::SequenceInput& input) {
                return policy::SequenceOutput{.logits = net_.actor_sequence(agent, input), .value = {}};
              },
          .trains_value = false,
          .shuffle_key = static_cast<uint64_t>(agent)};
}

bool Happo::ended(PhaseEnd end, UpdateStats& stats) const {
  stats.abandoned = end == PhaseEnd::kAbandoned;
  return end != PhaseEnd::kDone;
}

Expected<Tensor> Happo::train_agent(const RolloutBatch& batch, int64_t agent, const UpdateContext& context,
                                    UpdateStats& stats, TermValues& terms, bool& goes_on) {
  const RolloutBatch rows = agent_rows(batch, agent);
  Phase phase = phase_of(agent);
  // With one minibatch the first forward pass of training is that of the old policy on all rows.
  Tensor old_log_prob;
  if (config_.optimisation.num_batches_per_epoch == 1)
    phase.first_log_prob = &old_log_prob;
  else
    old_log_prob = evaluate(rows, phase).log_prob;
  COMRAD_TRY_ASSIGN(const PhaseEnd end, train_phase(rows, phase, context, stats, terms));
  goes_on = !ended(end, stats);
  return old_log_prob;
}

Expected<bool> Happo::train_critic(const RolloutBatch& batch, const UpdateContext& context,
                                   UpdateStats& stats, TermValues& terms) {
  const Phase phase{.optimizer = optimizers_.back().second,
                    .forward =
                        [this](const policy::SequenceInput& input) {
                          return policy::SequenceOutput{.logits = {},
                                                        .value = net_.joint_value_sequence(input)};
                        },
                    .trains_policy = false,
                    .shuffle_key = static_cast<uint64_t>(env_.num_agents)};
  COMRAD_TRY_ASSIGN(const PhaseEnd end, train_phase(batch, phase, context, stats, terms));
  return !ended(end, stats);
}

Expected<UpdateStats> Happo::update(RolloutBatch& batch, const UpdateContext& context) {
  UpdateStats stats;
  const std::vector<int64_t> order = agent_order();
  COMRAD_TRY_ASSIGN(const bool is_valid, begin_update(batch, context, stats));
  if (!is_valid) return stats;
  const int64_t agents = env_.num_agents, steps = batch.steps(), worlds = batch.slab_count;
  if (!has_warned_of_rewards_ && agents > 1) {
    const Tensor reward = batch.reward.view({steps, worlds, agents});
    if (!torch::equal(reward.amax(2), reward.amin(2))) {
      has_warned_of_rewards_ = true;
      spdlog::warn(
          "happo: agents of a world are paid differently, its one value learns the mean of their returns; "
          "--shared_reward_alpha 1 pays the team");
    }
  }
  prepare_targets(batch);
  // From here on `advantage` is M.
  const Tensor acting = batch.acting();
  batch.advantage = standardized(batch.advantage, acting);

  const auto put = [&stats](const std::string& name, double value) {
    stats.values.emplace_back(name, value);
  };
  RolloutBatch rows = to_device(batch, device_);
  rows.advantage = rows.advantage.clone();             // on a CPU it would be the batch's own
  std::vector<std::pair<std::string, Tensor>> ratios;  // to be read with everything else
  TermValues all;
  double grad_norm = 0;
  Tensor factor = torch::ones({steps, worlds}, rows.advantage.options());  // M / A
  // An update that ends before its last phase reports no values: they would lack agents, or the critic.
  const auto cut_short = [&stats]() -> UpdateStats {
    stats.values.clear();
    return stats;
  };
  for (const int64_t agent : order) {
    TermValues terms;
    bool goes_on = true;
    const RolloutBatch of_agent = agent_rows(rows, agent);
    const bool has_samples =
        ranks().add_up(std::vector<double>{static_cast<double>(count_of(of_agent.host_acting))}).front() > 0;
    Tensor old_log_prob;
    if (has_samples) {
      COMRAD_TRY_ASSIGN(old_log_prob, train_agent(rows, agent, context, stats, terms, goes_on));
    }
    if (!goes_on) return cut_short();
    const std::string prefix = fmt::format("happo/agent_{}", agent);
    all.add(terms, 1.0 / static_cast<double>(agents));
    grad_norm += last_grad_norm_ / static_cast<double>(agents);
    put(prefix + "_policy_loss", terms["policy_loss"]);
    put(prefix + "_grad_norm", last_grad_norm_);
    if (agent == order.back() || !has_samples) continue;  // no agent is left that needs the factor
    const Tensor new_log_prob = evaluate(of_agent, phase_of(agent)).log_prob;
    const Tensor ratio =
        happo_ratio(new_log_prob, old_log_prob, of_agent.acting(), config_.on_policy.happo_factor_clamp);
    factor.mul_(ratio);
    rows.advantage.view({steps, worlds, agents}).mul_(ratio.unsqueeze(2));
    ratios.emplace_back(prefix + "_post_ratio_mean", ranks().gather(ratio, 1).mean());
  }
  TermValues critic;
  COMRAD_TRY_ASSIGN(const bool critic_done, train_critic(rows, context, stats, critic));
  if (!context.reports || !critic_done || stats.optimizer_steps == 0) return cut_short();
  all.add(critic, 1);
  const double critic_norm = last_grad_norm_;
  last_grad_norm_ = grad_norm;  // train/grad_norm is the mean over the actors
  const Tensor factors = ranks().gather(factor, 1);
  ratios.emplace_back("happo/factor_m_mean", factors.mean());
  ratios.emplace_back("happo/factor_m_max", factors.max());
  report(batch, all, stats, ratios);
  put("happo/critic_grad_norm", critic_norm);
  put("happo/agent_order_first", static_cast<double>(order.front()));
  return stats;
}

}  // namespace comrad::learn
