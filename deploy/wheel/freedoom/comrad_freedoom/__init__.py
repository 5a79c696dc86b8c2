"""Freedoom 2's IWAD as a file of this package; `comrad` finds it by itself."""

import pathlib

IWAD = pathlib.Path(__file__).with_name("freedoom2.wad")
