#!/usr/bin/env python3
"""Episodes that `comrad eval --episodes_dir` wrote are played again in Python, to the bit; damaged files are refused.

    COMRAD_PROGRAM=build/bin/comrad PYTHONPATH=build/python episodes_test.py [unittest arguments]
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

from package import comrad  # first: it ends the test where the package is not there

PROGRAM = os.environ.get("COMRAD_PROGRAM", "")
if not os.access(PROGRAM, os.X_OK):
    print(f"[  SKIPPED ] 1 test, episodes in Python: no program comrad at '{PROGRAM}'; build it, or name it with COMRAD_PROGRAM")
    sys.exit(77)


class Episodes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name) / "episodes"
        cls.evaluate(cls, "random", cls.folder)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def evaluate(self, policy, folder, *more):
        command = [PROGRAM, "eval", "--scenario", "coop_health_gathering", "--policy", policy, "--episodes", "3", "--layout_seed", "5",
                   "--episodes_dir", str(folder), "--json", *more]
        done = subprocess.run(command, capture_output=True, text=True, timeout=200)
        if done.returncode != 0:
            raise AssertionError(done.stderr[-2000:])
        return json.loads(done.stdout)

    def replay(self, episode):
        totals, steps = [0.0] * episode.num_agents, 0
        for _, rewards, _, _, infos in episode.replay(size=(16, 16)):
            for index, agent in enumerate(rewards):
                totals[index] += rewards[agent]
            steps += bool(rewards)
        return totals, steps, infos

    def test_every_episode_plays_again(self):
        files = sorted(self.folder.glob("*.comrad"))
        self.assertEqual([file.name for file in files], [f"episode_000{number}.comrad" for number in range(3)])
        seeds = set()
        for file in files:
            episode = comrad.load_episode(file)
            seeds.add(episode.episode_seed)
            totals, steps, infos = self.replay(episode)  # compares the worlds at the end
            self.assertEqual(steps, len(episode.actions))
            self.assertEqual(infos["agent_0"]["score"], episode.score)
            self.assertEqual(infos["agent_0"]["length_tics"], episode.length_tics)
            for total, told in zip(totals, episode.returns):
                self.assertAlmostEqual(total, told, places=2)
        self.assertEqual(len(seeds), 3)
        self.assertGreater(len({tuple(row) for row in episode.actions[:, 0].tolist()}), 5)  # it was random

    def test_the_scripted_team_on_a_pool(self):
        folder = pathlib.Path(self.scratch.name) / "pool"
        answer = self.evaluate("oracle", folder, "--layout_pool", "train:2", "--each")
        self.assertEqual(len(list((folder / "maps").iterdir())), 2)
        episode = comrad.load_episode(folder / "episode_0001.comrad")
        self.assertEqual(episode.score, answer["each"][1]["J"])
        self.replay(episode)

    def test_another_world_is_told(self):
        episode = comrad.load_episode(self.folder / "episode_0000.comrad")
        episode.actions = episode.actions.copy()
        episode.actions[0] = 1
        with self.assertRaisesRegex(RuntimeError, "the replay ends in world|the episode is over"):
            try:
                self.replay(episode)
            except ValueError as error:  # it ended before its actions did
                raise RuntimeError(str(error)) from None

    def test_damaged_files_are_refused(self):
        good = (self.folder / "episode_0000.comrad").read_bytes()
        head, _, data = good.partition(b"\n")
        about = json.loads(head)
        changed = lambda **more: json.dumps({**about, **more}).encode() + b"\n" + data  # noqa: E731
        for words, content in (
            ("its first line is no JSON", b"\x00\x01"),
            ("not an episode", b'{"format": "x"}\n'),
            ("format version 2", changed(version=2)),
            ("it is cut off", good[:-1]),
            ("an action lies outside its head", head + b"\n" + b"\xff" * len(data)),
            ("lies outside its folder", changed(map="../../etc/passwd")),
            ("is missing; keep the folder maps", changed(map="maps/none.wad")),
            ("'episode_seed' is missing", json.dumps({key: value for key, value in about.items() if key != "episode_seed"}).encode() + b"\n" + data),
            ("bytes of actions for", changed(decisions=-1)),
        ):
            bad = self.folder / "bad.comrad"
            bad.write_bytes(content)
            with self.assertRaisesRegex(ValueError, words):
                comrad.load_episode(bad)
            bad.unlink()
        with self.assertRaisesRegex(FileNotFoundError, "no such episode"):
            comrad.load_episode(self.folder / "none.comrad")


if __name__ == "__main__":
    unittest.main()
