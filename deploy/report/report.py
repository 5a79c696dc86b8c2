#!/usr/bin/env python3
"""Reports on a folder of runs: one HTML page, and the tables as Markdown, LaTeX and CSV.

    comrad report DIR [--output FOLDER]
    comrad report DIR --results_page FILE.md --scenario_pages FOLDER

DIR holds run folders (train_dir/<experiment>) and, in eval/ beside or inside of them, answers of `comrad eval --json`; those of
--policy random and oracle there give the scale of normalised scores for their maps. Runs that cannot be used are named.
"""

import argparse
import datetime
import pathlib
import sys


def say(text: str) -> None:
    print(f"comrad report: {text}", file=sys.stderr)


def positive(text: str) -> float:
    """A number of env frames, for argparse."""
    value = float(text)
    if not 0 < value < 1e18:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1e18")
    return value


def parse(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="comrad report",
        description=__doc__,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", metavar="DIR", type=pathlib.Path)
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", type=pathlib.Path, help="where the report goes (default DIR/report)"
    )
    parser.add_argument(
        "--at",
        metavar="FRAMES",
        type=positive,
        help="read scores at so many env frames, and compare runs whatever their budgets (default: each at its end)",
    )
    parser.add_argument(
        "--bootstrap", action="store_true", help="intervals over seeds by bootstrap instead of Student t"
    )
    parser.add_argument(
        "--ignore",
        metavar="SETTING,...",
        default="",
        help="settings in which runs that are counted together may differ, for example batch_size,rollout",
    )
    parser.add_argument(
        "--results_page",
        metavar="FILE.md",
        type=pathlib.Path,
        help="write this one page about a folder of kept results (deploy/SWEEPS.md) instead: what beats random play",
    )
    parser.add_argument(
        "--scenario_pages",
        metavar="FOLDER",
        type=pathlib.Path,
        help="put the kept runs of each scenario and their curves into FOLDER/<scenario>/README.md",
    )
    parser.add_argument("--title", default="", help="above the page (default: the folder's name)")
    return parser.parse_args(words)


def write_results(study, folder: pathlib.Path, page: pathlib.Path | None, pages: pathlib.Path | None) -> int:
    from results_page import read_kept_rows, results_page, scenario_pages

    if not any(folder.glob("*/curve.csv")):
        say(f"error: {folder} holds no kept result (RUN/curve.csv); a sweep with [results] leaves them")
        return 2
    kept, written = read_kept_rows(study, folder), []
    try:
        if page:
            written += results_page(study, kept, folder, page, f"./comrad report {folder} --results_page {page}")
        if pages:
            written += scenario_pages(study, kept, pages, f"./comrad report {folder} --scenario_pages {pages}")
    except OSError as error:
        say(f"error: cannot write {error.filename or page or pages}: {error.strerror or error}")
        return 1
    except ValueError as error:
        say(f"error: {error}")
        return 2
    for path in written:
        print(path)
    return 0


def main(words: list[str]) -> int:
    arguments = parse(words)
    try:
        from compose import write_report
        from analysis import Options, read_study, reference_file
        from run_files import NO_RUN
    except ImportError as error:
        say(
            f"error: {error}; install python3-numpy, python3-scipy and python3-matplotlib (./comrad report does on Debian)"
        )
        return 1
    if not arguments.folder.is_dir():
        say(f"error: there is no folder {arguments.folder}; name one that holds runs, for example train_dir")
        return 2
    options = Options(
        at=arguments.at,
        bootstrap=arguments.bootstrap,
        ignore=frozenset(name for name in arguments.ignore.split(",") if name),
    )
    study = read_study(arguments.folder, options, reference_file())
    if not study.runs:
        for name, why in study.left_out:
            say(f"{name}: {why}")
        say(f"error: {arguments.folder.resolve()} {NO_RUN}")
        return 2
    if arguments.results_page or arguments.scenario_pages:
        return write_results(study, arguments.folder, arguments.results_page, arguments.scenario_pages)
    output = arguments.output or arguments.folder / "report"
    try:
        output.mkdir(parents=True, exist_ok=True)
        title = arguments.title or f"COMRAD: {arguments.folder.resolve().name}"
        written = write_report(study, output, title, datetime.datetime.now())
    except OSError as error:
        say(f"error: cannot write {output}: {error.strerror or error}")
        return 1
    for name, why in study.left_out + study.problems:
        say(f"{name}: {why}")
    for path in written:
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
