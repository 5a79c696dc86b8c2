"""Learning curves of single runs and of several seeds of one setting, over env frames or over wall time."""

import dataclasses

import numpy as np
from scipy import stats

from run_files import SCORE, Run
from tables import rounded

GRID_POINTS = 200
BAND_RUNS = 4  # so many have a band
REFERENCE_COLOR = "#666666"


@dataclasses.dataclass
class Curve:
    """A mean over runs with its 95 % interval (Student t); without one where there is a single run.

    x           [P] f64  env frames or seconds that all the runs cover
    mean        [P] f64
    half_width  [P] f64, NaN for a single run
    runs        how many
    """

    x: np.ndarray
    mean: np.ndarray
    half_width: np.ndarray
    runs: int


def value_at(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """y of the last report at or before each of [P] places; of the first report before that."""
    return y[np.maximum(0, np.searchsorted(x, at, side="right") - 1)]


def curve_over_runs(runs: list[Run], name: str = SCORE, over: str = "env_frames") -> Curve | None:
    """The mean of metric `name` over the runs that report it; None where none does, or where they share no stretch.

    over   "env_frames", or "time_s" for seconds of training."""
    series = [(x, y) for x, y in (run.metrics.series(name, over) for run in runs) if len(x)]
    if not series:
        return None
    if len(series) == 1:
        x, y = series[0]
        if len(x) > GRID_POINTS:  # the page needs no more
            grid = np.linspace(x[0], x[-1], GRID_POINTS)
            x, y = grid, np.interp(grid, x, y)
        return Curve(x, y, np.full(len(x), np.nan), 1)
    begin, end = max(x[0] for x, _ in series), min(x[-1] for x, _ in series)
    if begin > end:
        return None
    grid = np.linspace(begin, end, GRID_POINTS)
    values = np.array([np.interp(grid, x, y) for x, y in series])
    half_width = stats.t.ppf(0.975, len(values) - 1) * values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return Curve(grid, values.mean(axis=0), half_width, len(values))


def draw_runs(
    axes,
    runs: list[Run],
    label: str,
    *,
    metric: str = SCORE,
    over: str = "env_frames",
    color: str | None = None,
    scale: float = 1.0,
    linestyle="-",
    linewidth: float = 1.8,
    thin: list[Run] | None = None,
):
    """Draws the mean of `runs` on Matplotlib axes, x divided by `scale`; returns its line, or None where there is nothing to draw.

    thin   runs that are drawn thinly beside it; None: `runs`, where there are several

    From BAND_RUNS runs on the mean has its band. The interval of two is 12.7 standard errors to either side and that of three
    4.3: it would fill the panel, and the lines of the runs say more."""
    curve = curve_over_runs(runs, metric, over)
    if curve is None:
        return None
    has_band = curve.runs >= BAND_RUNS
    words = f" (mean of {curve.runs}{', 95 %' if has_band else ''})" if curve.runs > 1 else ""
    is_point = np.unique(curve.x[np.isfinite(curve.mean)]).size == 1  # a short run; a line needs two reports
    (line,) = axes.plot(
        curve.x / scale,
        curve.mean,
        linewidth=linewidth,
        color=color,
        linestyle=linestyle,
        marker="o" if is_point else None,
        label=label + words,
    )
    if has_band:
        low, high = curve.mean - curve.half_width, curve.mean + curve.half_width
        axes.fill_between(curve.x / scale, low, high, color=line.get_color(), alpha=0.16, linewidth=0)
    for run in (runs if curve.runs > 1 else []) if thin is None else thin:
        x, y = run.metrics.series(metric, over)
        axes.plot(x / scale, y, color=line.get_color(), alpha=0.45, linewidth=0.6, linestyle=linestyle)
    return line


def draw_references(axes, random: float | None, scripted: float | None) -> None:
    """Level lines at the scores of random play and of the scripted team, None for one that is not known.

    A line that would flatten the curves is words at the edge of the panel instead."""
    texts = {True: [], False: []}
    for score, words, style, heights in ((random, "random play", ":", 2.0), (scripted, "scripted team", "--", 0.35)):
        if score is None:
            continue
        low, high = axes.get_ylim()
        if low - heights * (high - low) <= score <= high + heights * (high - low):
            axes.axhline(score, color=REFERENCE_COLOR, linestyle=style, linewidth=1, label=words, zorder=0.9)
        else:
            texts[score > high].append(f"{words}: {rounded(score)} {chr(0x2191 if score > high else 0x2193)}")
    for above, lines in texts.items():
        axes.annotate(
            "\n".join(lines),
            (0.02, 0.98 if above else 0.02),
            xycoords="axes fraction",
            va="top" if above else "bottom",
            fontsize="small",
            color=REFERENCE_COLOR,
            zorder=1,  # under the curves
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1},
        )
