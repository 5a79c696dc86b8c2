#!/usr/bin/env python3
"""The spaces of comrad.gym_env beside those of ViZDoom's own wrapper, for every .cfg of the vizdoom package that both load.

    PYTHONPATH=build/python spaces_test.py [unittest arguments]
"""

import glob
import os
import sys
import unittest
import warnings

from package import comrad  # first: it ends the test where the package is not there

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


class Spaces(unittest.TestCase):
    def test_they_have_the_names_sizes_and_types_of_vizdooms(self):
        compared = 0
        for name, path in single_player_configs():
            for most in (0, 1, 2):
                with self.subTest(name, max_buttons_pressed=most):
                    theirs = VizdoomEnv(path, max_buttons_pressed=most, sound_enabled=False)
                    height, width, channels = theirs.observation_space["screen"].shape
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")  # of what is not here
                        ours = comrad.gym_env(path, max_buttons_pressed=most, size=(width, height))
                    self.assertEqual(str(ours.action_space), str(theirs.action_space))
                    wanted = {key: space for key, space in theirs.observation_space.spaces.items() if key not in NOT_HERE}
                    self.compare(ours, wanted, channels)
                    theirs.close()
                    ours.close()
                    compared += 1
        self.assertGreater(compared, 30)

    def compare(self, ours, wanted, channels=3):
        self.assertEqual(set(ours.observation_space.spaces), set(wanted))
        for key, space in wanted.items():
            if key in ("screen", "automap") and channels == 1:
                continue  # grey there, colours here
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
