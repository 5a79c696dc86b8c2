#!/usr/bin/env python3
"""Draws the learning curve of one or more runs from their metrics.jsonl.

    deploy/report/plot_curve.py RUN_DIR [RUN_DIR ...] -o curve.png [--title TEXT] [--baseline NAME=VALUE ...]

x axis: env frames (agents x tics); y axis: score J, mean over the last `stats_avg` training episodes.
Needs matplotlib (Debian: python3-matplotlib).
"""
import argparse
import json
import pathlib
import sys

SCORE_KEY = "policy_stats/avg_true_objective"


def read_curve(run_dir: pathlib.Path) -> tuple[list[float], list[float]]:
    """Returns env frames (in millions) and J of every report that has a score."""
    frames, scores = [], []
    with open(run_dir / "metrics.jsonl", encoding="utf-8") as lines:
        for line in lines:
            report = json.loads(line)
            if report.get(SCORE_KEY) is not None:
                frames.append(report["env_frames"] / 1e6)
                scores.append(report[SCORE_KEY])
    return frames, scores


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run_dirs", nargs="+", type=pathlib.Path)
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
    for run_dir in arguments.run_dirs:
        frames, scores = read_curve(run_dir)
        if not frames:
            print(f"plot_curve: {run_dir}/metrics.jsonl holds no {SCORE_KEY}", file=sys.stderr)
            return 2
        axes.plot(frames, scores, label=run_dir.name)
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
