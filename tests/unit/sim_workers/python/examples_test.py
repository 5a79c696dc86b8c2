#!/usr/bin/env python3
"""The examples of the Python package and the code in its README run to their ends.

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
    def test_ppo_runs(self):
        out = self.run_example("ppo.py", "--decisions", "10240")
        self.assertRegex(out, r"10240 decisions, return +-?\d")
        self.assertRegex(out, r"(?m)^trained +-?\d")

    @unittest.skipUnless(have("torch", "torchrl"), "needs torch and torchrl")
    def test_torchrl_plays_a_team(self):
        out = self.run_example("torchrl_rollout.py")
        self.assertRegex(out, r"[1-9]\d* episodes ended, pictures \(200, 2, 3, 36, 64\), advantages \(200, 2, 1\)")

    @unittest.skipUnless(have("stable_baselines3", "supersuit", "vizdoom"), "needs stable-baselines3, supersuit and vizdoom")
    def test_stable_baselines3_plays_a_game_and_a_team(self):
        self.assertRegex(self.run_example("sb3.py"), r"basic: 512 steps, [1-9]\d* episodes ended")
        out = self.run_example("sb3.py", "--scenario", "lava_pit", "--steps", "2048")
        self.assertRegex(out, r"lava_pit: 2048 steps, [1-9]\d* episodes ended")

    @unittest.skipUnless(have("vizdoom"), "needs vizdoom")
    def test_the_code_in_the_readme_runs(self):
        blocks = re.findall(r"```python\n(.*?)```", (EXAMPLES.parent / "README.md").read_text(encoding="utf-8"), re.DOTALL)
        self.assertGreaterEqual(len(blocks), 1)
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "my_games").mkdir()
            (pathlib.Path(folder) / "my_games" / "my_game.cfg").write_text("available_buttons = { ATTACK }\n", encoding="utf-8")
            (pathlib.Path(folder) / "readme.py").write_text("\n".join(blocks), encoding="utf-8")
            done = subprocess.run([sys.executable, "-B", "readme.py"], cwd=folder, capture_output=True, text=True, timeout=280)
        self.assertEqual(done.returncode, 0, done.stderr[-2000:])

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
