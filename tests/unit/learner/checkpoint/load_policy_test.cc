// learner/checkpoint/load_policy.py is the example that CHECKPOINTS.md shows to users of Python: its logits must be the
// network's own, over several steps, for every kind of network that it says it reads. Without PyTorch it is skipped.
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "learner/checkpoint/checkpoint.h"
#include "policy_workers/policy/policy_net.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/run_config.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/test_python.h"

namespace comrad::learn {
namespace {

constexpr int64_t kSteps = 4, kWorlds = 3, kMeasurements = 3;

struct Variant {
  const char* name;
  const char* algo;
  const char* encoder;
  bool use_rnn;
  RnnType rnn_type;
  int64_t layers;
  const char* decoder;
  bool agent_id;
  bool normalize;
  int64_t measurements;
};

class LoadPolicy : public testing::TestWithParam<Variant> {};

TEST_P(LoadPolicy, GivesTheNetworksLogits) {
  const Expected<std::string> python = test::python_with("torch");
  if (!python) GTEST_SKIP() << python.error().message;

  RunConfig config;
  config.run.algo = GetParam().algo;
  config.network.encoder_conv_architecture = GetParam().encoder;
  config.network.use_rnn = GetParam().use_rnn;
  config.network.rnn_type = GetParam().rnn_type;
  config.network.rnn_size = 24;
  config.network.rnn_num_layers = GetParam().layers;
  config.network.decoder_mlp_layers = GetParam().decoder;
  config.network.agent_id_input = GetParam().agent_id;
  config.network.normalize_input = GetParam().normalize;
  EnvShape env;
  env.num_agents = 2;
  env.head_count = 3;
  env.head_sizes = {3, 2, 4};
  env.measurement_count = static_cast<int32_t>(GetParam().measurements);
  const auto options = policy::PolicyNetOptions::from(config, env);
  const policy::PolicyNet net = policy::PolicyNet::create(options, 7, torch::kCPU);

  const int64_t rows = kWorlds * env.num_agents;
  const torch::Tensor frame =
      torch::randint(0, 256, {kSteps, rows, env.channels, env.height, env.width}, torch::kUInt8);
  torch::Tensor measurement;
  if (env.measurement_count > 0) measurement = torch::randn({kSteps, rows, kMeasurements});
  net.update_input_statistics(frame.flatten(0, 1),
                              measurement.defined() ? measurement.flatten(0, 1) : measurement);

  StateDict state;
  for (const auto& [name, tensor] : net.named_state()) state.put("network/" + name, tensor);
  state.put("config/toml", settings_to_toml(config));
  state.put("expected/frame", frame);
  if (measurement.defined()) state.put("expected/measurement", measurement);
  torch::Tensor recurrent = torch::zeros({rows, options.recurrent_state_count()});
  std::vector<torch::Tensor> logits;
  for (int64_t step = 0; step < kSteps; ++step) {
    const policy::PolicyOutput output =
        net.step(frame[step], measurement.defined() ? measurement[step] : measurement, recurrent);
    logits.push_back(output.logits);
    recurrent = output.recurrent_state;
  }
  state.put("expected/logits", torch::stack(logits));

  const test::ScratchFolder folder;
  ASSERT_TRUE(write_checkpoint((folder / "a.pt").string(), state));
  folder.write("compare.py", R"(
import sys, torch
sys.path.insert(0, sys.argv[1])
from load_policy import Policy, greedy
expected = torch.load(sys.argv[2], weights_only=True)["expected"]
for agent in range(2):
    policy, state, rows = Policy(sys.argv[2], agent), None, slice(agent, None, 2)
    for step, frame in enumerate(expected["frame"]):
        measurement = expected["measurement"][step][rows] if "measurement" in expected else None
        logits, state = policy.step(frame[rows], measurement, state)
        wanted = expected["logits"][step][rows]
        assert wanted.abs().max() > 0.01
        assert (logits - wanted).abs().max() < 1e-4, (agent, step, logits, wanted)
        choice = greedy(logits, [3, 2, 4])
        assert choice.tolist() == [[int(h.argmax()) for h in row.split([3, 2, 4])] for row in wanted]
)");
  const std::string command = *python + " " + (folder / "compare.py").string() + " " + COMRAD_SOURCE_DIR +
                              "/learner/checkpoint " + (folder / "a.pt").string();
  EXPECT_EQ(std::system(command.c_str()), 0);
}

INSTANTIATE_TEST_SUITE_P(, LoadPolicy,
                         testing::Values(Variant{"shared_gru", "ippo", "convnet_simple", true, RnnType::kGru,
                                                 1, "none", false, true, 3},
                                         Variant{"feed_forward_with_agent_id", "ippo", "convnet_impala",
                                                 false, RnnType::kGru, 1, "none", true, true, 0},
                                         Variant{"two_lstm_layers_and_a_decoder", "mappo", "convnet_atari",
                                                 true, RnnType::kLstm, 2, "32,16", true, false, 0},
                                         Variant{"agents_with_networks_of_their_own", "happo",
                                                 "convnet_simple", true, RnnType::kGru, 1, "none", false,
                                                 true, 3},
                                         Variant{"q_values", "qmix", "convnet_simple", true, RnnType::kGru, 1,
                                                 "none", false, true, 0}),
                         [](const auto& variant) { return std::string(variant.param.name); });

}  // namespace
}  // namespace comrad::learn
