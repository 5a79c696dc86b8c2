#include "policy_workers/network/tower.h"

#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {

SequenceInput SequenceInput::of_agent(int64_t agent, int64_t agents) const {
  return {.frame = rows_of_agent(frame, 1, agent, agents),
          .measurement = rows_of_agent(measurement, 1, agent, agents),
          .recurrent_state = rows_of_agent(recurrent_state, 0, agent, agents),
          .reset = rows_of_agent(reset, 1, agent, agents)};
}

Tensor rows_of_agent(const Tensor& rows, int64_t axis, int64_t agent, int64_t agents) {
  return rows.defined() ? rows.slice(axis, agent, c10::nullopt, agents) : rows;
}

Tensor interleave(const std::vector<Tensor>& of_agents, int64_t axis) {
  return of_agents.size() == 1 ? of_agents.front()
                               : torch::stack(of_agents, axis + 1).flatten(axis, axis + 1);
}

Tower::Tower(const NetworkOptions& options, bool with_core, int64_t extra_inputs,
             std::shared_ptr<const ObservationNormalizer> normalizer, const LayerMaker& make)
    : encoder_(make_encoder({.env = options.env,
                             .encoder = options.encoder,
                             .layer_norm = options.layer_norm,
                             .normalizer = std::move(normalizer)},
                            make)),
      core_(make_core(options.core(encoder_->feature_count() + extra_inputs, with_core), make)),
      core_norm_(options.layer_norm && core_->state_count() > 0
                     ? std::optional(make.norm("core_norm", {core_->feature_count()}))
                     : std::nullopt),
      decoder_(core_->feature_count(), options.decoder_widths, options.layer_norm, make) {}

Tensor Tower::normalised(const Tensor& features) const {
  return core_norm_ ? layer_norm(features, core_norm_->weight, core_norm_->bias) : features;
}

CoreOutput Tower::step(const Tensor& encoded, const Tensor& state) const {
  CoreOutput after = core_->step(encoded, state);
  return {decoder_(normalised(after.features)), after.state};
}

Tensor Tower::sequence(const Tensor& encoded, const Tensor& state, const Tensor& reset, int64_t steps) const {
  if (state_count() == 0) return decoder_(encoded);
  const Tensor x = encoded.view({steps, encoded.size(0) / steps, encoded.size(1)});
  return decoder_(normalised(unrolled(x, state, reset).features.flatten(0, 1)));
}

Tensor Tower::sequence(const SequenceInput& input, int64_t first_state,
                       const std::function<Tensor(const Tensor&)>& extend) const {
  Tensor encoded =
      encoder_->forward(input.frame.flatten(0, 1),
                        input.measurement.defined() ? input.measurement.flatten(0, 1) : input.measurement);
  if (extend) encoded = extend(encoded);
  const Tensor state =
      state_count() > 0 ? input.recurrent_state.slice(1, first_state, first_state + state_count()) : Tensor();
  return sequence(encoded, state, input.reset, input.frame.size(0));
}

CoreOutput Tower::unrolled(const Tensor& encoded, const Tensor& state, const Tensor& reset) const {
  Tensor keep;
  if (reset.defined()) keep = reset.eq(0).to(torch::kFloat32).unsqueeze(-1);
  return core_->sequence(encoded, state, keep);
}

NamedTensors Tower::named_parameters(const std::string& prefix) const {
  NamedTensors named;
  append(named, prefix, encoder_->named_parameters());
  append(named, prefix, core_->named_parameters());
  if (core_norm_) append(named, prefix, *core_norm_);
  append(named, prefix, decoder_.named_parameters());
  return named;
}

}  // namespace comrad::policy
