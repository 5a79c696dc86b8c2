#!/usr/bin/env python3
"""deploy/sweep/search.py, with Optuna: what it answers, again after a kill, from several programs at once, and of a damaged study.

    search_test.py [--venv FOLDER]

Needs a Python with Optuna: COMRAD_TEST_PYTHON alone where that is set, else the one in --venv, which `./comrad test` makes.
Skipped with code 77 where it has none.
"""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

PROGRAM = pathlib.Path(__file__).resolve().parents[4] / "deploy" / "sweep" / "search.py"
SKIPPED = 77
PATIENCE_S = 300
SPACE = [
    {"setting": "learning_rate", "low": 1e-5, "high": 1e-3, "step": 0.0, "log": True, "whole": False},
    {"setting": "rollout", "low": 16.0, "high": 64.0, "step": 16.0, "log": False, "whole": True},
    {"setting": "gamma", "low": 0.9, "high": 0.99, "step": 0.03, "log": False, "whole": False},
    {"setting": "exploration_loss", "choices": ["entropy", "symmetric_kl"]},
]


class Search(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        (self.folder / "search").mkdir()
        self.study = self.folder / "search" / "study.log"

    def plan(self, method: str, seed: int = 5) -> None:
        search = {"method": method, "runs": 20, "seed": seed, "space": SPACE, "first_env_frames": 100.0, "reduction": 3}
        runs = [{"name": f"trial_{number:03}", "study": "study", "number": number} for number in range(1, 21)]
        (self.folder / "sweep.json").write_text(json.dumps({"search": search, "runs": runs}))
        self.call("create")

    def words(self, command: str, run: int | None, **flags) -> list[str]:
        words = [sys.executable, "-B", str(PROGRAM), command, str(self.folder)]
        return words + ([] if run is None else [f"trial_{run:03}"]) + [f"--{key}={value}" for key, value in flags.items()]

    def call(self, command: str, run: int | None = None, **flags):
        done = subprocess.run(self.words(command, run, **flags), capture_output=True, text=True, timeout=PATIENCE_S)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout) if done.stdout else None

    def refusal(self, command: str, run: int | None = None, **flags) -> str:
        done = subprocess.run(self.words(command, run, **flags), capture_output=True, text=True, timeout=PATIENCE_S)
        self.assertEqual(done.returncode, 1, done.stdout)
        return done.stderr.strip().splitlines()[-1]

    def test_a_run_gets_the_same_settings_whenever_it_asks(self):
        self.plan("random")
        first, second = self.call("ask", 1), self.call("ask", 2)
        self.assertNotEqual(first["settings"], second["settings"])
        self.assertEqual(self.call("ask", 1), first)
        self.assertEqual(self.call("ask", 1, trial=first["trial"]), first)
        settings = first["settings"]
        self.assertTrue(1e-5 <= float(settings["learning_rate"]) <= 1e-3)
        self.assertIn(settings["rollout"], ("16", "32", "48", "64"))
        self.assertIn(round(float(settings["gamma"]), 6), (0.9, 0.93, 0.96, 0.99))
        self.assertIn(settings["exploration_loss"], ("entropy", "symmetric_kl"))
        self.call("tell", 1, trial=first["trial"], score=3)
        self.assertEqual(self.call("ask", 1, trial=first["trial"]), first)  # killed before it noted that
        self.call("tell", 1, trial=first["trial"], score=3)

    def test_random_settings_depend_on_seed_and_number_alone(self):
        self.plan("random")
        self.call("ask", 2)
        late = self.call("ask", 1)["settings"]
        self.study.unlink()
        self.plan("random")
        self.assertEqual(self.call("ask", 1)["settings"], late)
        self.study.unlink()
        self.plan("random", seed=6)
        self.assertNotEqual(self.call("ask", 1)["settings"], late)

    def test_a_trial_that_was_killed_half_way_is_taken_up_again(self):
        self.plan("tpe")
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        study = optuna.load_study(study_name="study", storage=JournalStorage(JournalFileBackend(str(self.study))))
        half = study.ask()
        half.set_user_attr("run", "trial_004")
        rate = half.suggest_float("learning_rate", 1e-5, 1e-3, log=True)
        answer = self.call("ask", 4)
        self.assertEqual(answer["trial"], half.number)
        self.assertEqual(float(answer["settings"]["learning_rate"]), rate)
        self.assertEqual(len(answer["settings"]), len(SPACE))
        self.assertEqual(self.call("ask", 4), answer)

    def test_many_programs_use_one_study_at_once(self):
        self.plan("tpe")
        asking = [subprocess.Popen(self.words("ask", run), stdout=subprocess.PIPE, text=True) for run in range(1, 7)]
        answers = [json.loads(one.communicate(timeout=PATIENCE_S)[0]) for one in asking]
        self.assertEqual(sorted(one["trial"] for one in answers), list(range(6)))
        self.assertEqual(len({one["settings"]["learning_rate"] for one in answers}), 6)
        telling = [
            subprocess.Popen(self.words("tell", run, trial=answer["trial"], score=run), stdout=subprocess.DEVNULL)
            for run, answer in enumerate(answers, 1)
        ]
        self.assertEqual([one.wait(PATIENCE_S) for one in telling], [0] * 6)
        self.assertNotIn(self.call("ask", 7)["settings"]["learning_rate"], [a["settings"]["learning_rate"] for a in answers])

    def test_a_stop_signal_leaves_no_lock_behind(self):
        self.plan("tpe")
        asking = subprocess.Popen(self.words("ask", 1), stdout=subprocess.PIPE, text=True)
        while asking.poll() is None and not self.study.read_text().count("\n") > 1:
            pass  # it has begun to write
        asking.send_signal(signal.SIGTERM)
        self.assertIn("settings", json.loads(asking.communicate(timeout=PATIENCE_S)[0]))
        self.assertEqual([path.name for path in self.study.parent.iterdir()], ["study.log"])

    def test_a_failed_run_is_tried_again_with_its_settings(self):
        self.plan("tpe")
        first = self.call("ask", 1)
        self.call("tell", 1, trial=first["trial"])
        again = self.call("ask", 1, trial=first["trial"])
        self.assertEqual(again["settings"], first["settings"])
        self.assertNotEqual(again["trial"], first["trial"])
        self.assertEqual(self.call("ask", 1, trial=again["trial"]), again)
        self.call("tell", 1, trial=again["trial"], score=2)
        self.assertEqual(self.call("ask", 1, trial=again["trial"]), again)

    def test_halving_lets_the_better_third_go_on(self):
        self.plan("halving")
        trials = {run: self.call("ask", run)["trial"] for run in range(1, 7)}
        report = lambda run, frames, score: self.call(
            "report", run, trial=trials[run], env_frames=frames, score=score
        )["pruned"]
        self.assertFalse(report(1, 100, 5.0))  # the first has none to be worse than
        self.assertTrue(report(2, 100, 4.0))
        self.assertFalse(report(3, 100, 6.0))
        self.assertTrue(report(4, 100, 1.0))
        self.assertTrue(report(4, 100, 9.0))  # reported already, and killed before it noted that
        self.assertFalse(report(1, 100, 0.0))
        self.assertFalse(report(3, 300, 6.0))
        self.assertTrue(report(1, 300, 5.0))
        self.call("tell", 3, trial=trials[3], score=7.0)
        self.assertEqual(self.call("ask", 4, trial=trials[4])["trial"], trials[4])

    def test_a_missing_or_damaged_study_is_an_error_that_names_it(self):
        self.plan("tpe")
        trial = self.call("ask", 1)["trial"]
        whole = self.study.read_bytes()
        self.study.unlink()
        missing = f"error: the study file {self.study} is missing; restore it, or give the sweep another name"
        for words in (("ask", 1), ("ask", 2)):
            self.assertEqual(self.refusal(*words), missing)
        self.assertEqual(self.refusal("tell", 1, trial=trial, score=1), missing)
        self.call("create")
        self.assertIn(f"trial_001 is trial {trial}, which {self.study} does not hold", self.refusal("ask", 1, trial=trial))
        for damaged in (b"\0" * 100 + b"\n", b"[1]\n" + whole, b"rubbish\n" + whole, whole[:-7], b'{"op_code": 99}\n' + whole):
            self.study.write_bytes(damaged)
            for words in (("create",), ("ask", 1)):
                message = self.refusal(*words)
                self.assertTrue(message.startswith(f"error: the study file {self.study} "), message)
                self.assertIn("restore it", message)
            self.assertEqual(self.study.read_bytes(), damaged)
        self.study.write_bytes(whole)
        self.assertEqual(self.call("ask", 1, trial=trial)["trial"], trial)

    def test_a_run_that_is_not_planned_is_refused(self):
        self.plan("tpe")
        self.assertIn("has no run trial_099", self.refusal("ask", 99))
        (self.folder / "sweep.json").write_text("{")
        self.assertTrue(self.refusal("ask", 1).startswith("error: "))


def python_with_optuna(venv: str) -> str | None:
    chosen = os.environ.get("COMRAD_TEST_PYTHON")
    for python in [chosen] if chosen else [os.path.join(venv, "bin", "python"), sys.executable]:
        if os.path.exists(python) and subprocess.run([python, "-c", "import optuna"], stderr=subprocess.DEVNULL).returncode == 0:
            return python
    return None


if __name__ == "__main__":
    if "--in_venv" in sys.argv:
        sys.argv.remove("--in_venv")
        unittest.main()
    found = python_with_optuna(sys.argv[2] if sys.argv[1:2] == ["--venv"] else "")
    if found is None:
        print("no Python here has Optuna (deploy/requirements_test.txt; ./comrad test installs it)")
        print("[  SKIPPED ] 1 test: search_test")
        sys.exit(SKIPPED)
    sys.exit(subprocess.run([found, "-B", __file__, "--in_venv"]).returncode)
