#!python
"""The commands `comrad` and `python -m comrad`: the trainer's own program, where one is installed, else a line with where to get it."""

import os
import sys

HOW = (
    "comrad: the trainer is no Python package; have it as a Debian package (apt-get install ./comrad_*_amd64.deb), as an image "
    "(docker run comrad train ...), or from the sources (./comrad train ...): see deploy/INSTALL.md there"
)

for folder in os.environ.get("PATH", "").split(os.pathsep):
    program = os.path.join(folder, "comrad")
    if os.path.isfile(program) and os.access(program, os.X_OK):
        with open(program, "rb") as file:
            is_ours = b"python" in file.readline(200)  # this one, or that of another environment
        if not is_ours:
            os.execv(program, [program, *sys.argv[1:]])
sys.exit(HOW)
