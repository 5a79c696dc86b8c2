#!/usr/bin/env python3
"""The Python package's types agree: mypy over its sources, the stub of its extension module, and a caller's wrong options.

    types_test.py
"""

import importlib.util
import pathlib
import subprocess
import sys
import tempfile

PACKAGE = pathlib.Path(__file__).resolve().parents[4] / "sim_workers" / "python" / "comrad"

if importlib.util.find_spec("mypy") is None:
    print("[  SKIPPED ] 1 test, types of the Python package: no mypy; ./comrad test installs it (deploy/requirements_test.txt)")
    sys.exit(77)
WRONG = "import comrad\n" + "".join(f"comrad.{make}('lava_pit', num_agent=2)\n" for make in ("parallel_env", "env", "team_env", "vector_env"))
RIGHT = "comrad.parallel_env('lava_pit', num_agents=2)\n"

with tempfile.TemporaryDirectory() as cache:

    def check(*paths, **options):
        command = [sys.executable, "-m", "mypy", "--ignore-missing-imports", "--cache-dir", cache, *paths]
        return subprocess.run(command, cwd=PACKAGE.parent, text=True, **options)

    if check(str(PACKAGE)).returncode != 0:
        sys.exit(1)
    caller = pathlib.Path(cache) / "caller.py"
    caller.write_text(WRONG + RIGHT, encoding="utf-8")
    told = check(str(caller), capture_output=True).stdout
    if told.count('Unexpected keyword argument "num_agent"') != 4 or "Found 4 errors" not in told:
        sys.exit(f"mypy should refuse num_agent=2 in four calls, and nothing else:\n{told}")
