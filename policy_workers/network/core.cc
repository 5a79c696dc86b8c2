#include "policy_workers/network/core.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/packed_product.h"
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
      at::add_out(out, factor(x, precision_).mm(factor_), base);  // in f32, as the wider of the two
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

/// Room for what all steps begin with [T, B, hidden]; of one step without resets, that itself.
Tensor states_before(const Tensor& state, const Tensor& keep, int64_t steps) {
  if (steps == 1 && keep.numel() == 0 && state.is_contiguous()) return state.unsqueeze(0);
  return torch::empty({steps, state.size(0), state.size(1)}, state.options());
}

/// What step t begins with: the state behind the step before it, or 0 where that was an episode's last.
void carry_over(Tensor& into, const Tensor& state, const Tensor& keep, int64_t t) {
  if (into.is_alias_of(state)) return;
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
    const Tensor h_in = states_before(h0, keep, steps);
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
  /// `no_bias` is 0: gi has its own.
  static Tensor forward(AutogradContext* context, const Tensor& gi, const Tensor& h0, const Tensor& keep,
                        const Tensor& weight_hh, const Tensor& bias_hh, const Tensor& no_bias,
                        Precision precision) {
    const int64_t steps = gi.size(0);
    const Tensor h_in = states_before(h0, keep, steps);
    const Tensor weight_t = weight_factor(weight_hh, precision).t();
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
    return steps == 1 ? h.unsqueeze(0) : at::stack(outputs);
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
            flat.sum(0),      Tensor(),
            Tensor()};
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

/// Weights of one recurrent layer.
struct CellWeights {
  Tensor weight_ih, weight_hh, bias_ih, bias_hh;
  Tensor no_bias;  ///< 0, as large
};
/// A layer's h (and, LSTM, c) after a step, or h of all steps [T, B, hidden] and the last c.
struct CellOutput {
  Tensor h, c;
};

/// What GRU and LSTM layers do differently.
struct Cell {
  int64_t gates;
  bool has_c;
  CellOutput (*step)(const Tensor& x, const Tensor& h, const Tensor& c, const CellWeights& w);
  /// `gi` is the input half of all steps, W_ih x + b_ih.
  CellOutput (*sequence)(const Tensor& gi, const Tensor& h, const Tensor& c, const Tensor& keep,
                         const CellWeights& w, Precision precision);
};

constexpr Cell kGru = {
    .gates = 3,
    .has_c = false,
    .step = [](const Tensor& x, const Tensor& h, const Tensor&, const CellWeights& w) -> CellOutput {
      return {at::gru_cell(x, h, w.weight_ih, w.weight_hh, w.bias_ih, w.bias_hh), {}};
    },
    .sequence = [](const Tensor& gi, const Tensor& h, const Tensor&, const Tensor& keep, const CellWeights& w,
                   Precision precision) -> CellOutput {
      return {gi.is_cuda()
                  ? FusedGruSequence::apply(gi, h, keep, w.weight_hh, w.bias_hh, w.no_bias, precision)
                  : GruSequence::apply(gi, h, keep, w.weight_hh, w.bias_hh, precision),
              {}};
    }};

constexpr Cell kLstm = {
    .gates = 4,
    .has_c = true,
    .step = [](const Tensor& x, const Tensor& h, const Tensor& c, const CellWeights& w) -> CellOutput {
      auto [h_after, c_after] = at::lstm_cell(x, {h, c}, w.weight_ih, w.weight_hh, w.bias_ih, w.bias_hh);
      return {h_after, c_after};
    },
    .sequence = [](const Tensor& gi, const Tensor& h, const Tensor& c, const Tensor& keep,
                   const CellWeights& w, Precision precision) -> CellOutput {
      const tensor_list outputs = LstmSequence::apply(gi, h, c, keep, w.weight_hh, w.bias_hh, precision);
      return {outputs[0], outputs[1]};
    }};

class RecurrentCore : public Core {
 public:
  RecurrentCore(const Cell& cell, const CoreInput& input, const LayerMaker& make)
      : cell_(cell), hidden_count_(input.hidden_count), precision_(make.precision) {
    const int64_t rows = cell.gates * hidden_count_;
    const double bound = 1.0 / std::sqrt(static_cast<double>(hidden_count_));
    const auto draw = [&](at::IntArrayRef sizes) {
      return torch::empty(sizes).uniform_(-bound, bound, make.generator).to(make.device).requires_grad_();
    };
    for (int64_t layer = 0; layer < input.layer_count; ++layer) {
      CellWeights weights;
      weights.weight_ih = draw({rows, layer == 0 ? input.input_count : hidden_count_});
      weights.weight_hh = draw({rows, hidden_count_});
      weights.bias_ih = draw({rows});
      weights.bias_hh = draw({rows});
      weights.no_bias = torch::zeros_like(weights.bias_hh);
      layers_.push_back(std::move(weights));
    }
  }

  CoreOutput step(const Tensor& input, const Tensor& state) const override {
    // The framework's cells multiply in f32, with a BLAS.
    if (precision_ != Precision::kFp32 || device::has_own_kernels(input.device())) {
      CoreOutput output = sequence(input.unsqueeze(0), state, {});
      return {output.features.squeeze(0), output.state};
    }
    return run(input, state, [this](const Tensor& x, const Tensor& h, const Tensor& c, const CellWeights& w) {
      return cell_.step(x, h, c, w);
    });
  }

  CoreOutput sequence(const Tensor& input, const Tensor& state, const Tensor& keep) const override {
    // libtorch 1.13 takes no undefined tensor in a custom function; an empty one means "no resets".
    const Tensor kept = keep.defined() ? keep : torch::empty({0}, state.options().requires_grad(false));
    return run(input, state, [&](const Tensor& x, const Tensor& h, const Tensor& c, const CellWeights& w) {
      return cell_.sequence(to_f32(linear(x, w.weight_ih, w.bias_ih, precision_)), h, c, kept, w, precision_);
    });
  }

  int64_t feature_count() const override { return hidden_count_; }
  int64_t state_count() const override {
    return static_cast<int64_t>(layers_.size()) * hidden_count_ * (cell_.has_c ? 2 : 1);
  }

  NamedTensors named_parameters() const override {
    NamedTensors named;
    for (size_t layer = 0; layer < layers_.size(); ++layer) {
      const std::string suffix = fmt::format("_l{}", layer);
      named.emplace_back("core.weight_ih" + suffix, layers_[layer].weight_ih);
      named.emplace_back("core.weight_hh" + suffix, layers_[layer].weight_hh);
      named.emplace_back("core.bias_ih" + suffix, layers_[layer].bias_ih);
      named.emplace_back("core.bias_hh" + suffix, layers_[layer].bias_hh);
    }
    return named;
  }

 private:
  /// Layer after layer; `run_layer` gives h and c of one step, or h of all steps and the last c.
  template <typename RunLayer>
  CoreOutput run(const Tensor& input, const Tensor& state, RunLayer&& run_layer) const {
    const auto layer_count = static_cast<int64_t>(layers_.size());
    const bool is_sequence = input.dim() == 3;
    const auto part = [&](int64_t index) {
      return state.slice(1, index * hidden_count_, (index + 1) * hidden_count_);
    };
    std::vector<Tensor> hidden, cells;
    Tensor x = input;
    for (int64_t layer = 0; layer < layer_count; ++layer) {
      const CellOutput after = run_layer(x, part(layer), cell_.has_c ? part(layer_count + layer) : Tensor(),
                                         layers_[static_cast<size_t>(layer)]);
      x = after.h;
      hidden.push_back(is_sequence ? x[-1] : x);
      if (cell_.has_c) cells.push_back(after.c);
    }
    hidden.insert(hidden.end(), cells.begin(), cells.end());
    return {x, hidden.size() == 1 ? hidden.front() : at::cat(hidden, 1)};
  }

  const Cell& cell_;
  int64_t hidden_count_;
  Precision precision_;
  std::vector<CellWeights> layers_;
};

/// Features pass unchanged.
class NoCore : public Core {
 public:
  explicit NoCore(int64_t feature_count) : feature_count_(feature_count) {}
  CoreOutput step(const Tensor& input, const Tensor& state) const override { return {input, state}; }
  CoreOutput sequence(const Tensor& input, const Tensor& state, const Tensor&) const override {
    return {input, state};
  }
  int64_t feature_count() const override { return feature_count_; }
  int64_t state_count() const override { return 0; }
  NamedTensors named_parameters() const override { return {}; }

 private:
  int64_t feature_count_;
};

/// Null for "none".
const Cell* find_cell(const std::string& kind) {
  if (kind == "gru") return &kGru;
  if (kind == "lstm") return &kLstm;
  COMRAD_CHECK(kind == "none", "a core is gru, lstm or none");
  return nullptr;
}

}  // namespace

std::shared_ptr<const Core> make_core(const CoreInput& input, const LayerMaker& make) {
  const Cell* cell = find_cell(input.kind);
  if (cell == nullptr) return std::make_shared<NoCore>(input.input_count);
  return std::make_shared<RecurrentCore>(*cell, input, make);
}

int64_t core_state_count(const CoreInput& input) {
  const Cell* cell = find_cell(input.kind);
  return cell == nullptr ? 0 : input.layer_count * input.hidden_count * (cell->has_c ? 2 : 1);
}

}  // namespace comrad::policy
