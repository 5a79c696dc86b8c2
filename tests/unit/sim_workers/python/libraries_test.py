#!/usr/bin/env python3
"""Libraries that train on the environments: each plays past an episode's end; the PPO of examples/ learns.

    PYTHONPATH=build/python libraries_test.py FOLDER [unittest arguments]

RLlib and BenchMARL get their own environments in FOLDER (some 500 MB), beside the packages of this Python. A case is skipped in a
line where pip cannot get its library, or where it is missing; ends with 77 where nothing could be played.
"""

import importlib.metadata
import importlib.util
import pathlib
import re
import subprocess
import sys
import sysconfig
import tempfile
import unittest
import venv

from package import comrad  # first: it ends the test where the package is not there

import gymnasium
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
EXAMPLES = HERE.parents[3] / "sim_workers" / "python" / "examples"


def have(*modules):
    return all(importlib.util.find_spec(module) for module in modules)


def make_game():
    return comrad.gym_env("basic", max_buttons_pressed=1, frame_skip=50, size=(64, 48))


class Gymma:
    """What EPyMARL's GymmaWrapper does with an environment: TimeLimit, flat observations, padding, the sum of rewards."""

    def __init__(self, key, time_limit, seed, **options):
        self.env = gymnasium.wrappers.TimeLimit(gymnasium.make(key, **options), max_episode_steps=time_limit)
        self.n_agents = self.env.unwrapped.n_agents
        self.longest_action_space = max(self.env.action_space, key=lambda space: space.n)
        self.longest_observation_size = max(gymnasium.spaces.flatdim(space) for space in self.env.observation_space)
        self.obs, _ = self.env.reset(seed=seed)

    def step(self, actions):
        self.obs, reward, done, truncated, info = self.env.step([int(action) for action in actions])
        return self.get_obs(), float(sum(reward)), done, truncated, info

    def get_obs(self):
        flat = [gymnasium.spaces.flatten(space, one) for space, one in zip(self.env.observation_space, self.obs)]
        return [np.pad(one, (0, self.longest_observation_size - len(one))) for one in flat]

    def get_avail_actions(self):
        return [[1] * space.n + [0] * (self.longest_action_space.n - space.n) for space in self.env.action_space]


class Libraries(unittest.TestCase):
    folder: pathlib.Path

    def run_script(self, path, *arguments, python=sys.executable, timeout=1500):
        done = subprocess.run([str(python), "-B", str(path), *arguments], capture_output=True, text=True, timeout=timeout)
        self.assertEqual(done.returncode, 0, done.stderr[-3000:])
        return done.stdout

    def test_epymarls_gymma_plays_an_episode(self):
        env = Gymma("comrad:comrad/CoopHealthGathering-v1", time_limit=200, seed=1, frame_skip=50, size=(32, 18))
        rng, total, done, truncated = np.random.default_rng(1), 0.0, False, False
        while not (done or truncated):
            actions = [rng.choice(np.flatnonzero(row)) for row in env.get_avail_actions()]
            seen, reward, done, truncated, info = env.step(actions)
            total += reward
        self.assertEqual([one.shape for one in seen], [(3 * 32 * 18,)] * 2)
        self.assertAlmostEqual(total, sum(info["episode_return"]), places=2)
        env.env.close()

    @unittest.skipUnless(have("torch", "vizdoom"), "needs torch and vizdoom")
    def test_the_ppo_of_the_examples_learns(self):
        out = self.run_script(EXAMPLES / "ppo.py", "--decisions", "80000")
        scores = {name: float(re.search(rf"^{name} +(\S+)$", out, re.MULTILINE)[1]) for name in ("random", "trained")}
        self.assertGreater(scores["trained"], scores["random"] + 40, out)

    @unittest.skipUnless(have("stable_baselines3", "vizdoom"), "needs stable-baselines3 and vizdoom")
    def test_stable_baselines3_plays_in_processes(self):
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import SubprocVecEnv, VecMonitor

        envs = VecMonitor(SubprocVecEnv([make_game] * 2, start_method="spawn"))
        ppo = PPO("MultiInputPolicy", envs, n_steps=32, batch_size=32, n_epochs=1, seed=1).learn(256)
        self.assertGreater(len(ppo.ep_info_buffer), 10)
        envs.close()

    @unittest.skipUnless(have("torchrl", "torch"), "needs torchrl")
    def test_torchrl_collects_past_the_ends_of_episodes(self):
        from torchrl.envs import PettingZooWrapper
        from torchrl.envs.utils import check_env_specs

        team = comrad.parallel_env("coop_health_gathering", frame_skip=50, size=(32, 18), flat_actions=True, observations=("action_mask",))
        env = PettingZooWrapper(team, return_state=True, use_mask=True, categorical_actions=True)
        check_env_specs(env)
        rollout = env.rollout(300, break_when_any_done=False)
        self.assertGreater(int(rollout["next", "done"].sum()), 1)
        self.assertEqual(rollout["state"].shape, (300, *team.state_space.shape))
        env.close()

    def plays_in_its_own_environment(self, requirement, script):
        """What `script` prints with a Python that has `requirement`, and of this one's packages what that leaves."""
        own = self.folder / re.match(r"\w+", requirement)[0]
        python = own / "bin" / "python"
        if not python.exists():
            venv.create(own, with_pip=True)
            here = sysconfig.get_path("purelib", vars={"base": str(own), "platbase": str(own)})
            beside = [path for path in sys.path if path.endswith("-packages")]
            (pathlib.Path(here) / "beside.pth").write_text("\n".join(beside) + "\n", encoding="utf-8")
        # PyTorch as it is here: the largest of all, and for a CPU where this one is.
        constraints = own / "constraints.txt"
        constraints.write_text(f"torch=={importlib.metadata.version('torch')}\n" if have("torch") else "", encoding="utf-8")
        got = subprocess.run([str(python), "-m", "pip", "install", "-q", "-c", str(constraints), requirement], capture_output=True, text=True, timeout=1800)
        if got.returncode != 0:
            self.skipTest(f"pip cannot get {requirement}: {(got.stderr or got.stdout).strip().splitlines()[-1]}")
        with tempfile.TemporaryDirectory(prefix="comrad_") as scratch:  # a short path: RLlib's sockets lie in it
            return self.run_script(HERE / script, scratch, python=python)

    def test_rllib_trains_two_iterations(self):
        out = self.plays_in_its_own_environment("ray[rllib]==2.60.0", "rllib_plays.py")
        self.assertRegex(out, r"RLlib: 2 iterations, [1-9]\d* episodes ended")

    def test_benchmarl_trains_two_iterations(self):
        out = self.plays_in_its_own_environment("benchmarl==1.5.2", "benchmarl_plays.py")
        self.assertIn("BenchMARL: 2 iterations, 400 steps", out)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    Libraries.folder = pathlib.Path(sys.argv.pop(1)).resolve()
    program = unittest.main(exit=False)
    if program.result.wasSuccessful() and len(program.result.skipped) == program.result.testsRun:
        sys.exit(77)
    sys.exit(not program.result.wasSuccessful())
