"""What the searches of sweeps have tried (deploy/sweep/search_space.h): runs by score with the settings that were searched, and of
populations which member copied which.

As with runs, nothing that is read is trusted: what cannot be used is left out and named.
"""

import dataclasses
import math
import pathlib

import matplotlib.pyplot as plt

from figures import legend_below
from run_files import number, one_line
from sweep_files import PATTERNS, object_or_empty, read_record
from tables import Table, millions, rounded

PANELS_MAX = 6  # of a lineage figure


@dataclasses.dataclass
class Generation:
    """A stretch of a member's training. `parent`: whose checkpoint it began with; empty: its own."""

    settings: dict[str, str]
    parent: str
    env_frames: float
    score: float


@dataclasses.dataclass
class Searched:
    """A trial or a member; its generations are those that are over."""

    name: str
    state: str
    env_frames: float
    score: float
    settings: dict[str, str]
    generations: list[Generation] = dataclasses.field(default_factory=list)


@dataclasses.dataclass
class Search:
    """One study of a sweep, its runs in their order."""

    title: str
    method: str
    space: list[str]
    runs: list[Searched]

    @property
    def best(self) -> list[Searched]:
        """By score, the highest first; those without one last."""
        return sorted(self.runs, key=lambda run: -run.score if math.isfinite(run.score) else math.inf)

    @property
    def has_lineage(self) -> bool:
        return any(run.generations for run in self.runs)


def texts_in(value) -> dict[str, str]:
    return {key: one_line(text, 80) for key, text in value.items() if isinstance(text, str)} if isinstance(value, dict) else {}


def read_generations(path: pathlib.Path) -> list[Generation]:
    found = object_or_empty(path).get("generations")
    generations = []
    for one in found if isinstance(found, list) else []:
        frames = number(one.get("env_frames")) if isinstance(one, dict) else math.nan
        if not frames > 0:
            break  # under way
        parent = one.get("parent") if isinstance(one.get("parent"), str) else ""
        generations.append(Generation(texts_in(one.get("settings")), parent, frames, number(one.get("score"))))
    return generations


def read_run(sweep: pathlib.Path, name: str) -> Searched:
    record, status = read_record(sweep, name), object_or_empty(sweep / name / "status.json")
    state = one_line(str(record.get("state", "waiting")), 20)
    if number(record.get("pruned_at_env_frames")) > 0:
        state += ", pruned"
    score, frames = number(status.get("J_mean")), number(status.get("env_frames"))
    generations = read_generations(sweep / "search" / f"{name}.json")
    return Searched(name, state, frames, score, texts_in(record.get("searched")), generations)


def read_searches(folder: pathlib.Path) -> list[Search]:
    """The searches of the sweep in `folder`, or of those one folder below."""
    searches = []
    for path in sorted({path for pattern in PATTERNS for path in folder.glob(pattern)}):
        plan = object_or_empty(path)
        search, runs = plan.get("search"), plan.get("runs")
        if not isinstance(search, dict) or not isinstance(search.get("space"), list) or not isinstance(runs, list):
            continue
        space = [one["setting"] for one in search["space"] if isinstance(one, dict) and isinstance(one.get("setting"), str)]
        studies: dict[str, list[Searched]] = {}
        for run in runs:
            name, study = (run.get("name"), run.get("study")) if isinstance(run, dict) else (None, None)
            if isinstance(name, str) and isinstance(study, str) and "/" not in name:
                studies.setdefault(study, []).append(read_run(path.parent, name))
        searches += [Search(study, one_line(str(search.get("method")), 20), space, of) for study, of in studies.items()]
    return searches


def short(text: str) -> str:
    """A setting's value with four digits where it is a number."""
    try:
        return rounded(float(text))
    except ValueError:
        return text


def run_table(search: Search) -> Table:
    rows = [
        [run.name, *(short(run.settings.get(name, "-")) for name in search.space), millions(run.env_frames), rounded(run.score), run.state]
        for run in search.best
    ]
    return Table(["run", *search.space, "env frames", "J", "state"], rows, note="J: mean of the last training episodes.")


def lineage_table(search: Search) -> Table:
    """A row for each copy, in the order of env frames."""
    runs = {run.name: run for run in search.runs}
    copies = []
    for run in search.runs:
        for at, generation in enumerate(run.generations[1:], 1):
            parent = runs.get(generation.parent)
            if parent is None or len(parent.generations) < at:
                continue
            own, better = run.generations[at - 1], parent.generations[at - 1]
            changes = ", ".join(
                f"{name} {short(better.settings.get(name, '-'))} to {short(generation.settings.get(name, '-'))}"
                for name in search.space
                if better.settings.get(name) != generation.settings.get(name)
            )
            copies.append((own.env_frames, [run.name, generation.parent, rounded(own.score), rounded(better.score), changes]))
    copies.sort(key=lambda copy: copy[0])
    rows = [[millions(frames), *cells] for frames, cells in copies]
    return Table(["env frames", "member", "copied", "its J", "the copied one's", "settings of the copied one, changed"], rows)


def lineage_figure(search: Search):
    """J and the numbers that were searched over env frames: a colour for each member, a dotted line from the member that it copied."""
    if not search.has_lineage:
        return None

    def value(generation: Generation, name: str) -> float:
        try:
            return generation.score if name == "J" else float(generation.settings[name])
        except (KeyError, ValueError):
            return math.nan

    finished = [one for run in search.runs for one in run.generations]
    numbers = [name for name in search.space if any(math.isfinite(value(one, name)) for one in finished)]
    names = ["J", *numbers][:PANELS_MAX]
    figure, panels = plt.subplots(len(names), 1, figsize=(8.4, 0.6 + 1.5 * len(names)), sharex=True, layout="constrained", squeeze=False)
    runs = {run.name: run for run in search.runs}
    for place, run in enumerate(search.runs):
        color = plt.cm.tab10(place % 10)
        panels[0, 0].plot([], [], color=color, label=run.name)
        for at, generation in enumerate(run.generations):
            origin = runs.get(generation.parent) if generation.parent else run
            before = origin.generations[at - 1] if at > 0 and origin and len(origin.generations) >= at else None
            begin = before.env_frames if before else 0.0
            for axes, name in zip(panels[:, 0], names):
                now, then = value(generation, name), value(before, name) if before else math.nan
                style = ":" if generation.parent else "-"
                if name == "J":
                    axes.plot([begin / 1e6, generation.env_frames / 1e6], [then, now], style, color=color, linewidth=1.2)
                    axes.plot([generation.env_frames / 1e6], [now], "o", color=color, markersize=3)
                else:
                    axes.plot([begin / 1e6, generation.env_frames / 1e6], [now, now], "-", color=color, linewidth=1.2)
                    if generation.parent:
                        axes.plot([begin / 1e6] * 2, [then, now], ":", color=color, linewidth=1)
    for axes, name in zip(panels[:, 0], names):
        axes.set_ylabel(name)
        values = [value(one, name) for one in finished]
        if name != "J" and min(values) > 0 and max(values) > 20 * min(values):
            axes.set_yscale("log")
    panels[-1, 0].set_xlabel("env frames (millions)")
    legend_below(figure, panels)
    return figure
