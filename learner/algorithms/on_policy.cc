#include "learner/algorithms/on_policy.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <span>
#include <utility>

#include "learner/batch/masked.h"
#include "learner/checkpoint/progress.h"
#include "learner/estimators/gae.h"
#include "learner/losses/ppo_loss.h"
#include "learner/ranks/lag_of_ranks.h"
#include "learner/step/micro_batches.h"
#include "learner/step/part_statistics.h"
#include "learner/step/terms_report.h"
#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
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

/// What one launch sends to the device, on the host.
std::vector<double> read_together(const std::vector<Tensor>& numbers) {
  if (numbers.empty()) return {};
  std::vector<Tensor> of_one_type;
  for (const Tensor& number : numbers) of_one_type.push_back(number.detach().to(torch::kFloat64).reshape({}));
  device::Readback read(torch::stack(of_one_type));
  read.wait();
  return {read.values(), read.values() + read.count()};
}

policy::SequenceInput input_of(const RolloutBatch& rows) {
  return {.frame = rows.frame,
          .measurement = rows.measurement,
          .recurrent_state = rows.recurrent_state,
          .reset = rows.reset,
          .global_state = rows.global_state};
}

}  // namespace

/// Rows and the phase that reads them.
class OnPolicy::Input final : public StepInput {
 public:
  Input(const OnPolicy& owner, RolloutBatch rows, Phase phase)
      : owner_(owner), rows_(std::move(rows)), phase_(std::move(phase)) {}

  std::vector<MicroLoss> micro_losses() const override {
    std::vector<MicroLoss> losses;
    for (const RolloutBatch& micro : owner_.micro_batches(rows_))
      losses.push_back([micro, &owner = owner_, forward = phase_.forward](std::span<const Tensor> scalars) {
        return owner.loss(forward(input_of(micro)), micro, PpoScalars(scalars));
      });
    return losses;
  }
  std::unique_ptr<StepInput> clone() const override { return std::make_unique<Input>(owner_, rows_, phase_); }
  void visit(const std::function<void(Tensor&)>& visit) override { visit_device_fields(rows_, visit); }

  Evaluation evaluate() const { return owner_.evaluate_now(rows_, phase_.forward); }

 private:
  const OnPolicy& owner_;
  RolloutBatch rows_;
  Phase phase_;
};

OnPolicy::OnPolicy(const RunConfig& config, const EnvShape& env, torch::Device device)
    : config_(config),
      env_(env),
      device_(device),
      net_(policy::ActorCritic::create(policy::NetworkOptions::from(config, env),
                                       RngKey(static_cast<uint64_t>(config.run.seed)).split("network").bits(),
                                       device)),
      schedule_(config),
      returns_(config.optimisation.returns_clip, config.on_policy.returns_half_life_decisions),
      runner_(config, device),
      launched_(runner_) {}

LossTerms OnPolicy::loss(const policy::SequenceOutput& output, const RolloutBatch& rows,
                         const PpoScalars& scalars) const {
  return ppo_loss(output, rows, scalars, PpoOptions::from(config_));
}

Expected<bool> OnPolicy::begin_update(RolloutBatch& batch, const UpdateContext& context, UpdateStats& stats) {
  env_frames_ = context.env_frames;
  launched_.take_late(stats);
  schedule_.before_batch(env_frames_);
  stats.lag = lag_of_ranks(apply_lag_filter(batch, version(), config_.collection.max_policy_lag),
                           batch.valid.numel(), ranks());
  ++updates_;
  if (stats.lag.valid_fraction == 0) {
    COMRAD_TRY(runner_.skip_invalid_batch(stats.lag.dropped, stats));
    return false;
  }
  if (stats.lag.valid_fraction < 0.5)
    spdlog::warn("update: only {:.0f}% of the batch is valid", 100 * stats.lag.valid_fraction);

  if (config_.network.normalize_input) {
    torch::NoGradGuard no_grad;
    Tensor frame = frames_on(batch, device_).flatten(0, 1);
    Tensor measurement =
        batch.measurement.defined() ? ranks().gather(batch.measurement, 1).flatten(0, 1) : Tensor();
    if (stats.lag.valid_fraction < 1) {
      frame = frame.index_select(0, device::moved(positions_of(batch.valid), device_));
      if (measurement.defined())
        measurement = measurement.index_select(0, positions_of(ranks().gather(batch.valid, 1)));
    }
    net_.update_input_statistics(
        frame, device::moved(measurement, device_),
        ranks().adder());  // the frames of other ranks are not fetched: their sums are
  }
  if (net_.options().global_state_count > 0) {
    const int64_t agents = batch.shape.env.num_agents;
    const Tensor valid = batch.valid.view({batch.steps(), batch.slab_count, agents}).amax(2);
    net_.update_state_statistics(device::moved(ranks()
                                                   .gather(batch.global_state, 1)
                                                   .flatten(0, 1)
                                                   .index_select(0, positions_of(ranks().gather(valid, 1))),
                                               device_));
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
  reported_advantage_ = ranks().gather(result.advantage, 1);
  reported_acting_ = ranks().gather(batch.acting(), 1);
  const Tensor target = ranks().gather(result.target, 1), valid = ranks().gather(batch.valid, 1);
  explained_variance_ =
      explained_variance(target, ranks().gather(value.narrow(0, 0, batch.steps()), 1), valid);
  if (!config_.optimisation.normalize_returns) return;
  const double mean = returns_.statistics().mean, sigma = returns_.sigma();
  if (!returns_.update(target, valid)) spdlog::warn("update: returns are not finite; statistics kept");
  if (config_.on_policy.popart) {
    // What was predicted in the old unit is the same return in the new one.
    const double scale = sigma / returns_.sigma(),
                 shift = (mean - returns_.statistics().mean) / returns_.sigma();
    net_.rescale_values(scale, shift);
    batch.value = batch.value * scale + shift;
  }
  batch.target = returns_.normalize(result.target);
  targets_clipped_ = returns_.clipped_fraction(target, valid);
}

Expected<OnPolicy::PhaseEnd> OnPolicy::train_phase(const RolloutBatch& batch, const Phase& phase,
                                                   const UpdateContext& context, UpdateStats& stats,
                                                   TermValues& terms) {
  if (!batch.host_valid.defined())
    return train_phase(to_device(batch, device_), phase, context, stats, terms);
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
  bool is_first = true, is_first_completed = false;
  launched_.begin_phase();
  const auto complete_steps = [&](bool waits) -> Status {
    while (launched_.has_outcome(waits)) {
      const auto [step, trains_policy, is_of_this_phase] = launched_.take_outcome(stats);
      COMRAD_TRY(runner_.status());
      if (!is_of_this_phase) continue;
      last_grad_norm_ = runner_.grad_norm();
      if (!step.was_taken) {
        is_first_completed = true;
        continue;
      }
      terms = step.terms;
      const double kl_of_step = terms["kl_divergence"];
      if (!std::exchange(is_first_completed, true))
        kl_first = kl_of_step, clipped_first = terms["fraction_clipped"];
      terms.set("kl_first", kl_first);
      terms.set("fraction_clipped_first", clipped_first);
      actor_loss += terms.loss() - terms["value_loss"];
      kl += kl_of_step;
      if (!trains_policy) continue;  // of dead agents alone: its KL is not informative
      ++trained;
      if (phase.trains_policy) schedule_.after_minibatch(kl_of_step);
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
      if (stats.optimizer_steps > 0 && !ranks().all(!context.begin_step || context.begin_step())) {
        COMRAD_TRY(complete_steps(/*waits=*/true));
        return PhaseEnd::kStopped;
      }
      const PolicyVersion version_before = version();
      const StepResult result = train_minibatch(minibatch, phase, context, is_first, stats);
      is_first = false;
      if (result == StepResult::kAbandoned || result == StepResult::kKlReached) {
        COMRAD_TRY(complete_steps(/*waits=*/true));
        return result == StepResult::kAbandoned ? PhaseEnd::kAbandoned : PhaseEnd::kDone;
      }
      if (result == StepResult::kSkipped) is_first_completed = true;
      COMRAD_TRY(complete_steps(/*waits=*/schedule_.follows_minibatches()));
      if (version() != version_before && context.after_step) context.after_step();
    }
    if (epoch + 1 == epochs && !schedule_.follows_epochs()) break;
    COMRAD_TRY(complete_steps(/*waits=*/true));
    if (trained == 0 || !phase.trains_policy) continue;
    schedule_.after_epoch(kl / static_cast<double>(trained));
    actor_loss /= static_cast<double>(trained);
    if (std::abs(previous_actor_loss - actor_loss) < kEarlyStopLossChange) break;
    previous_actor_loss = actor_loss;
  }
  COMRAD_TRY(complete_steps(/*waits=*/context.reports));
  return PhaseEnd::kDone;
}

OnPolicy::StepResult OnPolicy::train_minibatch(RolloutBatch& minibatch, const Phase& phase,
                                               const UpdateContext& context, bool is_first,
                                               UpdateStats& stats) {
  const SampleTotals totals = totals_of(minibatch);
  const bool has_policy = phase.trains_policy && totals.acting > 0;
  // Without anything to learn Adam's momentum would still move the weights.
  if (totals.valid == 0 || (!has_policy && !phase.trains_value)) {
    ++stats.skipped_steps;
    return StepResult::kSkipped;
  }
  const device::StepScope nothing_waits;
  if (phase.prepare) phase.prepare(minibatch);
  Input input(*this, minibatch, phase);
  const bool keeps_log_prob = is_first && phase.first_log_prob != nullptr;
  // Not before the first step: lag alone must not cost a whole batch.
  const bool watches_kl = phase.trains_policy && !is_first && config_.on_policy.early_stop_kl > 0;
  std::function<bool(const TermValues&)> is_wanted;
  if (watches_kl)
    is_wanted = [this](const TermValues& terms) {
      return terms["kl_divergence"] <= config_.on_policy.early_stop_kl;
    };
  LaunchedStep launched{.terms = {}, .read = {}, .trains_policy = has_policy};
  const StepRunner::Result result =
      runner_.launch({.optimizer = phase.optimizer,
                      .input = input,
                      .scalars = scalars(totals),
                      .learning_rate = schedule_.learning_rate() * (totals.valid / totals.places),
                      .keeps = keeps_log_prob,
                      .keep_going = context.keep_going,
                      .is_wanted = is_wanted},
                     stats, launched);
  if (result == StepRunner::Result::kAbandoned) return StepResult::kAbandoned;
  stats.rows_trained += minibatch.steps() * minibatch.rows();
  if (result == StepRunner::Result::kRefused) return StepResult::kKlReached;
  if (keeps_log_prob) *phase.first_log_prob = at::cat(launched.terms.kept, 1);
  launched_.add(std::move(launched));
  return StepResult::kLaunched;
}

std::vector<RolloutBatch> OnPolicy::micro_batches(const RolloutBatch& batch) const {
  const int64_t agents = batch.shape.env.num_agents;
  const int64_t whole_worlds = batch.rows() / agents, threads = runner_.pool().threads();
  const int64_t shared_out = (whole_worlds + threads - 1) / threads * agents;
  const int64_t fitting = samples_of_part(config_, device_) / batch.steps() / agents * agents;
  const int64_t rows_max = std::max(agents, std::min(fitting, shared_out));
  std::vector<RolloutBatch> micros;
  for (int64_t begin = 0; begin < batch.rows(); begin += rows_max)
    micros.push_back(narrow_rows(batch, begin, std::min(rows_max, batch.rows() - begin)));
  return micros;
}

std::vector<double> OnPolicy::scalars(const SampleTotals& totals) const {
  return {std::max(1.0, totals.valid), std::max(1.0, totals.acting),
          config_.on_policy.ppo_clip_ratio.at(env_frames_),
          config_.on_policy.exploration_loss_coeff.at(env_frames_)};
}

OnPolicy::SampleTotals OnPolicy::totals_of(const RolloutBatch& minibatch) {
  const std::vector<double> totals = ranks().add_up({static_cast<double>(count_of(minibatch.host_valid)),
                                                     static_cast<double>(count_of(minibatch.host_acting)),
                                                     static_cast<double>(minibatch.valid.numel())});
  return {.valid = totals[0], .acting = totals[1], .places = totals[2]};
}

Tensor OnPolicy::standardized(const Tensor& advantage, const Tensor& acting) {
  const double floor = config_.optimisation.normalize_returns
                           ? config_.on_policy.advantage_deviation_min * returns_.sigma()
                           : 0;
  const Tensor of_all = standardize(ranks().gather(advantage, 1), ranks().gather(acting, 1), floor);
  return of_all.narrow(1, ranks().rank() * advantage.size(1), advantage.size(1));
}

bool OnPolicy::accumulate(const RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                          TermValues& terms) {
  const SampleTotals totals = totals_of(minibatch);
  Input input(*this, minibatch, phase);
  const std::optional<StepOutcome> outcome = runner_.gradient_of({.optimizer = phase.optimizer,
                                                                  .input = input,
                                                                  .scalars = scalars(totals),
                                                                  .keep_going = context.keep_going});
  if (outcome) terms = outcome->terms;
  return outcome.has_value();
}

OnPolicy::Evaluation OnPolicy::evaluate(const RolloutBatch& batch, const Phase& phase) {
  Input input(*this, batch, phase);
  const std::vector<Tensor> said = runner_.evaluate(input, &phase.optimizer, [](const StepInput& rows) {
    const Evaluation evaluation = static_cast<const Input&>(rows).evaluate();
    return std::vector{evaluation.log_prob, evaluation.value};
  });
  return {.log_prob = said[0], .value = said[1]};
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
  (void)runner_.pool().run(static_cast<int64_t>(parts.size()), work, nullptr);
  std::vector<Tensor> log_probs, values;
  for (const Evaluation& part : parts) {
    if (part.log_prob.defined()) log_probs.push_back(part.log_prob);
    if (part.value.defined()) values.push_back(part.value);
  }
  return {log_probs.empty() ? Tensor() : at::cat(log_probs, 1).contiguous(),
          values.empty() ? Tensor() : at::cat(values, 1).contiguous()};
}

void OnPolicy::report(const RolloutBatch& batch, const TermValues& terms, UpdateStats& stats,
                      const std::vector<std::pair<std::string, Tensor>>& more) const {
  const auto put = [&stats](const char* name, double value) { stats.values.emplace_back(name, value); };
  put("train/lr", schedule_.learning_rate());
  put("train/actual_lr", runner_.learning_rate());
  put("train/exploration_loss_coeff", config_.on_policy.exploration_loss_coeff.at(env_frames_));
  put("train/ppo_clip_ratio", config_.on_policy.ppo_clip_ratio.at(env_frames_));
  put("train/loss", terms.loss());
  append_terms(terms, stats.values);
  put("train/explained_variance", explained_variance_);
  put("train/grad_norm", last_grad_norm_);

  const Spread advantage = spread_of(reported_advantage_, reported_acting_);
  if (advantage.count > 0) {
    put("train/adv_mean", advantage.mean);
    put("train/adv_min", advantage.min);
    put("train/adv_max", advantage.max);
    put("train/adv_std", std::sqrt(advantage.variance(/*unbiased=*/true)));
  }
  const Spread action = spread_of(ranks().gather(batch.action, 1), ranks().gather(batch.acting(), 1));
  if (action.count > 0) {
    put("train/act_min", action.min);
    put("train/act_max", action.max);
  }
  put("train/valids_fraction", stats.lag.valid_fraction);
  put("train/same_policy_fraction",
      1);  // a run trains one policy; dashboards of Sample Factory's runs read it
  put("train/num_sgd_steps", static_cast<double>(version()));
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
  runner_.learn_with(ranks);
  return {};
}

void OnPolicy::append_diagnostics(NamedNumbers& values) const {
  PartStatistics parts;
  const policy::NamedTensors named = net_.named_parameters();
  for (const auto& [prefix, optimizer] : optimizers_) parts.add(optimizer, named);
  parts.append_to(values);
}

void OnPolicy::save(StateDict& state) const {
  Progress{version(), updates_}.save(state, config_.run.algo.name(), net_.options().global_state_count);
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
  launched_.forget();
  runner_.resume(progress.version);
  updates_ = progress.updates;
  returns_.restore(statistics);
  return {};
}

}  // namespace comrad::learn
