"""PPO of Stable-Baselines3: python3 sb3.py [--game basic | --scenario lava_pit] [--steps 512]. Needs stable-baselines3 (2.9.2 was
tried), a scenario's team supersuit (3.11.0) too.

A game of ViZDoom is one Gymnasium environment. A team becomes one policy that all agents share: SuperSuit makes every agent an
environment of a vector environment, and its copies of the COMRAD environment are the others. Shows how to connect the two, not how to
learn well: PPO with the library's defaults takes hours for a scenario.
"""

import argparse

import comrad
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor


def game(name):
    return DummyVecEnv([lambda: comrad.gym_env(name, max_buttons_pressed=1, frame_skip=8, size=(64, 48))])


def team(scenario):
    import supersuit

    env = comrad.parallel_env(scenario, frame_skip=8, size=(64, 36), flat_actions=True)
    env = supersuit.pettingzoo_env_to_vec_env_v1(env)
    return supersuit.concat_vec_envs_v1(env, 2, num_cpus=1, base_class="stable_baselines3")  # two teams


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", default="basic")
    parser.add_argument("--scenario")
    parser.add_argument("--steps", type=int, default=512, help="of PPO.learn(), over all agents")
    asked = parser.parse_args()
    envs = VecMonitor(team(asked.scenario) if asked.scenario else game(asked.game))
    policy = "CnnPolicy" if asked.scenario else "MultiInputPolicy"  # a game's observation is a dictionary
    set_random_seed(1)  # PPO(seed=...) would seed the environments too, which SuperSuit's cannot be
    ppo = PPO(policy, envs, n_steps=128, batch_size=64, n_epochs=1).learn(asked.steps)
    episodes = [episode["r"] for episode in ppo.ep_info_buffer]
    print(f"{asked.scenario or asked.game}: {ppo.num_timesteps} steps, {len(episodes)} episodes ended, returns {[round(one, 1) for one in episodes[-3:]]}")
    envs.close()
