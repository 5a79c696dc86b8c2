#!/usr/bin/env python3
"""Labels, depth and automap: true to themselves, and beside those of ViZDoom on maps of Freedoom.

    PYTHONPATH=build/python buffers_test.py [unittest arguments]
"""

import os
import tempfile
import unittest
import warnings

from package import comrad, equal, random_actions  # first: it ends the test where the package is not there

import numpy as np

try:
    import vizdoom
    from vizdoom.gymnasium_wrapper.base_gymnasium_env import VizdoomEnv
except ImportError:
    vizdoom = None

CFG = """
doom_game_path = {wad}
doom_map = {map}
screen_resolution = RES_320X240
screen_format = RGB24
available_buttons = {{ MOVE_FORWARD TURN_LEFT }}
render_hud = false
render_weapon = false
episode_timeout = 1000
depth_buffer_enabled = true
labels_buffer_enabled = true
automap_buffer_enabled = true
automap_mode = {mode}
automap_render_textures = false
"""
UNITS_A_STEP = 7.2  # of ViZDoom's depths, which are whole bytes and lie a step below; measured on MAP02
EARTH = np.array([111, 87, 67])  # of an automap without lines


def box_of(pixels):
    ys, xs = np.nonzero(pixels)
    return xs.min(), ys.min(), xs.max() + 1 - xs.min(), ys.max() + 1 - ys.min()


def lines_of(automap):
    return np.abs(automap.astype(int) - EARTH).sum(-1) > 30


class Labels(unittest.TestCase):
    def check(self, picture, labels):
        """Every value has its own label whose box holds its pixels exactly; nearer things have higher ones."""
        self.assertEqual([label.value for label in labels], sorted({*np.unique(picture)} - {0, 1}))
        for label in labels:
            self.assertEqual((label.x, label.y, label.width, label.height), box_of(picture == label.value), label)

    def test_they_are_of_what_each_agent_sees(self):
        env = comrad.parallel_env("ammo_carrier", observations=("labels", "depth"), size=(160, 90))
        seen, _ = env.reset(seed=3)
        rng = np.random.default_rng(3)
        names, nearness = set(), []
        for _ in range(30):
            seen, *_ = env.step(random_actions(env, rng))
            own = dict(zip(env.state_names, env.state()))
            for agent in env.agents:
                labels = env.labels(agent)
                self.check(seen[agent]["labels"], labels)
                names.update(label.object_name for label in labels)
                eye = np.array([own[f"{agent}/x"], own[f"{agent}/y"]])
                ahead = np.array([own[f"{agent}/cos_angle"], own[f"{agent}/sin_angle"]])
                depths = [(np.array([label.object_position_x, label.object_position_y]) - eye) @ ahead for label in labels if label.value < 255]
                self.assertEqual(depths, sorted(depths, reverse=True))
                for label, depth in zip(labels, depths):
                    there = seen[agent]["depth"][seen[agent]["labels"] == label.value]
                    nearness.append(abs(np.median(there) - depth) / depth)
                mine = [label for label in labels if label.value == 255]  # the weapon, and whose it is
                self.assertTrue(all(abs(label.object_position_x - eye[0]) < 0.1 for label in mine))
        self.assertGreater(len(names), 1)
        self.assertLess(np.quantile(nearness, 0.9), 0.02)
        env.close()

    def test_a_batch_has_them_too(self):
        envs = comrad.vector_env("stag_hunt_arena", num_envs=3, observations=("labels", "automap"), channels_first=True)
        seen, _ = envs.reset(seed=1)
        self.assertEqual(seen["labels"].shape, (3, 2, 72, 128))
        self.assertEqual(seen["automap"].shape, (3, 2, 3, 72, 128))
        self.assertTrue(envs.observation_space.contains(seen))
        for index in range(3):
            for agent in range(2):
                self.check(seen["labels"][index, agent], envs.labels(index, agent))
                self.assertGreater(lines_of(seen["automap"][index, agent].transpose(1, 2, 0)).sum(), 20)
        with self.assertRaisesRegex(ValueError, "agent's index is 2"):
            envs.labels(0, 2)
        envs.close()
        with self.assertRaisesRegex(ValueError, "closed"):
            envs.labels(0)

    def test_who_did_not_ask_has_none(self):
        env = comrad.parallel_env("stag_hunt_arena")
        env.reset(seed=1)
        with self.assertRaisesRegex(ValueError, "have no labels; request them"):
            env.labels("agent_0")
        with self.assertRaisesRegex(ValueError, "agent 'agent_7' is none of"):
            env.labels("agent_7")
        env.close()


class Automap(unittest.TestCase):
    def make(self, mode):
        return comrad.parallel_env("armory_siege", observations=("automap",), automap_mode=mode, size=(160, 120))

    def test_what_was_seen_stays_on_it(self):
        env = self.make("normal")
        heads = comrad.describe("armory_siege")["heads"]
        turn = np.array([head.index("TURN_LEFT") + 1 if "TURN_LEFT" in head else 0 for head in heads])
        begun = env.reset(seed=1)[0]["agent_0"]["automap"]
        for _ in range(30):
            seen = env.step({agent: turn for agent in env.agents})[0]["agent_0"]["automap"]
        self.assertGreater(lines_of(seen).sum(), lines_of(begun).sum())
        state = env.get_state()
        env.reset(seed=1)
        self.assertTrue(equal(env.set_state(state)["agent_0"]["automap"], seen))
        self.assertTrue(equal(env.reset(seed=1)[0]["agent_0"]["automap"], begun))  # a new episode has seen nothing
        env.close()

    def test_every_mode_shows_more(self):
        counts = []
        for mode in ("NORMAL", "WHOLE", "OBJECTS", "OBJECTS_WITH_SIZE"):
            env = self.make(mode)
            counts.append(lines_of(env.reset(seed=1)[0]["agent_0"]["automap"]).sum())
            env.close()
        self.assertEqual(counts, sorted(set(counts)), counts)


class Files(unittest.TestCase):
    def test_a_cfg_says_what_is_seen(self):
        with tempfile.TemporaryDirectory() as folder:
            with open(f"{folder}/mine.cfg", "w", encoding="utf-8") as file:
                file.write("available_buttons = { ATTACK }\nlabels_buffer_enabled = true\nautomap_buffer_enabled = true\n"
                           "automap_mode = WHOLE\naudio_buffer_enabled = true\n")
            with self.assertWarnsRegex(UserWarning, "mine.cfg:5: audio_buffer_enabled is not served"):
                env = comrad.gym_env("mine", folder=folder, size=(64, 48))
            self.assertEqual(set(env.observation_space.spaces), {"screen", "labels", "automap"})
            whole = env.reset(seed=1)[0]["automap"]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                other = comrad.gym_env("mine", folder=folder, size=(64, 48), labels=False, automap_mode="NORMAL")
            self.assertEqual(set(other.observation_space.spaces), {"screen", "automap"})
            self.assertLess(lines_of(other.reset(seed=1)[0]["automap"]).sum(), lines_of(whole).sum())
            env.close(), other.close()


@unittest.skipUnless(vizdoom, "needs the package vizdoom")
class BesideVizdoom(unittest.TestCase):
    """The first picture of maps whose things stand where the map puts them."""

    def first_pictures(self, name, mode):
        with tempfile.TemporaryDirectory() as folder:
            path = f"{folder}/{name}.cfg"
            with open(path, "w", encoding="utf-8") as file:
                file.write(CFG.format(wad=os.path.join(os.path.dirname(vizdoom.__file__), "freedoom2.wad"), map=name, mode=mode))
            theirs, ours = VizdoomEnv(path, sound_enabled=False), comrad.gym_env(path)
            there, here = theirs.reset(seed=1)[0], ours.reset(seed=1)[0]
            their_labels, our_labels = theirs.state.labels, ours.labels()
            theirs.close(), ours.close()
        return there, here, their_labels, our_labels

    def test_the_same_things_show_in_the_same_places(self):
        for name, least in (("MAP02", 6), ("MAP07", 5)):
            with self.subTest(name):
                there, here, their_labels, our_labels = self.first_pictures(name, "NORMAL")
                kind = [np.minimum(picture["labels"][..., 0], 2) for picture in (there, here)]
                self.assertGreater((kind[0] == kind[1]).mean(), 0.97)
                key = lambda label: (label.object_name.lower(), round(label.object_position_x), round(label.object_position_y))  # noqa: E731
                found = {key(label): label for label in our_labels}
                seen = [label for label in their_labels if label.width * label.height >= 16]  # smaller ones come and go with a pixel
                self.assertGreaterEqual(len(seen), least)
                self.assertLessEqual({key(label) for label in seen}, set(found))
                self.assertLessEqual({one for one, label in found.items() if label.width * label.height >= 25}, {key(label) for label in their_labels})
                for label in seen:
                    mine = found[key(label)]
                    for theirs, ours in ((label.x, mine.x), (label.y, mine.y), (label.x + label.width, mine.x + mine.width),
                                         (label.y + label.height, mine.y + mine.height)):
                        self.assertLessEqual(abs(theirs - ours), 2, (name, label.object_name, label.x, label.y, mine))

    def test_depths_agree(self):
        for name in ("MAP02", "MAP07"):
            with self.subTest(name):
                there, here, *_ = self.first_pictures(name, "NORMAL")
                theirs, ours = there["depth"][..., 0].astype(float), here["depth"][..., 0]
                both = (theirs > 4) & (theirs < 255) & (ours > 0)
                self.assertGreater(both.mean(), 0.5)
                self.assertGreater((abs(ours[both] / UNITS_A_STEP - 1 - theirs[both]) < 1.5).mean(), 0.95)

    def test_automaps_agree(self):
        for mode in ("WHOLE", "OBJECTS"):
            with self.subTest(mode):
                there, here, *_ = self.first_pictures("MAP07", mode)
                theirs, ours = lines_of(there["automap"]), lines_of(here["automap"])
                near = np.logical_or.reduce([np.roll(ours, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)])
                self.assertGreater((theirs & near).sum() / theirs.sum(), 0.9)
                self.assertLess(abs(ours.sum() / theirs.sum() - 1), 0.3)


if __name__ == "__main__":
    unittest.main()
