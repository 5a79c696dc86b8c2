#!/usr/bin/env python3
"""deploy/package/release.sh --quick reports of each point whether it is met.

    release_test.py [unittest arguments]
"""

import pathlib
import shutil
import subprocess
import tempfile
import unittest

HOME = pathlib.Path(__file__).resolve().parents[4]
FILES = {
    "CMakeLists.txt": "project(comrad VERSION 1.2.3 LANGUAGES C CXX\n",
    "CITATION.cff": "cff-version: 1.2.0\nversion: 1.2.3\n",
    "CHANGELOG.md": "# Changelog\n\n## [Unreleased]\n\n## [1.2.3] - 2026-11-29\n\n### Added\n\n* Something.\n",
    "LICENSE": "MIT\n",
    "scenarios/DATASHEET.md": "# Datasheet\n",
    "scenarios/one/scenario.toml": "version = 2\n",
    "deploy/wheel/freedoom/LICENSE": "BSD\n",
}


class Release(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.home = pathlib.Path(scratch.name)
        for name, text in FILES.items():
            self.write(name, text)
        (self.home / "deploy/package").mkdir()
        shutil.copy(HOME / "deploy/package/release.sh", self.home / "deploy/package/")
        self.git("init", "--quiet")
        self.git("add", "--all")
        self.git("-c", "user.name=x", "-c", "user.email=x@localhost", "commit", "--quiet", "--message=x")
        self.git("tag", "v1.2.3")

    def write(self, name, text):
        path = self.home / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def git(self, *words):
        subprocess.run(["git", "-C", str(self.home), *words], check=True)

    def unmet(self):
        done = subprocess.run([self.home / "deploy/package/release.sh", "--quick"], capture_output=True, text=True, timeout=60)
        found = [line for line in done.stdout.splitlines() if line.startswith("NOT MET")]
        self.assertEqual(done.returncode, int(bool(found)), done.stdout + done.stderr)
        return found

    def test_a_release_that_has_all(self):
        self.assertEqual(self.unmet(), [])

    def test_each_point_can_fail(self):
        for name, good, bad, words in (
            ("CITATION.cff", "version: 1.2.3", "version: 1.2.2", "CITATION.cff"),
            ("CHANGELOG.md", "[1.2.3] - 2026-11-29", "[1.2.3]", "with its date"),
            ("CHANGELOG.md", "## [Unreleased]\n", "## [Unreleased]\n\n* More.\n", "Unreleased"),
            ("scenarios/one/scenario.toml", "version = 2", "title = 2", "every scenario"),
        ):
            with self.subTest(words):
                self.write(name, FILES[name].replace(good, bad))
                found = self.unmet()
                self.assertEqual(len(found), 2, found)  # and that it is not committed
                self.assertIn(words, found[0])
                self.assertIn("committed", found[1])
                self.write(name, FILES[name])
        (self.home / "LICENSE").unlink()
        self.assertIn("licences", self.unmet()[0])


if __name__ == "__main__":
    unittest.main()
