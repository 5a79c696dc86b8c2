#!/usr/bin/env python3
"""The examples of the Python package run, and the PPO among them learns.

    PYTHONPATH=build/python examples_test.py [unittest arguments]
"""

import importlib.util
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import package  # noqa: F401 (it ends the test where the package is not there)

EXAMPLES = pathlib.Path(__file__).resolve().parents[4] / "sim_workers" / "python" / "examples"


def have(*modules):
    return all(importlib.util.find_spec(module) for module in modules)


class Examples(unittest.TestCase):
    def run_example(self, name, *arguments):
        done = subprocess.run([sys.executable, "-B", str(EXAMPLES / name), *arguments], capture_output=True, text=True, timeout=280)
        self.assertEqual(done.returncode, 0, done.stderr[-2000:])
        return done.stdout

    def test_random_agents(self):
        self.assertIn("agent_1/health", self.run_example("random_agents.py", "ammo_carrier"))

    @unittest.skipUnless(have("torch", "vizdoom"), "needs torch and vizdoom")
    def test_ppo_beats_random_play(self):
        out = self.run_example("ppo.py", "--decisions", "60000")
        scores = {name: float(re.search(rf"^{name} +(\S+)$", out, re.MULTILINE)[1]) for name in ("random", "trained")}
        self.assertGreater(scores["trained"], scores["random"] + 40, out)

    @unittest.skipUnless(have("torch", "torchrl"), "needs torch and torchrl")
    def test_torchrl_plays_a_team(self):
        self.assertIn("pictures (64, 2, 3, 36, 64), advantages (64, 2, 1)", self.run_example("torchrl_rollout.py"))

    def test_the_notebook_runs_from_top_to_bottom(self):
        with open(EXAMPLES / "tour.ipynb", encoding="utf-8") as file:
            cells = [cell for cell in json.load(file)["cells"] if cell["cell_type"] == "code"]
        self.assertGreater(len(cells), 5)
        with tempfile.NamedTemporaryFile("w", suffix=".py", encoding="utf-8") as script:
            script.write("\n".join("".join(cell["source"]) for cell in cells))
            script.flush()
            done = subprocess.run([sys.executable, "-B", script.name], capture_output=True, text=True, timeout=200, env={**os.environ, "MPLBACKEND": "agg"})
        self.assertEqual(done.returncode, 0, done.stderr[-2000:])
        self.assertIn("decisions/s", done.stdout)


if __name__ == "__main__":
    unittest.main()
