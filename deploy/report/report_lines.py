"""Reads what a run writes while it trains, config.toml and metrics.jsonl, with Python's own modules alone.

Nothing that is read here is trusted; see run_files.py.
"""

import json
import math
import pathlib
import re
import tomllib

# Larger files are no output of ours: a report every second for a year stays below.
FILE_BYTES_MAX = 1 << 30
LINE_BYTES_MAX = 1 << 22


def one_line(text: str, longest: int = 300) -> str:
    """`text` without control characters and line breaks, and not longer than that."""
    text = " ".join(re.sub(r"[\x00-\x1f\x7f-\x9f]", " ", text).split())
    return text if len(text) <= longest else text[: longest - 3] + "..."


def number(value) -> float:
    """A JSON or TOML number as a float; NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def read_text(path: pathlib.Path) -> str:
    """Raises OSError and ValueError, which states what is wrong with the file."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no {path.name}")
    if path.stat().st_size > FILE_BYTES_MAX:
        raise ValueError(f"{path.name} has more than {FILE_BYTES_MAX >> 20} MB")
    return path.read_text(encoding="utf-8", errors="replace")


def parse_json(text: str):
    """Raises ValueError alone, also where the text nests too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it nests too deeply") from None


def read_object(path: pathlib.Path) -> dict:
    """Raises OSError, and ValueError with a sentence."""
    found = parse_json(read_text(path))
    if not isinstance(found, dict):
        raise ValueError(f"{path.name} holds no object")
    return found


def read_reports(path: pathlib.Path) -> tuple[list[tuple[float, float, dict]], list[int]]:
    """The reports of a metrics.jsonl as (env_frames, time_s, report), rising in env frames, and the numbers of its damaged lines.

    Where env frames fall, the learner went back to a checkpoint: what it then forgot is left out. Evaluations (eval/...) come
    later than the reports of the same env frames and are put in their place. Raises OSError and ValueError where there is no
    such file."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no {path.name}")
    if path.stat().st_size > FILE_BYTES_MAX:
        raise ValueError(f"{path.name} has more than {FILE_BYTES_MAX >> 20} MB")
    reports, evaluations, damaged = [], {}, []
    line_number = 0
    with open(path, "rb") as lines:
        while line := lines.readline(LINE_BYTES_MAX):
            line_number += 1
            if not line.strip():
                continue
            try:
                report = parse_json(line.decode("utf-8"))
            except ValueError:
                damaged.append(line_number)
                continue
            frames = number(report.get("env_frames")) if isinstance(report, dict) else math.nan
            time_s = number(report.get("time_s")) if isinstance(report, dict) else math.nan
            if not (0 <= frames < 1e18 and 0 <= time_s < 1e12):
                damaged.append(line_number)
            elif any(name.startswith("eval/") for name in report):
                evaluations[frames] = (frames, time_s, report)
            else:
                while reports and reports[-1][0] >= frames:
                    reports.pop()
                reports.append((frames, time_s, report))
    return sorted(reports + list(evaluations.values()), key=lambda row: row[0]), damaged


def read_settings(folder: pathlib.Path) -> dict:
    """The config.toml of a run. Raises ValueError with a sentence for a folder that cannot be used as a run."""
    try:
        settings = tomllib.loads(read_text(folder / "config.toml"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"config.toml: {one_line(str(error))}") from None
    for name, kind in (("scenario", str), ("algo", str), ("seed", int)):
        if type(settings.get(name)) is not kind or settings[name] == "":
            raise ValueError(f"config.toml: {name} is missing or no {'text' if kind is str else 'whole number'}")
    return settings
