#include "learner/algorithms/adam_optimizer.h"

#include <torch/optim/adam.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <type_traits>

namespace comrad::learn {
namespace {

/// libtorch keys its per-parameter state by text before 2.1 and by pointer since.
template <typename Map>
typename Map::key_type state_key(const Map&, const torch::Tensor& parameter) {
  if constexpr (std::is_same_v<typename Map::key_type, std::string>) {
    std::ostringstream text;
    text << parameter.unsafeGetTensorImpl();
    return text.str();
  } else {
    return parameter.unsafeGetTensorImpl();
  }
}

std::string entry_prefix(const std::string& section, const std::string& prefix, std::size_t index) {
  char number[16];
  std::snprintf(number, sizeof(number), "%03zu", index);
  return section + "/" + prefix + number;
}

/// The values of tensors with one number each, which leave the device at once: each wait for it would stop a GPU's queue.
std::vector<double> read_together(const std::vector<torch::Tensor>& numbers) {
  if (numbers.empty()) return {};
  const torch::Tensor read = torch::stack(numbers).cpu().to(torch::kFloat64);
  return {read.data_ptr<double>(), read.data_ptr<double>() + read.numel()};
}

}  // namespace

AdamSettings AdamSettings::from(const RunConfig& config) {
  return {.beta1 = config.optimisation.adam_beta1,
          .beta2 = config.optimisation.adam_beta2,
          .epsilon = config.optimisation.adam_eps,
          .max_grad_norm = config.optimisation.max_grad_norm};
}

struct AdamOptimizer::State {
  std::vector<torch::Tensor> parameters;
  AdamSettings settings;
  torch::optim::Adam adam;
  std::vector<double> gradient_norms;  // of the last clip_gradients()

  /// The moments of a parameter, or null before its first step.
  torch::optim::AdamParamState* moments(const torch::Tensor& parameter) {
    auto& map = adam.state();
    const auto found = map.find(state_key(map, parameter));
    return found == map.end() ? nullptr : static_cast<torch::optim::AdamParamState*>(found->second.get());
  }
};

AdamOptimizer::AdamOptimizer(std::vector<torch::Tensor> parameters, const AdamSettings& settings)
    : state_(new State{
          parameters, settings,
          torch::optim::Adam(
              parameters,
              torch::optim::AdamOptions(1e-4).betas({settings.beta1, settings.beta2}).eps(settings.epsilon)),
          std::vector<double>(parameters.size(), 0.0)}) {}
AdamOptimizer::~AdamOptimizer() = default;
AdamOptimizer::AdamOptimizer(AdamOptimizer&&) noexcept = default;
AdamOptimizer& AdamOptimizer::operator=(AdamOptimizer&&) noexcept = default;

const std::vector<torch::Tensor>& AdamOptimizer::parameters() const { return state_->parameters; }

void AdamOptimizer::zero_grad() {
  // Zeroed in place rather than dropped: the buffers of 13 MB are reused by every backward pass.
  for (torch::Tensor& parameter : state_->parameters) {
    torch::Tensor& gradient = parameter.mutable_grad();
    if (gradient.defined()) gradient.detach_().zero_();
  }
}

double AdamOptimizer::clip_gradients() {
  torch::NoGradGuard no_grad;
  std::vector<torch::Tensor> norms;
  for (const torch::Tensor& parameter : state_->parameters)
    norms.push_back(parameter.grad().defined() ? parameter.grad().norm()
                                               : torch::zeros({}, parameter.options()));
  state_->gradient_norms = read_together(norms);
  double squares = 0;
  for (const double each : state_->gradient_norms) squares += each * each;
  const double norm = std::sqrt(squares), limit = state_->settings.max_grad_norm;
  if (!std::isfinite(norm) || !(limit > 0)) return norm;
  const double factor = limit / (norm + 1e-6);
  if (factor < 1.0)
    for (const torch::Tensor& parameter : state_->parameters)
      if (parameter.grad().defined()) parameter.grad().mul_(factor);
  return norm;
}

void AdamOptimizer::step(double learning_rate) {
  for (auto& group : state_->adam.param_groups()) group.options().set_lr(learning_rate);
  state_->adam.step();
}

bool AdamOptimizer::has_stepped(std::size_t index) const {
  return state_->moments(state_->parameters[index]) != nullptr;
}

double AdamOptimizer::gradient_norm(std::size_t index) const { return state_->gradient_norms[index]; }

double AdamOptimizer::step_multiplier(std::size_t index) const {
  torch::NoGradGuard no_grad;
  const auto* moments = state_->moments(state_->parameters[index]);
  if (moments == nullptr) return 0;
  const AdamSettings& settings = state_->settings;
  const double correction = 1 - std::pow(settings.beta2, static_cast<double>(moments->step()));
  const torch::Tensor s = (moments->exp_avg_sq() / correction).sqrt();
  return (s / (s + settings.epsilon)).mean().item<double>();
}

double AdamOptimizer::max_second_moment() const {
  std::vector<torch::Tensor> largest;
  for (const torch::Tensor& parameter : state_->parameters) {
    const auto* moments = state_->moments(parameter);
    if (moments != nullptr) largest.push_back(moments->exp_avg_sq().max());
  }
  double all = 0;
  for (const double each : read_together(largest)) all = std::max(all, each);
  return all;
}

void AdamOptimizer::save(StateDict& state, const std::string& section, const std::string& prefix) const {
  for (std::size_t i = 0; i < state_->parameters.size(); ++i) {
    const auto* moments = state_->moments(state_->parameters[i]);
    if (moments == nullptr) continue;
    state.put(entry_prefix(section, prefix, i) + ".step", moments->step());
    state.put(entry_prefix(section, prefix, i) + ".exp_avg", moments->exp_avg());
    state.put(entry_prefix(section, prefix, i) + ".exp_avg_sq", moments->exp_avg_sq());
  }
}

Status AdamOptimizer::load(const StateDict& state, const std::string& section,
                           const std::string& key_prefix) {
  auto& map = state_->adam.state();
  map.clear();
  for (std::size_t i = 0; i < state_->parameters.size(); ++i) {
    const std::string prefix = entry_prefix(section, key_prefix, i);
    if (!state.has(prefix + ".step")) continue;
    const torch::Tensor& parameter = state_->parameters[i];
    auto moments = std::make_unique<torch::optim::AdamParamState>();
    COMRAD_TRY_ASSIGN(const int64_t step, state.integer(prefix + ".step"));
    moments->step(step);
    moments->exp_avg(torch::zeros_like(parameter));
    moments->exp_avg_sq(torch::zeros_like(parameter));
    COMRAD_TRY(state.copy_tensor(prefix + ".exp_avg", moments->exp_avg()));
    COMRAD_TRY(state.copy_tensor(prefix + ".exp_avg_sq", moments->exp_avg_sq()));
    map[state_key(map, parameter)] = std::move(moments);
  }
  return {};
}

}  // namespace comrad::learn
