#include "learner/algorithms/ippo.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "learner/algorithms/ppo_loss.h"
#include "learner/estimators/gae.h"
#include "policy_workers/policy/action_heads.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace {

constexpr double kEarlyStopLossChange = 1e-6;
constexpr int64_t kSkippedInARowMax = 20;

/// Sum over the samples of `values` weighted by `weight`, as a number.
double weighted(const Tensor& values, const Tensor& weight) { return (values * weight).sum().item<double>(); }

}  // namespace

Ippo::Ippo(const RunConfig& config, const EnvShape& env, torch::Device device)
    : config_(config),
      env_(env),
      device_(device),
      net_(policy::PolicyNet::create(policy::PolicyNetOptions::from(config, env),
                                     RngKey(static_cast<uint64_t>(config.seed)).split("network").bits(),
                                     device)),
      optimizer_(net_.parameters(), AdamSettings::from(config)),
      schedule_(config) {}

Expected<UpdateStats> Ippo::update(Minibatch& batch, const UpdateContext& context) {
  UpdateStats stats;
  schedule_.before_batch(context.env_frames);
  stats.lag = apply_lag_filter(batch, version_, config_.max_policy_lag);
  const int64_t update_index = updates_++;
  if (stats.lag.valid_fraction == 0) {
    spdlog::warn("update: no valid sample in the batch ({} too old); skipped", stats.lag.dropped);
    ++stats.skipped_steps;
    return stats;
  }
  if (stats.lag.valid_fraction < 0.5)
    spdlog::warn("update: only {:.0f}% of the batch is valid", 100 * stats.lag.valid_fraction);

  if (config_.normalize_input) {
    torch::NoGradGuard no_grad;
    Tensor frame = batch.frame.flatten(0, 1);
    Tensor measurement = batch.measurement.defined() ? batch.measurement.flatten(0, 1) : Tensor();
    if (stats.lag.valid_fraction < 1) {
      const Tensor index = batch.valid.flatten().nonzero().squeeze(1);
      frame = frame.index_select(0, index);
      if (measurement.defined()) measurement = measurement.index_select(0, index);
    }
    net_.update_input_statistics(frame.to(device_),
                                 measurement.defined() ? measurement.to(device_) : measurement);
  }
  prepare_targets(batch);

  std::vector<int64_t> order(static_cast<std::size_t>(batch.slab_count));
  std::iota(order.begin(), order.end(), 0);
  Rng rng(RngKey(static_cast<uint64_t>(config_.seed))
              .split("shuffle")
              .split(static_cast<uint64_t>(update_index)));
  const int64_t parts = std::clamp<int64_t>(config_.num_batches_per_epoch, 1, batch.slab_count);
  LossSums sums;
  double previous_actor_loss = 1e9;
  for (int64_t epoch = 0; epoch < config_.num_epochs; ++epoch) {
    if (config_.shuffle_minibatches)
      for (std::size_t i = order.size() - 1; i > 0; --i)
        std::swap(order[i], order[rng.below(static_cast<uint32_t>(i + 1))]);
    double actor_loss = 0, kl = 0;
    int64_t trained = 0;
    for (int64_t part = 0; part < parts; ++part) {
      const int64_t begin = batch.slab_count * part / parts, end = batch.slab_count * (part + 1) / parts;
      Minibatch minibatch =
          config_.shuffle_minibatches
              ? select_slabs(batch, std::vector<int64_t>(order.begin() + begin, order.begin() + end))
              : narrow_rows(batch, begin * env_.num_agents, (end - begin) * env_.num_agents);
      if (stats.optimizer_steps > 0 && context.begin_step && !context.begin_step()) {
        report(batch, sums, stats);
        return stats;
      }
      LossSums part_sums;
      const StepResult result = train_minibatch(minibatch, context, stats, part_sums);
      if (result == StepResult::kAbandoned) {
        stats.abandoned = true;
        return stats;
      }
      if (skipped_in_a_row_ >= kSkippedInARowMax)
        return Error{
            ErrorCode::kBadInput,
            "loss or gradient was not finite in " + std::to_string(skipped_in_a_row_) +
                " optimizer steps in a row; lower --learning_rate or --max_grad_norm and resume from the "
                "last checkpoint"};
      if (result == StepResult::kSkipped) continue;
      sums = part_sums;
      actor_loss += part_sums.actor();
      kl += part_sums.kl;
      ++trained;
      schedule_.after_minibatch(part_sums.kl);
    }
    if (trained == 0) continue;
    schedule_.after_epoch(kl / static_cast<double>(trained));
    actor_loss /= static_cast<double>(trained);
    if (std::abs(previous_actor_loss - actor_loss) < kEarlyStopLossChange) break;
    previous_actor_loss = actor_loss;
  }
  if (stats.optimizer_steps > 0) report(batch, sums, stats);
  return stats;
}

void Ippo::prepare_targets(Minibatch& batch) {
  torch::NoGradGuard no_grad;
  const auto natural = [this](const Tensor& value) {
    return config_.normalize_returns ? returns_.denormalize(value) : value;
  };
  const Advantages result =
      gae({.reward = batch.reward,
           .terminated = batch.terminated,
           .truncated = batch.truncated,
           .value = natural(batch.value),
           .final_value = natural(batch.final_value),
           .valid = batch.valid,
           .value_valid = batch.value_valid},
          {.gamma = config_.gamma, .lambda = config_.gae_lambda, .legacy_timeouts = config_.legacy_timeouts});
  batch.advantage = result.advantage;
  batch.target = result.target;
  if (!config_.normalize_returns) return;
  if (!returns_.update(result.target, batch.valid))
    spdlog::warn("update: returns are not finite; statistics kept");
  batch.target = returns_.normalize(result.target);
}

Ippo::StepResult Ippo::train_minibatch(Minibatch& minibatch, const UpdateContext& context, UpdateStats& stats,
                                       LossSums& sums) {
  const double valid_count = minibatch.valid.sum(torch::kFloat64).item<double>();
  if (valid_count == 0) {
    ++stats.skipped_steps;
    return StepResult::kSkipped;
  }
  optimizer_.zero_grad();
  if (!accumulate_gradient(minibatch, context, sums)) return StepResult::kAbandoned;
  stats.rows_trained += minibatch.steps() * minibatch.rows();

  last_grad_norm_ = optimizer_.clip_gradients();
  if (!std::isfinite(sums.total()) || !std::isfinite(last_grad_norm_)) {
    ++skipped_in_a_row_;
    ++stats.skipped_steps;
    spdlog::error("update: loss {} with gradient norm {} at version {}; optimizer step skipped ({} in a row)",
                  sums.total(), last_grad_norm_, version_, skipped_in_a_row_);
    return StepResult::kSkipped;
  }
  skipped_in_a_row_ = 0;
  const double valid_fraction = valid_count / static_cast<double>(minibatch.valid.numel());
  last_learning_rate_ = schedule_.learning_rate() * valid_fraction;
  optimizer_.step(last_learning_rate_);
  ++version_;
  ++stats.optimizer_steps;
  if (context.after_step) context.after_step();
  return StepResult::kTrained;
}

bool Ippo::accumulate_gradient(Minibatch& minibatch, const UpdateContext& context, LossSums& sums) {
  // What depends on the whole minibatch comes first; then each micro-batch adds its share of the same sums,
  // so the gradient does not depend on micro_batch_size.
  minibatch.advantage = standardize(minibatch.advantage, minibatch.valid);
  const double valid_count = std::max(1.0, minibatch.valid.sum(torch::kFloat64).item<double>());
  const int64_t steps = minibatch.steps(), agents = env_.num_agents;
  const int64_t rows_max = std::max(agents, config_.micro_batch_size / steps / agents * agents);
  const ExplorationLoss exploration_kind = parse_exploration_loss(config_.exploration_loss);
  const double clip_high = 1.0 + config_.ppo_clip_ratio, clip_low = 1.0 / clip_high;

  for (int64_t begin = 0; begin < minibatch.rows(); begin += rows_max) {
    if (context.keep_going && !context.keep_going()) return false;
    const Minibatch micro = narrow_rows(minibatch, begin, std::min(rows_max, minibatch.rows() - begin));
    const auto on_device = [this](const Tensor& tensor) {
      return tensor.defined() ? tensor.to(device_) : tensor;
    };
    const Tensor valid = on_device(micro.valid).to(torch::kBool);
    const Tensor weight = valid.to(torch::kFloat32) / valid_count;
    const Tensor mask = on_device(micro.mask_or_undefined());

    const policy::SequenceOutput output =
        net_.sequence(on_device(micro.frame), on_device(micro.measurement), on_device(micro.recurrent_state),
                      on_device(micro.reset));
    const Tensor log_probs = policy::head_log_probs(output.logits, mask, env_);
    const Tensor log_prob = policy::action_log_prob(log_probs, on_device(micro.action), env_);
    const Tensor behaviour_log_prob = on_device(micro.log_prob);
    const Tensor old_value = on_device(micro.value).narrow(0, 0, steps);
    const Tensor ratio = importance_ratio(log_prob, behaviour_log_prob);

    const Tensor policy_loss =
        -(clipped_objective(ratio, on_device(micro.advantage), config_.ppo_clip_ratio) * weight).sum();
    const Tensor value_loss =
        config_.value_loss_coeff *
        (clipped_value_loss(output.value, old_value, on_device(micro.target), config_.ppo_clip_value) *
         weight)
            .sum();
    Tensor loss = policy_loss + value_loss;
    if (exploration_kind != ExplorationLoss::kNone) {
      const Tensor exploration = config_.exploration_loss_coeff *
                                 (exploration_loss(log_probs, mask, env_, exploration_kind) * weight).sum();
      loss = loss + exploration;
      sums.exploration += exploration.item<double>();
    }
    const auto divergence = [&] {
      return policy::kl_divergence(log_probs, policy::head_log_probs(on_device(micro.logits), mask, env_),
                                   env_);
    };
    Tensor kl;
    if (config_.kl_loss_coeff != 0) {
      kl = divergence();
      const Tensor penalty = config_.kl_loss_coeff * (kl * weight).sum();
      loss = loss + penalty;
      sums.kl_penalty += penalty.item<double>();
    }
    loss.backward();

    torch::NoGradGuard no_grad;
    if (!kl.defined()) kl = divergence();
    const Tensor zero = torch::zeros({}, kl.options());
    const Tensor value_delta = torch::where(valid, (output.value - old_value).abs(), zero);
    const Tensor valid_ratio = torch::where(valid, ratio, torch::ones({}, ratio.options()));
    sums.policy += policy_loss.item<double>();
    sums.value += value_loss.item<double>();
    sums.kl += weighted(kl, weight);
    sums.kl_max = std::max(sums.kl_max, torch::where(valid, kl, zero).max().item<double>());
    sums.entropy += weighted(policy::entropy(log_probs, env_), weight);
    sums.predicted_value += weighted(output.value, weight);
    sums.value_delta += weighted(value_delta, weight);
    sums.value_delta_max = std::max(sums.value_delta_max, value_delta.max().item<double>());
    sums.ratio += weighted(ratio, weight);
    sums.ratio_min = std::min(sums.ratio_min, valid_ratio.min().item<double>());
    sums.ratio_max = std::max(sums.ratio_max, valid_ratio.max().item<double>());
    sums.clipped += weighted(((ratio < clip_low) | (ratio > clip_high)).to(torch::kFloat32), weight);
    sums.log_prob_max =
        std::max(sums.log_prob_max, torch::where(valid, log_prob.abs(), zero).max().item<double>());
  }
  return true;
}

void Ippo::report(const Minibatch& batch, const LossSums& sums, UpdateStats& stats) const {
  const auto put = [&stats](const char* name, double value) { stats.values.emplace_back(name, value); };
  put("train/lr", schedule_.learning_rate());
  put("train/actual_lr", last_learning_rate_);
  put("train/loss", sums.total());
  put("train/policy_loss", sums.policy);
  put("train/value_loss", sums.value);
  put("train/exploration_loss", sums.exploration);
  put("train/kl_loss", sums.kl_penalty);
  put("train/kl_divergence", sums.kl);
  put("train/kl_divergence_max", sums.kl_max);
  put("train/entropy", sums.entropy);
  put("train/value", sums.predicted_value);
  put("train/value_delta", sums.value_delta);
  put("train/value_delta_max", sums.value_delta_max);
  put("train/ratio_mean", sums.ratio);
  put("train/ratio_min", sums.ratio_min);
  put("train/ratio_max", sums.ratio_max);
  put("train/fraction_clipped", sums.clipped);
  put("train/max_abs_logprob", sums.log_prob_max);
  put("train/grad_norm", last_grad_norm_);
  put("train/adam_max_second_moment", optimizer_.max_second_moment());

  const Tensor valid_index = batch.valid.flatten().nonzero().squeeze(1);
  const Tensor advantage = batch.advantage.flatten().index_select(0, valid_index);
  put("train/adv_mean", advantage.mean().item<double>());
  put("train/adv_min", advantage.min().item<double>());
  put("train/adv_max", advantage.max().item<double>());
  put("train/adv_std", advantage.numel() > 1 ? advantage.std().item<double>() : 0.0);
  const Tensor action = batch.action.flatten(0, 1).index_select(0, valid_index);
  put("train/act_min", action.min().item<double>());
  put("train/act_max", action.max().item<double>());
  put("train/valids_fraction", stats.lag.valid_fraction);
  put("train/num_sgd_steps", static_cast<double>(version_));
  put("train/version_diff_avg", stats.lag.mean);
  put("train/version_diff_min", static_cast<double>(stats.lag.min));
  put("train/version_diff_max", static_cast<double>(stats.lag.max));
  for (const auto& [name, tensor] : net_.named_state()) {  // means over all elements of a frame
    if (name == "normalizer.frame.mean") put("train/obs_running_mean", tensor.mean().item<double>());
    if (name == "normalizer.frame.var") put("train/obs_running_std", tensor.sqrt().mean().item<double>());
  }
  if (config_.normalize_returns) {
    put("train/returns_running_mean", returns_.statistics().mean);
    put("train/returns_running_std", returns_.sigma());
  }
}

void Ippo::save(StateDict& state) const {
  state.put("algorithm/name", std::string(name()));
  state.put("algorithm/version", static_cast<int64_t>(version_));
  state.put("algorithm/updates", updates_);
  for (const auto& [name, tensor] : net_.named_state()) state.put("network/" + name, tensor);
  optimizer_.save(state, "optimizer");
  state.put("normalizer/returns_mean", returns_.statistics().mean);
  state.put("normalizer/returns_variance", returns_.statistics().variance);
  state.put("normalizer/returns_count", returns_.statistics().count);
  state.put("schedule/learning_rate", schedule_.learning_rate());
}

Status Ippo::load(const StateDict& state) {
  COMRAD_TRY_ASSIGN(const std::string maker, state.text("algorithm/name"));
  if (maker != name())
    return Error{ErrorCode::kBadFormat, "checkpoint was made by \"" + maker + "\", this run trains " + name()};
  COMRAD_TRY_ASSIGN(const int64_t version, state.integer("algorithm/version"));
  COMRAD_TRY_ASSIGN(const int64_t updates, state.integer("algorithm/updates"));
  ReturnNormalizer::Statistics statistics;
  COMRAD_TRY_ASSIGN(statistics.mean, state.number("normalizer/returns_mean"));
  COMRAD_TRY_ASSIGN(statistics.variance, state.number("normalizer/returns_variance"));
  COMRAD_TRY_ASSIGN(statistics.count, state.number("normalizer/returns_count"));
  COMRAD_TRY_ASSIGN(const double learning_rate, state.number("schedule/learning_rate"));
  for (const auto& [key, tensor] : net_.named_state())
    COMRAD_TRY(state.copy_tensor("network/" + key, tensor));
  net_.state_changed();
  COMRAD_TRY(optimizer_.load(state, "optimizer"));
  version_ = static_cast<PolicyVersion>(version);
  updates_ = updates;
  returns_.restore(statistics);
  // Constant and linear schedules follow this run's flags; only the adaptive ones live from their last
  // position.
  if (config_.lr_schedule.starts_with("kl_adaptive")) schedule_.restore(learning_rate);
  return {};
}

}  // namespace comrad::learn
