#include "learner/algorithms/q_learning.h"

#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <cmath>

#include "learner/algorithms/gradient_sum.h"
#include "learner/algorithms/part_statistics.h"
#include "learner/algorithms/progress.h"
#include "learner/estimators/td_targets.h"
#include "policy_workers/policy/torch_ops.h"
#include "policy_workers/policy/utilities.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::learn {
namespace {

uint64_t seed_of(const RunConfig& config, const char* purpose) {
  return RngKey(static_cast<uint64_t>(config.run.seed)).split(purpose).bits();
}

/// A fresh mixer; equal ones for online and target, since both come from one seed. Null for idqn.
std::unique_ptr<Mixer> mixer_of(const RunConfig& config, const EnvShape& env, const policy::PolicyNet& net) {
  if (!config.run.algo->mixes_q_values()) return nullptr;
  return make_mixer(MixerOptions::from(config, env, net.encoded_count(), net.options().global_state_count),
                    seed_of(config, "mixer"), net.device());
}

std::vector<Tensor> parameters_of(const policy::PolicyNet& net, const Mixer* mixer) {
  std::vector<Tensor> parameters = net.parameters();
  if (mixer == nullptr) return parameters;
  for (const auto& [name, tensor] : mixer->named_parameters()) parameters.push_back(tensor);
  return parameters;
}

/// Weights and biases of the layers that give Q-values, one pair per tower.
std::vector<Tensor> heads_of(const policy::PolicyNet& net) {
  std::vector<Tensor> heads;
  for (const auto& [parameter, tensor] : net.named_parameters())
    if (parameter.ends_with("action_head.weight") || parameter.ends_with("action_head.bias"))
      heads.push_back(tensor);
  return heads;
}

/// Root mean square of the rewards of a batch's valid samples, agent by agent.
double reward_rms(const ReplayBatch& batch) {
  const Tensor valid = batch.valid.to(torch::kFloat64);
  const Tensor square = batch.reward.to(torch::kFloat64).square();
  return std::sqrt((square * valid).sum().item<double>() / std::max(1.0, valid.sum().item<double>()));
}

/// Encoder features [count, R, E] of the observations from step `first` on.
Tensor encode(const policy::PolicyNet& net, const ReplayBatch& batch, int64_t first, int64_t count) {
  const auto rows_of = [&](const Tensor& field) {
    return field.defined() ? field.narrow(0, first, count).flatten(0, 1) : field;
  };
  return net.encode(rows_of(batch.frame), rows_of(batch.measurement)).view({count, batch.rows(), -1});
}

/// `rows` [T, R, ...] of the observations behind the steps, with those of cuts put in: value f of `finals`
/// goes to (step[f], row[f]).
Tensor with_finals(Tensor rows, const Tensor& step, const Tensor& row, const Tensor& finals) {
  if (step.numel() == 0) return rows;
  rows = rows.clone();
  rows.index_put_({step, row}, finals);
  return rows;
}

}  // namespace

double epsilon_at(const RunConfig& config, double env_frames) {
  const double way = std::clamp(env_frames / config.q_learning.epsilon_decay_env_frames, 0.0, 1.0);
  return config.q_learning.epsilon_start +
         way * (config.q_learning.epsilon_end - config.q_learning.epsilon_start);
}

void QLearning::LossSums::add(const LossSums& part) {
  loss += part.loss, regularizer += part.regularizer, td += part.td;
  predicted += part.predicted, target += part.target, utility += part.utility, spread += part.spread;
  terminated += part.terminated, truncated += part.truncated, head_entropy += part.head_entropy;
  target_square += part.target_square, unclamped += part.unclamped, clipped += part.clipped;
  predicted_max = std::max(predicted_max, part.predicted_max);
  predicted_min = std::min(predicted_min, part.predicted_min);
  target_max = std::max(target_max, part.target_max);
  utility_max = std::max(utility_max, part.utility_max);
  utility_min = std::min(utility_min, part.utility_min);
}

QLearning::QLearning(const RunConfig& config, const EnvShape& env, torch::Device device)
    : config_(config),
      env_(env),
      device_(device),
      net_(policy::PolicyNet::create(policy::PolicyNetOptions::from(config, env), seed_of(config, "network"),
                                     device)),
      target_net_(net_.twin()),
      mixer_(mixer_of(config, env, net_)),
      target_mixer_(mixer_of(config, env, net_)),
      optimizer_(parameters_of(net_, mixer_.get()), AdamSettings::from(config)),
      target_parameters_(parameters_of(target_net_, target_mixer_.get())),
      schedule_(config),
      pool_(threads_for_parts(config, device)) {}

int64_t QLearning::parameter_count() const {
  int64_t count = 0;
  for (const Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

void QLearning::observe(const Tensor& frame, const Tensor& measurement, const Tensor& global_state) {
  torch::NoGradGuard no_grad;
  if (net_.options().global_state_count > 0 && global_state.defined())
    net_.update_state_statistics(global_state.to(device_));
  if (!config_.network.normalize_input || !frame.defined()) return;
  net_.update_input_statistics(frame.to(device_),
                               measurement.defined() ? measurement.to(device_) : measurement);
}

Tensor QLearning::Scene::mask() const {
  return batch.has_action_mask ? batch.action_mask.narrow(0, 0, batch.steps()) : Tensor();
}

Tensor QLearning::next_action(const Scene& scene) const {
  return policy::greedy_action(config_.q_learning.double_dqn ? scene.online.next : scene.target.next,
                               scene.next_mask, env_);
}

Tensor QLearning::loss_of_error(const Tensor& error) const {
  return config_.q_learning.use_huber_loss ? huber(error) : error.square();
}

QLearning::QValues QLearning::q_values(const policy::PolicyNet& net, const ReplayBatch& batch,
                                       bool has_gradient) const {
  const int64_t steps = batch.steps();
  const bool has_core = net.options().use_rnn;
  // A target without a recurrent core has no use for what was decided on.
  const int64_t first = has_gradient || has_core ? 0 : 1;
  Tensor encoded;
  {
    torch::NoGradGuard no_grad;  // nothing bootstraps with gradient
    encoded = has_gradient ? encode(net, batch, steps, 1) : encode(net, batch, first, steps + 1 - first);
  }
  if (has_gradient) encoded = at::cat({encode(net, batch, 0, steps), encoded});
  const Tensor reset = batch.reset.narrow(0, first, steps + 1 - first);
  const Tensor q = net.logits_of(encoded, batch.recurrent_state, reset);

  QValues values;
  if (first == 0) {
    values.now = q.narrow(0, 0, steps);
    values.state = encoded.detach().narrow(0, 0, steps);
  }
  torch::NoGradGuard no_grad;
  values.next = q.detach().narrow(0, 1 - first, steps);
  values.next_state = encoded.detach().narrow(0, 1 - first, steps);
  const int64_t final_count = static_cast<int64_t>(batch.final_row.size());
  if (final_count == 0) return values;

  // The cut episodes once more, each as a column of its own that goes on to its true last observation.
  const Tensor row = torch::tensor(batch.final_row, torch::kInt64).to(device_);
  const Tensor step = torch::tensor(batch.final_step, torch::kInt64).to(device_);
  const Tensor column = torch::arange(final_count, row.options());
  const Tensor final_encoded = net.encode(batch.final_frame, batch.final_measurement);
  Tensor columns = encoded.detach().index_select(1, row);
  columns.index_put_({step + 1, column}, final_encoded);
  Tensor column_reset = reset.index_select(1, row);
  column_reset.index_put_({step + 1, column}, torch::zeros({}, column_reset.options()));
  const Tensor final_q = net.logits_of(columns, batch.recurrent_state.index_select(0, row), column_reset)
                             .index({step + 1, column});
  values.next = with_finals(values.next, step, row, final_q);
  values.next_state = with_finals(values.next_state, step, row, final_encoded);
  return values;
}

QLearning::Scene QLearning::scene_of(const ReplayBatch& micro) const {
  Scene scene;
  scene.batch = micro;
  for (Tensor* field :
       {&scene.batch.frame, &scene.batch.measurement, &scene.batch.action_mask, &scene.batch.agent_active,
        &scene.batch.action, &scene.batch.reward, &scene.batch.bootstrap, &scene.batch.terminated,
        &scene.batch.truncated, &scene.batch.valid, &scene.batch.reset, &scene.batch.recurrent_state,
        &scene.batch.weight, &scene.batch.final_frame, &scene.batch.final_measurement,
        &scene.batch.global_state, &scene.batch.final_global_state})
    if (field->defined()) *field = field->to(device_);
  ReplayBatch& batch = scene.batch;
  if (config_.q_learning.burn_in > 0 && batch.steps() > config_.q_learning.burn_in) {
    // Each network warms up a state of its own; what follows is a shorter batch.
    const auto warmed = [&](const policy::PolicyNet& net) {
      torch::NoGradGuard no_grad;
      const int64_t count = config_.q_learning.burn_in;
      return steps_from(batch, count,
                        net.state_after(encode(net, batch, 0, count), batch.recurrent_state,
                                        batch.reset.narrow(0, 0, count)));
    };
    const ReplayBatch for_target = warmed(target_net_);
    batch = warmed(net_);
    scene.online = q_values(net_, batch, true);
    torch::NoGradGuard no_grad;
    scene.target = q_values(target_net_, for_target, false);
  } else {
    scene.online = q_values(net_, batch, true);
    torch::NoGradGuard no_grad;
    scene.target = q_values(target_net_, batch, false);
  }
  const int64_t steps = batch.steps();
  const Tensor row = torch::tensor(batch.final_row, torch::kInt64).to(device_);
  const Tensor step = torch::tensor(batch.final_step, torch::kInt64).to(device_);
  // The last observation of a cut episode has the masks of the decision before it.
  const auto behind = [&](const Tensor& field) {
    return with_finals(field.narrow(0, 1, steps), step, row, field.index({step, row}));
  };
  if (batch.has_action_mask) scene.next_mask = behind(batch.action_mask);
  scene.next_active = behind(batch.agent_active);
  if (net_.options().global_state_count > 0) {
    const Tensor normalized = net_.normalized_state(batch.global_state);
    scene.state = normalized.narrow(0, 0, steps);
    scene.next_state = normalized.narrow(0, 1, steps);
    if (!batch.final_row.empty()) {
      const int64_t agents = batch.shape.env.num_agents;
      const Tensor first = torch::arange(0, row.numel(), agents, row.options());
      const Tensor world = row.index_select(0, first).div(agents, "floor");
      scene.next_state = with_finals(scene.next_state, step.index_select(0, first), world,
                                     net_.normalized_state(batch.final_global_state));
    }
  }
  return scene;
}

QLearning::Part QLearning::part_of(const ReplayBatch& micro, double valid_count) const {
  Part part;
  const Scene scene = scene_of(micro);
  const SampleLoss sample = loss_of(scene);
  const Tensor valid = sample_valid(scene.batch).to(torch::kFloat32);
  const Tensor share = valid / valid_count;
  const int64_t samples_of_world = valid.size(1) / micro.world_count;
  const Tensor importance = scene.batch.weight.repeat_interleave(samples_of_world).unsqueeze(0);
  Tensor loss = (sample.loss * share * importance).sum();
  Tensor regularizer = torch::zeros({}, share.options());
  if (sample.regularizer.defined()) regularizer = (sample.regularizer * share).sum();
  part.gradients = torch::autograd::grad({loss + regularizer}, parameters(), /*grad_outputs=*/{},
                                         /*retain_graph=*/c10::nullopt, /*create_graph=*/false,
                                         /*allow_unused=*/true);

  torch::NoGradGuard no_grad;
  const Tensor is_valid = valid.to(torch::kBool);
  const auto largest = [&](const Tensor& of_samples) {
    return torch::where(is_valid, of_samples, torch::full({}, -1e30f, valid.options())).max();
  };
  const Tensor unclamped = sample.unclamped.defined() ? sample.unclamped : sample.target;
  const Tensor utility = policy::chosen_utility(scene.online.now, scene.batch.action, env_).detach();
  const Tensor taken = scene.batch.valid.to(torch::kBool);
  const Tensor spread = scene.online.now.detach().std(-1, /*unbiased=*/false).mean();
  const Tensor of_row = scene.batch.valid.to(torch::kFloat32) / std::max(1.0, valid_count) *
                        (static_cast<double>(valid.size(1)) / static_cast<double>(micro.rows()));
  const std::vector<std::pair<double*, Tensor>> numbers = {
      {&part.sums.loss, loss.detach()},
      {&part.sums.regularizer, regularizer.detach()},
      {&part.sums.td, (sample.error * share).sum()},
      {&part.sums.predicted, (sample.predicted * share).sum()},
      {&part.sums.predicted_max, largest(sample.predicted)},
      {&part.sums.predicted_min, -largest(-sample.predicted)},
      {&part.sums.target, (sample.target * share).sum()},
      {&part.sums.target_max, largest(sample.target)},
      {&part.sums.utility, (utility * of_row).sum()},
      {&part.sums.utility_max, torch::where(taken, utility, torch::full({}, -1e30f, valid.options())).max()},
      {&part.sums.utility_min, torch::where(taken, utility, torch::full({}, 1e30f, valid.options())).min()},
      {&part.sums.spread, spread * micro.world_count},
      {&part.sums.terminated, (scene.batch.terminated.to(torch::kFloat32) * of_row).sum()},
      {&part.sums.truncated, (scene.batch.truncated.to(torch::kFloat32) * of_row).sum()},
      {&part.sums.head_entropy, sample.head_entropy.defined() ? (sample.head_entropy * share).sum()
                                                              : torch::zeros({}, share.options())},
      {&part.sums.target_square, (sample.target.square() * share).sum()},
      {&part.sums.unclamped, (unclamped * share).sum()},
      {&part.sums.clipped, (sample.target.ne(unclamped) * share).sum()}};
  std::vector<Tensor> read;
  for (const auto& [place, number] : numbers) read.push_back(number);
  const Tensor on_host = torch::stack(read).cpu();
  for (std::size_t i = 0; i < numbers.size(); ++i) *numbers[i].first = double{on_host.data_ptr<float>()[i]};
  const Tensor counted = valid.view({valid.size(0), micro.world_count, samples_of_world});
  const Tensor errors = sample.error.view_as(counted) * counted / q_sigma();
  part.abs_td = errors.sum(2).sum(0) / counted.sum(2).sum(0).clamp_min(1.0);
  if (config_.replay.per_sequences && valid.size(0) > 1)
    part.abs_td = config_.replay.per_eta * errors.amax({0, 2}) + (1 - config_.replay.per_eta) * part.abs_td;
  part.abs_td = part.abs_td.cpu();
  return part;
}

int64_t QLearning::micro_worlds(const ReplayBatch& batch) const {
  const int64_t rows_of_world = (batch.steps() + 1) * batch.shape.env.num_agents, threads = pool_.threads();
  const int64_t shared_out = (batch.world_count + threads - 1) / threads;
  return std::max<int64_t>(1, std::min(config_.optimisation.micro_batch_size / rows_of_world, shared_out));
}

bool QLearning::accumulate_gradient(ReplayBatch& batch, const UpdateContext& context, LossSums& sums) {
  Tensor valid = sample_valid(batch);
  if (config_.q_learning.burn_in > 0 && batch.steps() > config_.q_learning.burn_in)
    valid = valid.narrow(0, config_.q_learning.burn_in, batch.steps() - config_.q_learning.burn_in);
  const double valid_count = std::max(1.0, valid.sum(torch::kFloat64).item<double>());
  const int64_t worlds = micro_worlds(batch), count = (batch.world_count + worlds - 1) / worlds;
  std::vector<Tensor> abs_td;
  const bool is_done = sum_gradients<Part>(
      pool_, parameters(), count,
      [&](int64_t i) {
        const int64_t begin = i * worlds;
        return part_of(narrow_worlds(batch, begin, std::min(worlds, batch.world_count - begin)), valid_count);
      },
      [&](const Part& part) {
        sums.add(part.sums);
        abs_td.push_back(part.abs_td);
      },
      context.keep_going);
  if (!is_done) return false;
  sums.spread /= static_cast<double>(batch.world_count);
  batch.abs_td = at::cat(abs_td);
  return true;
}

Expected<UpdateStats> QLearning::update(ReplayBatch& batch, const UpdateContext& context) {
  UpdateStats stats;
  schedule_.before_batch(context.env_frames);
  ++updates_;
  const Tensor valid = sample_valid(batch);
  const double valid_count = valid.sum(torch::kFloat64).item<double>();
  stats.lag.valid_fraction = valid_count / static_cast<double>(valid.numel());
  if (valid_count == 0) {
    COMRAD_TRY(guard_.skip_invalid_batch(0, stats));
    batch.abs_td = torch::zeros({batch.world_count});
    return stats;
  }
  if (config_.q_learning.normalize_q_values && !scale_.has_begun()) scale_.begin(reward_rms(batch));
  optimizer_.zero_grad();
  LossSums sums;
  if (!accumulate_gradient(batch, context, sums)) {
    stats.abandoned = true;
    return stats;
  }
  stats.rows_trained += batch.steps() * batch.rows();
  if (!guard_.step(optimizer_, sums.loss + sums.regularizer, schedule_.learning_rate(), version_, stats)) {
    COMRAD_TRY(guard_.status());
    batch.abs_td.zero_();
    return stats;
  }
  update_targets();
  report(sums, stats);
  if (!mixer_) {  // the reference's names for decisions that do not count
    const double total = static_cast<double>(valid.numel());
    stats.values.emplace_back("train/policy_lag_valid_frac", stats.lag.valid_fraction);
    stats.values.emplace_back("train/policy_lag_dropped", total - valid_count);
    stats.values.emplace_back("train/policy_lag_total", total);
  }
  if (batch.rewards_read > 0)
    stats.values.emplace_back("train/rewards_clipped_fraction", static_cast<double>(batch.rewards_clipped) /
                                                                    static_cast<double>(batch.rewards_read));
  if (config_.q_learning.normalize_q_values) {
    const double before = q_sigma();
    rescale_outputs(before, scale_.observe(sums.target_square));
  }
  if (context.after_step) context.after_step();
  return stats;
}

void QLearning::update_targets() {
  torch::NoGradGuard no_grad;
  const bool copies = config_.q_learning.target_update_tau == 1;
  if (copies && version_ % static_cast<PolicyVersion>(config_.q_learning.target_update_interval) != 0) return;
  for (std::size_t i = 0; i < target_parameters_.size(); ++i) {
    if (copies)
      target_parameters_[i].copy_(parameters()[i]);
    else
      target_parameters_[i].lerp_(parameters()[i], config_.q_learning.target_update_tau);
  }
}

void QLearning::rescale_outputs(double before, double after) {
  if (before == after) return;
  torch::NoGradGuard no_grad;
  const double factor = before / after;
  const bool are_linear = !mixer_ || mixer_->scales_with_utilities();
  for (const policy::PolicyNet* net : {&net_, &target_net_})
    for (Tensor& parameter : are_linear ? heads_of(*net) : std::vector<Tensor>()) parameter.mul_(factor);
  for (Mixer* mixer : {mixer_.get(), target_mixer_.get()})
    if (mixer != nullptr) mixer->rescale(factor);
}

void QLearning::report(const LossSums& sums, UpdateStats& stats) const {
  const auto put = [&stats](const char* name, double value) { stats.values.emplace_back(name, value); };
  put("train/lr", schedule_.learning_rate());
  put("train/loss", sums.loss + sums.regularizer);
  put(mixer_ ? "train/q_tot_mean" : "train/dqn_q_mean", sums.predicted);
  put(mixer_ ? "train/q_tot_max" : "train/dqn_q_max", sums.predicted_max);
  if (!mixer_) put("train/dqn_q_min", sums.predicted_min);
  put(mixer_ ? "train/target_q_tot_mean" : "train/dqn_target_q_mean", sums.target);
  put("train/target_q_max", sums.target_max);
  put(mixer_ ? "train/td_error_mean" : "train/dqn_td_error_mean", sums.td);
  // QMIX's utilities have no unit of their own: the mixer gives them one.
  const double unit = !mixer_ || mixer_->scales_with_utilities() ? q_sigma() : 1;
  put("train/agent_qs_mean", sums.utility * unit);
  put("train/agent_qs_max", sums.utility_max * unit);
  put("train/agent_qs_min", sums.utility_min * unit);
  put("train/q_std_across_actions", sums.spread * unit);
  put("train/q_sigma", q_sigma());
  if (mixer_) put("train/target_before_clamp", sums.unclamped);
  if (mixer_) put("train/targets_clipped_fraction", sums.clipped);
  put("train/done_ratio", sums.terminated);
  put("train/timeout_ratio", sums.truncated);
  if (config_.run.algo->mixer == MixerKind::kQplexAttention) {
    put("train/attend_mag_regs", sums.regularizer);
    put("train/head_entropy_mean", sums.head_entropy);
  }
  put("train/grad_norm", guard_.grad_norm());
  put("train/adam_max_second_moment", optimizer_.max_second_moment());
  put("train/valids_fraction", stats.lag.valid_fraction);
  put("train/num_sgd_steps", static_cast<double>(version_));
  put("train/num_updates", static_cast<double>(updates_));
  if (!mixer_) put("train/dqn_num_updates", static_cast<double>(updates_));
}

void QLearning::append_diagnostics(NamedNumbers& values) const {
  PartStatistics parts;
  parts.add(optimizer_, net_.named_parameters());
  if (mixer_) parts.add(optimizer_, mixer_->named_parameters(), "mixer");
  parts.append_to(values);
}

void QLearning::save(StateDict& state) const {
  Progress{version_, updates_}.save(state, config_.run.algo.name(), net_.options().global_state_count);
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
  version_ = progress.version;
  updates_ = progress.updates;
  scale_ = QScale();
  if (QScale::is_in(state)) {
    COMRAD_TRY_ASSIGN(scale_, QScale::load(state));
    if (!config_.q_learning.normalize_q_values) {  // these networks go on in natural units
      rescale_outputs(scale_.sigma(), 1);
      scale_ = QScale();
    }
  } else if (version_ > 0) {
    scale_.begin_natural();
  }
  return {};
}

}  // namespace comrad::learn
