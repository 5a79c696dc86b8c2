"""Plays a WAD in ViZDoom without pressing anything and prints USER1..USER60, one line per tic.

usage: user_variables.py WAD TICS"""

import os
import sys
import tempfile

import vizdoom


def play(wad: str, tics: int) -> None:
    game = vizdoom.DoomGame()
    game.set_doom_scenario_path(wad)
    game.set_doom_map("map01")
    game.set_doom_skill(3)
    game.set_mode(vizdoom.Mode.PLAYER)
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    game.set_seed(1)
    game.set_episode_timeout(0)
    game.set_available_buttons([vizdoom.Button.ATTACK])
    users = [getattr(vizdoom.GameVariable, f"USER{number}") for number in range(1, 61)]
    game.set_available_game_variables(users)
    game.init()
    game.new_episode()
    for _ in range(tics):
        game.make_action([0], 1)
        print(*(int(game.get_game_variable(user)) for user in users))
    game.close()


wad_path, tic_count = os.path.abspath(sys.argv[1]), int(sys.argv[2])
with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)  # the engine leaves its settings where it runs
    play(wad_path, tic_count)
