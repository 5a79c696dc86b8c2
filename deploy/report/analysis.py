"""What a folder of runs contains: which runs belong together, their scores, references, thresholds and aggregates.

A cell is one scenario played by one algorithm with one set of the settings that change what is learned; its runs differ in
their seed, and in what their machines decided. What cannot be part of a cell is named in `Study.left_out`, never mixed in.
"""

import collections
import dataclasses
import functools
import math
import os
import pathlib
import tomllib

import numpy as np

from intervals import LEVEL, bootstrap_interval, student_interval
from run_files import (
    NOT_LEARNED,
    OFF_POLICY,
    ON_POLICY,
    SCORE,
    Evaluation,
    Occupancy,
    Run,
    find_evaluations,
    find_occupancies,
    find_runs,
    number,
    one_line,
)
from curves import value_at
from scipy import stats
from sweep_files import add_planned_runs
from tables import millions

# Shares of the way from random play to the scripted team at which sample efficiency is read.
THRESHOLDS = (0.25, 0.5, 0.75)
# A run within so much of its budget has reached it: reports come every few seconds.
REACHED = 0.99
BUDGETS = frozenset({"train_for_env_frames", "train_for_env_steps"})  # the setting and its older name
SETTINGS_NAMED_MAX = 3
OCCUPANCIES_MAX = 24
ENDED_BADLY = ("failed", "interrupted", "missing")


@dataclasses.dataclass
class Options:
    """What the command line chose.

    at          env frames at which scores are read; None: the end of each run
    bootstrap   intervals over seeds by percentile bootstrap instead of Student t
    ignore      settings in which runs of one cell may differ"""

    at: float | None = None
    bootstrap: bool = False
    ignore: frozenset[str] = frozenset()


@dataclasses.dataclass
class Reference:
    """Scores between which a scenario's are normalised, and where they were measured."""

    random: float
    scripted: float
    source: str

    def normalised(self, score):
        return (score - self.random) / (self.scripted - self.random)


@dataclasses.dataclass
class Cell:
    """Runs of one scenario, algorithm and set of settings.

    runs         all of them, also those that are not done
    complete     those that count in means, one a seed
    scores       [n] f64, training score of `complete`
    evaluations  of `complete`, all by one protocol, or empty"""

    scenario: str
    algo: str
    label: str
    runs: list[Run]
    complete: list[Run]
    scores: np.ndarray
    evaluations: list[Evaluation] = dataclasses.field(default_factory=list)

    @property
    def drawn(self) -> list[Run]:
        """The runs that a mean over time is made of: those that are done, else all."""
        return self.complete or self.runs

    @property
    def absence(self) -> str:
        """What tables show in place of a score where no run counts: "no score: 2 failed"; empty where one does."""
        return "" if self.complete else f"no score: {states_text(self.runs)}"

    def evaluated(self) -> np.ndarray:
        return np.array([evaluation.mean for evaluation in self.evaluations])


@dataclasses.dataclass
class Study:
    folder: pathlib.Path
    options: Options
    runs: list[Run]
    cells: list[Cell]
    references: dict[str, Reference]
    baselines: list[Evaluation]
    occupancies: list[tuple[str, Occupancy]]
    left_out: list[tuple[str, str]]
    problems: list[tuple[str, str]]

    @property
    def failed(self) -> list[Run]:
        """Runs that failed, were interrupted or were never made."""
        return [run for run in self.runs if run.state in ENDED_BADLY]

    @property
    def scenarios(self) -> list[str]:
        return list(dict.fromkeys(cell.scenario for cell in self.cells))

    @property
    def labels(self) -> list[str]:
        return list(dict.fromkeys(cell.label for cell in self.cells))

    def cells_of(self, scenario: str) -> list[Cell]:
        return [cell for cell in self.cells if cell.scenario == scenario]

    def interval(self, values: np.ndarray) -> tuple[float, float]:
        return bootstrap_interval(values) if self.options.bootstrap else student_interval(values)


def states_text(runs: list[Run]) -> str:
    """ "4 finished, 2 failed, 1 missing"."""
    counts = collections.Counter(run.state for run in runs)
    return ", ".join(f"{counts[state]} {state}" for state in sorted(counts, key=lambda state: (state != "finished", state)))


def algorithm_order(algo: str) -> tuple[int, str]:
    known = ON_POLICY + OFF_POLICY
    return (known.index(algo) if algo in known else len(known), algo)


def setting_text(value) -> str:
    """A value as labels show it; what a sweep writes as text is the same as the number in config.toml."""
    if isinstance(value, bool):
        return "on" if value else "off"
    try:
        return f"{float(value):.10g}"
    except (TypeError, ValueError, OverflowError):
        return one_line(str(value), 24) or "none"


def experiments_of(runs: list[Run], options: Options) -> dict[str, dict[str, str]]:
    """What each run learns from, by its folder: all settings that must be the same within a cell.

    Precision is one of them where runs were started with different ones, not where only machines chose differently."""
    free = NOT_LEARNED | options.ignore | (BUDGETS | {"train_for_seconds"} if options.at else set())
    if len({run.explicit_precision for run in runs} - {""}) < 2:
        free |= {"precision"}
    return {
        str(run.folder): {
            name: setting_text(value)
            for name, value in run.settings.items()
            if name not in free and not isinstance(value, dict)
        }
        for run in runs
    }


def few_names(names: set[str], pairs: list[list[dict[str, str]]]) -> list[str]:
    """Of the settings that differ all where they are few, else those that are needed to tell the members of each pair apart."""
    in_order = sorted(names, key=lambda name: (name != "preset", name))
    if len(names) <= SETTINGS_NAMED_MAX:
        return in_order
    parts = lambda chosen: sum(len({tuple(one.get(name) for name in chosen) for one in pair}) for pair in pairs)
    needed: list[str] = []
    for name in in_order:
        if parts([*needed, name]) > parts(needed):
            needed.append(name)
    return needed[:SETTINGS_NAMED_MAX]


def setting_words(name: str, text: str | None) -> str:
    """ "gamma 0.9", "2 M env frames"; a setting that a kept result leaves out has the built-in value."""
    words = f"{name.replace('_', ' ')} {text or 'built-in'}"
    try:
        return f"{millions(float(text))} env frames" if name in BUDGETS and text else words
    except ValueError:
        return words


def labels_of(runs: list[Run], options: Options) -> dict[str, str]:
    """The label of each run, by its folder: its algorithm, and the settings that differ within a scenario."""
    experiments = experiments_of(runs, options)
    by_pair: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        by_pair.setdefault((run.scenario, run.algo), []).append(run)
    named, unnamed = {}, {}
    for algo in {run.algo for run in runs}:
        pairs = [[experiments[str(run.folder)] for run in members] for (_, of), members in by_pair.items() if of == algo]
        differing = {
            name for pair in pairs for name in set().union(*pair) if len({one.get(name) for one in pair}) > 1
        }
        named[algo] = few_names(differing, pairs)
        unnamed[algo] = len(differing) - len(named[algo])
    labels = {}
    for members in by_pair.values():
        taken: dict[str, dict] = {}
        for run in members:
            own = experiments[str(run.folder)]
            words = [run.algo] + [setting_words(name, own.get(name)) for name in named[run.algo]]
            more = f" and {unnamed[run.algo]} more settings" if unnamed[run.algo] else ""
            label = ", ".join(words) + more
            chosen, again = label, 1
            while taken.setdefault(chosen, own) != own:  # differ in what is not named
                again += 1
                chosen = f"{label} ({again})"
            labels[str(run.folder)] = chosen
    return labels


def why_incomplete(run: Run, options: Options) -> str:
    """Why the run does not count in means; empty where it does."""
    frames, scores = run.metrics.series(SCORE)
    if not len(scores) and run.state in ENDED_BADLY:
        return f"{run.state}: {run.last_error()}"
    if not len(scores):
        return "no episode has ended" if len(run.metrics) else "it has written no report"
    budget = options.at or next((number(run.settings[name]) for name in BUDGETS if name in run.settings), math.nan)
    if math.isfinite(budget) and run.env_frames >= REACHED * budget:
        return ""
    if options.at is None and run.state == "finished":
        return ""
    return f"{run.state} at {run.env_frames:.3g} of {budget:.3g} env frames"


def score_of(run: Run, options: Options) -> float:
    """Training score J: the mean of the last `stats_avg` episodes, in the last report or in the one at `options.at`."""
    frames, scores = run.metrics.series(SCORE)
    return float(value_at(frames, scores, np.array([options.at if options.at else frames[-1]]))[0])


def one_per_seed(runs: list[Run], left_out: list[tuple[str, str]]) -> list[Run]:
    """Runs of one seed are no independent sample: the one with the most frames stays."""
    best: dict[int, Run] = {}
    for run in sorted(runs, key=lambda run: (-run.env_frames, run.name)):
        if run.seed in best:
            left_out.append((run.name, f"same settings and seed {run.seed} as {best[run.seed].name}"))
        best.setdefault(run.seed, run)
    return sorted(best.values(), key=lambda run: run.seed)


def choose_evaluations(cells: list[Cell], evaluations: list[Evaluation], left_out: list[tuple[str, str]]) -> None:
    """Gives each cell the evaluations of its runs, where every complete run has one by the same protocol.

    A scenario has one protocol: the one that most of its runs have."""
    by_run: dict[tuple[str, str], list[Evaluation]] = {}
    for evaluation in evaluations:
        by_run.setdefault((evaluation.scenario, evaluation.policy), []).append(evaluation)
    known = {(cell.scenario, run.name) for cell in cells for run in cell.runs}
    for key in by_run.keys() - known:
        for evaluation in by_run[key]:
            if evaluation.policy not in ("random", "oracle"):
                left_out.append(
                    (
                        evaluation.file.name,
                        f"it evaluates {evaluation.policy} on {evaluation.scenario}, and there is no such run here",
                    )
                )
    for scenario in dict.fromkeys(cell.scenario for cell in cells):
        members = [cell for cell in cells if cell.scenario == scenario]
        votes: dict[str, int] = {}
        for cell in members:
            for run in cell.complete:
                for protocol in {one.protocol() for one in by_run.get((scenario, run.name), [])}:
                    votes[protocol] = votes.get(protocol, 0) + 1
        if not votes:
            continue
        protocol = max(votes, key=lambda name: (votes[name], name))
        for cell in members:
            chosen = [
                [one for one in by_run.get((scenario, run.name), []) if one.protocol() == protocol]
                for run in cell.complete
            ]
            for run in cell.complete:
                for one in by_run.get((scenario, run.name), []):
                    if one.protocol() != protocol:
                        left_out.append((one.file.name, f"{one.protocol()}; the table shows {protocol}"))
            if chosen and all(chosen):
                cell.evaluations = [ones[-1] for ones in chosen]
            elif any(chosen):
                missing = [run.name for run, ones in zip(cell.complete, chosen) if not ones]
                left_out.append(
                    (f"{cell.scenario}, {cell.label}: evaluations", f"{', '.join(missing)} has none ({protocol})")
                )


def reference_file() -> pathlib.Path:
    """Where the repository, or what was installed of it, has scores of random play and of scripted teams."""
    home = os.environ.get("COMRAD_HOME") or pathlib.Path(__file__).resolve().parents[2]
    return pathlib.Path(home) / "scenarios" / "reference_scores.toml"


def measured_references(path: pathlib.Path) -> dict[str, dict]:
    """scenarios/reference_scores.toml; empty where it cannot be read."""
    try:
        return {
            name: entry
            for name, entry in tomllib.loads(path.read_text(encoding="utf-8")).items()
            if isinstance(entry, dict)
        }
    except (OSError, ValueError):
        return {}


def plays_default_map(run: Run) -> bool:
    """Also a run whose kept evaluation did, while it trained on the scenario's stages."""
    wad = pathlib.PurePath(str(run.settings.get("wad", ""))).name
    pool = run.settings.get("layout_pool", "")
    return (
        (pool == "" or (pool == "curriculum" and run.result.get("layout") == "seed 42"))
        and run.settings.get("layout_seed", 42) == 42
        and wad in ("", f"{run.scenario}_42.wad")
    )


def references_of(
    runs: list[Run], baselines: list[Evaluation], measured: dict[str, dict], left_out: list[tuple[str, str]]
) -> dict[str, Reference]:
    """A reference for each scenario that has one: evaluations beside the runs come before the repository's numbers."""
    found = {}
    for scenario in dict.fromkeys(run.scenario for run in runs):
        members = [run for run in runs if run.scenario == scenario]
        sizes = {number(run.settings.get("num_agents", 2)) for run in members}
        if len(sizes) > 1:
            left_out.append((f"{scenario}: normalised scores", "its runs have teams of different sizes"))
            continue
        size = sizes.pop()
        random = [
            one for one in baselines if one.scenario == scenario and one.policy == "random" and one.num_agents == size
        ]
        oracle = [
            one for one in baselines if one.scenario == scenario and one.policy == "oracle" and one.num_agents == size
        ]
        pairs = [(a, b) for a in random for b in oracle if a.layout == b.layout]
        entry = measured.get(scenario, {})
        if pairs:
            a, b = pairs[-1]
            candidate = Reference(
                a.mean, b.mean, f"{a.file.name} and {b.file.name}: {a.episodes} and {b.episodes} episodes on {a.layout}"
            )
        elif not all(map(plays_default_map, members)):
            left_out.append(
                (
                    f"{scenario}: normalised scores",
                    "runs do not play the default map; put evaluations of random "
                    "play and of the scripted team on their maps into eval/",
                )
            )
            continue
        elif number(entry.get("num_agents")) == size:
            candidate = Reference(
                number(entry.get("random")),
                number(entry.get("scripted")),
                f"scenarios/reference_scores.toml: {entry.get('episodes')} episodes each on the default map",
            )
        else:
            left_out.append(
                (
                    f"{scenario}: normalised scores",
                    f"no reference for {size:.0f} agents; put evaluations of "
                    "random play and of the scripted team into eval/",
                )
            )
            continue
        if not (
            math.isfinite(candidate.random)
            and math.isfinite(candidate.scripted)
            and candidate.scripted > candidate.random
        ):
            left_out.append(
                (f"{scenario}: normalised scores", "the scripted team's reference is not above that of random play")
            )
            continue
        found[scenario] = candidate
    return found


def titled_occupancies(
    cells: list[Cell], occupancies: list[Occupancy], left_out: list[tuple[str, str]]
) -> list[tuple[str, Occupancy]]:
    """The first OCCUPANCIES_MAX of them, each with its players, in the order of the cells; baselines last."""
    known = {
        (cell.scenario, run.name): (at, f"{cell.label}, seed {run.seed}")
        for at, cell in enumerate(cells)
        for run in cell.runs
    }
    known |= {
        (one.scenario, policy): (len(cells), title)
        for one in occupancies
        for policy, title in (("random", "random play"), ("oracle", "scripted team"))
    }
    ordered = sorted(
        ((*known[key], one) for one in occupancies if (key := (one.scenario, one.policy)) in known),
        key=lambda item: (item[2].scenario, item[0], item[1]),
    )
    left_out += [
        (one.file.name, f"there is no run {one.policy} of {one.scenario} here")
        for one in occupancies
        if (one.scenario, one.policy) not in known
    ]
    left_out += [
        (one.file.name, f"the page shows {OCCUPANCIES_MAX} occupancy maps") for _, _, one in ordered[OCCUPANCIES_MAX:]
    ]
    return [(title, one) for _, title, one in ordered[:OCCUPANCIES_MAX]]


def read_study(folder: pathlib.Path, options: Options, reference_file: pathlib.Path) -> Study:
    """Reads everything below `folder`. Never raises for what lies there."""
    runs, left_out = find_runs(folder)
    left_out += add_planned_runs(folder, runs)
    evaluations, unread = find_evaluations(folder)
    left_out += unread
    labels = labels_of(runs, options)
    groups: dict[tuple[str, str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.scenario, run.algo, labels[str(run.folder)]), []).append(run)
    cells = []
    for (scenario, algo, label), members in sorted(
        groups.items(), key=lambda item: (item[0][0], algorithm_order(item[0][1]), item[0][2])
    ):
        complete = []
        for run in members:
            why = why_incomplete(run, options)
            if why:
                left_out.append((run.name, why + "; it counts in no mean"))
            else:
                complete.append(run)
        complete = one_per_seed(complete, left_out)
        cells.append(
            Cell(scenario, algo, label, members, complete, np.array([score_of(run, options) for run in complete]))
        )
    choose_evaluations(cells, evaluations, left_out)
    occupancies, unread = find_occupancies(folder)
    left_out += unread
    baselines = [one for one in evaluations if one.policy in ("random", "oracle")]
    references = references_of(runs, baselines, measured_references(reference_file), left_out)
    return Study(
        folder=folder,
        options=options,
        runs=runs,
        cells=cells,
        references=references,
        baselines=baselines,
        occupancies=titled_occupancies(cells, occupancies, left_out),
        left_out=left_out,
        problems=[(run.name, problem) for run in runs for problem in run.problems],
    )


def episode_interval(evaluations: list[Evaluation]) -> tuple[float, float]:
    """95 % interval of the mean over evaluations when the policies are what they are and only episodes vary.

    The squared standard errors add; degrees of freedom by Welch and Satterthwaite. NaN where one has a single
    episode."""
    errors = np.array(
        [
            one.half_width / stats.t.ppf((1 + LEVEL) / 2, one.episodes - 1) if one.episodes > 1 else np.nan
            for one in evaluations
        ]
    )
    mean = float(np.mean([one.mean for one in evaluations])) if evaluations else np.nan
    variance = float(np.sum(errors**2)) / max(1, len(errors)) ** 2
    if not evaluations or not math.isfinite(variance):
        return np.nan, np.nan
    if variance == 0:
        return mean, mean
    degrees = np.sum(errors**2) ** 2 / np.sum(errors**4 / np.array([one.episodes - 1 for one in evaluations]))
    half = stats.t.ppf((1 + LEVEL) / 2, degrees) * math.sqrt(variance)
    return mean - half, mean + half


def uses_evaluations(study: Study) -> bool:
    """Aggregates stand on evaluations where every cell that has complete runs has them, else on training scores."""
    counted = [cell for cell in study.cells if cell.complete]
    return bool(counted) and all(cell.evaluations for cell in counted)


def normalised_scores(study: Study) -> tuple[list[str], dict[str, list[np.ndarray]], list[str]]:
    """Normalised scores by label, in the order of the scenarios that all compared labels have.

    Returns those scenarios, label -> [scenario] of [n] f64, and the labels that were left out.
    A label that would shrink the common scenarios below half of the most that any label has is left out."""
    use_evaluations = uses_evaluations(study)
    table: dict[str, dict[str, np.ndarray]] = {}
    for cell in study.cells:
        reference = study.references.get(cell.scenario)
        if reference is None or not cell.complete:
            continue
        values = cell.evaluated() if use_evaluations else cell.scores
        table.setdefault(cell.label, {})[cell.scenario] = reference.normalised(values)
    if not table:
        return [], {}, []
    most = max(len(scenarios) for scenarios in table.values())
    kept = {label: scenarios for label, scenarios in table.items() if 2 * len(scenarios) > most}
    common = [name for name in study.scenarios if all(name in scenarios for scenarios in kept.values())]
    if not common:
        return [], {}, list(table)
    return (
        common,
        {label: [scenarios[name] for name in common] for label, scenarios in kept.items()},
        [label for label in table if label not in kept],
    )


def frames_to(run: Run, score: float) -> tuple[float, float]:
    """Env frames and seconds of training at the first report whose J is at least `score`; inf where none is."""
    frames, scores = run.metrics.series(SCORE)
    times, _ = run.metrics.series(SCORE, "time_s")
    there = np.flatnonzero(scores >= score)
    return (float(frames[there[0]]), float(times[there[0]])) if len(there) else (math.inf, math.inf)


def family(algo: str) -> str:
    return "on-policy" if algo in ON_POLICY else "off-policy" if algo in OFF_POLICY else ""


@dataclasses.dataclass
class Gap:
    """The strongest on-policy cell against the strongest off-policy one of a scenario, in units of its reference."""

    scenario: str
    gap: float
    on_policy: str
    off_policy: str


def family_gaps(study: Study) -> list[Gap]:
    gaps = []
    use_evaluations = uses_evaluations(study)
    for scenario, reference in study.references.items():
        best: dict[str, tuple[float, str]] = {}
        for cell in study.cells_of(scenario):
            if not cell.complete or not family(cell.algo):
                continue
            mean = float(np.mean(cell.evaluated() if use_evaluations else cell.scores))
            best[family(cell.algo)] = max(best.get(family(cell.algo), (-math.inf, "")), (mean, cell.label))
        if len(best) == 2:
            (on, on_label), (off, off_label) = best["on-policy"], best["off-policy"]
            gaps.append(Gap(scenario, (on - off) / (reference.scripted - reference.random), on_label, off_label))
    return gaps


TICS = {"tics": 1, "decisions": 4}  # of one of a unit
REFERENCE = "@reference"  # behind the name of a scenario: the game that the paper's runs played


@functools.cache
def scenario_settings(scenario: str) -> dict:
    """scenario.toml of a scenario of this repository, without its variant; empty where there is none."""
    path = pathlib.Path(__file__).resolve().parents[2] / "scenarios" / scenario.partition("@")[0] / "scenario.toml"
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def published_table(path: pathlib.Path) -> tuple[list[str], dict[str, dict]]:
    """The paper's table in the scenarios' units: algorithms; of each scenario printed, half_width, archived (in that order),
    ceiling, unit (the paper's) and ours_in_one (how many of our units are one of the paper's). Raises ValueError where units do
    not convert."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    algorithms = table.pop("algorithms")
    for scenario, entry in table.items():
        unit, ours = entry["unit"], scenario_settings(scenario).get("score_unit")
        entry["ours_in_one"] = 1.0
        if unit == ours:
            continue
        if unit not in TICS or ours not in TICS:
            raise ValueError(f"{path.name}: {scenario} is published in {unit}, which are no {ours}")
        entry["ours_in_one"] = TICS[unit] / TICS[ours]
        for name in ("printed", "half_width", "archived"):
            entry[name] = [value * entry["ours_in_one"] for value in entry[name]]
    return algorithms, table
