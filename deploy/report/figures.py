"""The figures of a report. Each function returns a Matplotlib figure, or None where there is nothing to draw."""

import itertools
import textwrap

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 (the backend is chosen first)
from matplotlib.collections import LineCollection  # noqa: E402
from matplotlib.colors import PowerNorm  # noqa: E402
from matplotlib.ticker import PercentFormatter  # noqa: E402

from analysis import REFERENCE, Cell, Gap, Study, family, normalised_scores  # noqa: E402
from curves import draw_references, draw_runs  # noqa: E402
from intervals import (
    interquartile_mean,
    performance_profile,
    probability_of_improvement,  # noqa: E402
    stratified_interval,
)
from run_files import SCORE, Occupancy, Run  # noqa: E402

EVALUATION = "eval/J"
# What curves are drawn over: words and divisor for long runs, and for short ones.
AXES = {
    "env_frames": (("env frames (millions)", 1e6), ("env frames (thousands)", 1e3)),
    "time_s": (("hours of training", 3600.0), ("minutes of training", 60.0)),
}
SHORT_OF = 0.2  # of the long runs' unit

# Of Okabe and Ito, readable with colour blindness: warm on-policy, cold off-policy.
COLORS = {
    "ippo": "#d55e00",
    "mappo": "#e69f00",
    "happo": "#b5547f",
    "idqn": "#0072b2",
    "vdn": "#3fa7e0",
    "qmix": "#009e73",
    "qplex_d": "#6a51a3",
    "qplex_q": "#4d4d4d",
}
OTHER_COLORS = ("#8c564b", "#17becf", "#7f7f7f", "#bcbd22")
OCCUPANCY_CELL = 32  # map units; a player is 32 wide
OCCUPANCY_CELLS_MAX = 96
LABEL_WIDTH = 26  # letters of a line beside an axis

LINE_STYLES = ("-", "--", "-.", ":")

# What shows whether learning works, of on-policy and of Q-learning runs; learner/METRICS.md explains each.
DIAGNOSTICS = (
    ("train/entropy", "entropy (nats)"),
    ("train/explained_variance", "explained variance"),
    ("train/kl_divergence", "KL to the behaviour policy"),
    ("train/fraction_clipped", "fraction clipped"),
    ("train/value_loss", "value loss"),
    ("train/grad_norm", "gradient norm"),
    ("train/q_tot_mean", "team's Q"),
    ("train/dqn_q_mean", "own Q"),
    ("train/td_error_mean", "TD error"),
    ("train/dqn_td_error_mean", "own TD error"),
    ("train/epsilon", "epsilon"),
    ("train/loss", "loss"),
)

STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.labelsize": 8,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#888888",
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "svg.hashsalt": "comrad",
    "figure.facecolor": "white",
}
plt.rcParams.update(STYLE)


def colors_of(study: Study) -> dict[str, tuple[str, str]]:
    """Colour and line style of every label; variants of one algorithm share the colour."""
    algos = {cell.label: cell.algo for cell in study.cells}
    others = itertools.cycle(OTHER_COLORS)
    colors = {algo: COLORS.get(algo) or next(others) for algo in dict.fromkeys(algos.values())}
    variants: dict[str, int] = {}
    found = {}
    for label, algo in algos.items():
        found[label] = (colors[algo], LINE_STYLES[variants.get(algo, 0) % len(LINE_STYLES)])
        variants[algo] = variants.get(algo, 0) + 1
    return found


def axis_of(runs: list[Run], over: str) -> tuple[str, float]:
    """The label and the divisor of an axis that holds these runs."""
    ends = [getattr(run.metrics, over)[-1] for run in runs if len(run.metrics)]
    long, short = AXES[over]
    return long if not ends or max(ends) >= SHORT_OF * long[1] else short


def legend_below(figure, axes) -> None:
    """One legend for all panels, under them, on so many rows as its words need."""
    entries: dict[str, object] = {}
    for one in np.ravel(axes):
        for handle, label in zip(*one.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    if not entries:
        return
    width, height = figure.get_size_inches()
    columns = max(1, min(len(entries), int(width / (0.55 + 0.062 * max(map(len, entries))))))
    inches = 0.08 + 0.17 * -(-len(entries) // columns)
    figure.set_size_inches(width, height + inches)
    figure.get_layout_engine().set(rect=(0, inches / (height + inches), 1, height / (height + inches)))
    figure.legend(entries.values(), entries.keys(), loc="lower center", ncols=columns, borderaxespad=0.1)


def learning_curves(study: Study, scenario: str):
    """J of training episodes over env frames and over wall time: the mean over seeds, and single seeds thinly."""
    figure, panels = plt.subplots(1, 2, figsize=(8.4, 2.9), sharey=True, layout="constrained")
    colors, drawn = colors_of(study), False
    units = {over: axis_of([run for cell in study.cells_of(scenario) for run in cell.runs], over) for over in AXES}
    for cell in study.cells_of(scenario):
        color, style = colors[cell.label]
        for axes, over in zip(panels, AXES):
            scale = units[over][1]
            for metric, line_style in ((SCORE, style), (EVALUATION, (0, (1, 1)))):
                words = cell.label if metric == SCORE else f"{cell.label}, greedy"
                look = {"color": color, "scale": scale, "linestyle": line_style}
                thin = cell.runs if len(cell.runs) > 1 else []
                line = draw_runs(axes, cell.drawn, words, metric=metric, over=over, thin=thin, **look)
                drawn = drawn or line is not None
    if not drawn:
        plt.close(figure)
        return None
    reference = study.references.get(scenario)
    for axes, over in zip(panels, AXES):
        axes.set_xlabel(units[over][0])
        axes.margins(x=0.01)
        if reference:
            draw_references(axes, reference.random, reference.scripted)
    panels[0].set_ylabel("J")
    figure.suptitle(scenario.replace("_", " "))
    legend_below(figure, panels)
    return figure


def wrapped(label: str) -> str:
    """A label in lines that leave an axis its room: a cell's may name several settings."""
    return "\n".join(textwrap.wrap(label, LABEL_WIDTH, break_on_hyphens=False))


def aggregate_figure(study: Study):
    """Interquartile means, performance profiles and probabilities of improvement of normalised scores."""
    common, scores, _ = normalised_scores(study)
    if not scores:
        return None
    colors = colors_of(study)
    labels = list(scores)
    pairs = [
        (a, b)
        for a in labels
        for b in labels
        if a != b
        and probability_of_improvement(scores[a], scores[b]) > 0.5
        or a < b
        and a != b
        and probability_of_improvement(scores[a], scores[b]) == 0.5
    ]
    pairs.sort(key=lambda pair: -probability_of_improvement(scores[pair[0]], scores[pair[1]]))
    rows, versus = [wrapped(label) for label in labels], [f"{wrapped(a)}\n> {wrapped(b)}" for a, b in pairs]
    lines = max(sum(text.count("\n") + 1 for text in texts) for texts in (rows, versus))
    height = max(2.6, 0.9 + 0.15 * lines + 0.1 * max(len(rows), len(versus)))
    figure, panels = plt.subplots(1, 3 if pairs else 2, figsize=(8.4, min(height, 9.0)), layout="constrained")
    means, profile = panels[0], panels[1]
    for row, label in enumerate(labels):
        color, style = colors[label]
        mean = interquartile_mean(scores[label])
        low, high = stratified_interval(lambda drawn: interquartile_mean(drawn), scores[label])
        means.plot([low, high], [row, row], color=color, linewidth=5, alpha=0.35, solid_capstyle="butt")
        means.plot([mean], [row], "|", color=color, markersize=13, markeredgewidth=2.2)
    means.set_yticks(range(len(labels)), rows)
    means.invert_yaxis()
    means.set_title("interquartile mean")
    means.set_xlabel("normalised J")
    everything = np.concatenate([np.concatenate(runs) for runs in scores.values()])
    span = max(0.05, everything.max() - min(0.0, everything.min()))
    thresholds = np.linspace(min(0.0, everything.min()) - 0.02 * span, everything.max() + 0.04 * span, 101)
    for label in labels:
        color, style = colors[label]
        profile.step(
            thresholds,
            performance_profile(scores[label], thresholds),
            where="post",
            color=color,
            linestyle=style,
            linewidth=1.6,
            label=label,
        )
        low, high = stratified_interval(
            lambda drawn: performance_profile(drawn, thresholds), scores[label], resamples=500
        )
        profile.fill_between(thresholds, low, high, step="post", color=color, alpha=0.12, linewidth=0)
    profile.set_title("performance profile")
    profile.set_xlabel("normalised J, t")
    profile.set_ylabel("share of runs with J > t")
    profile.set_ylim(-0.02, 1.02)
    if pairs:
        improvement = panels[2]
        for row, (better, worse) in enumerate(pairs):
            probability = probability_of_improvement(scores[better], scores[worse])
            low, high = stratified_interval(probability_of_improvement, scores[better], scores[worse])
            improvement.plot(
                [low, high], [row, row], color=colors[better][0], linewidth=5, alpha=0.35, solid_capstyle="butt"
            )
            improvement.plot([probability], [row], "|", color=colors[better][0], markersize=11, markeredgewidth=2.2)
        improvement.set_yticks(range(len(pairs)), versus)
        improvement.invert_yaxis()
        improvement.axvline(0.5, color="#777777", linewidth=1, linestyle="--")
        improvement.set_xlim(-0.02, 1.02)
        improvement.set_title("probability of improvement")
    legend_below(figure, panels)
    return figure


def gap_figure(gaps: list[Gap], algorithms: list[str], published: dict[str, dict]):
    """The strongest on-policy against the strongest off-policy cell of each scenario; the paper's beside it, hollow."""
    if not gaps:
        return None
    gaps = sorted(gaps, key=lambda one: one.gap)
    figure, axes = plt.subplots(figsize=(8.4, 0.9 + 0.34 * len(gaps)), layout="constrained")
    for row, one in enumerate(gaps):
        axes.barh(row, one.gap, height=0.55, color=COLORS["ippo"] if one.gap > 0 else COLORS["idqn"], zorder=2)
        axes.annotate(
            f" {one.on_policy} against {one.off_policy} ",
            (max(one.gap, 0), row),
            va="center",
            fontsize=7,
            color="#555555",
            annotation_clip=False,
        )
        entry = published.get(one.scenario.removesuffix(REFERENCE))
        if entry:
            values = {"on-policy": [], "off-policy": []}
            for algo, value in zip(algorithms, entry["printed"]):
                values[family(algo)].append(value)
            axes.plot(
                (max(values["on-policy"]) - max(values["off-policy"])) / entry["ceiling"],
                row,
                "D",
                markerfacecolor="white",
                markeredgecolor="#333333",
                markersize=5,
                zorder=3,
                label="paper, of its ceiling (orientation)" if row == 0 else None,
            )
    axes.set_yticks(range(len(gaps)), [one.scenario for one in gaps])
    axes.axvline(0, color="#555555", linewidth=0.8)
    axes.set_xlabel(
        "off-policy stronger  \N{LEFTWARDS ARROW}  normalised gap  \N{RIGHTWARDS ARROW}  on-policy stronger"
    )
    axes.set_title("strongest on-policy against strongest off-policy algorithm")
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, -0.05) - 0.05 * (high - low), max(high, 0.05) + 0.2 * (high - low))
    axes.grid(axis="y", visible=False)
    legend_below(figure, axes)
    return figure


def speed_figure(study: Study):
    """Env frames per second and policy lag of every run, by label."""
    cells = [cell for cell in study.cells if any(len(run.metrics) for run in cell.runs)]
    if not cells:
        return None
    colors = colors_of(study)
    rows = [wrapped(f"{cell.scenario}  {cell.label}") for cell in cells]
    height = 0.9 + sum(0.1 + 0.14 * (text.count("\n") + 1) for text in rows)
    figure, panels = plt.subplots(1, 2, figsize=(8.4, height), sharey=True, layout="constrained")
    for row, cell in enumerate(cells):
        for axes, name in zip(panels, ("perf/_fps", "train/version_diff_avg")):
            values = np.array(
                [
                    np.nanmean(run.metrics.column(name))
                    for run in cell.runs
                    if np.isfinite(run.metrics.column(name)).any()
                ]
            )
            axes.plot(values, np.full(len(values), row), "o", color=colors[cell.label][0], alpha=0.55, markersize=4.5)
            if len(values):
                axes.plot([values.mean()], [row], "|", color=colors[cell.label][0], markersize=12, markeredgewidth=2)
    panels[0].set_yticks(range(len(cells)), rows)
    panels[0].invert_yaxis()
    panels[0].set_title("throughput")
    panels[1].set_title("policy lag")
    panels[0].set_xlabel("env frames/s")
    panels[1].set_xlabel("policy lag (SGD steps)")
    for axes in panels:
        axes.set_xlim(left=0, right=1.05 * max(axes.get_xlim()[1], 1e-9))
    return figure


def diagnostics_figure(study: Study, scenario: str):
    """Mean over seeds of what shows whether learning works, over env frames."""
    cells = study.cells_of(scenario)
    shown = [
        (name, title)
        for name, title in DIAGNOSTICS
        if any(np.isfinite(run.metrics.column(name)).any() for cell in cells for run in cell.runs)
    ]
    if not shown:
        return None
    colors, columns = colors_of(study), 4
    words, scale = axis_of([run for cell in cells for run in cell.runs], "env_frames")
    rows = -(-len(shown) // columns)
    figure, panels = plt.subplots(
        rows, columns, figsize=(8.4, 1.45 * rows + 0.4), layout="constrained", squeeze=False, sharex=True
    )
    for axes, (name, title) in zip(panels.flat, shown):
        for cell in cells:
            color, style = colors[cell.label]
            look = {"color": color, "scale": scale, "linestyle": style, "linewidth": 1.2}
            line = draw_runs(axes, cell.drawn, cell.label, metric=name, thin=[], **look)
            if line is not None:
                line.set_label(cell.label)
        axes.set_title(title)
    for axes in panels.flat[len(shown) :]:
        axes.set_visible(False)
    for axes in panels.flat[max(0, len(shown) - columns) : len(shown)]:
        axes.set_xlabel(words)
        axes.tick_params(labelbottom=True)
    legend_below(figure, panels[:1])
    return figure


def occupancy_figure(occupancy: Occupancy):
    """One panel an agent: the share of its decisions in each cell of the plan."""
    lines, agents = occupancy.lines, len(occupancy.positions)
    xs, ys = lines[:, [0, 2]], lines[:, [1, 3]]
    left, right, bottom, top = xs.min(), xs.max(), ys.min(), ys.max()
    side = max(OCCUPANCY_CELL, max(right - left, top - bottom) / OCCUPANCY_CELLS_MAX)
    columns = min(agents, 4)
    rows = -(-agents // columns)
    width = 8.4 / columns
    height = min(4.6, max(1.2, width * (top - bottom) / max(1.0, right - left)))
    figure, panels = plt.subplots(
        rows, columns, figsize=(8.4, rows * (height + 0.25)), layout="constrained", squeeze=False
    )
    edges = [np.arange(low, high + side, side) for low, high in ((left, right), (bottom, top))]
    counts = [np.histogram2d(one[:, 0], one[:, 1], bins=edges)[0].T / len(one) for one in occupancy.positions]
    highest = max(one.max() for one in counts) or 1.0
    for agent, axes in enumerate(panels.flat):
        axes.set_axis_off()
        if agent >= agents:
            continue
        for blocks, color, line_width in ((0, "#d5d9de", 0.5), (1, "#4a5560", 0.8)):
            chosen = lines[lines[:, 4] == blocks]
            axes.add_collection(
                LineCollection(chosen[:, :4].reshape(-1, 2, 2), colors=color, linewidths=line_width, zorder=3)
            )
        shown = axes.imshow(
            np.ma.masked_equal(counts[agent], 0),
            origin="lower",
            interpolation="nearest",
            cmap="YlOrRd",
            zorder=2,
            extent=(edges[0][0], edges[0][-1], edges[1][0], edges[1][-1]),
            norm=PowerNorm(0.4, vmin=0, vmax=highest),
        )
        axes.set_title(f"agent {agent}")
        axes.set_xlim(left - side, right + side)
        axes.set_ylim(bottom - side, top + side)
        axes.set_aspect("equal")
    bar = figure.colorbar(shown, ax=panels, shrink=0.75, pad=0.01, format=PercentFormatter(1.0))
    bar.set_label(f"share of decisions in a cell of {side:.0f} units")
    bar.outline.set_visible(False)
    return figure


def cell_title(cell: Cell) -> str:
    return f"{cell.scenario}, {cell.label}"
