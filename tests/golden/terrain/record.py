#!/usr/bin/env python3
"""Records how a player of ViZDoom 1.3.2 moves over steps and under low ceilings.

    record.py NUMBER...        writes NUMBER.textmap and NUMBER.csv beside this file

A map is twelve strips side by side from west to east, with floors and ceilings drawn from the number; so is the script of
600 tics, in which a key is held for up to 15 tics. Needs a Python with `vizdoom`.
"""
import os
import random
import struct
import sys
import tempfile

import vizdoom as vzd

HERE = os.path.dirname(os.path.abspath(__file__))
HALF_DEPTH, OPEN_CEILING, STRIPS, TICS = 128, 512, 12, 600
KEYS = [("fwd", "MOVE_FORWARD", 0.6), ("back", "MOVE_BACKWARD", 0.2), ("left", "MOVE_LEFT", 0.2),
        ("right", "MOVE_RIGHT", 0.2), ("jump", "JUMP", 0.5), ("crouch", "CROUCH", 0.08), ("speed", "SPEED", 0.5)]
STATE = ["POSITION_X", "POSITION_Y", "POSITION_Z", "VELOCITY_X", "VELOCITY_Y", "VELOCITY_Z"]


def strips(number):
    """[(floor, ceiling, width)]"""
    generator = random.Random(number)
    result, floor = [], 0
    for _ in range(STRIPS):
        floor = max(0, min(200, floor + generator.choice([-96, -64, -40, -24, -16, -8, 0, 8, 16, 24, 32, 40])))
        ceiling = floor + generator.choice([56, 60, 64, 72, 80, 96, 128, 400]) if generator.random() < 0.4 else OPEN_CEILING
        result.append((floor, ceiling, generator.choice([32, 48, 64, 96, 128])))
    return result


def textmap(rooms):
    text, x = 'namespace = "zdoom";\n', 0
    for width in [0] + [width for _, _, width in rooms]:
        x += width
        for y in (-HALF_DEPTH, HALF_DEPTH):
            text += "vertex { x = %d.0; y = %d.0; }\n" % (x, y)
    sides, last = [], len(rooms) - 1

    def line(start, end, front, back=None):
        nonlocal text
        sides.append((front, back is None))
        if back is None:
            text_end = "blocking = true; }\n"
        else:
            sides.append((back, False))
            text_end = "sideback = %d; twosided = true; }\n" % (len(sides) - 1)
        front_side = len(sides) - (1 if back is None else 2)
        text += "linedef { v1 = %d; v2 = %d; sidefront = %d; %s" % (start, end, front_side, text_end)

    line(0, 1, 0)
    for i in range(len(rooms)):
        line(2 * i + 1, 2 * i + 3, i)
        line(2 * i + 2, 2 * i, i)
        if i > 0:
            line(2 * i, 2 * i + 1, i, i - 1)
    line(2 * last + 3, 2 * last + 2, last)
    for sector, solid in sides:
        text += 'sidedef { sector = %d; texturetop = "BRICK9"; texturebottom = "BRICK9"; texturemiddle = "%s"; }\n' % (
            sector, "BRICK9" if solid else "-")
    for floor, ceiling, _ in rooms:
        text += ('sector { heightfloor = %d; heightceiling = %d; texturefloor = "FLAT4"; textureceiling = "FLOOR0_1"; }\n' %
                 (floor, ceiling))
    return text + ("thing { x = %d.0; y = 0.0; angle = 0; type = 1; skill1 = true; skill2 = true; skill3 = true; skill4 = true; "
                   "skill5 = true; single = true; coop = true; dm = true; class1 = true; }\n" % (rooms[0][2] // 2))


def script(number):
    """Rows of the keys and, last, degrees turned to the right."""
    generator = random.Random(number + 1000)
    left, held, rows = [0] * len(KEYS), [0] * len(KEYS), []
    for _ in range(TICS):
        for key, (_, _, chance) in enumerate(KEYS):
            if left[key] == 0:
                left[key], held[key] = generator.randint(1, 15), int(generator.random() < chance)
            left[key] -= 1
        rows.append(held + [round(generator.uniform(-25, 25), 2) if generator.random() < 0.1 else 0])
    return rows


def record(number):
    text = textmap(strips(number))
    with open(os.path.join(HERE, "%d.textmap" % number), "w") as file:
        file.write(text)
    lumps = [("MAP01", b""), ("TEXTMAP", text.encode()), ("ENDMAP", b"")]
    body, directory = b"", b""
    for name, data in lumps:
        directory += struct.pack("<ii8s", 12 + len(body), len(data), name.encode())
        body += data
    os.chdir(tempfile.mkdtemp())  # ViZDoom leaves its settings where it runs
    with open("terrain.wad", "wb") as file:
        file.write(struct.pack("<4sii", b"PWAD", len(lumps), 12 + len(body)) + body + directory)
    game = vzd.DoomGame()
    game.set_doom_game_path(os.path.join(os.path.dirname(vzd.__file__), "freedoom2.wad"))
    game.set_doom_scenario_path("terrain.wad")
    game.set_doom_map("map01")
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    game.set_mode(vzd.Mode.PLAYER)
    game.set_episode_timeout(0)
    game.set_episode_start_time(14)
    game.set_available_buttons([getattr(vzd.Button, name) for _, name, _ in KEYS] + [vzd.Button.TURN_LEFT_RIGHT_DELTA])
    game.init()
    fixed = lambda name: round(game.get_game_variable(getattr(vzd.GameVariable, name)) * 65536)
    with open(os.path.join(HERE, "%d.csv" % number), "w") as file:
        file.write("map_tic," + ",".join(key for key, _, _ in KEYS) + ",x,y,z,velocity_x,velocity_y,velocity_z,angle_degrees\n")
        for pressed in [None] + script(number):
            if pressed is not None:
                game.make_action([float(value) for value in pressed], 1)
            keys = pressed[:-1] if pressed is not None else [0] * len(KEYS)
            file.write(",".join(str(value) for value in [game.get_episode_time()] + keys + [fixed(name) for name in STATE]) +
                       ",%.9f\n" % game.get_game_variable(vzd.GameVariable.ANGLE))
    game.close()


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        record(int(argument))
