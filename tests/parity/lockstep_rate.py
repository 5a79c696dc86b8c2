#!/usr/bin/env python3
"""Decisions per second that ViZDoom makes with one player alone or with up to eight in lock step: the numbers
that `comrad bench sim` of the same scenario stands beside. One alone also measures the machine's speed.

    lockstep_rate.py --wad FILE [--players 2] [--seconds S] [--frame_skip 4]

Each player is its own process, as in every ViZDoom multiplayer game; all press uniform random buttons, hold them
for a decision and look at their 160x120 picture after it. A decision of one player counts as one. Alone, episodes begin
anew when they end. Needs a Python with `vizdoom`. Prints one JSON object.
"""
import argparse
import json
import multiprocessing
import os
import queue
import random
import tempfile
import time

from scenario_parity import free_port

BUTTONS = ["MOVE_FORWARD", "MOVE_BACKWARD", "TURN_LEFT", "TURN_RIGHT", "MOVE_LEFT", "MOVE_RIGHT", "ATTACK"]


def play(player, players, wad, port, frame_skip, seconds, folder, answer):
    import vizdoom as vzd
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    own_folder = os.path.join(folder, str(player))  # settings lie where it runs; two in one folder race to make theirs
    os.mkdir(own_folder)
    os.chdir(own_folder)
    game = vzd.DoomGame()
    game.set_doom_game_path(os.path.join(os.path.dirname(vzd.__file__), "freedoom2.wad"))
    game.set_doom_scenario_path(wad)
    game.set_doom_map("map01")
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    game.set_screen_resolution(vzd.ScreenResolution.RES_160X120)
    game.set_screen_format(vzd.ScreenFormat.RGB24)
    game.set_mode(vzd.Mode.PLAYER)
    game.set_available_buttons([getattr(vzd.Button, name) for name in BUTTONS])
    if players > 1 and player == 0:
        game.add_game_args("-host %d -port %d +viz_connect_timeout 60 +sv_noautoaim 1" % (players, port))
    elif players > 1:
        game.add_game_args("-join 127.0.0.1 -port %d +viz_connect_timeout 60" % port)
    game.init()
    generator = random.Random(player)
    decisions, frame_bytes, begin = 0, 0, time.monotonic()
    while time.monotonic() - begin < seconds:
        if players == 1 and game.is_episode_finished():
            game.new_episode()
        if players > 1 and game.is_player_dead():
            game.respawn_player()
        if game.is_episode_finished():
            break  # all leave a map together; one map is enough to measure
        game.make_action([float(generator.random() < 0.3) for _ in BUTTONS], frame_skip)
        state = game.get_state()
        frame_bytes += 0 if state is None else state.screen_buffer.nbytes
        decisions += 1
    answer.put((decisions, frame_bytes, time.monotonic() - begin))
    game.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wad", required=True)
    parser.add_argument("--players", type=int, choices=range(1, 9), default=2, metavar="1..8")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--frame_skip", type=int, default=4)
    arguments = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    answer, port = context.Queue(), free_port()
    with tempfile.TemporaryDirectory() as folder:
        players = [context.Process(target=play, args=(player, arguments.players, os.path.abspath(arguments.wad), port,
                                                      arguments.frame_skip, arguments.seconds, folder, answer))
                   for player in range(arguments.players)]
        for player in players:
            player.start()
        try:
            results = [answer.get(timeout=arguments.seconds + 120) for _ in players]
        except queue.Empty:
            raise SystemExit("a player did not finish; what ViZDoom said is above") from None
        finally:
            for player in players:
                player.join(20)
                if player.is_alive():
                    player.kill()
    seconds = max(result[2] for result in results)
    decisions = sum(result[0] for result in results)
    print(json.dumps({"players": arguments.players, "decisions": decisions, "seconds": round(seconds, 2),
                      "decisions_per_s": round(decisions / seconds, 1),
                      "frame_bytes": sum(result[1] for result in results) // max(1, decisions)}))


if __name__ == "__main__":
    main()
