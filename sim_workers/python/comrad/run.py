"""A training run's folder, read."""

import json
import os
import pathlib
import re
import tomllib
from typing import Any

import numpy as np

from .report_lines import read_reports

NAMES = re.compile(r"(?P<kind>checkpoint|milestone)_(?P<version>\d+)_(?P<env_frames>\d+)\.pt|best_(?P<score>-?[\d.]+)\.pt")


class Run:
    """What `comrad train` keeps in `<train_dir>/<experiment>`; nothing is written. Raises FileNotFoundError where that is no run."""

    def __init__(self, folder: str | os.PathLike) -> None:
        self.folder = pathlib.Path(folder)
        if not (self.folder / "config.toml").is_file():
            raise FileNotFoundError(f"{self.folder}: no run, there is no config.toml")

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting, merged, by its flag's name."""
        return tomllib.loads((self.folder / "config.toml").read_text(encoding="utf-8"))

    @property
    def status(self) -> dict[str, Any]:
        """The state of the run in the last report: state, frames, rates, J. Empty before its first."""
        file = self.folder / "status.json"
        return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}

    def reports(self) -> list[dict[str, Any]]:
        """The lines of metrics.jsonl, rising in env frames (learner/METRICS.md explains them). Where a learner went
        back to a checkpoint, what it forgot is left out; damaged lines are too; evaluations stand where they belong."""
        file = self.folder / "metrics.jsonl"
        return [report for _, _, report in read_reports(file)[0]] if file.is_file() else []

    def metrics(self) -> dict[str, np.ndarray]:
        """The same as columns f64 [reports], NaN where a report lacks the name: pandas.DataFrame(run.metrics())."""
        reports = self.reports()
        names = dict.fromkeys(name for report in reports for name, value in report.items() if isinstance(value, (int, float)))
        return {name: np.array([_number(report.get(name)) for report in reports], np.float64) for name in names}

    def checkpoints(self) -> list[pathlib.Path]:
        """The periodic ones and milestones by rising env frames; load_policy(run.checkpoints()[-1])."""
        found = [(int(match["env_frames"]), file) for file in self._files() if (match := NAMES.fullmatch(file.name)) and match["kind"]]
        return [file for _, file in sorted(found)]

    def best_checkpoint(self) -> pathlib.Path | None:
        """The one with the best score while it trained; None where none was kept."""
        found = [(float(match["score"]), file) for file in self._files() if (match := NAMES.fullmatch(file.name)) and match["score"]]
        return max(found)[1] if found else None

    def _files(self) -> list[pathlib.Path]:
        folder = self.folder / "checkpoint"
        return list(folder.iterdir()) if folder.is_dir() else []

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else float("nan")
