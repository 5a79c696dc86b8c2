#include "learner/critics/td_scene.h"

#include <algorithm>
#include <bit>

#include "policy_workers/device/queue.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace {

/// Encoder features [count, R, E] of the observations from step `first` on.
Tensor encode(const policy::ActorCritic& net, const ReplayBatch& batch, int64_t first, int64_t count) {
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

/// Repeats a batch's last cut until there are 1, 2, 4, 8 ... of them, so that few recordings fit all batches. What is put
/// twice at a place is the same.
void round_up_cuts(ReplayBatch& batch) {
  const int64_t agents = batch.shape.env.num_agents;
  const auto cuts = static_cast<uint64_t>(batch.final_row.size()) / static_cast<uint64_t>(agents);
  if (std::has_single_bit(cuts) || cuts == 0) return;
  Tensor kept = torch::arange(static_cast<int64_t>(std::bit_ceil(cuts)), torch::kInt64);
  kept.clamp_max_(static_cast<int64_t>(cuts) - 1);
  const Tensor rows = (kept.unsqueeze(1) * agents + torch::arange(agents, torch::kInt64)).flatten();
  for (Tensor* field : {&batch.final_frame, &batch.final_measurement})
    if (field->defined()) *field = field->index_select(0, rows.to(field->device()));
  if (batch.final_global_state.defined())
    batch.final_global_state =
        batch.final_global_state.index_select(0, kept.to(batch.final_global_state.device()));
  for (std::vector<int64_t>* places : {&batch.final_step, &batch.final_row}) {
    std::vector<int64_t> more;
    for (int64_t i = 0; i < rows.numel(); ++i)
      more.push_back((*places)[static_cast<std::size_t>(rows.data_ptr<int64_t>()[i])]);
    *places = std::move(more);
  }
}

QValues q_values(const policy::ActorCritic& net, const ReplayPart& part, const Tensor& recurrent_state,
                 bool has_gradient) {
  const ReplayBatch& batch = part.batch;
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
  const Tensor q = net.logits_of(encoded, recurrent_state, reset);

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

  // The cut episodes once more, each as its own column that continues to its true last observation.
  const Tensor &row = part.final_row, &step = part.final_step;
  const Tensor column = torch::arange(final_count, row.options());
  const Tensor final_encoded = net.encode(batch.final_frame, batch.final_measurement);
  Tensor columns = encoded.detach().index_select(1, row);
  columns.index_put_({step + 1, column}, final_encoded);
  Tensor column_reset = reset.index_select(1, row);
  column_reset.index_put_({step + 1, column}, torch::zeros({}, column_reset.options()));
  const Tensor final_q =
      net.logits_of(columns, recurrent_state.index_select(0, row), column_reset).index({step + 1, column});
  values.next = with_finals(values.next, step, row, final_q);
  values.next_state = with_finals(values.next_state, step, row, final_encoded);
  return values;
}

}  // namespace

void ReplayPart::visit(const std::function<void(Tensor&)>& visit) {
  for (Tensor* field : {&batch.frame,
                        &batch.measurement,
                        &batch.action_mask,
                        &batch.agent_active,
                        &batch.action,
                        &batch.reward,
                        &batch.bootstrap,
                        &batch.terminated,
                        &batch.truncated,
                        &batch.valid,
                        &batch.reset,
                        &batch.recurrent_state,
                        &batch.weight,
                        &batch.final_frame,
                        &batch.final_measurement,
                        &batch.global_state,
                        &batch.final_global_state,
                        &final_row,
                        &final_step,
                        &before.frame,
                        &before.measurement,
                        &before.reset})
    if (field->defined()) visit(*field);
}

std::vector<ReplayPart> replay_parts(const ReplayBatch& batch, int64_t worlds, int64_t burn_in,
                                     bool rounds_cuts, torch::Device device) {
  std::vector<ReplayPart> parts;
  for (int64_t begin = 0; begin < batch.world_count; begin += worlds) {
    ReplayPart& part = parts.emplace_back();
    part.batch = narrow_worlds(batch, begin, std::min(worlds, batch.world_count - begin));
    if (const int64_t count = burn_in; count > 0 && batch.steps() > count) {
      part.before.shape = part.batch.shape;
      part.before.world_count = part.batch.world_count;
      part.before.frame = part.batch.frame.narrow(0, 0, count);
      if (part.batch.measurement.defined())
        part.before.measurement = part.batch.measurement.narrow(0, 0, count);
      part.before.reset = part.batch.reset.narrow(0, 0, count);
      part.batch = steps_from(part.batch, count, part.batch.recurrent_state);
    }
    if (rounds_cuts) round_up_cuts(part.batch);
    part.final_row = torch::tensor(part.batch.final_row, torch::kInt64);
    part.final_step = torch::tensor(part.batch.final_step, torch::kInt64);
    std::vector<Tensor*> fields;
    part.visit([&](Tensor& field) { fields.push_back(&field); });
    device::move_together(fields, device);
  }
  return parts;
}

Tensor TdScene::mask() const {
  return batch.has_action_mask ? batch.action_mask.narrow(0, 0, batch.steps()) : Tensor();
}

TdScene td_scene(const policy::ActorCritic& online, const policy::ActorCritic& target,
                 const ReplayPart& part) {
  TdScene scene;
  scene.batch = part.batch;
  const ReplayBatch& batch = scene.batch;
  // With a burn-in each network warms up its own state.
  const auto state_of = [&](const policy::ActorCritic& net) {
    if (!part.before.frame.defined()) return batch.recurrent_state;
    torch::NoGradGuard no_grad;
    return net.state_after(encode(net, part.before, 0, part.before.frame.size(0)), batch.recurrent_state,
                           part.before.reset);
  };
  scene.online = q_values(online, part, state_of(online), true);
  {
    torch::NoGradGuard no_grad;
    scene.target = q_values(target, part, state_of(target), false);
  }
  const int64_t steps = batch.steps();
  const Tensor &row = part.final_row, &step = part.final_step;
  // The last observation of a cut episode has the masks of the decision before it.
  const auto behind = [&](const Tensor& field) {
    return with_finals(field.narrow(0, 1, steps), step, row, field.index({step, row}));
  };
  if (batch.has_action_mask) scene.next_mask = behind(batch.action_mask);
  scene.next_active = behind(batch.agent_active);
  if (online.options().global_state_count > 0) {
    const Tensor normalized = online.normalized_state(batch.global_state);
    scene.state = normalized.narrow(0, 0, steps);
    scene.next_state = normalized.narrow(0, 1, steps);
    if (!batch.final_row.empty()) {
      const int64_t agents = batch.shape.env.num_agents;
      const Tensor first = torch::arange(0, row.numel(), agents, row.options());
      const Tensor world = row.index_select(0, first).div(agents, "floor");
      scene.next_state = with_finals(scene.next_state, step.index_select(0, first), world,
                                     online.normalized_state(batch.final_global_state));
    }
  }
  return scene;
}

}  // namespace comrad::learn
