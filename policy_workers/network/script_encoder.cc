#include "policy_workers/network/script_encoder.h"

#include <spdlog/fmt/fmt.h>
#include <torch/csrc/jit/api/module.h>
#include <torch/csrc/jit/runtime/graph_executor.h>
#include <torch/csrc/jit/serialization/import.h>

#include <algorithm>
#include <exception>
#include <filesystem>

#include "policy_workers/device/shape_text.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/settings/encoder_layers.h"

namespace comrad::policy {
namespace {

constexpr double kRowTolerance = 1e-3;

class ScriptEncoder : public Encoder {
 public:
  ScriptEncoder(const std::string& path, const EnvShape& env, torch::Device device)
      : Encoder(env, device), module_(torch::jit::load(path, device)) {
    module_.eval();
    for (const auto& parameter : module_.named_parameters())
      parameters_.emplace_back("encoder." + parameter.name, parameter.value.requires_grad_());
  }

  Tensor forward(const Tensor& frame, const Tensor& measurement) const override {
    const int64_t rows = frame.size(0);
    const Tensor bytes = frame.reshape({rows, env_.channels, env_.height, env_.width}).to(device_);
    const Tensor numbers = env_.measurement_count > 0
                               ? measurement.reshape({rows, env_.measurement_count}).to(device_)
                               : torch::zeros({rows, 0}, torch::TensorOptions(device_));
    // An optimised graph rounds otherwise from its third call on, and step() must stay equal to sequence().
    const torch::jit::GraphOptimizerEnabledGuard as_written(false);
    return torch::jit::Module(module_).forward({bytes, numbers}).toTensor();
  }

  int64_t feature_count() const override { return feature_count_; }
  NamedTensors named_parameters() const override { return parameters_; }
  std::string implementation() const override { return "TorchScript"; }

  /// Asked of the module once; forward() throws what TorchScript throws.
  void count_features() {
    torch::NoGradGuard no_grad;
    feature_count_ = try_rows(1).size(1);
  }

  /// Features of rows of fixed noise.
  Tensor try_rows(int64_t rows) const {
    at::Generator generator = at::make_generator<at::CPUGeneratorImpl>(uint64_t{7});
    const Tensor frame =
        at::randint(0, 256, {rows, env_.channels, env_.height, env_.width}, generator, torch::kUInt8);
    return forward(frame, at::randn({rows, env_.measurement_count}, generator, torch::kFloat32));
  }

 private:
  torch::jit::Module module_;
  NamedTensors parameters_;
  int64_t feature_count_ = 0;
};

/// What is wrong with the module; empty where nothing is.
std::string fault_of(const ScriptEncoder& encoder) {
  const NamedTensors parameters = encoder.named_parameters();
  if (parameters.empty()) return "has no parameters; one that learns is expected";
  for (const auto& [name, tensor] : parameters)
    if (tensor.scalar_type() != torch::kFloat32)
      return "has the parameter " + name.substr(name.find('.') + 1) + " of " + device::shape_text(tensor) +
             "; float32 is expected";
  const Tensor features = encoder.try_rows(5);
  if (features.scalar_type() != torch::kFloat32 || features.dim() != 2 || features.size(0) != 5 ||
      features.size(1) < 1 || features.size(1) > kEncoderFeaturesMax)
    return fmt::format("returns {} for 5 rows; features float32 [5, F], F up to {}, are expected",
                       device::shape_text(features), kEncoderFeaturesMax);
  if (!torch::isfinite(features).all().item<bool>())
    return "returns infinity or NaN for random bytes; finite features are expected (divide frames by 255)";
  if (!torch::equal(encoder.try_rows(5), features))
    return "returns other features for the same input; leave out dropout and noise";
  const Tensor fewer = encoder.try_rows(2);
  if (fewer.size(1) != features.size(1))
    return "returns " + device::shape_text(fewer) + " for 2 rows and " + device::shape_text(features) +
           " for 5; the same number of features is expected";
  const double moved = (fewer[0] - features[0]).abs().max().item<double>();
  if (moved > kRowTolerance * (1 + features[0].abs().max().item<double>()))
    return "returns other features for a row when its batch changes; normalise within a row (LayerNorm), not "
           "over "
           "the batch (BatchNorm)";
  (features * torch::randn_like(features)).sum().backward();
  for (const auto& [name, tensor] : parameters) {
    const std::string own = name.substr(name.find('.') + 1);
    if (!tensor.grad().defined())
      return "gives its parameter " + own + " no gradient; use it in forward(), or leave it out";
    if (!torch::isfinite(tensor.grad()).all().item<bool>())
      return "gives its parameter " + own + " a gradient of infinity or NaN";
  }
  return "";
}

}  // namespace

std::shared_ptr<const Encoder> make_script_encoder(const EncoderInput& input, const LayerMaker& make) {
  auto encoder = std::make_shared<ScriptEncoder>(input.encoder, input.env, make.device);
  encoder->count_features();
  return encoder;
}

Status check_script_encoder(const std::string& path, const EnvShape& env) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored))
    return Error{ErrorCode::kNotFound,
                 "encoder " + path + ": no such file; comrad.export_encoder(module, path) writes one"};
  const auto refuse = [&path](const std::string& why) {
    return Error{ErrorCode::kBadFormat, "encoder " + path + " " + why};
  };
  try {
    const torch::AutoGradMode with_gradient(true);
    const ScriptEncoder encoder(path, env, torch::kCPU);
    if (const std::string fault = fault_of(encoder); !fault.empty()) return refuse(fault);
  } catch (const std::exception& error) {
    // One line: TorchScript's reports have one for every frame of its interpreter, and the last contains the cause.
    std::string what = error.what();
    what.resize(std::min(what.find("\nException raised from"), what.size()));
    what.resize(what.find_last_not_of(" \n") + 1);
    what.erase(0, what.rfind('\n') + 1);
    return refuse(fmt::format(
        "failed, where a TorchScript module of frames u8 [B, {}, {}, {}] and measurements f32 [B, {}] to "
        "features f32 [B, F] is expected; write it with comrad.export_encoder. libtorch reports: {}",
        env.channels, env.height, env.width, env.measurement_count, what));
  }
  return {};
}

}  // namespace comrad::policy
