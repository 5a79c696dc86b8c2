"""One Markdown page about a folder of kept results (deploy/SWEEPS.md): what was shown to learn, by which test, and what was not.

The folder holds <run>/result.json, config.toml and metrics.jsonl, and in eval/ the episodes of every run and of random play on
the same maps (`comrad eval --policy random --json`). A run beats random play where Welch's one-sided test over their episodes gives
p < 0.01 after Holm's correction over all tests of the page, in score J or in return; both are tested for every run.
"""

import dataclasses
import math
import os
import pathlib

import numpy as np
from scipy import stats

from analysis import REFERENCE, Study, measured_references, published_table, reference_file, scenario_settings
from figures import EVALUATION, STYLE, colors_of, legend_below, plt
from curves import draw_references, draw_runs
from run_files import OFF_POLICY, ON_POLICY, SCORE, Run, parse_json, read_text
from tables import Table, as_markdown, millions, plural, rounded

ALGORITHMS = ON_POLICY + OFF_POLICY
ALPHA = 0.01
LONGEST_FRAMES = 20e6  # within which a score of the paper's 100 M counts as reached
RANDOM = "random_"  # eval/random_<scenario>.json
SECTION_BEGIN, SECTION_END = "<!-- results -->", "<!-- end of results -->"  # in a scenario's page
PICTURE = "curves.png"
# At the width of a page, 8.4 inches, this is the size of the text around it.
LARGER = {"font.size": 9, "axes.labelsize": 9, "axes.titlesize": 10, "legend.fontsize": 9} | {
    f"{axis}tick.labelsize": 8.5 for axis in "xy"
}


@dataclasses.dataclass
class Row:
    """A kept run beside random play. p_score and p_return are Holm's, NaN where random play was not measured."""

    run: Run
    result: dict
    scores: np.ndarray
    returns: np.ndarray
    p_score: float = math.nan
    p_return: float = math.nan

    @property
    def beats_in_score(self) -> bool:
        return self.p_score < ALPHA

    @property
    def beats_in_return(self) -> bool:
        return self.p_return < ALPHA

    @property
    def stale(self) -> str:
        stale = self.result.get("stale")
        words = [stale] if isinstance(stale, str) and stale else []
        played, version = self.run.settings["scenario_version"], scenario_settings(self.run.scenario).get("version", 1)
        return "; ".join(words + [f"version {played} of the scenario, now {version}"] * (played != version))

    @property
    def env_frames(self) -> float:
        return float(self.result.get("env_frames") or math.nan)


def read_episodes(path: pathlib.Path) -> tuple[np.ndarray, np.ndarray]:
    """J and return of each episode of an evaluation, [E] f64. Raises OSError and ValueError with a sentence."""
    answer = parse_json(read_text(path))
    each = answer.get("each") if isinstance(answer, dict) else None
    if not isinstance(each, list) or len(each) < 2 or not all(isinstance(one, dict) for one in each):
        raise ValueError(f"{path.name} holds no episodes")
    values = [np.array([one.get(name, math.nan) for one in each], dtype=float) for name in ("J", "return")]
    if not all(np.isfinite(one).all() for one in values):
        raise ValueError(f"{path.name} has an episode without J or return")
    return values[0], values[1]


def welch(ours: np.ndarray, others: np.ndarray) -> float:
    """The chance of so much higher a mean if both were alike, one-sided (Welch 1947)."""
    if ours.std() == 0 and others.std() == 0:
        return 0.0 if ours.mean() > others.mean() else 1.0
    return float(stats.ttest_ind(ours, others, equal_var=False, alternative="greater").pvalue)


def holm(p_values: list[float]) -> list[float]:
    """Adjusted p-values (Holm 1979): rising with the raw ones, each at most 1."""
    order = sorted(range(len(p_values)), key=lambda at: p_values[at])
    adjusted, highest = [math.nan] * len(p_values), 0.0
    for place, at in enumerate(order):
        highest = max(highest, min(1.0, (len(p_values) - place) * p_values[at]))
        adjusted[at] = highest
    return adjusted


Kept = tuple[list[Row], dict[str, tuple], list[str]]


def tests_of(rows: list[Row]) -> int:
    """Score and return of every run that random play was measured for."""
    return 2 * sum(not math.isnan(row.p_score) for row in rows)


def read_rows(study: Study, folder: pathlib.Path) -> Kept:
    """The kept runs of a study, random play of each scenario, and what could not be used."""
    rows, problems, random_play = [], [], {}
    for run in study.runs:
        try:
            result = parse_json(read_text(run.folder / "result.json"))
            if not isinstance(result, dict):
                raise ValueError("result.json holds no object")
            rows.append(Row(run, result, *read_episodes(folder / "eval" / f"{run.name}.json")))
        except (OSError, ValueError) as error:
            problems.append(f"{run.name}: {error}")
    for scenario in sorted({row.run.scenario for row in rows}):
        try:
            random_play[scenario] = read_episodes(folder / "eval" / f"{RANDOM}{scenario}.json")
        except (OSError, ValueError) as error:
            problems.append(f"random play of {scenario}: {error}")
    tested = [row for row in rows if row.run.scenario in random_play]
    p_values = []
    for row in tested:
        scores, returns = random_play[row.run.scenario]
        p_values += [welch(row.scores, scores), welch(row.returns, returns)]
    for at, adjusted in enumerate(holm(p_values)):
        if at % 2 == 0:
            tested[at // 2].p_score = adjusted
        else:
            tested[at // 2].p_return = adjusted
    return rows, random_play, problems


def most(rows: list[Row], name: str) -> bool:
    return 2 * sum(getattr(row, name) for row in rows) > len(rows)


def cell_text(rows: list[Row]) -> str:
    """The mean J of a cell's longest runs; bold where most of them beat random play in score, italic where in return alone."""
    if not rows:
        return ""
    text = rounded(float(np.mean([row.scores.mean() for row in rows])), 3)
    if most(rows, "beats_in_score"):
        text = f"**{text}**"
    elif most(rows, "beats_in_return"):
        text = f"*{text}*"
    return text + (f" ({len(rows)})" if len(rows) > 1 else "") + ("†" if any(row.stale for row in rows) else "")


def cells_of(rows: list[Row]) -> dict[tuple[str, str], list[Row]]:
    """Runs by scenario and algorithm; of runs of several lengths those of the greatest goal."""
    cells: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        cells.setdefault((row.run.scenario, row.run.algo), []).append(row)
    for at, found in cells.items():
        goal = max(row.result.get("train_for_env_frames") or 0 for row in found)
        cells[at] = [row for row in found if (row.result.get("train_for_env_frames") or 0) == goal]
    return cells


def plays_as_published(run: Run) -> bool:
    """The game of the paper's runs: the reference variant, two agents, a decision in four tics."""
    return run.scenario.endswith(REFERENCE) and run.settings.get("num_agents", 2) == 2 and run.settings.get("env_frameskip", 4) == 4


def printed_for(run: Run, published: dict[str, dict]) -> float | None:
    """The paper's J for that game and algorithm, in the scenario's unit."""
    entry = published.get(run.scenario.removesuffix(REFERENCE)) if plays_as_published(run) else None
    return entry["printed"][ALGORITHMS.index(run.algo)] if entry else None


def reached(scenarios, cells, published: dict[str, dict]) -> dict[str, list[str]]:
    """For each scenario the algorithms whose mean J in its reference variant is what the paper prints at 100 M, or more."""
    found = {}
    for scenario in scenarios:
        for algo in ALGORITHMS:
            rows = cells.get((scenario, algo), [])
            value = (printed_for(rows[0].run, published) if rows else None) or 0
            if value <= 0 or max(row.env_frames for row in rows) > LONGEST_FRAMES * 1.05:
                continue
            if most(rows, "beats_in_score") and np.mean([row.scores.mean() for row in rows]) >= value:
                found.setdefault(scenario, []).append(algo)
    return found


def weakest_table(published: dict[str, dict]) -> Table:
    """Random play and the scripted team in the reference variants, beside the lowest score that the paper prints, in one unit."""
    table = Table(["scenario", "random play", "the paper's lowest", "scripted team", "episodes"], [])
    for name, entry in measured_references(reference_file()).items():
        scenario = name.removesuffix(REFERENCE)
        if scenario != name and scenario in published:
            played = [f"{rounded(entry[one], 4)} ± {rounded(entry[one + '_half_width'], 2)}" for one in ("random", "scripted")]
            table.rows.append([scenario, played[0], rounded(min(published[scenario]["printed"]), 4), played[1], str(entry["episodes"])])
    return table


def curves_figure(study: Study, scenarios: list[str], random_play: dict):
    """J of training episodes over env frames, a panel a scenario: three to a row, as wide as a page."""
    with plt.rc_context(STYLE | LARGER):
        columns = min(3, len(scenarios))
        rows = math.ceil(len(scenarios) / columns)
        size = (8.4, 2.25 * rows + 0.3) if columns > 1 else (5.6, 3.2)
        figure, panels = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
        colors = colors_of(study)
        for axes in panels.flat[len(scenarios) :]:
            axes.axis("off")
        for axes, scenario in zip(panels.flat, scenarios):
            for cell in study.cells_of(scenario):
                color, style = colors[cell.label]
                look = {"color": color, "scale": 1e6, "linestyle": style, "linewidth": 1.4}
                lines = (draw_runs(axes, cell.drawn, cell.algo, metric=name, **look) for name in (SCORE, EVALUATION))
                if line := next(filter(None, lines), None):
                    line.set_label(cell.algo)
            random = float(random_play[scenario][0].mean()) if scenario in random_play else None
            reference = study.references.get(scenario)
            draw_references(axes, random, reference.scripted if reference else None)
            axes.set_title(scenario.replace("_", " "))
            axes.margins(x=0.01)
        for axes in panels.flat[max(0, len(scenarios) - columns) : len(scenarios)]:
            axes.set_xlabel("env frames (millions)")
        figure.supylabel("J of training episodes", fontsize=LARGER["font.size"])
        if len(scenarios) == panels.size:
            legend_below(figure, panels)
            return figure
        found = {words: handle for axes in panels.flat for handle, words in zip(*axes.get_legend_handles_labels())}
        names = [name for name in dict.fromkeys((*ALGORITHMS, *found)) if name in found]
        panels.flat[-1].legend([found[name] for name in names], names, loc="center", ncols=2)
        return figure


def p_text(p: float) -> str:
    return "" if math.isnan(p) else "<1e-9" if p < 1e-9 else f"{p:.2g}"


def score_text(scores: np.ndarray) -> str:
    half = stats.t.ppf(0.975, len(scores) - 1) * scores.std(ddof=1) / math.sqrt(len(scores))
    return f"{rounded(float(scores.mean()))} ± {rounded(float(half), 2)}"


def save_picture(figure, path: pathlib.Path) -> None:
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)


def machine_of(row: Row) -> str:
    processor = str(row.result.get("processor", ""))
    return processor + " with a GPU" * (bool(processor) and str(row.run.settings.get("device", "")).startswith("cuda"))


def origin_of(rows: list[Row]) -> str:
    """When, by which program and where."""
    dates = sorted(str(row.result.get("date", ""))[:10] for row in rows)
    commits = sorted({str(row.result.get("commit", ""))[:7] for row in rows} - {""})
    machines = sorted({machine_of(row) for row in rows} - {""})
    return (f"{dates[0]} to {dates[-1]}; " if rows else "") + f"commits {joined(commits)}; {joined(machines)}"


def scenario_section(scenario: str, rows: list[Row], known: tuple | None, tests: int, command: str) -> str:
    """What one scenario's page says of its kept runs."""
    table = Table(["algorithm", "seed", "env frames", "precision", "J", "p", "return", "p", "minutes", ""], [])
    for row in rows:
        table.rows.append(
            [
                row.run.algo,
                str(row.run.seed),
                millions(row.env_frames),
                str(row.run.settings.get("precision", "")),
                score_text(row.scores),
                p_text(row.p_score),
                rounded(float(row.returns.mean()), 3),
                p_text(row.p_return),
                rounded(float(row.result.get("train_s") or math.nan) / 60, 2),
                "learned" if row.beats_in_score else "learned, by its return" if row.beats_in_return else "not learned",
            ]
        )
    random = (
        f"Random play: J {score_text(known[0])}, return {rounded(float(known[1].mean()), 3)}. "
        f"p: one-sided Welch test against it over episodes, after Holm's correction over all {tests} tests of the kept runs."
        if known
        else "Random play was not measured."
    )
    return (
        f"## What was shown to learn\n\nWritten by `{command}`; {origin_of(rows)}. {random}\n\n{as_markdown(table)}\n"
        f"![Learning curves of the kept runs]({PICTURE})\n"
    )


def with_section(text: str, section: str) -> str:
    """A page with the section between its marks, or at its end where it has none. Raises ValueError."""
    begin, end = text.find(SECTION_BEGIN), text.find(SECTION_END)
    if (begin < 0) != (end < 0) or end < begin:
        raise ValueError(f"has one of the marks {SECTION_BEGIN} and {SECTION_END}; it needs both, in this order, or none")
    marked = f"{SECTION_BEGIN}\n\n{section}\n{SECTION_END}"
    if begin < 0:
        return text.rstrip("\n") + f"\n\n{marked}\n"
    return text[:begin] + marked + text[end + len(SECTION_END) :]


def scenario_pages(study: Study, kept: Kept, pages: pathlib.Path, command: str) -> list[pathlib.Path]:
    """Puts the kept runs of every scenario into pages/<scenario>/README.md, between two marks, and their curves beside it.

    Returns what was written. Raises OSError, and ValueError for a page with one mark.
    """
    rows, random_play, _ = kept
    tests = tests_of(rows)
    texts = {}
    for scenario in sorted({row.run.scenario for row in rows}):
        page = pages / scenario / "README.md"
        if not page.is_file():
            continue
        own = [row for row in rows if row.run.scenario == scenario]
        own.sort(key=lambda row: (ALGORITHMS.index(row.run.algo), row.run.seed))
        try:
            section = scenario_section(scenario, own, random_play.get(scenario), tests, command)
            texts[scenario] = with_section(page.read_text(encoding="utf-8"), section)
        except ValueError as error:
            raise ValueError(f"{page} {error}") from error
    written = []
    for scenario, text in texts.items():
        save_picture(curves_figure(study, [scenario], random_play), pages / scenario / PICTURE)
        (pages / scenario / "README.md").write_text(text, encoding="utf-8")
        written += [pages / scenario / "README.md", pages / scenario / PICTURE]
    return written


def joined(words) -> str:
    return ", ".join(words) if words else "none"


def results_page(study: Study, kept: Kept, folder: pathlib.Path, page: pathlib.Path, command: str) -> list[pathlib.Path]:
    """Writes the page and, beside the kept results, its picture. Returns what was written. Raises OSError."""
    rows, random_play, problems = kept
    published = published_table(pathlib.Path(__file__).with_name("published.toml"))[1]
    played = {row.run.scenario for row in rows}
    scenarios = [name for known in published for name in (known, known + REFERENCE) if name == known or name in played]
    scenarios += sorted(played - set(scenarios))
    cells = cells_of(rows)
    learns = {
        (scenario, algo)
        for (scenario, algo), found in cells.items()
        if most(found, "beats_in_score") or most(found, "beats_in_return")
    }
    paper = reached(scenarios, cells, published)
    by_algo = {algo: [s for s in scenarios if (s, algo) in learns] for algo in ALGORITHMS}

    matrix = Table(["scenario", "random play", *ALGORITHMS], [])
    for scenario in scenarios:
        known = random_play.get(scenario)
        matrix.rows.append(
            [scenario, rounded(float(known[0].mean()), 3) if known else ""]
            + [cell_text(cells.get((scenario, algo), [])) for algo in ALGORITHMS]
        )
    details = Table(
        ["run", "env frames", "J", "p", "return", "random's return", "p", "paper's J at 100 M", "minutes", "stale"], []
    )
    for row in sorted(rows, key=lambda row: (scenarios.index(row.run.scenario), ALGORITHMS.index(row.run.algo), row.run.seed)):
        known = random_play.get(row.run.scenario)
        printed = printed_for(row.run, published)
        details.rows.append(
            [
                row.run.name,
                millions(row.env_frames),
                score_text(row.scores),
                p_text(row.p_score),
                rounded(float(row.returns.mean()), 3),
                rounded(float(known[1].mean()), 3) if known else "",
                p_text(row.p_return),
                "" if printed is None else rounded(printed),
                rounded(float(row.result.get("train_s") or math.nan) / 60, 2),
                row.stale,
            ]
        )

    picture = folder / PICTURE
    shown = [scenario for scenario in scenarios if any(row.run.scenario == scenario for row in rows)]
    figure = curves_figure(study, shown, random_play) if shown else None
    if figure is not None:
        save_picture(figure, picture)
    missing = [f"{algo} on {s}" for s in scenarios for algo in ALGORITHMS if (s, algo) not in cells]
    lines = [
        "# Results: what was shown to learn",
        "",
        f"Written by `{command}`; no number is typed by hand. {len(rows)} runs of {len(cells)} of "
        f"{len(scenarios) * len(ALGORITHMS)} pairs of scenario and algorithm; {origin_of(rows)}.",
        "",
        "J is the mean over 100 fresh episodes with drawn actions unless a run's evaluation says otherwise. **Bold**: beats random play in "
        "J; *italic*: in the return alone (one-sided Welch test over episodes, p < 0.01 after Holm's correction over all "
        f"{tests_of(rows)} tests of this page), in most of a cell's seeds, whose number stands in "
        "brackets. An empty cell was not run. †: recipe or map have changed since; the last table says what.",
        "",
        as_markdown(matrix),
        f"* Scenarios that at least one algorithm learns: {sum(any((s, a) in learns for a in ALGORITHMS) for s in scenarios)} "
        f"of {len(scenarios)}. Not yet: {joined([s for s in scenarios if not any((s, a) in learns for a in ALGORITHMS)])}.",
        "* Scenarios that each algorithm learns: " + ", ".join(f"{algo} {len(by_algo[algo])}" for algo in ALGORITHMS) + ".",
        "* What the paper prints for the same algorithm at 100 M env frames is reached within 20 M, in the game that its runs "
        f"played (`--variant reference`), on {plural(len(paper), 'scenario')}: " + (joined([f"{s} ({joined(algos)})" for s, algos in paper.items()])) + ".",
        "",
    ]
    if figure is not None:
        lines += [
            f"![Learning curves]({os.path.relpath(picture, page.parent)})",
            "",
            "Thick: the mean over seeds; thin: single seeds. A scripted team whose score is beyond a panel is named at its edge.",
            "",
        ]
    lines += ["## Each run", "", as_markdown(details)]
    lines += ["## Random play in the game of the paper's runs", "", as_markdown(weakest_table(published))]
    if problems or study.left_out:
        lines += ["## Left out", ""] + [f"* {one}" for one in problems] + [f"* {n}: {why}" for n, why in study.left_out]
        lines.append("")
    lines += ["## Not run", "", (joined(missing) if missing else "Every pair was run.") , ""]
    page.write_text("\n".join(lines), encoding="utf-8")
    return [page] + ([picture] if figure is not None else [])
