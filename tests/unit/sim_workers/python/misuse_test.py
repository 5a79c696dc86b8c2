#!/usr/bin/env python3
"""What callers do wrong: each is an exception with words, and the environment continues.

    PYTHONPATH=build/python misuse_test.py [unittest arguments]
"""

import contextlib
import copy
import gc
import importlib.util
import io
import os
import pickle
import signal
import tempfile
import threading
import unittest
import unittest.mock

from package import comrad  # first: it ends the test where the package is not there

import numpy as np

SMALL = {"size": (16, 16)}


class Misuse(unittest.TestCase):
    def refuses(self, kind, words, call, *arguments, **options):
        """`call` raises `kind` with all of `words` in its message."""
        with self.assertRaises(kind) as caught:
            call(*arguments, **options)
        for word in words.split("|"):
            self.assertIn(word, str(caught.exception))

    def test_arguments_that_cannot_be(self):
        make = comrad.parallel_env
        self.refuses(FileNotFoundError, "stag_hunt_arena", make, "stag_hunt_aren")
        self.refuses(FileNotFoundError, "nowhere.cfg", make, "nowhere.cfg")
        self.refuses(ValueError, "starts for 4 players, not for 9", make, "stag_hunt_arena", num_agents=9)
        self.refuses(ValueError, "env_frameskip is 0", make, "stag_hunt_arena", frame_skip=0)
        self.refuses(ValueError, "width is 8|16..4096", make, "stag_hunt_arena", size=(8, 72))
        self.refuses(ValueError, "'smell' is none of", make, "stag_hunt_arena", observations=("smell",))
        self.refuses(ValueError, "automap_mode 'ALL' is none of NORMAL, WHOLE", make, "stag_hunt_arena", automap_mode="ALL")
        self.refuses(FileNotFoundError, "no such folder", make, "basic", folder="/nowhere")
        self.refuses(ValueError, "render_mode 'ascii'", make, "stag_hunt_arena", render_mode="ascii")
        self.refuses(ValueError, "no_such", make, "stag_hunt_arena", reward="no_such=1")
        self.refuses(ValueError, "FLY", make, "stag_hunt_arena", heads="FLY")
        self.refuses(TypeError, "observations is a list of names|('depth',)", make, "stag_hunt_arena", observations="depth")
        self.refuses(TypeError, "size is 128; (width, height)", make, "stag_hunt_arena", size=128)
        self.refuses(TypeError, "render_size's height is 2.5", make, "stag_hunt_arena", render_size=(64, 2.5))
        self.refuses(TypeError, "frame_skip is 2.5; a whole number", make, "stag_hunt_arena", frame_skip=2.5)
        self.refuses(TypeError, "num_agents is True", make, "stag_hunt_arena", num_agents=True)
        self.refuses(ValueError, "num_agents is 0; a team has", make, "stag_hunt_arena", num_agents=0)
        self.refuses(TypeError, "num_envs is '4'", comrad.vector_env, "stag_hunt_arena", num_envs="4")
        self.refuses(TypeError, "max_buttons_pressed is 0.5", comrad.gym_env, "basic", max_buttons_pressed=0.5)
        self.refuses(ValueError, "radios", make, "stag_hunt_arena", layout={"radios": 1})
        self.refuses(TypeError, "a layout seed is an integer, not str", make, "stag_hunt_arena", layout={"seed": "x"})
        self.refuses(ValueError, "seed -1", comrad.draw_map, "stag_hunt_arena", seed=-1)
        self.refuses(TypeError, "automap_mode is 3; a text", make, "stag_hunt_arena", automap_mode=3)
        self.refuses(ValueError, "layout seed -1", make, "stag_hunt_arena", layout=-1)
        self.refuses(TypeError, "layout is a float", make, "stag_hunt_arena", layout=1.5)
        self.refuses(FileNotFoundError, "gone.wad: no such WAD", make, "stag_hunt_arena", layout="gone.wad")
        self.refuses(ValueError, "num_envs is 0", comrad.vector_env, "stag_hunt_arena", num_envs=0)
        self.refuses(ValueError, "num_threads is 0", comrad.vector_env, "stag_hunt_arena", num_threads=0)
        self.refuses(ValueError, "a scenario for a team|comrad.parallel_env('stag_hunt_arena')", comrad.gym_env, "stag_hunt_arena")
        self.refuses(ValueError, "comrad/LavaPit-v2: this package has version 1", make, "comrad/LavaPit-v2")
        self.refuses(ValueError, "dtype 'float64': it is one of uint8, float32", make, "lava_pit", dtype="float64")
        self.refuses(ValueError, "dtype 'float32' requires copy=True", comrad.vector_env, "lava_pit", dtype="float32", copy=False)
        self.refuses(ValueError, "autoreset_mode 'Later': it is one of 'NextStep', 'SameStep', 'Disabled'", comrad.vector_env, "lava_pit",
                     autoreset_mode="Later")
        self.refuses(ValueError, "max_buttons_pressed -1", comrad.gym_env, "basic", max_buttons_pressed=-1)
        with tempfile.TemporaryDirectory() as folder:
            self.refuses(FileNotFoundError, "without a .wad", make, "stag_hunt_arena", layout=folder)
            with open(f"{folder}/bad.wad", "wb") as file:
                file.write(b"no WAD at all, but long enough for a header")
            self.refuses(ValueError, "bad.wad", make, "stag_hunt_arena", layout=f"{folder}/bad.wad")
            other = f"{folder}/other.wad"
            with open(other, "wb") as file:
                file.write(comrad.draw_map("lava_pit"))
            self.refuses(ValueError, "lava_pit", make, "stag_hunt_arena", layout=other)

    @unittest.skipUnless(importlib.util.find_spec("pygame"), "without pygame")
    @unittest.mock.patch.dict(os.environ)
    def test_a_window_without_a_display(self):
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
            os.environ.pop(name, None)
        env = comrad.parallel_env("lava_pit", render_mode="human", **SMALL)
        with contextlib.redirect_stdout(io.StringIO()):
            self.refuses(RuntimeError, 'needs a display|use render_mode "rgb_array"', env.reset, seed=1)
        env.close()

    def test_steps_at_the_wrong_time(self):
        env = comrad.parallel_env("coop_puzzle", **SMALL)
        action = {agent: env.action_space(agent).sample() for agent in env.possible_agents}
        self.refuses(ValueError, "call reset() before", env.step, action)
        self.refuses(ValueError, "call reset() before", env.get_state)
        self.refuses(ValueError, "call reset() before state()", env.state)
        self.refuses(TypeError, "a seed is an integer", env.reset, seed="1")
        self.refuses(ValueError, "seed -1", env.reset, seed=-1)
        env.reset(seed=1)
        self.refuses(ValueError, "agent_1 is missing", env.step, {"agent_0": action["agent_0"]})
        self.refuses(TypeError, "actions is a list; a dictionary", env.step, [action["agent_0"]])
        self.refuses(TypeError, "not NoneType", env.set_state, None)
        for wrong in (0, [0], np.zeros(99, int), np.zeros(len(action["agent_0"])), "left", None):
            self.refuses(ValueError, "action of agent_0", env.step, {**action, "agent_0": wrong})
        self.refuses(ValueError, "agent 1, head 0: it must lie in 0..", env.step, {**action, "agent_1": np.array([7, *[0] * (len(action["agent_1"]) - 1)])})
        env.step(action)  # it continues
        self.refuses(TypeError, "in the middle of an episode|neither copied nor pickled|get_state()", copy.deepcopy, env)
        self.refuses(TypeError, "neither copied nor pickled", pickle.dumps, env)
        env.close()
        for call in (lambda: env.step(action), env.reset, env.get_state, env.state_hash, lambda: env.set_state(None)):
            self.assertRaises((ValueError, TypeError), call)
        self.refuses(ValueError, "were closed", env.reset)
        env.close()

    def test_an_episode_that_is_over_is_not_stepped(self):
        env = comrad.gym_env("basic", frame_skip=50, **SMALL)
        env.reset(seed=1)
        nothing = np.zeros(3, np.int8)
        for _ in range(6):
            over = env.step(nothing)[3]
        self.assertTrue(over)
        self.refuses(ValueError, "the episode is over", env.step, nothing)
        env.reset()
        self.refuses(ValueError, "is not in MultiBinary(3)", env.step, np.zeros(4, np.int8))
        env.step(nothing)
        env.close()
        deltas = comrad.gym_env("deathmatch", **SMALL)
        deltas.reset(seed=1)
        binary = np.zeros(deltas.action_space["binary"].n, np.int8)
        self.assertRaises(ValueError, deltas.step, {"binary": binary, "continuous": np.array([0, np.nan, 0], np.float32)})
        deltas.close()

    def test_batches_of_the_wrong_shape(self):
        envs = comrad.vector_env("lava_pit", num_envs=2, **SMALL)
        shape = envs.action_space.shape
        self.refuses(ValueError, "call reset() before", envs.step, np.zeros(shape, int))
        self.refuses(ValueError, "1 seeds were given for 2", envs.reset, seed=[1])
        self.refuses(ValueError, "seed 18446744073709551616", envs.reset, seed=2**64 - 1)
        self.refuses(ValueError, "reset_mask", envs.reset, options={"reset_mask": [1, 0]})
        envs.reset(seed=1)
        self.refuses(ValueError, "actions are float64", envs.step, np.zeros(shape))
        self.refuses(ValueError, "are wanted", envs.step, np.zeros((3, *shape[1:]), int))
        self.refuses(ValueError, "environment 1", envs.step, np.stack([np.zeros(shape[1:], int), np.full(shape[1:], 9)]))
        self.refuses(ValueError, "no step was sent", envs.recv)
        envs.send(np.zeros(shape, int))
        self.refuses(ValueError, "call recv() first", envs.send, np.zeros(shape, int))
        self.refuses(ValueError, "call recv() first", envs.get_state, 0)
        envs.recv()
        self.refuses(ValueError, "index is 2", envs.get_state, 2)
        envs.send(np.zeros(shape, int))
        envs.close()  # while a step is on its way

    def test_batches_that_are_sent_in_parts(self):
        envs = comrad.vector_env("lava_pit", num_envs=3, num_threads=2, **SMALL)
        one = np.zeros((1, *envs.action_space.shape[1:]), int)
        self.refuses(ValueError, "call reset() before", envs.send, one, [0])
        envs.reset(seed=1)
        self.refuses(ValueError, "index is 3", envs.send, one, [3])
        self.refuses(ValueError, f"integers {(2, *one.shape[1:])} are wanted", envs.send, one, [0, 1])
        self.refuses(ValueError, "environment 2", envs.send, one + 9, [2])
        self.refuses(ValueError, "min_envs counts environments", envs.recv, 1)
        envs.send(one, [2])
        self.refuses(ValueError, "environment 2 was sent a step already", envs.send, one, [2])
        self.refuses(ValueError, "steps of 1 environments were sent and not received; call recv() first", envs.step, np.repeat(one, 3, 0))
        self.refuses(ValueError, "call recv() first", envs.reset)
        self.refuses(ValueError, "min_envs is 0", envs.recv, 0)
        self.assertEqual(envs.recv(1)[4]["env_id"].tolist(), [2])
        self.refuses(ValueError, "no step was sent", envs.recv, 1)
        envs.send(one, [0])
        envs.close()  # while it is on its way
        same = comrad.vector_env("lava_pit", num_envs=2, autoreset_mode="SameStep", **SMALL)
        same.reset(seed=1)
        self.refuses(ValueError, "no autoreset_mode \"SameStep\"", same.send, one, [0])
        same.close()
        off = comrad.vector_env("basic", num_envs=1, autoreset_mode="Disabled", frame_skip=100, **SMALL)
        off.reset(seed=1)
        for _ in range(3):
            off.step(np.zeros(off.action_space.shape, int))
        self.refuses(ValueError, "the episode is over; call reset()", off.step, np.zeros(off.action_space.shape, int))
        off.close()

    def test_states_of_others_are_refused(self):
        env, other = comrad.parallel_env("lava_pit", **SMALL), comrad.parallel_env("coop_puzzle", **SMALL)
        faster = comrad.parallel_env("lava_pit", frame_skip=2, **SMALL)
        for one in (env, other, faster):
            one.reset(seed=1)
        self.refuses(ValueError, "the state is of lava_pit|coop_puzzle", other.set_state, env.get_state())
        self.refuses(ValueError, "frame skip 4", faster.set_state, env.get_state())
        narrower = comrad.parallel_env("lava_pit", heads=";".join(head[0] for head in comrad.describe("lava_pit")["heads"]), **SMALL)
        narrower.reset(seed=1)
        self.refuses(ValueError, "other heads or measurements", narrower.set_state, env.get_state())
        self.refuses(ValueError, "other heads or measurements", env.set_state, narrower.get_state())
        narrower.close()
        state = env.get_state()
        env.close()
        del env
        gc.collect()
        again = comrad.parallel_env("lava_pit", **SMALL)
        again.reset(seed=2)
        again.set_state(state)  # outlives what it was taken from
        self.assertEqual(again.state_hash(), state.hash())
        for one in (other, faster, again):
            one.close()

    def test_two_threads_take_no_turns(self):
        envs = comrad.vector_env("stag_hunt_arena", num_envs=8)
        envs.reset(seed=1)
        actions = np.zeros(envs.action_space.shape, int)
        refused, done = [], []

        def play():
            for _ in range(40):
                try:
                    envs.step(actions)
                    done.append(1)
                except ValueError as error:
                    refused.append(str(error))
                    try:
                        envs.recv()  # a step that the other sent and could not take would refuse all that follow
                        done.append(1)
                    except ValueError as again:
                        refused.append(str(again))

        threads = [threading.Thread(target=play) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertGreater(len(done), 0)
        for words in refused:
            self.assertRegex(words, "another thread|recv|no step was sent")
        try:
            envs.recv()  # one may have sent what the other's refusal left
        except ValueError:
            pass
        envs.step(actions)
        envs.close()

    def test_each_thread_may_have_its_own(self):
        hashes = {}

        def play(name):
            env = comrad.parallel_env("coop_puzzle", **SMALL)
            env.reset(seed=5)
            for _ in range(20):
                env.step({agent: np.zeros(env.action_space(agent).shape, int) for agent in env.agents})
            hashes[name] = env.state_hash()
            env.close()

        threads = [threading.Thread(target=play, args=(name,)) for name in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(set(hashes.values())), 1)
        self.assertEqual(len(hashes), 3)

    def test_a_child_process_makes_its_own(self):
        env = comrad.parallel_env("coop_puzzle", **SMALL)
        env.reset(seed=1)
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            signal.alarm(60)  # rather than hang
            words = ""
            try:
                env.reset()
            except ValueError as error:
                words = str(error)
            try:
                env.close()
                own = comrad.parallel_env("coop_puzzle", **SMALL)
                own.reset(seed=1)
                own.close()
                words += "; its own plays"
            except Exception as error:  # noqa: BLE001 (sent to the parent)
                words += repr(error)
            os.write(write, words.encode())
            os._exit(0)
        os.close(write)
        with os.fdopen(read) as told:
            words = told.read()
        self.assertEqual(os.waitpid(child, 0)[1], 0)
        self.assertIn("another process", words)
        self.assertIn("its own plays", words)
        env.reset(seed=1)
        env.close()

    def test_environments_that_nobody_closes_end(self):
        before = threading.active_count()
        for _ in range(5):
            comrad.vector_env("lava_pit", num_envs=2, **SMALL).reset(seed=1)
        gc.collect()
        self.assertEqual(threading.active_count(), before)
        with open("/proc/self/status", encoding="utf-8") as file:
            threads = next(int(line.split()[1]) for line in file if line.startswith("Threads:"))
        self.assertLess(threads, before + 10)


if __name__ == "__main__":
    unittest.main()
