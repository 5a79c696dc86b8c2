// Encoders from layers: any stack, by the kernels of the CPU where they fit and by operators elsewhere, and how one is added.
#include "policy_workers/network/layer_encoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/pixel_path.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/settings/encoder_layers.h"
#include "rollout_buffer/settings/layers.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/policy_workers/network/made_encoder.h"

namespace comrad::policy {
namespace layer_encoder_test {

using ::testing::HasSubstr;
using ::testing::StartsWith;

EnvShape small_frames() {
  EnvShape env;
  env.height = 40;
  env.width = 44;
  env.measurement_count = 2;
  return env;
}

std::shared_ptr<const Encoder> encoder_of(const EnvShape& env, const std::string& layers) {
  const MadeEncoder made = made_encoder(env, layers);
  torch::manual_seed(3);
  made.update_statistics(torch::randint(0, 256, {20, env.frame_bytes()}, torch::kUInt8), {});
  return made.encoder;
}

struct Pass {
  Tensor features;
  std::vector<Tensor> gradients;
};
Pass pass_of(const Encoder& encoder, const Tensor& frame, const Tensor& measurement) {
  for (auto& [name, parameter] : encoder.named_parameters())
    if (parameter.grad().defined()) parameter.mutable_grad().zero_();
  Pass pass{encoder.forward(frame, measurement), {}};
  torch::manual_seed(5);
  (pass.features * torch::randn_like(pass.features)).sum().backward();
  for (auto& [name, parameter] : encoder.named_parameters())
    pass.gradients.push_back(parameter.grad().clone());
  return pass;
}

/// A stack of convolutions of random sizes that frames of 40 x 44 are large enough for.
std::string random_stack(std::mt19937& random) {
  const auto from = [&](int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); };
  std::string layers;
  for (int conv = from(2, 3); conv > 0; --conv)
    layers += "conv " + std::to_string(8 * from(1, 3)) + " " +
              [&] {
                const std::string size = std::to_string(from(1, 4));
                return size + "x" + size;
              }() +
              "/" + std::to_string(from(1, 2)) + ", ";
  return layers + "flatten, linear " + std::to_string(from(1, 40));
}

TEST(LayerEncoder, KernelsEqualOperatorsOnRandomShapesForwardAndBackward) {
  const EnvShape env = small_frames();
  std::mt19937 random(11);
  for (int round = 0; round < 8; ++round) {
    const std::string layers = round == 0 ? "simple" : random_stack(random);
    const std::shared_ptr<const Encoder> encoder = encoder_of(env, layers);
    EXPECT_EQ(encoder->implementation(), "oneDNN convolutions") << layers;
    const Tensor frame = torch::randint(0, 256, {70, 3, 40, 44}, torch::kUInt8),  // more than one chunk
        measurement = torch::randn({70, 2});
    const Pass kernels = pass_of(*encoder, frame, measurement);
    const device::OperatorPath as_on_a_gpu;
    EXPECT_EQ(encoder->implementation(), "operators");
    const Pass operators = pass_of(*encoder, frame, measurement);
    EXPECT_TRUE(torch::allclose(kernels.features, operators.features, 1e-4, 1e-5)) << layers;
    for (std::size_t i = 0; i < kernels.gradients.size(); ++i) {
      const double scale = operators.gradients[i].abs().max().item<double>();
      EXPECT_LE((kernels.gradients[i] - operators.gradients[i]).abs().max().item<double>(), 1e-4 * scale)
          << layers << " " << encoder->named_parameters()[i].first;
    }
  }
}

TEST(LayerEncoder, AnyLayersEqualTheSameLayersWrittenOut) {
  const EnvShape env = small_frames();
  const std::string layers =
      "conv 8 3x3/2 pad 1 relu, layernorm, pool 3x3/2 pad 1, residual, conv 6 3x3 none, gelu, flatten, "
      "layernorm, "
      "linear 20 tanh, linear 9 silu";
  const std::shared_ptr<const Encoder> encoder = encoder_of(env, layers);
  EXPECT_EQ(encoder->implementation(), "operators in chunks");
  EXPECT_EQ(encoder->feature_count(), 9 + 128);
  std::vector<std::string> names;
  std::map<std::string, Tensor> p;
  for (const auto& [name, tensor] : encoder->named_parameters()) {
    names.push_back(name);
    p[name.substr(std::string("encoder.").size())] = tensor.detach();
  }
  EXPECT_THAT(
      names, ::testing::ElementsAre(
                 "encoder.conv1.weight", "encoder.conv1.bias", "encoder.norm1.weight", "encoder.norm1.bias",
                 "encoder.conv2.weight", "encoder.conv2.bias", "encoder.conv3.weight", "encoder.conv3.bias",
                 "encoder.conv4.weight", "encoder.conv4.bias", "encoder.norm2.weight", "encoder.norm2.bias",
                 "encoder.image.weight", "encoder.image.bias", "encoder.image2.weight", "encoder.image2.bias",
                 "encoder.measurement1.weight", "encoder.measurement1.bias", "encoder.measurement2.weight",
                 "encoder.measurement2.bias"));
  const Tensor frame = torch::randint(0, 256, {40, 3, 40, 44}, torch::kUInt8),
               measurement = torch::randn({40, 2});
  torch::NoGradGuard no_grad;
  EnvShape pixels_only = env;
  pixels_only.measurement_count = 0;
  // flatten alone is the normalised frame.
  Tensor x = encoder_of(pixels_only, "flatten")->forward(frame, {}).view({40, 3, 40, 44});
  const auto conv = [&](const Tensor& input, const std::string& name, int64_t stride, int64_t padding) {
    return at::conv2d(input, p[name + ".weight"], p[name + ".bias"], stride, padding);
  };
  x = at::relu(conv(x, "conv1", 2, 1));
  x = at::layer_norm(x, x.sizes().slice(1), p["norm1.weight"], p["norm1.bias"]);
  x = at::max_pool2d(x, 3, 2, 1);
  x = x + conv(at::elu(conv(at::elu(x), "conv2", 1, 1)), "conv3", 1, 1);
  x = at::gelu(conv(x, "conv4", 1, 0)).flatten(1);
  x = at::layer_norm(x, x.sizes().slice(1), p["norm2.weight"], p["norm2.bias"]);
  x = at::silu(at::linear(at::tanh(at::linear(x, p["image.weight"], p["image.bias"])), p["image2.weight"],
                          p["image2.bias"]));
  const Tensor features = encoder->forward(frame, measurement);
  EXPECT_LT((features.slice(1, 0, 9) - x).abs().max().item<double>(), 1e-5);
  std::vector<const uint8_t*> rows = rows_of(frame);
  EXPECT_LT((encoder->forward_rows(rows, measurement) - features).abs().max().item<double>(), 1e-5);
}

// Adding an encoder as policy_workers/ENCODERS.md describes.

TEST(AddingAnEncoder, LayersInAFileOfSettingsAreTrainedWithoutCode) {
  const test::ScratchFolder folder;
  const std::string file =
      folder.write("small.toml",
                   "[network]\n"
                   "encoder = [\"conv 16 8x8/4\", \"conv 32 4x4/2\", \"flatten\", \"linear 256\"]\n"
                   "core = \"gru 256\"\n"
                   "decoder = [128]\n");
  RunConfig config;
  const Expected<SettingsLayer> layer = read_settings_toml(file);
  ASSERT_TRUE(layer) << layer.error().message;
  ASSERT_TRUE(apply_layer(config, *layer));
  EnvShape env;
  env.num_agents = 2;
  const ActorCritic net = ActorCritic::create(NetworkOptions::from(config, env), 1, torch::kCPU);
  EXPECT_THAT(
      net.description(),
      StartsWith(
          "encoder conv 16 8x8/4, conv 32 4x4/2, flatten, linear 256 by oneDNN convolutions, gru of 256"));
  for (const auto& [name, tensor] : net.named_parameters()) {
    if (name == "encoder.image.weight") {
      EXPECT_EQ(tensor.size(0), 256);
    }
    if (name == "core.weight_hh_l0") {
      EXPECT_EQ(tensor.size(1), 256);
    }
    if (name == "action_head.weight") {
      EXPECT_EQ(tensor.size(1), 128);
    }
  }
}

/// The mean of each colour plane, weighed: three features.
class MeanColour : public Encoder {
 public:
  MeanColour(const EncoderInput& input, const LayerMaker& make)
      : Encoder(input.env, make.device), colour_(make("colour", {3, 3})) {}
  Tensor forward(const Tensor& frame, const Tensor&) const override {
    return colour_(frame.to(device_, torch::kFloat32).mean({2, 3}) / 255);
  }
  int64_t feature_count() const override { return 3; }
  NamedTensors named_parameters() const override {
    NamedTensors named;
    append(named, "encoder.", colour_);
    return named;
  }
  std::string implementation() const override { return "operators"; }

 private:
  Layer colour_;
};

TEST(AddingAnEncoder, AClassInCppIsKnownByItsName) {
  RunConfig config;
  config.network.encoder = "mean_colour";
  EnvShape env;
  EXPECT_FALSE(check_encoder("mean_colour", env));
  add_encoder("mean_colour",
              [](const EncoderInput& input, const LayerMaker& make) -> std::shared_ptr<const Encoder> {
                return std::make_shared<MeanColour>(input, make);
              });
  EXPECT_TRUE(check_encoder("mean_colour", env));
  const ActorCritic net = ActorCritic::create(NetworkOptions::from(config, env), 1, torch::kCPU);
  EXPECT_GE(net.weights_bytes(), 4 * net.parameter_count());
  const int64_t agents = env.num_agents;
  const PolicyOutput output =
      net.step(torch::zeros({agents, 3, 72, 128}, torch::kUInt8), {}, torch::zeros({agents, 512}));
  EXPECT_EQ(output.logits.size(0), agents);
}

TEST(CheckEncoder, NamesWhatIsWrong) {
  EXPECT_THAT(check_encoder("vit", {}).error().message,
              HasSubstr("encoder is vit; it must be one of simple, impala"));
  EXPECT_THAT(check_encoder("simpel", {}).error().message, HasSubstr("did you mean 'simple'"));
  EXPECT_THAT(check_encoder("/nowhere/vit.pt", {}).error().message,
              HasSubstr("/nowhere/vit.pt: no such file"));
}

}  // namespace layer_encoder_test
}  // namespace comrad::policy
