#!/usr/bin/env python3
"""Plays a run's policy in the real ViZDoom and compares its mean return with the one that `comrad eval` finds.

The run was trained on a ViZDoom .cfg (comrad train --scenario FILE.cfg) with one agent. Greedy actions, the run's frame
skip; ViZDoom draws 640x480, of which every 128x72 view takes the nearest pixels: ours is drawn at 128x72 with the
projection of a 4:3 screen.

    tests/parity/vizdoom_policy.py train_dir/RUN --episodes 100

Prints one JSON object: both means, the 95 % interval of ours and whether ViZDoom's lies in it; exit code 1 where it does
not. Needs a Python with torch, numpy and vizdoom. Not part of the test suite: it takes a trained run.
"""
import argparse
import glob
import json
import os
import subprocess
import sys

import torch
import vizdoom as vzd

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../learner/checkpoint'))
import load_policy  # noqa: E402

IWAD = os.environ.get('COMRAD_IWAD', '/usr/share/games/doom/freedoom2.wad')


def latest_checkpoint(run):
    files = glob.glob(os.path.join(run, 'checkpoint/checkpoint_*.pt'))
    return max(files, key=lambda name: int(os.path.basename(name).split('_')[1]))


def presses(heads, names, choice):
    """What `choice` of each head gives to the buttons `names`, in their order."""
    values = dict.fromkeys(names, 0.0)
    for head, index in zip(heads, choice):
        if index > 0:
            name, _, number = head[index - 1].partition('=')
            values[name] = float(number or 1)
    return list(values.values())


def frame_of(game):
    """[1, 3, 72, 128] u8 of what the player sees."""
    screen = torch.from_numpy(game.get_state().screen_buffer.copy()).permute(2, 0, 1)  # RGB24: [480, 640, 3]
    rows = ((torch.arange(72) + 0.5) * screen.shape[1] / 72).long()
    columns = ((torch.arange(128) + 0.5) * screen.shape[2] / 128).long()
    return screen[:, rows][:, :, columns][None]


def play(policy, described, cfg, episodes, frame_skip):
    """Returns of so many episodes in ViZDoom."""
    game = vzd.DoomGame()
    game.load_config(cfg)
    game.set_doom_game_path(IWAD)
    game.set_mode(vzd.Mode.PLAYER)
    game.set_window_visible(False)
    game.set_screen_format(vzd.ScreenFormat.RGB24)
    game.set_screen_resolution(vzd.ScreenResolution.RES_640X480)
    game.init()
    names = [button.name for button in game.get_available_buttons()]
    returns = []
    for episode in range(episodes):
        game.set_seed(1000 + episode)
        game.new_episode()
        state = None
        while not game.is_episode_finished():
            with torch.no_grad():
                logits, state = policy.step(frame_of(game), state=state)
            choice = load_policy.greedy(logits, described['heads'])[0].tolist()
            game.make_action(presses(described['head_buttons'], names, choice), frame_skip)
        returns.append(game.get_total_reward())
    game.close()
    return returns


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('run')
    parser.add_argument('--episodes', type=int, default=100)
    parser.add_argument('--comrad', default='./comrad')
    asked = parser.parse_args()
    policy = load_policy.Policy(latest_checkpoint(asked.run))
    settings = policy.settings
    cfg = settings['scenario']
    if settings['num_agents'] != 1 or settings['use_additional_input'] or not cfg.lower().endswith('.cfg'):
        sys.exit(f'{asked.run}: a run of one agent on a .cfg without additional input is needed')

    def json_of(*words):
        return json.loads(subprocess.run([asked.comrad, *words, '--json'], check=True, stdout=subprocess.PIPE).stdout)

    heads = ['--heads', settings['heads']] if settings['heads'] else []
    described = json_of('scenarios', 'describe', cfg, *heads)
    ours = json_of('eval', '--policy', asked.run, '--episodes', str(asked.episodes))
    returns = play(policy, described, cfg, asked.episodes, settings['env_frameskip'])
    mean = sum(returns) / len(returns)
    within = abs(mean - ours['J_mean']) <= ours['J_ci95']
    print(json.dumps({'cfg': cfg, 'episodes': asked.episodes, 'ours': ours['J_mean'], 'ci95': ours['J_ci95'],
                      'vizdoom': mean, 'within': within}))
    return 0 if within else 1


if __name__ == '__main__':
    sys.exit(main())
