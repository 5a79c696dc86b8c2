#!/usr/bin/env python3
"""ViZDoom's pictures of a scenario, for picture parity.

    V/bin/python record.py SCENARIO|FILE.cfg OUT [--map MAPxx] [--script CSV] [--at 0,35] [--no_monsters] [--hud]

SCENARIO is one of the pip package's. Writes OUT/frame_tNNN.png (160x120), frame_tNNN_depth.png (ViZDoom's 8-bit depth)
and trace.csv: a row per tic with action, pose and picture-worthy numbers, and things.csv: every actor at the drawn tics.
Needs the package vizdoom alone.
"""
import argparse
import csv
import os
import struct
import tempfile
import zlib

COLUMNS = "fwd back left right turnl turnr attack speed use jump crouch turn180 dyaw dpitch dfwd dside".split()


def write_png(path, image):
    """[height, width] or [height, width, 3] u8."""
    height, width = image.shape[:2]
    rows = image.reshape(height, -1)
    body = b"".join(b"\0" + rows[y].tobytes() for y in range(height))
    kind = 2 if image.ndim == 3 else 0

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(body, 9)) + chunk(b"IEND", b""))


def configure(game, hud):
    """Everything that pictures depend on; after a cfg, which sets some of it too."""
    import vizdoom

    game.set_seed(20240607)
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    game.set_screen_resolution(vizdoom.ScreenResolution.RES_160X120)
    game.set_screen_format(vizdoom.ScreenFormat.RGB24)
    game.set_depth_buffer_enabled(True)
    game.set_objects_info_enabled(True)
    game.set_render_hud(hud)
    for thing in ("crosshair", "decals", "particles", "screen_flashes", "messages"):
        getattr(game, f"set_render_{thing}")(False)
    game.set_episode_timeout(0)
    game.set_mode(vizdoom.Mode.PLAYER)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario")
    parser.add_argument("out")
    parser.add_argument("--map")
    parser.add_argument("--script")
    parser.add_argument("--at", default="0")
    parser.add_argument("--no_monsters", action="store_true")
    parser.add_argument("--hud", action="store_true")
    parser.add_argument("--iwad", default="")
    options = parser.parse_args()
    import vizdoom

    config = options.scenario
    if not config.endswith(".cfg"):
        config = os.path.join(os.path.dirname(vizdoom.__file__), "scenarios", config + ".cfg")
    config, out = os.path.abspath(config), os.path.abspath(options.out)
    script = os.path.abspath(options.script) if options.script else None
    os.makedirs(out, exist_ok=True)
    # The buttons of COLUMNS, in their order.
    B = vizdoom.Button
    buttons = [B.MOVE_FORWARD, B.MOVE_BACKWARD, B.MOVE_LEFT, B.MOVE_RIGHT, B.TURN_LEFT, B.TURN_RIGHT, B.ATTACK, B.SPEED,
               B.USE, B.JUMP, B.CROUCH, B.TURN180, B.TURN_LEFT_RIGHT_DELTA, B.LOOK_UP_DOWN_DELTA,
               B.MOVE_FORWARD_BACKWARD_DELTA, B.MOVE_LEFT_RIGHT_DELTA]
    variables = [f"POSITION_{a}" for a in "XYZ"] + ["ANGLE", "PITCH"] + [f"VELOCITY_{a}" for a in "XYZ"]
    variables += ["VIEW_HEIGHT", "HEALTH"]
    game = vizdoom.DoomGame()
    game.load_config(config)
    if options.iwad:
        game.set_doom_game_path(options.iwad)
    configure(game, options.hud)
    game.set_available_buttons(buttons)
    game.set_available_game_variables([getattr(vizdoom.GameVariable, name) for name in variables])
    if options.map:
        game.set_doom_map(options.map)
    if options.no_monsters:
        game.add_game_args("-nomonsters")
    rows = []
    if script:
        with open(script) as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    at = {int(t) for t in options.at.split(",")}
    with tempfile.TemporaryDirectory() as folder, open(os.path.join(out, "trace.csv"), "w") as trace, open(
            os.path.join(out, "things.csv"), "w") as things:
        os.chdir(folder)  # ViZDoom writes its own files where it runs
        game.init()
        trace.write("t," + ",".join("a_" + c for c in COLUMNS) + "," + ",".join(variables) + "\n")
        things.write("t,name,x,y,z,angle\n")

        def note(t, action):
            state = game.get_state()
            numbers = [game.get_game_variable(getattr(vizdoom.GameVariable, name)) for name in variables]
            trace.write(f"{t}," + ",".join(f"{a:g}" for a in action) + "," + ",".join(f"{n:.9f}" for n in numbers) + "\n")
            if t not in at or state is None:
                return
            write_png(os.path.join(out, f"frame_t{t:03d}.png"), state.screen_buffer)
            write_png(os.path.join(out, f"frame_t{t:03d}_depth.png"), state.depth_buffer)
            for thing in state.objects:
                things.write(f"{t},{thing.name},{thing.position_x:.6f},{thing.position_y:.6f},"
                             f"{thing.position_z:.6f},{thing.angle:.6f}\n")

        note(0, [0.0] * len(COLUMNS))
        for t, row in enumerate(rows[:max(at)], 1):
            action = [float(row.get(c) or row.get("a_" + c) or 0) for c in COLUMNS]
            game.make_action(action, 1)
            if game.is_episode_finished():
                break
            note(t, action)
        game.close()


if __name__ == "__main__":
    main()
