"""Learning curves of single runs and of several seeds of one setting, over env frames or over wall time."""

import dataclasses

import numpy as np
from scipy import stats

from run_files import SCORE, Run

GRID_POINTS = 200


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


def draw_curve(axes, curve: Curve, label: str, color: str | None = None, scale: float = 1.0) -> str:
    """Draws mean and band on Matplotlib axes, x divided by `scale`; returns the colour that was used.

    The band of two runs, 12.7 standard errors to either side, may leave the picture."""
    (line,) = axes.plot(curve.x / scale, curve.mean, linewidth=1.8, color=color, label=label)
    if np.isfinite(curve.half_width).any():
        limits = axes.dataLim.frozen()
        axes.fill_between(
            curve.x / scale,
            curve.mean - curve.half_width,
            curve.mean + curve.half_width,
            color=line.get_color(),
            alpha=0.16,
            linewidth=0,
        )
        if curve.runs == 2:
            axes.dataLim.set(limits)
    return line.get_color()
