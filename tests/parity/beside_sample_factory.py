#!/usr/bin/env python3
"""Trains COMRAD and Sample Factory 2.1.1 on the same ViZDoom games and draws score against env frames and against time.

Both train IPPO (one agent: PPO) with the same network (three convolutions, 512 units, GRU 512), frame skip, number of
environments, rollout, batch and learning values, from pixels of 128x72, on the .cfg files that Sample Factory carries. The
score is the return of training episodes, the mean of the last 100, as both report it. Runs go one after the other, a seed of
each in turn, and may have other work beside them (--busy): they give the score against env frames.

    python3 -m venv SF && SF/bin/pip install sample-factory==2.1.1 'gymnasium<1' 'numpy<2' vizdoom==1.3.2 torch==2.13.0
    tests/parity/beside_sample_factory.py defend_the_center health_gathering_supreme --seeds 1 2 3 --sample_factory SF
    tests/parity/beside_sample_factory.py defend_the_center health_gathering_supreme --rates 3 --sample_factory SF

With --rates the machine must have nothing else to do: in each round each system trains for 0.3 M env frames, in turn. The medians over
rounds of the rate and of the seconds until the first frame make time of env frames. Without them the curves' own seconds do, except
those of curves that were made with --busy.

--rows gets a line a run as soon as it is over; a curve that is there is not made again. --picture draws what is there and prints
the tables of BENCHMARKS.md. Not part of the test suite: a run takes minutes.
"""
import argparse
import json
import math
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
FRAMES = 2e6
RATE_FRAMES = 3e5  # of a run that measures the rate
POINTS = 120  # of a curve, in the file of rows

# The settings of both. Values that their defaults share are written down too: a default may change.
SHARED = {
    'env_frameskip': 4, 'num_workers': 2, 'num_envs_per_worker': 8, 'worker_num_splits': 2,
    'rollout': 32, 'recurrence': 32, 'batch_size': 1024, 'num_batches_per_epoch': 1, 'num_epochs': 1,
    'num_batches_to_accumulate': 1, 'use_rnn': True, 'rnn_type': 'gru', 'rnn_size': 512,
    'encoder_conv_architecture': 'convnet_simple', 'normalize_input': True, 'normalize_returns': True,
    'gamma': 0.99, 'gae_lambda': 0.95, 'learning_rate': 4e-4, 'adam_eps': 1e-6, 'max_grad_norm': 4.0,
    'ppo_clip_ratio': 0.2, 'ppo_clip_value': 0.2, 'value_loss_coeff': 0.5, 'exploration_loss': 'symmetric_kl',
    'exploration_loss_coeff': 0.001, 'reward_scale': 1.0, 'reward_clip': 1000.0, 'with_vtrace': False,
    'experiment_summaries_interval': 5, 'stats_avg': 100,
}
# The choices of the action heads: for Sample Factory their numbers, for COMRAD their buttons, each after "none".
HEADS = {
    'defend_the_center': ('3,2', 'TURN_LEFT,TURN_RIGHT;ATTACK'),
    'health_gathering_supreme': ('5', 'TURN_LEFT,TURN_RIGHT,MOVE_FORWARD,MOVE_BACKWARD'),
}


def flags(settings):
    return [f'--{name}={value}' for name, value in settings.items()]


def run_comrad(asked, game, cfg, seed, folder, precision, env_frames):
    """The curve of one run, [(env frames, seconds, score)], and its seconds."""
    settings = {**SHARED, 'seed': seed, 'train_for_env_frames': env_frames, 'heads': HEADS[game][1], 'train_dir': folder,
                'experiment': game, 'precision': precision, 'algo': 'ippo', 'preset': 'small', 'scenario': cfg,
                'use_additional_input': False}  # Sample Factory gets pixels alone
    del settings['recurrence']  # COMRAD's is the rollout
    began = time.monotonic()
    subprocess.run([asked.comrad, 'train', *flags(settings)], check=True, stdout=subprocess.DEVNULL)
    seconds = time.monotonic() - began
    with open(pathlib.Path(folder, game, 'metrics.jsonl'), encoding='utf-8') as file:
        reports = [json.loads(line) for line in file]
    head = seconds - reports[-1]['time_s']  # what passed before the learner's clock began
    return [(one['env_frames'], head + one['time_s'], one['reward/reward'])
            for one in reports if one.get('reward/reward') is not None], seconds


def run_sample_factory(asked, game, cfg, seed, folder, env_frames):
    settings = {**SHARED, 'seed': seed, 'train_for_env_steps': int(env_frames), 'train_dir': folder, 'experiment': game,
                'env': game, 'device': 'cpu', 'algo': 'APPO', 'flush_summaries_interval': 5}
    settings['env'] = name = f'{game}_cfg'
    python = str(pathlib.Path(asked.sample_factory, 'bin', 'python'))
    began, began_at = time.monotonic(), time.time()
    subprocess.run([python, str(HERE / 'sample_factory_game.py'), name, cfg, HEADS[game][0], *flags(settings)], check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    seconds = time.monotonic() - began
    read = subprocess.run([python, '-c', READ_EVENTS, str(pathlib.Path(folder, game, '.summary', '0'))], check=True,
                          stdout=subprocess.PIPE, text=True)
    return [(step, wall - began_at, value) for step, wall, value in json.loads(read.stdout)], seconds


READ_EVENTS = '''
import json, sys
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
events = EventAccumulator(sys.argv[1], size_guidance={'scalars': 0})
events.Reload()
print(json.dumps([(one.step, one.wall_time, one.value) for one in events.Scalars('reward/reward')]))
'''


def thinned(curve):
    """At most POINTS of it, the last one among them."""
    step = max(1, math.ceil(len(curve) / POINTS))
    return [[int(frames), round(seconds, 1), round(score, 4)] for frames, seconds, score in curve[::-1][::step][::-1]]


def rows_of(path):
    if not path.exists():
        return []
    with open(path, encoding='utf-8') as file:
        return [json.loads(line) for line in file if line.strip()]


def cfg_of(asked, game):
    scenarios = next(pathlib.Path(asked.sample_factory).glob('lib/python3*/site-packages/sf_examples/vizdoom/doom/scenarios'))
    return str(scenarios / f'{game}.cfg')


def run_of(asked, system, game, seed, env_frames):
    folder = os.path.join(asked.train_dir, f'{system}_{seed}'.replace(' ', '_'))
    shutil.rmtree(os.path.join(folder, game), ignore_errors=True)  # a part of a run has no wall time
    if system == 'Sample Factory':
        return run_sample_factory(asked, game, cfg_of(asked, game), seed, folder, env_frames)
    return run_comrad(asked, game, cfg_of(asked, game), seed, folder, system.split()[1], env_frames)


def append_row(asked, row):
    with open(asked.rows, 'a', encoding='utf-8') as file:
        file.write(json.dumps(row) + '\n')


def measure_rates(asked):
    for game in asked.games:
        for _ in range(asked.rates):
            for system in asked.systems:
                curve, _ = run_of(asked, system, game, asked.seeds[0], RATE_FRAMES)
                rate, start_s = rate_and_start(curve)
                append_row(asked, {'system': system, 'game': game, 'date': time.strftime('%Y-%m-%d'), 'rate': round(rate, 1),
                                   'start_s': round(start_s, 1)})


def train_all(asked):
    for game in asked.games:
        for seed in asked.seeds:
            for system in asked.systems:
                key = {'system': system, 'game': game, 'seed': seed}
                if any(row.items() >= key.items() and 'curve' in row for row in rows_of(asked.rows)):
                    continue
                curve, seconds = run_of(asked, system, game, seed, FRAMES)
                append_row(asked, {**key, 'date': time.strftime('%Y-%m-%d'), 'seconds': round(seconds, 1),
                                   **({'busy': True} if asked.busy else {}), 'curve': thinned(curve)})


def score_at(curve, column, at):
    """The score when env frames (column 0) or seconds (column 1) reach `at`; None where the curve ends before."""
    for before, after in zip(curve, curve[1:]):
        if before[column] <= at <= after[column]:
            share = (at - before[column]) / ((after[column] - before[column]) or 1)
            return before[2] + share * (after[2] - before[2])
    return None


def rate_and_start(curve):
    """Env frames a second between the first report and the last, and the seconds that passed before the first frame."""
    rate = (curve[-1][0] - curve[0][0]) / (curve[-1][1] - curve[0][1])
    return rate, curve[0][1] - curve[0][0] / rate


def mean_and_range(values):
    text = '{:.0f}' if values and min(values) > 100 else '{:.3g}'
    return f'{text} ({text} to {text})'.format(statistics.mean(values), min(values), max(values)) if values else ''


def draw(asked):
    """The picture, and the table: score at parts of the frames, at equal times, rates."""
    import matplotlib
    matplotlib.use('svg' if str(asked.picture).endswith('.svg') else 'agg')
    import matplotlib.pyplot as plt
    rows = rows_of(asked.rows)
    # One system's curves are no comparison, and curves of a busy machine have no time without a measured rate.
    timed = {(row['game'], row['system']) for row in rows if 'rate' in row or not row.get('busy')}
    games = [game for game in HEADS if sum(of == game for of, _ in timed) > 1]
    systems = list(dict.fromkeys(row['system'] for row in rows))
    figure, axes = plt.subplots(len(games), 2, figsize=(9, 3.2 * len(games)), squeeze=False, sharey='row')
    print('| game | system | seeds | env frames/s | score at 0.5 M | at 1 M | at 1.5 M | at 2 M | after 3 min |')
    print('| --- | --- | --- | --- | --- | --- | --- | --- | --- |')
    for line, game in enumerate(games):
        for number, system in enumerate(systems):
            mine = [row for row in rows if row['game'] == game and row['system'] == system]
            curves = [row['curve'] for row in mine if 'curve' in row]
            measured = [(row['rate'], row['start_s']) for row in mine if 'rate' in row]
            measured = measured or [rate_and_start(row['curve']) for row in mine if 'curve' in row and not row.get('busy')]
            if not curves or not measured:
                continue
            rate, start_s = (statistics.median(values) for values in zip(*measured))
            curves = [[[frames, start_s + frames / rate, score] for frames, _, score in curve] for curve in curves]
            for curve in curves:
                label = system if curve is curves[0] else None
                axes[line][0].plot([p[0] / 1e6 for p in curve], [p[2] for p in curve], color=f'C{number}', lw=1.2, label=label)
                axes[line][1].plot([p[1] / 60 for p in curve], [p[2] for p in curve], color=f'C{number}', lw=1.2, label=label)
            cells = [mean_and_range([score_at(curve, 0, at) for curve in curves if score_at(curve, 0, at) is not None])
                     for at in (0.5e6, 1e6, 1.5e6)]
            cells.append(mean_and_range([curve[-1][2] for curve in curves if curve[-1][0] > 0.98 * FRAMES]))
            cells.append(mean_and_range([score_at(curve, 1, 180) for curve in curves if score_at(curve, 1, 180) is not None]))
            rates = mean_and_range([one for one, _ in measured])
            print(f'| {game} | {system} | {len(curves)} | {rates} | ' + ' | '.join(cells) + ' |')
        axes[line][0].set(title=game, xlabel='env frames, millions', ylabel='return of the last 100 episodes')
        axes[line][1].set(title=game, xlabel='minutes since the start', xscale='log')
        axes[line][0].legend()
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(asked.picture, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('games', nargs='*', help=' '.join(HEADS))
    parser.add_argument('--seeds', nargs='+', type=int, default=[1, 2, 3])
    parser.add_argument('--rates', type=int, default=0, metavar='ROUNDS', help='measure rates in so many rounds, train no curve')
    parser.add_argument('--busy', action='store_true', help='other work runs beside the curves: their seconds say nothing')
    parser.add_argument('--systems', nargs='+', default=['COMRAD fp32', 'COMRAD bf16', 'Sample Factory'])
    parser.add_argument('--comrad', default=str(HERE.parents[1] / 'comrad'))
    parser.add_argument('--sample_factory', help='the virtual environment that has it')
    parser.add_argument('--train_dir', default='/tmp/beside_sample_factory')
    parser.add_argument('--rows', type=pathlib.Path, default=HERE / 'beside_sample_factory.jsonl')
    parser.add_argument('--picture', type=pathlib.Path, help='draw what the rows hold, after the runs if games are '
                        'named; a system whose rate was not measured is left out')
    asked = parser.parse_args()
    unknown = [game for game in asked.games if game not in HEADS]
    if unknown:
        parser.error(f'{unknown[0]}: the games are {", ".join(HEADS)}')
    if asked.games and not asked.sample_factory:
        parser.error('--sample_factory: name the virtual environment that has Sample Factory')
    if asked.games and asked.rates > 0:
        measure_rates(asked)
    elif asked.games:
        train_all(asked)
    if asked.picture:
        draw(asked)
    return 0


if __name__ == '__main__':
    sys.exit(main())
