"""Puts a report together: which tables and figures there are, in which order, with which words."""

import datetime
import pathlib

import figures
import searches
import study_tables as of
from analysis import ENDED_BADLY, Study, family_gaps, normalised_scores, published_table, states_text, uses_evaluations
from page import Page
from tables import Table, as_latex, as_markdown, millions, plural


class Report:
    """A page, and the same tables as Markdown and LaTeX. Each method adds one section, or nothing."""

    def __init__(self, study: Study, title: str, now: datetime.datetime):
        self.study = study
        self.page = Page(title)
        self.markdown = [
            f"# {title}\n\n{now:%Y-%m-%d}. {plural(len(study.runs), 'run')}: {states_text(study.runs)}. "
            f"95 % intervals over seeds ({of.interval_words(study)}).\n"
        ]
        self.latex: list[str] = []
        hours = sum(float(run.metrics.time_s[-1]) for run in study.runs if len(run.metrics)) / 3600
        counts = {state: sum(run.state == state for run in study.runs) for state in ENDED_BADLY}
        self.page.head(
            f"{study.folder.resolve().name}, {now:%Y-%m-%d %H:%M}. Score J as each scenario defines it; 95 % intervals.",
            [
                (str(len(study.runs)), "runs"),
                (str(sum(len(cell.complete) for cell in study.cells)), "counted in means"),
                *((str(count), state) for state, count in counts.items() if count or state == "failed"),
                (str(len(study.scenarios)), "scenarios"),
                (str(len({cell.algo for cell in study.cells})), "algorithms"),
                (millions(sum(run.env_frames for run in study.runs)), "env frames"),
                (f"{hours:.1f} h", "of training"),
            ],
        )

    def table(self, name: str, table: Table | None) -> None:
        """On the page, and under `name` in Markdown."""
        if table is None or not table.rows:
            return
        self.page.table(table)
        self.markdown.append(f"\n## {name}\n\n{as_markdown(table)}")

    def failures(self) -> None:
        if self.study.failed:
            self.page.section("Failed and missing runs")
            self.table("Failed and missing runs", of.failed_table(self.study))

    def scores(self) -> None:
        at = self.study.options.at
        where = f"at {millions(at)} env frames" if at else "at the end of each run"
        self.page.section(
            "Scores",
            f"J in training: mean of the last training episodes (setting stats_avg), {where}, over seeds "
            f"({of.interval_words(self.study)}). Evaluated: fresh episodes of the finished policy; over seeds its "
            "interval covers other seeds, over episodes only of other episodes of these policies. Normalised: 0 is "
            "random play, 1 the scripted team.",
        )
        for scenario in self.study.scenarios:
            self.page.heading(scenario)
            self.table(scenario, of.score_table(self.study, scenario))
        matrix = of.matrix_table(self.study)
        if len(self.study.scenarios) > 1:
            self.page.heading("All scenarios")
            self.table("All scenarios", matrix)
        self.latex.append(as_latex(matrix, matrix.note))

    def searches(self) -> None:
        found = searches.read_searches(self.study.folder)
        if found:
            self.page.section(
                "Searches",
                "What sweeps with [search] have tried, the best first; one run each, so a difference may be that of seeds.",
            )
        for search in found:
            title = f"{search.title}, {search.method}"
            self.page.heading(title)
            self.table(f"Search: {title}", searches.run_table(search))
            self.page.figure(
                searches.lineage_figure(search),
                f"{title}: a point is the end of a generation; a dotted line leads from the member whose checkpoint was copied",
            )
            self.table(f"Lineage: {title}", searches.lineage_table(search))

    def curves(self) -> None:
        self.page.section(
            "Learning curves",
            "Score of training episodes: the mean over seeds, single runs thinly, from four seeds on with the 95 % band of "
            "the mean (Student t). A mean covers what all its runs have covered; the legend has the number of runs.",
        )
        for scenario in self.study.scenarios:
            self.page.figure(
                figures.learning_curves(self.study, scenario), f"{scenario}: J over env frames and over wall time"
            )

    def aggregates(self) -> None:
        common, scores, apart = normalised_scores(self.study)
        if not scores:
            return
        kind = "evaluations" if uses_evaluations(self.study) else "training scores"
        self.page.section(
            "Across scenarios",
            f"Normalised {kind} over {plural(len(common), 'scenario')}: {', '.join(common)}. Intervals: stratified "
            "bootstrap over seeds (Agarwal et al. 2021, arXiv:2108.13264). The interquartile mean is that of the middle "
            "half of all runs; a scenario with more seeds weighs more in it.",
        )
        if apart:
            self.page.text(
                f"Left out, because they share too few scenarios with the others: {', '.join(apart)}.", "warn"
            )
        if max(len(one) for runs in scores.values() for one in runs) < 2:
            self.page.text("There is one seed for each cell, so there are no intervals.", "warn")
        aggregate = of.aggregate_table(self.study)
        self.table("Across scenarios", aggregate)
        self.page.figure(
            figures.aggregate_figure(self.study),
            "interquartile mean, performance profile and probability of improvement (the first scores more than the "
            "second)",
        )
        self.table("Probability of improvement", of.improvement_table(self.study))
        self.latex.append(
            as_latex(aggregate, f"Normalised scores over {plural(len(common), 'scenario')}, stratified bootstrap.")
        )

    def efficiency(self) -> None:
        efficiency = of.efficiency_table(self.study)
        if efficiency:
            self.page.section(
                "Sample efficiency",
                "Runs that have reached a share of the way from random play to the scripted team, and the median env "
                "frames and training time until then (where more than half of them have).",
            )
            self.table("Sample efficiency", efficiency)

    def families(self) -> None:
        gaps = family_gaps(self.study)
        if gaps:
            self.page.section(
                "On-policy against off-policy",
                "The strongest on-policy algorithm minus the strongest off-policy one, in units of the way from random "
                "play to the scripted team.",
            )
            self.page.figure(
                figures.gap_figure(gaps, *published_table(of.PUBLISHED)),
                "scenario-normalised gap between the two families",
            )
            self.table("On-policy against off-policy", of.gap_table(gaps))

    def occupancy(self) -> None:
        if self.study.occupancies:
            self.page.section(
                "Where agents are",
                "Occupancy of evaluation episodes over the map's plan: dark lines block, grey ones do not. An agent that "
                "died stays where it fell until the episode ends. The colour is stretched, so that little is seen too.",
            )
        for title, one in self.study.occupancies:
            others = f", of {one.maps} maps the one that was played most" if one.maps > 1 else ""
            self.page.figure(
                figures.occupancy_figure(one),
                f"{one.scenario}, {title}: occupancy of {plural(one.episodes, 'episode')}, {one.layout}{others}",
            )

    def speed(self) -> None:
        self.page.section("Throughput, lag, CPU")
        self.page.figure(figures.speed_figure(self.study), "every run is a point, the mean of its cell a bar")
        self.table("Throughput and lag", of.speed_table(self.study))
        cpu = of.cpu_table(self.study)
        if cpu.rows:
            self.page.heading("CPU by role")
            self.table("CPU by role", cpu)

    def diagnostics(self) -> None:
        self.page.section(
            "Learning diagnostics",
            "Means over seeds; learner/METRICS.md states what each number means and when it is bad.",
        )
        for scenario in self.study.scenarios:
            self.page.figure(figures.diagnostics_figure(self.study, scenario), f"{scenario}: learning diagnostics")

    def runs(self) -> None:
        self.page.section("Runs")
        self.table("Runs", of.run_table(self.study))
        if self.study.left_out or self.study.problems:
            self.page.heading("Left out and damaged")
            self.table("Left out and damaged", of.left_out_table(self.study))
        self.page.heading("Settings in which cells differ")
        self.page.table(of.settings_table(self.study))

    def orientation(self) -> None:
        if self.study.references:
            self.page.section("Random play and scripted teams")
            self.table("Random play and scripted teams", of.reference_table(self.study))
        self.page.section("The paper's table")
        self.table("The paper's table", of.published_tables())


def write_report(study: Study, output: pathlib.Path, title: str, now: datetime.datetime) -> list[pathlib.Path]:
    """Writes report.html, report.md, report.tex, scores.csv, runs.csv and curves.csv. Raises OSError."""
    report = Report(study, title, now)
    report.failures()
    report.scores()
    report.searches()
    report.curves()
    report.aggregates()
    report.efficiency()
    report.families()
    report.occupancy()
    report.speed()
    report.diagnostics()
    report.runs()
    report.orientation()
    files = {
        "report.html": report.page.render(),
        "report.md": "".join(report.markdown),
        "report.tex": "\n".join(report.latex),
        **of.csv_files(study),
    }
    for name, text in files.items():
        half = output / f".{name}.new"
        half.write_text(text, encoding="utf-8")
        half.replace(output / name)
    return [output / name for name in files]
