#include "learner/step/adam_optimizer.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/share_out.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/elementwise.h"
#include "rollout_buffer/core/check.h"

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

/// The moments of all parameters lie one behind the other, so that a device starts a few kernels in all, not for each.
struct AdamOptimizer::State {
  std::vector<torch::Tensor> parameters;
  AdamSettings settings;
  torch::Tensor all_means,
      all_squares;  ///< exp_avg and exp_avg_sq [elements]; 0 before a parameter's first gradient
  std::vector<torch::Tensor> mean, square;  ///< of a parameter: its part of them, in its shape
  std::vector<bool> has_stepped;            ///< by parameter
  torch::Tensor owner;  ///< i32 [elements], on the device: whose element it is; made at the first step there
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
  /// Each parameter's part of numbers [elements], in its shape.
  std::vector<torch::Tensor> parts_of(const torch::Tensor& numbers) const {
    std::vector<torch::Tensor> parts;
    int64_t first = 0;
    for (const torch::Tensor& parameter : parameters) {
      parts.push_back(numbers.narrow(0, first, parameter.numel()).view(parameter.sizes()));
      first += parameter.numel();
    }
    return parts;
  }
};

AdamOptimizer::AdamOptimizer(std::vector<torch::Tensor> parameters, const AdamSettings& settings)
    : state_(new State) {
  COMRAD_CHECK(!parameters.empty(), "an optimizer has parameters");
  State& state = *state_;
  state.parameters = std::move(parameters);
  state.settings = settings;
  const auto options = state.parameters.front().options().requires_grad(false);
  int64_t elements = 0;
  for (const torch::Tensor& parameter : state.parameters) {
    COMRAD_CHECK(parameter.scalar_type() == options.dtype() && parameter.device() == options.device(),
                 "an optimizer's parameters are of one type, on one device");
    elements += parameter.numel();
  }
  state.all_means = torch::zeros({elements}, options);
  state.all_squares = torch::zeros_like(state.all_means);
  state.mean = state.parts_of(state.all_means);
  state.square = state.parts_of(state.all_squares);
  state.has_stepped.resize(state.parameters.size());
  state.steps = torch::zeros({}, options.dtype(torch::kFloat64));
  state.gradient_norms = torch::zeros({static_cast<int64_t>(state.parameters.size())}, state.steps.options());
  state.steps_before = torch::zeros_like(state.gradient_norms);
}
AdamOptimizer::~AdamOptimizer() = default;
AdamOptimizer::AdamOptimizer(AdamOptimizer&&) noexcept = default;
AdamOptimizer& AdamOptimizer::operator=(AdamOptimizer&&) noexcept = default;

const std::vector<torch::Tensor>& AdamOptimizer::parameters() const { return state_->parameters; }

void AdamOptimizer::zero_grad() {
  // Zeroed in place rather than dropped: the buffers of 13 MB are reused by every backward pass.
  std::vector<torch::Tensor> gradients;
  for (torch::Tensor& parameter : state_->parameters) {
    torch::Tensor& gradient = parameter.mutable_grad();
    if (gradient.defined()) gradients.push_back(gradient.detach_());
  }
  if (!gradients.empty()) at::_foreach_zero_(gradients);
}

std::vector<std::size_t> AdamOptimizer::with_gradient() {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < state_->parameters.size(); ++i) {
    if (!state_->parameters[i].grad().defined()) continue;
    indices.push_back(i);
    state_->has_stepped[i] = true;
  }
  return indices;
}

torch::Tensor AdamOptimizer::step(double learning_rate, const torch::Tensor& loss) {
  torch::NoGradGuard no_grad;
  if (state_->has_own_kernels()) return step_on_cpu(with_gradient(), learning_rate, loss);
  return step_on_device(torch::full({}, learning_rate, torch::kFloat64), loss);
}

torch::Tensor AdamOptimizer::step(const torch::Tensor& learning_rate, const torch::Tensor& loss) {
  torch::NoGradGuard no_grad;
  return step_on_device(learning_rate, loss);
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

/// The same as operators, which any device works off by itself: over all parameters at once. One without a gradient has one of 0, and
/// moments of 0.
torch::Tensor AdamOptimizer::step_on_device(const torch::Tensor& learning_rate, const torch::Tensor& loss) {
  State& state = *state_;
  const AdamSettings& settings = state.settings;
  const auto type = state.all_means.scalar_type();
  std::vector<torch::Tensor> gradients;
  for (std::size_t i = 0; i < state.parameters.size(); ++i) {
    const torch::Tensor& gradient = state.parameters[i].grad();
    if (gradient.defined()) state.has_stepped[i] = true;
    gradients.push_back(gradient.defined()
                            ? gradient.reshape(-1)
                            : torch::zeros({state.parameters[i].numel()}, state.all_means.options()));
  }
  state.gradient_norms.copy_(torch::stack(at::_foreach_norm(gradients)));
  const torch::Tensor norm = state.gradient_norms.square().sum().sqrt();
  torch::Tensor is_finite = norm.isfinite();
  if (loss.defined()) is_finite = is_finite.logical_and(loss.detach().isfinite().reshape({}));
  const torch::Tensor taken = is_finite.to(torch::kFloat64);
  const double limit = settings.max_grad_norm;
  const torch::Tensor scale = limit > 0 ? (limit / (norm + 1e-6)).clamp_max(1.0) : torch::ones_like(norm);
  state.steps.add_(taken);
  const torch::Tensor since = (state.steps - state.steps_before).clamp_min(1.0);  // [P]
  const torch::Tensor step_sizes = learning_rate * taken / (1 - at::pow(settings.beta1, since)),
                      root_scales = (1 - at::pow(settings.beta2, since)).rsqrt();
  if (!state.owner.defined()) {
    std::vector<torch::Tensor> owners;
    for (const torch::Tensor& parameter : state.parameters)
      owners.push_back(torch::full({parameter.numel()}, static_cast<int64_t>(owners.size()), torch::kInt32));
    state.owner = at::cat(owners).to(state.all_means.device());
  }
  const auto of_elements = [&](const torch::Tensor& of_parameters) {
    return of_parameters.to(type).index_select(0, state.owner);
  };
  // A weight of 0 leaves the moments, and a gradient of 0 keeps what is not finite out of the product.
  const torch::Tensor gradient = torch::where(is_finite, at::cat(gradients) * scale.to(type),
                                              torch::zeros({}, state.all_means.options()));
  torch::Tensor &mean = state.all_means, &square = state.all_squares;
  mean.lerp_(gradient, ((1 - settings.beta1) * taken).to(type).expand_as(mean));
  square.lerp_(gradient.square(), ((1 - settings.beta2) * taken).to(type).expand_as(square));
  const torch::Tensor root = square.sqrt().mul_(of_elements(root_scales)).add_(settings.epsilon);
  at::_foreach_sub_(state.parameters, state.parts_of((mean / root).mul_(of_elements(step_sizes))));
  for (const torch::Tensor& parameter : state.parameters) parameter.unsafeGetTensorImpl()->bump_version();
  return torch::stack({taken, norm});
}

void AdamOptimizer::clear_moments(std::size_t index) {
  if (!has_stepped(index)) return;
  torch::NoGradGuard no_grad;
  state_->mean[index].zero_();
  state_->square[index].zero_();
  state_->steps_before[static_cast<int64_t>(index)].copy_(state_->steps);
}

bool AdamOptimizer::has_stepped(std::size_t index) const { return state_->has_stepped[index]; }

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
  return state_->all_squares.max().to(torch::kFloat64);
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
    state_->has_stepped[i] = state.has(prefix + ".step");
    if (!state_->has_stepped[i]) {
      state_->mean[i].zero_();
      state_->square[i].zero_();
      continue;
    }
    COMRAD_TRY_ASSIGN(const int64_t of_parameter, state.integer(prefix + ".step"));
    steps = std::max(steps, of_parameter);
    since.data_ptr<double>()[i] = static_cast<double>(of_parameter);
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
