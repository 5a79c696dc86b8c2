#include "learner/algorithms/on_policy.h"

#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "learner/algorithms/gradient_sum.h"
#include "learner/algorithms/part_statistics.h"
#include "learner/algorithms/ppo_loss.h"
#include "learner/algorithms/progress.h"
#include "learner/estimators/gae.h"
#include "policy_workers/policy/action_heads.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace {

constexpr double kEarlyStopLossChange = 1e-6;

/// 1 - Var(R - V) / Var(R) over valid samples: 1 when values foretell the returns, 0 when they say no more than
/// their mean, below when they mislead. NaN where all returns are the same.
double explained_variance(const Tensor& target, const Tensor& value, const Tensor& valid) {
  const Tensor index = valid.flatten().nonzero().squeeze(1);
  const Tensor of_target = target.flatten().index_select(0, index).to(torch::kFloat64);
  const Tensor error = of_target - value.flatten().index_select(0, index);
  return 1 - error.var(/*unbiased=*/false).item<double>() / of_target.var(/*unbiased=*/false).item<double>();
}

}  // namespace

void OnPolicy::LossSums::add(const LossSums& part) {
  policy += part.policy, value += part.value;
  exploration += part.exploration, kl_penalty += part.kl_penalty;
  kl += part.kl, entropy += part.entropy;
  predicted_value += part.predicted_value, value_delta += part.value_delta;
  ratio += part.ratio, clipped += part.clipped;
  kl_max = std::max(kl_max, part.kl_max);
  value_delta_max = std::max(value_delta_max, part.value_delta_max);
  ratio_min = std::min(ratio_min, part.ratio_min);
  ratio_max = std::max(ratio_max, part.ratio_max);
  log_prob_max = std::max(log_prob_max, part.log_prob_max);
  value_clipped += part.value_clipped;
  for (std::size_t head = 0; head < head_entropy.size(); ++head)
    head_entropy[head] += part.head_entropy[head];
}

void OnPolicy::LossSums::add_policy(const LossSums& part, double share) {
  policy += share * part.policy;
  exploration += share * part.exploration;
  kl_penalty += share * part.kl_penalty;
  kl += share * part.kl;
  kl_max = std::max(kl_max, part.kl_max);
  entropy += share * part.entropy;
  ratio += share * part.ratio;
  ratio_min = std::min(ratio_min, part.ratio_min);
  ratio_max = std::max(ratio_max, part.ratio_max);
  clipped += share * part.clipped;
  log_prob_max = std::max(log_prob_max, part.log_prob_max);
  kl_first += share * part.kl_first;
  clipped_first += share * part.clipped_first;
  for (std::size_t head = 0; head < head_entropy.size(); ++head)
    head_entropy[head] += share * part.head_entropy[head];
}

void OnPolicy::LossSums::take_value(const LossSums& part) {
  value = part.value;
  predicted_value = part.predicted_value;
  value_delta = part.value_delta;
  value_delta_max = part.value_delta_max;
  value_clipped = part.value_clipped;
}

OnPolicy::OnPolicy(const RunConfig& config, const EnvShape& env, torch::Device device)
    : config_(config),
      env_(env),
      device_(device),
      net_(policy::PolicyNet::create(policy::PolicyNetOptions::from(config, env),
                                     RngKey(static_cast<uint64_t>(config.run.seed)).split("network").bits(),
                                     device)),
      schedule_(config),
      returns_(config.optimisation.returns_clip),
      pool_(threads_for_parts(config, device)) {}

Expected<bool> OnPolicy::begin_update(RolloutBatch& batch, const UpdateContext& context, UpdateStats& stats) {
  schedule_.before_batch(context.env_frames);
  stats.lag = apply_lag_filter(batch, version_, config_.collection.max_policy_lag);
  ++updates_;
  if (stats.lag.valid_fraction == 0) {
    COMRAD_TRY(guard_.skip_invalid_batch(stats.lag.dropped, stats));
    return false;
  }
  if (stats.lag.valid_fraction < 0.5)
    spdlog::warn("update: only {:.0f}% of the batch is valid", 100 * stats.lag.valid_fraction);

  if (config_.network.normalize_input) {
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
  if (net_.options().global_state_count > 0) {
    const int64_t agents = batch.shape.env.num_agents;
    const Tensor valid = batch.valid.view({batch.steps(), batch.slab_count, agents}).amax(2);
    net_.update_state_statistics(
        batch.global_state.flatten(0, 1).index_select(0, valid.flatten().nonzero().squeeze(1)).to(device_));
  }
  return true;
}

void OnPolicy::prepare_targets(RolloutBatch& batch) {
  torch::NoGradGuard no_grad;
  const auto natural = [this](const Tensor& value) {
    return config_.optimisation.normalize_returns ? returns_.denormalize(value) : value;
  };
  const Tensor value = natural(batch.value);
  const Advantages result = gae({.reward = batch.reward,
                                 .terminated = batch.terminated,
                                 .truncated = batch.truncated,
                                 .value = value,
                                 .final_value = natural(batch.final_value),
                                 .valid = batch.valid,
                                 .value_valid = batch.value_valid},
                                {.gamma = config_.optimisation.gamma,
                                 .lambda = config_.on_policy.gae_lambda,
                                 .legacy_timeouts = config_.optimisation.legacy_timeouts});
  batch.advantage = batch.raw_advantage = reported_advantage_ = result.advantage;
  batch.target = result.target;
  reported_acting_ = batch.acting();
  explained_variance_ = explained_variance(result.target, value.narrow(0, 0, batch.steps()), batch.valid);
  if (!config_.optimisation.normalize_returns) return;
  if (!returns_.update(result.target, batch.valid))
    spdlog::warn("update: returns are not finite; statistics kept");
  batch.target = returns_.normalize(result.target);
  targets_clipped_ = returns_.clipped_fraction(result.target, batch.valid);
}

Expected<OnPolicy::PhaseEnd> OnPolicy::train_phase(const RolloutBatch& batch, const Phase& phase,
                                                   const UpdateContext& context, UpdateStats& stats,
                                                   LossSums& sums) {
  const int64_t agents = batch.shape.env.num_agents;
  std::vector<int64_t> order(static_cast<std::size_t>(batch.slab_count));
  std::iota(order.begin(), order.end(), 0);
  Rng rng(RngKey(static_cast<uint64_t>(config_.run.seed))
              .split("shuffle")
              .split(static_cast<uint64_t>(updates_))
              .split(phase.shuffle_key));
  const int64_t parts = std::clamp<int64_t>(config_.optimisation.num_batches_per_epoch, 1, batch.slab_count);
  double previous_actor_loss = 1e9, kl_first = 0, clipped_first = 0;
  bool is_first = true;
  for (int64_t epoch = 0; epoch < config_.optimisation.num_epochs; ++epoch) {
    if (config_.optimisation.shuffle_minibatches)
      for (std::size_t i = order.size() - 1; i > 0; --i)
        std::swap(order[i], order[rng.below(static_cast<uint32_t>(i + 1))]);
    double actor_loss = 0, kl = 0;
    int64_t trained = 0;
    for (int64_t part = 0; part < parts; ++part) {
      const int64_t begin = batch.slab_count * part / parts, end = batch.slab_count * (part + 1) / parts;
      RolloutBatch minibatch =
          config_.optimisation.shuffle_minibatches && parts > 1
              ? select_slabs(batch, std::vector<int64_t>(order.begin() + begin, order.begin() + end))
              : narrow_rows(batch, begin * agents, (end - begin) * agents);
      if (stats.optimizer_steps > 0 && context.begin_step && !context.begin_step()) return PhaseEnd::kStopped;
      LossSums part_sums;
      const StepResult result = train_minibatch(minibatch, phase, context, is_first, stats, part_sums);
      if (is_first) kl_first = part_sums.kl, clipped_first = part_sums.clipped;
      is_first = false;
      if (result == StepResult::kAbandoned) return PhaseEnd::kAbandoned;
      if (result == StepResult::kKlReached) return PhaseEnd::kDone;
      COMRAD_TRY(guard_.status());
      if (result == StepResult::kSkipped) continue;
      sums = part_sums;
      sums.kl_first = kl_first;
      sums.clipped_first = clipped_first;
      actor_loss += part_sums.actor();
      kl += part_sums.kl;
      if (!part_sums.has_policy) continue;  // of dead agents alone: its KL is no news
      ++trained;
      if (phase.trains_policy) schedule_.after_minibatch(part_sums.kl);
    }
    if (trained == 0 || !phase.trains_policy) continue;
    schedule_.after_epoch(kl / static_cast<double>(trained));
    actor_loss /= static_cast<double>(trained);
    if (std::abs(previous_actor_loss - actor_loss) < kEarlyStopLossChange) break;
    previous_actor_loss = actor_loss;
  }
  return PhaseEnd::kDone;
}

OnPolicy::StepResult OnPolicy::train_minibatch(RolloutBatch& minibatch, const Phase& phase,
                                               const UpdateContext& context, bool is_first,
                                               UpdateStats& stats, LossSums& sums) {
  const double valid_count = minibatch.valid.sum(torch::kFloat64).item<double>();
  sums.has_policy = phase.trains_policy && minibatch.acting().any().item<bool>();
  // Without anything to learn Adam's momentum would still move the weights.
  if (valid_count == 0 || (!sums.has_policy && !phase.trains_value)) {
    ++stats.skipped_steps;
    return StepResult::kSkipped;
  }
  if (phase.prepare) phase.prepare(minibatch);
  phase.optimizer.zero_grad();
  Phase pass = phase;
  if (!is_first) pass.first_log_prob = nullptr;
  if (!accumulate(minibatch, pass, context, sums)) return StepResult::kAbandoned;
  stats.rows_trained += minibatch.steps() * minibatch.rows();

  // Not before the first step: lag alone must not cost a whole batch.
  if (phase.trains_policy && !is_first && config_.on_policy.early_stop_kl > 0 &&
      sums.kl > config_.on_policy.early_stop_kl)
    return StepResult::kKlReached;

  const double valid_fraction = valid_count / static_cast<double>(minibatch.valid.numel());
  const bool stepped =
      guard_.step(phase.optimizer, sums.total(), schedule_.learning_rate() * valid_fraction, version_, stats);
  last_grad_norm_ = guard_.grad_norm();
  if (!stepped) return StepResult::kSkipped;
  if (context.after_step) context.after_step();
  return StepResult::kTrained;
}

policy::SequenceInput OnPolicy::input_of(const RolloutBatch& rows) const {
  const auto on_device = [this](const Tensor& tensor) {
    return tensor.defined() ? tensor.to(device_) : tensor;
  };
  return {.frame = on_device(rows.frame),
          .measurement = on_device(rows.measurement),
          .recurrent_state = on_device(rows.recurrent_state),
          .reset = on_device(rows.reset),
          .global_state = on_device(rows.global_state)};
}

std::vector<RolloutBatch> OnPolicy::micro_batches(const RolloutBatch& batch) const {
  const int64_t agents = batch.shape.env.num_agents;
  const int64_t whole_worlds = batch.rows() / agents, threads = pool_.threads();
  const int64_t shared_out = (whole_worlds + threads - 1) / threads * agents;
  const int64_t fitting = config_.optimisation.micro_batch_size / batch.steps() / agents * agents;
  const int64_t rows_max = std::max(agents, std::min(fitting, shared_out));
  std::vector<RolloutBatch> micros;
  for (int64_t begin = 0; begin < batch.rows(); begin += rows_max)
    micros.push_back(narrow_rows(batch, begin, std::min(rows_max, batch.rows() - begin)));
  return micros;
}

OnPolicy::Part OnPolicy::part_of(const RolloutBatch& micro, const Phase& phase,
                                 const SampleCounts& counts) const {
  Part part;
  const ExplorationLoss exploration_kind = config_.on_policy.exploration_loss;
  const double clip_high = 1.0 + config_.on_policy.ppo_clip_ratio, clip_low = 1.0 / clip_high;
  const auto on_device = [this](const Tensor& tensor) {
    return tensor.defined() ? tensor.to(device_) : tensor;
  };
  const Tensor valid = on_device(micro.valid).to(torch::kBool);
  const Tensor acting = on_device(micro.acting()).to(torch::kBool);
  const Tensor weight = acting.to(torch::kFloat32) / counts.acting;
  const Tensor value_weight = valid.to(torch::kFloat32) / counts.valid;
  const policy::SequenceOutput output = phase.forward(input_of(micro));
  const Tensor zero = torch::zeros({}, weight.options());

  // Where a number of this micro-batch goes, and how; all of them leave the device at once.
  struct Number {
    double* sum;
    enum { kAdd, kMax, kMin } how;
  };
  std::vector<Number> places;
  std::vector<Tensor> numbers;
  const auto add = [&](double& sum, const Tensor& number) {
    places.push_back({&sum, Number::kAdd});
    numbers.push_back(number.detach());
  };
  const auto add_mean = [&](double& sum, const Tensor& of_samples) { add(sum, (of_samples * weight).sum()); };
  const auto add_value_mean = [&](double& sum, const Tensor& of_samples) {
    add(sum, (of_samples * value_weight).sum());
  };
  const auto add_extreme = [&](double& sum, const Tensor& of_samples, const Tensor& counted,
                               const Tensor& otherwise, bool is_max) {
    const Tensor samples = torch::where(counted, of_samples.detach(), otherwise);
    places.push_back({&sum, is_max ? Number::kMax : Number::kMin});
    numbers.push_back(is_max ? samples.max() : samples.min());
  };

  Tensor loss = zero;
  Tensor log_probs, log_prob, ratio, kl, mask;
  const auto divergence = [&] {
    return policy::kl_divergence(log_probs, policy::head_log_probs(on_device(micro.logits), mask, env_),
                                 env_);
  };
  if (output.logits.defined()) {
    mask = on_device(micro.mask_or_undefined());
    log_probs = policy::head_log_probs(output.logits, mask, env_);
    log_prob = policy::action_log_prob(log_probs, on_device(micro.action), env_);
    ratio = importance_ratio(log_prob, on_device(micro.log_prob));
    const Tensor policy_loss =
        -(clipped_objective(ratio, on_device(micro.advantage), config_.on_policy.ppo_clip_ratio) * weight)
             .sum();
    loss = loss + policy_loss;
    add(part.sums.policy, policy_loss);
    if (exploration_kind != ExplorationLoss::kNone) {
      const Tensor exploration = config_.on_policy.exploration_loss_coeff *
                                 (exploration_loss(log_probs, mask, env_, exploration_kind) * weight).sum();
      loss = loss + exploration;
      add(part.sums.exploration, exploration);
    }
    if (config_.on_policy.kl_loss_coeff != 0) {
      kl = divergence();
      const Tensor penalty = config_.on_policy.kl_loss_coeff * (kl * weight).sum();
      loss = loss + penalty;
      add(part.sums.kl_penalty, penalty);
    }
  }
  Tensor old_value;
  if (output.value.defined()) {
    old_value = on_device(micro.value).narrow(0, 0, micro.steps());
    const Tensor target = on_device(micro.target);
    const Tensor of_samples =
        clipped_value_loss(output.value, old_value, target, config_.on_policy.ppo_clip_value);
    const Tensor value_loss = config_.on_policy.value_loss_coeff * (of_samples * value_weight).sum();
    loss = loss + value_loss;
    add(part.sums.value, value_loss);
    add_value_mean(part.sums.value_clipped,
                   (of_samples.detach() > (output.value.detach() - target).square()).to(torch::kFloat32));
  }
  part.gradients = torch::autograd::grad({loss}, phase.optimizer.parameters(), /*grad_outputs=*/{},
                                         /*retain_graph=*/c10::nullopt, /*create_graph=*/false,
                                         /*allow_unused=*/true);

  torch::NoGradGuard no_grad;
  if (log_prob.defined()) {
    if (phase.first_log_prob != nullptr) part.log_prob = log_prob.detach().cpu();
    if (!kl.defined()) kl = divergence();
    add_mean(part.sums.kl, kl);
    add_extreme(part.sums.kl_max, kl, acting, zero, true);
    const Tensor head_entropy = policy::head_entropies(log_probs, env_);
    add_mean(part.sums.entropy, head_entropy.sum(-1));
    for (int64_t head = 0; head < env_.head_count; ++head)
      add_mean(part.sums.head_entropy[static_cast<std::size_t>(head)], head_entropy.select(-1, head));
    add_mean(part.sums.ratio, ratio);
    add_extreme(part.sums.ratio_min, ratio, acting, zero + 1, false);
    add_extreme(part.sums.ratio_max, ratio, acting, zero + 1, true);
    add_mean(part.sums.clipped, ((ratio < clip_low) | (ratio > clip_high)).to(torch::kFloat32));
    add_extreme(part.sums.log_prob_max, log_prob.abs(), acting, zero, true);
  }
  if (output.value.defined()) {
    const Tensor value_delta = (output.value - old_value).abs();
    add_value_mean(part.sums.predicted_value, output.value);
    add_value_mean(part.sums.value_delta, value_delta);
    add_extreme(part.sums.value_delta_max, value_delta, valid, zero, true);
  }
  const Tensor read = torch::stack(numbers).cpu();
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double number = double{read.data_ptr<float>()[i]};
    double& sum = *places[i].sum;
    sum = places[i].how == Number::kAdd   ? sum + number
          : places[i].how == Number::kMax ? std::max(sum, number)
                                          : std::min(sum, number);
  }
  return part;
}

bool OnPolicy::accumulate(const RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                          LossSums& sums) {
  // What depends on the whole minibatch came before; each micro-batch adds its share of the same sums, so the
  // gradient does not depend on micro_batch_size.
  const auto count_of = [](const Tensor& mask) {
    return std::max(1.0, mask.sum(torch::kFloat64).item<double>());
  };
  const SampleCounts counts{.valid = count_of(minibatch.valid), .acting = count_of(minibatch.acting())};
  const std::vector<RolloutBatch> micros = micro_batches(minibatch);
  std::vector<Tensor> first_log_prob;
  const bool is_done = sum_gradients<Part>(
      pool_, phase.optimizer.parameters(), static_cast<int64_t>(micros.size()),
      [&](int64_t i) { return part_of(micros[static_cast<std::size_t>(i)], phase, counts); },
      [&](const Part& part) {
        sums.add(part.sums);
        if (phase.first_log_prob != nullptr) first_log_prob.push_back(part.log_prob);
      },
      context.keep_going);
  if (!is_done) return false;
  if (phase.first_log_prob != nullptr) *phase.first_log_prob = at::cat(first_log_prob, 1);
  return true;
}

OnPolicy::Evaluation OnPolicy::evaluate(const RolloutBatch& batch, const Forward& forward) const {
  const std::vector<RolloutBatch> micros = micro_batches(batch);
  std::vector<Evaluation> parts(micros.size());
  const auto work = [&](int64_t i) {
    torch::NoGradGuard no_grad;
    const RolloutBatch& micro = micros[static_cast<std::size_t>(i)];
    const policy::SequenceOutput output = forward(input_of(micro));
    Evaluation& part = parts[static_cast<std::size_t>(i)];
    if (output.logits.defined()) {
      const Tensor mask = micro.mask_or_undefined();
      const Tensor of_choices =
          policy::head_log_probs(output.logits, mask.defined() ? mask.to(device_) : mask, env_);
      part.log_prob = policy::action_log_prob(of_choices, micro.action.to(device_), env_).cpu();
    }
    if (output.value.defined()) part.value = output.value.cpu();
  };
  (void)pool_.run(static_cast<int64_t>(parts.size()), work, nullptr);
  std::vector<Tensor> log_probs, values;
  for (const Evaluation& part : parts) {
    if (part.log_prob.defined()) log_probs.push_back(part.log_prob);
    if (part.value.defined()) values.push_back(part.value);
  }
  return {log_probs.empty() ? Tensor() : at::cat(log_probs, 1).contiguous(),
          values.empty() ? Tensor() : at::cat(values, 1).contiguous()};
}

void OnPolicy::report(const RolloutBatch& batch, const LossSums& sums, UpdateStats& stats) const {
  const auto put = [&stats](const char* name, double value) { stats.values.emplace_back(name, value); };
  put("train/lr", schedule_.learning_rate());
  put("train/actual_lr", guard_.learning_rate());
  put("train/loss", sums.total());
  put("train/policy_loss", sums.policy);
  put("train/value_loss", sums.value);
  put("train/exploration_loss", sums.exploration);
  put("train/kl_loss", sums.kl_penalty);
  put("train/kl_divergence", sums.kl);
  put("train/kl_divergence_max", sums.kl_max);
  put("train/kl_first", sums.kl_first);
  put("train/entropy", sums.entropy);
  for (int32_t head = 0; head < env_.head_count; ++head)
    put(("train/entropy_head_" + std::to_string(head)).c_str(),
        sums.head_entropy[static_cast<std::size_t>(head)]);
  put("train/value", sums.predicted_value);
  put("train/value_delta", sums.value_delta);
  put("train/value_delta_max", sums.value_delta_max);
  put("train/value_clip_fraction", sums.value_clipped);
  put("train/explained_variance", explained_variance_);
  put("train/ratio_mean", sums.ratio);
  put("train/ratio_min", sums.ratio_min);
  put("train/ratio_max", sums.ratio_max);
  put("train/fraction_clipped", sums.clipped);
  put("train/fraction_clipped_first", sums.clipped_first);
  put("train/max_abs_logprob", sums.log_prob_max);
  put("train/grad_norm", last_grad_norm_);
  double second_moment = 0;
  for (const auto& [prefix, optimizer] : optimizers_)
    second_moment = std::max(second_moment, optimizer.max_second_moment());
  put("train/adam_max_second_moment", second_moment);

  const auto acting_samples = [](const Tensor& samples, const Tensor& acting) {
    return samples.flatten(0, 1).index_select(0, acting.flatten().nonzero().squeeze(1));
  };
  const Tensor advantage = acting_samples(reported_advantage_, reported_acting_);
  if (advantage.numel() > 0) {
    put("train/adv_mean", advantage.mean().item<double>());
    put("train/adv_min", advantage.min().item<double>());
    put("train/adv_max", advantage.max().item<double>());
    put("train/adv_std", advantage.numel() > 1 ? advantage.std().item<double>() : 0.0);
  }
  const Tensor action = acting_samples(batch.action, batch.acting());
  if (action.numel() > 0) {
    put("train/act_min", action.min().item<double>());
    put("train/act_max", action.max().item<double>());
  }
  put("train/valids_fraction", stats.lag.valid_fraction);
  put("train/same_policy_fraction",
      1);  // a run trains one policy; dashboards of Sample Factory's runs ask for it
  put("train/num_sgd_steps", static_cast<double>(version_));
  put("train/version_diff_avg", stats.lag.mean);
  put("train/version_diff_min", static_cast<double>(stats.lag.min));
  put("train/version_diff_max", static_cast<double>(stats.lag.max));
  for (const auto& [name, tensor] : net_.named_state()) {  // means over all elements of a frame
    if (name == "normalizer.frame.mean") put("train/obs_running_mean", tensor.mean().item<double>());
    if (name == "normalizer.frame.var") put("train/obs_running_std", tensor.sqrt().mean().item<double>());
  }
  if (config_.optimisation.normalize_returns) {
    put("train/returns_running_mean", returns_.statistics().mean);
    put("train/returns_running_std", returns_.sigma());
    put("train/targets_clipped_fraction", targets_clipped_);
  }
}

void OnPolicy::append_diagnostics(NamedNumbers& values) const {
  PartStatistics parts;
  const policy::NamedTensors named = net_.named_parameters();
  for (const auto& [prefix, optimizer] : optimizers_) parts.add(optimizer, named);
  parts.append_to(values);
}

void OnPolicy::save(StateDict& state) const {
  Progress{version_, updates_}.save(state, config_.run.algo.name(), net_.options().global_state_count);
  for (const auto& [name, tensor] : net_.named_state()) state.put("network/" + name, tensor);
  for (const auto& [prefix, optimizer] : optimizers_) optimizer.save(state, "optimizer", prefix);
  state.put("normalizer/returns_mean", returns_.statistics().mean);
  state.put("normalizer/returns_variance", returns_.statistics().variance);
  state.put("normalizer/returns_count", returns_.statistics().count);
  schedule_.save(state);
}

Status OnPolicy::load(const StateDict& state) {
  COMRAD_TRY_ASSIGN(const Progress progress,
                    Progress::load(state, config_.run.algo.name(), net_.options().global_state_count));
  ReturnNormalizer::Statistics statistics;
  COMRAD_TRY_ASSIGN(statistics.mean, state.number("normalizer/returns_mean"));
  COMRAD_TRY_ASSIGN(statistics.variance, state.number("normalizer/returns_variance"));
  COMRAD_TRY_ASSIGN(statistics.count, state.number("normalizer/returns_count"));
  for (const auto& [key, tensor] : net_.named_state()) {
    const Status copied = state.copy_tensor("network/" + key, tensor);
    if (copied) continue;
    const bool is_view = config_.run.algo->critic == CriticKind::kCentral && key.starts_with("critic.");
    return Error{
        copied.error().code,
        copied.error().message +
            (is_view ? " (mappo_critic_view is " + std::string(word_of(config_.network.mappo_critic_view)) +
                           " here; a run made before that setting was there saw by position: put "
                           "mappo_critic_view = \"position\" into its config.toml)"
                     : "")};
  }
  net_.state_changed();
  for (auto& [prefix, optimizer] : optimizers_) COMRAD_TRY(optimizer.load(state, "optimizer", prefix));
  COMRAD_TRY(schedule_.load(state));
  version_ = progress.version;
  updates_ = progress.updates;
  returns_.restore(statistics);
  return {};
}

}  // namespace comrad::learn
