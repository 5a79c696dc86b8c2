"""The runs that a sweep planned, from its sweep.json and records/ (deploy/sweep/sweep_folder.h).

A sweep's folder lists every run with its settings, and each run has a record of how its last attempt ended. A run that failed
before it made its folder, or was never started, is in no other place.
"""

import pathlib
import tomllib

from run_files import Metrics, Run, one_line, read_object, read_run

PATTERNS = ("sweep.json", "*/sweep.json")  # of a sweep's folder, and of a folder with sweeps


def typed(text: str):
    """The value of a setting that sweep.json holds as text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def object_or_empty(path: pathlib.Path) -> dict:
    """Empty where there is no such file, or where it cannot be read."""
    try:
        return read_object(path)
    except (OSError, ValueError):
        return {}


def read_record(sweep: pathlib.Path, name: str) -> dict:
    """How the last attempt of a run went; empty where there was none, or where the record cannot be read."""
    return object_or_empty(sweep / "records" / f"{name}.json")


def read_plan(path: pathlib.Path) -> list[tuple[str, dict]]:
    """Name and settings of each planned run. Raises OSError, and ValueError with a sentence."""
    planned = []
    runs = read_object(path).get("runs")
    for one in runs if isinstance(runs, list) else [None]:
        name, settings = (one.get("name"), one.get("settings")) if isinstance(one, dict) else (None, None)
        if not isinstance(name, str) or "/" in name or not isinstance(settings, dict):
            raise ValueError("a run has no name or no settings")
        settings = {key: typed(value) for key, value in settings.items() if isinstance(value, str)}
        if not (isinstance(settings.get("scenario"), str) and isinstance(settings.get("algo"), str)):
            raise ValueError(f"{name} has no scenario or no algo")
        if type(settings.setdefault("seed", 42)) is not int:
            raise ValueError(f"{name}: seed is no whole number")
        planned.append((name, settings))
    return planned


def kept_run(path: pathlib.Path, name: str) -> Run | None:
    """The run's kept result, where the sweep keeps results and has this one."""
    results = read_object(path).get("results")
    folder = results.get("folder") if isinstance(results, dict) else None
    try:
        return read_run(pathlib.Path(folder) / name) if isinstance(folder, str) and folder else None
    except ValueError:
        return None


def note_ending(run: Run, record: dict) -> None:
    """An attempt that ended badly after the run wrote its status, or without one."""
    if record.get("state") in ("failed", "interrupted") and run.state != "finished":
        message = record.get("error") or run.status.get("message")
        run.status |= {"state": record["state"], "message": message}


def absent_run(sweep: pathlib.Path, name: str, settings: dict, record: dict, runs: list[Run]) -> Run:
    """A planned run without a folder. Settings that the plan leaves to the scenario and the recipe are those of another run of
    the same scenario and algorithm."""
    alike = [run.settings for run in runs if all(run.settings[key] == settings[key] for key in ("scenario", "algo"))]
    run = Run(sweep / name, alike[0] | settings if alike else settings, Metrics())
    why = f"its record states {record.get('state')}, but it has no folder" if record else "it was never started"
    run.status = {"state": "missing", "message": why}
    note_ending(run, record)
    return run


def add_planned_runs(folder: pathlib.Path, runs: list[Run]) -> list[tuple[str, str]]:
    """Adds to `runs` what sweeps in `folder` planned beside them, and how attempts ended to those that are there.

    Returns the plans that cannot be read, with the reason."""
    left_out = []
    for path in sorted({path for pattern in PATTERNS for path in folder.glob(pattern)}):
        try:
            planned = read_plan(path)
        except (OSError, ValueError) as error:
            left_out.append(
                (str(path.relative_to(folder)), f"{one_line(str(error))}; runs that it planned may be missing here")
            )
            continue
        made = {run.folder: run for run in runs}
        for name, settings in planned:
            record = read_record(path.parent, name)
            run = made.get(path.parent / name) or kept_run(path, name)
            if run is None:
                run = absent_run(path.parent, name, settings, record, list(made.values()))
            else:
                note_ending(run, record)
            if run.folder not in made:
                runs.append(run)
    return left_out
