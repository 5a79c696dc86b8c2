#!/usr/bin/env python3
"""`comrad report` over made-up runs: what it counts, what it refuses to mix, and what it does with damaged files.

    report_test.py [unittest arguments]

Needs numpy, SciPy and Matplotlib (deploy/packages_report.txt); skipped with code 77 where they are missing.
"""

import contextlib
import csv
import dataclasses
import datetime
import io
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import types
import unittest
import warnings

HERE = pathlib.Path(__file__).resolve().parent
REPORT = HERE.parents[3] / "deploy" / "report"
sys.path[:0] = [str(HERE), str(REPORT)]
try:
    import numpy as np
    import scipy  # noqa: F401 (only asked whether it is there)
    import matplotlib.figure

    import analysis
    import compose
    import curves
    import figures
    import intervals
    import plot
    import report
    import results_page
    import run_files
    import searches
    import study_tables as of
    import tables
except ImportError as missing:
    print(f"[  SKIPPED ] 1 test, comrad report: {missing}; install the packages of deploy/packages_report.txt")
    sys.exit(77)
import made_runs  # noqa: E402 (it lies beside this)

NO_REFERENCES = pathlib.Path("/nowhere/reference_scores.toml")


class WithFolder(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)

    def study(self, **options) -> analysis.Study:
        return analysis.read_study(self.folder, analysis.Options(**options), NO_REFERENCES)

    def reasons(self, study) -> str:
        return "\n".join(f"{name}: {why}" for name, why in study.left_out)


class ReadingRuns(WithFolder):
    def test_damaged_lines_are_counted_and_the_others_read(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, reports=3)
        lines = (run / "metrics.jsonl").read_text().splitlines()
        hostile = [
            lines[0],
            "{",
            "[1, 2]",
            '{"env_frames": "many", "time_s": 1}',
            '{"env_frames": 1e400, "time_s": 1}',
            "\x00\xff",
            "[" * 100_000,
            '{"env_frames": -4, "time_s": 1}',
            '{"env_frames": true, "time_s": 1}',
            *lines[1:],
            lines[2][:40],
        ]
        (run / "metrics.jsonl").write_text("\n".join(hostile), encoding="latin-1")
        read = run_files.read_run(run)
        self.assertEqual(len(read.metrics), 3)
        self.assertEqual(read.metrics.damaged_lines, 9)
        self.assertIn("metrics.jsonl: 9 damaged lines skipped", read.problems)

    def test_what_a_learner_forgot_is_left_out(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, reports=1)
        (run / "metrics.jsonl").write_text(
            "".join(
                json.dumps({"env_frames": frames, "time_s": time_s, run_files.SCORE: score}) + "\n"
                for frames, time_s, score in ((100, 1, 1), (200, 2, 2), (300, 3, 3), (150, 1.5, 7), (250, 2.5, 8))
            )
        )
        frames, scores = run_files.read_run(run).metrics.series(run_files.SCORE)
        self.assertEqual(frames.tolist(), [100, 150, 250])
        self.assertEqual(scores.tolist(), [1, 7, 8])

    def test_evaluations_that_come_late_stand_at_their_place_and_forget_nothing(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, reports=1)
        (run / "metrics.jsonl").write_text(
            "".join(
                json.dumps(report) + "\n"
                for report in (
                    {"env_frames": 100, "time_s": 1, run_files.SCORE: 1},
                    {"env_frames": 300, "time_s": 3, run_files.SCORE: 3},
                    {"env_frames": 200, "time_s": 2, "eval/J": 7, "eval/episodes": 20},
                    {"env_frames": 400, "time_s": 4, run_files.SCORE: 4},
                )
            )
        )
        metrics = run_files.read_run(run).metrics
        self.assertEqual(metrics.series(run_files.SCORE)[0].tolist(), [100, 300, 400])
        self.assertEqual([one.tolist() for one in metrics.series("eval/J", "time_s")], [[2], [7]])

    def test_a_folder_that_is_no_run_is_named(self):
        for name, text in (
            ("no_toml", "scenario = "),
            ("no_seed", 'scenario = "a"\nalgo = "b"\n'),
            ("true_seed", 'scenario = "a"\nalgo = "b"\nseed = true\n'),
            ("deep", "a = " + "[" * 5000),
        ):
            (self.folder / name).mkdir()
            (self.folder / name / "config.toml").write_text(text)
        made_runs.write_run(self.folder / ".hidden", "lava_pit", "ippo", 42, start=0, end=5)
        (self.folder / "no_config").mkdir()
        (self.folder / "no_config" / "metrics.jsonl").write_text("")
        runs, left_out = run_files.find_runs(self.folder)
        self.assertEqual(runs, [])
        self.assertEqual([name for name, _ in left_out], ["deep", "no_config", "no_seed", "no_toml", "true_seed"])
        self.assertIn("seed is missing", dict(left_out)["no_seed"])

    def test_the_last_error_of_a_failed_run(self):
        run = made_runs.write_run(
            self.folder,
            "lava_pit",
            "ippo",
            42,
            start=0,
            end=5,
            state="failed",
            message="learner:\n\x1b[31mout of memory\x1b[0m",
        )
        self.assertEqual(run_files.read_run(run).last_error(), "learner: [31mout of memory [0m")
        (run / "status.json").write_text('{"state": "failed", "message": ""}')
        (run / "logs" / "supervisor.log").write_text("all is well\nsim-0: error: no map\nstopped\n")
        self.assertEqual(run_files.read_run(run).last_error(), "sim-0: error: no map")

    def test_evaluations_that_are_none_are_named(self):
        (self.folder / "eval").mkdir()
        for name, text in (
            ("a", "[]"),
            ("b", '{"policy": 3}'),
            ("c", "no json"),
            ("d", '{"policy": "random", "scenario": "x", "episodes": 4, "J_mean": null}'),
            ("e", "3"),
        ):
            (self.folder / "eval" / f"{name}.json").write_text(text)
        found, left_out = run_files.find_evaluations(self.folder)
        self.assertEqual(found, [])
        self.assertEqual([name for name, _ in left_out], ["eval/b.json", "eval/c.json", "eval/d.json", "eval/e.json"])


class ReadingPositions(WithFolder):
    def test_places_are_gathered_by_agent(self):
        path = made_runs.write_positions(self.folder, "lava_pit", "random", agents=3, episodes=4, decisions=10)
        read = run_files.read_occupancy(path)
        self.assertEqual((read.policy, read.episodes, read.maps, read.lines.shape), ("random", 4, 1, (9, 5)))
        self.assertEqual([one.shape for one in read.positions], [(44, 2)] * 3)
        first = json.loads(path.read_text().splitlines()[2])["positions"][2]
        self.assertEqual(read.positions[2][:2].ravel().tolist(), first[:4])

    def test_of_several_maps_the_one_that_was_played_most_is_shown(self):
        path = made_runs.write_positions(self.folder, "lava_pit", "random", episodes=1, decisions=10)
        text = path.read_text()
        path.write_text(
            text
            + "\n".join(text.replace("aa", "bb").splitlines()[1:])
            + "\n"
            + text.replace("aa", "bb").splitlines()[2]
            + "\n"
        )
        read = run_files.read_occupancy(path)
        self.assertEqual((read.episodes, read.maps), (2, 2))

    def test_files_that_hold_no_positions_are_named(self):
        good = (
            made_runs.write_positions(self.folder, "lava_pit", "random", episodes=1, decisions=3)
            .read_text()
            .splitlines()
        )
        bad = {
            "no_head": good[1:],
            "no_map": [good[0], good[2]],
            "no_episode": good[:2],
            "odd": good[:2] + ['{"layout": "00000000000000aa", "positions": [[1, 2, 3]]}'],
            "far": good[:2] + ['{"layout": "00000000000000aa", "positions": [[1, 1e9]]}'],
            "words": good[:2] + ['{"layout": "00000000000000aa", "positions": [["a", "b"]]}'],
            "cut": good[:2] + [good[2][:30]],
            "crowd": good[:2] + [json.dumps({"layout": "00000000000000aa", "positions": [[0, 0]] * 500})],
            "uneven": good + ['{"layout": "00000000000000aa", "positions": [[1, 1]]}'],
            "null": good[:2] + ['{"layout": "00000000000000aa", "positions": null}'],
            "nan": good[:2] + ['{"layout": "00000000000000aa", "positions": [[NaN, 1]]}'],
        }
        for name, lines in bad.items():
            (self.folder / "eval" / f"{name}.jsonl").write_text("\n".join(lines) + "\n")
        found, left_out = run_files.find_occupancies(self.folder)
        self.assertEqual([one.file.name for one in found], ["lava_pit_random.jsonl"])
        self.assertEqual({pathlib.Path(name).stem for name, _ in left_out}, set(bad))


class Grouping(WithFolder):
    def labels(self, **options) -> list[tuple[str, int]]:
        return [(cell.label, len(cell.complete)) for cell in self.study(**options).cells]

    def test_settings_part_cells_and_name_them(self):
        for gamma in (0.9, 0.99):
            for seed in (42, 68):
                made_runs.write_run(
                    self.folder, "lava_pit", "ippo", seed, start=0, end=5, gamma=gamma, name=f"g{gamma}_{seed}"
                )
        self.assertEqual(self.labels(), [("ippo, gamma 0.9", 2), ("ippo, gamma 0.99", 2)])
        self.assertEqual([label for label, _ in self.labels(ignore=frozenset({"gamma"}))], ["ippo"])

    def test_what_a_machine_decided_and_how_a_run_was_started_part_no_cells(self):
        """Two seeds of a sweep on two machines, and a run that was started by hand: config.toml as they have it."""
        chosen = {"num_workers": 0, "max_batch": 0, "min_batch": 0, "trajectory_slabs": 0, "precision": "auto"}
        here = {"num_workers": 2, "max_batch": 8, "min_batch": 8, "trajectory_slabs": 16, "precision": "bf16"}
        there = {"num_workers": 16, "max_batch": 64, "min_batch": 32, "trajectory_slabs": 128, "precision": "fp32"}
        sweep = {"experiment": "", "restart_behavior": "resume", **chosen}
        for seed, machine, threads, asked in (
            (42, here, 2, sweep),
            (68, there, 8, sweep),
            (81, here, 2, {**sweep, "train_dir": "train_dir", "learner_threads": 0}),
        ):
            made_runs.write_run(
                self.folder, "lava_pit", "ippo", seed, start=0, end=5, learner_threads=threads, explicit=asked, **machine
            )
        self.assertEqual(self.labels(), [("ippo", 3)])

    def test_precision_parts_cells_where_runs_were_told_different_ones(self):
        for seed in (42, 68):
            for precision in ("fp32", "bf16"):
                made_runs.write_run(
                    self.folder, "lava_pit", "ippo", seed, start=0, end=5,
                    precision=precision, explicit={"wad": ""}, name=f"{precision}_{seed}",
                )  # fmt: skip
        made_runs.write_run(
            self.folder, "lava_pit", "ippo", 81, start=0, end=5, precision="bf16", explicit={"precision": "auto"}
        )
        self.assertEqual(self.labels(), [("ippo, precision bf16", 3), ("ippo, precision fp32", 2)])

    def test_a_recipe_of_many_settings_is_named_by_its_preset(self):
        many = {f"setting_{index}": 1 for index in range(6)}
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, preset="paper", name="a", **many)
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, preset="small", name="b")
        self.assertEqual(
            self.labels(),
            [("ippo, preset paper and 6 more settings", 1), ("ippo, preset small and 6 more settings", 1)],
        )

    def test_how_a_run_is_watched_parts_no_cells(self):
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, eval_every_env_frames=0.0)
        made_runs.write_run(
            self.folder, "lava_pit", "ippo", 68, start=0, end=5, eval_every_env_frames=5e5, eval_maps="held_out"
        )
        self.assertEqual(self.labels(), [("ippo", 2)])

    def test_the_settings_that_part_no_cells_are_those_of_the_program(self):
        repository = HERE.parents[3]
        rows = {}  # name -> (subject, the row's text)
        for path in (repository / "rollout_buffer" / "settings").glob("*.def"):
            for row in path.read_text().split("\nSETTING(")[1:]:
                rows[row.split(",")[1].strip()] = (path.stem, row)
        learned_of_run = {"scenario", "variant", "algo", "preset", "train_for_env_frames", "train_for_seconds"}
        recipe = re.search(r"kNoRecipe = \{(.*?)\};", (repository / "deploy/sweep/sweep_results.cc").read_text(), re.S)
        expected = set(re.findall(r'"(\w+)"', recipe[1])) | {"save_best_after"}
        for name, (subject, row) in rows.items():
            if subject == "hosts" or (subject == "run" and name not in learned_of_run):
                expected.add(name)
            if ".is_of_the_start" in row or ".is_automatic_size" in row:
                expected.add(name)
        self.assertEqual(run_files.NOT_LEARNED ^ expected, {"precision"}, "which parts cells where runs set it")
        self.assertLessEqual(analysis.BUDGETS - {"train_for_env_steps"}, set(rows))

    def test_settings_beyond_those_that_are_named_part_cells_too(self):
        for number in range(2):
            made_runs.write_run(
                self.folder,
                "lava_pit",
                "ippo",
                42,
                start=0,
                end=5,
                name=f"run{number}",
                **{f"a{index}": 0 for index in range(3)},
                b=number,
            )
            made_runs.write_run(
                self.folder,
                "lava_pit",
                "ippo",
                42,
                start=0,
                end=5,
                name=f"other{number}",
                **{f"a{index}": 1 for index in range(3)},
                b=number,
            )
        labels = [cell.label for cell in self.study().cells]
        self.assertEqual(len(labels), 4)
        self.assertEqual(len(set(labels)), 4)

    def test_one_seed_counts_once(self):
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, name="one")
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=9, name="two")
        study = self.study()
        self.assertEqual([run.name for run in study.cells[0].complete], ["one"])
        self.assertIn("two: same settings and seed 42 as one", self.reasons(study))

    def test_unfinished_runs_are_named_and_do_not_count(self):
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5)
        made_runs.write_run(self.folder, "lava_pit", "ippo", 68, start=0, end=5, frames=4e5, state="paused")
        made_runs.write_run(self.folder, "lava_pit", "ippo", 81, start=0, end=5, reports=1)
        study = self.study()
        self.assertEqual([run.seed for run in study.cells[0].complete], [42])
        self.assertIn("lava_pit_ippo_68: paused at 4e+05 of 1e+06 env frames", self.reasons(study))
        self.assertIn("lava_pit_ippo_81: no episode has ended", self.reasons(study))
        self.assertEqual([run.seed for run in self.study(at=4e5).cells[0].complete], [42, 68])

    def test_scores_are_read_where_asked(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, reports=1)
        (run / "metrics.jsonl").write_text(
            "".join(
                json.dumps({"env_frames": frames, "time_s": frames, run_files.SCORE: score}) + "\n"
                for frames, score in ((2e5, 1.0), (5e5, 2.0), (1e6, 3.0))
            )
        )
        self.assertEqual(self.study().cells[0].scores.tolist(), [3.0])
        self.assertEqual(self.study(at=5.5e5).cells[0].scores.tolist(), [2.0])

    def test_evaluations_count_only_where_every_run_has_one_of_the_same_kind(self):
        for seed in (42, 68):
            run = made_runs.write_run(self.folder, "lava_pit", "ippo", seed, start=0, end=5)
            made_runs.write_evaluation(self.folder, "lava_pit", run.name, 4, episodes=20)
        cell = self.study().cells[0]
        self.assertEqual(len(cell.evaluations), 2)
        made_runs.write_evaluation(self.folder, "lava_pit", "lava_pit_ippo_68", 4, episodes=30)
        study = self.study()
        self.assertEqual(study.cells[0].evaluations, [])
        self.assertIn("has none (", self.reasons(study))
        made_runs.write_evaluation(self.folder, "lava_pit", "gone", 4)
        self.assertIn("gone.json: it evaluates gone on lava_pit, and there is no such run", self.reasons(self.study()))


    def test_an_answer_of_several_policies_counts_as_so_many(self):
        paths = [made_runs.write_evaluation(self.folder, "lava_pit", policy, 4) for policy in ("random", "oracle")]
        together = {"scenario": "lava_pit", "policies": [json.loads(path.read_text()) for path in paths]}
        path = self.folder / "together.json"
        path.write_text(json.dumps(together))
        self.assertEqual([one.policy for one in run_files.read_evaluation(path)], ["random", "oracle"])
        path.write_text(json.dumps({"scenario": "lava_pit", "players": ["a", "b"], "cells": []}))
        with self.assertRaisesRegex(ValueError, "no answer"):
            run_files.read_evaluation(path)


class Sweeps(WithFolder):
    REFUSED = "learning begins at 40000 env frames, the run ends at 40000; raise --train_for_env_frames"

    def setUp(self):
        """A sweep of two algorithms: ippo finished once, failed in the middle and was never started; qmix was refused."""
        super().setUp()
        self.sweep = self.folder / "study"
        made_runs.write_run(self.sweep, "lava_pit", "ippo", 42, start=0, end=5, num_workers=2)
        made_runs.write_run(
            self.sweep, "lava_pit", "ippo", 68, start=0, end=5, frames=3e5, state="running", num_workers=2
        )
        made_runs.write_sweep(
            self.sweep,
            [
                {"scenario": "lava_pit", "algo": algo, "seed": seed}
                for algo, seeds in (("ippo", (42, 68, 81)), ("qmix", (42, 68)))
                for seed in seeds
            ],
            {
                "lava_pit_ippo_42": {"state": "finished", "exit_code": 0},
                "lava_pit_ippo_68": {"error": "the learner was killed"},
                "lava_pit_qmix_42": {"error": self.REFUSED},
                "lava_pit_qmix_68": {"error": self.REFUSED},
            },
        )

    def test_every_planned_run_is_in_the_report(self):
        study = analysis.read_study(self.sweep, analysis.Options(), NO_REFERENCES)
        self.assertEqual(
            {run.name: (run.state, run.last_error()) for run in study.failed},
            {
                "lava_pit_ippo_68": ("failed", "the learner was killed"),
                "lava_pit_ippo_81": ("missing", "it was never started"),
                "lava_pit_qmix_42": ("failed", self.REFUSED),
                "lava_pit_qmix_68": ("failed", self.REFUSED),
            },
        )
        self.assertEqual([(cell.label, len(cell.runs)) for cell in study.cells], [("ippo", 3), ("qmix", 2)])
        self.assertIn(f"lava_pit_qmix_42: failed: {self.REFUSED}; it counts in no mean", self.reasons(study))

    def test_an_algorithm_without_a_run_stays_in_the_tables(self):
        output = self.folder / "out"
        output.mkdir()
        study = analysis.read_study(self.sweep, analysis.Options(), NO_REFERENCES)
        compose.write_report(study, output, "study", datetime.datetime(2026, 1, 1))
        texts = {name: (output / f"report.{name}").read_text() for name in ("html", "md", "tex")}
        for text in texts.values():
            self.assertIn("no score: 2 failed", text)
        self.assertIn("5 runs: 1 finished, 3 failed, 1 missing.", texts["md"])
        self.assertIn("<b>3</b><span>failed</span>", texts["html"])
        self.assertIn("<b>1</b><span>missing</span>", texts["html"])
        with open(output / "runs.csv", encoding="utf-8", newline="") as file:
            errors = {row["run"]: row["last_error"] for row in csv.DictReader(file)}
        self.assertEqual(errors["lava_pit_qmix_68"], self.REFUSED)
        self.assertEqual(errors["lava_pit_ippo_42"], "")

    def test_a_sweep_with_no_run_at_all_is_reported(self):
        for name in ("lava_pit_ippo_42", "lava_pit_ippo_68"):
            shutil.rmtree(self.sweep / name)
        study = self.study()
        self.assertEqual([cell.absence for cell in study.cells], ["no score: 1 failed, 2 missing", "no score: 2 failed"])
        self.assertIn("its record states finished, but it has no folder", self.reasons(study))
        self.assertIsNone(figures.learning_curves(study, "lava_pit"))
        self.assertIsNone(figures.speed_figure(study))
        of.csv_files(study)

    def test_a_run_that_was_made_by_hand_beside_a_sweep_joins_its_cell(self):
        by_hand = {"learner_threads": 0, "num_workers": 0, "precision": "auto", "train_dir": "train_dir"}
        made_runs.write_run(
            self.folder, "lava_pit", "ippo", 97, start=0, end=5, num_workers=8, max_batch=32, precision="fp32", explicit=by_hand
        )
        self.assertEqual([(cell.label, len(cell.runs)) for cell in self.study().cells], [("ippo", 4), ("qmix", 2)])

    def test_a_result_that_was_kept_elsewhere_counts(self):
        made_runs.write_run(self.folder / "results", "lava_pit", "qmix", 42, start=0, end=5)
        plan = json.loads((self.sweep / "sweep.json").read_text())
        plan["results"] = {"folder": str(self.folder / "results")}
        (self.sweep / "sweep.json").write_text(json.dumps(plan))
        study = analysis.read_study(self.sweep, analysis.Options(), NO_REFERENCES)
        self.assertEqual([run.seed for run in study.cells[1].complete], [42])

    def test_a_damaged_plan_is_named(self):
        for text in ("{", "[]", '{"runs": 3}', '{"runs": [{"name": "../x", "settings": {}}]}', '{"runs": [{"name": "x", "settings": {}}]}'):
            (self.sweep / "sweep.json").write_text(text)
            study = self.study()
            self.assertEqual(len(study.runs), 2)
            self.assertIn("runs that it planned may be missing here", self.reasons(study))


class References(WithFolder):
    MEASURED = {"lava_pit": {"num_agents": 2, "random": 0.0, "scripted": 10.0, "episodes": 100}}

    def references(self, *evaluations, **settings):
        made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, **settings)
        runs, _ = run_files.find_runs(self.folder)
        found, _ = run_files.find_evaluations(self.folder)
        left_out = []
        return analysis.references_of(runs, found, self.MEASURED, left_out), "\n".join(why for _, why in left_out)

    def test_the_repositorys_numbers_are_for_the_default_map_and_team(self):
        references, _ = self.references()
        self.assertEqual(references["lava_pit"].normalised(5.0), 0.5)

    def test_other_maps_need_evaluations_of_their_own(self):
        references, why = self.references(layout_pool="train:50")
        self.assertEqual(references, {})
        self.assertIn("do not play the default map", why)

    def test_stages_of_the_scenario_are_trained_on_and_its_own_map_is_scored(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5, layout_pool="curriculum")
        [trained], _ = run_files.find_runs(self.folder)
        self.assertFalse(analysis.plays_default_map(trained), run)
        self.assertTrue(analysis.plays_default_map(dataclasses.replace(trained, result={"layout": "seed 42"})))
        self.assertFalse(analysis.plays_default_map(dataclasses.replace(trained, result={"layout": "a pool"})))
        other = dataclasses.replace(trained, settings=trained.settings | {"algo": "qmix", "layout_pool": ""})
        kept = types.SimpleNamespace(rows=[types.SimpleNamespace(run=run) for run in (trained, other)])
        self.assertEqual(results_page.staged_sentence(kept), " Runs of lava pit (ippo) train on the scenario's stages: J is that of these.")

    def test_other_teams_need_evaluations_of_their_own(self):
        references, why = self.references(num_agents=4)
        self.assertEqual(references, {})
        self.assertIn("no reference for 4 agents", why)

    def test_evaluations_beside_the_runs_come_first(self):
        made_runs.write_evaluation(self.folder, "lava_pit", "random", 1, spread=0, layout="eval:20")
        made_runs.write_evaluation(self.folder, "lava_pit", "oracle", 5, spread=0, layout="eval:20")
        references, _ = self.references(layout_pool="train:50")
        self.assertAlmostEqual(references["lava_pit"].normalised(3.0), 0.5)

    def test_a_scripted_team_that_is_no_better_than_chance_is_no_scale(self):
        made_runs.write_evaluation(self.folder, "lava_pit", "random", 5, spread=0)
        made_runs.write_evaluation(self.folder, "lava_pit", "oracle", 5, spread=0)
        references, why = self.references()
        self.assertEqual(references, {})
        self.assertIn("not above that of random play", why)

    def test_the_file_of_the_repository_names_its_scenarios(self):
        measured = analysis.measured_references(HERE.parents[3] / "scenarios" / "reference_scores.toml")
        scenarios = {path.parent.name for path in (HERE.parents[3] / "scenarios").glob("*/scenario.toml")}
        self.assertLessEqual({name.removesuffix("@reference") for name in measured}, scenarios)
        self.assertLessEqual(scenarios, set(measured))
        for name, entry in measured.items():
            self.assertLess(entry["random"], entry["scripted"], name)


class Numbers(unittest.TestCase):
    def test_student_interval_of_a_textbook_sample(self):
        low, high = intervals.student_interval(np.array([4.0, 6.0, 8.0]))  # s = 2, t(0.975, 2) = 4.302653
        self.assertAlmostEqual(low, 6 - 4.302653 * 2 / math.sqrt(3), places=5)
        self.assertAlmostEqual(high, 6 + 4.302653 * 2 / math.sqrt(3), places=5)
        self.assertTrue(math.isnan(intervals.student_interval(np.array([4.0]))[0]))

    def test_bootstrap_interval_covers_the_mean_as_often_as_it_says(self):
        generator = np.random.default_rng(1)
        hits = 0
        for trial in range(300):
            low, high = intervals.bootstrap_interval(generator.normal(3, 1, 40), resamples=500, seed=trial)
            hits += low <= 3 <= high
        self.assertGreater(hits / 300, 0.89)
        self.assertLess(hits / 300, 0.99)

    def test_interval_over_episodes_is_that_of_one_policy_where_there_is_one(self):
        one = run_files.Evaluation(pathlib.Path("x"), "run", "s", "", 2, 20, 5.0, 1.5, 0, True, np.empty(0))
        low, high = analysis.episode_interval([one])
        self.assertAlmostEqual((high - low) / 2, 1.5)
        low, high = analysis.episode_interval([one, one])  # twice the episodes
        self.assertAlmostEqual((high - low) / 2, 1.5 / math.sqrt(2) * 2.024394 / 2.093024, places=5)

    def test_curves_cover_what_all_runs_cover(self):
        def run(begin, end, score):
            grid = np.linspace(begin, end, 5)
            return run_files.Run(
                pathlib.Path("x"), {}, run_files.Metrics(grid, grid, {run_files.SCORE: np.full(5, score)})
            )

        curve = curves.curve_over_runs([run(0, 100, 1.0), run(20, 80, 3.0)])
        self.assertEqual((curve.x[0], curve.x[-1], curve.runs), (20, 80, 2))
        self.assertTrue((curve.mean == 2.0).all())
        self.assertAlmostEqual(curve.half_width[0], 12.706205, places=4)  # t(0.975, 1) s / sqrt(2), s = sqrt(2)
        self.assertIsNone(curves.curve_over_runs([run(0, 10, 1.0), run(20, 80, 3.0)]))

    def test_few_runs_are_thin_lines_and_their_mean_and_more_have_a_band(self):
        def run(score):
            grid = np.linspace(0, 100, 5)
            return run_files.Run(pathlib.Path("x"), {}, run_files.Metrics(grid, grid, {run_files.SCORE: grid * score}))

        for count, lines, bands, label in ((1, 1, 0, "a"), (2, 3, 0, "a (mean of 2)"), (3, 4, 0, "a (mean of 3)"), (4, 5, 1, "a (mean of 4, 95 %)")):
            axes = matplotlib.figure.Figure().subplots()
            line = curves.draw_runs(axes, [run(score) for score in range(count)], "a")
            self.assertEqual((len(axes.get_lines()), len(axes.collections)), (lines, bands))
            self.assertEqual(line.get_label(), label)
            low, high = axes.get_ylim()
            self.assertLess(high - low, 1.2 * 100 * max(1, count - 1) + 100 * bands, "the band does not make the lines flat")

    def test_a_run_with_one_report_is_a_point(self):
        at = np.array([60_000.0])
        run = run_files.Run(pathlib.Path("x"), {}, run_files.Metrics(at, at, {run_files.SCORE: np.array([0.04])}))
        line = curves.draw_runs(matplotlib.figure.Figure().subplots(), [run], "a")
        self.assertEqual(line.get_marker(), "o")

    def test_a_reference_that_would_make_curves_flat_is_words(self):
        axes = matplotlib.figure.Figure().subplots()
        axes.plot([0, 1], [0, 1])
        curves.draw_references(axes, 0.025, 11.0)
        self.assertEqual([line.get_label() for line in axes.get_lines()][1:], ["random play"])
        self.assertIn("scripted team: 11 \N{UPWARDS ARROW}", [text.get_text() for text in axes.texts])
        low, high = axes.get_ylim()
        self.assertLess(high - low, 1.5)

    def test_texts_of_numbers(self):
        self.assertEqual(tables.with_interval(6123.9, 5048.2, 7199.1), "6124 [5048, 7199]")
        self.assertEqual(tables.with_interval(0.7508, 0.6901, 0.8115), "0.75 [0.69, 0.81]")
        self.assertEqual(tables.with_interval(3.0, math.nan, math.nan), "3")
        self.assertEqual(tables.with_interval(0.0085, -0.2, 0.217), "0.0085 [-0.2000, 0.2170]")
        self.assertEqual(tables.with_interval(0.0, -0.2, 0.2), "0.00 [-0.20, 0.20]")
        self.assertEqual(tables.rounded(0.0085), "0.0085")
        self.assertEqual(tables.rounded(8.5e-8), "8.5e-08")
        self.assertEqual(tables.rounded(math.inf), "-")
        self.assertEqual(tables.latex_text("a_b & 5 %"), r"a\_b \& 5 \%")


class Plots(WithFolder):
    def test_refuses_what_it_cannot_draw(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5)
        picture = self.folder / "plot.svg"
        for words, message in (
            (["--metric", "train/grad_nrom"], "did you mean train/grad_norm?"),
            (["--metric", "eval/J"], "nothing was evaluated in 40 reports"),
            (["--baseline", "90x"], "NAME=VALUE"),
        ):
            with contextlib.redirect_stderr(io.StringIO()) as said:
                self.assertEqual(plot.main([*words, "--output", str(picture), "--curve", "one", str(run)]), 2)
            self.assertIn(message, said.getvalue())
            self.assertFalse(picture.exists())

    def plot(self, *words) -> str:
        """The picture of `comrad plot`, as SVG whose texts are texts."""
        output = self.folder / "plot.svg"
        with matplotlib.rc_context({"svg.fonttype": "none"}):
            self.assertEqual(plot.main([*words, "--output", str(output)]), 0)
        return output.read_text()

    def test_seeds_of_a_sweep_and_a_run_by_hand_are_one_curve_with_title_and_references(self):
        words = ["--over_seeds"]
        for seed, threads in ((42, 2), (68, 8), (81, 4)):
            explicit = {"learner_threads": 0, "precision": "auto"}
            run = made_runs.write_run(
                self.folder, "lava_pit", "ippo", seed, start=0, end=5, learner_threads=threads, explicit=explicit
            )
            words += ["--curve", run.name, str(run)]
        drawn = self.plot(*words)
        for text in (">lava pit<", ">lava_pit IPPO (mean of 3)<", ">random play<", ">scripted team: 11 "):
            self.assertIn(text, drawn)
        self.assertNotIn("explicit", drawn)
        drawn = self.plot(*words, "--metric", "train/grad_norm", "--title", "gradients")
        self.assertIn(">lava_pit IPPO (mean of 3)<", drawn)
        self.assertIn(">gradients<", drawn)
        self.assertNotIn("random play", drawn)


@dataclasses.dataclass
class Ended:
    returncode: int
    stderr: str


def run_report(*words) -> Ended:
    """`comrad report`, in this process: its packages take a second to load. What Matplotlib warns of is in stderr."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            try:
                returncode = report.main([str(word) for word in words])
            except SystemExit as refused:  # by argparse
                returncode = refused.code
    return Ended(returncode, said.getvalue())


class TheCommand(WithFolder):
    def test_the_script_reports_a_single_run_without_anything_else(self):
        run = made_runs.write_run(self.folder, "lava_pit", "ippo", 42, start=0, end=5)
        (run / "status.json").unlink()
        words = [sys.executable, "-B", str(REPORT / "report.py"), str(run)]
        ended = subprocess.run(words, capture_output=True, text=True, timeout=300)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assertIn("status.json: there is no status.json", ended.stderr)
        self.assertIn(str(run / "report" / "report.html"), ended.stdout)

    def test_writes_one_page_and_its_tables(self):
        runs = self.folder / "runs"
        made_runs.write_study(runs, scenarios=made_runs.TWO_SCENARIOS)
        made_runs.write_run(
            runs,
            "lava_pit",
            "ippo",
            97,
            start=0,
            end=5,
            frames=1e5,
            state="failed",
            name="<b>evil & co",
            message="</table><script>alert(1)</script> ran out of disk",
        )
        made_runs.write_run(runs, "lava_pit", "qmix_of_mine", 97, start=0, end=5)
        ended = run_report(runs, "--output", self.folder / "out")
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assertEqual(
            sorted(path.name for path in (self.folder / "out").iterdir()),
            ["curves.csv", "report.html", "report.md", "report.tex", "runs.csv", "scores.csv"],
        )
        self.assertIn("<b>evil & co: failed at 1e+05 of 1e+06 env frames", ended.stderr)
        page = (self.folder / "out" / "report.html").read_text()
        self.assertNotIn("<script", page)
        self.assertNotIn("<b>evil", page)
        self.assertIn("ran out of disk", page)
        self.assertEqual(re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page), [], "nothing comes from elsewhere")
        self.assertNotIn("@import", page)
        self.assertNotIn("url(", page)
        for words in (
            "Across scenarios",
            "On-policy against off-policy",
            "Sample efficiency",
            "Learning diagnostics",
            "CPU by role",
            "not reproducible",
        ):
            self.assertIn(words, page)
        with open(self.folder / "out" / "scores.csv", encoding="utf-8", newline="") as file:
            rows = {(row["scenario"], row["label"], row["source"]): row for row in csv.DictReader(file)}
        row = rows["ammo_carrier", "ippo", "training"]
        scores = [
            run_files.read_run(runs / f"ammo_carrier_ippo_{seed}").metrics.column(run_files.SCORE)[-1]
            for seed in made_runs.SEEDS
        ]
        self.assertEqual(int(row["seeds"]), 3)
        self.assertAlmostEqual(float(row["J_mean"]), np.mean(scores))
        low, high = intervals.student_interval(np.array(scores))
        self.assertAlmostEqual(float(row["seeds_low"]), low)
        self.assertAlmostEqual(float(row["seeds_high"]), high)
        self.assertIn(r"\toprule", (self.folder / "out" / "report.tex").read_text())

    def test_a_population_is_shown_with_its_lineage(self):
        members = ("member_1", "member_2")
        for name in members:
            made_runs.write_run(self.folder / "study", "lava_pit", "ippo", 42, start=0, end=5, name=name)
            (self.folder / "study" / name / "status.json").write_text(
                json.dumps({"state": "finished", "env_frames": 1e6, "J_mean": 7.5 if name == "member_2" else 6.25})
            )
        settings = {"scenario": "lava_pit", "algo": "ippo", "seed": "42"}
        runs = [{"name": name, "settings": settings, "study": "study", "number": 1} for name in members]
        space = [{"setting": "learning_rate", "low": 1e-5, "high": 1e-2}, {"setting": "exploration_loss", "choices": ["none"]}]
        sweep = {"name": "study", "runs": runs, "search": {"method": "pbt", "space": space}}
        folder = self.folder / "study"
        (folder / "records").mkdir()
        (folder / "search").mkdir()
        (folder / "sweep.json").write_text(json.dumps(sweep))
        generation = lambda rate, score, frames, parent="": {
            "settings": {"learning_rate": rate, "exploration_loss": "<b>none"},
            "parent": parent,
            "env_frames": frames,
            "score": score,
        }
        histories = {
            "member_1": [generation("0.0001", 1.5, 5e5), generation("0.0036", 6.25, 1e6, "member_2")],
            "member_2": [generation("0.003", 5.5, 5e5), generation("0.003", 7.5, 1e6), {"settings": {}, "parent": ""}],
        }
        for name, history in histories.items():
            (folder / "search" / f"{name}.json").write_text(json.dumps({"generations": history}))
            record = {"state": "finished", "searched": history[1]["settings"]}
            (folder / "records" / f"{name}.json").write_text(json.dumps(record))
        ended = run_report(self.folder, "--output", self.folder / "out")
        self.assertEqual(ended.returncode, 0, ended.stderr)
        text = (self.folder / "out" / "report.md").read_text()
        self.assertIn("| member_2 | 0.003 | &lt;b>none | 1 M | 7.5 | finished |\n| member_1 | 0.0036 |", text)
        self.assertIn("| 0.5 M | member_1 | member_2 | 1.5 | 5.5 | learning_rate 0.003 to 0.0036 |", text)
        page = (self.folder / "out" / "report.html").read_text()
        self.assertIn("a dotted line leads from the member", page)
        self.assertNotIn("<b>none", page)
        for damaged in ("{", "[]", '{"generations": [1, {"env_frames": "x"}]}', '{"generations": {"a": 1}}'):
            (folder / "search" / "member_1.json").write_text(damaged)
            for search in searches.read_searches(self.folder):
                self.assertEqual(searches.lineage_table(search).rows, [])
                self.assertIsNotNone(searches.lineage_figure(search))  # the other member's
        for damaged in ({"space": 3}, {"space": [3]}, 7, {"space": [], "method": []}):
            (folder / "sweep.json").write_text(json.dumps(sweep | {"search": damaged}))
            for search in searches.read_searches(self.folder):
                searches.run_table(search), searches.lineage_table(search), searches.lineage_figure(search)

    def test_labels_of_several_settings_leave_figures_their_room(self):
        for number, seed in enumerate((42, 68, 42, 68)):
            made_runs.write_run(
                self.folder,
                "lava_pit",
                "ippo",
                seed,
                start=0,
                end=5,
                name=f"run{number}",
                eps_clip_of_the_policy=number // 2 * 0.125,
                discount_of_late_rewards=0.99,
                minibatches_of_an_epoch=number // 2 + 4,
                steps_of_a_rollout=32 * (number // 2 + 1),
            )
        ended = run_report(self.folder)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assertNotIn("constrained_layout", ended.stderr)

    def test_the_way_of_computing_intervals_is_chosen(self):
        made_runs.write_study(self.folder, evaluations=False, scenarios=made_runs.TWO_SCENARIOS)
        texts = [of.csv_files(self.study(bootstrap=bootstrap))["scores.csv"] for bootstrap in (False, True)]
        self.assertNotEqual(*texts)
        self.assertTrue(report.parse([str(self.folder), "--bootstrap"]).bootstrap)

    def test_refuses_what_holds_no_run(self):
        for words, message in (
            ((self.folder,), "holds no run"),
            ((self.folder / "gone",), "there is no folder"),
            ((self.folder, "--at", "-3"), "not between"),
            ((self.folder, "--otput", "x"), "unrecognized"),
        ):
            ended = run_report(*words)
            self.assertEqual(ended.returncode, 2, ended.stderr)
            self.assertIn(message, ended.stderr)
        self.assertEqual(list(self.folder.iterdir()), [])


class ResultsPage(WithFolder):
    """A folder of kept results: tests over episodes, corrected, and what the page reports of them."""

    def keep(self, scenario, algo, seed, scores, **result):
        run = made_runs.write_run(self.folder, scenario, algo, seed, start=0, end=1, reports=5, frames=2e6)
        for name in ("metrics.jsonl", "status.json"):
            (run / name).unlink()
        (run / "curve.csv").write_text("env_frames,J\n1000000,0.25\n2000000,0.5\n")
        kept = {"train_for_env_frames": 2e6, "env_frames": 2e6, "train_s": 120, "commit": "abcdef012", "stale": ""}
        kept |= {"processor": "a CPU", "date": "2026-01-02"} | self.evaluation(scenario, run.name, scores) | result
        (run / "result.json").write_text(json.dumps(kept))
        return run

    def evaluation(self, scenario, policy, scores):
        answer = {"policy": policy, "scenario": scenario, "episodes": len(scores), "layout": "seed 42", "num_agents": 2}
        return answer | {"J_mean": float(np.mean(scores)), "J": scores, "return": scores}

    def random_play(self, scenario, scores):
        (self.folder / f"random_{scenario}.json").write_text(json.dumps(self.evaluation(scenario, "random", scores)))

    def page(self) -> str:
        page = self.folder / "RESULTS.md"
        self.assertEqual(run_report(self.folder, "--results_page", page).returncode, 0)
        return page.read_text()

    def test_people_have_their_rows(self):
        self.random_play("lava_pit", [0.0, 1.0] * 50)
        self.keep("lava_pit", "ippo", 7, [8.0, 9.0] * 50)
        self.assertIn("## People\n\nNo episode is kept yet", self.page())
        people = self.folder / "people"
        people.mkdir()
        for at, (policy, score) in enumerate([("0=person,1=oracle", 7.0), ("0=person,1=oracle", 9.0), ("random", 1.0), ("person", 4.0)]):
            (people / f"{at}.comrad").write_bytes(json.dumps({"scenario": "lava_pit", "policy": policy, "score": score}).encode() + b"\n\xff")
        (people / "junk.comrad").write_bytes(b"\xff")
        page = self.page()
        self.assertRegex(page, r"\| lava pit \| 0=person,1=oracle \| 2 \| 8 ± 13 \| 0.5 \|")
        self.assertRegex(page, r"\| lava pit \| person \| 1 \| 4 \|")
        self.assertNotIn("| random | 1", page)
        self.assertIn("people/junk.comrad: no episode of comrad play", page)

    def test_holm_is_the_textbook(self):
        # Holm 1979: 0.01, 0.02, 0.03, 0.04 times 4, 3, 2, 1, made rising.
        for ours, known in zip(results_page.holm([0.03, 0.01, 0.04, 0.02]), [0.06, 0.04, 0.06, 0.06]):
            self.assertAlmostEqual(ours, known)
        self.assertEqual(results_page.holm([0.9, 0.8]), [1.0, 1.0])

    def test_welch_is_the_textbook_and_knows_constants(self):
        ours, others = np.array([3.0, 4.0, 5.0, 6.0]), np.array([1.0, 2.0, 1.0, 4.0])
        difference, error = ours.mean() - others.mean(), math.sqrt(ours.var(ddof=1) / 4 + others.var(ddof=1) / 4)
        freedom = error**4 / ((ours.var(ddof=1) / 4) ** 2 / 3 + (others.var(ddof=1) / 4) ** 2 / 3)
        self.assertAlmostEqual(
            results_page.welch(ours, others), float(scipy.stats.t.sf(difference / error, freedom)), places=12
        )
        self.assertEqual(results_page.welch(np.ones(3), np.zeros(3)), 0.0)
        self.assertEqual(results_page.welch(np.zeros(3), np.zeros(3)), 1.0)

    def test_scores_of_cells_and_what_cannot_be_used(self):
        for scenario in ("lava_pit", "stag_hunt_arena"):
            self.random_play(scenario, [0.0, 1.0] * 50)
        self.keep("lava_pit", "ippo", 7, [8.0, 9.0] * 50)
        self.keep("lava_pit", "ippo", 8, [9.0, 10.0] * 50)
        self.keep("lava_pit", "vdn", 7, [0.0, 1.0] * 50, stale="gamma 0.9 -> 0.99", checkpoint_hash="xxh3:5")
        self.keep("stag_hunt_arena", "mappo", 7, [0.0] * 100)
        (self.keep("stag_hunt_arena", "ippo", 7, [0.0] * 100) / "result.json").write_text("{")
        (self.keep("stag_hunt_arena", "happo", 7, [0.0] * 100) / "curve.csv").write_text("env_frames,J\n2,1\n1,1\n")
        page = self.page()
        # 8.5 and 9.5: t(0.975, 1) = 12.706 times a standard error of 0.5; (9 - 0.025) / (11 - 0.025) of the scripted team's way.
        self.assertRegex(page, r"\| lava pit \| 0.5 \| \*\*9\*\* ± 6.4<br>82 % \|  \|  \|  \| 0.5†<br>4 % \|")
        self.assertRegex(page, r"\| stag hunt arena \| 0.5 \|  \| 0<br>-1 % \|  \|")
        self.assertIn("3 of 104 cells have runs, 0 of them three seeds or more", page)
        self.assertIn("over 4 runs", page)
        self.assertIn("stag_hunt_arena_ippo_7: ", page)
        self.assertIn("stag_hunt_arena_happo_7: curve.csv: a point is not finite, or env_frames do not rise", page)
        self.assertTrue((self.folder / "curves.png").stat().st_size > 1000)
        self.assertFalse((self.folder / "aggregates.png").exists(), "no two algorithms share three scenarios")
        rows = list(csv.DictReader(io.StringIO((self.folder / "runs.csv").read_text())))
        self.assertEqual([(row["run"], row["J"]) for row in rows][:2], [("lava_pit_ippo_7", "8.5"), ("lava_pit_ippo_8", "9.5")])
        self.assertEqual((rows[2]["stale"], rows[2]["checkpoint_hash"]), ("gamma 0.9 -> 0.99", "xxh3:5"))

    def test_a_scenario_with_more_runs_weighs_no_more(self):
        import intervals

        scores = [np.ones(4), np.zeros(1), np.zeros(2), np.zeros(1)]
        self.assertEqual(intervals.interquartile_mean(scores), 0.0)
        self.assertEqual(list(intervals.performance_profile(scores, np.array([0.5]))), [0.25])

    def test_the_algorithms_that_share_most_cells_are_shown_together(self):
        for scenario in ("lava_pit", "ammo_carrier", "platform_chain", "stag_hunt_arena"):
            for algo in ("ippo", "vdn", "qmix"):
                for seed in (7, 8):
                    if (scenario, algo) not in (("stag_hunt_arena", "vdn"), ("platform_chain", "qmix")):
                        self.keep(scenario, algo, seed, [float(seed), seed + 1.0] * 50)
        self.assertIn("Over the 3 scenarios where ippo, vdn have runs without † (", self.page())
        self.keep("platform_chain", "qmix", 7, [1.0, 2.0] * 50)
        self.assertIn("Over the 3 scenarios where ippo, vdn, qmix have runs without † (", self.page())
        self.assertTrue((self.folder / "aggregates.png").stat().st_size > 1000)

    def test_runs_of_an_earlier_recipe_are_compared_with_nothing(self):
        for algo in results_page.ALGORITHMS:
            self.keep("stag_hunt_arena", algo, 7, [2.0, 3.0] * 50, stale="" if algo in ("ippo", "mappo", "happo") else "gamma 0.9 -> 0.99")
        page = self.page()
        self.assertRegex(page, r"\| stag hunt arena \|.*\| 2.5†<br>8 % \|")
        self.assertNotIn("All algorithms together", page)
        self.assertNotIn("stag hunt arena: undecided", page)
        self.assertIn("commitment is needed. With default rules: not run.", page)

    def test_the_papers_scores_are_those_of_its_games_in_its_units(self):
        self.keep("coop_health_gathering@reference", "ippo", 7, [2000.0, 2010.0] * 50)  # tics; four are a decision
        self.keep("smart_enemies", "ippo", 7, [50.0, 60.0] * 50)
        beside = self.page().partition("## Beside the paper")[2].partition("## Findings")[0]
        self.assertIn("| coop health gathering | ippo | 1 | 2 M | 501.2 | 1105 | decisions |", beside)
        self.assertNotIn("smart enemies", beside)

    def test_findings_say_undecided_where_seeds_do_not_decide(self):
        for seed, (ippo, qmix) in enumerate([(9.0, 3.0), (9.1, 3.1), (9.2, 3.2)]):
            self.keep("rhythm_sync", "ippo", seed, [ippo] * 10)
            self.keep("rhythm_sync", "qmix", seed, [qmix] * 10)
            self.keep("foraging_commons", "ippo", seed, [ippo] * 10)
            self.keep("foraging_commons", "qmix", seed, [qmix] * 10)
            self.keep("ammo_carrier", "ippo", seed, [ippo] * 10)
            self.keep("ammo_carrier", "mappo", seed, [9.1 - 3 * (seed == 2) + 3 * (seed == 1)] * 10)
        self.keep("stag_hunt_arena", "ippo", 7, [9.0] * 10)
        self.keep("stag_hunt_arena", "vdn", 7, [1.0] * 10)
        page = self.page()
        self.assertIn("stag hunt arena: undecided (ippo 9, vdn 1; a single seed)", page)
        self.assertRegex(page, r"rhythm sync: holds \(ippo 9.1, qmix 3.1; p = .*, 3 seeds\)")
        self.assertRegex(page, r"foraging commons: the reverse \(qmix 3.1, ippo 9.1; p = ")
        self.assertRegex(page, r"ammo carrier: undecided \(ippo 9.1, mappo 9.1; p = ")
        self.assertIn("coop", page)
        self.assertIn("With reference rules: not run.", page)

    def test_units_that_do_not_convert_are_refused(self):
        table = self.folder / "published.toml"
        table.write_text('algorithms = ["ippo"]\n[lava_pit]\nunit = "tics"\nprinted = [1]\nhalf_width = [1]\narchived = [1]\n')
        with self.assertRaisesRegex(ValueError, "published.toml: lava_pit is published in tics, which are no count"):
            analysis.published_table(table)

    def scenario_pages(self) -> Ended:
        return run_report(self.folder, "--scenario_pages", self.folder / "pages")

    def test_each_scenarios_page_has_its_runs_between_two_marks(self):
        self.random_play("lava_pit", [0.0, 1.0] * 50)
        self.keep("lava_pit", "ippo", 7, [8.0, 9.0] * 50)
        self.keep("lava_pit", "vdn", 7, [0.0, 1.0] * 50)
        self.keep("stag_hunt_arena", "ippo", 7, [0.0] * 100)
        page = self.folder / "pages" / "lava_pit" / "README.md"
        page.parent.mkdir(parents=True)
        page.write_text("# Lava Pit\n\nWords.\n")
        self.assertEqual(self.scenario_pages().returncode, 0)
        first = page.read_text()
        self.assertTrue(first.startswith("# Lava Pit\n\nWords.\n\n<!-- results -->\n\n## What was shown to learn\n"))
        self.assertRegex(first, r"\| ippo \| 7 \|.*8\.5 ± .*\| learned \|")
        self.assertRegex(first, r"\| vdn \| 7 \|.*\| not learned \|")
        self.assertNotIn("stag_hunt", first)
        self.assertTrue((page.parent / "curves.png").stat().st_size > 1000)
        self.assertFalse((self.folder / "pages" / "stag_hunt_arena").exists(), "a scenario without a page gets none")

        page.write_text(first + "\nMore words.\n")
        self.assertEqual(self.scenario_pages().returncode, 0)
        self.assertEqual(page.read_text(), first + "\nMore words.\n", "the section is replaced, all else stays")

        page.write_text("<!-- results -->\n")
        broken = self.scenario_pages()
        self.assertEqual(broken.returncode, 2)
        self.assertIn("needs both", broken.stderr)
        self.assertEqual(page.read_text(), "<!-- results -->\n")


class Rates(unittest.TestCase):
    def draw(self, *words):
        program = HERE.parents[3] / "deploy" / "report" / "rates.py"
        return subprocess.run([sys.executable, "-B", str(program), *map(str, words)], capture_output=True, text=True, timeout=300)

    def test_the_kept_rates_become_two_charts(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.draw(folder)
            self.assertEqual(done.returncode, 0, done.stderr)
            for name in ("pipeline.png", "simulator.png"):
                self.assertGreater(pathlib.Path(folder, name).stat().st_size, 1000)

    def test_an_entry_without_a_rate_is_named_as_bad_input(self):
        with tempfile.TemporaryDirectory() as folder:
            rates = pathlib.Path(folder, "rates.toml")
            rates.write_text("[[pipeline]]\ncores = 2\n")
            done = self.draw(folder, "--rates", rates)
            self.assertEqual(done.returncode, 2)
            self.assertIn("needs rates", done.stderr)


if __name__ == "__main__":
    unittest.main()
