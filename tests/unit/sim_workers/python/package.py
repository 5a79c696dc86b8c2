"""What the package's tests share: the package itself, or the end of the test with 77 where it is not there."""

import os
import sys
import tempfile

try:
    import gymnasium  # noqa: F401
    import numpy as np
    import pettingzoo  # noqa: F401

    import comrad
except ImportError as missing:
    print(f"[  SKIPPED ] 1 test, Python package: {missing}; ./comrad test builds it and installs what it needs "
          "(Debian: python3-dev; PyPI: deploy/requirements_test.txt)")
    sys.exit(77)

_logs = tempfile.TemporaryDirectory()  # Stable-Baselines3 makes a folder for every model
os.environ["SB3_LOGDIR"] = _logs.name


def random_actions(env, rng):
    """For every agent of a ParallelEnv, from `rng` alone."""
    return {agent: rng.integers(env.action_space(agent).nvec) for agent in env.agents}


def equal(a, b) -> bool:
    """Observations of any shape, to the bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    return a.dtype == b.dtype and np.array_equal(a, b)


__all__ = ["comrad", "equal", "random_actions"]
