#!/usr/bin/env python3
"""Hands the reports of runs to other programs; `comrad export` starts it. Needs Python's own modules alone, and wandb for --wandb.

    export.py --csv FILE RUN_DIR [RUN_DIR ...]
    export.py --wandb FOLDER [--project NAME] RUN_DIR [RUN_DIR ...]

--csv writes one row a report: run, scenario, algo, seed, time_s, env_frames, decisions, then every other name that any of the
runs has (learner/METRICS.md); a cell is empty where a report lacks the name or holds null. --wandb lets the wandb package make
an offline run of each, with its videos, which `wandb sync` uploads. What a learner forgot when it went back to a checkpoint is left out, as in plots.
Damaged lines are named. A run without a report is named and left out; exit code 2 where none is left.
"""

import argparse
import csv
import dataclasses
import math
import os
import pathlib
import re
import sys

from report_lines import number, one_line, read_reports, read_settings

FIRST_NAMES = ("time_s", "env_frames", "decisions")


@dataclasses.dataclass
class ReportedRun:
    """A run's name in the output, its config.toml, and its reports as in read_reports()."""

    name: str
    settings: dict
    rows: list[tuple[float, float, dict]]
    folder: pathlib.Path

    @property
    def scenario(self) -> str:
        return pathlib.PurePath(self.settings["scenario"]).name

    @property
    def videos(self) -> list[tuple[int, pathlib.Path]]:
        """Env frames and file of each video (--video_every_env_frames)."""
        found = [(re.fullmatch(r"video_(\d+)\.gif", path.name), path) for path in sorted((self.folder / "videos").glob("*"))]
        return [(int(match[1]), path) for match, path in found if match]


def say(text: str) -> None:
    print(f"comrad export: {text}", file=sys.stderr)


def read_runs(folders: list[pathlib.Path]) -> list[ReportedRun]:
    """Those that have reports; the others are named. Runs of one name get that of their folder's folder before it."""
    names = [folder.name for folder in folders]
    runs = []
    for folder in folders:
        name = folder.name if names.count(folder.name) == 1 else f"{folder.parent.name}/{folder.name}"
        try:
            settings = read_settings(folder)
            rows, damaged = read_reports(folder / "metrics.jsonl")
        except (OSError, ValueError) as error:
            say(f"{name}: {one_line(str(error))}; left out")
            continue
        if damaged:
            shown = ", ".join(map(str, damaged[:10])) + (", ..." if len(damaged) > 10 else "")
            lines = "lines" if len(damaged) > 1 else "line"
            say(f"{name}: metrics.jsonl: {len(damaged)} damaged {lines} skipped ({lines} {shown})")
        if rows:
            runs.append(ReportedRun(name, settings, rows, folder))
        else:
            say(f"{name}: it has written no report yet; left out")
    return runs


def numbers_of(report: dict) -> dict[str, int | float]:
    """The finite numbers of a report; whole ones stay whole."""
    return {name: value for name, value in report.items() if math.isfinite(number(value))}


def write_csv(runs: list[ReportedRun], path: pathlib.Path) -> None:
    found = dict.fromkeys(name for run in runs for _, _, report in run.rows for name in report)
    names = [*FIRST_NAMES, *sorted(name for name in found if name not in FIRST_NAMES)]
    part = path.with_name(path.name + ".part")
    with open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["run", "scenario", "algo", "seed", *names])
        for run in runs:
            about = [run.name, run.scenario, run.settings["algo"], run.settings["seed"]]
            for _, _, report in run.rows:
                values = numbers_of(report)
                table.writerow(about + [values.get(name, "") for name in names])
    os.replace(part, path)
    print(path)


def write_wandb(runs: list[ReportedRun], folder: pathlib.Path, project: str) -> None:
    """One offline run each: the settings as its config, reports and videos as its history over env frames."""
    os.environ.update(
        WANDB_MODE="offline",  # nothing is sent, no login is needed
        WANDB_DIR=str(folder),
        WANDB_SILENT="true",
        WANDB_CONSOLE="off",
        WANDB_DISABLE_GIT="true",
        WANDB_DISABLE_CODE="true",
        WANDB_X_DISABLE_STATS="true",
    )
    import wandb

    folder.mkdir(parents=True, exist_ok=True)
    for run in runs:
        settings = {name: value for name, value in run.settings.items() if not isinstance(value, dict)}
        algo, seed = settings["algo"], settings["seed"]
        made = wandb.init(
            mode="offline",
            dir=str(folder),
            project=project,
            name=run.name,
            group=run.scenario,
            job_type=algo,
            tags=[run.scenario, algo, f"seed {seed}"],
            config=settings,
        )
        made.define_metric("env_frames")
        made.define_metric("*", step_metric="env_frames")
        for _, _, report in run.rows:
            made.log(numbers_of(report))
        for frames, video in run.videos:
            made.log({"env_frames": frames, "eval/video": wandb.Video(str(video))})
        made_in = made.dir  # <offline run>/files
        made.finish()
        print(pathlib.Path(made_in).parent)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    to = parser.add_mutually_exclusive_group(required=True)
    to.add_argument("--csv", type=pathlib.Path, metavar="FILE")
    to.add_argument("--wandb", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("--project", default="comrad")
    parser.add_argument("runs", nargs="+", type=pathlib.Path, metavar="RUN_DIR")
    arguments = parser.parse_args()
    runs = read_runs(arguments.runs)
    if not runs:
        say("error: nothing to export")
        return 2
    try:
        if arguments.csv:
            write_csv(runs, arguments.csv)
        else:
            write_wandb(runs, arguments.wandb, arguments.project)
    except OSError as error:
        say(f"error: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
