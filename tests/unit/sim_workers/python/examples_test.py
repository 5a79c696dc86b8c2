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

    def test_the_page_of_encoders_links_the_example_and_has_the_programs_table(self):
        from comrad._engine import encoder_layers

        page = (EXAMPLES.parents[2] / "policy_workers" / "ENCODERS.md").read_text(encoding="utf-8")
        self.assertIn("(../sim_workers/python/examples/vision_transformer.py)", page)
        rows = dict(re.findall(r"(?m)^\| `(\w+)` \| (conv .*?) \| ", page))
        self.assertGreaterEqual(len(rows), 5)
        for name, layers in rows.items():
            self.assertEqual(", ".join(encoder_layers(name)), layers, name)

    @unittest.skipUnless(have("torch"), "needs torch")
    def test_a_vision_transformer_is_trained_resumed_evaluated_and_read_back(self):
        import comrad
        import torch

        comrad_program = os.environ["COMRAD_PROGRAM"]
        with tempfile.TemporaryDirectory() as folder:
            file = f"{folder}/vit.pt"
            self.assertIn("256 features", self.run_example("vision_transformer.py", file))
            begun = {f"encoder.{name}": tensor.clone() for name, tensor in torch.jit.load(file).named_parameters()}

            def run(*words):
                done = subprocess.run([comrad_program, *words], capture_output=True, text=True, timeout=280)
                self.assertEqual(done.returncode, 0, done.stderr[-2000:])
                return done.stdout

            train = ("train", "--scenario=platform_chain", f"--train_dir={folder}", "--experiment=vit", "--num_workers=1",
                     "--num_envs_per_worker=4", "--batch_size=128", "--device=cpu")
            run(*train, f"--encoder={file}", "--train_for_env_frames=3000")
            run(*train, f"--encoder={file}", "--train_for_env_frames=5000")  # the same file: the run continues
            os.remove(file)  # the run has its own copy
            os.rename(f"{folder}/vit", f"{folder}/moved")
            played = json.loads(run("eval", "--policy", f"{folder}/moved", "--episodes=1", "--json", "--device=cpu"))
            self.assertEqual(played["episodes"], 1)
            policy = comrad.load_policy(f"{folder}/moved")
            trained = {name: tensor for name, tensor in policy.state_dict().items() if name in begun}
            self.assertEqual(trained.keys(), begun.keys())
            self.assertTrue(any(not torch.equal(trained[name], begun[name]) for name in begun), "nothing was learned")
            logits, _ = policy(torch.zeros(2, 3, 72, 128, dtype=torch.uint8))
            self.assertTrue(logits.isfinite().all())

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
