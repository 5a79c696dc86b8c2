#!/usr/bin/env python3
"""Draws the learning curves of runs from their metrics.jsonl; `comrad plot` starts it.

    plot.py --output FILE [--metric NAME] [--x env_frames|time_s] [--title TEXT] [--over_seeds]
            [--baseline NAME=VALUE ...] --curve LABEL RUN_DIR [RUN_DIR ...] [--curve ...]

A curve of one run is drawn as it is; of several, each thinly and their mean with its 95% interval over the runs (Student t).
Evaluations (eval/J) of runs that have them are drawn dashed. A run without a number to draw is named and left out.
Exit code 0; 2 where nothing is left to draw or matplotlib is missing (Debian: python3-matplotlib).
"""
import argparse
import bisect
import difflib
import json
import math
import pathlib
import statistics
import sys
import tomllib

SCORE = "policy_stats/avg_true_objective"
EVALUATION = "eval/J"
AXES = {"env_frames": ("env frames (millions)", 1e6), "time_s": ("hours of training", 3600.0)}
GRID_POINTS = 200
# Settings that do not make two runs different experiments.
NAMES_OF_A_RUN = {"seed", "experiment", "train_dir", "restart_behavior", "wad", "load_checkpoint_kind"}
# Student's t, two-sided 95%, for 1, 2, ... degrees of freedom; the normal distribution's beyond.
T_95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131)

Curve = tuple[list[float], list[float]]  # rising x, and y


def say(text: str) -> None:
    print(f"comrad plot: {text}", file=sys.stderr)


def read_reports(run_dir: pathlib.Path) -> list[dict]:
    """The lines of metrics.jsonl; the last may be half written, as the run may go on. Empty where there is none."""
    reports = []
    try:
        with open(run_dir / "metrics.jsonl", encoding="utf-8") as lines:
            for line in lines:
                try:
                    report = json.loads(line)
                except ValueError:
                    continue
                if isinstance(report, dict) and isinstance(report.get("env_frames"), (int, float)):
                    reports.append(report)
    except OSError:
        pass
    return reports


def curve_of(reports: list[dict], metric: str, x: str) -> Curve:
    """x (in the unit of AXES, rising) and the metric of every report that has it."""
    points = {}
    for report in reports:  # after a learner went back to a checkpoint, the later report of a place counts
        value = report.get(metric)
        if isinstance(value, (int, float)) and isinstance(report.get(x), (int, float)):
            points[report[x] / AXES[x][1]] = value
    return sorted(points), [points[place] for place in sorted(points)]


def value_at(curve: Curve, at: float) -> float:
    """The value at `at` on the line through the points; that of the first or last point outside of them."""
    xs, ys = curve
    right = bisect.bisect_right(xs, at)
    if right in (0, len(xs)):
        return ys[min(right, len(xs) - 1)]
    part = (at - xs[right - 1]) / (xs[right] - xs[right - 1])
    return ys[right - 1] + part * (ys[right] - ys[right - 1])


def mean_and_interval(curves: list[Curve]) -> tuple[list[float], list[float], list[float]]:
    """x that all curves cover, their mean there, and the half-width of its 95% interval."""
    begin = max(xs[0] for xs, _ in curves)
    end = max(begin, min(xs[-1] for xs, _ in curves))
    grid = [begin + (end - begin) * i / (GRID_POINTS - 1) for i in range(GRID_POINTS)]
    t = T_95[len(curves) - 2] if len(curves) - 2 < len(T_95) else 1.96
    means, half_widths = [], []
    for at in grid:
        values = [value_at(curve, at) for curve in curves]
        means.append(statistics.fmean(values))
        half_widths.append(t * statistics.stdev(values) / math.sqrt(len(values)))
    return grid, means, half_widths


def settings_of(run_dir: pathlib.Path) -> dict:
    """The settings of config.toml, sections flattened; empty where it cannot be read."""
    try:
        with open(run_dir / "config.toml", "rb") as file:
            document = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError):
        return {}
    flat = {}
    for key, value in document.items():
        flat.update(value if isinstance(value, dict) else {key: value})
    return flat


def grouped_over_seeds(curves: list[tuple[str, list[pathlib.Path]]]) -> list[tuple[str, list[pathlib.Path]]]:
    """Single runs that differ in their seed alone become one curve, named by scenario, algorithm and what else differs."""
    groups: dict[str, list[pathlib.Path]] = {}
    kept, settings = [], {}
    for label, runs in curves:
        if len(runs) > 1:
            kept.append((label, runs))
            continue
        chosen = {key: value for key, value in settings_of(runs[0]).items() if key not in NAMES_OF_A_RUN}
        key = json.dumps(chosen, sort_keys=True, default=str)
        settings[key] = chosen
        groups.setdefault(key, []).append(runs[0])
    named = {"scenario", "algo"}
    differing = sorted(
        name for name in {name for chosen in settings.values() for name in chosen}
        if name not in named and len({json.dumps(chosen.get(name), default=str) for chosen in settings.values()}) > 1)
    for key, runs in groups.items():
        chosen = settings[key]
        words = [str(chosen.get("scenario", runs[0].name)), str(chosen.get("algo", "")).upper()]
        words += [f"{name}={chosen.get(name)}" for name in differing[:3]]
        kept.append((" ".join(word for word in words if word), runs))
    return kept


def why_nothing(run: pathlib.Path, reports: list[dict], metric: str) -> str:
    if not reports:
        return f"{run.name}: it has written no report yet; left out"
    if metric in (SCORE, EVALUATION):
        what = "no episode has ended" if metric == SCORE else "nothing was evaluated"
        return f"{run.name}: {what} in {len(reports)} reports; left out"
    known = sorted({name for report in reports for name in report})
    near = difflib.get_close_matches(metric, known, n=1)
    return f"{run.name}: no report has a number {metric}" + (f"; did you mean {near[0]}?" if near else "") + "; left out"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--curve", nargs="+", action="append", required=True, metavar=("LABEL", "RUN_DIR"))
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--metric", default=SCORE)
    parser.add_argument("--x", choices=sorted(AXES), default="env_frames")
    parser.add_argument("--title", default="")
    parser.add_argument("--over_seeds", action="store_true")
    parser.add_argument("--baseline", action="append", default=[], metavar="NAME=VALUE")
    arguments = parser.parse_args()
    try:
        import matplotlib
    except ImportError:
        say("matplotlib is missing; install python3-matplotlib")
        return 2
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    curves = [(words[0], [pathlib.Path(word) for word in words[1:]]) for words in arguments.curve]
    if arguments.over_seeds:
        curves = grouped_over_seeds(curves)
    figure, axes = plt.subplots(figsize=(7, 4), dpi=110)
    drawn = 0
    for label, runs in curves:
        learned, evaluated = [], []
        for run in runs:
            reports = read_reports(run)
            curve = curve_of(reports, arguments.metric, arguments.x)
            if curve[0]:
                learned.append(curve)
            else:
                say(why_nothing(run, reports, arguments.metric))
            evaluation = curve_of(reports, EVALUATION, arguments.x) if arguments.metric == SCORE else ([], [])
            if evaluation[0]:
                evaluated.append(evaluation)
        color = None  # the same for what was learned and how it was evaluated
        for kind, of_kind in (("", learned), (", evaluated", evaluated)):
            if not of_kind:
                continue
            drawn += 1
            style = "--" if kind else "-"
            marker = "o" if kind and max(len(xs) for xs, _ in of_kind) <= 50 else None
            if len(of_kind) == 1:
                (line,) = axes.plot(*of_kind[0], style, marker=marker, markersize=3, color=color, label=label + kind)
                color = line.get_color()
                continue
            xs, means, half_widths = mean_and_interval(of_kind)
            (line,) = axes.plot(xs, means, style, linewidth=2, color=color,
                                label=f"{label}{kind} (mean of {len(of_kind)}, 95 %)")
            axes.fill_between(xs, [mean - half for mean, half in zip(means, half_widths)],
                              [mean + half for mean, half in zip(means, half_widths)],
                              color=line.get_color(), alpha=0.15, linewidth=0)
            color = line.get_color()
            for curve in of_kind:
                axes.plot(*curve, style, color=color, alpha=0.5, linewidth=0.7)
    if drawn == 0:
        say("error: nothing to draw")
        return 2
    for baseline in arguments.baseline:
        name, _, value = baseline.rpartition("=")
        try:
            axes.axhline(float(value), color="gray", linestyle="--", linewidth=1, label=name)
        except ValueError:
            say(f"error: --baseline {baseline}: write NAME=VALUE, for example random=649")
            return 2
    axes.set_xlabel(AXES[arguments.x][0])
    axes.set_ylabel("score J (training: mean of the last episodes)" if arguments.metric == SCORE else arguments.metric)
    axes.set_title(arguments.title)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
