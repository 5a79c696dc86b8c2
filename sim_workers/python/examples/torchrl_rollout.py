"""A team in TorchRL: python3 torchrl_rollout.py [scenario]. Needs torchrl (0.14.1 was tried).

PettingZooWrapper takes a COMRAD environment as it is; agents stand together in one group "agent". A small network that agents share plays
a rollout past the end of an episode, and GAE is computed over it with a critic that sees both agents' pictures: what a MAPPO loss of
TorchRL starts from.
"""

import sys

import comrad
import torch
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn
from torchrl.envs import PettingZooWrapper
from torchrl.objectives.value import GAE


class Features(nn.Module):
    """Pictures u8 [..., 3, h, w] to [..., 64]."""

    def __init__(self):
        super().__init__()
        self.net = nn.Sequential(nn.Conv2d(3, 8, 8, 8), nn.ReLU(), nn.AdaptiveAvgPool2d(4), nn.Flatten(), nn.Linear(128, 64), nn.ReLU())

    def forward(self, pictures):
        return self.net(pictures.flatten(0, -4).float() / 255).unflatten(0, pictures.shape[:-3])


class DrawnChoices(nn.Module):
    """Features to a choice of each head, drawn from their logits."""

    def __init__(self, head_sizes):
        super().__init__()
        self.head_sizes, self.logits = head_sizes, nn.Linear(64, sum(head_sizes))

    def forward(self, features):
        heads = self.logits(features).split(self.head_sizes, -1)
        return torch.stack([torch.distributions.Categorical(logits=head).sample() for head in heads], -1)


class TeamValue(nn.Module):
    """Features of all agents [..., N, 64] to a value for each [..., N, 1], the same."""

    def __init__(self, agents):
        super().__init__()
        self.value = nn.Linear(64 * agents, 1)

    def forward(self, features):
        return self.value(features.flatten(-2)).unsqueeze(-2).expand(*features.shape[:-1], 1)


if __name__ == "__main__":
    scenario = sys.argv[1] if len(sys.argv) > 1 else "coop_health_gathering"
    team = comrad.parallel_env(scenario, frame_skip=50, size=(64, 36), channels_first=True)  # 1.4 s a decision: episodes are short here
    agents, head_sizes = len(team.possible_agents), team.action_space("agent_0").nvec.tolist()
    env = PettingZooWrapper(team, categorical_actions=True)
    env.set_seed(1)
    features = TensorDictModule(Features(), in_keys=[("agent", "observation")], out_keys=[("agent", "features")])
    policy = TensorDictSequential(features, TensorDictModule(DrawnChoices(head_sizes), [("agent", "features")], [("agent", "action")]))
    critic = TensorDictSequential(features, TensorDictModule(TeamValue(agents), [("agent", "features")], [("agent", "state_value")]))
    with torch.no_grad():
        rollout = env.rollout(200, policy, break_when_any_done=False)
        advantages = GAE(gamma=0.99, lmbda=0.95, value_network=critic, average_gae=False)
        advantages.set_keys(
            value=("agent", "state_value"),
            advantage=("agent", "advantage"),
            value_target=("agent", "value_target"),
            reward=("agent", "reward"),
            done=("agent", "done"),
            terminated=("agent", "terminated"),
        )
        rollout = advantages(rollout)
    ended = int(rollout["next", "done"].sum())
    print(f"{scenario}: {ended} episodes ended, pictures {tuple(rollout['agent', 'observation'].shape)}, advantages {tuple(rollout['agent', 'advantage'].shape)}")
    env.close()
