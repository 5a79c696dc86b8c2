#!/usr/bin/env python3
"""Trains on ViZDoom's own .cfg files and compares the policies with random play.

For each game and seed: `comrad train` to --env_frames (a run that was interrupted continues), then 100 greedy episodes against
100 of random play, Welch's test (one-sided; of so many episodes the normal distribution stands for Student's). One line a
run goes to standard output as a row of a Markdown table and to --rows as JSON; a row that is there is not made again.

    tests/parity/vizdoom_games.py basic take_cover --seeds 1 2 3 --train_dir DIR --rows DIR/rows.jsonl

Needs a Python with the package vizdoom for its files alone. Not part of the test suite: a run takes minutes to hours.
"""
import argparse
import json
import math
import os
import subprocess
import sys
import time


def comrad(program, *words):
    """Standard output of a command; what it reports on standard error goes through."""
    return subprocess.run([program, *words], check=True, stdout=subprocess.PIPE, text=True).stdout


def evaluate(program, policy, episodes, more):
    """Returns J of each episode."""
    answer = comrad(program, 'eval', '--policy', policy, '--episodes', str(episodes), '--each', '--json', *more)
    return [one['J'] for one in json.loads(answer)['each']]


def moments(values):
    mean = sum(values) / len(values)
    return mean, sum((value - mean) ** 2 for value in values) / (len(values) - 1)


def welch(ours, others):
    """Mean of each, and the chance that `ours` would be so much higher if both were alike."""
    (mean, variance), (other_mean, other_variance) = moments(ours), moments(others)
    error = math.sqrt(variance / len(ours) + other_variance / len(others))
    if error == 0:
        return mean, other_mean, 0.0 if mean > other_mean else 1.0
    return mean, other_mean, 0.5 * math.erfc((mean - other_mean) / error / math.sqrt(2))


def rows_of(path):
    if not os.path.exists(path):
        return []
    with open(path, encoding='utf-8') as file:
        return [json.loads(line) for line in file if line.strip()]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('games', nargs='+', help='names of .cfg files in the folder of the package, or paths')
    parser.add_argument('--seeds', nargs='+', type=int, default=[1])
    parser.add_argument('--env_frames', type=float, default=2e6)
    parser.add_argument('--episodes', type=int, default=100)
    parser.add_argument('--comrad', default='./comrad')
    parser.add_argument('--train_dir', required=True)
    parser.add_argument('--rows', required=True)
    parser.add_argument('--train_flags', nargs=argparse.REMAINDER, default=[], help='all that follows goes to `comrad train`')
    asked = parser.parse_args()
    random_play = {}
    for game in asked.games:
        path = game
        if not game.endswith('.cfg'):
            import vizdoom  # for its files alone
            path = os.path.join(vizdoom.scenarios_path, game + '.cfg')
        name = os.path.splitext(os.path.basename(path))[0]
        agents = ['--num_agents', '2'] if name == 'multi_duel' else []
        for seed in asked.seeds:
            key = {'game': name, 'seed': seed, 'env_frames': asked.env_frames}
            if any(row.items() >= key.items() for row in rows_of(asked.rows)):
                continue
            run, began = f'{name}_{seed}', time.monotonic()
            comrad(asked.comrad, 'train', '--scenario', path, '--algo', 'ippo', '--preset', 'small', '--seed', str(seed),
                   '--train_for_env_frames', str(asked.env_frames), '--train_dir', asked.train_dir, '--experiment', run,
                   *agents, *asked.train_flags)
            train_s = time.monotonic() - began
            if name not in random_play:
                random_play[name] = evaluate(asked.comrad, 'random', asked.episodes,
                                             ['--scenario', path, '--seed', '1', *agents])
            ours = evaluate(asked.comrad, os.path.join(asked.train_dir, run), asked.episodes, ['--seed', '1'])
            mean, random_mean, p = welch(ours, random_play[name])
            row = {**key, 'J': mean, 'random': random_mean, 'p': p, 'train_s': round(train_s), 'episodes': asked.episodes}
            with open(asked.rows, 'a', encoding='utf-8') as file:
                file.write(json.dumps(row) + '\n')
            print(f'| {name} | {seed} | {asked.env_frames:.3g} | {random_mean:.4g} | {mean:.4g} | {p:.2g} | {train_s:.0f} |',
                  flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
