"""Means, aggregates over scenarios and their intervals.

Scores of one algorithm are a list with one array for each scenario, which holds a score for each run (seed). Scenarios may
have different numbers of runs, but each weighs the same; a bootstrap draws runs within a scenario (strata) and keeps every scenario.

Source: Agarwal et al. 2021, Deep Reinforcement Learning at the Edge of the Statistical Precipice, arXiv:2108.13264,
sections 4.1 to 4.3. tests/unit/deploy/report compares these functions with the authors' package rliable.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

LEVEL = 0.95
RESAMPLES = 2000

Scores = Sequence[np.ndarray]


def student_interval(values: np.ndarray) -> tuple[float, float]:
    """Two-sided 95 % interval of the mean of [n] values: mean +- t(0.975, n - 1) s / sqrt(n). NaN for fewer than two."""
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        return np.nan, np.nan
    half = stats.t.ppf((1 + LEVEL) / 2, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)


def bootstrap_interval(values: np.ndarray, resamples: int = RESAMPLES, seed: int = 0) -> tuple[float, float]:
    """95 % percentile interval of the mean of [n] values. NaN for fewer than two."""
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        return np.nan, np.nan
    generator = np.random.default_rng(seed)
    means = values[generator.integers(len(values), size=(resamples, len(values)))].mean(axis=1)
    return percentiles(means)


def percentiles(values: np.ndarray) -> tuple[float, float]:
    """The middle 95 % of [n] resampled values."""
    low, high = np.percentile(values, [50 * (1 - LEVEL), 50 * (1 + LEVEL)])
    return float(low), float(high)


def interquartile_mean(scores: Scores) -> float:
    """Mean of the middle half of all runs of all scenarios: robust to single runs, yet every scenario counts. Runs of a scenario that
    has fewer count several times."""
    most = math.lcm(*map(len, scores))
    values = np.concatenate([np.repeat(runs, most // len(runs)) for runs in scores])
    values.sort()  # a third of the time of SciPy's trim_mean, thousands of times a report
    cut = len(values) // 4
    return float(values[cut : len(values) - cut].mean())


def performance_profile(scores: Scores, thresholds: np.ndarray) -> np.ndarray:
    """Share of a scenario's runs that score more than each of [K] thresholds, averaged over scenarios: [K] f64, falling."""
    return np.mean([(np.asarray(runs)[:, None] > thresholds).mean(axis=0) for runs in scores], axis=0)


def probability_of_improvement(better: Scores, worse: Scores) -> float:
    """P(a run of `better` scores more than one of `worse`) in a scenario, ties half, averaged over scenarios.

    Both have the same scenarios in the same order. It is the Mann-Whitney U statistic over the number of pairs."""
    return float(np.mean([(np.greater.outer(x, y) + 0.5 * np.equal.outer(x, y)).mean() for x, y in zip(better, worse)]))


def resampled(scores: Scores, generator: np.random.Generator) -> list[np.ndarray]:
    """As many runs of each scenario, drawn with replacement from its own."""
    return [runs[generator.integers(len(runs), size=len(runs))] for runs in scores]


def stratified_interval(
    statistic: Callable[..., np.ndarray | float], *scores: Scores, resamples: int = RESAMPLES, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """95 % percentile interval of statistic(*scores), each algorithm's runs drawn anew within each scenario.

    NaN where no scenario has two runs of any: there is nothing to draw from."""
    generator = np.random.default_rng(seed)
    if all(len(runs) < 2 for one in scores for runs in one):
        nothing = np.full(np.shape(statistic(*scores)), np.nan)
        return nothing, nothing
    drawn = np.array([statistic(*(resampled(one, generator) for one in scores)) for _ in range(resamples)])
    low, high = np.percentile(drawn, [50 * (1 - LEVEL), 50 * (1 + LEVEL)], axis=0)
    return low, high
