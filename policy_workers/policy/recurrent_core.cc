#include "policy_workers/policy/recurrent_core.h"

#include <cmath>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/policy/packed_product.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::tensor_list;

/// Products of all steps of a sequence with one weight: in panels, or as a factor that is made once.
class StepProduct {
 public:
  /// `x` is as one step's.
  StepProduct(const Tensor& x, const Tensor& weight, WeightSide side, Precision precision)
      : weight_(weight), side_(side), precision_(precision), packs_(packs(x, weight, precision)) {
    if (packs_) return;
    factor_ = weight_factor(weight, precision);
    if (side == WeightSide::kTransposed) factor_ = factor_.t();
  }

  /// out = base + x W^T, or base + x W.
  void out(Tensor& out, const Tensor& base, const Tensor& x) const {
    if (packs_)
      packed_product_out(out, base, x, weight_, side_, precision_);
    else if (precision_ == Precision::kFp32)
      at::addmm_out(out, base, x, factor_);
    else
      at::add_out(out, to_f32(factor(x, precision_).mm(factor_)), base);
  }

  Tensor operator()(const Tensor& base, const Tensor& x) const {
    Tensor sum = torch::empty_like(base);
    out(sum, base, x);
    return sum;
  }

 private:
  Tensor weight_, factor_;
  WeightSide side_;
  Precision precision_;
  bool packs_;
};

/// What step t begins with: the state behind the step before it, or 0 where that was an episode's last.
void carry_over(Tensor& into, const Tensor& state, const Tensor& keep, int64_t t) {
  if (keep.numel() > 0)
    at::mul_out(into, state, keep[t]);
  else
    into.copy_(state);
}

/// G^T h over all rows of all steps.
Tensor weight_gradient(const Tensor& gradient, const Tensor& h, Precision precision) {
  return to_f32(factor(gradient, precision).t().mm(factor(h, precision)));
}

/// The recurrent half of a GRU layer over a sequence. The input half, gi = W_ih x + b_ih, is one product
/// outside.
///
///   r = sigmoid(gi_r + gh_r), z = sigmoid(gi_z + gh_z), n = tanh(gi_n + r gh_n), h' = n + z (h - n)
///   with gh = W_hh h + b_hh and h = keep_t h'_{t-1}
///
/// Written by hand because autograd would add one [3H, H] weight gradient per step; here it is a single
/// product over all T B rows after the loop, which halves the time of the core's backward pass on a CPU.
struct GruSequence : torch::autograd::Function<GruSequence> {
  static Tensor forward(AutogradContext* context, const Tensor& gi, const Tensor& h0, const Tensor& keep,
                        const Tensor& weight_hh, const Tensor& bias_hh, Precision precision) {
    const int64_t steps = gi.size(0), rows = gi.size(1), hidden = h0.size(1);
    const Tensor output = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor h_in = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor gates =
        torch::empty({steps, rows, 3 * hidden}, gi.options());  // r, z, n after their functions
    const Tensor gh_n = torch::empty({steps, rows, hidden}, gi.options());
    const StepProduct product(h0, weight_hh, WeightSide::kTransposed, precision);
    Tensor gh = torch::empty({rows, 3 * hidden}, gi.options());
    Tensor h = h0;
    for (int64_t t = 0; t < steps; ++t) {
      Tensor h_before = h_in[t];
      carry_over(h_before, h, keep, t);
      product.out(gh, bias_hh, h_before);
      Tensor rz = gates[t].slice(1, 0, 2 * hidden);
      at::add_out(rz, gi[t].slice(1, 0, 2 * hidden), gh.slice(1, 0, 2 * hidden));
      rz.sigmoid_();
      gh_n[t].copy_(gh.slice(1, 2 * hidden));
      Tensor n = gates[t].slice(1, 2 * hidden);
      at::addcmul_out(n, gi[t].slice(1, 2 * hidden), rz.slice(1, 0, hidden), gh_n[t]);
      n.tanh_();
      h = output[t];
      at::sub_out(h, h_before, n);
      h.mul_(rz.slice(1, hidden)).add_(n);
    }
    context->save_for_backward({h_in, gates, gh_n, keep, weight_hh});
    context->saved_data["precision"] = static_cast<int64_t>(precision);
    return output;
  }

  static tensor_list backward(AutogradContext* context, tensor_list grad_outputs) {
    const auto saved = context->get_saved_variables();
    const auto precision = static_cast<Precision>(context->saved_data["precision"].toInt());
    const Tensor &h_in = saved[0], &gates = saved[1], &gh_n = saved[2], &keep = saved[3];
    const StepProduct product(h_in[0], saved[4], WeightSide::kPlain, precision);
    const Tensor& grad = grad_outputs[0];
    const int64_t steps = h_in.size(0), rows = h_in.size(1), hidden = h_in.size(2);
    const Tensor grad_gi = torch::empty_like(gates);
    const Tensor grad_gh = torch::empty_like(gates);
    Tensor carried = torch::zeros({rows, hidden}, h_in.options());  // gradient of h'_t from the steps after t
    for (int64_t t = steps - 1; t >= 0; --t) {
      const Tensor r = gates[t].slice(1, 0, hidden), z = gates[t].slice(1, hidden, 2 * hidden),
                   n = gates[t].slice(1, 2 * hidden);
      const Tensor grad_h = carried.add_(grad[t]);
      Tensor gi_r = grad_gi[t].slice(1, 0, hidden), gi_z = grad_gi[t].slice(1, hidden, 2 * hidden),
             gi_n = grad_gi[t].slice(1, 2 * hidden);
      const Tensor grad_hz = grad_h * z;
      at::sub_out(gi_n, grad_h, grad_hz).mul_(1 - n.square());
      at::sub_out(gi_z, h_in[t], n).mul_(grad_hz).mul_(1 - z);
      at::mul_out(gi_r, gi_n, gh_n[t]).mul_(r).mul_(1 - r);
      grad_gh[t].slice(1, 0, 2 * hidden).copy_(grad_gi[t].slice(1, 0, 2 * hidden));
      Tensor gh_n_gradient = grad_gh[t].slice(1, 2 * hidden);
      at::mul_out(gh_n_gradient, gi_n, r);
      carried = product(grad_hz, grad_gh[t]);
      if (keep.numel() > 0) carried.mul_(keep[t]);
    }
    const Tensor flat = grad_gh.view({steps * rows, 3 * hidden});
    return {grad_gi,     carried,
            Tensor(),    weight_gradient(flat, h_in.view({steps * rows, hidden}), precision),
            flat.sum(0), Tensor()};
  }
};

/// The same on a GPU, where every operator of a step costs a start: what lies between two products is one kernel of torch's.
struct FusedGruSequence : torch::autograd::Function<FusedGruSequence> {
  static Tensor forward(AutogradContext* context, const Tensor& gi, const Tensor& h0, const Tensor& keep,
                        const Tensor& weight_hh, const Tensor& bias_hh, Precision precision) {
    const int64_t steps = gi.size(0), rows = gi.size(1), hidden = h0.size(1);
    const Tensor h_in = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor weight_t = weight_factor(weight_hh, precision).t();
    const Tensor no_bias = torch::zeros_like(bias_hh);  // gi has its own
    tensor_list outputs, saved = {h_in, keep, weight_hh};
    Tensor h = h0;
    for (int64_t t = 0; t < steps; ++t) {
      Tensor h_before = h_in[t];
      carry_over(h_before, h, keep, t);
      const Tensor gh = to_f32(factor(h_before, precision).mm(weight_t));
      Tensor gates;
      std::tie(h, gates) = at::_thnn_fused_gru_cell(gi[t], gh, h_before, no_bias, bias_hh);
      outputs.push_back(h);
      saved.push_back(gates);
    }
    context->save_for_backward(saved);
    context->saved_data["precision"] = static_cast<int64_t>(precision);
    return at::stack(outputs);
  }

  static tensor_list backward(AutogradContext* context, tensor_list grad_outputs) {
    const auto saved = context->get_saved_variables();
    const auto precision = static_cast<Precision>(context->saved_data["precision"].toInt());
    const Tensor &h_in = saved[0], &keep = saved[1], &grad = grad_outputs[0];
    const StepProduct product(h_in[0], saved[2], WeightSide::kPlain, precision);
    const int64_t steps = h_in.size(0), rows = h_in.size(1), hidden = h_in.size(2);
    tensor_list of_gi(static_cast<size_t>(steps)), of_gh(static_cast<size_t>(steps));
    Tensor carried;  // gradient of h'_t from the steps after t
    for (int64_t t = steps - 1; t >= 0; --t) {
      const Tensor grad_h = carried.defined() ? carried.add_(grad[t]) : grad[t].contiguous();
      const auto [gi, gh, h, gi_bias, gh_bias] =
          at::_thnn_fused_gru_cell_backward(grad_h, saved[static_cast<size_t>(t + 3)], /*has_bias=*/false);
      of_gi[static_cast<size_t>(t)] = gi;
      of_gh[static_cast<size_t>(t)] = gh;
      carried = product(h, gh);
      if (keep.numel() > 0) carried.mul_(keep[t]);
    }
    const Tensor flat = at::cat(of_gh);
    return {at::stack(of_gi), carried,
            Tensor(),         weight_gradient(flat, h_in.view({steps * rows, hidden}), precision),
            flat.sum(0),      Tensor()};
  }
};

/// The recurrent half of an LSTM layer over a sequence; returns h [T, B, hidden] and the last c [B, hidden].
///
///   i, f, o = sigmoid, g = tanh of gi + W_hh h + b_hh;  c' = f c + i g;  h' = o tanh(c')
struct LstmSequence : torch::autograd::Function<LstmSequence> {
  static tensor_list forward(AutogradContext* context, const Tensor& gi, const Tensor& h0, const Tensor& c0,
                             const Tensor& keep, const Tensor& weight_hh, const Tensor& bias_hh,
                             Precision precision) {
    const int64_t steps = gi.size(0), rows = gi.size(1), hidden = h0.size(1);
    const Tensor output = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor h_in = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor c_in = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor tanh_c = torch::empty({steps, rows, hidden}, gi.options());
    const Tensor gates = torch::empty({steps, rows, 4 * hidden}, gi.options());
    const StepProduct product(h0, weight_hh, WeightSide::kTransposed, precision);
    Tensor h = h0, c = c0;
    for (int64_t t = 0; t < steps; ++t) {
      Tensor h_before = h_in[t], c_before = c_in[t], gate = gates[t];
      carry_over(h_before, h, keep, t);
      carry_over(c_before, c, keep, t);
      product.out(gate, bias_hh, h_before);
      gate.add_(gi[t]);
      Tensor input_forget = gate.slice(1, 0, 2 * hidden), g = gate.slice(1, 2 * hidden, 3 * hidden),
             o = gate.slice(1, 3 * hidden);
      input_forget.sigmoid_();
      g.tanh_();
      o.sigmoid_();
      c = at::addcmul(c_before * input_forget.slice(1, hidden), input_forget.slice(1, 0, hidden), g);
      Tensor squashed = tanh_c[t];
      at::tanh_out(squashed, c);
      h = output[t];
      at::mul_out(h, o, squashed);
    }
    context->save_for_backward({h_in, c_in, tanh_c, gates, keep, weight_hh});
    context->saved_data["precision"] = static_cast<int64_t>(precision);
    return {output, c};
  }

  static tensor_list backward(AutogradContext* context, tensor_list grad_outputs) {
    const auto saved = context->get_saved_variables();
    const auto precision = static_cast<Precision>(context->saved_data["precision"].toInt());
    const Tensor &h_in = saved[0], &c_in = saved[1], &tanh_c = saved[2], &gates = saved[3], &keep = saved[4];
    const StepProduct product(h_in[0], saved[5], WeightSide::kPlain, precision);
    const Tensor& grad = grad_outputs[0];
    const int64_t steps = h_in.size(0), rows = h_in.size(1), hidden = h_in.size(2);
    const Tensor grad_gi = torch::empty_like(gates);
    Tensor carried_h = torch::zeros({rows, hidden}, h_in.options());
    Tensor carried_c = grad_outputs[1].defined() ? grad_outputs[1].clone() : torch::zeros_like(carried_h);
    for (int64_t t = steps - 1; t >= 0; --t) {
      const Tensor i = gates[t].slice(1, 0, hidden), f = gates[t].slice(1, hidden, 2 * hidden),
                   g = gates[t].slice(1, 2 * hidden, 3 * hidden), o = gates[t].slice(1, 3 * hidden);
      Tensor grad_i = grad_gi[t].slice(1, 0, hidden), grad_f = grad_gi[t].slice(1, hidden, 2 * hidden),
             grad_g = grad_gi[t].slice(1, 2 * hidden, 3 * hidden), grad_o = grad_gi[t].slice(1, 3 * hidden);
      const Tensor grad_h = grad.defined() ? carried_h.add_(grad[t]) : carried_h;
      at::mul_out(grad_o, grad_h, tanh_c[t]).mul_(o).mul_(1 - o);
      const Tensor grad_c = carried_c.add_((grad_h * o).mul_(1 - tanh_c[t].square()));
      at::mul_out(grad_i, grad_c, g).mul_(i).mul_(1 - i);
      at::mul_out(grad_f, grad_c, c_in[t]).mul_(f).mul_(1 - f);
      at::mul_out(grad_g, grad_c, i).mul_(1 - g.square());
      carried_h = product(torch::zeros_like(carried_h), grad_gi[t]);
      carried_c = grad_c * f;
      if (keep.numel() > 0) {
        carried_h.mul_(keep[t]);
        carried_c.mul_(keep[t]);
      }
    }
    const Tensor flat = grad_gi.view({steps * rows, 4 * hidden});
    return {grad_gi,
            carried_h,
            carried_c,
            Tensor(),
            weight_gradient(flat, h_in.view({steps * rows, hidden}), precision),
            flat.sum(0),
            Tensor()};
  }
};

}  // namespace

RecurrentCore RecurrentCore::create(CoreKind kind, int64_t input_count, int64_t hidden_count,
                                    int64_t layer_count, at::Generator generator, torch::Device device,
                                    Precision precision) {
  RecurrentCore core;
  core.precision_ = precision;
  core.kind_ = kind;
  core.feature_count_ = input_count;
  if (kind == CoreKind::kNone) return core;
  core.hidden_count_ = hidden_count;
  core.feature_count_ = hidden_count;
  const int64_t rows = (kind == CoreKind::kGru ? 3 : 4) * hidden_count;
  const double bound = 1.0 / std::sqrt(static_cast<double>(hidden_count));
  auto draw = [&](at::IntArrayRef sizes) {
    return torch::empty(sizes).uniform_(-bound, bound, generator).to(device).requires_grad_();
  };
  for (int64_t layer = 0; layer < layer_count; ++layer) {
    CoreLayer weights;
    weights.weight_ih = draw({rows, layer == 0 ? input_count : hidden_count});
    weights.weight_hh = draw({rows, hidden_count});
    weights.bias_ih = draw({rows});
    weights.bias_hh = draw({rows});
    core.layers_.push_back(std::move(weights));
  }
  return core;
}

int64_t RecurrentCore::state_count() const {
  return static_cast<int64_t>(layers_.size()) * hidden_count_ * (kind_ == CoreKind::kLstm ? 2 : 1);
}

CoreOutput RecurrentCore::step(const Tensor& input, const Tensor& state) const {
  if (kind_ == CoreKind::kNone) return {input, state};
  // The framework's cells multiply in f32, with a BLAS.
  if (precision_ != Precision::kFp32 || device::has_own_kernels(input.device())) {
    CoreOutput output = sequence(input.unsqueeze(0), state, {});
    return {output.features.squeeze(0), output.state};
  }
  const int64_t layer_count = static_cast<int64_t>(layers_.size());
  std::vector<Tensor> hidden, cells;
  Tensor x = input;
  for (int64_t layer = 0; layer < layer_count; ++layer) {
    const CoreLayer& w = layers_[static_cast<size_t>(layer)];
    const Tensor h = state.slice(1, layer * hidden_count_, (layer + 1) * hidden_count_);
    if (kind_ == CoreKind::kGru) {
      x = at::gru_cell(x, h, w.weight_ih, w.weight_hh, w.bias_ih, w.bias_hh);
    } else {
      const int64_t first = (layer_count + layer) * hidden_count_;
      const Tensor c = state.slice(1, first, first + hidden_count_);
      Tensor c_after;
      std::tie(x, c_after) = at::lstm_cell(x, {h, c}, w.weight_ih, w.weight_hh, w.bias_ih, w.bias_hh);
      cells.push_back(c_after);
    }
    hidden.push_back(x);
  }
  hidden.insert(hidden.end(), cells.begin(), cells.end());
  return {x, hidden.size() == 1 ? hidden.front() : at::cat(hidden, 1)};
}

CoreOutput RecurrentCore::sequence(const Tensor& input, const Tensor& state, const Tensor& keep) const {
  if (kind_ == CoreKind::kNone) return {input, state};
  const int64_t layer_count = static_cast<int64_t>(layers_.size());
  // libtorch 1.13 takes no undefined tensor in a custom function; an empty one says "no resets".
  const Tensor kept = keep.defined() ? keep : torch::empty({0}, input.options().requires_grad(false));
  std::vector<Tensor> hidden, cells;
  Tensor x = input;
  for (int64_t layer = 0; layer < layer_count; ++layer) {
    const CoreLayer& w = layers_[static_cast<size_t>(layer)];
    const Tensor h0 = state.slice(1, layer * hidden_count_, (layer + 1) * hidden_count_);
    const Tensor gi = linear(x, w.weight_ih, w.bias_ih, precision_);
    if (kind_ == CoreKind::kGru) {
      x = gi.is_cuda() ? FusedGruSequence::apply(gi, h0, kept, w.weight_hh, w.bias_hh, precision_)
                       : GruSequence::apply(gi, h0, kept, w.weight_hh, w.bias_hh, precision_);
    } else {
      const int64_t first = (layer_count + layer) * hidden_count_;
      const Tensor c0 = state.slice(1, first, first + hidden_count_);
      const tensor_list outputs = LstmSequence::apply(gi, h0, c0, kept, w.weight_hh, w.bias_hh, precision_);
      x = outputs[0];
      cells.push_back(outputs[1]);
    }
    hidden.push_back(x[-1]);
  }
  hidden.insert(hidden.end(), cells.begin(), cells.end());
  return {x, hidden.size() == 1 ? hidden.front() : at::cat(hidden, 1)};
}

NamedTensors RecurrentCore::named_parameters() const {
  NamedTensors named;
  for (size_t layer = 0; layer < layers_.size(); ++layer) {
    const std::string suffix = "_l" + std::to_string(layer);
    named.emplace_back("core.weight_ih" + suffix, layers_[layer].weight_ih);
    named.emplace_back("core.weight_hh" + suffix, layers_[layer].weight_hh);
    named.emplace_back("core.bias_ih" + suffix, layers_[layer].bias_ih);
    named.emplace_back("core.bias_hh" + suffix, layers_[layer].bias_hh);
  }
  return named;
}

}  // namespace comrad::policy
