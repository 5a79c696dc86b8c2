#!/usr/bin/env python3
"""Croissant descriptions of a pool of maps and of recorded episodes: mlcroissant accepts them and reads their records; damaged folders are refused.

    COMRAD_PROGRAM=build/bin/comrad PYTHONPATH=build/python croissant_test.py [unittest arguments]

mlcroissant comes from PyPI into an environment of the test's own. Ends with 77 where it cannot be had.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import venv

from package import comrad  # noqa: F401 (first: it ends the test where the package is not there)

PROGRAM = os.environ.get("COMRAD_PROGRAM", "")
READS = """
import json, sys
import mlcroissant
dataset = mlcroissant.Dataset(sys.argv[1])
assert not dataset.metadata.ctx.issues.errors and not dataset.metadata.ctx.issues.warnings, dataset.metadata.ctx.issues.report()
for record in dataset.records(sys.argv[2]):
    print(json.dumps({key: value.decode() if isinstance(value, bytes) else value for key, value in record.items()}))
"""


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=600, check=False)


class Croissant(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        venv.create(cls.folder / "reader", with_pip=True)
        cls.reader = cls.folder / "reader" / "bin" / "python"
        got = run(cls.reader, "-m", "pip", "install", "-q", "mlcroissant==1.1.1")
        if got.returncode != 0:
            print(f"[  SKIPPED ] 1 test, Croissant: pip cannot get mlcroissant: {(got.stderr or got.stdout).strip().splitlines()[-1]}")
            sys.exit(77)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def described(self, folder):
        done = run(sys.executable, "-B", "-m", "comrad.croissant", folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        return folder / "croissant.json"

    def records(self, file, name):
        done = run(self.reader, "-c", READS, file, name)
        self.assertEqual(done.returncode, 0, done.stderr[-3000:])
        return [json.loads(line) for line in done.stdout.splitlines()]

    def test_a_pool(self):
        pool = self.folder / "pool"
        drawn = run(PROGRAM, "doomgen", "lava_pit", "--pool", "eval", "--count", "3", "-o", pool)
        self.assertEqual(drawn.returncode, 0, drawn.stderr)
        file = self.described(pool)
        registry = json.loads((pool / "batch_registry.json").read_text(encoding="utf-8"))
        records = self.records(file, "maps")
        self.assertEqual([one["maps/content_hash"] for one in records], [one["content_hash"] for one in registry])
        self.assertEqual({(one["maps/split"], one["maps/scenario_version"]) for one in records}, {("eval", comrad.describe("lava_pit")["version"])})
        before = file.read_bytes()
        self.assertEqual(self.described(pool).read_bytes(), before)
        listed = {one["@id"] for one in json.loads(before)["distribution"]}
        self.assertEqual(listed, {"batch_registry.json"} | {one["filename"] for one in registry})
        (pool / registry[0]["filename"]).unlink()
        self.assertRegex(run(sys.executable, "-B", "-m", "comrad.croissant", pool).stderr, r"^comrad\.croissant: .*no such file, but .* lists it\n$")

    def test_episodes(self):
        episodes = self.folder / "episodes"
        played = run(PROGRAM, "eval", "--scenario", "coop_health_gathering", "--policy", "random", "--episodes", "3", "--episodes_dir", episodes)
        self.assertEqual(played.returncode, 0, played.stderr[-2000:])
        records = self.records(self.described(episodes), "episodes")
        kept = [comrad.load_episode(file) for file in sorted(episodes.glob("*.comrad"))]
        self.assertEqual([one["episodes/score"] for one in records], [one.score for one in kept])
        self.assertEqual({one["episodes/scenario_version"] for one in records}, {comrad.describe("coop_health_gathering")["version"]})
        kept[0].about["scenario_version"] = 99
        self.assertRaisesRegex(ValueError, "version 99, here it has version", kept[0].make_env)
        self.assertEqual([one["episodes/episode_seed"] for one in records], [one.episode_seed for one in kept])

    def test_bad_input(self):
        for folder, words in (("none", "neither batch_registry.json"), ("bad", "not as comrad doomgen writes it")):
            (self.folder / folder).mkdir()
            if folder == "bad":
                (self.folder / folder / "batch_registry.json").write_text("[{}]", encoding="utf-8")
            done = run(sys.executable, "-B", "-m", "comrad.croissant", self.folder / folder)
            self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
            self.assertIn(words, done.stderr)


if __name__ == "__main__":
    unittest.main()
