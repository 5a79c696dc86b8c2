#!/usr/bin/env python3
"""comrad.Run over made-up folders, damaged ones among them.

    PYTHONPATH=build/python runs_test.py [unittest arguments]
"""

import json
import pathlib
import tempfile
import unittest

from package import comrad  # first: it ends the test where the package is not there

import numpy as np


class Runs(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def test_what_is_no_run_is_refused(self):
        with self.assertRaisesRegex(FileNotFoundError, "no config.toml"):
            comrad.Run(self.folder)

    def test_a_run_that_has_just_begun(self):
        self.write("config.toml", 'algo = "vdn"\nseed = 3\n')
        run = comrad.Run(self.folder)
        self.assertEqual(run.settings, {"algo": "vdn", "seed": 3})
        self.assertEqual((run.status, run.reports(), run.metrics(), run.checkpoints(), run.best_checkpoint()), ({}, [], {}, [], None))

    def test_metrics_are_columns(self):
        self.write("config.toml", "")
        lines = [
            json.dumps({"time_s": 1.0, "env_frames": 100, "train/loss": 0.5}),
            json.dumps({"time_s": 2.0, "env_frames": 200, "train/loss": 0.4}),
            json.dumps({"time_s": 3.0, "env_frames": 150, "reward/reward": None, "J": 2}),  # back at a checkpoint of 150
            '{"time_s": 4.0, "env_fra',
        ]
        self.write("metrics.jsonl", "\n".join(lines))
        metrics = comrad.Run(self.folder).metrics()
        self.assertEqual(metrics["env_frames"].tolist(), [100, 150])
        np.testing.assert_array_equal(metrics["train/loss"], [0.5, np.nan])
        np.testing.assert_array_equal(metrics["J"], [np.nan, 2])
        self.assertNotIn("reward/reward", metrics)

    def test_an_evaluation_that_comes_late_forgets_nothing(self):
        self.write("config.toml", "")
        lines = [{"time_s": 1, "env_frames": 100}, {"time_s": 2, "env_frames": 200}, {"time_s": 3, "env_frames": 100, "eval/J": 7}]
        self.write("metrics.jsonl", "\n".join(map(json.dumps, lines)))
        self.assertEqual(comrad.Run(self.folder).metrics()["env_frames"].tolist(), [100, 100, 200])

    def test_checkpoints_come_in_their_order(self):
        self.write("config.toml", "")
        for name in ("checkpoint_000000009_36864.pt", "checkpoint_000000081_331776.pt", "milestone_000000040_163840.pt",
                     "best_7.250.pt", "best_-1.500.pt", "checkpoint_000000001_1.pt.broken", "notes.txt"):
            self.write(f"checkpoint/{name}", "")
        run = comrad.Run(self.folder)
        self.assertEqual([file.name.split("_")[-1] for file in run.checkpoints()], ["36864.pt", "163840.pt", "331776.pt"])
        self.assertEqual(run.best_checkpoint().name, "best_7.250.pt")

    def test_a_checkpoint_that_is_none_is_refused(self):
        try:
            import torch  # noqa: F401 (comrad.load_policy needs it)
        except ImportError:
            self.skipTest("no PyTorch here")
        self.write("checkpoint/checkpoint_000000001_1.pt", "no archive")
        with self.assertRaisesRegex(ValueError, "cannot read it"):
            comrad.load_policy(self.folder)
        with self.assertRaisesRegex(FileNotFoundError, "no such checkpoint"):
            comrad.load_policy(self.folder / "gone.pt")


if __name__ == "__main__":
    unittest.main()
