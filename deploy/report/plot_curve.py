#!/usr/bin/env python3
"""Draws the learning curve of one or more runs from their metrics.jsonl.

    deploy/report/plot_curve.py RUN [RUN ...] -o curve.png [--title TEXT] [--baseline NAME=VALUE ...]

A RUN is a run directory, or several of one setting under one name: NAME=DIR,DIR,... draws each of them thinly and
their mean with its 95% interval over the runs (Student t). x axis: env frames (agents x tics); y axis: score J, mean
over the last `stats_avg` training episodes. Needs matplotlib (Debian: python3-matplotlib).
"""
import argparse
import bisect
import json
import math
import pathlib
import statistics
import sys

SCORE_KEY = "policy_stats/avg_true_objective"
GRID_POINTS = 200
# Student's t, two-sided 95%, for 1, 2, ... degrees of freedom; the normal distribution's beyond.
T_95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131)

Curve = tuple[list[float], list[float]]


def read_curve(run_dir: pathlib.Path) -> Curve:
    """Returns env frames (in millions, rising) and J of every report that has a score.

    Raises OSError where there is no metrics.jsonl and ValueError where it holds no score."""
    frames, scores = [], []
    with open(run_dir / "metrics.jsonl", encoding="utf-8") as lines:
        for line in lines:
            report = json.loads(line)
            if report.get(SCORE_KEY) is not None:
                frames.append(report["env_frames"] / 1e6)
                scores.append(report[SCORE_KEY])
    if not frames:
        raise ValueError(f"{run_dir}/metrics.jsonl holds no {SCORE_KEY}")
    return frames, scores


def score_at(curve: Curve, at: float) -> float:
    """J of the last report at or before `at` million env frames; of the first one before that."""
    frames, scores = curve
    return scores[max(0, bisect.bisect_right(frames, at) - 1)]


def mean_and_interval(curves: list[Curve]) -> tuple[list[float], list[float], list[float]]:
    """Returns env frames that all curves cover, their mean J there, and the half-width of its 95% interval."""
    begin = max(frames[0] for frames, _ in curves)
    end = min(frames[-1] for frames, _ in curves)
    grid = [begin + (end - begin) * i / (GRID_POINTS - 1) for i in range(GRID_POINTS)]
    t = T_95[len(curves) - 2] if len(curves) - 2 < len(T_95) else 1.96
    means, half_widths = [], []
    for at in grid:
        scores = [score_at(curve, at) for curve in curves]
        means.append(statistics.fmean(scores))
        half_widths.append(t * statistics.stdev(scores) / math.sqrt(len(scores)))
    return grid, means, half_widths


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="RUN")
    parser.add_argument("-o", "--output", required=True, type=pathlib.Path)
    parser.add_argument("--title", default="")
    parser.add_argument("--baseline", action="append", default=[], metavar="NAME=VALUE")
    arguments = parser.parse_args()

    try:
        import matplotlib
    except ImportError:
        print("plot_curve: matplotlib is missing; install python3-matplotlib", file=sys.stderr)
        return 2
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4), dpi=110)
    for run in arguments.runs:
        name, _, folders = run.rpartition("=")
        run_dirs = [pathlib.Path(folder) for folder in folders.split(",")]
        try:
            curves = [read_curve(run_dir) for run_dir in run_dirs]
        except (OSError, ValueError) as error:
            print(f"plot_curve: {error}", file=sys.stderr)
            return 2
        if len(curves) == 1:
            axes.plot(*curves[0], label=name or run_dirs[0].name)
            continue
        frames, means, half_widths = mean_and_interval(curves)
        (line,) = axes.plot(frames, means, linewidth=2, label=f"{name} (mean of {len(curves)}, 95%)")
        axes.fill_between(
            frames,
            [mean - half for mean, half in zip(means, half_widths)],
            [mean + half for mean, half in zip(means, half_widths)],
            color=line.get_color(), alpha=0.15, linewidth=0)
        for curve in curves:
            axes.plot(*curve, color=line.get_color(), alpha=0.5, linewidth=0.7)
    for baseline in arguments.baseline:
        name, _, value = baseline.partition("=")
        axes.axhline(float(value), color="gray", linestyle="--", linewidth=1, label=name)
    axes.set_xlabel("env frames (millions)")
    axes.set_ylabel("J (training episodes, mean of the last 100)")
    axes.set_title(arguments.title)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
