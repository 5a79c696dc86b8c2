"""BenchMARL's MAPPO on a team for two iterations, its critic on state(), for libraries_test.py: benchmarl_plays.py SCRATCH_FOLDER"""

import sys

import comrad
from benchmarl.algorithms import MappoConfig
from benchmarl.environments.common import Task
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models import CnnConfig, MlpConfig
from torch import nn
from torchrl.envs import PettingZooWrapper


class ComradTask(PettingZooClass):
    """A scenario of COMRAD: its pictures, and state() as the global state."""

    def get_env_fun(self, num_envs, continuous_actions, seed, device):
        return lambda: PettingZooWrapper(
            comrad.parallel_env(dtype="float32", flat_actions=True, **self.config), return_state=True, categorical_actions=True, seed=seed, device=device)

    def supports_continuous_actions(self):
        return False

    def supports_discrete_actions(self):
        return True

    def has_state(self):
        return True

    def has_render(self, env):
        return False

    def max_steps(self, env):
        return 200

    @staticmethod
    def env_name():
        return "comrad"


class ComradTasks(Task):
    COOP_HEALTH_GATHERING = None

    @staticmethod
    def associated_class():
        return ComradTask


config = ExperimentConfig.get_from_yaml()
config.max_n_frames, config.max_n_iters, config.loggers, config.evaluation, config.create_json = None, 2, [], False, False
config.on_policy_collected_frames_per_batch, config.on_policy_n_envs_per_worker = 200, 1
config.on_policy_minibatch_size, config.on_policy_n_minibatch_iters = 100, 1
config.save_folder = sys.argv[1]
experiment = Experiment(
    task=ComradTasks.COOP_HEALTH_GATHERING.get_task({"scenario": "coop_health_gathering", "frame_skip": 50, "size": (64, 36)}),
    algorithm_config=MappoConfig.get_from_yaml(),
    model_config=CnnConfig(cnn_num_cells=[8, 8], cnn_kernel_sizes=4, cnn_strides=4, cnn_paddings=0, cnn_activation_class=nn.Tanh,
                           mlp_num_cells=[32], mlp_layer_class=nn.Linear, mlp_activation_class=nn.Tanh),
    critic_model_config=MlpConfig(num_cells=[32], layer_class=nn.Linear, activation_class=nn.Tanh),
    seed=1,
    config=config,
)
experiment.run()
print(f"BenchMARL: {experiment.n_iters_performed} iterations, {experiment.total_frames} steps")
