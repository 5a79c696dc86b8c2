// Encoders from TorchScript files: what is taken, and what each fault is answered with.
#include "policy_workers/network/script_encoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/csrc/jit/api/module.h>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "tests/support/scratch_folder.h"

namespace comrad::policy {
namespace script_encoder_test {

using ::testing::AllOf;
using ::testing::HasSubstr;

class ScriptEncoders : public testing::Test {
 protected:
  /// A module of one weight [32, 3] whose forward() is `body`.
  std::string written(const std::string& body, torch::ScalarType type = torch::kFloat32) {
    torch::jit::Module module("Colours");
    torch::manual_seed(1);
    module.register_parameter("weight", torch::randn({32, 3}).to(type), /*is_buffer=*/false);
    module.define("def forward(self, frames, measurements):\n" + body);
    const std::string path = folder_.string() + "/encoder.pt";
    module.save(path);
    return path;
  }
  std::string fault(const std::string& body, torch::ScalarType type = torch::kFloat32) {
    const Status checked = check_script_encoder(written(body, type), env_);
    return checked ? "" : checked.error().message;
  }

  void SetUp() override {
    env_.head_count = 1;
    env_.head_sizes = {3};
  }

  test::ScratchFolder folder_;
  EnvShape env_;
};

constexpr const char* kGood =
    "    x = frames.float().mean([2, 3]) / 255.0\n"
    "    return torch.elu(torch.matmul(x, self.weight.t()))\n";

TEST_F(ScriptEncoders, AreTrainedLikeAnyOther) {
  const std::string path = written(kGood);
  ASSERT_TRUE(check_script_encoder(path, env_)) << check_script_encoder(path, env_).error().message;
  NetworkOptions options;
  options.encoder = path;
  options.env = env_;
  options.normalize_input = false;
  options.rnn_size = 8;
  const ActorCritic net = ActorCritic::create(options, 1, torch::kCPU);
  EXPECT_EQ(net.named_parameters().front().first, "encoder.weight");
  const int64_t rows = env_.num_agents * 2;
  const Tensor frame = torch::randint(0, 256, {4, rows, 3, 72, 128}, torch::kUInt8),
               state = torch::randn({rows, 8});
  const SequenceOutput sequence = net.sequence(frame, {}, state, {});
  Tensor before = state;
  for (int64_t step = 0; step < 4; ++step) {
    const PolicyOutput output = net.step(frame[step], {}, before);
    EXPECT_LT((output.logits - sequence.logits[step]).abs().max().item<double>(), 1e-5) << step;
    before = output.recurrent_state;
  }
  sequence.logits.square().sum().backward();
  EXPECT_GT(net.parameters().front().grad().abs().sum().item<double>(), 0);
  const ActorCritic twin = net.twin(), worker = ActorCritic::create_for_loading(options, torch::kCPU);
  {
    torch::NoGradGuard no_grad;
    net.parameters().front().add_(1);
  }
  EXPECT_FALSE(torch::equal(twin.parameters().front(), net.parameters().front()))
      << "a twin has its own weights";
  ASSERT_TRUE(worker.read_weights(net.weights()));
  EXPECT_TRUE(torch::equal(worker.parameters().front(), net.parameters().front()));
}

TEST_F(ScriptEncoders, AFaultEndsTheStartWithWhatWasExpected) {
  EXPECT_THAT(fault("    return frames.float().mean([2, 3]) / self.weight[0:1, :] * 0.0 / 0.0\n"),
              HasSubstr("returns infinity or NaN"));
  EXPECT_THAT(fault("    return torch.matmul(frames.float().mean([2, 3]), self.weight.t()).view([-1])\n"),
              AllOf(HasSubstr("for 5 rows"), HasSubstr("features float32 [5, F]")));
  EXPECT_THAT(fault("    return torch.matmul(frames.float().mean([2, 3]), self.weight.t()).double()\n"),
              HasSubstr("Double [5, 32]"));
  EXPECT_THAT(fault("    x = frames.float().mean([2, 3])\n"
                    "    return torch.matmul(x - x.mean([0]), self.weight.t())\n"),
              HasSubstr("when its batch changes"));
  EXPECT_THAT(fault("    x = frames.float().mean([2, 3])\n"
                    "    return torch.matmul(x, self.weight.t()) + torch.rand([32])\n"),
              HasSubstr("other features for the same input"));
  EXPECT_THAT(fault("    return torch.matmul(frames.float().mean([2, 3]), self.weight.detach().t())\n"),
              ::testing::Not(::testing::IsEmpty()));
  EXPECT_THAT(fault("    return torch.matmul(frames, self.weight)\n"), HasSubstr("libtorch reports"));
  const std::string product = fault("    return torch.matmul(measurements, self.weight.t())\n");
  EXPECT_THAT(product, AllOf(HasSubstr("encoder.pt failed"), HasSubstr("measurements f32 [B, 0]"),
                             HasSubstr("libtorch reports: ")));
  EXPECT_EQ(product.find('\n'), std::string::npos) << product;
  EXPECT_THAT(fault(kGood, torch::kFloat64), HasSubstr("float32 is expected"));
  folder_.write("broken.pt", "no module");
  EXPECT_THAT(check_script_encoder(folder_.string() + "/broken.pt", env_).error().message,
              AllOf(HasSubstr("broken.pt failed"), HasSubstr("comrad.export_encoder")));
}

}  // namespace script_encoder_test
}  // namespace comrad::policy
