#!/usr/bin/env python3
"""The spaces of comrad.gym_env beside those of ViZDoom's own wrapper, for every .cfg of the vizdoom package that both load.

    PYTHONPATH=build/python spaces_test.py [unittest arguments]
"""

import glob
import os
import sys
import tempfile
import unittest
import warnings

from package import comrad  # first: it ends the test where the package is not there

import gymnasium
import numpy as np

from comrad.batch import gray

try:
    import vizdoom
    from vizdoom.gymnasium_wrapper.base_gymnasium_env import VizdoomEnv
except ImportError as missing:
    print(f"[  SKIPPED ] 1 test, ViZDoom's spaces: {missing}; ./comrad test installs it")
    sys.exit(77)

NOT_HERE = {"audio", "notifications"}
BUFFERS = ("depth", "labels", "automap")


def single_player_configs():
    for path in sorted(glob.glob(os.path.join(vizdoom.scenarios_path, "*.cfg"))):
        with open(path, encoding="utf-8") as file:
            text = file.read()
        if "-host" not in text:
            yield os.path.splitext(os.path.basename(path))[0], path


def numbered_here(env):
    """The names of the buttons that each number of a Discrete action presses."""
    space = env.action_space
    rest = None
    if isinstance(space, gymnasium.spaces.Dict):
        space, rest = space["binary"], np.zeros(space["continuous"].shape, np.float32)
    for number in range(space.n):
        values = env._values_of(number if rest is None else {"binary": number, "continuous": rest})
        yield [name for name, value in zip(env.button_names, values) if value]


def numbered_there(env):
    names = [button.name for button in env.game.get_available_buttons()][env.num_delta_buttons :]
    for pressed in env.button_map:
        yield [name for name, held in zip(names, pressed) if held]


class Spaces(unittest.TestCase):
    def test_they_have_the_names_sizes_and_types_of_vizdooms(self):
        compared = 0
        for name, path in single_player_configs():
            for most in (0, 1, 2, 3):
                with self.subTest(name, max_buttons_pressed=most):
                    theirs = VizdoomEnv(path, max_buttons_pressed=most, sound_enabled=False)
                    height, width, _ = theirs.observation_space["screen"].shape
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")  # of what is not here
                        ours = comrad.gym_env(path, max_buttons_pressed=most, size=(width, height))
                    self.assertEqual(str(ours.action_space), str(theirs.action_space))
                    wanted = {key: space for key, space in theirs.observation_space.spaces.items() if key not in NOT_HERE}
                    self.compare(ours, wanted)
                    if most:
                        self.assertEqual(list(numbered_here(ours)), list(numbered_there(theirs)))
                    theirs.close()
                    ours.close()
                    compared += 1
        self.assertGreater(compared, 40)

    def compare(self, ours, wanted):
        self.assertEqual(set(ours.observation_space.spaces), set(wanted))
        for key, space in wanted.items():
            self.assertEqual(ours.observation_space[key].shape, space.shape, key)
            if key != "depth":  # bytes there, map units here
                self.assertEqual(ours.observation_space[key].dtype, space.dtype, key)

    def test_all_buffers_are_asked_for_as_there(self):
        path = os.path.join(vizdoom.scenarios_path, "basic.cfg")
        theirs = VizdoomEnv(path, screen_format=vizdoom.ScreenFormat.RGB24, sound_enabled=False, **{f"{name}_buffer_enabled": True for name in BUFFERS})
        height, width, _ = theirs.observation_space["screen"].shape
        ours = comrad.gym_env(path, size=(width, height), **{name: True for name in BUFFERS})
        self.compare(ours, theirs.observation_space.spaces)
        theirs.close()
        ours.close()

    def test_every_screen_format_has_the_spaces_of_the_wrapper(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in vizdoom.ScreenFormat.__members__:
                with self.subTest(name):
                    path = os.path.join(folder, f"{name}.cfg")
                    with open(path, "w", encoding="utf-8") as file:
                        file.write(f"doom_scenario_path = {vizdoom.scenarios_path}/basic.wad\navailable_buttons = {{ ATTACK }}\n"
                                   f"screen_format = {name}\nautomap_buffer_enabled = true\n")
                    theirs = VizdoomEnv(path, sound_enabled=False)
                    ours = comrad.gym_env(path)
                    self.compare(ours, theirs.observation_space.spaces)
                    self.assertTrue(ours.observation_space.contains(ours.reset(seed=1)[0]))
                    theirs.close()
                    ours.close()
            coloured, path = comrad.gym_env(os.path.join(folder, "RGB24.cfg")), os.path.join(folder, "GRAY8.cfg")
            options = {"dtype": "float32", "channels_first": True, "size": (64, 48)}
            pictures, first = comrad.gym_env(path), comrad.gym_env(path, **options)
            there, here, planes = coloured.reset(seed=1)[0], pictures.reset(seed=1)[0], first.reset(seed=1)[0]
            for key in ("screen", "automap"):
                self.assertTrue(np.array_equal(here[key], gray(there[key], -1)), key)
                self.assertEqual((planes[key].shape, planes[key].dtype), ((1, 48, 64), np.float32))
            self.assertTrue(first.observation_space.contains(planes))
            with self.assertWarnsRegex(UserWarning, "GRAY8, but pictures are RGB here; comrad.gym_env has gray ones"):
                envs = comrad.vector_env(path, num_envs=1)
            for one in (coloured, pictures, first, envs):
                one.close()

    def test_gray_is_vizdooms(self):
        seen = {}
        for screen_format in (vizdoom.ScreenFormat.RGB24, vizdoom.ScreenFormat.GRAY8):
            theirs = VizdoomEnv(os.path.join(vizdoom.scenarios_path, "deadly_corridor.cfg"), screen_format=screen_format, sound_enabled=False)
            seen[screen_format] = theirs.reset(seed=1)[0]["screen"]
            theirs.close()
        coloured, there = seen.values()
        self.assertTrue(np.array_equal(gray(coloured, -1), there))

    def test_the_variables_of_a_game_begin_as_vizdooms(self):
        for name in ("basic", "defend_the_center", "health_gathering", "deadly_corridor"):
            with self.subTest(name):
                path = os.path.join(vizdoom.scenarios_path, name + ".cfg")
                theirs, ours = VizdoomEnv(path, sound_enabled=False), comrad.gym_env(name, size=(64, 48))
                there, here = theirs.reset(seed=1)[0], ours.reset(seed=1)[0]
                self.assertEqual(here["gamevariables"].tolist(), there["gamevariables"].tolist())
                theirs.close()
                ours.close()


if __name__ == "__main__":
    unittest.main()
