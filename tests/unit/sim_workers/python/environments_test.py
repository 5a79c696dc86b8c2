#!/usr/bin/env python3
"""The environments of the Python package: PettingZoo's and Gymnasium's own checks, episodes that repeat, states that come back.

    PYTHONPATH=build/python environments_test.py [unittest arguments]
"""

import os
import tempfile
import unittest
import warnings

from package import comrad, equal, random_actions  # first: it ends the test where the package is not there

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils import parallel_to_aec

os.environ["SDL_VIDEODRIVER"] = "dummy"  # windows that are not seen


class PettingZoo(unittest.TestCase):
    def test_every_scenario_passes_its_api_test(self):
        for scenario in comrad.scenarios():
            with self.subTest(scenario):
                env = comrad.parallel_env(scenario)
                parallel_api_test(env, num_cycles=20)
                env.close()

    def test_observations_of_all_kinds_pass_it(self):
        env = comrad.parallel_env("ammo_carrier", observations=("depth", "measurements", "action_mask"), channels_first=True, size=(64, 36))
        parallel_api_test(env, num_cycles=20)
        seen = env.reset(seed=1)[0]["agent_0"]
        self.assertEqual(seen["screen"].shape, (3, 36, 64))
        self.assertGreater(seen["depth"].max(), 64.0)  # a wall is somewhere
        self.assertEqual([int(head.sum()) for head in seen["action_mask"]], env.action_space("agent_0").nvec.tolist())
        env.close()

    def test_equal_seeds_are_equal_episodes(self):
        parallel_seed_test(lambda: comrad.parallel_env("coop_health_gathering"), num_cycles=20)

    def test_it_renders(self):
        render_test(lambda render_mode: parallel_to_aec(comrad.parallel_env("lava_pit", render_mode=render_mode, render_size=(64, 36))))
        env = comrad.parallel_env("lava_pit", render_mode="rgb_array", render_size=(64, 36))
        env.reset(seed=1)
        self.assertEqual(env.render().shape, (36, 128, 3))  # two agents side by side
        env.close()

    def test_it_converts_to_taking_turns(self):
        env = parallel_to_aec(comrad.parallel_env("rhythm_sync"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a state that turns do not have
            api_test(env, num_cycles=20)
        env.close()

    def test_larger_teams_play(self):
        env = comrad.parallel_env("armory_siege", num_agents=8)
        rng = np.random.default_rng(1)
        seen, _ = env.reset(seed=1)
        self.assertEqual(len(seen), 8)
        for _ in range(5):
            seen, rewards, *_ = env.step(random_actions(env, rng))
        self.assertEqual(len(rewards), 8)
        self.assertFalse(equal(seen["agent_0"], seen["agent_7"]))
        env.close()


class Episodes(unittest.TestCase):
    def play(self, env, steps, seed=3):
        rng = np.random.default_rng(seed)
        hashes, last = [], None
        for _ in range(steps):
            last = env.step(random_actions(env, rng))
            hashes.append(env.state_hash())
        return hashes, last

    def test_a_state_comes_back_in_another_environment_too(self):
        env, other = (comrad.parallel_env("stag_hunt_arena") for _ in range(2))
        env.reset(seed=5)
        self.play(env, 30)
        state = env.get_state()
        self.assertEqual(state.hash(), env.state_hash())
        first, seen = self.play(env, 40)
        other.reset(seed=6)
        for place in (env, other):
            place.set_state(state)
            self.assertEqual(place.state_hash(), state.hash())
            again, seen_again = self.play(place, 40)
            self.assertEqual(first, again)
            self.assertTrue(equal(seen[0], seen_again[0]))
            self.assertEqual(seen[1], seen_again[1])
        env.close(), other.close()

    def test_episodes_follow_from_seed_and_number(self):
        env = comrad.parallel_env("coop_puzzle")
        env.reset(seed=9)
        first = self.play(env, 10)[0]
        env.reset()
        second = self.play(env, 10)[0]
        self.assertNotEqual(first, second)
        env.reset(seed=9)
        self.assertEqual(self.play(env, 10)[0], first)
        env.reset()
        self.assertEqual(self.play(env, 10)[0], second)
        env.close()

    def test_an_episode_ends_with_its_account(self):
        # No button is pressed: the floor kills both after a while, or time is up.
        env = comrad.parallel_env("coop_health_gathering", size=(16, 16))
        env.reset(seed=1)
        total, steps, infos = 0.0, 0, {}
        while env.agents:
            steps += 1
            _, rewards, terminated, truncated, infos = env.step({agent: np.zeros(4, np.int32)[: len(env.action_space(agent).nvec)] for agent in env.agents})
            total += rewards["agent_1"]
        episode = infos["agent_1"]
        self.assertNotIn("episode", episode)  # Gymnasium's own, with r, l and t
        self.assertTrue(any(terminated.values()) != any(truncated.values()))
        self.assertAlmostEqual(episode["episode_return"], total, places=3)
        self.assertEqual(episode["episode_length"], steps)
        self.assertEqual(episode["score_share"], np.float32(episode["score"]) / np.float32(episode["ceiling"]))
        self.assertGreater(episode["score"], 0)
        self.assertEqual(episode["ceiling"], 8400)
        self.assertGreater(episode["length_tics"], 100)
        env.close()

    def test_the_state_tells_where_agents_are(self):
        env = comrad.parallel_env("stag_hunt_arena")
        env.reset(seed=1)
        before = dict(zip(env.state_names, env.state()))
        forward = comrad.describe("stag_hunt_arena")["heads"][0].index("MOVE_FORWARD") + 1
        for _ in range(5):
            env.step({agent: np.array([forward, *[0] * (len(env.action_space(agent).nvec) - 1)]) for agent in env.agents})
        after = dict(zip(env.state_names, env.state()))
        way = np.array([after[f"agent_0/{axis}"] - before[f"agent_0/{axis}"] for axis in "xy"])
        ahead = np.array([before["agent_0/cos_angle"], before["agent_0/sin_angle"]])
        self.assertGreater(way @ ahead, 30)
        self.assertEqual(after["agent_0/health"], 100)
        env.close()


class Maps(unittest.TestCase):
    def test_a_layout_is_a_seed_parameters_or_files(self):
        wad = comrad.draw_map("lava_pit", seed=7)
        self.assertEqual(wad[:4], b"PWAD")
        self.assertEqual(wad, comrad.draw_map("lava_pit", seed=7))
        with tempfile.TemporaryDirectory() as folder:
            for name, seed in (("a.wad", 7), ("b.wad", 8)):
                with open(f"{folder}/{name}", "wb") as file:
                    file.write(comrad.draw_map("lava_pit", seed=seed))
            seen = {}
            for name, layout in (("seed", 7), ("file", f"{folder}/a.wad"), ("parameters", {"seed": 7}), ("folder", folder)):
                env = comrad.parallel_env("lava_pit", layout=layout)
                first = env.reset(seed=1)[0]["agent_0"]
                second = env.reset()[0]["agent_0"]
                seen[name] = first
                self.assertEqual(name == "folder", not np.array_equal(first, second), name)  # of a folder the next map is played
                env.close()
            for name in ("file", "parameters", "folder"):
                self.assertTrue(equal(seen["seed"], seen[name]), name)


class Gymnasium(unittest.TestCase):
    def test_games_of_vizdoom_pass_its_check(self):
        for name in ("basic", "health_gathering", "take_cover"):
            with self.subTest(name):
                env = gymnasium.make(f"comrad/{name}-v0", render_mode="rgb_array", size=(64, 48))
                check_env(env.unwrapped)
                env.close()

    def test_a_game_is_found_in_a_named_folder(self):
        import vizdoom

        with tempfile.TemporaryDirectory() as folder:
            with open(os.path.join(vizdoom.scenarios_path, "basic.cfg"), encoding="utf-8") as file:
                text = file.read().replace("basic.wad", os.path.join(vizdoom.scenarios_path, "basic.wad"))
            with open(f"{folder}/mine.cfg", "w", encoding="utf-8") as file:
                file.write(text)
            os.environ["COMRAD_VIZDOOM_PATH"] = f"/nowhere:{folder}"
            try:
                found = comrad.vizdoom_cfg("mine")
            finally:
                del os.environ["COMRAD_VIZDOOM_PATH"]
            self.assertEqual(found, f"{folder}/mine.cfg")
            self.assertEqual(comrad.describe("mine", folder=folder)["title"], comrad.describe(found)["title"])
            for make in (comrad.gym_env, comrad.parallel_env, comrad.vector_env):
                env = make("mine.cfg" if make is comrad.gym_env else "mine", folder=folder, size=(64, 48))
                env.reset(seed=1)
                env.close()
            with self.assertRaisesRegex(FileNotFoundError, "basic.cfg: no such file; .* has mine"):
                comrad.gym_env("basic", folder=folder)  # the package's is not meant

    def test_every_button_is_pressed_by_its_name(self):
        env = comrad.gym_env("basic", size=(64, 48), frame_skip=4, max_buttons_pressed=1)
        self.assertEqual(env.button_names, ["MOVE_LEFT", "MOVE_RIGHT", "ATTACK"])
        self.assertEqual(env.action_space.n, 4)
        env.reset(seed=2)
        ammo = [env.step(3)[0]["gamevariables"][0] for _ in range(5)]
        self.assertEqual(ammo[-1], 50)  # AMMO2: 3 is the first button, as in ViZDoom's wrapper
        ammo = [env.step(1)[0]["gamevariables"][0] for _ in range(5)]
        self.assertLess(ammo[-1], 50)  # 1 the last: it has shot
        env.close()

    def test_deltas_take_numbers(self):
        env = comrad.gym_env("deathmatch", size=(64, 48))
        self.assertEqual(set(env.action_space.spaces), {"binary", "continuous"})
        env.reset(seed=2)
        delta = [name for name in env.button_names if name.endswith("_DELTA")]
        turn = np.zeros(len(delta), np.float32)
        turn[delta.index("TURN_LEFT_RIGHT_DELTA")] = 45
        nothing = np.zeros(env.action_space["binary"].n, np.int8)
        for _ in range(10):  # the map holds the player for a moment
            before = env.step({"binary": nothing, "continuous": 0 * turn})[0]["screen"]
        after = env.step({"binary": nothing, "continuous": turn})[0]["screen"]
        still = env.set_state(env.get_state())["screen"]
        self.assertTrue(equal(after, still))
        self.assertGreater((before != after).mean(), 0.2)
        env.close()


class Vector(unittest.TestCase):
    def test_it_plays_what_single_ones_play(self):
        envs = comrad.vector_env("coop_puzzle", num_envs=3, num_threads=2)
        singles = [comrad.parallel_env("coop_puzzle") for _ in range(3)]
        seen, _ = envs.reset(seed=11)
        alone = [single.reset(seed=11 + index)[0] for index, single in enumerate(singles)]
        rng = np.random.default_rng(1)
        for _ in range(20):
            for index in range(3):
                for agent in range(2):
                    self.assertTrue(equal(seen[index, agent], alone[index][f"agent_{agent}"]))
            actions = rng.integers(envs.action_space.nvec)
            seen, reward, terminated, truncated, _ = envs.step(actions)
            for index, single in enumerate(singles):
                alone[index], rewards, *_ = single.step({f"agent_{agent}": actions[index, agent] for agent in range(2)})
                self.assertEqual([rewards["agent_0"], rewards["agent_1"]], [float(one) for one in reward[index]])
        envs.close()

    def test_episodes_begin_again_in_the_step_after(self):
        envs = comrad.vector_env("basic", num_envs=2, size=(16, 16), frame_skip=50, reward="living_reward=0")
        self.assertEqual(envs.metadata["autoreset_mode"], AutoresetMode.NEXT_STEP)
        first, _ = envs.reset(seed=4)
        nothing = np.zeros(envs.action_space.shape, np.int64)
        for _ in range(5):  # its limit is 300 tics
            seen, reward, terminated, truncated, infos = envs.step(nothing)
        self.assertFalse(truncated.any())
        seen, reward, terminated, truncated, infos = envs.step(nothing)
        self.assertTrue(truncated.all())
        self.assertTrue((infos["length_tics"] >= 300).all() and (infos["episode_length"] == 6).all() and infos["_score"].all())
        seen, reward, terminated, truncated, infos = envs.step(nothing)
        self.assertFalse((terminated | truncated).any())
        self.assertNotIn("score", infos)
        self.assertTrue((reward == 0).all())
        state = envs.get_state(0)
        envs.step(nothing)
        envs.set_state(0, state)
        self.assertTrue(equal(envs.observe()[0], seen[0]))
        envs.close()

    def test_one_environment_alone_is_reset_by_a_mask(self):
        envs = comrad.vector_env("lava_pit", num_envs=2)
        begin, _ = envs.reset(seed=1)
        forward = np.zeros(envs.action_space.shape, np.int64)
        forward[..., 0] = 1
        for _ in range(5):
            moved, *_ = envs.step(forward)
        again, _ = envs.reset(seed=1, options={"reset_mask": np.array([True, False])})
        self.assertTrue(equal(again[0], begin[0]))
        self.assertTrue(equal(again[1], moved[1]))
        envs.close()

    def test_without_copies_arrays_are_the_engines_own(self):
        envs = comrad.vector_env("lava_pit", num_envs=4, copy=False, channels_first=True)
        seen, _ = envs.reset(seed=1)
        actions = np.ones(envs.action_space.shape, np.int64)
        envs.send(actions)
        again, *_ = envs.recv()
        self.assertTrue(np.shares_memory(seen, again))
        try:
            import torch
        except ImportError:
            torch = None
        if torch:
            self.assertEqual(torch.from_dlpack(again).data_ptr(), again.ctypes.data)
        envs.close()
        self.assertGreater(int(again.max()), 0)  # the memory outlives the environments' end


if __name__ == "__main__":
    unittest.main()
