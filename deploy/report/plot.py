#!/usr/bin/env python3
"""Draws the learning curves of runs from their metrics.jsonl; `comrad plot` starts it.

    plot.py --output FILE [--metric NAME] [--x env_frames|time_s] [--title TEXT] [--over_seeds]
            [--baseline NAME=VALUE ...] [--curve LABEL DIR [DIR ...] ...] [--folder DIR ...]

DIR is a run or a folder with runs, as a sweep's. A curve of one run is drawn as it is; of several, each thinly and their mean,
from four runs on with its 95% interval over the runs (Student t). Of a --folder, runs that differ in their seed alone are one curve. Where all play one scenario on its default map, lines show the scores of random play and of the scripted team.
Evaluations (eval/J) of runs that have them are drawn dashed. A run without a number to draw is named and left out.
Exit code 0; 2 where nothing is left to draw or a package is missing (deploy/packages_report.txt).
"""

import argparse
import difflib
import pathlib
import sys


def say(text: str) -> None:
    print(f"comrad plot: {text}", file=sys.stderr)


def parse(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--curve", nargs="+", action="append", default=[], metavar=("LABEL", "DIR"))
    parser.add_argument("--folder", action="append", default=[], metavar="DIR")
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--metric", default="")
    parser.add_argument("--x", choices=("env_frames", "time_s"), default="env_frames")
    parser.add_argument("--title", default="")
    parser.add_argument("--over_seeds", action="store_true")
    parser.add_argument("--baseline", action="append", default=[], metavar="NAME=VALUE")
    return parser.parse_args(words)


def main(words: list[str]) -> int:
    arguments = parse(words)
    try:
        from figures import EVALUATION, axis_of, plt
        from analysis import Options, labels_of, measured_references, reference_file, references_of
        from curves import REFERENCE_COLOR, draw_references, draw_runs
        from run_files import NO_RUN, SCORE, find_runs
        from sweep_files import add_planned_runs
    except ImportError as error:
        say(f"error: {error}; install the packages of deploy/packages_report.txt (./comrad plot does on Debian)")
        return 2
    metric = arguments.metric or SCORE

    def why_nothing(run) -> str:
        if run.state == "missing":
            return run.status["message"]
        if not len(run.metrics):
            return "it has written no report yet"
        if metric == SCORE:
            return f"no episode has ended in {len(run.metrics)} reports"
        if metric == EVALUATION:
            return f"nothing was evaluated in {len(run.metrics)} reports"
        near = difflib.get_close_matches(metric, sorted(run.metrics.values), n=1)
        return f"no report has a number {metric}" + (f"; did you mean {near[0]}?" if near else "")

    def has_numbers(run) -> bool:
        names = (metric, EVALUATION)[: 2 if metric == SCORE else 1]
        return any(len(run.metrics.series(name, arguments.x)[0]) for name in names)

    def runs_of(folders: list[str]) -> list:
        drawable = []
        for folder in map(pathlib.Path, folders):
            runs, left_out = find_runs(folder)
            left_out += add_planned_runs(folder, runs)
            left_out += [(run.name, why_nothing(run)) for run in runs if not has_numbers(run)]
            for name, why in left_out:
                say(f"{name}: {why}; left out")
            if not runs and not left_out:
                say(f"{folder.resolve()} {NO_RUN}")
            drawable += filter(has_numbers, runs)
        return drawable

    curves = [(label, runs) for label, *folders in arguments.curve if (runs := runs_of(folders))]
    grouped = runs_of(arguments.folder)
    if arguments.over_seeds:
        grouped += [runs[0] for _, runs in curves if len(runs) == 1]
        curves = [(label, runs) for label, runs in curves if len(runs) > 1]
    if grouped:  # those that differ in their seed alone become one curve
        names = labels_of(grouped, Options())
        groups: dict[str, list] = {}
        for run in grouped:
            groups.setdefault(
                f"{run.scenario} {names[str(run.folder)].replace(run.algo, run.algo.upper(), 1)}", []
            ).append(run)
        curves += groups.items()

    words_below, scale = axis_of([run for _, runs in curves for run in runs], arguments.x)
    figure, axes = plt.subplots(figsize=(7, 4), dpi=110, layout="constrained")
    drawn = 0
    for label, runs in curves:
        color = None  # the same for what was learned and how it was evaluated
        for name, words, style in ((metric, "", "-"), (EVALUATION, ", evaluated", "--")):
            if words and metric != SCORE:
                continue
            look = {"color": color, "scale": scale, "linestyle": style}
            line = draw_runs(axes, runs, label + words, metric=name, over=arguments.x, **look)
            if line is None:
                continue
            drawn += 1
            color = line.get_color()
            if style == "--" and len(line.get_xdata()) <= 50:
                line.set(marker="o", markersize=3)
    if drawn == 0:
        say("error: nothing to draw")
        return 2
    for baseline in arguments.baseline:
        name, _, value = baseline.rpartition("=")
        try:
            axes.axhline(float(value), color=REFERENCE_COLOR, linestyle="-.", linewidth=1, label=name)
        except ValueError:
            say(f"error: --baseline {baseline}: write NAME=VALUE, for example random=649")
            return 2
    everything = [run for _, runs in curves for run in runs]
    scenarios = list(dict.fromkeys(run.scenario for run in everything))
    if metric == SCORE and len(scenarios) == 1:
        for reference in references_of(everything, [], measured_references(reference_file()), []).values():
            draw_references(axes, reference.random, reference.scripted)
    axes.set_xlabel(words_below)
    axes.set_ylabel("score J (training: mean of the last episodes)" if metric == SCORE else metric)
    named = ", ".join(name.replace("_", " ") for name in scenarios[:3]) + (" and others" if len(scenarios) > 3 else "")
    axes.set_title(arguments.title or named)
    axes.legend()
    figure.savefig(arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
