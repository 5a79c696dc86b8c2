#!/usr/bin/env python3
"""Writes gallery.udmf, the map of picture parity, and ViZDoom's pictures of it.

    python3 -m venv V && V/bin/pip install vizdoom && V/bin/python gallery.py [--iwad FILE]

The map is COMRAD's own: one of each thing that can be drawn wrongly. Each pose of POSES becomes NAME.png (160x120) and
NAME_depth.png (ViZDoom's 8-bit depth) in a folder for the release of Freedoom, whose textures and sprites (BSD-3-Clause) they show:
Debian 12's freedoom2.wad is 0.12.1, Debian 13's 0.13.0.
"""
import argparse
import os
import struct
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
START_TICS = 24  # the pistol is up by then

# name: x, y, angle in degrees
POSES = {
    "hall_east": (96, 400, 0),
    "hall_slope": (600, 60, 135),
    "platform": (256, 96, 80),
    "pit": (480, 700, 215),
    "beam": (880, 200, 170),
    "grating": (560, 576, 10),
    "yard": (1100, 384, 350),
    "from_yard": (1480, 300, 160),
    "door": (512, 500, 90),
    "back_room": (512, 900, 250),
    "monsters": (860, 640, 262),
    "glass": (860, 384, 150),
}


class Map:
    def __init__(self):
        self.vertices, self.lines, self.sides, self.sectors, self.things = [], [], [], [], []
        self.edges = {}

    def vertex(self, point):
        if point not in self.vertices:
            self.vertices.append(point)
        return self.vertices.index(point)

    def sector(self, **fields):
        self.sectors.append(fields)
        return len(self.sectors) - 1

    def ring(self, sector, points, outside=None, side=None, line=None, back=None):
        """Clockwise: the sector lies to the right. Without `outside` a ring is solid until another one shares it."""
        for a, b in zip(points, points[1:] + points[:1]):
            a, b = self.vertex(a), self.vertex(b)
            if (b, a) in self.edges:  # the other side of a known line
                entry = self.lines[self.edges[b, a]]
                self.sides.append(dict(sector=sector, **(side or {})))
                self.sides[-1].pop("texturemiddle", None)
                self.sides[entry["sidefront"]].pop("texturemiddle", None)
                entry.update(sideback=len(self.sides) - 1, twosided=True)
                entry.pop("blocking", None)
                continue
            self.edges[a, b] = len(self.lines)
            self.sides.append(dict(sector=sector, **(side or {})))
            entry = dict(v1=a, v2=b, sidefront=len(self.sides) - 1, **(line or {}))
            if outside is None:
                entry["blocking"] = True
            else:
                self.sides.append(dict(sector=outside, **(back if back is not None else side or {})))
                entry.update(sideback=len(self.sides) - 1, twosided=True)
            self.lines.append(entry)

    def thing(self, kind, x, y, angle=0, **more):
        everyone = {f"skill{i}": True for i in range(1, 9)} | {f"class{i}": True for i in range(1, 9)}
        self.things.append(dict(type=kind, x=float(x), y=float(y), angle=angle, single=True, coop=True, dm=True,
                                **everyone, **more))

    def text(self):
        def value(v):
            return {True: "true", False: "false"}.get(v) if isinstance(v, bool) else f'"{v}"' if isinstance(v, str) else str(v)

        blocks = [("thing", t) for t in self.things]
        blocks += [("vertex", dict(x=float(x), y=float(y))) for x, y in self.vertices]
        blocks += [("linedef", x) for x in self.lines] + [("sidedef", x) for x in self.sides]
        blocks += [("sector", x) for x in self.sectors]
        body = "".join(f"{kind} {{ " + " ".join(f"{k} = {value(v)};" for k, v in fields.items()) + " }\n"
                       for kind, fields in blocks)
        return 'namespace = "zdoom";\n' + body


def box(x0, y0, x1, y1):
    return [(x0, y0), (x0, y1), (x1, y1), (x1, y0)]


def gallery(start):
    m = Map()
    wall = lambda name, **more: dict(texturemiddle=name, texturetop=name, texturebottom=name, **more)
    step = lambda name, **more: dict(texturetop=name, texturebottom=name, **more)
    hall = m.sector(heightceiling=192, texturefloor="FLOOR4_8", textureceiling="CEIL3_5", lightlevel=176)
    yard = m.sector(heightfloor=-16, heightceiling=120, texturefloor="GRASS1", textureceiling="F_SKY1", lightlevel=224)
    frame = m.sector(heightceiling=112, texturefloor="FLAT5_5", textureceiling="FLAT5_5", lightlevel=144)
    room = m.sector(heightfloor=24, heightceiling=168, texturefloor="FLAT14", textureceiling="FLAT20", lightlevel=128,
                    lightcolor=0xFF9060)
    platform = m.sector(heightfloor=24, heightceiling=192, texturefloor="FLAT1", textureceiling="CEIL3_5",
                        lightlevel=208, rotationfloor=30.0, xpanningfloor=8.0, ypanningfloor=16.0)
    pit = m.sector(heightfloor=-40, heightceiling=192, texturefloor="NUKAGE1", textureceiling="CEIL3_5", lightlevel=255)
    beam = m.sector(heightceiling=96, texturefloor="FLOOR4_8", textureceiling="CRATOP2", lightlevel=112,
                    xscaleceiling=2.0, yscaleceiling=0.5)
    cage = m.sector(heightceiling=192, texturefloor="FLOOR0_1", textureceiling="CEIL3_5", lightlevel=176)
    hut = m.sector(heightfloor=-16, heightceiling=72, texturefloor="FLAT5_4", textureceiling="FLAT5_4", lightlevel=160)

    m.ring(hall, [(0, 128), (0, 768), (448, 768), (576, 768), (960, 768), (1024, 704), (1024, 512), (1024, 256),
                  (1024, 0), (128, 0)], side=wall("STARTAN2"))
    m.ring(yard, [(1024, 256), (1024, 512), (1024, 640), (1600, 640), (1600, 128), (1024, 128)],
           side=wall("BRICK6", offsetx=24, offsety=13))
    m.ring(frame, box(448, 768, 576, 800), side=wall("DOORTRAK"), line=dict(dontpegbottom=True))
    m.ring(room, [(448, 800), (384, 800), (384, 1056), (640, 1056), (640, 800), (576, 800)],
           side=wall("METAL1", scalex_mid=0.5, offsety_mid=20.0))
    m.ring(platform, box(192, 192, 320, 320), hall, step("STEP3"), back=step("STEP3"))
    m.ring(pit, box(192, 448, 448, 640), hall, step("SLADWALL", offsetx=16), line=dict(dontpegbottom=True))
    m.ring(beam, box(640, 128, 768, 256), hall, step("SUPPORT2"), line=dict(dontpegtop=True))
    m.ring(cage, [(640, 512), (640, 640), (704, 640), (704, 512)], hall, dict(texturemiddle="MIDGRATE"))
    m.ring(hut, box(1280, 256, 1408, 384), yard, step("WOOD1"))
    pillar = box(512, 320, 576, 384)[::-1]
    m.ring(hall, pillar, side=wall("COMPTALL"))
    # A pane of glass: both sides in one sector.
    a, b = m.vertex((760, 420)), m.vertex((824, 484))
    for _ in range(2):
        m.sides.append(dict(sector=hall, texturemiddle="SW1COMP"))
    m.lines.append(dict(v1=a, v2=b, sidefront=len(m.sides) - 2, sideback=len(m.sides) - 1, twosided=True, alpha=0.4))

    m.thing(1, start[0], start[1], start[2])
    for i in range(8):
        m.thing(3001, 640 + 40 * i, 80, 45 * i, dormant=True)
    m.thing(3004, 800, 300, 90, dormant=True)
    m.thing(58, 900, 300, 135, dormant=True)
    m.thing(2012, 256, 256)
    m.thing(2011, 384, 300)
    m.thing(2035, 500, 240)
    m.thing(2028, 700, 400)
    m.thing(30, 1200, 300)
    m.thing(44, 960, 600)
    m.thing(2014, 400, 560)
    m.thing(2018, 1344, 320)
    m.thing(2005, 1500, 200)
    m.thing(2046, 512, 980)
    return m.text()


def wad(text):
    lumps = [("MAP01", b""), ("TEXTMAP", text.encode()), ("ENDMAP", b"")]
    data, entries = b"", b""
    for name, body in lumps:
        entries += struct.pack("<ii8s", 12 + len(data), len(body), name.encode())
        data += body
    return struct.pack("<4sii", b"PWAD", len(lumps), 12 + len(data)) + data + entries


def release_of(iwad):
    """What Freedoom's lump of its own name says: 0.13.0."""
    with open(iwad, "rb") as file:
        content = file.read()
    count, directory = struct.unpack_from("<ii", content, 4)
    for number in range(count):
        offset, size, name = struct.unpack_from("<ii8s", content, directory + 16 * number)
        if name.rstrip(b"\0") == b"FREEDOOM":
            return content[offset : offset + size].decode().partition("-")[0]
    raise SystemExit(f"{iwad} is no Freedoom")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--iwad", default="/usr/share/games/doom/freedoom2.wad")
    parser.add_argument("--out", default=HERE)
    parser.add_argument("--only_map", action="store_true")
    options = parser.parse_args()
    options.out = os.path.abspath(options.out)
    with open(os.path.join(options.out, "gallery.udmf"), "w") as file:
        file.write(gallery((512, 96, 90)))
    with open(os.path.join(options.out, "poses.csv"), "w") as file:
        file.write("name,x,y,angle,tics\n")
        for name, (x, y, angle) in POSES.items():
            file.write(f"{name},{x},{y},{angle},{START_TICS}\n")
    if options.only_map:
        return
    import vizdoom
    import record

    pictures = os.path.join(options.out, "freedoom_" + release_of(options.iwad))
    os.makedirs(pictures, exist_ok=True)
    for name, pose in POSES.items():
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "gallery.wad")
            with open(path, "wb") as file:
                file.write(wad(gallery(pose)))
            os.chdir(folder)  # ViZDoom writes its own files where it runs
            game = vizdoom.DoomGame()
            game.set_doom_game_path(options.iwad)
            game.set_doom_scenario_path(path)
            game.set_doom_map("map01")
            record.configure(game, hud=True)
            game.set_render_weapon(True)
            game.set_available_buttons([vizdoom.Button.TURN_LEFT])
            game.set_episode_start_time(START_TICS)
            game.init()
            state = game.get_state()
            record.write_png(os.path.join(pictures, name + ".png"), state.screen_buffer)
            record.write_png(os.path.join(pictures, name + "_depth.png"), state.depth_buffer)
            game.close()


if __name__ == "__main__":
    main()
