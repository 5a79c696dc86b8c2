#!/usr/bin/env python3
"""Every wrapper of Gymnasium, PettingZoo and SuperSuit on these environments; those that cannot apply are named with the reason.

    PYTHONPATH=build/python wrappers_test.py [unittest arguments]
"""

import contextlib
import inspect
import os
import re
import tempfile
import unittest
import warnings

from package import comrad  # first: it ends the test where the package is not there

import gymnasium
import numpy as np
from gymnasium import spaces, wrappers
from gymnasium.wrappers import vector
from pettingzoo.utils import conversions
from pettingzoo.utils import wrappers as turns
from pettingzoo.utils.env import AECEnv, ParallelEnv

SMALL = {"size": (16, 16), "render_size": (32, 32)}
ENDS = {"frame_skip": 50, "render_mode": "rgb_array", **SMALL}  # an episode of basic is 6 steps
os.environ["SDL_VIDEODRIVER"] = "dummy"  # windows that are not seen


def game(**options):
    return comrad.gym_env("basic", **{"max_buttons_pressed": 1, **ENDS, **options})


def pixels(**options):
    """A game that shows its picture alone, as Gymnasium's wrappers of pictures want it."""
    env = game(**options)
    return wrappers.TransformObservation(env, lambda seen: seen["screen"], env.observation_space["screen"])


def numbers():
    return wrappers.TransformObservation(game(), lambda seen: seen["gamevariables"], spaces.Box(-100, 100, (1,)))


def turning(folder):
    """A game whose action is a number of degrees; its own bounds are float32's, so wrappers that scale need narrower ones below."""
    import vizdoom

    path = os.path.join(folder, "turning.cfg")
    with open(path, "w", encoding="utf-8") as file:
        file.write(f"doom_scenario_path = {vizdoom.scenarios_path}/basic.wad\nepisode_timeout = 300\n"
                   "available_buttons = { TURN_LEFT_RIGHT_DELTA }\n")
    return path


def narrow(env):
    return wrappers.TransformAction(env, lambda degrees: degrees, spaces.Box(-10, 10, (1,), np.float32))


class Wrappers(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = scratch.name
        self.addCleanup(warnings.resetwarnings)
        warnings.simplefilter("ignore")  # the libraries' own

    def all_are_tried(self, found, tried, cannot):
        """`cannot`: names by reason."""
        left_out = {name for names in cannot.values() for name in names}
        self.assertEqual(set(found), set(tried) | left_out, "a new wrapper is added to the test, with a reason where it cannot apply")

    @contextlib.contextmanager
    def tries(self, name):
        """A wrapper that needs a package that is not here is skipped."""
        with self.subTest(name):
            try:
                yield
            except gymnasium.error.DependencyNotInstalled as missing:
                self.skipTest(str(missing))

    def plays(self, env, steps=14):
        """Past the ends of two episodes; what is seen is of the space."""
        seen, _ = env.reset(seed=1)
        ends = 0
        for _ in range(steps):
            self.assertTrue(env.observation_space.contains(seen), env)
            seen, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if terminated or truncated:
                ends += 1
                seen, _ = env.reset()
        self.assertGreaterEqual(ends, 1)
        env.close()

    def test_gymnasiums(self):
        degrees = turning(self.folder)
        tried = {
            "AddRenderObservation": lambda wrap: wrap(game()),
            "AddWhiteNoise": lambda wrap: wrap(pixels(), probability_of_noise_per_pixel=0.1),
            "Autoreset": lambda wrap: wrap(game()),
            "ClipAction": lambda wrap: wrap(comrad.gym_env(degrees, **ENDS)),
            "ClipReward": lambda wrap: wrap(game(), -1, 1),
            "DelayObservation": lambda wrap: wrap(pixels(), 2),
            "DiscretizeAction": lambda wrap: wrap(narrow(comrad.gym_env(degrees, **ENDS)), 5),
            "DiscretizeObservation": lambda wrap: wrap(numbers(), 5),
            "DtypeObservation": lambda wrap: wrap(pixels(), np.float32),
            "FilterObservation": lambda wrap: wrap(game(), ["screen"]),
            "FlattenObservation": lambda wrap: wrap(game()),
            "FrameStackObservation": lambda wrap: wrap(game(), 3),
            "GrayscaleObservation": lambda wrap: wrap(pixels(), keep_dim=True),
            "HumanRendering": lambda wrap: wrap(game()),
            "MaxAndSkipObservation": lambda wrap: wrap(pixels(), 2),
            "NormalizeObservation": lambda wrap: wrap(pixels(dtype="float32")),
            "NormalizeReward": lambda wrap: wrap(game()),
            "ObstructView": lambda wrap: wrap(pixels(), 0.2, 2),
            "OrderEnforcing": lambda wrap: wrap(game()),
            "PassiveEnvChecker": lambda wrap: wrap(game()),
            "RecordEpisodeStatistics": lambda wrap: wrap(game()),
            "RecordVideo": lambda wrap: wrap(game(), self.folder),
            "RenderCollection": lambda wrap: wrap(game()),
            "RepeatAction": lambda wrap: wrap(game(), 2),
            "RescaleAction": lambda wrap: wrap(narrow(comrad.gym_env(degrees, **ENDS)), np.float32(-1), np.float32(1)),
            "RescaleObservation": lambda wrap: wrap(pixels(dtype="float32"), np.float32(-1), np.float32(1)),
            "ReshapeObservation": lambda wrap: wrap(pixels(), (48, 16)),
            "ResizeObservation": lambda wrap: wrap(pixels(), (8, 8)),
            "StickyAction": lambda wrap: wrap(game(), 0.5),
            "TimeAwareObservation": lambda wrap: wrap(wrappers.TimeLimit(game(), 10)),
            "TimeLimit": lambda wrap: wrap(game(), 3),
            "TransformAction": lambda wrap: wrap(game(), lambda action: action, None),
            "TransformObservation": lambda wrap: wrap(game(), lambda seen: seen, None),
            "TransformReward": lambda wrap: wrap(game(), lambda reward: reward),
        }
        cannot = {"plays Atari's games alone": ("AtariPreprocessing",)}
        found = {name: one for name, one in vars(wrappers).items() if inspect.isclass(one) and issubclass(one, gymnasium.Wrapper)}
        self.all_are_tried(found, tried, cannot)
        for name in tried:
            with self.tries(name):
                self.plays(tried[name](found[name]))

    def test_gymnasiums_of_batches(self):
        def games(**options):
            return comrad.vector_env("basic", num_envs=2, **{**ENDS, **options})

        def same(values):
            return values

        tried = {
            "ClipReward": lambda wrap: wrap(games(), -1, 1),
            "DictInfoToList": lambda wrap: wrap(games()),
            "DtypeObservation": lambda wrap: wrap(games(), np.float32),
            "FilterObservation": lambda wrap: wrap(games(observations=("depth",)), ["screen"]),
            "FlattenObservation": lambda wrap: wrap(games(observations=("depth",))),
            "GrayscaleObservation": lambda wrap: wrap(games()),
            "HumanRendering": lambda wrap: wrap(games()),
            "NormalizeObservation": lambda wrap: wrap(games(dtype="float32")),
            "NormalizeReward": lambda wrap: wrap(games()),
            "RecordEpisodeStatistics": lambda wrap: wrap(games()),
            "RecordVideo": lambda wrap: wrap(games(), self.folder),
            "RescaleObservation": lambda wrap: wrap(games(dtype="float32"), np.float32(-1), np.float32(1)),
            "ReshapeObservation": lambda wrap: wrap(games(), (48, 16)),
            "ResizeObservation": lambda wrap: wrap(games(), (8, 8)),
            "TransformAction": lambda wrap: wrap(games(), same),
            "TransformObservation": lambda wrap: wrap(games(), same),
            "TransformReward": lambda wrap: wrap(games(), same),
            "VectorizeTransformAction": lambda wrap: wrap(games(), wrappers.TransformAction, func=same, action_space=None),
            "VectorizeTransformObservation": lambda wrap: wrap(games(), wrappers.ReshapeObservation, shape=(48, 16)),
            "VectorizeTransformReward": lambda wrap: wrap(games(), wrappers.ClipReward, min_reward=-1, max_reward=1),
        }
        cannot = {"takes actions of a Box, and batches have choices of heads": ("ClipAction", "RescaleAction")}
        found = {name: one for name, one in vars(vector).items() if inspect.isclass(one) and issubclass(one, gymnasium.vector.VectorWrapper)}
        self.all_are_tried(found, tried, cannot)
        for name in tried:
            with self.tries(name):
                envs = tried[name](found[name])
                seen, _ = envs.reset(seed=1)
                ends = 0
                for _ in range(14):
                    self.assertTrue(envs.observation_space.contains(seen))
                    seen, _, terminated, truncated, _ = envs.step(envs.action_space.sample())
                    ends += int((terminated | truncated).sum())
                self.assertGreaterEqual(ends, 2)
                envs.close()

    def team(self, **options):
        return comrad.parallel_env("coop_health_gathering", **{**ENDS, **options})

    def turns(self, **options):
        return comrad.env("coop_health_gathering", **{**ENDS, **options})

    def plays_as_team(self, env, steps=20):
        """`env` of PettingZoo or SuperSuit, agents at once or in turn, past the end of an episode."""
        env.reset(seed=1)
        if isinstance(env, AECEnv):
            for agent in env.agent_iter(2 * steps):
                seen, _, terminated, truncated, _ = env.last()
                self.assertTrue(env.observation_space(agent).contains(seen), agent)
                env.step(None if terminated or truncated else env.action_space(agent).sample())
        else:
            for _ in range(steps):
                if not env.agents:
                    break
                seen, *_ = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
                for agent, one in seen.items():
                    self.assertTrue(env.observation_space(agent).contains(one), agent)
        env.close()

    def test_pettingzoos(self):
        tried = {
            "AssertOutOfBoundsWrapper": lambda wrap: wrap(self.turns(flat_actions=True)),
            "BaseParallelWrapper": lambda wrap: wrap(self.team()),
            "BaseWrapper": lambda wrap: wrap(self.turns()),
            "MultiEpisodeEnv": lambda wrap: wrap(self.turns(), 2),
            "MultiEpisodeParallelEnv": lambda wrap: wrap(self.team(), 2),
            "OrderEnforcingWrapper": lambda wrap: wrap(self.turns()),
            "RecordVideo": lambda wrap: wrap(self.turns(), self.folder),
            "RecordVideoParallel": lambda wrap: wrap(self.team(), self.folder),
            "TerminateIllegalWrapper": lambda wrap: wrap(self.turns(flat_actions=True, observations=("action_mask",)), -1),
        }
        cannot = {
            "prints games whose render_mode is ansi": ("CaptureStdoutWrapper",),
            "takes actions of a Box, and agents have choices of heads": ("ClipOutOfBoundsWrapper",),
        }
        found = {name: one for name, one in vars(turns).items() if inspect.isclass(one)}
        self.all_are_tried(found, tried, cannot)
        for name in tried:
            with self.tries(name):
                self.plays_as_team(tried[name](found[name]))

    def test_pettingzoos_conversions(self):
        tried = {
            "aec_to_parallel": lambda convert: convert(self.turns()),
            "from_parallel": lambda convert: convert(self.team()),
            "parallel_to_aec": lambda convert: convert(self.team()),
            "to_parallel": lambda convert: convert(self.turns()),
            "turn_based_aec_to_parallel": lambda convert: convert(self.turns()),
            "aec_to_parallel_wrapper": lambda convert: convert(self.turns()),
            "parallel_to_aec_wrapper": lambda convert: convert(self.team()),
            "turn_based_aec_to_parallel_wrapper": lambda convert: convert(self.turns()),
        }
        found = {name for name, one in vars(conversions).items() if callable(one) and getattr(one, "__module__", "") == conversions.__name__}
        self.all_are_tried(found, tried, {"make functions": ("aec_wrapper_fn", "parallel_wrapper_fn")})
        for name in tried:
            with self.tries(name):
                self.plays_as_team(tried[name](getattr(conversions, name)))

    def test_supersuits(self):
        try:
            import supersuit
        except ImportError:
            self.skipTest("needs the package SuperSuit")
        team = self.team

        def flat():
            return self.team(flat_actions=True)

        def batch():
            return supersuit.pettingzoo_env_to_vec_env_v1(self.team())

        tried = {
            "action_lambda_v1": lambda wrap: wrap(team(), lambda action, space: action, lambda space: space),
            "agent_indicator_v0": lambda wrap: wrap(team()),
            "black_death_v3": lambda wrap: wrap(team()),
            "clip_reward_v0": lambda wrap: wrap(team()),
            "color_reduction_v0": lambda wrap: wrap(team()),
            "concat_vec_envs_v1": lambda wrap: wrap(batch(), 2),
            "delay_observations_v0": lambda wrap: wrap(team(), 2),
            "dtype_v0": lambda wrap: wrap(team(), np.float32),
            "flatten_v0": lambda wrap: wrap(team()),
            "frame_skip_v0": lambda wrap: wrap(team(), 2),
            "frame_stack_v1": lambda wrap: wrap(team(), 3),
            "frame_stack_v2": lambda wrap: wrap(team(), 3),
            "gym_vec_env_v0": lambda wrap: wrap(pixels(), 2),
            "max_observation_v0": lambda wrap: wrap(team(), 2),
            "nan_noop_v0": lambda wrap: wrap(flat(), 0),
            "nan_random_v0": lambda wrap: wrap(flat()),
            "nan_zeros_v0": lambda wrap: wrap(flat()),
            "normalize_obs_v0": lambda wrap: wrap(team(dtype="float32")),
            "observation_lambda_v0": lambda wrap: wrap(team(), lambda seen, space: seen),
            "pad_action_space_v0": lambda wrap: wrap(flat()),
            "pad_observations_v0": lambda wrap: wrap(team()),
            "pettingzoo_env_to_vec_env_v1": lambda wrap: wrap(team()),
            "reshape_v0": lambda wrap: wrap(team(), (48, 16)),
            "resize_v1": lambda wrap: wrap(team(), 8, 8),
            "reward_lambda_v0": lambda wrap: wrap(team(), lambda reward: reward),
            "stable_baselines3_vec_env_v0": lambda wrap: wrap(pixels(), 2),
            "sticky_actions_v0": lambda wrap: wrap(team(), 0.5),
            "vectorize_aec_env_v0": lambda wrap: wrap(self.turns(), 2),
        }
        cannot = {
            "takes actions of a Box, and agents have choices of heads": ("clip_actions_v0", "scale_actions_v0"),
            "of the library that Stable-Baselines3 replaced": ("stable_baselines_vec_env_v0",),
        }
        found = {name for name in dir(supersuit) if re.search(r"_v\d+$", name)}
        self.all_are_tried(found, tried, cannot)
        for name in tried:
            with self.tries(name):
                env = tried[name](getattr(supersuit, name))
                if isinstance(env, ParallelEnv):
                    self.plays_as_team(env)
                    continue
                env.reset()
                for _ in range(14):  # batches of several interfaces
                    if hasattr(env, "agent_selection"):
                        env.step([env.action_space(env.agent_selection).sample() for _ in range(2)])
                    else:
                        own = name == "gym_vec_env_v0"  # its space is the batch's
                        env.step(env.action_space.sample() if own else np.stack([env.action_space.sample() for _ in range(env.num_envs)]))
                if hasattr(env, "close"):
                    env.close()


if __name__ == "__main__":
    unittest.main()
