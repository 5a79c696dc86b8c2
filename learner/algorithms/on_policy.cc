#include "learner/algorithms/on_policy.h"

#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "learner/algorithms/gradient_sum.h"
#include "learner/algorithms/lag_of_ranks.h"
#include "learner/algorithms/micro_batches.h"
#include "learner/algorithms/part_statistics.h"
#include "learner/algorithms/ppo_loss.h"
#include "learner/algorithms/progress.h"
#include "learner/batch/masked.h"
#include "learner/estimators/gae.h"
#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/device/operator_path.h"
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
  const Spread of_error = spread_of(target.to(torch::kFloat64) - value, valid);
  return 1 - of_error.variance(/*unbiased=*/false) / spread_of(target, valid).variance(/*unbiased=*/false);
}

/// What the device is asked for in one go, on the host.
std::vector<double> read_together(const std::vector<Tensor>& numbers) {
  if (numbers.empty()) return {};
  std::vector<Tensor> of_one_type;
  for (const Tensor& number : numbers) of_one_type.push_back(number.detach().to(torch::kFloat64).reshape({}));
  device::Readback read(torch::stack(of_one_type));
  read.wait();
  return {read.values(), read.values() + read.count()};
}

}  // namespace

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
  stats.lag = lag_of_ranks(apply_lag_filter(batch, version_, config_.collection.max_policy_lag),
                           batch.valid.numel(), *ranks_);
  ++updates_;
  if (stats.lag.valid_fraction == 0) {
    COMRAD_TRY(guard_.skip_invalid_batch(stats.lag.dropped, stats));
    return false;
  }
  if (stats.lag.valid_fraction < 0.5)
    spdlog::warn("update: only {:.0f}% of the batch is valid", 100 * stats.lag.valid_fraction);

  if (config_.network.normalize_input) {
    torch::NoGradGuard no_grad;
    Tensor frame = frames_on(batch, device_).flatten(0, 1);
    Tensor measurement =
        batch.measurement.defined() ? ranks_->gather(batch.measurement, 1).flatten(0, 1) : Tensor();
    if (stats.lag.valid_fraction < 1) {
      frame = frame.index_select(0, positions_of(batch.valid).to(device_));
      if (measurement.defined())
        measurement = measurement.index_select(0, positions_of(ranks_->gather(batch.valid, 1)));
    }
    policy::AddUp of_all_frames;  // the frames of other ranks are not fetched: their sums are
    if (!ranks_->is_alone()) of_all_frames = [this](Tensor& sums) { ranks_->add_up(sums); };
    net_.update_input_statistics(frame, measurement.defined() ? measurement.to(device_) : measurement,
                                 of_all_frames);
  }
  if (net_.options().global_state_count > 0) {
    const int64_t agents = batch.shape.env.num_agents;
    const Tensor valid = batch.valid.view({batch.steps(), batch.slab_count, agents}).amax(2);
    net_.update_state_statistics(ranks_->gather(batch.global_state, 1)
                                     .flatten(0, 1)
                                     .index_select(0, positions_of(ranks_->gather(valid, 1)))
                                     .to(device_));
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
  batch.advantage = batch.raw_advantage = result.advantage;
  batch.target = result.target;
  reported_advantage_ = ranks_->gather(result.advantage, 1);
  reported_acting_ = ranks_->gather(batch.acting(), 1);
  const Tensor target = ranks_->gather(result.target, 1), valid = ranks_->gather(batch.valid, 1);
  explained_variance_ =
      explained_variance(target, ranks_->gather(value.narrow(0, 0, batch.steps()), 1), valid);
  if (!config_.optimisation.normalize_returns) return;
  if (!returns_.update(target, valid)) spdlog::warn("update: returns are not finite; statistics kept");
  batch.target = returns_.normalize(result.target);
  targets_clipped_ = returns_.clipped_fraction(target, valid);
}

Expected<OnPolicy::PhaseEnd> OnPolicy::train_phase(const RolloutBatch& batch, const Phase& phase,
                                                   const UpdateContext& context, UpdateStats& stats,
                                                   LossSums& sums) {
  if (!batch.host_valid.defined()) return train_phase(to_device(batch, device_), phase, context, stats, sums);
  const int64_t agents = batch.shape.env.num_agents;
  std::vector<int64_t> order(static_cast<std::size_t>(batch.slab_count));
  std::iota(order.begin(), order.end(), 0);
  Rng rng(RngKey(static_cast<uint64_t>(config_.run.seed))
              .split("shuffle")
              .split(static_cast<uint64_t>(updates_))
              .split(phase.shuffle_key));
  const int64_t parts = std::clamp<int64_t>(config_.optimisation.num_batches_per_epoch, 1, batch.slab_count);
  const int64_t epochs = config_.optimisation.num_epochs;
  double previous_actor_loss = 1e9, kl_first = 0, clipped_first = 0;
  // Of the epoch in hand.
  double actor_loss = 0, kl = 0;
  int64_t trained = 0;
  bool is_first = true, is_first_settled = false;
  std::deque<Step> given;
  const auto settle_steps = [&](bool waits) -> Status {
    while (!given.empty() && (waits || given.front().read.is_ready())) {
      const bool has_policy = given.front().has_policy;
      const std::optional<LossSums> of_step = settle(given, stats);
      COMRAD_TRY(guard_.status());
      if (!of_step) {
        is_first_settled = true;
        continue;
      }
      if (!std::exchange(is_first_settled, true)) kl_first = of_step->kl, clipped_first = of_step->clipped;
      sums = *of_step;
      sums.kl_first = kl_first;
      sums.clipped_first = clipped_first;
      actor_loss += of_step->actor();
      kl += of_step->kl;
      if (!has_policy) continue;  // of dead agents alone: its KL is no news
      ++trained;
      if (phase.trains_policy) schedule_.after_minibatch(of_step->kl);
    }
    return {};
  };
  for (int64_t epoch = 0; epoch < epochs; ++epoch) {
    if (config_.optimisation.shuffle_minibatches)
      for (std::size_t i = order.size() - 1; i > 0; --i)
        std::swap(order[i], order[rng.below(static_cast<uint32_t>(i + 1))]);
    actor_loss = kl = 0;
    trained = 0;
    for (int64_t part = 0; part < parts; ++part) {
      const int64_t begin = batch.slab_count * part / parts, end = batch.slab_count * (part + 1) / parts;
      RolloutBatch minibatch =
          config_.optimisation.shuffle_minibatches && parts > 1
              ? select_slabs(batch, std::vector<int64_t>(order.begin() + begin, order.begin() + end))
              : narrow_rows(batch, begin * agents, (end - begin) * agents);
      if (stats.optimizer_steps > 0 && !ranks_->all(!context.begin_step || context.begin_step())) {
        COMRAD_TRY(settle_steps(/*waits=*/true));
        return PhaseEnd::kStopped;
      }
      const PolicyVersion version_before = version_;
      const StepResult result = train_minibatch(minibatch, phase, context, is_first, stats, given);
      is_first = false;
      if (result == StepResult::kAbandoned || result == StepResult::kKlReached) {
        COMRAD_TRY(settle_steps(/*waits=*/true));
        return result == StepResult::kAbandoned ? PhaseEnd::kAbandoned : PhaseEnd::kDone;
      }
      if (result == StepResult::kSkipped) is_first_settled = true;
      COMRAD_TRY(settle_steps(/*waits=*/schedule_.follows_minibatches()));
      if (version_ != version_before && context.after_step) context.after_step();
    }
    if (epoch + 1 == epochs && !schedule_.follows_epochs()) break;
    COMRAD_TRY(settle_steps(/*waits=*/true));
    if (trained == 0 || !phase.trains_policy) continue;
    schedule_.after_epoch(kl / static_cast<double>(trained));
    actor_loss /= static_cast<double>(trained);
    if (std::abs(previous_actor_loss - actor_loss) < kEarlyStopLossChange) break;
    previous_actor_loss = actor_loss;
  }
  COMRAD_TRY(settle_steps(/*waits=*/true));
  return PhaseEnd::kDone;
}

OnPolicy::StepResult OnPolicy::train_minibatch(RolloutBatch& minibatch, const Phase& phase,
                                               const UpdateContext& context, bool is_first,
                                               UpdateStats& stats, std::deque<Step>& given) {
  const SampleTotals totals = totals_of(minibatch);
  const bool has_policy = phase.trains_policy && totals.acting > 0;
  // Without anything to learn Adam's momentum would still move the weights.
  if (totals.valid == 0 || (!has_policy && !phase.trains_value)) {
    ++stats.skipped_steps;
    return StepResult::kSkipped;
  }
  const device::StepScope nothing_waits;
  if (phase.prepare) phase.prepare(minibatch);
  Phase pass = phase;
  if (!is_first) pass.first_log_prob = nullptr;
  const double valid_fraction = totals.valid / totals.places;
  Step step{.numbers = {},
            .read = {},
            .has_policy = has_policy,
            .learning_rate = schedule_.learning_rate() * valid_fraction};
  // A look at the KL between gradient and step is for the host, and so is what ranks say to each other.
  const bool is_recorded =
      !device::has_own_kernels(device_) && config_.on_policy.early_stop_kl <= 0 && ranks_->is_alone();
  if (is_recorded) {
    if (context.keep_going && !context.keep_going()) return StepResult::kAbandoned;
    stats.rows_trained += minibatch.steps() * minibatch.rows();
    guard_.count_step(version_, stats);
    give_recorded(minibatch, pass, totals, step);
    given.push_back(std::move(step));
    return StepResult::kGiven;
  }
  phase.optimizer.zero_grad();
  if (!add_gradient(minibatch, pass, SampleCounts::of(totals), context.keep_going, step.numbers,
                    pass.first_log_prob))
    return StepResult::kAbandoned;
  stats.rows_trained += minibatch.steps() * minibatch.rows();

  // Not before the first step: lag alone must not cost a whole batch.
  if (phase.trains_policy && !is_first && config_.on_policy.early_stop_kl > 0) {
    device::Readback read(at::cat(step.numbers.of_parts).to(torch::kFloat64));
    read.wait();
    if (step.numbers.sums(read.values()).kl > config_.on_policy.early_stop_kl) return StepResult::kKlReached;
  }

  const Tensor outcome = guard_.step(phase.optimizer, step.numbers.loss, step.learning_rate, version_, stats);
  std::vector<Tensor> numbers = step.numbers.of_parts;
  numbers.push_back(outcome);
  step.read = device::Readback(at::cat(numbers).to(torch::kFloat64));
  given.push_back(std::move(step));
  return StepResult::kGiven;
}

std::optional<OnPolicy::LossSums> OnPolicy::settle(std::deque<Step>& given, UpdateStats& stats) {
  Step step = std::move(given.front());
  given.pop_front();
  if (!step.read.is_ready()) step.read.wait();
  const double* outcome = step.read.values() + step.read.count() - 2;
  LossSums sums = step.numbers.sums(step.read.values());
  sums.has_policy = step.has_policy;
  guard_.settle({.was_taken = outcome[0] != 0,
                 .grad_norm = outcome[1],
                 .loss = sums.total(),
                 .learning_rate = step.learning_rate},
                version_, stats);
  last_grad_norm_ = guard_.grad_norm();
  if (outcome[0] == 0) return std::nullopt;
  return sums;
}

OnPolicy::LossSums OnPolicy::Numbers::sums(const double* values) const {
  LossSums sums;
  for (std::size_t part = 0; part < of_parts.size(); ++part)
    for (const Number& place : places) {
      double& sum =
          place.head < 0 ? sums.*place.sum : sums.head_entropy[static_cast<std::size_t>(place.head)];
      const double number = *values++;
      sum = place.how == Number::kAdd   ? sum + number
            : place.how == Number::kMax ? std::max(sum, number)
                                        : std::min(sum, number);
    }
  return sums;
}

policy::SequenceInput OnPolicy::input_of(const RolloutBatch& rows) const {
  return {.frame = rows.frame,
          .measurement = rows.measurement,
          .recurrent_state = rows.recurrent_state,
          .reset = rows.reset,
          .global_state = rows.global_state};
}

std::vector<RolloutBatch> OnPolicy::micro_batches(const RolloutBatch& batch) const {
  const int64_t agents = batch.shape.env.num_agents;
  const int64_t whole_worlds = batch.rows() / agents, threads = pool_.threads();
  const int64_t shared_out = (whole_worlds + threads - 1) / threads * agents;
  const int64_t fitting = samples_of_part(config_, device_) / batch.steps() / agents * agents;
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
  const Tensor valid = micro.valid.to(torch::kBool);
  const Tensor acting = micro.acting().to(torch::kBool);
  const Tensor weight = acting.to(torch::kFloat32) / counts.acting;
  const Tensor value_weight = valid.to(torch::kFloat32) / counts.valid;
  const policy::SequenceOutput output = phase.forward(input_of(micro));
  const Tensor zero = torch::zeros({}, weight.options());

  std::vector<Tensor> numbers;
  using Sum = double LossSums::*;
  const auto add = [&](Sum sum, const Tensor& number) {
    part.places.push_back({.sum = sum});
    numbers.push_back(number.detach());
  };
  const auto add_mean = [&](Sum sum, const Tensor& of_samples) { add(sum, (of_samples * weight).sum()); };
  const auto add_value_mean = [&](Sum sum, const Tensor& of_samples) {
    add(sum, (of_samples * value_weight).sum());
  };
  const auto add_extreme = [&](Sum sum, const Tensor& of_samples, const Tensor& counted,
                               const Tensor& otherwise, bool is_max) {
    const Tensor samples = torch::where(counted, of_samples.detach(), otherwise);
    part.places.push_back({.sum = sum, .how = is_max ? Number::kMax : Number::kMin});
    numbers.push_back(is_max ? samples.max() : samples.min());
  };

  Tensor loss = zero;
  Tensor log_probs, log_prob, ratio, kl, mask;
  const auto divergence = [&] {
    return policy::kl_divergence(log_probs, policy::head_log_probs(micro.logits, mask, env_), env_);
  };
  if (output.logits.defined()) {
    mask = micro.mask_or_undefined();
    log_probs = policy::head_log_probs(output.logits, mask, env_);
    log_prob = policy::action_log_prob(log_probs, micro.action, env_);
    ratio = importance_ratio(log_prob, micro.log_prob);
    const Tensor policy_loss =
        -(clipped_objective(ratio, micro.advantage, config_.on_policy.ppo_clip_ratio) * weight).sum();
    loss = loss + policy_loss;
    add(&LossSums::policy, policy_loss);
    if (exploration_kind != ExplorationLoss::kNone) {
      const Tensor exploration = config_.on_policy.exploration_loss_coeff *
                                 (exploration_loss(log_probs, mask, env_, exploration_kind) * weight).sum();
      loss = loss + exploration;
      add(&LossSums::exploration, exploration);
    }
    if (config_.on_policy.kl_loss_coeff != 0) {
      kl = divergence();
      const Tensor penalty = config_.on_policy.kl_loss_coeff * (kl * weight).sum();
      loss = loss + penalty;
      add(&LossSums::kl_penalty, penalty);
    }
  }
  Tensor old_value;
  if (output.value.defined()) {
    old_value = micro.value.narrow(0, 0, micro.steps());
    const Tensor target = micro.target;
    const Tensor of_samples =
        clipped_value_loss(output.value, old_value, target, config_.on_policy.ppo_clip_value);
    const Tensor value_loss = config_.on_policy.value_loss_coeff * (of_samples * value_weight).sum();
    loss = loss + value_loss;
    add(&LossSums::value, value_loss);
    add_value_mean(&LossSums::value_clipped,
                   (of_samples.detach() > (output.value.detach() - target).square()).to(torch::kFloat32));
  }
  part.gradients = torch::autograd::grad({loss}, phase.optimizer.parameters(), /*grad_outputs=*/{},
                                         /*retain_graph=*/c10::nullopt, /*create_graph=*/false,
                                         /*allow_unused=*/true);

  torch::NoGradGuard no_grad;
  if (log_prob.defined()) {
    if (phase.first_log_prob != nullptr) part.log_prob = log_prob.detach();
    if (!kl.defined()) kl = divergence();
    add_mean(&LossSums::kl, kl);
    add_extreme(&LossSums::kl_max, kl, acting, zero, true);
    const Tensor head_entropy = policy::head_entropies(log_probs, env_);
    add_mean(&LossSums::entropy, head_entropy.sum(-1));
    for (int64_t head = 0; head < env_.head_count; ++head) {
      part.places.push_back({.sum = nullptr, .head = static_cast<int>(head)});
      numbers.push_back((head_entropy.select(-1, head) * weight).sum());
    }
    add_mean(&LossSums::ratio, ratio);
    add_extreme(&LossSums::ratio_min, ratio, acting, zero + 1, false);
    add_extreme(&LossSums::ratio_max, ratio, acting, zero + 1, true);
    add_mean(&LossSums::clipped, ((ratio < clip_low) | (ratio > clip_high)).to(torch::kFloat32));
    add_extreme(&LossSums::log_prob_max, log_prob.abs(), acting, zero, true);
  }
  if (output.value.defined()) {
    const Tensor value_delta = (output.value - old_value).abs();
    add_value_mean(&LossSums::predicted_value, output.value);
    add_value_mean(&LossSums::value_delta, value_delta);
    add_extreme(&LossSums::value_delta_max, value_delta, valid, zero, true);
  }
  part.loss = loss.detach();
  part.numbers = torch::stack(numbers);
  return part;
}

OnPolicy::SampleTotals OnPolicy::totals_of(const RolloutBatch& minibatch) {
  const std::vector<double> totals = ranks_->add_up({static_cast<double>(count_of(minibatch.host_valid)),
                                                     static_cast<double>(count_of(minibatch.host_acting)),
                                                     static_cast<double>(minibatch.valid.numel())});
  return {.valid = totals[0], .acting = totals[1], .places = totals[2]};
}

OnPolicy::SampleCounts OnPolicy::SampleCounts::of(const SampleTotals& totals) {
  const auto at_least_one = [](double count) {
    return torch::full({}, std::max(1.0, count), torch::kFloat64);
  };
  return {.valid = at_least_one(totals.valid), .acting = at_least_one(totals.acting)};
}

Tensor OnPolicy::standardized(const Tensor& advantage, const Tensor& acting) {
  if (ranks_->is_alone()) return standardize(advantage, acting);
  const Tensor of_all = standardize(ranks_->gather(advantage, 1), ranks_->gather(acting, 1));
  return of_all.narrow(1, ranks_->rank() * advantage.size(1), advantage.size(1));
}

OnPolicy::Recorded::Recorded(const RolloutBatch& like, const Phase& phase)
    : optimizer(&phase.optimizer), keeps_log_prob(phase.first_log_prob != nullptr), minibatch(like) {
  visit_device_fields(minibatch, [](Tensor& field) { field = torch::empty_like(field); });
}

bool OnPolicy::Recorded::fits(const RolloutBatch& other, const Phase& phase) const {
  return optimizer == &phase.optimizer && keeps_log_prob == (phase.first_log_prob != nullptr) &&
         minibatch.rows() == other.rows() && minibatch.has_action_mask == other.has_action_mask;
}

void OnPolicy::Recorded::read(const RolloutBatch& other) {
  const torch::NoGradGuard no_grad;
  RolloutBatch from = other;
  std::vector<Tensor> fields;
  visit_device_fields(from, [&](Tensor& field) { fields.push_back(field); });
  visit_device_fields(minibatch, [&, next = std::size_t{0}](Tensor& field) mutable {
    field.copy_(fields[next++], /*non_blocking=*/true);
  });
}

OnPolicy::RecordedStep& OnPolicy::recorded_step(const RolloutBatch& minibatch, const Phase& phase) {
  for (const auto& made : recorded_steps_)
    if (made->fits(minibatch, phase)) return *made;
  RecordedStep& made = *recorded_steps_.emplace_back(std::make_unique<RecordedStep>(minibatch, phase));
  made.settings = torch::empty({3}, torch::TensorOptions(torch::kFloat64).device(device_));
  made.graph.record_at_second_replay(device_, [this, &made, phase] {
    phase.optimizer.zero_grad();
    made.numbers = {};
    const SampleCounts counts{.valid = made.settings[0], .acting = made.settings[1]};
    (void)add_gradient(made.minibatch, phase, counts, {}, made.numbers,
                       made.keeps_log_prob ? &made.log_prob : nullptr);
    std::vector<Tensor> numbers = made.numbers.of_parts;
    numbers.push_back(phase.optimizer.step(made.settings[2], made.numbers.loss));
    made.outcome = at::cat(numbers).to(torch::kFloat64);
  });
  return made;
}

void OnPolicy::give_recorded(const RolloutBatch& minibatch, const Phase& phase, const SampleTotals& totals,
                             Step& step) {
  RecordedStep& recorded = recorded_step(minibatch, phase);
  recorded.read(minibatch);
  {
    torch::NoGradGuard no_grad;
    const SampleCounts counts = SampleCounts::of(totals);
    const Tensor settings = device::host_memory({3}, torch::kFloat64, device_);
    settings[0].copy_(counts.valid);
    settings[1].copy_(counts.acting);
    settings[2].fill_(step.learning_rate);
    recorded.settings.copy_(settings, /*non_blocking=*/true);
  }
  recorded.graph.replay();
  step.numbers = recorded.numbers;
  step.read = device::Readback(recorded.outcome);
  if (phase.first_log_prob != nullptr) *phase.first_log_prob = recorded.log_prob.clone();
}

bool OnPolicy::add_gradient(const RolloutBatch& minibatch, const Phase& phase, const SampleCounts& counts,
                            const std::function<bool()>& keep_going, Numbers& numbers,
                            Tensor* first_log_prob) {
  // What depends on the whole minibatch came before; each micro-batch adds its share of the same sums, so the
  // gradient does not depend on micro_batch_size.
  const std::vector<RolloutBatch> micros = micro_batches(minibatch);
  std::vector<Tensor> log_probs;
  const bool is_done = sum_gradients<Part>(
      pool_, phase.optimizer.parameters(), static_cast<int64_t>(micros.size()),
      [&](int64_t i) { return part_of(micros[static_cast<std::size_t>(i)], phase, counts); },
      [&](const Part& part) {
        numbers.places = part.places;
        numbers.of_parts.push_back(part.numbers);
        numbers.loss = numbers.loss.defined() ? numbers.loss + part.loss : part.loss;
        if (first_log_prob != nullptr) log_probs.push_back(part.log_prob);
      },
      keep_going);
  if (!is_done) return false;
  if (first_log_prob != nullptr) *first_log_prob = at::cat(log_probs, 1);
  if (ranks_->is_alone()) return true;
  ranks_->add_up_gradients(phase.optimizer.parameters());
  Tensor losses = numbers.loss.reshape({1});
  const Tensor of_parts = ranks_->gather(torch::stack(numbers.of_parts), 0);
  losses = ranks_->gather(losses, 0);
  if (ranks_->failure()) return false;
  numbers.of_parts = of_parts.unbind(0);
  numbers.loss = losses.sum();
  return true;
}

bool OnPolicy::accumulate(const RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                          LossSums& sums) {
  Numbers numbers;
  if (!add_gradient(minibatch, phase, SampleCounts::of(totals_of(minibatch)), context.keep_going, numbers,
                    phase.first_log_prob))
    return false;
  device::Readback read(at::cat(numbers.of_parts).to(torch::kFloat64));
  read.wait();
  sums = numbers.sums(read.values());
  return true;
}

OnPolicy::Evaluation OnPolicy::evaluate(const RolloutBatch& batch, const Phase& phase) {
  if (device::has_own_kernels(device_)) return evaluate_now(batch, phase.forward);
  RecordedEvaluation& recorded = recorded_evaluation(batch, phase);
  recorded.read(batch);
  recorded.graph.replay();
  const auto copy_of = [](const Tensor& result) { return result.defined() ? result.clone() : result; };
  return {.log_prob = copy_of(recorded.result.log_prob), .value = copy_of(recorded.result.value)};
}

OnPolicy::RecordedEvaluation& OnPolicy::recorded_evaluation(const RolloutBatch& batch, const Phase& phase) {
  for (const auto& made : recorded_evaluations_)
    if (made->fits(batch, phase)) return *made;
  RecordedEvaluation& made =
      *recorded_evaluations_.emplace_back(std::make_unique<RecordedEvaluation>(batch, phase));
  made.graph.record_at_second_replay(device_, [this, &made, forward = phase.forward] {
    made.result = evaluate_now(made.minibatch, forward);
  });
  return made;
}

OnPolicy::Evaluation OnPolicy::evaluate_now(const RolloutBatch& batch, const Forward& forward) const {
  const std::vector<RolloutBatch> micros = micro_batches(batch);
  std::vector<Evaluation> parts(micros.size());
  const auto work = [&](int64_t i) {
    torch::NoGradGuard no_grad;
    const RolloutBatch& micro = micros[static_cast<std::size_t>(i)];
    const policy::SequenceOutput output = forward(input_of(micro));
    Evaluation& part = parts[static_cast<std::size_t>(i)];
    if (output.logits.defined()) {
      const Tensor of_choices = policy::head_log_probs(output.logits, micro.mask_or_undefined(), env_);
      part.log_prob = policy::action_log_prob(of_choices, micro.action, env_);
    }
    if (output.value.defined()) part.value = output.value;
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

void OnPolicy::report(const RolloutBatch& batch, const LossSums& sums, UpdateStats& stats,
                      const std::vector<std::pair<std::string, Tensor>>& more) const {
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

  const Spread advantage = spread_of(reported_advantage_, reported_acting_);
  if (advantage.count > 0) {
    put("train/adv_mean", advantage.mean);
    put("train/adv_min", advantage.min);
    put("train/adv_max", advantage.max);
    put("train/adv_std", std::sqrt(advantage.variance(/*unbiased=*/true)));
  }
  const Spread action = spread_of(ranks_->gather(batch.action, 1), ranks_->gather(batch.acting(), 1));
  if (action.count > 0) {
    put("train/act_min", action.min);
    put("train/act_max", action.max);
  }
  put("train/valids_fraction", stats.lag.valid_fraction);
  put("train/same_policy_fraction",
      1);  // a run trains one policy; dashboards of Sample Factory's runs ask for it
  put("train/num_sgd_steps", static_cast<double>(version_));
  put("train/version_diff_avg", stats.lag.mean);
  put("train/version_diff_min", static_cast<double>(stats.lag.min));
  put("train/version_diff_max", static_cast<double>(stats.lag.max));
  if (config_.optimisation.normalize_returns) {
    put("train/returns_running_mean", returns_.statistics().mean);
    put("train/returns_running_std", returns_.sigma());
    put("train/targets_clipped_fraction", targets_clipped_);
  }

  std::vector<std::pair<std::string, Tensor>> on_device = more;
  std::vector<Tensor> second_moments;
  for (const auto& [prefix, optimizer] : optimizers_) second_moments.push_back(optimizer.max_second_moment());
  on_device.emplace_back("train/adam_max_second_moment", torch::stack(second_moments).max());
  for (const auto& [name, tensor] : net_.named_state()) {  // means over all elements of a frame
    if (name == "normalizer.frame.mean") on_device.emplace_back("train/obs_running_mean", tensor.mean());
    if (name == "normalizer.frame.var") on_device.emplace_back("train/obs_running_std", tensor.sqrt().mean());
  }
  std::vector<Tensor> numbers;
  for (const auto& [name, tensor] : on_device) numbers.push_back(tensor);
  const std::vector<double> read = read_together(numbers);
  for (std::size_t i = 0; i < read.size(); ++i) put(on_device[i].first.c_str(), read[i]);
}

Status OnPolicy::learn_with(RankGroup& ranks) {
  ranks_ = &ranks;
  return {};
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
  recorded_steps_.clear(), recorded_evaluations_.clear();  // moments may move
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
