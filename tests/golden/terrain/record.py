#!/usr/bin/env python3
"""Records how a player of ViZDoom 1.3.2 moves over steps, under low ceilings and along slanted walls.

    record.py NAME...          writes NAME.textmap and NAME.csv beside this file

The map of a NUMBER is twelve strips side by side from west to east, with floors and ceilings drawn from the number. That of
slanted_NUMBER is a room of seven to eleven walls with five pillars and platforms in it, none of which need lie along an axis;
its corners lie on a grid of 16 units, so that fractions of walls are often halves. That of pushed_NUMBER is a square with 48
triangles on its floor whose lines push who crosses them. The number also draws the script of 600 tics, in which a key is
held for up to 15 tics. Needs a Python with `vizdoom`.
"""
import math
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
# How often each key is held among slanted walls, where it mostly runs into them, and among lines that push.
SLANTED_CHANCES = [0.85, 0.1, 0.25, 0.25, 0.03, 0.0, 0.6]
PUSHED_CHANCES = [0.6, 0.3, 0.3, 0.3, 0.0, 0.0, 0.1]
TURN, SLANTED_TURN = (0.1, 25), (0.06, 60)  # how often and how far in degrees at most
SOLID, OPEN = "blocking = true; }\n", "twosided = true; }\n"
THRUST = "twosided = true; special = 72; arg0 = %d; arg1 = %d; repeatspecial = true; playercross = true; }\n"
START = ("thing { x = %d.0; y = 0.0; angle = 0; type = 1; skill1 = true; skill2 = true; skill3 = true; skill4 = true; "
         "skill5 = true; single = true; coop = true; dm = true; class1 = true; }\n")
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
    """The strips."""
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
    return text + START % (rooms[0][2] // 2)


def slanted_rings(number):
    """[(corners, floor height)]: the room, its corners in clockwise order, then what stands in it, counter-clockwise; a pillar
    has no floor. Fronts of lines are on their right, so inside the room and outside of the others."""
    generator = random.Random(number)

    def ring(centre_x, centre_y, directions, radius_min, radius_max):
        corners = []
        for direction in directions:
            radius = generator.uniform(radius_min, radius_max)
            corners.append((16 * round((centre_x + radius * math.cos(direction)) / 16),
                            16 * round((centre_y + radius * math.sin(direction)) / 16)))
        return corners

    walls = generator.randint(7, 11)
    rings = [(ring(0, 0, [-2 * math.pi * i / walls + generator.uniform(-0.2, 0.2) for i in range(walls)], 320, 560), 0)]
    for i in range(5):
        direction, corners = 2 * math.pi * (i + generator.uniform(-0.2, 0.2)) / 5, generator.randint(3, 4)
        first = generator.uniform(0, 2 * math.pi)
        rings.append((ring(210 * math.cos(direction), 210 * math.sin(direction),
                           [first + 2 * math.pi * corner / corners for corner in range(corners)], 28, 64),
                      generator.choice([None, None, 40, 24, 16])))
    return rings


def pushed_rings(number):
    generator = random.Random(number)
    radius, rings = generator.choice([8, 12, 16, 24]), [([(-160, -160), (-160, 160), (160, 160), (160, -160)], 0)]
    for x in range(-132, 133, 44):
        for y in range(-132, 133, 44):
            if (x, y) != (0, 0):
                first = generator.uniform(0, 2 * math.pi)
                rings.append(([(round(x + radius * math.cos(first + 2 * math.pi * corner / 3)),
                                round(y + radius * math.sin(first + 2 * math.pi * corner / 3))) for corner in range(3)], 0))
    return rings


def rings_textmap(rings, two_sided):
    """`two_sided()` ends each line between a platform and the room."""
    text, vertices, sides, sectors = 'namespace = "zdoom";\n', 0, [], []
    lines = ""
    for number, (corners, floor) in enumerate(rings):
        if floor is not None:
            sectors.append(floor)
        for i, corner in enumerate(corners):
            text += "vertex { x = %d.0; y = %d.0; }\n" % corner
            lines += "linedef { v1 = %d; v2 = %d; sidefront = %d; " % (
                vertices + i, vertices + (i + 1) % len(corners), len(sides))
            solid = number == 0 or floor is None
            sides.append((0, solid))
            if solid:
                lines += SOLID
            else:
                lines += "sideback = %d; " % len(sides) + two_sided()
                sides.append((len(sectors) - 1, False))
        vertices += len(corners)
    text += lines
    for sector, solid in sides:
        text += 'sidedef { sector = %d; texturetop = "BRICK9"; texturebottom = "BRICK9"; texturemiddle = "%s"; }\n' % (
            sector, "BRICK9" if solid else "-")
    for floor in sectors:
        text += 'sector { heightfloor = %d; heightceiling = 256; texturefloor = "FLAT4"; textureceiling = "FLOOR0_1"; }\n' % floor
    return text + START % 0


def script(number, chances, turn):
    """Rows of the keys and, last, degrees turned to the right."""
    generator = random.Random(number + 1000)
    left, held, rows = [0] * len(KEYS), [0] * len(KEYS), []
    for _ in range(TICS):
        for key, chance in enumerate(chances):
            if left[key] == 0:
                left[key], held[key] = generator.randint(1, 15), int(generator.random() < chance)
            left[key] -= 1
        rows.append(held + [round(generator.uniform(-turn[1], turn[1]), 2) if generator.random() < turn[0] else 0])
    return rows


def record(name):
    kind, number = name.rpartition("_")[0], int(name.rpartition("_")[2])
    generator = random.Random(number + 2000)
    if kind == "slanted":
        text, keys = rings_textmap(slanted_rings(number), lambda: OPEN), script(number, SLANTED_CHANCES, SLANTED_TURN)
    elif kind == "pushed":
        push = lambda: THRUST % (generator.randrange(256), generator.choice([1, 5, 40, 100]))
        text, keys = rings_textmap(pushed_rings(number), push), script(number, PUSHED_CHANCES, SLANTED_TURN)
    else:
        text, keys = textmap(strips(number)), script(number, [chance for _, _, chance in KEYS], TURN)
    with open(os.path.join(HERE, name + ".textmap"), "w") as file:
        file.write(text)
    lumps = [("MAP01", b""), ("TEXTMAP", text.encode()), ("ENDMAP", b"")]
    body, directory = b"", b""
    for lump, data in lumps:
        directory += struct.pack("<ii8s", 12 + len(body), len(data), lump.encode())
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
    fixed = lambda variable: round(game.get_game_variable(getattr(vzd.GameVariable, variable)) * 65536)
    with open(os.path.join(HERE, name + ".csv"), "w") as file:
        file.write("map_tic," + ",".join(key for key, _, _ in KEYS) + ",x,y,z,velocity_x,velocity_y,velocity_z,angle_degrees\n")
        for pressed in [None] + keys:
            if pressed is not None:
                game.make_action([float(value) for value in pressed], 1)
            held = pressed[:-1] if pressed is not None else [0] * len(KEYS)
            file.write(",".join(str(value) for value in [game.get_episode_time()] + held + [fixed(variable) for variable in STATE]) +
                       ",%.9f\n" % game.get_game_variable(vzd.GameVariable.ANGLE))
    game.close()


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        record(argument)
