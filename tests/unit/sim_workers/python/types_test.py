#!/usr/bin/env python3
"""The Python package's types agree: mypy over its sources and the stub of its extension module.

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
with tempfile.TemporaryDirectory() as cache:
    sys.exit(subprocess.run([sys.executable, "-m", "mypy", "--ignore-missing-imports", "--cache-dir", cache, str(PACKAGE)], cwd=PACKAGE.parent).returncode)
