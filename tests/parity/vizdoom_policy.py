#!/usr/bin/env python3
"""Plays a run's policy in the real ViZDoom and compares its mean score with the one that `comrad eval` finds: of one agent the
return, of a scenario its J where ViZDoom can tell it (not what each player has killed), else the return.

The run was trained on a ViZDoom .cfg with one agent, or on one of the thirteen scenarios with two; of these, ViZDoom plays the
run's own map as a network game, and `scenario_play rewards` prints what the variables of both players pay. Greedy actions, the
run's frame skip. A run with `--render_size 160x120 --resize nearest` sees what ViZDoom shows at that size, made smaller in the same
way: 92 % of all pixels are equal. Of a run whose views are drawn at 128x72 directly ViZDoom draws 640x480, of which every view
takes the nearest pixels; its status bar then differs, which costs a policy of defend_the_center half of its score.

In a network game what the second player presses counts a tic later than what the first does. So that both engines play the same
game, it does in ours as well (`comrad.parallel_env`, a step for each tic); `comrad eval`, where nothing is late, is printed beside it.

    tests/parity/vizdoom_policy.py train_dir/RUN --episodes 100

Prints one JSON object: both means, the 95 % interval of ours and whether ViZDoom's lies in it; exit code 1 where it does
not. ViZDoom does not show what a scenario's last decision did, so its returns (`vizdoom_return`) lack what that one pays. Needs a
Python with torch, numpy, vizdoom and this project's package. Not part of the test suite: it takes a trained run.
"""
import argparse
import glob
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
import scenario_parity  # noqa: E402
from scenario_parity import AGENTS, SCENARIOS, TICS, play_vizdoom, returns_of, without_end  # noqa: E402

IWAD = os.environ.get('COMRAD_IWAD', '/usr/share/games/doom/freedoom2.wad')
JOINING_S = 600  # how long an episode of two may take


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


def frame_of(screen, place):
    """[1, 3, 72, 128] u8 of an RGB picture [rows, columns, 3] u8; each pixel is what lies at `place` (0: its corner, 0.5: its
    middle) of the picture's."""
    import torch
    screen = torch.from_numpy(screen.copy()).permute(2, 0, 1)
    rows = ((torch.arange(72) + place) * screen.shape[1] / 72).long()
    columns = ((torch.arange(128) + place) * screen.shape[2] / 128).long()
    return screen[:, rows][:, :, columns][None]


def screen_of(settings):
    """ViZDoom's resolution for a run, and where in a pixel of the view its colour is taken."""
    if settings['resize'] == 'nearest':
        return 'RES_' + settings['render_size'].upper(), 0.0  # as OpenCV's INTER_NEAREST
    return 'RES_640X480', 0.5


class PolicyPlayer:
    """A checkpoint that plays one seat; sent to the process that plays it, which loads the network."""

    def __init__(self, checkpoint, head_sizes, screen, decisions=None, render=None, measurements=()):
        self.resolution, self.place = screen
        self.checkpoint, self.head_sizes, self.decisions, self.render = checkpoint, head_sizes, decisions, render or {}
        self.measurements = measurements  # terms of `comrad scenarios describe`, in the order of the .cfg's variables
        self.state = None

    def load(self, player):
        """The network of this seat."""
        import comrad
        import torch
        torch.set_num_threads(1)
        self.policy = comrad.load_policy(self.checkpoint, player)

    def prepare(self, game, player):
        """Before game.init()."""
        import vizdoom as vzd
        self.load(player)
        game.set_screen_format(vzd.ScreenFormat.RGB24)
        game.set_screen_resolution(getattr(vzd.ScreenResolution, self.resolution))
        for part in ('hud', 'weapon', 'screen_flashes'):
            if part in self.render:
                getattr(game, 'set_render_' + part)(bool(self.render[part]))

    def begin(self):
        """Before an episode's first decision."""
        self.state = None

    def decide(self, game):
        """The choice of each head for what `game` shows now."""
        return self.see(game.get_state().screen_buffer, self.measurement_of(game))

    def see(self, screen, measurement=None):
        """The choice of each head for a picture [rows, columns, 3]."""
        import torch
        with torch.no_grad():
            logits, self.state = self.policy(frame_of(screen, self.place), measurement, self.state)
        return self.policy.greedy(logits, self.head_sizes)[0].tolist()

    def measurement_of(self, game):
        """[1, M] f32 of the variables that the .cfg lists; None for a policy that gets none."""
        import torch
        if not self.measurements:
            return None
        values = [max(-term['clip'], min(term['clip'], value * term['scale'] + term['offset']))
                  for term, value in zip(self.measurements, game.get_state().game_variables, strict=True)]
        return torch.tensor([values], dtype=torch.float32)

    def choose(self, game, tic):
        """As Script.choose of scenario_parity.py."""
        if tic % TICS == 0:
            if tic >= self.decisions * TICS:
                return None
            self.choice = self.decide(game)
        return self.choice


def play_cfg(player, heads, cfg, episodes, frame_skip):
    """Returns of so many episodes of one player."""
    import vizdoom as vzd
    game = vzd.DoomGame()
    game.load_config(cfg)
    game.set_doom_game_path(IWAD)
    game.set_mode(vzd.Mode.PLAYER)
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    player.prepare(game, 0)
    game.init()
    names = [button.name for button in game.get_available_buttons()]
    returns = []
    for episode in range(episodes):
        game.set_seed(1000 + episode)
        game.new_episode()
        player.begin()
        while not game.is_episode_finished():
            game.make_action(presses(heads, names, player.decide(game)), frame_skip)
        returns.append(game.get_total_reward())
    game.close()
    return returns


def play_scenario(player, run, name, heads, spec, episodes, scenario_play):
    """Score and mean return of the two players in each of so many episodes on the run's own map; a score that ViZDoom cannot
    tell is None."""
    wad = the_map(run)
    played, folder = [], tempfile.mkdtemp()
    try:
        for episode in range(episodes):
            seed = (1000 + episode) * 2654435761 % 2**31  # far apart: neighbouring ones draw first numbers that are alike
            for attempt in range(3):
                try:
                    rows = play_vizdoom(wad, spec, heads, player, seed, folder, JOINING_S)
                    break
                except RuntimeError as problem:  # of its network; the same seed again
                    print(f'episode {episode}: {problem}', file=sys.stderr)
                    if attempt == 2:
                        raise
            paid = returns_of(scenario_play, name, {0: without_end(rows)}, folder)[0]
            played.append((score_of(rows, spec), sum(paid) / AGENTS))
            print(f'episode {episode}: {len(rows) - 1} decisions, score {played[-1][0]}, return {played[-1][1]:.4g}', file=sys.stderr)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return played


def play_ours(players, run, scenario, render_size, episodes):
    """[(score, mean return)] of so many of our episodes on the run's map, where what the second player chooses is pressed a tic
    later, as in a network game."""
    import comrad
    width, height = map(int, render_size.split('x'))
    env = comrad.parallel_env(scenario, num_agents=AGENTS, frame_skip=1, size=(width, height), layout=the_map(run))
    first, second = env.possible_agents
    played = []
    for seat, player in enumerate(players):
        player.load(seat)
    for episode in range(episodes):
        seen, _ = env.reset(seed=1000 + episode)
        choice = {agent: [0] * len(players[0].head_sizes) for agent in env.possible_agents}
        for player in players:
            player.begin()
        tic = 0
        while env.agents:
            before = choice
            if tic % TICS == 0:
                choice = {agent: player.see(seen[agent]) for agent, player in zip(env.possible_agents, players, strict=True)}
            seen, _, _, _, infos = env.step({first: choice[first], second: before[second]})
            tic += 1
        told = [infos[agent] for agent in env.possible_agents]
        played.append((told[0]['score'], sum(one['episode_return'] for one in told) / AGENTS))
    env.close()
    return played


def the_map(run):
    """The one map of a run."""
    wads = glob.glob(os.path.join(run, 'layouts', '**', '*.wad'), recursive=True)
    if len(wads) != 1:
        sys.exit(f'{run}/layouts: a run on one map is needed, and {len(wads)} are there')
    return os.path.abspath(wads[0])


def score_of(rows, spec):
    """J of an episode by ViZDoom's rows [decision][player]."""
    if spec['score'] == 'survival_tics':
        return rows[-1][0]['tics'] - rows[0][0]['tics']
    if spec['score'] not in spec['exports']:
        return None

    def last(name):
        return rows[-1][0][f'USER{spec["exports"][name]}']
    return last(spec['score']) / (last(spec['score_divisor']) if 'score_divisor' in spec else 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('run')
    parser.add_argument('--episodes', type=int, default=100)
    parser.add_argument('--comrad', default='./comrad')
    parser.add_argument('--scenario_play', default='build/bin/scenario_play')
    asked = parser.parse_args()
    with open(os.path.join(asked.run, 'config.toml'), 'rb') as file:
        settings = tomllib.load(file)
    scenario, agents = settings['scenario'], settings['num_agents']
    is_cfg = scenario.lower().endswith('.cfg')
    if settings['resize'] == 'area':
        sys.exit(f'{asked.run}: ViZDoom makes no views that are resized by area; train with --resize nearest')
    if agents != (1 if is_cfg else AGENTS) or not is_cfg and (settings['use_additional_input'] or settings['env_frameskip'] != TICS):
        sys.exit(f'{asked.run}: a run of one agent on a .cfg is needed, or of two on a scenario with 4 tics a decision and without '
                 'additional input')

    def json_of(*words):
        return json.loads(subprocess.run([asked.comrad, *words, '--json'], check=True, stdout=subprocess.PIPE).stdout)

    heads = ['--heads', settings['heads']] if settings['heads'] else []
    described = json_of('scenarios', 'describe', scenario, *heads)
    evaluated = json_of('eval', '--policy', asked.run, '--episodes', str(asked.episodes))
    checkpoint = latest_checkpoint(asked.run)
    if is_cfg:
        terms = described['measurement_terms'] if settings['use_additional_input'] else ()
        player = PolicyPlayer(checkpoint, described['heads'], screen_of(settings), measurements=terms)
        values, name = play_cfg(player, described['head_buttons'], scenario, asked.episodes, settings['env_frameskip']), 'return'
        ours = [one[name] for one in evaluated['each']]
        more = {}
    else:
        with open(os.path.join(SCENARIOS, scenario, 'scenario.toml'), 'rb') as file:
            spec = tomllib.load(file)

        def player():
            return PolicyPlayer(checkpoint, described['heads'], screen_of(settings), spec['decision_limit'], spec.get('render'))
        here = play_ours([player(), player()], asked.run, scenario, settings['render_size'], asked.episodes)
        played = play_scenario(player(), asked.run, scenario, described['head_buttons'], spec, asked.episodes,
                               os.path.abspath(asked.scenario_play))
        name = 'return' if played[0][0] is None else 'J'
        values, ours = ([one[name == 'return'] for one in of] for of in (played, here))
        in_time, in_time_ci95 = mean_and_ci95([one[name] for one in evaluated['each']])
        more = {'ours_return': mean_and_ci95([one[1] for one in here])[0],
                'vizdoom_return': mean_and_ci95([one[1] for one in played])[0],
                'ours_in_time': in_time, 'ours_in_time_ci95': in_time_ci95}
    mean, theirs_ci95 = mean_and_ci95(values)
    ours_mean, ours_ci95 = mean_and_ci95(ours)
    within = abs(mean - ours_mean) <= ours_ci95
    print(json.dumps({'scenario': scenario, 'episodes': asked.episodes, 'what': name, 'ours': ours_mean, 'ours_ci95': ours_ci95,
                      'vizdoom': mean, 'vizdoom_ci95': theirs_ci95, 'within': within, **more}))
    return 0 if within else 1


def mean_and_ci95(values):
    """Mean over episodes and the half-width of its 95 % interval."""
    mean = sum(values) / len(values)
    return mean, 1.96 * (sum((value - mean) ** 2 for value in values) / max(len(values) - 1, 1) / len(values)) ** 0.5


if __name__ == '__main__':
    sys.exit(main())
