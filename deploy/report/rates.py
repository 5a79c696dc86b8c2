#!/usr/bin/env python3
"""Draws the charts of BENCHMARKS.md from deploy/bench/rates.toml.

    rates.py FOLDER [--rates FILE]

Writes pipeline.png (env frames a second by cores and network) and simulator.png (decisions a second beside ViZDoom, by players).
"""

import argparse
import pathlib
import sys
import tomllib

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 (the backend is chosen first)

HOME = pathlib.Path(__file__).resolve().parents[2]
OURS, OTHERS = ("#9ecae9", "#3fa7e0", "#0072b2"), "#d55e00"  # more cores, darker
BAD_INPUT = 2


def bars(axes, labels: list[str], values: list[float], colors: list[str]) -> None:
    """Horizontal bars with their values behind them."""
    places = range(len(labels))
    axes.barh(places, values, color=colors)
    axes.set_yticks(places, labels)
    axes.invert_yaxis()
    axes.set_xlim(0, 1.15 * max(values))
    axes.spines[["top", "right"]].set_visible(False)
    for place, value in zip(places, values, strict=True):
        axes.text(value, place, f" {value:,.0f}".replace(",", " "), va="center", fontsize=8)


def draw(rates: dict, folder: pathlib.Path) -> list[pathlib.Path]:
    """Both charts. Errors: KeyError, TypeError and ValueError where an entry lacks something."""
    rows = sorted((entry["cores"], rate, network) for entry in rates["pipeline"] for network, rate in entry["rates"].items())
    figure, axes = plt.subplots(figsize=(7, 0.4 + 0.26 * len(rows)), layout="constrained")
    shades = dict(zip(sorted({cores for cores, _, _ in rows}), OURS, strict=False))
    labels = [f"{network}, {cores} core{'s' * (cores > 1)}" for cores, _, network in rows]
    bars(axes, labels, [rate for _, rate, _ in rows], [shades.get(cores, OURS[-1]) for cores, _, _ in rows])
    axes.set_xlabel("env frames/s, training IPPO on Co-op Health Gathering without a GPU")
    files = [folder / "pipeline.png", folder / "simulator.png"]
    figure.savefig(files[0], dpi=110)

    rows = sorted((int(players), -rate, entry["name"]) for entry in rates["simulator"] for players, rate in entry["rates"].items())
    figure, axes = plt.subplots(figsize=(7, 2.2), layout="constrained")
    labels = [f"{name}, {players} player{'s' * (players > 1)}" for players, _, name in rows]
    bars(axes, labels, [-rate for _, rate, _ in rows], [OURS[-1] if "COMRAD" in name else OTHERS for _, _, name in rows])
    axes.set_xlabel("Stag Hunt, decisions/s of all players")
    figure.savefig(files[1], dpi=110)
    return files


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--rates", type=pathlib.Path, default=HOME / "deploy" / "bench" / "rates.toml")
    arguments = parser.parse_args()
    try:
        rates = tomllib.loads(arguments.rates.read_text(encoding="utf-8"))
        arguments.folder.mkdir(parents=True, exist_ok=True)
        files = draw(rates, arguments.folder)
    except (OSError, KeyError, TypeError, ValueError) as error:
        print(f"comrad bench: error: {arguments.rates}: {error!r}; each entry needs rates and cores or name", file=sys.stderr)
        return BAD_INPUT
    print("\n".join(map(str, files)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
