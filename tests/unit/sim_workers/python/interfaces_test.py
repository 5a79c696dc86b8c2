#!/usr/bin/env python3
"""The forms in which environments are offered: ids, agents in turn, teams, flat actions, copies, partial batches, wrappers.

    PYTHONPATH=build/python interfaces_test.py [unittest arguments]
"""

import copy
import inspect
import os
import pickle
import struct
import subprocess
import sys
import tempfile
import unittest

from package import comrad, equal, random_actions  # first: it ends the test where the package is not there

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from gymnasium.wrappers import RecordEpisodeStatistics
from gymnasium.wrappers import vector as wrappers
from pettingzoo.test import api_test, parallel_api_test
from pettingzoo.utils.env import AECEnv

SMALL = {"size": (16, 16)}
ENDS = {"frame_skip": 50, **SMALL}  # an episode of basic is 6 steps
ACCOUNT = {"score", "ceiling", "score_share", "episode_return", "episode_length", "length_tics"}


def make_basic():
    return comrad.gym_env("basic", max_buttons_pressed=1, **ENDS)


class Infos(unittest.TestCase):
    def test_the_last_step_holds_flat_numbers_and_gymnasiums_own_stay_its_own(self):
        env = RecordEpisodeStatistics(comrad.gym_env("basic", **ENDS))
        for _ in range(2):
            env.reset(seed=3)
            is_over, steps = False, 0
            while not is_over:
                _, _, terminated, truncated, info = env.step(np.zeros(3, np.int8))
                is_over, steps = terminated or truncated, steps + 1
            self.assertEqual(set(info), ACCOUNT | {"episode"})
            self.assertEqual(set(info["episode"]), {"r", "l", "t"})
            self.assertEqual((info["episode"]["l"], info["episode"]["r"]), (steps, info["episode_return"]))
            self.assertEqual(info["episode_length"], steps)
        env.close()


class Copies(unittest.TestCase):
    def test_they_are_equal_before_the_first_step_and_after_a_reset(self):
        env = comrad.parallel_env("lava_pit", num_agents=2, observations=("measurements",), layout={"seed": 3}, **SMALL)
        fresh = copy.deepcopy(env)
        self.assertEqual((fresh.agents, fresh.observation_spaces), ([], env.observation_spaces))
        env.reset(seed=5)
        env.reset()
        again = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
        rng = np.random.default_rng(1)
        for _ in range(10):
            actions = random_actions(env, rng)
            seen = env.step(actions)[0]
            for one in again:
                self.assertTrue(equal(one.step(actions)[0]["agent_1"], seen["agent_1"]))
                self.assertEqual(one.state_hash(), env.state_hash())
        with self.assertRaisesRegex(TypeError, "in the middle of an episode"):
            pickle.dumps(env)
        env.reset()
        again[0].reset()
        self.assertEqual(copy.deepcopy(env).state_hash(), again[0].state_hash())  # the streams continue alike
        for one in (env, fresh, *again):
            one.close()

    def test_every_kind_has_them(self):
        for make in (
            lambda: comrad.env("lava_pit", **SMALL),
            lambda: comrad.team_env("lava_pit", **SMALL),
            lambda: gymnasium.make("comrad/LavaPit-v1", **SMALL),
            lambda: comrad.gym_env("basic", **SMALL),
            lambda: comrad.vector_env("lava_pit", num_envs=2, **SMALL),
        ):
            env = make()
            env.reset(seed=1)
            twin = pickle.loads(pickle.dumps(env))
            self.assertEqual(str(twin), str(env))
            env.close(), twin.close()

    def test_processes_get_them(self):
        envs = AsyncVectorEnv([make_basic] * 2, context="spawn" if __name__ != "__main__" else None)
        envs.reset(seed=1)
        ended = 0
        for _ in range(9):
            *_, truncated, infos = envs.step(np.zeros(2, np.int64))
            ended += truncated.sum()
        self.assertEqual(ended, 2)
        envs.close()


class Ways(unittest.TestCase):
    def test_agents_take_turns(self):
        env = comrad.env("lava_pit", **SMALL)
        self.assertIsInstance(env, AECEnv)
        api_test(env, num_cycles=30)
        env.reset(seed=1)
        self.assertEqual(env.state().shape, env.state_space.shape)
        env.close()

    def test_ids_name_scenarios_and_games(self):
        self.assertIn("comrad/LavaPit-v1", gymnasium.registry)
        self.assertEqual(comrad.describe("comrad/LavaPit-v1"), comrad.describe("lava_pit"))
        for scenario in comrad.scenarios():
            version = comrad.describe(scenario)["version"]
            self.assertIn(f"comrad/{scenario.title().replace('_', '')}-v{version}", gymnasium.registry)
        for make in (comrad.parallel_env, comrad.env, comrad.team_env, comrad.vector_env):
            env = make("comrad/LavaPit-v1", **SMALL)
            env.reset(seed=1)
            env.close()
        gymnasium.make("comrad/basic-v0", **SMALL).close()
        comrad.gym_env("comrad/basic-v0", **SMALL).close()

    def test_a_team_is_one_gymnasium_env(self):
        env = gymnasium.make("comrad:comrad/CoopHealthGathering-v1", frame_skip=35, **SMALL)
        seen, info = env.reset(seed=1)
        self.assertTrue(env.observation_space.contains(seen))
        self.assertEqual(set(info), ACCOUNT | {"active"})
        self.assertEqual((info["active"], info["episode_return"]), ([True, True], [0.0, 0.0]))
        self.assertEqual([type(space).__name__ for space in env.action_space], ["Discrete", "Discrete"])
        twin = comrad.parallel_env("coop_health_gathering", frame_skip=35, flat_actions=True, **SMALL)
        twin.reset(seed=1)
        is_over = False
        while not is_over:
            seen, rewards, terminated, truncated, info = env.step((1, 2))
            there = twin.step({"agent_0": 1, "agent_1": 2})
            self.assertEqual(rewards, list(there[1].values()))
            is_over = terminated or truncated
        self.assertEqual(info["episode_return"], [there[4][agent]["episode_return"] for agent in twin.possible_agents])
        self.assertEqual(info["score"], there[4]["agent_0"]["score"])
        self.assertTrue(equal(env.unwrapped.state(), twin.state()))
        with self.assertRaisesRegex(ValueError, "1 actions were given for 2 agents"):
            env.unwrapped.step((1,))
        env.close(), twin.close()

    def test_a_missing_package_is_named(self):
        script = "import sys\nsys.modules['pettingzoo'] = None\nimport comrad"
        done = subprocess.run([sys.executable, "-B", "-c", script], capture_output=True, text=True, timeout=100)
        self.assertIn("ImportError: comrad needs the package pettingzoo; run: pip install pettingzoo", done.stderr)

    def test_signatures_name_every_option(self):
        for make in (comrad.parallel_env, comrad.env, comrad.team_env, comrad.gym_env, comrad.vector_env):
            parameters = inspect.signature(make).parameters.values()
            self.assertNotIn(inspect.Parameter.VAR_KEYWORD, {one.kind for one in parameters}, make)
            self.assertTrue(all(one.annotation is not inspect.Parameter.empty for one in parameters), make)
        self.assertIs(comrad.parallel_env, comrad.ComradParallelEnv)
        for name in ("ComradParallelEnv", "ComradGymEnv", "ComradVectorEnv"):
            kind = getattr(comrad, name)
            for option in inspect.signature(kind).parameters:
                shared = name == "ComradVectorEnv" and option in inspect.signature(comrad.ComradParallelEnv).parameters
                self.assertTrue(shared or option in kind.__doc__, f"{name}: {option} is not documented")


class FlatActions(unittest.TestCase):
    def test_numbers_are_the_product_of_heads_in_row_major_order(self):
        flat = comrad.FlatActions([3, 2, 4])
        self.assertEqual(flat.count, 24)
        choices = flat.choices(np.arange(24))
        self.assertEqual([choices[n].tolist() for n in (0, 1, 4, 8, 23)], [[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [2, 1, 3]])
        allowed = np.array([1, 0, 1, 1, 1, 1, 1, 0, 1], np.int8)
        by_head = np.split(allowed, [3, 5])
        self.assertEqual(flat.mask(allowed).tolist(), [int(all(head[one] for head, one in zip(by_head, row))) for row in choices])
        with self.assertRaisesRegex(ValueError, "action 24: it must lie in 0..23"):
            flat.choices(np.array([0, 24]))

    def test_they_play_what_choices_play(self):
        flat = comrad.parallel_env("coop_puzzle", flat_actions=True, observations=("action_mask",), **SMALL)
        parallel_api_test(flat, num_cycles=20)
        heads = comrad.parallel_env("coop_puzzle", **SMALL)
        envs = comrad.vector_env("coop_puzzle", num_envs=2, flat_actions=True, observations=("action_mask",), **SMALL)
        many, _ = envs.reset(seed=1)
        seen, _ = flat.reset(seed=1)
        heads.reset(seed=1)
        self.assertTrue(envs.observation_space.contains(many))
        self.assertTrue(equal(many["action_mask"][0, 0], seen["agent_0"]["action_mask"]))
        self.assertEqual(envs.action_space.shape, (2, 2))
        sizes = comrad.FlatActions(heads.action_space("agent_0").nvec.tolist())
        rng = np.random.default_rng(1)
        for _ in range(15):
            numbers = rng.integers(sizes.count, size=2)
            flat.step(dict(zip(flat.agents, numbers)))
            heads.step(dict(zip(heads.agents, sizes.choices(numbers))))
            envs.step(np.stack([numbers, numbers]))
            self.assertEqual(flat.state_hash(), heads.state_hash())
            self.assertEqual(envs.get_state(0).hash(), heads.state_hash())
        with self.assertRaisesRegex(ValueError, "an integer is wanted"):
            flat.step({agent: [0, 0] for agent in flat.agents})
        for one in (flat, heads, envs):
            one.close()


class Pictures(unittest.TestCase):
    def test_float32_is_the_same_between_0_and_1(self):
        options = {"observations": ("automap", "agent_id"), **SMALL}
        whole = comrad.parallel_env("lava_pit", **options).reset(seed=1)[0]["agent_1"]
        env = comrad.parallel_env("lava_pit", dtype="float32", channels_first=True, **options)
        seen = env.reset(seed=1)[0]["agent_1"]
        self.assertTrue(env.observation_space("agent_1").contains(seen))
        for name in ("screen", "automap"):
            self.assertTrue(equal(seen[name].transpose(1, 2, 0), whole[name].astype(np.float32) / np.float32(255)))
        self.assertEqual(seen["agent_id"].tolist(), [0, 1])
        envs = comrad.vector_env("lava_pit", num_envs=2, dtype="float32", channels_first=True, **options)
        many, _ = envs.reset(seed=1)
        self.assertTrue(envs.observation_space.contains(many))
        self.assertTrue(equal(many["screen"][0, 1], seen["screen"]))
        self.assertTrue(equal(many["agent_id"][1], np.eye(2, dtype=np.float32)))
        game = comrad.gym_env("basic", dtype="float32", channels_first=True, automap=True, size=(64, 48))
        first = game.reset(seed=1)[0]
        self.assertTrue(game.observation_space.contains(first))
        self.assertEqual(first["automap"].shape, (3, 48, 64))
        for one in (env, envs, game):
            one.close()


def joined_wad(wads):
    """The maps of several WADs as MAP01, MAP02 ... of one."""
    lumps = []
    for number, wad in enumerate(wads, 1):
        count, start = struct.unpack_from("<ii", wad, 4)
        for at in range(start, start + 16 * count, 16):
            offset, size, name = struct.unpack_from("<ii8s", wad, at)
            lumps.append((b"MAP%02d" % number if name.startswith(b"MAP") and size == 0 else name, wad[offset : offset + size]))
    body, directory = b"", b""
    for name, lump in lumps:
        directory += struct.pack("<ii8s", 12 + len(body), len(lump), name)
        body += lump
    return struct.pack("<4sii", b"PWAD", len(lumps), 12 + len(body)) + body + directory


class Streams(unittest.TestCase):
    """Episodes and maps across resets."""

    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = scratch.name
        for number in range(3):
            with open(f"{self.folder}/{number}.wad", "wb") as file:
                file.write(comrad.draw_map("lava_pit", seed=7 + number))

    def test_a_game_plays_every_map_of_a_folder(self):
        import vizdoom

        with tempfile.TemporaryDirectory() as folder:
            for name in ("basic", "my_way_home"):
                os.symlink(os.path.join(vizdoom.scenarios_path, f"{name}.wad"), f"{folder}/{name}.wad")
            env = comrad.gym_env("basic", layout=folder, **SMALL)
            seen = [env.reset(seed=1 if number == 0 else None)[0]["screen"] for number in range(3)]
            states = [env.state_hash()]
            self.assertFalse(equal(seen[0], seen[1]))
            self.assertTrue(equal(env.reset(seed=1)[0]["screen"], seen[0]))
            env.reset(), env.reset()
            self.assertEqual(env.state_hash(), states[0])  # the same stream again
            env.close()

    def test_every_map_of_one_wad_is_played_where_the_cfg_names_none(self):
        wad = f"{self.folder}/many.wad"
        with open(wad, "wb") as file:
            file.write(joined_wad([comrad.draw_map("lava_pit", seed=seed) for seed in (7, 8, 9)]))
        cfgs = {}
        for name, line in (("free", ""), ("named", "doom_map = MAP02\n")):
            cfgs[name] = f"{self.folder}/{name}.cfg"
            with open(cfgs[name], "w", encoding="utf-8") as file:
                file.write(f"doom_scenario_path = {wad}\n{line}available_buttons = {{ MOVE_FORWARD }}\n"
                           "available_game_variables = { POSITION_X POSITION_Y ANGLE }\n")
        free, named = (comrad.gym_env(cfgs[name], layout=wad, **SMALL) for name in ("free", "named"))
        team = comrad.parallel_env(cfgs["free"], layout=wad, **SMALL)
        batch = comrad.vector_env(cfgs["free"], layout=wad, num_envs=2, **SMALL)
        played = {"free": [], "named": [], "team": [], "batch": []}
        for number in range(6):
            seed = 1 if number == 0 else None
            played["free"].append(free.reset(seed=seed)[0]["screen"].tobytes())
            played["named"].append(named.reset(seed=seed)[0]["screen"].tobytes())
            played["team"].append(team.reset(seed=seed)[0]["agent_0"].tobytes())
            played["batch"] += [one.tobytes() for one in batch.reset(seed=seed)[0]]
        for name, maps in (("free", 3), ("named", 1), ("team", 3), ("batch", 3)):
            self.assertEqual(len(set(played[name])), maps, name)
        self.assertEqual(played["free"][:3], played["free"][3:])
        self.assertEqual(set(played["named"]), {played["free"][1]})
        for one in (free, named, team, batch):
            one.close()

    def test_each_environment_of_a_batch_takes_maps_in_turn(self):
        envs = comrad.vector_env("lava_pit", num_envs=2, layout=self.folder, **SMALL)
        hashes = []
        for number in range(4):
            envs.reset(seed=1 if number == 0 else None)
            hashes.append([envs.get_state(index).hash() for index in range(2)])
        for index in range(2):
            env = comrad.parallel_env("lava_pit", layout=[f"{self.folder}/{(index + 2 * number) % 3}.wad" for number in range(4)], **SMALL)
            for number in range(4):
                env.reset(seed=1 + index if number == 0 else None)
                self.assertEqual(env.state_hash(), hashes[number][index])
            env.close()
        envs.close()

    def test_reset_without_a_seed_goes_on_with_the_seeds_stream_in_every_process(self):
        envs = comrad.vector_env("lava_pit", num_envs=2, **SMALL)
        envs.reset(seed=7)
        envs.reset()
        found = [envs.get_state(index).hash() for index in range(2)]
        envs.close()
        script = ("import comrad\nenvs = comrad.vector_env('lava_pit', num_envs=2, size=(16, 16))\nenvs.reset(seed=7), envs.reset()\n"
                  "print([envs.get_state(index).hash() for index in range(2)])")
        done = subprocess.run([sys.executable, "-B", "-c", script], capture_output=True, text=True, timeout=100)
        self.assertEqual(done.stdout.strip(), str(found), done.stderr)


class Batches(unittest.TestCase):
    def test_partial_ones_play_the_same_episodes(self):
        options = {"num_envs": 5, "num_threads": 2, "num_agents": 1, "reward": "living_reward=0", **ENDS}
        whole, parts = comrad.vector_env("basic", **options), comrad.vector_env("basic", **options)
        first = whole.reset(seed=3)[0]
        self.assertTrue(equal(parts.reset(seed=3)[0], first))
        rng = np.random.default_rng(1)
        actions = rng.integers(whole.single_action_space.nvec, size=(20, 5, len(whole.single_action_space.nvec)))
        expected = [whole.step(row) for row in actions]
        taken, received, sizes = np.zeros(5, int), 0, []
        parts.send(actions[0], np.arange(5))
        while received < 5 * 20:
            seen, reward, terminated, truncated, infos = parts.recv(min_envs=2)
            sizes.append(len(reward))
            received += len(reward)
            for row, index in enumerate(infos["env_id"]):
                there = expected[taken[index]]
                self.assertTrue(equal(seen[row], there[0][index]))
                self.assertEqual((reward[row], terminated[row], truncated[row]), (there[1][index], there[2][index], there[3][index]))
                if terminated[row] or truncated[row]:
                    self.assertTrue(infos["_score"][row])
                    self.assertEqual(infos["episode_return"][row], there[4]["episode_return"][index])
            taken[infos["env_id"]] += 1
            again = [index for index in infos["env_id"] if taken[index] < 20]
            if again:
                parts.send(np.stack([actions[taken[index], index] for index in again]), again)
        self.assertEqual(taken.tolist(), [20] * 5)
        self.assertGreaterEqual(min(sizes[:10]), 2)
        self.assertEqual(parts.get_state(4).hash(), whole.get_state(4).hash())
        self.assertTrue(equal(parts.step(actions[0])[0], whole.step(actions[0])[0]))  # whole batches again
        whole.close(), parts.close()

    def test_autoreset_modes_are_gymnasiums(self):
        made = {mode: comrad.vector_env("basic", num_envs=2, autoreset_mode=mode, **ENDS) for mode in AutoresetMode}
        for mode, envs in made.items():
            self.assertEqual(envs.metadata["autoreset_mode"], mode)
            envs.reset(seed=4)
        self.assertEqual(comrad.vector_env("basic", num_envs=1, autoreset_mode="SameStep", **SMALL).metadata["autoreset_mode"], AutoresetMode.SAME_STEP)
        nothing = np.zeros((2, *made[AutoresetMode.DISABLED].single_action_space.shape), int)
        for _ in range(5):
            for envs in made.values():
                envs.step(nothing)
        last = {mode: envs.step(nothing) for mode, envs in made.items()}
        following = made[AutoresetMode.NEXT_STEP].step(nothing)
        same, off = last[AutoresetMode.SAME_STEP], last[AutoresetMode.DISABLED]
        for index in range(2):
            self.assertTrue(equal(same[4]["final_obs"][index], last[AutoresetMode.NEXT_STEP][0][index]))
        self.assertTrue(same[3].all() and same[4]["_final_obs"].all())
        self.assertTrue(equal(same[0], following[0]))
        self.assertEqual(same[4]["final_info"]["episode_length"].tolist(), [6, 6])
        self.assertNotIn("score", same[4])
        self.assertTrue(equal(off[0], last[AutoresetMode.NEXT_STEP][0]))
        again, _ = made[AutoresetMode.DISABLED].reset(options={"reset_mask": np.array([True, False])})
        self.assertTrue(equal(again[0], following[0][0]))
        self.assertTrue(equal(again[1], off[0][1]))
        for envs in made.values():
            envs.close()

    def test_gymnasiums_vector_wrappers_take_them(self):
        for mode in ("NextStep", "SameStep"):
            for options in ({"num_agents": 1}, {"num_agents": 2, "team_reward": True}):
                with self.subTest(mode, **options):
                    scenario, more = ("basic", ENDS) if options["num_agents"] == 1 else ("coop_health_gathering", {"frame_skip": 100, **SMALL})
                    envs = comrad.vector_env(scenario, num_envs=3, autoreset_mode=mode, **options, **more)
                    envs = wrappers.RecordEpisodeStatistics(envs)
                    if mode == "NextStep":  # the others refuse SameStep
                        envs = wrappers.NormalizeReward(wrappers.ClipReward(envs, -1, 1))
                        envs = wrappers.NormalizeObservation(wrappers.DtypeObservation(envs, np.float32))
                        envs = wrappers.FlattenObservation(envs)
                    envs.reset(seed=1)
                    returns = []
                    for _ in range(60):
                        seen, reward, terminated, truncated, infos = envs.step(envs.action_space.sample())
                        self.assertEqual(reward.shape, (3,))
                        if "episode" in infos:
                            returns += infos["episode"]["r"][infos["_episode"]].tolist()
                            account = infos if mode == "NextStep" else infos["final_info"]
                            told = account["episode_return"].reshape(3, -1).sum(-1)[infos["_episode"]]
                            np.testing.assert_allclose(infos["episode"]["r"][infos["_episode"]], told, rtol=1e-4)
                            np.testing.assert_array_equal(infos["episode"]["l"][infos["_episode"]], account["episode_length"][infos["_episode"]])
                    self.assertGreater(len(returns), 2)
                    envs.close()


if __name__ == "__main__":
    unittest.main()
