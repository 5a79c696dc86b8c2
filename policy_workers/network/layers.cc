#include "policy_workers/network/layers.h"

#include <cmath>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {

std::pair<Tensor, Tensor> initial_layer(at::IntArrayRef sizes, Initialization init, double gain,
                                        at::Generator generator) {
  if (init == Initialization::kZero) return {torch::zeros(sizes), torch::zeros({sizes[0]})};
  if (init == Initialization::kOrthogonal)
    return {orthogonal(sizes, gain, generator), torch::zeros({sizes[0]})};
  int64_t inputs = 1;
  for (const int64_t size : sizes.slice(1)) inputs *= size;
  const double bound = 1.0 / std::sqrt(static_cast<double>(inputs));
  const Tensor weight = torch::empty(sizes).uniform_(-bound, bound, generator);
  return {weight, torch::empty({sizes[0]}).uniform_(-bound, bound, generator)};
}

Tensor orthogonal(at::IntArrayRef sizes, double gain, at::Generator generator) {
  const int64_t rows = sizes[0];
  int64_t columns = 1;
  for (size_t axis = 1; axis < sizes.size(); ++axis) columns *= sizes[axis];
  // Saxe et al. 2014, arXiv:1312.6120: Q of a Gaussian matrix, signs fixed by R's diagonal so that Q
  // is uniform.
  Tensor gaussian = torch::empty({std::max(rows, columns), std::min(rows, columns)}, torch::kFloat64);
  gaussian.normal_(0.0, 1.0, generator);
  // LAPACK takes a column at a time: threads would wait for each other tens of thousands of times, and round differently.
  const device::OneMathThread one_thread;
  auto [q, r] = at::linalg_qr(gaussian);
  q = q * r.diagonal().sign();
  if (rows < columns) q = q.t();
  return (q * gain).to(torch::kFloat32).contiguous().view(sizes);
}

Layer LayerMaker::operator()(std::string name, at::IntArrayRef sizes) const {
  const auto [weight, bias] = initial_layer(sizes, init, gain, generator);
  return Layer{std::move(name), weight.to(device).requires_grad_(), bias.to(device).requires_grad_()};
}

Layer LayerMaker::norm(std::string name, at::IntArrayRef sizes) const {
  return Layer{std::move(name), torch::ones(sizes).to(device).requires_grad_(),
               torch::zeros(sizes).to(device).requires_grad_()};
}

Tensor layer_norm(const Tensor& rows, const Tensor& weight, const Tensor& bias) {
  return at::layer_norm(to_f32(rows), weight.sizes(), weight, bias);
}

void append(NamedTensors& named, const std::string& prefix, const Layer& layer) {
  named.emplace_back(prefix + layer.name + ".weight", layer.weight);
  named.emplace_back(prefix + layer.name + ".bias", layer.bias);
}

void append(NamedTensors& named, const std::string& prefix, const NamedTensors& more) {
  for (const auto& [name, tensor] : more) named.emplace_back(prefix + name, tensor);
}

}  // namespace comrad::policy
