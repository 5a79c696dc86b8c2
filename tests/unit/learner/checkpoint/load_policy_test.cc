// comrad.load_policy and comrad.save_policy of the Python package: their logits are the network's own, over several steps, for
// every kind of network, and what they write is read here. Skipped without PyTorch or without the package.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>
#include <variant>
#include <vector>

#include "learner/checkpoint/architecture.h"
#include "learner/checkpoint/checkpoint.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/run_config.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/test_python.h"

namespace comrad::learn {
namespace load_policy_test {

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
  bool layer_norm = false;
};

/// A checkpoint of a network of that kind, with "expected": frame [steps, rows, 3, 72, 128], measurement, logits.
StateDict checkpoint_with_answers(const Variant& variant) {
  RunConfig config;
  config.run.algo = variant.algo;
  config.network.encoder = variant.encoder;
  config.network.use_rnn = variant.use_rnn;
  config.network.rnn_type = variant.rnn_type;
  config.network.rnn_size = 24;
  config.network.rnn_num_layers = variant.layers;
  config.network.decoder_mlp_layers = variant.decoder;
  config.network.agent_id_input = variant.agent_id;
  config.network.normalize_input = variant.normalize;
  config.network.q_layer_norm = variant.layer_norm;
  EnvShape env;
  env.num_agents = 2;
  env.head_count = 3;
  env.head_sizes = {3, 2, 4};
  env.measurement_count = static_cast<int32_t>(variant.measurements);
  config.environment.num_agents = env.num_agents;
  const auto options = policy::NetworkOptions::from(config, env);
  const policy::ActorCritic net = policy::ActorCritic::create(options, 7, torch::kCPU);

  const int64_t rows = kWorlds * env.num_agents;
  const torch::Tensor frame =
      torch::randint(0, 256, {kSteps, rows, env.channels, env.height, env.width}, torch::kUInt8);
  torch::Tensor measurement;
  if (env.measurement_count > 0) measurement = torch::randn({kSteps, rows, kMeasurements});
  net.update_input_statistics(frame.flatten(0, 1),
                              measurement.defined() ? measurement.flatten(0, 1) : measurement);

  if (variant.layer_norm) {
    torch::NoGradGuard no_grad;
    for (const auto& [name, tensor] : net.named_parameters())
      if (name.find("norm") != std::string::npos) tensor.add_(torch::randn_like(tensor), 0.3);
  }
  StateDict state;
  for (const auto& [name, tensor] : net.named_state()) state.put("network/" + name, tensor);
  state.put("config/toml", settings_to_toml(config));
  state.put_all(architecture_of(config).value());
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
  return state;
}

/// What is written back differs from `state` in the action head's bias alone.
void expect_changed_biases(const StateDict& state, const StateDict& written) {
  ASSERT_EQ(written.values().size(), state.values().size());
  int changed = 0;
  for (const auto& [key, value] : state.values()) {
    const auto* before = std::get_if<torch::Tensor>(&value);
    if (const auto* text = std::get_if<std::string>(&value)) {
      EXPECT_EQ(written.text(key).value(), *text) << key;
    }
    if (before == nullptr) continue;
    const torch::Tensor after = written.tensor(key).value();
    const double more = (after.to(torch::kFloat64) - before->to(torch::kFloat64)).abs().max().item<double>();
    if (key.ends_with("action_head.bias")) {
      // Of a shared network the policy that is given last counts.
      EXPECT_NEAR(more, key.find("agent0.") == std::string::npos ? 2.0 : 1.0, 1e-6) << key;
      ++changed;
    } else {
      EXPECT_EQ(more, 0) << key;
    }
  }
  EXPECT_GT(changed, 0);
}

constexpr Variant kVariants[] = {
    {"shared_gru", "ippo", "simple", true, RnnType::kGru, 1, "none", false, true, 3},
    {"feed_forward_with_agent_id", "ippo", "impala", false, RnnType::kGru, 1, "none", true, true, 0},
    {"two_lstm_layers_and_a_decoder", "mappo", "atari", true, RnnType::kLstm, 2, "32,16", true, false, 0},
    {"agents_with_networks_of_their_own", "happo", "simple", true, RnnType::kGru, 1, "none", false, true, 3},
    {"q_values", "qmix", "simple", true, RnnType::kGru, 1, "none", false, true, 0},
    {"normalised_q_values", "vdn", "impala", true, RnnType::kGru, 1, "32,16", true, true, 3, true},
    {"normalised_feed_forward", "idqn", "simple_half", false, RnnType::kGru, 1, "none", false, true, 0, true},
    {"resnet", "ippo", "resnet", true, RnnType::kGru, 1, "none", false, true, 0},
    {"layers", "ippo",
     "conv 8 8x8/4 relu, layernorm, pool 3x3/2 pad 1, residual, flatten, linear 40 gelu, layernorm, linear "
     "24 none, tanh",
     true, RnnType::kGru, 1, "none", false, true, 3}};

TEST(LoadPolicy, GivesTheNetworksLogitsAndGoesBack) {
  std::error_code ignored;  // this test lies in <build>/tests
  const auto build = std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path().parent_path();
  setenv("PYTHONPATH", (build / "python").c_str(), 1);
  const Expected<std::string> python = test::python_with("torch, comrad");
  if (!python) GTEST_SKIP() << python.error().message;

  const test::ScratchFolder folder;
  std::vector<StateDict> states;
  for (const Variant& variant : kVariants) {
    states.push_back(checkpoint_with_answers(variant));
    ASSERT_TRUE(write_checkpoint((folder / variant.name).string(), states.back()));
  }
  folder.write("compare.py", R"(
import sys, torch, comrad
for path in sys.argv[1:]:
    expected = torch.load(path, weights_only=True)["expected"]
    policies = [comrad.load_policy(path, agent) for agent in range(2)]
    for agent, policy in enumerate(policies):
        state, rows = None, slice(agent, None, 2)
        with torch.no_grad():
            for step, frame in enumerate(expected["frame"]):
                measurement = expected["measurement"][step][rows] if "measurement" in expected else None
                logits, state = policy(frame[rows], measurement, state)
                wanted = expected["logits"][step][rows]
                assert wanted.abs().max() > 0.01, path
                assert (logits - wanted).abs().max() < 1e-4, (path, agent, step, logits, wanted)
                choice = policy.greedy(logits, [3, 2, 4])
                assert choice.tolist() == [[int(h.argmax()) for h in row.split([3, 2, 4])] for row in wanted], path
                assert (policy.sample(logits, [3, 2, 4]) < torch.tensor([3, 2, 4])).all(), path
            policy.action_head.bias.add_(1.0 + agent)
    comrad.save_policy(policies, path, path + ".back")
)");
  std::string command = *python + " " + (folder / "compare.py").string();
  for (const Variant& variant : kVariants) command += " " + (folder / variant.name).string();
  ASSERT_EQ(std::system(command.c_str()), 0);

  for (std::size_t i = 0; i < states.size(); ++i) {
    SCOPED_TRACE(kVariants[i].name);
    const Expected<StateDict> written = read_checkpoint((folder / kVariants[i].name).string() + ".back");
    ASSERT_TRUE(written) << written.error().message;
    expect_changed_biases(states[i], *written);
  }
}

}  // namespace load_policy_test
}  // namespace comrad::learn
