"""PPO in a hundred lines on a ViZDoom game: python3 ppo.py [--game basic] [--decisions 80000]

Proximal policy optimisation (Schulman et al. 2017, equation 7) with generalised advantages (Schulman et al. 2016), on pictures of
64x48. Prints the mean return of episodes as it goes, and at the end that of random play and of the trained policy.

What it reaches: with the defaults, 40 s on one core of an AMD EPYC (PyTorch 2.13, OMP_NUM_THREADS=1; minutes where other programs share
the core), mean returns in `basic` of -44, -47 and -93 with the seeds 1, 2 and 3, over 48 episodes; random play has -165. A good player's
return is positive, so these policies still miss often: a beginning to change, not a result to compare with.
"""

import argparse

import comrad
import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

ENVS, STEPS, EPOCHS, BATCH = 16, 64, 3, 256
GAMMA, LAMBDA, CLIP, ENTROPY, RATE = 0.99, 0.95, 0.2, 0.01, 5e-4


class ActorCritic(nn.Module):
    def __init__(self, choices):
        super().__init__()
        self.body = nn.Sequential(nn.Conv2d(3, 16, 8, 4), nn.ReLU(), nn.Conv2d(16, 32, 4, 2), nn.ReLU(), nn.Flatten(), nn.Linear(32 * 4 * 6, 128), nn.ReLU())
        self.actor, self.critic = nn.Linear(128, choices), nn.Linear(128, 1)
        nn.init.orthogonal_(self.actor.weight, 0.01)

    def forward(self, pictures):
        features = self.body(pictures.float() / 255)
        return Categorical(logits=self.actor(features)), self.critic(features)[:, 0]


def make(game, seed):
    # One head with every button: choice 0 presses nothing.
    buttons = ",".join(button for head in comrad.describe(game)["heads"] for button in head)
    envs = comrad.vector_env(game, num_agents=1, num_envs=ENVS, heads=buttons, size=(64, 48), channels_first=True)
    return envs, torch.from_numpy(envs.reset(seed=seed)[0])


def score(game, choose, episodes=48, seed=1000):
    """Mean return of the first episodes to end."""
    envs, pictures = make(game, seed)
    ended = []
    while len(ended) < episodes:
        pictures, _, _, _, infos = envs.step(choose(torch.from_numpy(np.asarray(pictures)))[:, None])
        if "episode_return" in infos:
            ended += infos["episode_return"][infos["_episode_return"]].tolist()
    envs.close()
    return float(np.mean(ended[:episodes]))


def train(game, decisions, seed=1):
    torch.manual_seed(seed)
    envs, picture = make(game, seed)
    net = ActorCritic(int(envs.single_action_space.nvec[0]))
    adam = torch.optim.Adam(net.parameters(), RATE, eps=1e-5)
    was_over, returns = torch.zeros(ENVS), []
    for update in range(decisions // (ENVS * STEPS)):
        pictures, actions, logs, values, rewards, overs, counts = [], [], [], [], [], [], []
        for _ in range(STEPS):
            with torch.no_grad():
                policy, value = net(picture)
            action = policy.sample()
            seen, reward, terminated, truncated, infos = envs.step(action.numpy()[:, None])
            pictures.append(picture), actions.append(action), logs.append(policy.log_prob(action)), values.append(value)
            rewards.append(torch.from_numpy(reward).float() / 100), counts.append(1 - was_over)  # a step that begins an episode teaches nothing
            was_over = torch.from_numpy(terminated | truncated).float()
            overs.append(was_over)
            picture = torch.from_numpy(seen)
            if "episode_return" in infos:
                returns += infos["episode_return"][infos["_episode_return"]].tolist()
        with torch.no_grad():
            value = net(picture)[1]
        advantage, advantages = torch.zeros(ENVS), [None] * STEPS
        for step in reversed(range(STEPS)):
            error = rewards[step] + GAMMA * value * (1 - overs[step]) - values[step]
            advantage = (error + GAMMA * LAMBDA * (1 - overs[step]) * advantage) * counts[step]
            advantages[step], value = advantage, values[step]
        keep = torch.cat(counts) > 0
        x, a, log, adv, v = (torch.cat(one)[keep] for one in (pictures, actions, logs, advantages, values))
        target, adv = adv + v, (adv - adv.mean()) / (adv.std() + 1e-8)
        for part in torch.cat([torch.randperm(len(x)) for _ in range(EPOCHS)]).split(BATCH):
            policy, value = net(x[part])
            ratio = (policy.log_prob(a[part]) - log[part]).exp()
            gain = torch.min(ratio * adv[part], ratio.clamp(1 - CLIP, 1 + CLIP) * adv[part]).mean()
            loss = -gain + 0.5 * (value - target[part]).square().mean() - ENTROPY * policy.entropy().mean()
            adam.zero_grad(), loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 0.5)
            adam.step()
        if update % 10 == 9:
            print(f"{(update + 1) * ENVS * STEPS:8} decisions, return {np.mean(returns[-50:]):8.2f}", flush=True)
    envs.close()
    return net


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", default="basic")
    parser.add_argument("--decisions", type=int, default=80_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    net = train(asked.game, asked.decisions, asked.seed)
    rng = np.random.default_rng(1)
    choices = net.actor.out_features
    print(f"random  {score(asked.game, lambda pictures: rng.integers(choices, size=len(pictures))):8.2f}")
    with torch.no_grad():
        print(f"trained {score(asked.game, lambda pictures: net(pictures)[0].probs.argmax(1).numpy()):8.2f}")
