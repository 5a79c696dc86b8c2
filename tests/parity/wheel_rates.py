#!/usr/bin/env python3
"""The rate of vector environments from one installed package beside another: the wheel beside a build of the same machine.

    python3 tests/parity/wheel_rates.py FOLDER OTHER [--windows 200] [--scenario lava_pit]

Each FOLDER is on Python's path and has `comrad` in it (build/python; site-packages of an environment). Both play the same episodes in
separate processes, a short window of steps each in turn; what counts is processor time, so other programs change little. Prints the
medians in decisions per second of processor time, and the median and the quartiles of the windows' ratios. Not part of the test suite.
"""

import argparse
import os
import statistics
import subprocess
import sys

PLAYS = """
import sys, time
import comrad, numpy as np
envs = comrad.vector_env(sys.argv[1], num_envs=16, num_threads=1, copy=False, channels_first=True)
envs.reset(seed=1)
rng = np.random.default_rng(1)
actions = [rng.integers(envs.action_space.nvec) for _ in range(16)]
for line in sys.stdin:
    begin = time.process_time()
    for step in range(16):
        envs.step(actions[step])
    print(16 * 16 * envs.num_agents / (time.process_time() - begin), flush=True)
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs=2)
    parser.add_argument("--windows", type=int, default=200)
    parser.add_argument("--scenario", default="lava_pit")
    asked = parser.parse_args()
    players = [
        subprocess.Popen([sys.executable, "-c", PLAYS, asked.scenario], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                         env={**os.environ, "PYTHONPATH": folder})
        for folder in asked.folder
    ]  # fmt: skip
    rates = [[], []]
    for window in range(asked.windows + 1):
        for index in (0, 1) if window % 2 else (1, 0):
            player = players[index]
            player.stdin.write("\n")
            player.stdin.flush()
            if line := player.stdout.readline().strip():
                rates[index].append(float(line))
    for player in players:
        player.communicate()
    if any(len(rate) <= asked.windows for rate in rates):
        sys.exit("wheel_rates: one of them ended early; its words are above")
    one, other = (rate[1:] for rate in rates)  # the first windows warm up
    quarter, half, rest = statistics.quantiles([a / b for a, b in zip(one, other)], n=4)
    print(f"{asked.scenario}: {statistics.median(one):.0f} beside {statistics.median(other):.0f} decisions/s; ratio {half:.3f} (quartiles {quarter:.3f}, {rest:.3f})")


if __name__ == "__main__":
    main()
