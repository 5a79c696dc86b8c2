#!/usr/bin/env python3
"""The aggregates of `comrad report` agree with rliable, the package of their authors.

    rliable_test.py [--venv FOLDER]

Needs a Python with rliable: COMRAD_TEST_PYTHON alone where that is set, else the one in --venv, which `./comrad test` makes.
Skipped with code 77 where it has none.
"""

import argparse
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[3] / "deploy" / "report"))
SKIPPED = 77
HAS_RLIABLE = "import importlib.util, sys; sys.exit(importlib.util.find_spec('rliable') is None)"  # to import it takes seconds
RESAMPLES = 500  # of both bootstraps; their quantiles then differ by some 4 % of an interval's width


def find_python(venv: str) -> str | None:
    chosen = os.environ.get("COMRAD_TEST_PYTHON")
    for python in [chosen] if chosen else [os.path.join(venv, "bin", "python"), sys.executable]:
        if (
            os.path.exists(python)
            and subprocess.run([python, "-c", HAS_RLIABLE]).returncode == 0
        ):
            return python
    return None


def compare() -> int:
    import numpy as np
    from rliable import library, metrics

    import intervals

    failed = 0

    def check(what: str, ours, theirs, tolerance: float) -> None:
        nonlocal failed
        difference = float(np.max(np.abs(np.asarray(ours) - np.asarray(theirs))))
        good = difference <= tolerance
        failed += not good
        print(f"{'ok  ' if good else 'FAIL'} {what}: differs by {difference:.3g}, at most {tolerance:g}")

    generator = np.random.default_rng(3)
    np.random.seed(0)  # rliable draws from numpy's own generator, whatever its random_state
    thresholds = np.linspace(-0.5, 2.0, 41)
    for runs, scenarios in ((5, 13), (3, 4), (10, 2)):
        x = generator.gamma(2.0, 0.3, (runs, scenarios)) + np.linspace(0, 0.4, scenarios)
        y = np.round(x + generator.normal(0.1, 0.3, (runs, scenarios)), 1)  # ties too
        ours_x, ours_y = list(x.T), list(y.T)
        size = f"{runs} runs of {scenarios} scenarios"
        check(f"interquartile mean, {size}", intervals.interquartile_mean(ours_x), metrics.aggregate_iqm(x), 1e-12)
        check(
            f"probability of improvement, {size}",
            intervals.probability_of_improvement(ours_x, ours_y),
            metrics.probability_of_improvement(x, y),
            1e-12,
        )
        check(
            f"performance profile, {size}",
            intervals.performance_profile(ours_x, thresholds),
            library.create_performance_profile({"x": x}, thresholds, reps=2)[0]["x"],
            1e-12,
        )
        # Two bootstraps agree within their own noise.
        theirs = library.get_interval_estimates(
            {"x": x},
            lambda one: np.array([metrics.aggregate_iqm(one)]),
            reps=RESAMPLES,
        )[1]["x"]
        ours = intervals.stratified_interval(lambda one: intervals.interquartile_mean(one), ours_x, resamples=RESAMPLES)
        check(f"its interval, {size}", ours, theirs.ravel(), 0.12 * float(np.ptp(theirs)))
        theirs = library.get_interval_estimates(
            {"x,y": (x, y)},
            lambda a, b: np.array([metrics.probability_of_improvement(a, b)]),
            reps=RESAMPLES,
        )[1]["x,y"]
        ours = intervals.stratified_interval(intervals.probability_of_improvement, ours_x, ours_y, resamples=RESAMPLES)
        check(f"interval of the improvement, {size}", ours, theirs.ravel(), 0.12 * float(np.ptp(theirs)))
    print(f"{failed} failed")
    return 1 if failed else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", default=str(HERE.parents[3] / "build" / "test-python"))
    arguments = parser.parse_args()
    try:
        import rliable  # noqa: F401 (only asked whether it is there)
    except ImportError:
        python = find_python(arguments.venv)
        if python is None:
            print(
                "[  SKIPPED ] 1 test, aggregates against rliable: no Python here has rliable; ./comrad test installs it "
                "(deploy/requirements_test.txt), or set COMRAD_TEST_PYTHON to one that has it"
            )
            return SKIPPED
        os.execv(python, [python, "-B", *sys.argv])
    return compare()


if __name__ == "__main__":
    sys.exit(main())
