#include "learner/algorithms/q_learning.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <utility>

#include "learner/batch/masked.h"
#include "learner/checkpoint/progress.h"
#include "learner/estimators/td_targets.h"
#include "learner/step/micro_batches.h"
#include "learner/step/part_statistics.h"
#include "learner/step/terms_report.h"
#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/readback.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/utilities.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace {

RngKey key_of(const RunConfig& config, const char* purpose) {
  return RngKey(static_cast<uint64_t>(config.run.seed)).split(purpose);
}
uint64_t seed_of(const RunConfig& config, const char* purpose) { return key_of(config, purpose).bits(); }

/// A fresh mixer; equal ones for online and target, since both come from one seed. Null for idqn.
std::unique_ptr<Mixer> mixer_of(const RunConfig& config, const EnvShape& env, const policy::ActorCritic& net,
                                uint64_t seed) {
  if (!config.run.algo->mixes_q_values()) return nullptr;
  return make_mixer(MixerOptions::from(config, env, net.encoded_count(), net.options().global_state_count),
                    seed, net.device());
}

std::vector<Tensor> parameters_of(const policy::ActorCritic& net, const Mixer* mixer) {
  std::vector<Tensor> parameters = net.parameters();
  if (mixer == nullptr) return parameters;
  for (const auto& [name, tensor] : mixer->named_parameters()) parameters.push_back(tensor);
  return parameters;
}

/// Weights and biases of the layers that give Q-values, one pair per tower.
std::vector<Tensor> heads_of(const policy::ActorCritic& net) {
  std::vector<Tensor> heads;
  for (const auto& [parameter, tensor] : net.named_parameters())
    if (parameter.ends_with("action_head.weight") || parameter.ends_with("action_head.bias"))
      heads.push_back(tensor);
  return heads;
}

/// Root mean square of the rewards of the valid samples of all ranks, agent by agent.
double reward_rms(const ReplayBatch& batch, RankGroup& ranks) {
  const Tensor valid = ranks.gather(batch.valid, 1).to(torch::kFloat64);
  const Tensor square = ranks.gather(batch.reward, 1).to(torch::kFloat64).square();
  return std::sqrt((square * valid).sum().item<double>() / std::max(1.0, valid.sum().item<double>()));
}

}  // namespace

/// The micro-batches of one batch.
class QLearning::Input final : public StepInput {
 public:
  Input(const QLearning& owner, std::vector<ReplayPart> parts) : owner_(owner), parts_(std::move(parts)) {}

  std::vector<MicroLoss> micro_losses() const override {
    std::vector<MicroLoss> losses;
    for (const ReplayPart& part : parts_)
      losses.push_back(
          [this, &part](std::span<const Tensor> scalars) { return owner_.loss_of_part(part, scalars); });
    return losses;
  }
  std::unique_ptr<StepInput> clone() const override { return std::make_unique<Input>(owner_, parts_); }
  void visit(const std::function<void(Tensor&)>& visit) override {
    for (ReplayPart& part : parts_) part.visit(visit);
  }

 private:
  const QLearning& owner_;
  std::vector<ReplayPart> parts_;
};

QLearning::QLearning(const RunConfig& config, const EnvShape& env, torch::Device device)
    : config_(config),
      env_(env),
      device_(device),
      net_(policy::ActorCritic::create(policy::NetworkOptions::from(config, env), seed_of(config, "network"),
                                       device)),
      target_net_(net_.twin()),
      mixer_(mixer_of(config, env, net_, seed_of(config, "mixer"))),
      target_mixer_(mixer_of(config, env, net_, seed_of(config, "mixer"))),
      optimizer_(parameters_of(net_, mixer_.get()), AdamSettings::from(config)),
      targets_(parameters_of(target_net_, target_mixer_.get()), optimizer_.parameters(),
               config.q_learning.target_update_tau, config.q_learning.target_update_interval, device),
      schedule_(config),
      runner_(config, device),
      launched_(runner_),
      n_step_(config.q_learning.n_step.rounded_at(0)) {}

int64_t QLearning::parameter_count() const {
  int64_t count = 0;
  for (const Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

Status QLearning::learn_with(RankGroup& ranks) {
  runner_.learn_with(ranks);
  return {};
}

void QLearning::observe(const Tensor& frame, const Tensor& measurement, const Tensor& global_state) {
  torch::NoGradGuard no_grad;
  if (net_.options().global_state_count > 0 && global_state.defined())
    net_.update_state_statistics(ranks().gather_rows(global_state).to(device_));
  if (!config_.network.normalize_input || !frame.defined()) return;
  net_.update_input_statistics(
      frame.to(device_), measurement.defined() ? ranks().gather_rows(measurement).to(device_) : measurement,
      ranks().adder());  // the frames of other ranks are not fetched: their sums are
}

Tensor QLearning::next_action(const Scene& scene) const {
  return policy::greedy_action(config_.q_learning.double_dqn ? scene.online.next : scene.target.next,
                               scene.next_mask, env_);
}

Tensor QLearning::loss_of_error(const Tensor& error) const {
  return config_.q_learning.use_huber_loss ? huber(error) : error.square();
}

std::vector<ReplayPart> QLearning::parts_of(const ReplayBatch& batch) const {
  return replay_parts(batch, micro_worlds(batch), config_.q_learning.burn_in, runner_.records(), device_);
}

LossTerms QLearning::loss_of_part(const ReplayPart& part, std::span<const Tensor> scalars) const {
  Scene scene = td_scene(net_, target_net_, part);
  scene.sigma = scalars[1];
  const bool has_shares = config_.replay.per_sequences;
  return td_loss(loss_of(scene), sample_valid(scene.batch), scene.online.now,
                 utilities_have_a_unit() ? scene.sigma : torch::ones({}, torch::kFloat64), scene.batch,
                 scalars,
                 {.is_joint = mixer_ != nullptr, .sequence_share = has_shares ? config_.replay.per_eta : 0});
}

int64_t QLearning::micro_worlds(const ReplayBatch& batch) const {
  const int64_t rows_of_world = (batch.steps() + 1) * batch.shape.env.num_agents,
                threads = runner_.pool().threads();
  const int64_t shared_out = (batch.world_count + threads - 1) / threads;
  return std::max<int64_t>(1, std::min(samples_of_part(config_, device_) / rows_of_world, shared_out));
}

QLearning::Totals QLearning::totals_of(const ReplayBatch& batch) {
  const Tensor valid = sample_valid(batch);
  const int64_t burn_in = batch.steps() > config_.q_learning.burn_in ? config_.q_learning.burn_in : 0;
  const Tensor all = ranks().gather(
      torch::tensor(
          std::vector{static_cast<double>(count_of(valid)), static_cast<double>(valid.numel()),
                      static_cast<double>(count_of(valid.narrow(0, burn_in, batch.steps() - burn_in))),
                      static_cast<double>(batch.rewards_read), static_cast<double>(batch.rewards_clipped),
                      batch.least_probability},
          torch::kFloat64)
          .unsqueeze(0),
      0);
  const Tensor sum = all.sum(0), least = all.amin(0);
  const double* sums = sum.data_ptr<double>();
  return {.valid = sums[0],
          .places = sums[1],
          .trained = std::max(1.0, sums[2]),
          .worlds = static_cast<double>(batch.world_count * ranks().count()),
          .rewards_read = sums[3],
          .rewards_clipped = sums[4],
          .least_probability = least.data_ptr<double>()[5]};
}

StepRequest QLearning::request_for(Input& input, const Totals& totals, const UpdateContext& context) {
  return {.optimizer = optimizer_,
          .input = input,
          .scalars = {totals.trained, q_sigma(), totals.worlds},
          .learning_rate = schedule_.learning_rate(),
          .keeps = true,
          .reads_kept = true,
          .reads_second_moment = true,
          .keep_going = context.keep_going};
}

void QLearning::place_schedules(double env_frames) {
  schedule_.before_batch(env_frames);
  const int64_t n_step = config_.q_learning.n_step.rounded_at(env_frames);
  if (n_step == n_step_) return;
  n_step_ = n_step;
  runner_.forget_recordings();  // it is how often a loop of theirs runs
}

bool QLearning::accumulate_gradient(ReplayBatch& batch, const UpdateContext& context, TermValues& terms) {
  place_schedules(context.env_frames);
  Input input(*this, parts_of(batch));
  const std::optional<StepOutcome> outcome =
      runner_.gradient_of(request_for(input, totals_of(batch), context));
  if (!outcome) return false;
  terms = outcome->terms;
  batch.abs_td = torch::tensor(outcome->kept, torch::kFloat32);
  return true;
}

Expected<UpdateStats> QLearning::update(ReplayBatch& batch, const UpdateContext& context) {
  UpdateStats stats;
  launched_.take_late(stats);
  launched_.begin_phase();
  place_schedules(context.env_frames);
  ++updates_;
  const Totals totals = totals_of(batch);
  stats.lag.valid_fraction = totals.valid / totals.places;
  if (totals.valid == 0) {
    COMRAD_TRY(runner_.skip_invalid_batch(0, stats));
    batch.abs_td = torch::zeros({batch.world_count});
    return stats;
  }
  if (config_.q_learning.normalize_q_values && !scale_.has_begun()) scale_.begin(reward_rms(batch, ranks()));
  if (batch.least_probability > totals.least_probability)  // see the factor f_k in the header
    batch.weight.mul_(std::pow(totals.least_probability / batch.least_probability, batch.weight_exponent));
  Input input(*this, parts_of(batch));
  LaunchedStep launched;
  {
    const device::StepScope nothing_waits;
    if (runner_.launch(request_for(input, totals, context), stats, launched) !=
        StepRunner::Result::kLaunched) {
      stats.abandoned = true;
      return stats;
    }
  }
  stats.rows_trained += batch.steps() * batch.rows();
  launched_.add(std::move(launched));
  const bool moves_scale = is_scale_due();
  COMRAD_TRY_ASSIGN(
      const std::optional<StepOutcome> outcome,
      complete_steps(context.reports || config_.replay.per || moves_scale || is_reset_due(), stats));
  if (outcome) batch.abs_td = torch::tensor(outcome->kept, torch::kFloat32);
  if (outcome && !outcome->was_taken) {
    batch.abs_td.zero_();
    return stats;
  }
  targets_.follow(version());
  if (is_reset_due()) reset();
  if (moves_scale) {
    const double before = q_sigma();
    rescale_outputs(before, scale_.move());
  }
  if (outcome && context.reports) report(*outcome, totals, stats);
  if (context.after_step) context.after_step();
  return stats;
}

bool QLearning::is_reset_due() const {
  const auto every = static_cast<PolicyVersion>(config_.q_learning.q_reset_every_updates);
  return every > 0 && version() % every == 0;
}

void QLearning::see(const StepOutcome& outcome) {
  if (outcome.was_taken && config_.q_learning.normalize_q_values)
    scale_.observe(outcome.terms["target_mean_square"]);
}

void QLearning::settle() {
  launched_.settle([this](const StepOutcome& outcome) { see(outcome); });
}

Expected<std::optional<StepOutcome>> QLearning::complete_steps(bool waits, UpdateStats& stats) {
  std::optional<StepOutcome> of_this_update;
  while (launched_.has_outcome(waits)) {
    LaunchedSteps::Outcome outcome = launched_.take_outcome(stats);
    COMRAD_TRY(runner_.status());
    see(outcome.step);
    if (outcome.is_of_this_phase) of_this_update = std::move(outcome.step);
  }
  return of_this_update;
}

void QLearning::reset() {
  torch::NoGradGuard no_grad;
  const RngKey key = key_of(config_, "reset").split(static_cast<uint64_t>(version()));
  const policy::ActorCritic fresh_net =
      policy::ActorCritic::create(net_.options(), key.split("network").bits(), device_);
  const std::unique_ptr<Mixer> fresh_mixer = mixer_of(config_, env_, net_, key.split("mixer").bits());
  const std::vector<Tensor> fresh = parameters_of(fresh_net, fresh_mixer.get());
  const auto named = net_.named_parameters();  // the mixer's lie behind them
  for (std::size_t i = 0; i < fresh.size(); ++i) {
    const bool is_last = i >= named.size() || std::string_view(part_of_parameter(named[i].first)) == "heads";
    const double share = is_last ? 1 : config_.q_learning.q_reset_fresh_share;
    parameters()[i].lerp_(fresh[i], share);
    target_parameters()[i].lerp_(fresh[i], share);
    if (is_last) optimizer_.clear_moments(i);
  }
  spdlog::info("optimizer step {}: last layers reset, {:.3g} of encoder and core replaced by fresh weights",
               version(), config_.q_learning.q_reset_fresh_share);
}

void QLearning::rescale_outputs(double before, double after) {
  if (before == after) return;
  torch::NoGradGuard no_grad;
  const double factor = before / after;
  const bool are_linear = utilities_have_a_unit();
  for (const policy::ActorCritic* net : {&net_, &target_net_})
    for (Tensor& parameter : are_linear ? heads_of(*net) : std::vector<Tensor>()) parameter.mul_(factor);
  for (Mixer* mixer : {mixer_.get(), target_mixer_.get()})
    if (mixer != nullptr) mixer->rescale(factor);
}

void QLearning::report(const StepOutcome& outcome, const Totals& totals, UpdateStats& stats) const {
  const auto put = [&stats](const char* name, double value) { stats.values.emplace_back(name, value); };
  put("train/lr", schedule_.learning_rate());
  put("train/loss", outcome.terms.loss());
  append_terms(outcome.terms, stats.values);
  put("train/q_sigma", q_sigma());
  if (config_.q_learning.td_lambda < 0) put("train/n_step", static_cast<double>(n_step_));
  if (const int64_t every = config_.q_learning.q_reset_every_updates; every > 0)
    put("train/q_resets", std::floor(static_cast<double>(version()) / static_cast<double>(every)));
  put("train/grad_norm", runner_.grad_norm());
  put("train/adam_max_second_moment", outcome.max_second_moment);
  put("train/valids_fraction", stats.lag.valid_fraction);
  put("train/num_sgd_steps", static_cast<double>(version()));
  put("train/num_updates", static_cast<double>(updates_));
  if (!mixer_) {
    put("train/dqn_num_updates", static_cast<double>(updates_));
    // The reference's names for decisions that do not count.
    put("train/policy_lag_valid_frac", stats.lag.valid_fraction);
    put("train/policy_lag_dropped", totals.places - totals.valid);
    put("train/policy_lag_total", totals.places);
  }
  if (totals.rewards_read > 0)
    put("train/rewards_clipped_fraction", totals.rewards_clipped / totals.rewards_read);
}

void QLearning::append_diagnostics(NamedNumbers& values) const {
  PartStatistics parts;
  parts.add(optimizer_, net_.named_parameters());
  if (mixer_) parts.add(optimizer_, mixer_->named_parameters(), "mixer");
  parts.append_to(values);
}

void QLearning::save(StateDict& state) const {
  Progress{version(), updates_}.save(state, config_.run.algo.name(), net_.options().global_state_count);
  for (const auto& [key, tensor] : net_.named_state()) state.put("network/" + key, tensor);
  for (const auto& [key, tensor] : target_net_.named_parameters()) state.put("target/" + key, tensor);
  if (mixer_) {
    for (const auto& [key, tensor] : mixer_->named_parameters()) state.put("mixer/" + key, tensor);
    for (const auto& [key, tensor] : target_mixer_->named_parameters())
      state.put("target_mixer/" + key, tensor);
  }
  optimizer_.save(state, "optimizer");
  schedule_.save(state);
  if (config_.q_learning.normalize_q_values) scale_.save(state);
}

Status QLearning::load(const StateDict& state) {
  COMRAD_TRY_ASSIGN(const Progress progress,
                    Progress::load(state, config_.run.algo.name(), net_.options().global_state_count));
  for (const auto& [key, tensor] : net_.named_state())
    COMRAD_TRY(state.copy_tensor("network/" + key, tensor));
  for (const auto& [key, tensor] : target_net_.named_parameters())
    COMRAD_TRY(state.copy_tensor("target/" + key, tensor));
  if (mixer_) {
    for (const auto& [key, tensor] : mixer_->named_parameters())
      COMRAD_TRY(state.copy_tensor("mixer/" + key, tensor));
    for (const auto& [key, tensor] : target_mixer_->named_parameters())
      COMRAD_TRY(state.copy_tensor("target_mixer/" + key, tensor));
  }
  net_.state_changed();
  COMRAD_TRY(optimizer_.load(state, "optimizer"));
  COMRAD_TRY(schedule_.load(state));
  launched_.forget();
  runner_.resume(progress.version);
  updates_ = progress.updates;
  scale_ = QScale();
  if (QScale::is_in(state)) {
    COMRAD_TRY_ASSIGN(scale_, QScale::load(state));
    if (!config_.q_learning.normalize_q_values) {  // these networks continue in natural units
      rescale_outputs(scale_.sigma(), 1);
      scale_ = QScale();
    }
  } else if (version() > 0) {
    scale_.begin_natural();
  }
  return {};
}

}  // namespace comrad::learn
