#!/usr/bin/env python3
"""The rate of vector environments from one installed package beside another: the wheel beside a build of the same machine.

    python3 tests/parity/wheel_rates.py FOLDER OTHER [--rounds 9] [--scenario lava_pit]

Each FOLDER is on Python's path and has `comrad` in it (build/python; site-packages of an environment). In each round both play the same
episodes, in turn, in separate processes; what counts is processor time, so other programs change little. Prints the medians in decisions
per second of processor time, their ratio and the span of the rounds' ratios. Not part of the test suite.
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
actions = [rng.integers(envs.action_space.nvec) for _ in range(64)]
for step in range(int(sys.argv[2])):
    if step == 50:
        begin = time.process_time()
    envs.step(actions[step % 64])
print((int(sys.argv[2]) - 50) * 16 * envs.num_agents / (time.process_time() - begin))
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs=2)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--scenario", default="lava_pit")
    parser.add_argument("--steps", type=int, default=1500)
    asked = parser.parse_args()
    rates = {folder: [] for folder in asked.folder}
    for turn in range(asked.rounds):
        for folder in asked.folder[:: 1 if turn % 2 else -1]:
            done = subprocess.run([sys.executable, "-c", PLAYS, asked.scenario, str(asked.steps)], check=True, stdout=subprocess.PIPE, text=True,
                                  env={**os.environ, "PYTHONPATH": folder})
            rates[folder].append(float(done.stdout))
    one, other = (rates[folder] for folder in asked.folder)
    ratios = [a / b for a, b in zip(one, other)]
    print(f"{asked.scenario}: {statistics.median(one):.0f} beside {statistics.median(other):.0f} decisions/s, ratio {statistics.median(one) / statistics.median(other):.3f} "
          f"(rounds {min(ratios):.3f} to {max(ratios):.3f})")


if __name__ == "__main__":
    main()
