#include "policy_workers/policy/policy_net.h"

#include <malloc.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <string_view>

#include "policy_workers/policy/encoder.h"
#include "policy_workers/policy/recurrent_core.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

constexpr std::array<int64_t, 2> kCriticWidths = {512, 256};  // of a central critic, tanh after each

}  // namespace

/// The network's parts in the order that a frame passes them.
class PolicyNetImpl {
 public:
  PolicyNetOptions options;
  torch::Device device = torch::kCPU;
  Encoder encoder;
  RecurrentCore core;
  Tensor action_weight, action_bias;  // [A, F], [A]
  // From features to values: own features to one value, or the joint features of a world to N.
  struct ValueLayer {
    std::string name;
    Tensor weight, bias;
  };
  std::vector<ValueLayer> value_layers;

  /// Features [B, F] of the rows to their values [B].
  Tensor value_of(const Tensor& features) const {
    Tensor x = features;
    if (options.central_critic)
      x = x.reshape({x.size(0) / options.env.num_agents, x.size(1) * options.env.num_agents});
    for (std::size_t i = 0; i < value_layers.size(); ++i) {
      x = at::linear(x, value_layers[i].weight, value_layers[i].bias);
      if (i + 1 < value_layers.size()) x = at::tanh(x);
    }
    return x.flatten();
  }

  NamedTensors named_parameters() const {
    NamedTensors named = encoder.named_parameters();
    for (auto& entry : core.named_parameters()) named.push_back(entry);
    named.emplace_back("action_head.weight", action_weight);
    named.emplace_back("action_head.bias", action_bias);
    for (const ValueLayer& layer : value_layers) {
      named.emplace_back(layer.name + ".weight", layer.weight);
      named.emplace_back(layer.name + ".bias", layer.bias);
    }
    return named;
  }

  NamedTensors named_state() const {
    NamedTensors named = named_parameters();
    for (auto& entry : encoder.named_buffers()) named.push_back(entry);
    return named;
  }

  PolicyOutput act(const Tensor& encoded, const Tensor& recurrent_state) const {
    Tensor state = recurrent_state;
    if (core.state_count() > 0) state = state.to(device);
    const CoreOutput after = core.step(encoded, state);
    return {at::linear(after.features, action_weight, action_bias),
            value_of(after.features), after.state};
  }
};

PolicyNetOptions PolicyNetOptions::from(const RunConfig& config, const EnvShape& env) {
  PolicyNetOptions options;
  options.env = env;
  options.encoder = config.encoder_conv_architecture;
  options.use_rnn = config.use_rnn;
  options.rnn_type = config.rnn_type;
  options.rnn_size = config.rnn_size;
  options.rnn_num_layers = config.rnn_num_layers;
  options.init_gain = config.policy_init_gain;
  options.normalize_input = config.normalize_input;
  options.central_critic = config.algo == "mappo";
  return options;
}

int64_t PolicyNetOptions::recurrent_state_count() const {
  if (!use_rnn) return 0;
  return rnn_num_layers * rnn_size * (rnn_type == "lstm" ? 2 : 1);
}

PolicyNet PolicyNet::create(const PolicyNetOptions& options, uint64_t seed, torch::Device device) {
  COMRAD_CHECK(options.encoder == "convnet_simple", "settings were resolved: the encoder is convnet_simple");
  COMRAD_CHECK(!options.use_rnn || options.rnn_type == "gru" || options.rnn_type == "lstm",
               "settings were resolved: rnn_type is gru or lstm");
  torch::NoGradGuard no_grad;
  at::Generator generator = at::make_generator<at::CPUGeneratorImpl>(seed);
  PolicyNet net;
  net.impl_ = std::make_shared<PolicyNetImpl>();
  PolicyNetImpl& impl = *net.impl_;
  impl.options = options;
  impl.device = device;
  impl.encoder = Encoder::create(options.env, options.init_gain, options.normalize_input, generator, device);
  const CoreKind kind = !options.use_rnn             ? CoreKind::kNone
                        : options.rnn_type == "lstm" ? CoreKind::kLstm
                                                     : CoreKind::kGru;
  impl.core = RecurrentCore::create(kind, impl.encoder.feature_count(), options.rnn_size,
                                    options.rnn_num_layers, generator, device);
  const int64_t features = impl.core.feature_count(), logits = options.env.logit_count();
  impl.action_weight =
      orthogonal({logits, features}, options.init_gain, generator).to(device).requires_grad_();
  impl.action_bias = torch::zeros({logits}).to(device).requires_grad_();
  const auto add_value_layer = [&](const char* name, int64_t inputs, int64_t outputs) {
    impl.value_layers.push_back(
        {name, orthogonal({outputs, inputs}, options.init_gain, generator).to(device).requires_grad_(),
         torch::zeros({outputs}).to(device).requires_grad_()});
  };
  if (options.central_critic) {
    const int64_t agents = options.env.num_agents;
    add_value_layer("critic.0", features * agents, kCriticWidths[0]);
    add_value_layer("critic.1", kCriticWidths[0], kCriticWidths[1]);
    add_value_layer("critic.2", kCriticWidths[1], agents);
  } else {
    add_value_layer("value_head", features, 1);
  }
  return net;
}

PolicyOutput PolicyNet::step(const Tensor& frame, const Tensor& measurement,
                             const Tensor& recurrent_state) const {
  torch::NoGradGuard no_grad;
  return impl_->act(impl_->encoder.forward(frame, measurement), recurrent_state);
}

PolicyOutput PolicyNet::step_rows(std::span<const uint8_t* const> frames, const Tensor& measurement,
                                  const Tensor& recurrent_state) const {
  torch::NoGradGuard no_grad;
  return impl_->act(impl_->encoder.forward_rows(frames, measurement), recurrent_state);
}

SequenceOutput PolicyNet::sequence(const Tensor& frame, const Tensor& measurement,
                                   const Tensor& recurrent_state, const Tensor& reset) const {
  const PolicyNetImpl& impl = *impl_;
  const int64_t steps = frame.size(0), rows = frame.size(1);
  Tensor flat_measurement;
  if (measurement.defined()) flat_measurement = measurement.flatten(0, 1);
  Tensor features = impl.encoder.forward(frame.flatten(0, 1), flat_measurement);
  if (impl.core.state_count() > 0) {
    Tensor keep;
    if (reset.defined()) keep = reset.to(impl.device).eq(0).to(torch::kFloat32).unsqueeze(-1);
    features = impl.core
                   .sequence(features.view({steps, rows, impl.encoder.feature_count()}),
                             recurrent_state.to(impl.device), keep)
                   .features.flatten(0, 1);
  }
  return {at::linear(features, impl.action_weight, impl.action_bias).view({steps, rows, -1}),
          impl.value_of(features).view({steps, rows})};
}

void PolicyNet::update_input_statistics(const Tensor& frame, const Tensor& measurement) const {
  impl_->encoder.update_statistics(frame, measurement);
}

std::vector<Tensor> PolicyNet::parameters() const {
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->named_parameters()) parameters.push_back(tensor);
  return parameters;
}

NamedTensors PolicyNet::named_state() const { return impl_->named_state(); }

int64_t PolicyNet::parameter_count() const {
  int64_t count = 0;
  for (const Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

int64_t PolicyNet::weights_bytes() const {
  int64_t bytes = 0;
  for (auto& [name, tensor] : named_state()) bytes += static_cast<int64_t>(tensor.nbytes());
  return bytes;
}

void PolicyNet::write_weights(std::span<std::byte> out) const {
  COMRAD_CHECK(static_cast<int64_t>(out.size()) == weights_bytes(), "the buffer is weights_bytes() long");
  std::byte* at = out.data();
  for (auto& [name, tensor] : named_state()) {
    const Tensor dense = tensor.detach().cpu().contiguous();
    std::memcpy(at, dense.data_ptr(), dense.nbytes());
    at += dense.nbytes();
  }
}

Status PolicyNet::read_weights(std::span<const std::byte> in) const {
  if (static_cast<int64_t>(in.size()) != weights_bytes())
    return Error{ErrorCode::kBadFormat, "weights of " + std::to_string(in.size()) +
                                            " bytes, but this network has " +
                                            std::to_string(weights_bytes()) +
                                            "; learner and policy worker must run the same config.toml"};
  torch::NoGradGuard no_grad;
  const std::byte* at = in.data();
  for (auto& [name, tensor] : named_state()) {
    const Tensor dense = torch::empty(tensor.sizes(), tensor.options().device(torch::kCPU));
    std::memcpy(dense.data_ptr(), at, dense.nbytes());
    tensor.copy_(dense);
    at += dense.nbytes();
  }
  impl_->encoder.refresh_statistics();
  return {};
}

void PolicyNet::state_changed() const { impl_->encoder.refresh_statistics(); }

const PolicyNetOptions& PolicyNet::options() const { return impl_->options; }
torch::Device PolicyNet::device() const { return impl_->device; }

Expected<torch::Device> choose_device(const std::string& setting) {
  if (setting == "cpu") return torch::Device(torch::kCPU);
  const bool has_cuda = at::hasCUDA();
  if (setting == "auto") return torch::Device(has_cuda ? torch::kCUDA : torch::kCPU);
  int64_t index = 0;
  if (setting != "cuda") {
    constexpr std::string_view kPrefix = "cuda:";
    const char* first = setting.data() + std::min(kPrefix.size(), setting.size());
    const char* last = setting.data() + setting.size();
    const auto parsed = std::from_chars(first, last, index);
    if (!setting.starts_with(kPrefix) || parsed.ec != std::errc() || parsed.ptr != last || index < 0 ||
        index > 127)
      return Error{ErrorCode::kBadInput,
                   "device is '" + setting + "'; it may be auto, cpu, cuda or cuda:<n>"};
  }
  const int64_t count = has_cuda ? static_cast<int64_t>(at::getNumGPUs()) : 0;
  if (index >= count)
    return Error{ErrorCode::kUnsupported,
                 "device is '" + setting + "', but there are " + std::to_string(count) +
                     " CUDA devices here (or this libtorch was built without CUDA); use --device cpu"};
  return torch::Device(torch::kCUDA, static_cast<torch::DeviceIndex>(index));
}

void tune_allocator() {
  // glibc gives large blocks back to the kernel on every free; each forward pass then pays a page fault per 4
  // KiB of every activation again. Kept blocks made a pass over 128 rows about a third faster.
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, (1 << 30) + ((1 << 30) - 1));
  mallopt(M_TOP_PAD, 64 << 20);
}

void tune_math(int thread_count) {
  at::set_num_threads(thread_count);
  at::globalContext().setFlushDenormal(true);
}

}  // namespace comrad::policy
