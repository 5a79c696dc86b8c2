"""The tables of a report: a study's results, in rows, and as files of comma-separated values."""

import math
import pathlib

import numpy as np

import figures
from analysis import (
    ENDED_BADLY,
    THRESHOLDS,
    Cell,
    Gap,
    Study,
    episode_interval,
    frames_to,
    normalised_scores,
    published_table,
    uses_evaluations,
)
from curves import curve_over_runs
from intervals import interquartile_mean, probability_of_improvement, stratified_interval
from run_files import SCORE, number
from tables import Table, as_csv, duration, millions, rounded, with_interval

PUBLISHED = pathlib.Path(__file__).resolve().parent / "published.toml"


def over_seeds(study: Study, values: np.ndarray) -> str:
    return with_interval(float(np.mean(values)), *study.interval(values)) if len(values) else "-"


def interval_words(study: Study) -> str:
    return "percentile bootstrap" if study.options.bootstrap else "Student t"


def normalised(study: Study, cell: Cell) -> str:
    reference = study.references.get(cell.scenario)
    if reference is None or not cell.complete:
        return "-"
    return over_seeds(study, reference.normalised(cell.evaluated() if cell.evaluations else cell.scores))


def score_table(study: Study, scenario: str) -> Table:
    """One row a cell: over seeds, and apart from it over episodes."""
    rows = []
    for cell in study.cells_of(scenario):
        episodes = (
            with_interval(float(np.mean(cell.evaluated())), *episode_interval(cell.evaluations))
            if cell.evaluations
            else "-"
        )
        frames = [study.options.at or run.env_frames for run in cell.complete]
        rows.append(
            [
                cell.label,
                f"{len(cell.complete)} of {len(cell.runs)}",
                millions(float(np.mean(frames)) if frames else math.nan),
                cell.absence or over_seeds(study, cell.scores),
                over_seeds(study, cell.evaluated()),
                episodes,
                normalised(study, cell),
            ]
        )
    protocol = next((cell.evaluations[0].protocol() for cell in study.cells_of(scenario) if cell.evaluations), "")
    return Table(
        ["", "runs", "env frames", "J in training", "J evaluated, over seeds", "over episodes", "normalised"],
        rows,
        1,
        f"Evaluated: {protocol}." if protocol else "",
    )


def matrix_table(study: Study) -> Table:
    """Scenarios by algorithms: the mean over seeds with its interval."""
    use_evaluations = uses_evaluations(study)
    rows = []
    for scenario in study.scenarios:
        cells = {cell.label: cell for cell in study.cells_of(scenario)}
        texts = [
            cells[label].absence
            or over_seeds(study, cells[label].evaluated() if use_evaluations else cells[label].scores)
            if label in cells
            else "-"
            for label in study.labels
        ]
        reference = study.references.get(scenario)
        rows.append(
            [scenario] + texts + ([rounded(reference.random), rounded(reference.scripted)] if reference else ["-", "-"])
        )
    what = "of evaluations" if use_evaluations else "of the last training episodes"
    return Table(
        ["scenario"] + study.labels + ["random", "scripted"],
        rows,
        1,
        f"J {what}: mean over seeds [95 % interval, {interval_words(study)}].",
    )


def aggregate_table(study: Study) -> Table | None:
    common, scores, _ = normalised_scores(study)
    if not scores:
        return None
    rows = []
    for label, runs in scores.items():
        low, high = stratified_interval(lambda drawn: interquartile_mean(drawn), runs)
        mean_low, mean_high = stratified_interval(lambda drawn: float(np.mean([one.mean() for one in drawn])), runs)
        rows.append(
            [
                label,
                str(sum(map(len, runs))),
                with_interval(interquartile_mean(runs), low, high),
                with_interval(float(np.mean([one.mean() for one in runs])), mean_low, mean_high),
            ]
        )
    return Table(["", "runs", "interquartile mean", "mean of scenarios"], rows)


def improvement_table(study: Study) -> Table | None:
    """P(row > column)."""
    _, scores, _ = normalised_scores(study)
    if len(scores) < 2:
        return None
    rows = [
        [a] + ["" if a == b else rounded(probability_of_improvement(scores[a], scores[b]), 3) for b in scores]
        for a in scores
    ]
    return Table(["P(row > column)"] + list(scores), rows)


def efficiency_table(study: Study) -> Table | None:
    rows = []
    for cell in study.cells:
        reference = study.references.get(cell.scenario)
        runs = [run for run in cell.runs if len(run.metrics.series(SCORE)[0])]
        if reference is None or not runs:
            continue
        texts = []
        for share in THRESHOLDS:
            reached = np.array(
                [frames_to(run, reference.random + share * (reference.scripted - reference.random)) for run in runs]
            )
            count = int(np.isfinite(reached[:, 0]).sum())
            median = np.median(reached, axis=0) if 2 * count > len(runs) else (math.inf, math.inf)
            texts.append(
                f"{count}/{len(runs)}"
                + (f": {millions(median[0])}, {duration(median[1])}" if math.isfinite(median[0]) else "")
            )
        rows.append([cell.scenario, cell.label] + texts)
    if not rows:
        return None
    return Table(["scenario", ""] + [f"{share:.0%} of the way" for share in THRESHOLDS], rows, 2)


def mean_of(run, name: str) -> float:
    values = run.metrics.column(name)
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else math.nan


def mean_text(values: list[float], digits: int = 3) -> str:
    values = [value for value in values if math.isfinite(value)]
    return rounded(float(np.mean(values)), digits) if values else "-"


def speed_table(study: Study) -> Table:
    rows = []
    for cell in study.cells:
        runs = [run for run in cell.runs if len(run.metrics)]
        if not runs:
            continue
        last = [float(np.nanmax(run.metrics.column("train/version_diff_max"), initial=-1.0)) for run in runs]
        rows.append(
            [
                cell.scenario,
                cell.label,
                mean_text([mean_of(run, "perf/_fps") for run in runs], 4),
                mean_text([mean_of(run, "perf/_sample_throughput") for run in runs], 4),
                mean_text([mean_of(run, "train/version_diff_avg") for run in runs]),
                rounded(max(last)) if max(last) >= 0 else "-",
                mean_text([100 * mean_of(run, "stats/learner_busy_fraction") for run in runs]),
            ]
        )
    return Table(
        ["scenario", "", "env frames/s", "decisions/s", "lag", "lag max", "learner busy %"],
        rows,
        2,
        "Means over time and runs. Lag in SGD steps between the policy that acted and the one that learned.",
    )


CPU_ROLES = ("simulators", "policy workers", "learner", "supervisor")


def cpu_table(study: Study) -> Table:
    rows = [
        [cell.scenario, cell.label] + [mean_text([cpu_share(run, role) for run in cell.runs]) for role in CPU_ROLES]
        for cell in study.cells
        if any(math.isfinite(cpu_share(run, role)) for run in cell.runs for role in CPU_ROLES)
    ]
    return Table(
        ["scenario", ""] + list(CPU_ROLES),
        rows,
        2,
        "Cores that the processes of a role kept busy since the run was last started (status.json, cpu_s).",
    )


def cpu_share(run, role: str) -> float:
    """Cores that a role kept busy in the run's last start, as its status states; NaN where it does not."""
    recorded, elapsed = run.status.get("cpu_s"), number(run.status.get("elapsed_s"))
    return number(recorded.get(role)) / elapsed if isinstance(recorded, dict) and elapsed > 0 else math.nan


def run_table(study: Study) -> Table:
    by_run = {one.policy: one for cell in study.cells for one in cell.evaluations}
    rows = []
    for cell in study.cells:
        for run in sorted(cell.runs, key=lambda one: (one.seed, one.name)):
            _, scores = run.metrics.series(SCORE)
            one = by_run.get(run.name)
            evaluated = with_interval(one.mean, one.mean - one.half_width, one.mean + one.half_width) if one else "-"
            rows.append(
                [
                    run.name,
                    cell.scenario,
                    cell.label,
                    str(run.seed),
                    run.state,
                    millions(run.env_frames),
                    duration(float(run.metrics.time_s[-1])) if len(run.metrics) else "-",
                    rounded(float(scores[-1])) if len(scores) else "-",
                    evaluated,
                ]
            )
    return Table(
        ["run", "scenario", "", "seed", "state", "env frames", "trained", "last J", "evaluated"],
        rows,
        3,
        "Evaluated: J over fresh episodes of that run alone.",
    )


def failed_table(study: Study) -> Table:
    return Table(
        ["run", "state", "env frames", "last error"],
        [[run.name, run.state, millions(run.env_frames), run.last_error()] for run in study.failed],
        9,
    )


def settings_table(study: Study) -> Table:
    """Settings of each cell that are not the same in all of them."""
    shown = [(cell, cell.runs[0].settings) for cell in study.cells]
    names = sorted(
        {
            name
            for _, settings in shown
            for name in settings
            if name not in ("scenario", "algo", "seed", "experiment", "train_dir", "wad")
            and len({repr(other.get(name)) for _, other in shown}) > 1
        }
    )
    return Table(
        ["setting"] + [figures.cell_title(cell) for cell, _ in shown],
        [[name] + [str(settings.get(name, "built-in")) for _, settings in shown] for name in names],
        9,
    )


def published_tables() -> Table:
    algorithms, published = published_table(PUBLISHED)
    rows = []
    for scenario, entry in published.items():
        texts = []
        for printed, half, archived in zip(entry["printed"], entry["half_width"], entry["archived"]):
            differs = abs(printed - archived) > max(0.006, 0.002 * abs(archived))
            texts.append(f"{printed:.2f} \N{PLUS-MINUS SIGN} {half:.2f}" + (f" (*{archived:g})" if differs else ""))
        rows.append([scenario] + texts + [f"{entry['ceiling']}"])
    return Table(
        ["scenario"] + algorithms + ["ceiling"],
        rows,
        1,
        "For orientation only; not reproducible from the runs its repository keeps. Those hold one seed (42) for each cell; "
        "the printed intervals are computed from the last ten points of that run. (*x): the kept run gives x instead. "
        "All of idqn, Platform Chain and Lava Maze, and two cells of Lava Pit, ended before 100 M env frames and were "
        "stretched to them. Scores are in the units of the scenarios here.",
    )


def gap_table(gaps: list[Gap]) -> Table:
    return Table(
        ["scenario", "gap", "on-policy", "off-policy"],
        [[one.scenario, rounded(one.gap, 3), one.on_policy, one.off_policy] for one in gaps],
    )


def left_out_table(study: Study) -> Table:
    return Table(["what", "why"], [list(pair) for pair in study.left_out + study.problems], 9)


def reference_table(study: Study) -> Table:
    return Table(
        ["scenario", "random", "scripted", "measured in"],
        [[name, rounded(one.random), rounded(one.scripted), one.source] for name, one in study.references.items()],
        9,
    )


def csv_files(study: Study) -> dict[str, str]:
    scores, runs, points = [], [], []
    for cell in study.cells:
        reference = study.references.get(cell.scenario)
        for source, values in (("training", cell.scores), ("evaluation", cell.evaluated())):
            if not len(values):
                continue
            low, high = study.interval(values)
            episodes = episode_interval(cell.evaluations) if source == "evaluation" else (math.nan, math.nan)
            mean = float(values.mean())
            scores.append(
                [
                    cell.scenario,
                    cell.algo,
                    cell.label,
                    source,
                    len(values),
                    mean,
                    low,
                    high,
                    *episodes,
                    float(reference.normalised(mean)) if reference else math.nan,
                ]
            )
        for run in cell.runs:
            _, series = run.metrics.series(SCORE)
            one = next((one for one in cell.evaluations if one.policy == run.name), None)
            runs.append(
                [
                    run.name,
                    cell.scenario,
                    cell.algo,
                    cell.label,
                    run.seed,
                    run.state,
                    run in cell.complete,
                    run.env_frames,
                    float(run.metrics.time_s[-1]) if len(run.metrics) else math.nan,
                    float(series[-1]) if len(series) else math.nan,
                    one.mean if one else math.nan,
                    one.half_width if one else math.nan,
                    run.last_error() if run.state in ENDED_BADLY else "",
                ]
            )
        for over in figures.AXES:
            curve = curve_over_runs(cell.drawn, SCORE, over)
            if curve is not None:
                points += [
                    [
                        cell.scenario,
                        cell.label,
                        over,
                        curve.runs,
                        float(x),
                        float(mean),
                        float(mean - half),
                        float(mean + half),
                    ]
                    for x, mean, half in zip(curve.x, curve.mean, curve.half_width)
                ]
    return {
        "scores.csv": as_csv(
            [
                "scenario",
                "algo",
                "label",
                "source",
                "seeds",
                "J_mean",
                "seeds_low",
                "seeds_high",
                "episodes_low",
                "episodes_high",
                "normalised",
            ],
            scores,
        ),
        "runs.csv": as_csv(
            [
                "run",
                "scenario",
                "algo",
                "label",
                "seed",
                "state",
                "counted",
                "env_frames",
                "time_s",
                "J_training",
                "J_evaluated",
                "J_evaluated_half_width",
                "last_error",
            ],
            runs,
        ),
        "curves.csv": as_csv(["scenario", "label", "over", "runs", "x", "J_mean", "J_low", "J_high"], points),
    }
