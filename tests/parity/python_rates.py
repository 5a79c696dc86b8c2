#!/usr/bin/env python3
"""How fast environments are from Python: the package beside `comrad bench sim`, ViZDoom's Gymnasium wrapper and EnvPool.

    taskset -c 0 python3 tests/parity/python_rates.py --comrad build/bin/comrad [--seconds 8] [--rounds 3]

Everything on the one core that the process was given, actions drawn at random by NumPy outside the clock where a batch takes
them. First two agents of Co-op Health Gathering at 128x72; then one player of ViZDoom's health_gathering.cfg at 160x120, the
same pictures from all, frame skip 4. A decision is one agent's. Rounds are interleaved; the table has medians, spread and ratios.
Needs comrad and vizdoom (deploy/requirements_test.txt); envpool 1.2.5 where it is there. Not part of the test suite.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import time

import numpy as np


def timed(step, decisions_a_step, seconds):
    """Decisions a second of `step()`, after a tenth of the time as warm-up."""
    for limit in (seconds / 10, seconds):
        steps, began = 0, time.perf_counter()
        while time.perf_counter() - began < limit:
            step()
            steps += 1
        rate = steps * decisions_a_step / (time.perf_counter() - began)
    return rate


def bench_sim(asked, scenario):
    answer = subprocess.run([asked.comrad, 'bench', 'sim', '--scenario', scenario, '--seconds', str(asked.seconds), '--json'],
                            check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(answer.stdout.splitlines()[-1])['decisions_per_s']


def comrad_vector(asked, scenario, **options):
    import comrad
    envs = comrad.vector_env(scenario, num_envs=8, num_threads=1, **options)
    envs.reset(seed=1)
    rng = np.random.default_rng(1)
    actions = [rng.integers(envs.action_space.nvec) for _ in range(64)]
    turn = iter(range(1 << 60))
    rate = timed(lambda: envs.step(actions[next(turn) % 64]), 8 * envs.num_agents, asked.seconds)
    envs.close()
    return rate


def one_at_a_time(asked, env):
    rng = np.random.default_rng(1)
    actions = [rng.integers(0, 2, env.action_space.n).astype(np.int8) for _ in range(64)]
    env.reset(seed=1)
    turn = iter(range(1 << 60))

    def step():
        _, _, terminated, truncated, _ = env.step(actions[next(turn) % 64])
        if terminated or truncated:
            env.reset()

    rate = timed(step, 1, asked.seconds)
    env.close()
    return rate


def comrad_gym(asked, cfg):
    import comrad
    return one_at_a_time(asked, comrad.gym_env(cfg, size=(160, 120), frame_skip=4))


def vizdoom_gym(asked, cfg):
    from vizdoom.gymnasium_wrapper.base_gymnasium_env import VizdoomEnv
    return one_at_a_time(asked, VizdoomEnv(cfg, frame_skip=4, screen_resolution='RES_160X120', sound_enabled=False))


def envpool(asked, cfg):
    import envpool as pool
    envs = pool.make_gymnasium('HealthGathering-v1', num_envs=8, batch_size=8, num_threads=1, frame_skip=4, stack_num=1, img_height=120,
                               img_width=160, cfg_path=cfg, wad_path=os.path.splitext(cfg)[0] + '.wad', seed=1)
    envs.reset()
    shape, rng = envs.action_space.shape, np.random.default_rng(1)
    actions = [rng.integers(0, 2, (8, *shape)).astype(envs.action_space.dtype) for _ in range(64)]
    turn = iter(range(1 << 60))
    rate = timed(lambda: envs.step(actions[next(turn) % 64]), 8, asked.seconds)
    envs.close()
    return rate


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--comrad', default='./comrad')
    parser.add_argument('--seconds', type=float, default=8)
    parser.add_argument('--rounds', type=int, default=3)
    asked = parser.parse_args()
    if len(os.sched_getaffinity(0)) != 1:
        parser.error('start it on one core: taskset -c 0 ...')
    import vizdoom
    cfg = os.path.join(vizdoom.scenarios_path, 'health_gathering.cfg')
    scenario = 'coop_health_gathering'
    groups = [
        ('coop_health_gathering, 2 agents, 128x72', {
            '`comrad bench sim` (C++)': lambda: bench_sim(asked, scenario),
            '`vector_env(copy=False, channels_first=True)`': lambda: comrad_vector(asked, scenario, copy=False, channels_first=True),
            '`vector_env()`': lambda: comrad_vector(asked, scenario),
        }),
        ('health_gathering.cfg, 1 player, 160x120', {
            '`comrad.vector_env`, 8 environments': lambda: comrad_vector(asked, cfg, num_agents=1, size=(160, 120)),
            '`comrad.gym_env`': lambda: comrad_gym(asked, cfg),
            "ViZDoom 1.3.2's Gymnasium wrapper": lambda: vizdoom_gym(asked, cfg),
            'EnvPool 1.2.5 (ViZDoom inside), 8 environments': lambda: envpool(asked, cfg),
        }),
    ]
    print('| game | what | decisions/s on one core | of the first |')
    print('| --- | --- | --- | --- |')
    for game, ways in groups:
        rates = {name: [] for name in ways}
        for _ in range(asked.rounds):
            for name, measure in ways.items():
                try:
                    rates[name].append(measure())
                except Exception as error:  # noqa: BLE001 (a peer that is not there, or fails, has no row)
                    print(f'{name}: {error!r}', file=sys.stderr)
        first = None
        for name, found in rates.items():
            if not found:
                continue
            median = statistics.median(found)
            first = first or median
            print(f'| {game} | {name} | {median:.0f} ({min(found):.0f} to {max(found):.0f}) | {median / first:.2f} |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
