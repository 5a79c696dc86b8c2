"""One Markdown page about a folder of kept results (deploy/SWEEPS.md): scores, aggregates, curves and findings.

The folder holds <run>/result.json, config.toml and curve.csv, and random_<scenario>.json with the episodes of random play on the
same map. A run beats random play where Welch's one-sided test over their episodes gives p < 0.01 after Holm's correction over all
tests of the folder.
"""

import dataclasses
import functools
import itertools
import json
import math
import os
import pathlib

import numpy as np
from scipy import stats

from analysis import REFERENCE, Reference, Study, published_table, scenario_settings
from figures import COLORS, STYLE, colors_of, legend_below, plt
from curves import draw_references, draw_runs
from intervals import interquartile_mean, stratified_interval, student_interval
from run_files import OFF_POLICY, ON_POLICY, RESULT, Run, episode_values, read_object
from tables import Table, as_csv, as_markdown, millions, rounded, with_interval

ALGORITHMS = ON_POLICY + OFF_POLICY
ALPHA = 0.01  # of a run against random play
ALPHA_FINDING = 0.05  # of a difference between algorithms, over seeds
RANDOM = "random_"  # random_<scenario>.json
HEAD_BYTES_MAX = 1 << 20  # of a kept episode
SECTION_BEGIN, SECTION_END = "<!-- results -->", "<!-- end of results -->"  # in a scenario's page
AGGREGATED_MIN = 3  # scenarios that are shown together
PICTURE, AGGREGATES, EACH_RUN = "curves.png", "aggregates.png", "runs.csv"
# At the width of a page, 8.4 inches, this is the size of the text around it.
LARGER = {"font.size": 9, "axes.labelsize": 9, "axes.titlesize": 10, "legend.fontsize": 9} | {
    f"{axis}tick.labelsize": 8.5 for axis in "xy"
}


@dataclasses.dataclass(frozen=True)
class Claim:
    """The paper's sentence on which algorithms are ahead where (section 4): `ahead` and `behind` are families, each represented
    by its strongest algorithm, as in the paper's figure 2."""

    words: str
    ahead: tuple[str, ...]
    behind: tuple[str, ...]
    scenarios: tuple[str, ...]


CLAIMS = (
    Claim("on-policy algorithms lead where commitment is needed", ON_POLICY, OFF_POLICY, ("stag_hunt_arena", "rhythm_sync", "coop_puzzle")),
    Claim("value methods lead in stewardship and defence", OFF_POLICY, ON_POLICY, ("foraging_commons", "armory_siege")),
    Claim("IPPO leads MAPPO on Ammo Carrier", ("ippo",), ("mappo",), ("ammo_carrier",)),
)


@dataclasses.dataclass
class Row:
    """A kept run. scores [E] f64 is J of each evaluated episode; p_score is Holm's, NaN where random play was not measured."""

    run: Run
    scores: np.ndarray
    returns: np.ndarray
    p_score: float = math.nan

    @property
    def beats_random(self) -> bool:
        return self.p_score < ALPHA

    @property
    def mean(self) -> float:
        return float(self.scores.mean())

    @property
    def stale(self) -> str:
        stale = self.run.result.get("stale")
        words = [stale] if isinstance(stale, str) and stale else []
        played, version = self.run.settings["scenario_version"], scenario_settings(self.run.scenario).get("version", 1)
        return "; ".join(words + [f"version {played} of the scenario, now {version}"] * (played != version))

    @property
    def env_frames(self) -> float:
        return float(self.run.result.get("env_frames") or math.nan)


def episodes_of(answer: dict, name: str) -> tuple[np.ndarray, np.ndarray]:
    """J and return of each episode of a kept evaluation, [E] f64. Raises ValueError with a sentence about the file `name`."""
    scores, returns = (episode_values(answer, value) for value in ("J", "return"))
    if len(scores) < 2 or len(scores) != len(returns) or not np.isfinite([scores, returns]).all():
        raise ValueError(f"{name} lacks J or return of its episodes")
    return scores, returns


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


Cells = dict[tuple[str, str], list[Row]]


@dataclasses.dataclass
class Kept:
    """What a folder of kept results holds.

    random_play   scenario -> J of each episode of random play, [E] f64
    problems      what could not be used, a sentence each"""

    rows: list[Row]
    random_play: dict[str, np.ndarray]
    problems: list[str]

    @property
    def tests(self) -> int:
        return sum(not math.isnan(row.p_score) for row in self.rows)

    @functools.cached_property
    def cells(self) -> Cells:
        """Runs by scenario and algorithm; of runs of several lengths those of the greatest goal."""
        cells: Cells = {}
        for row in self.rows:
            cells.setdefault((row.run.scenario, row.run.algo), []).append(row)
        for at, found in cells.items():
            goal = max(row.run.result.get("train_for_env_frames") or 0 for row in found)
            cells[at] = [row for row in found if (row.run.result.get("train_for_env_frames") or 0) == goal]
        return cells

    @functools.cached_property
    def comparable(self) -> Cells:
        """Those whose runs are of today's recipe, map and version of the scenario."""
        return {at: rows for at, rows in self.cells.items() if not any(row.stale for row in rows)}


def read_kept_rows(study: Study, folder: pathlib.Path) -> Kept:
    """The kept runs of a study beside random play."""
    rows, problems, random_play = [], [], {}
    for run in study.runs:
        try:
            rows.append(Row(run, *episodes_of(run.result, RESULT)))
        except ValueError as error:
            problems.append(f"{run.name}: {error}")
    for scenario in sorted({row.run.scenario for row in rows}):
        try:
            path = folder / f"{RANDOM}{scenario}.json"
            random_play[scenario] = episodes_of(read_object(path), path.name)[0]
        except (OSError, ValueError) as error:
            problems.append(f"random play of {scenario}: {error}")
    tested = [row for row in rows if row.run.scenario in random_play]
    for row, p in zip(tested, holm([welch(row.scores, random_play[row.run.scenario]) for row in tested])):
        row.p_score = p
    return Kept(rows, random_play, problems)


def means_of(rows: list[Row]) -> np.ndarray:
    """Mean J of each run, [seeds] f64."""
    return np.array([row.mean for row in rows])


def half_width(values: np.ndarray) -> float:
    """Of the 95 % interval of the mean of [n] values (Student t)."""
    return student_interval(values)[1] - float(values.mean())


def share_text(score: float, reference: Reference | None) -> str:
    return "" if reference is None else f"{100 * reference.normalised(score):.0f} %"


def cell_text(rows: list[Row], reference: Reference | None) -> str:
    """Mean J over seeds with its half-width, bold where most runs beat random play; beneath it the share of the scripted team's."""
    if not rows:
        return ""
    means = means_of(rows)
    text = rounded(float(means.mean()), 3)
    if 2 * sum(row.beats_random for row in rows) > len(rows):
        text = f"**{text}**"
    if len(means) > 1:
        text += f" ± {rounded(half_width(means), 2)}"
    text += "†" * any(row.stale for row in rows)
    share = share_text(float(means.mean()), reference)
    return text + (f"<br>{share}" if share else "")


def score_table(study: Study, kept: Kept, scenarios: list[str]) -> Table:
    """Scenarios by algorithms under the default rules."""
    table = Table(["scenario", "random", *ALGORITHMS, "scripted"], [])
    for scenario in scenarios:
        known, reference = kept.random_play.get(scenario), study.references.get(scenario)
        table.rows.append(
            [scenario.replace("_", " "), "" if known is None else rounded(float(known.mean()), 3)]
            + [cell_text(kept.cells.get((scenario, algo), []), reference) for algo in ALGORITHMS]
            + ["" if reference is None else rounded(reference.scripted, 3)]
        )
    return table


def staged_sentence(kept: Kept) -> str:
    """Which curves are those of a scenario's stages; empty where none is."""
    runs = [row.run for row in kept.rows if row.run.settings.get("layout_pool") == "curriculum"]
    staged = dict.fromkeys(f"{run.scenario.replace('_', ' ')} ({run.algo})" for run in runs)
    return f" Runs of {joined(list(staged))} train on the scenario's stages: J is that of these." if staged else ""


def aggregates_of(study: Study, kept: Kept) -> tuple[list[str], dict[str, list[np.ndarray]]]:
    """Normalised J of some algorithms, [scenario] of [seeds] f64, over the scenarios with a reference where each of them has comparable
    runs: of all such choices that of most cells, then of most algorithms. Empty where fewer than AGGREGATED_MIN scenarios are common."""
    common, algos = [], ()
    for count in range(len(ALGORITHMS), 1, -1):
        for chosen in itertools.combinations(ALGORITHMS, count):
            shared = [one for one in study.references if all((one, algo) in kept.comparable for algo in chosen)]
            if len(shared) >= AGGREGATED_MIN and len(shared) * count > len(common) * len(algos):
                common, algos = shared, chosen
    value = lambda scenario, algo: study.references[scenario].normalised(means_of(kept.comparable[scenario, algo]))
    return common, {algo: [value(scenario, algo) for scenario in common] for algo in algos}


def aggregates_figure(scores: dict[str, list[np.ndarray]]):
    """Interquartile means of normalised J with stratified bootstrap intervals (Agarwal et al. 2021)."""
    with plt.rc_context(STYLE | LARGER):
        figure, axes = plt.subplots(figsize=(5.6, 0.7 + 0.25 * len(scores)), layout="constrained")
        for row, (algo, values) in enumerate(scores.items()):
            mean, (low, high) = interquartile_mean(values), stratified_interval(interquartile_mean, values)
            axes.plot([low, high], [row, row], color=COLORS[algo], linewidth=6, alpha=0.35, solid_capstyle="butt")
            axes.plot([mean], [row], "|", color=COLORS[algo], markersize=12, markeredgewidth=2.4)
        axes.set_yticks(range(len(scores)), scores)
        axes.set_ylim(len(scores) - 0.5, -0.5)
        axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
        axes.set_xlabel("interquartile mean of J (0: random play, 1: scripted team)")
        return figure


def curves_figure(study: Study, scenarios: list[str], random_play: dict[str, np.ndarray]):
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
                line = draw_runs(axes, cell.drawn, cell.algo, color=color, scale=1e6, linestyle=style, linewidth=1.4)
                if line:
                    line.set_label(cell.algo)
            reference = study.references.get(scenario)
            random = float(random_play[scenario].mean()) if scenario in random_play else None
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


def paper_table(kept: Kept, published: dict[str, dict]) -> Table:
    """Our runs of the reference variants beside the paper's scores, in the paper's units."""
    table = Table(["scenario", "algorithm", "seeds", "env frames", "J", "paper, 100 M", "unit"], [], numbers_from=2)
    for scenario, entry in published.items():
        for algo in ALGORITHMS:
            rows = kept.cells.get((scenario + REFERENCE, algo), [])
            if not rows:
                continue
            means = means_of(rows) / entry["ours_in_one"]
            low, high = student_interval(means)
            printed = entry["printed"][ALGORITHMS.index(algo)] / entry["ours_in_one"]
            frames = max(row.env_frames for row in rows)
            score = with_interval(float(means.mean()), low, high)
            table.rows.append(
                [scenario.replace("_", " "), algo, str(len(rows)), millions(frames), score, rounded(printed), entry["unit"]]
            )
    return table


def strongest(kept: Kept, scenario: str, family: tuple[str, ...]) -> list[Row]:
    cells = [kept.comparable[scenario, algo] for algo in family if (scenario, algo) in kept.comparable]
    return max(cells, key=lambda rows: means_of(rows).mean(), default=[])


def finding(kept: Kept, claim: Claim, scenario: str) -> str | None:
    """Whether a claim holds in one scenario: the strongest algorithm of each side, two-sided Welch test over seeds. None where a
    side has no comparable run."""
    sides = [strongest(kept, scenario, family) for family in (claim.ahead, claim.behind)]
    if not all(sides):
        return None
    numbers = ", ".join(f"{rows[0].run.algo} {rounded(float(means_of(rows).mean()), 3)}" for rows in sides)
    seeds = min(len(rows) for rows in sides)
    if seeds < 2:
        return f"{scenario.replace('_', ' ')}: undecided ({numbers}; a single seed)"
    ahead, behind = map(means_of, sides)
    p = 2 * min(welch(ahead, behind), welch(behind, ahead))
    verdict = "undecided" if p >= ALPHA_FINDING else "holds" if ahead.mean() > behind.mean() else "the reverse"
    return f"{scenario.replace('_', ' ')}: {verdict} ({numbers}; p = {min(p, 1.0):.2g}, {seeds} seeds)"


def findings_lines(kept: Kept) -> list[str]:
    lines = []
    for claim in CLAIMS:
        for rules, ending in (("default rules", ""), ("reference rules", REFERENCE)):
            found = [finding(kept, claim, scenario + ending) for scenario in claim.scenarios]
            known = [words.replace(REFERENCE, "") for words in found if words]
            if missing := len(found) - len(known):
                known.append(f"{missing} of {len(found)} not run" if known else "not run")
            lines.append(f"* The paper: {claim.words}. With {rules}: {'; '.join(known)}.")
    return lines


def people_table(folder: pathlib.Path, study: Study, kept: Kept) -> Table:
    """Scores of the episodes that people played (`comrad play --save` into a folder beside the results), by scenario and team."""
    scores: dict[tuple[str, str], list[float]] = {}
    for path in sorted(folder.glob("*/*.comrad")):
        try:
            with open(path, "rb") as file:
                head = json.loads(file.readline(HEAD_BYTES_MAX))
            score, team = float(head["score"]), head["policy"]
            if "person" in team and math.isfinite(score):
                scores.setdefault((head["scenario"], team), []).append(score)
        except (OSError, ValueError, KeyError, TypeError) as error:
            kept.problems.append(f"{path.relative_to(folder)}: no episode of comrad play ({type(error).__name__})")
    table = Table(["scenario", "team", "episodes", "J", "random", "scripted"], [], numbers_from=2)
    for (scenario, team), values in sorted(scores.items()):
        random, reference = kept.random_play.get(scenario), study.references.get(scenario)
        text = score_text(np.array(values)) if len(values) > 1 else rounded(values[0])
        random_text = "" if random is None else rounded(float(random.mean()), 3)
        table.rows.append([scenario.replace("_", " "), team, str(len(values)), text, random_text, rounded(reference.scripted, 3) if reference else ""])
    return table


def p_text(p: float) -> str:
    return "" if math.isnan(p) else "<1e-9" if p < 1e-9 else f"{p:.2g}"


def score_text(scores: np.ndarray) -> str:
    return f"{rounded(float(scores.mean()))} ± {rounded(half_width(scores), 2)}"


def save_picture(figure, path: pathlib.Path) -> pathlib.Path:
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)
    return path


def machine_of(row: Row) -> str:
    processor = str(row.run.result.get("processor", ""))
    return processor + " with a GPU" * (bool(processor) and str(row.run.settings.get("device", "")).startswith("cuda"))


def joined(words) -> str:
    return ", ".join(words) if words else "none"


def origin_of(rows: list[Row]) -> str:
    """When and where."""
    dates = sorted(str(row.run.result.get("date", ""))[:10] for row in rows)
    machines = sorted({machine_of(row) for row in rows} - {""})
    return (f"{dates[0]} to {dates[-1]}; " if rows else "") + joined(machines)


def each_run(kept: Kept) -> str:
    """Every kept run as CSV."""
    head = "run,scenario,algorithm,seed,env_frames,minutes,J,J_ci95,J_greedy,return,p,date,commit,machine,checkpoint_hash,stale"
    rows = []
    for row in sorted(kept.rows, key=lambda row: (row.run.scenario, ALGORITHMS.index(row.run.algo), row.run.seed)):
        of = row.run.result.get
        rows.append(
            [row.run.name, row.run.scenario, row.run.algo, row.run.seed, f"{row.env_frames:.0f}"]
            + [rounded(float(of("train_s") or math.nan) / 60, 3), rounded(row.mean), rounded(float(of("J_ci95") or 0), 3)]
            + ["" if of("J_mean_greedy") is None else rounded(of("J_mean_greedy")), rounded(float(row.returns.mean()))]
            + [p_text(row.p_score), str(of("date", ""))[:10], str(of("commit", ""))[:7], machine_of(row)]
            + [of("checkpoint_hash", ""), row.stale]
        )
    return as_csv(head.split(","), rows)


def scenario_section(scenario: str, rows: list[Row], random: np.ndarray | None, tests: int, command: str) -> str:
    """What one scenario's page reports of its kept runs."""
    table = Table(["algorithm", "seed", "env frames", "precision", "J", "p", "minutes", ""], [])
    for row in rows:
        table.rows.append(
            [
                row.run.algo,
                str(row.run.seed),
                millions(row.env_frames),
                str(row.run.settings.get("precision", "")),
                score_text(row.scores),
                p_text(row.p_score),
                rounded(float(row.run.result.get("train_s") or math.nan) / 60, 2),
                "learned" if row.beats_random else "not learned",
            ]
        )
    words = (
        "Random play was not measured."
        if random is None
        else f"Random play: J {score_text(random)}. p: one-sided Welch test against it over episodes, after Holm's correction over "
        f"all {tests} kept runs."
    )
    return (
        f"## What was shown to learn\n\nWritten by `{command}`; {origin_of(rows)}. {words}\n\n{as_markdown(table)}\n"
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
    texts = {}
    for scenario in sorted({row.run.scenario for row in kept.rows}):
        page = pages / scenario / "README.md"
        if not page.is_file():
            continue
        own = [row for row in kept.rows if row.run.scenario == scenario]
        own.sort(key=lambda row: (ALGORITHMS.index(row.run.algo), row.run.seed))
        try:
            section = scenario_section(scenario, own, kept.random_play.get(scenario), kept.tests, command)
            texts[scenario] = with_section(page.read_text(encoding="utf-8"), section)
        except ValueError as error:
            raise ValueError(f"{page} {error}") from error
    written = []
    for scenario, text in texts.items():
        written.append(save_picture(curves_figure(study, [scenario], kept.random_play), pages / scenario / PICTURE))
        (pages / scenario / "README.md").write_text(text, encoding="utf-8")
        written.append(pages / scenario / "README.md")
    return written


def results_page(study: Study, kept: Kept, folder: pathlib.Path, page: pathlib.Path, command: str) -> list[pathlib.Path]:
    """Writes the page and, beside the kept results, its pictures and runs.csv. Returns what was written. Raises OSError."""
    published = published_table(pathlib.Path(__file__).with_name("published.toml"))[1]
    others = {row.run.scenario for row in kept.rows if not row.run.scenario.endswith(REFERENCE)} - set(published)
    scenarios = [*published, *sorted(others)]
    cells = [(scenario, algo) for scenario in scenarios for algo in ALGORITHMS]
    run = [one for one in cells if one in kept.cells]
    link = lambda name: os.path.relpath(folder / name, page.parent)
    seeds = [len(kept.cells[one]) for one in run]
    lines = [
        "# Results",
        "",
        f"Written by `{command}`; {origin_of(kept.rows)}. {len(run)} of {len(cells)} cells have runs, "
        f"{sum(count >= 3 for count in seeds)} of them three seeds or more. [{EACH_RUN}]({link(EACH_RUN)}) has each run with its "
        "commit, machine, minutes and checkpoint's hash.",
        "",
        "J is the mean over 100 fresh episodes with drawn actions, then over seeds, ± half of its 95 % interval over seeds (Student t; "
        "none for a single seed). **Bold**: most of the cell's runs beat random play (one-sided Welch test over episodes, p < "
        f"{ALPHA} after Holm's correction over {kept.tests} runs). Beneath: where J lies between random play (0 %) and the scripted "
        "team (100 %). An empty cell was not run. †: its recipe, map or scenario's version has changed since.",
        "",
        as_markdown(score_table(study, kept, scenarios)),
    ]
    written = [page, folder / EACH_RUN]
    common, scores = aggregates_of(study, kept)
    if common:
        written.append(save_picture(aggregates_figure(scores), folder / AGGREGATES))
        lines += [
            "## Scenarios together",
            "",
            f"![Interquartile means]({link(AGGREGATES)})",
            "",
            f"Over the {len(common)} scenarios where {joined(list(scores))} have runs without † ({joined(common).replace('_', ' ')}), with "
            "stratified bootstrap intervals over seeds (Agarwal et al. 2021); single seeds have none.",
            "",
        ]
    shown = [scenario for scenario in scenarios if any(row.run.scenario == scenario for row in kept.rows)]
    if shown:
        written.append(save_picture(curves_figure(study, shown, kept.random_play), folder / PICTURE))
        lines += [
            "## Learning curves",
            "",
            f"![Learning curves]({link(PICTURE)})",
            "",
            "Thick: the mean over seeds; thin: single seeds. A scripted team whose score is beyond a panel is named at its edge."
            + staged_sentence(kept),
            "",
        ]
    beside = paper_table(kept, published)
    if beside.rows:
        lines += [
            "## Beside the paper",
            "",
            "In the game that the paper's runs played (`--variant reference`), in its units.",
            "",
            as_markdown(beside),
        ]
    people = people_table(folder, study, kept)
    lines += ["## People", ""]
    lines += [as_markdown(people)] if people.rows else [f"No episode is kept yet: `comrad play SCENARIO --save {folder}/people` keeps some.", ""]
    lines += ["## Findings", "", f"The strongest algorithm of each side is compared over seeds (Welch, p < {ALPHA_FINDING}), without runs marked †.", ""]
    lines += findings_lines(kept) + [""]
    names = {row.run.name for row in kept.rows}
    problems = kept.problems + [f"{name}: {why}" for name, why in study.left_out if name not in names]
    if problems:
        lines += ["## Left out", ""] + [f"* {one}" for one in problems] + [""]
    page.write_text("\n".join(lines), encoding="utf-8")
    (folder / EACH_RUN).write_text(each_run(kept), encoding="utf-8")
    return written
