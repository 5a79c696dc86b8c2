"""RLlib's PPO on a team for two iterations, for libraries_test.py: rllib_plays.py SCRATCH_FOLDER"""

import sys

import comrad
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env


def make(_):
    return ParallelPettingZooEnv(comrad.parallel_env("coop_health_gathering", frame_skip=50, size=(64, 36), dtype="float32", flat_actions=True))


ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, object_store_memory=100 << 20, _temp_dir=sys.argv[1])
register_env("team", make)
config = (
    PPOConfig()
    .environment("team")
    .multi_agent(policies={"shared"}, policy_mapping_fn=lambda *_, **__: "shared")
    .env_runners(num_env_runners=0)
    .training(train_batch_size_per_learner=200, minibatch_size=64, num_epochs=1)
    .rl_module(model_config=DefaultModelConfig(conv_filters=[[16, 8, 4], [32, 4, 2]]))
)
algorithm = config.build_algo()
episodes = 0
for _ in range(2):
    episodes += algorithm.train()["env_runners"].get("num_episodes", 0)
algorithm.stop()
ray.shutdown()
print(f"RLlib: 2 iterations, {episodes:.0f} episodes ended")
