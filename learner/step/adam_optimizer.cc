#include "learner/step/adam_optimizer.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/share_out.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/elementwise.h"

namespace comrad::learn {
namespace {

std::string entry_prefix(const std::string& section, const std::string& prefix, std::size_t index) {
  char number[24];
  std::snprintf(number, sizeof(number), "%03zu", index);
  return section + "/" + prefix + number;
}

/// Of each tensor's elements; the order of a sum does not depend on how many threads there are.
std::vector<double> sums_of_squares(const std::vector<torch::Tensor>& tensors,
                                    const std::vector<device::Piece>& pieces) {
  std::vector<double> of_pieces(pieces.size());
  device::share_out(pieces.size(), [&](std::size_t i) {
    const device::Piece& piece = pieces[i];
    of_pieces[i] =
        policy::kernels::sum_of_squares(tensors[piece.tensor].data_ptr<float>() + piece.begin, piece.size());
  });
  std::vector<double> sums(tensors.size());
  for (std::size_t i = 0; i < pieces.size(); ++i) sums[pieces[i].tensor] += of_pieces[i];
  return sums;
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
  std::vector<torch::Tensor> mean,
      square;           ///< exp_avg and exp_avg_sq; undefined before a parameter's first gradient
  torch::Tensor steps;  ///< f64 [], on the device: steps taken
  torch::Tensor
      steps_before;  ///< f64 [P], on the device: of those, before a parameter's moments were cleared
  torch::Tensor gradient_norms;  ///< f64 [P], on the device: of the parameters' gradients at the last step

  bool has_own_kernels() const {
    return std::ranges::all_of(parameters, [](const torch::Tensor& parameter) {
      return device::has_own_kernels(parameter.device()) && parameter.scalar_type() == torch::kFloat32 &&
             parameter.is_contiguous();
    });
  }
  void make_moments(std::size_t index) {
    if (mean[index].defined()) return;
    mean[index] = torch::zeros_like(parameters[index], parameters[index].options().requires_grad(false));
    square[index] = torch::zeros_like(mean[index]);
  }
};

AdamOptimizer::AdamOptimizer(std::vector<torch::Tensor> parameters, const AdamSettings& settings)
    : state_(new State{.parameters = std::move(parameters),
                       .settings = settings,
                       .mean = {},
                       .square = {},
                       .steps = {},
                       .steps_before = {},
                       .gradient_norms = {}}) {
  state_->mean.resize(state_->parameters.size());
  state_->square.resize(state_->parameters.size());
  const torch::Device device =
      state_->parameters.empty() ? torch::Device(torch::kCPU) : state_->parameters.front().device();
  state_->steps = torch::zeros({}, torch::TensorOptions(torch::kFloat64).device(device));
  state_->gradient_norms =
      torch::zeros({static_cast<int64_t>(state_->parameters.size())}, state_->steps.options());
  state_->steps_before = torch::zeros_like(state_->gradient_norms);
}
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

std::vector<std::size_t> AdamOptimizer::with_gradient() {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < state_->parameters.size(); ++i) {
    if (!state_->parameters[i].grad().defined()) continue;
    indices.push_back(i);
    state_->make_moments(i);
  }
  return indices;
}

torch::Tensor AdamOptimizer::step(double learning_rate, const torch::Tensor& loss) {
  torch::NoGradGuard no_grad;
  if (state_->has_own_kernels()) return step_on_cpu(with_gradient(), learning_rate, loss);
  return step_on_device(with_gradient(), torch::full({}, learning_rate, torch::kFloat64), loss);
}

torch::Tensor AdamOptimizer::step(const torch::Tensor& learning_rate, const torch::Tensor& loss) {
  torch::NoGradGuard no_grad;
  return step_on_device(with_gradient(), learning_rate, loss);
}

/// Two passes over the gradients: one for the norm, one for everything else.
torch::Tensor AdamOptimizer::step_on_cpu(const std::vector<std::size_t>& indices, double learning_rate,
                                         const torch::Tensor& loss) {
  const AdamSettings& settings = state_->settings;
  std::vector<torch::Tensor> gradients;
  for (const std::size_t i : indices) gradients.push_back(state_->parameters[i].grad().contiguous());
  const std::vector<device::Piece> pieces = device::pieces_of(gradients);
  const std::vector<double> squares = sums_of_squares(gradients, pieces);
  state_->gradient_norms.zero_();
  for (std::size_t k = 0; k < indices.size(); ++k)
    state_->gradient_norms.data_ptr<double>()[indices[k]] = std::sqrt(squares[k]);
  const double norm = std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0)),
               limit = settings.max_grad_norm;
  const torch::Tensor on_host = loss.defined() ? loss.detach().to(torch::kFloat64) : torch::Tensor();
  const bool is_finite =
      std::isfinite(norm) && (!on_host.defined() || std::isfinite(*on_host.data_ptr<double>()));
  torch::Tensor outcome = torch::empty({2}, torch::kFloat64);
  outcome.data_ptr<double>()[0] = is_finite ? 1 : 0;
  outcome.data_ptr<double>()[1] = norm;
  if (!is_finite) return outcome;
  double& steps = *state_->steps.data_ptr<double>();
  steps += 1;
  std::vector<policy::kernels::AdamStep> numbers;  // of each of `indices`
  for (const std::size_t parameter : indices) {
    const double since = steps - state_->steps_before.data_ptr<double>()[parameter];
    numbers.push_back(
        {.gradient_scale = static_cast<float>(limit > 0 ? std::min(1.0, limit / (norm + 1e-6)) : 1.0),
         .beta1 = static_cast<float>(settings.beta1),
         .beta2 = static_cast<float>(settings.beta2),
         .one_less_beta1 = static_cast<float>(1 - settings.beta1),
         .one_less_beta2 = static_cast<float>(1 - settings.beta2),
         .step_size = static_cast<float>(learning_rate / (1 - std::pow(settings.beta1, since))),
         .root_scale = static_cast<float>(1 / std::sqrt(1 - std::pow(settings.beta2, since))),
         .epsilon = static_cast<float>(settings.epsilon)});
  }
  device::share_out(pieces.size(), [&](std::size_t k) {
    const device::Piece& piece = pieces[k];
    const std::size_t i = indices[piece.tensor];
    policy::kernels::adam_step(
        numbers[piece.tensor], piece.size(), gradients[piece.tensor].data_ptr<float>() + piece.begin,
        state_->mean[i].data_ptr<float>() + piece.begin, state_->square[i].data_ptr<float>() + piece.begin,
        state_->parameters[i].data_ptr<float>() + piece.begin);
  });
  for (const std::size_t i : indices) state_->parameters[i].unsafeGetTensorImpl()->bump_version();
  return outcome;
}

/// The same as operators, which any device works off by itself.
torch::Tensor AdamOptimizer::step_on_device(const std::vector<std::size_t>& indices,
                                            const torch::Tensor& learning_rate, const torch::Tensor& loss) {
  const AdamSettings& settings = state_->settings;
  std::vector<torch::Tensor> norms(state_->parameters.size(), torch::zeros_like(state_->steps));
  for (const std::size_t i : indices) norms[i] = state_->parameters[i].grad().norm().to(torch::kFloat64);
  if (!norms.empty()) state_->gradient_norms.copy_(torch::stack(norms));
  const torch::Tensor norm = state_->gradient_norms.square().sum().sqrt();
  torch::Tensor is_finite = norm.isfinite();
  if (loss.defined()) is_finite = is_finite.logical_and(loss.detach().isfinite().reshape({}));
  const torch::Tensor taken = is_finite.to(torch::kFloat64);
  const double limit = settings.max_grad_norm;
  const torch::Tensor scale = limit > 0 ? (limit / (norm + 1e-6)).clamp_max(1.0) : torch::ones_like(norm);
  state_->steps.add_(taken);
  const torch::Tensor since = (state_->steps - state_->steps_before).clamp_min(1.0);  // [P]
  const torch::Tensor step_sizes = learning_rate * taken / (1 - at::pow(settings.beta1, since)),
                      root_scales = (1 - at::pow(settings.beta2, since)).rsqrt();
  for (const std::size_t i : indices) {
    torch::Tensor &parameter = state_->parameters[i], &mean = state_->mean[i], &square = state_->square[i];
    const auto type = parameter.scalar_type();
    // A weight of 0 leaves the moments, and a gradient of 0 keeps what is not finite out of the product.
    const torch::Tensor gradient = torch::where(is_finite, parameter.grad() * scale.to(type),
                                                torch::zeros({}, parameter.options().requires_grad(false)));
    mean.lerp_(gradient, ((1 - settings.beta1) * taken).to(type).expand_as(mean));
    square.lerp_(gradient.square(), ((1 - settings.beta2) * taken).to(type).expand_as(square));
    const auto at_parameter = static_cast<int64_t>(i);
    parameter.sub_(mean / (square.sqrt() * root_scales[at_parameter].to(type) + settings.epsilon) *
                   step_sizes[at_parameter].to(type));
  }
  return torch::stack({taken, norm});
}

void AdamOptimizer::clear_moments(std::size_t index) {
  if (!has_stepped(index)) return;
  torch::NoGradGuard no_grad;
  state_->mean[index].zero_();
  state_->square[index].zero_();
  state_->steps_before[static_cast<int64_t>(index)].copy_(state_->steps);
}

bool AdamOptimizer::has_stepped(std::size_t index) const { return state_->mean[index].defined(); }

double AdamOptimizer::gradient_norm(std::size_t index) const {
  return state_->gradient_norms[static_cast<int64_t>(index)].item<double>();
}

double AdamOptimizer::step_multiplier(std::size_t index) const {
  torch::NoGradGuard no_grad;
  if (!has_stepped(index)) return 0;
  const AdamSettings& settings = state_->settings;
  const torch::Tensor since = state_->steps - state_->steps_before[static_cast<int64_t>(index)];
  const torch::Tensor correction = 1 - at::pow(settings.beta2, since.clamp_min(1.0));
  const torch::Tensor s = (state_->square[index] / correction).sqrt();
  return (s / (s + settings.epsilon)).mean().item<double>();
}

torch::Tensor AdamOptimizer::max_second_moment() const {
  torch::NoGradGuard no_grad;
  std::vector<torch::Tensor> largest = {torch::zeros_like(state_->steps)};
  for (const torch::Tensor& square : state_->square)
    if (square.defined()) largest.push_back(square.max().to(torch::kFloat64));
  return torch::stack(largest).max();
}

void AdamOptimizer::save(StateDict& state, const std::string& section, const std::string& prefix) const {
  const auto steps = static_cast<int64_t>(state_->steps.item<double>());
  if (steps == 0) return;
  const torch::Tensor before = state_->steps_before.to(torch::kCPU, torch::kInt64);
  for (std::size_t i = 0; i < state_->parameters.size(); ++i) {
    if (!has_stepped(i)) continue;
    state.put(entry_prefix(section, prefix, i) + ".step", steps - before.data_ptr<int64_t>()[i]);
    state.put(entry_prefix(section, prefix, i) + ".exp_avg", state_->mean[i]);
    state.put(entry_prefix(section, prefix, i) + ".exp_avg_sq", state_->square[i]);
  }
}

Status AdamOptimizer::load(const StateDict& state, const std::string& section,
                           const std::string& key_prefix) {
  int64_t steps = 0;
  torch::Tensor since = torch::full(state_->steps_before.sizes(), -1.0, torch::kFloat64);
  for (std::size_t i = 0; i < state_->parameters.size(); ++i) {
    const std::string prefix = entry_prefix(section, key_prefix, i);
    state_->mean[i] = state_->square[i] = torch::Tensor();
    if (!state.has(prefix + ".step")) continue;
    COMRAD_TRY_ASSIGN(const int64_t of_parameter, state.integer(prefix + ".step"));
    steps = std::max(steps, of_parameter);
    since.data_ptr<double>()[i] = static_cast<double>(of_parameter);
    state_->make_moments(i);
    COMRAD_TRY(state.copy_tensor(prefix + ".exp_avg", state_->mean[i]));
    COMRAD_TRY(state.copy_tensor(prefix + ".exp_avg_sq", state_->square[i]));
  }
  torch::NoGradGuard no_grad;
  state_->steps.fill_(static_cast<double>(steps));
  const double all = static_cast<double>(steps);
  state_->steps_before.copy_(torch::where(since.ge(0), all - since, torch::zeros({}, torch::kFloat64)));
  return {};
}

}  // namespace comrad::learn
