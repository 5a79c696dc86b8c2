#!/usr/bin/env python3
"""Plays the same WAD with the same buttons in ViZDoom and in COMRAD and compares what comes of it.

    vizdoom_parity.py --trace BIN traces|weapons|monsters|scenarios [--only NAME] [--tics N]

`traces`   scenarios of the vizdoom package without monsters, 350 tics of seeded random buttons: position within 0.01
           unit, angle, health, ammunition, reward and end exact.
`weapons`  a range made for it: how much a shot hurts and how many pellets of it hit, each weapon, some 100 shots.
`monsters` what an attack of each monster costs and how far it walks.
`scenarios` every map of every WAD of the vizdoom package: 2 000 tics (--tics) of random buttons in COMRAD alone, twice; the same
           hash at every tic, no warning but those that EXPLAINED lists.

Distributions are compared by two-sample chi-square tests (cells of less than 10 of both together are joined), positions
by the two-sample Kolmogorov-Smirnov test, each at 1 in 10 000. Everything random is seeded, so a run that passes passes
again.

Needs a Python with `vizdoom` and `numpy`: COMRAD_TEST_PYTHON alone where that is set, else the one in --venv, which
`./comrad test` makes, else the one that runs this. Where none has them the program reports it in one line that begins with
"[  SKIPPED ] 1" and ends with code 77.
"""
import argparse
import csv
import math
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile

SKIPPED = 77  # exit code that ctest reads as "skipped"
BUTTONS = [
    ("fwd", "MOVE_FORWARD"), ("back", "MOVE_BACKWARD"), ("left", "MOVE_LEFT"), ("right", "MOVE_RIGHT"),
    ("turnl", "TURN_LEFT"), ("turnr", "TURN_RIGHT"), ("attack", "ATTACK"), ("speed", "SPEED"), ("use", "USE"),
    ("jump", "JUMP"), ("crouch", "CROUCH"), ("turn180", "TURN180"), ("dyaw", "TURN_LEFT_RIGHT_DELTA"),
    ("dpitch", "LOOK_UP_DOWN_DELTA"), ("dfwd", "MOVE_FORWARD_BACKWARD_DELTA"), ("dside", "MOVE_LEFT_RIGHT_DELTA"),
]
VARIABLES = [
    "POSITION_X", "POSITION_Y", "POSITION_Z", "ANGLE", "PITCH", "VELOCITY_X", "VELOCITY_Y", "VELOCITY_Z", "VIEW_HEIGHT",
    "ON_GROUND", "HEALTH", "ARMOR", "SELECTED_WEAPON", "ATTACK_READY", "AMMO2", "KILLCOUNT", "HITCOUNT", "HITS_TAKEN",
    "DAMAGECOUNT", "DAMAGE_TAKEN", "DEAD",
]


# ---------------------------------------------------------------- a Python that has vizdoom


def has_vizdoom(python):
    return subprocess.run([python, "-c", "import vizdoom, numpy"], capture_output=True).returncode == 0


def find_python(venv):
    """The path of a Python that can import vizdoom; None and why where there is none."""
    chosen = os.environ.get("COMRAD_TEST_PYTHON")
    for python in [chosen] if chosen else [os.path.join(venv, "bin", "python"), sys.executable]:
        if shutil.which(python) and has_vizdoom(python):
            return python, ""
    if chosen:
        return None, f"COMRAD_TEST_PYTHON={chosen} cannot import vizdoom and numpy"
    return None, ("no Python here can import vizdoom and numpy: ./comrad test installs them "
                  "(deploy/requirements_test.txt), or set COMRAD_TEST_PYTHON to one that can")


def import_vizdoom(venv, tested):
    """The package. Where this Python lacks it the program begins again with one that has it, or ends as skipped."""
    try:
        import vizdoom
        return vizdoom
    except ImportError:
        python, why = find_python(venv)
        if python is None:
            print("[  SKIPPED ] 1 test, %s: %s" % (tested, why))
            sys.exit(SKIPPED)
        os.execv(python, [python, "-B"] + sys.argv)


# ---------------------------------------------------------------- the two engines


def vizdoom_game(vzd, cfg, seed, args, buttons, objects=False):
    game = vzd.DoomGame()
    game.load_config(cfg)
    game.set_seed(seed)
    game.set_mode(vzd.Mode.PLAYER)
    game.set_window_visible(False)
    game.set_sound_enabled(False)
    game.set_screen_resolution(vzd.ScreenResolution.RES_160X120)
    game.set_available_buttons([getattr(vzd.Button, name) for name in buttons])
    game.set_available_game_variables([getattr(vzd.GameVariable, name) for name in VARIABLES])
    game.set_episode_timeout(0)
    game.set_objects_info_enabled(objects)
    for arg in args:
        game.add_game_args(arg)
    game.init()
    return game


def play_vizdoom(vzd, cfg, seed, columns, rows, no_monsters=False, objects=False, limit=None):
    """Rows as a trace has them, row 0 first; things as [(t, id, name, x, y, z)]."""
    game = vizdoom_game(vzd, cfg, seed, ["-nomonsters"] if no_monsters else [], [name for _, name in columns], objects)
    try:
        wanted = [getattr(vzd.GameVariable, name) for name in VARIABLES]
        result, things = [], []

        def note(t, reward, total):
            row = {name: game.get_game_variable(variable) for name, variable in zip(VARIABLES, wanted)}
            row.update(t=t, map_tic=game.get_episode_time(), reward=reward, total_reward=total,
                       finished=int(game.is_episode_finished()))
            result.append(row)
            state = game.get_state() if objects else None
            if state is not None:
                things.extend((t, o.id, o.name, o.position_x, o.position_y, o.position_z) for o in state.objects)

        total = 0.0
        note(0, 0.0, 0.0)
        for t, row in enumerate(rows, 1):
            reward = game.make_action([float(v) for v in row], 1)
            total += reward
            note(t, reward, total)
            if game.is_episode_finished():
                break
        return result, things
    finally:
        game.close()


def write_actions(path, columns, rows):
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([short for short, _ in columns])
        writer.writerows(rows)


def read_rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def play_comrad(binary, cfg, seed, columns, rows, folder, no_monsters=False, start=None, objects=False, more=()):
    actions, out, things = (os.path.join(folder, name) for name in ("actions.csv", "out.csv", "things.csv"))
    write_actions(actions, columns, rows)
    command = [binary, cfg, "--actions", actions, "--seed", str(seed), "--out", out, "--no-timeout", *more]
    if no_monsters:
        command.append("--no-monsters")
    if objects:
        command += ["--things", things]
    if start is not None:
        path = os.path.join(folder, "start.csv")
        with open(path, "w", newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(start))
            writer.writeheader()
            writer.writerow({k: "%.9f" % v if isinstance(v, float) else v for k, v in start.items()})
        command += ["--start-from", path]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError("comrad-trace failed: " + done.stderr.strip())
    result = [{k: float(v) for k, v in row.items() if v not in (None, "")} for row in read_rows(out)]
    listed = []
    if objects:
        listed = [(int(r["t"]), int(r["id"]), r["name"], float(r["x"]), float(r["y"]), float(r["z"]))
                  for r in read_rows(things)]
    return result, listed


# ---------------------------------------------------------------- statistics


def normal_tail(z):
    return 0.5 * math.erfc(z / math.sqrt(2.0))


def chi_square_tail(value, degrees):
    """P(X >= value), Wilson and Hilferty's approximation."""
    if degrees <= 0:
        return 1.0
    third = 2.0 / (9.0 * degrees)
    return normal_tail(((value / degrees) ** (1.0 / 3.0) - (1.0 - third)) / math.sqrt(third))


def chi_square(a, b):
    """Two samples of numbers. Returns (p, degrees)."""
    keys = sorted(set(a) | set(b))
    cells, x, y = [], 0, 0
    for key in keys:
        x += a.count(key)
        y += b.count(key)
        if x + y >= 10:
            cells.append((x, y))
            x = y = 0
    if x + y:
        if cells:
            last = cells.pop()
            cells.append((last[0] + x, last[1] + y))
        else:
            cells.append((x, y))
    ratio = math.sqrt(len(b) / len(a))
    value = sum((p * ratio - q / ratio) ** 2 / (p + q) for p, q in cells)
    return chi_square_tail(value, len(cells) - 1), len(cells) - 1


def kolmogorov_smirnov(a, b):
    a, b = sorted(a), sorted(b)
    i = j = 0
    largest = 0.0
    while i < len(a) and j < len(b):
        value = min(a[i], b[j])
        while i < len(a) and a[i] == value:
            i += 1
        while j < len(b) and b[j] == value:
            j += 1
        largest = max(largest, abs(i / len(a) - j / len(b)))
    return kolmogorov_tail(largest, len(a) * len(b) / (len(a) + len(b)))


def kolmogorov_smirnov_uniform(values):
    """p of numbers in 0..1 that should be uniform."""
    values, count = sorted(values), len(values)
    return kolmogorov_tail(max(max((i + 1) / count - value, value - i / count) for i, value in enumerate(values)), count)


def kolmogorov_tail(largest, count):
    """P of a distance as large between a distribution and `count` draws of it, by Stephens's approximation."""
    root = math.sqrt(count)
    z = (root + 0.12 + 0.11 / root) * largest
    return min(1.0, max(0.0, 2.0 * sum((-1) ** (k - 1) * math.exp(-2.0 * k * k * z * z) for k in range(1, 101))))


class Report:
    def __init__(self):
        self.failed = 0

    def check(self, name, passed, detail):
        print("%s %s: %s" % ("[       OK ]" if passed else "[  FAILED  ]", name, detail), flush=True)
        self.failed += not passed

    def distribution(self, name, ours, theirs, tail=1e-4):
        if len(ours) < 20 or len(theirs) < 20:
            self.check(name, False, "too few values: %d and %d" % (len(ours), len(theirs)))
            return
        p, degrees = chi_square(ours, theirs)
        self.check(name, p > tail, "chi-square p = %.4f, %d degrees, n = %d and %d, means %.3f and %.3f" % (
            p, degrees, len(ours), len(theirs), sum(ours) / len(ours), sum(theirs) / len(theirs)))

    def continuous(self, name, ours, theirs, tail=1e-4):
        p = kolmogorov_smirnov(ours, theirs)
        self.check(name, p > tail, "Kolmogorov-Smirnov p = %.4f, n = %d and %d, means %.3f and %.3f" % (
            p, len(ours), len(theirs), sum(ours) / len(ours), sum(theirs) / len(theirs)))


# ---------------------------------------------------------------- traces


def random_script(seed, tics):
    """Each binary button is held for up to 20 tics at a time, deltas come now and then."""
    chance = {"fwd": 0.6, "back": 0.15, "left": 0.2, "right": 0.2, "turnl": 0.2, "turnr": 0.2, "attack": 0.3,
              "speed": 0.4, "use": 0.1, "jump": 0.12, "crouch": 0.08, "turn180": 0.02}
    generator = random.Random(seed)
    left, held = {}, {}
    rows = []
    for _ in range(tics):
        row = []
        for short, _ in BUTTONS:
            if short in chance:
                if left.get(short, 0) <= 0:
                    left[short] = generator.randint(1, 20)
                    held[short] = int(generator.random() < chance[short])
                left[short] -= 1
                row.append(held[short])
            elif generator.random() < 0.1:
                row.append(round(generator.uniform(-20, 20), 2))
            else:
                row.append(0)
        rows.append(row)
    return rows


def compare_rows(name, ours, theirs, report):
    if len(ours) != len(theirs):
        report.check(name, False, "%d rows against ViZDoom's %d" % (len(ours), len(theirs)))
        return
    exact = ["ANGLE", "PITCH", "HEALTH", "ARMOR", "SELECTED_WEAPON", "ATTACK_READY", "AMMO2", "HITS_TAKEN", "DAMAGE_TAKEN",
             "DEAD", "ON_GROUND", "reward", "finished", "map_tic"]
    if name.startswith("health_gathering"):
        # Kits lie where each engine's own chance puts them: healing is left out of the comparison.
        exact = [c for c in exact if c not in ("HEALTH", "DEAD")]
    largest = 0.0
    for a, b in zip(ours, theirs):
        place = max(abs(a[c] - b[c]) for c in ("POSITION_X", "POSITION_Y", "POSITION_Z"))
        largest = max(largest, place)
        if place > 0.01:
            report.check(name, False, "tic %d: position off by %.4f" % (b["t"], place))
            return
        for column in exact:
            tolerance = 1e-6 if column in ("ANGLE", "PITCH") else 5e-6
            if abs(a[column] - b[column]) > tolerance:
                report.check(name, False, "tic %d: %s is %s, ViZDoom's %s" % (b["t"], column, a[column], b[column]))
                return
    report.check(name, True, "%d tics, position within %.6f" % (len(theirs) - 1, largest))


def run_traces(vzd, binary, only, report):
    scenarios = os.path.join(os.path.dirname(vzd.__file__), "scenarios")
    for scenario in ("basic", "health_gathering", "my_way_home", "take_cover"):
        for seed in (1, 2, 3):
            name = "%s/%d" % (scenario, seed)
            if only and only not in name:
                continue
            cfg = os.path.join(scenarios, scenario + ".cfg")
            rows = random_script(seed, 350)
            theirs, _ = play_vizdoom(vzd, cfg, seed, BUTTONS, rows, no_monsters=True)
            with tempfile.TemporaryDirectory() as folder:
                ours, _ = play_comrad(binary, cfg, seed, BUTTONS, rows, folder, no_monsters=True, start=theirs[0])
            compare_rows(name, ours, theirs, report)


# ---------------------------------------------------------------- a range of our own


DECORATE = """
actor BigHeart : Health 20000
{
  Inventory.Amount 100000000
  Inventory.MaxAmount 100000000
  +INVENTORY.ALWAYSPICKUP
  States
  {
  Spawn:
    MEDI A -1
    stop
  }
}
actor Dummy 20001
{
  Health 100000000
  Radius %(radius)d
  Height 56
  Mass 1000000000
  +SHOOTABLE
  +SOLID
  +NOBLOOD
  States
  {
  Spawn:
    POSS A -1
    stop
  }
}
actor RocketStack : RocketAmmo 20003
{
  Inventory.Amount 50
}
actor CellStack : Cell 20004
{
  Inventory.Amount 300
}
"""


def range_wad(things, radius=20, room=(-256, -512, 2048, 512)):
    """One sector; things are (type, x, y, angle)."""
    left, bottom, right, top = room
    text = 'namespace = "zdoom";\n'
    for x, y in ((left, bottom), (left, top), (right, top), (right, bottom)):
        text += "vertex { x = %d.0; y = %d.0; }\n" % (x, y)
    for i in range(4):
        text += "linedef { v1 = %d; v2 = %d; sidefront = %d; blocking = true; }\n" % (i, (i + 1) % 4, i)
    text += 'sidedef { sector = 0; texturemiddle = "BRICK9"; }\n' * 4
    text += 'sector { heightfloor = 0; heightceiling = 256; texturefloor = "FLAT4"; textureceiling = "FLOOR0_1"; }\n'
    for kind, x, y, angle in things:
        text += ("thing { x = %d.0; y = %d.0; angle = %d; type = %d; skill1 = true; skill2 = true; skill3 = true; "
                 "skill4 = true; skill5 = true; single = true; dm = true; coop = true; class1 = true; }\n" %
                 (x, y, angle, kind))
    lumps = [("DECORATE", (DECORATE % {"radius": radius}).encode()), ("MAP01", b""), ("TEXTMAP", text.encode()), ("ENDMAP", b"")]
    body, directory = b"", b""
    for name, data in lumps:
        directory += struct.pack("<ii8s", 12 + len(body), len(data), name.encode())
        body += data
    return struct.pack("<4sii", b"PWAD", len(lumps), 12 + len(body)) + body + directory


def range_cfg(folder, wad, skill=3):
    with open(os.path.join(folder, "range.wad"), "wb") as file:
        file.write(wad)
    cfg = os.path.join(folder, "range.cfg")
    with open(cfg, "w") as file:
        file.write("doom_scenario_path = range.wad\ndoom_map = map01\ndoom_skill = %d\nepisode_start_time = 14\n"
                   "available_buttons = { ATTACK }\nmode = PLAYER\n" % skill)
    return cfg


WEAPON_COLUMNS = [("attack", "ATTACK"), ("fwd", "MOVE_FORWARD"), ("SELECT_WEAPON%d", "SELECT_WEAPON%d"), ("dyaw", "TURN_LEFT_RIGHT_DELTA")]

# name, slot, things to take (at the player's feet), distance, tics from shot to shot, shots, what to compare
WEAPONS = [
    ("fist", 1, [], 52, 26, 250),
    ("pistol", 2, [], 500, 20, 250),
    ("pistol burst", 2, [], 500, 14, 250),
    ("shotgun", 3, [2001], 500, 46, 250),
    ("super shotgun", 3, [82], 400, 66, 200),
    ("chaingun", 4, [2002], 500, 12, 250),
    ("rocket launcher", 5, [2003], 700, 60, 120),
    ("plasma rifle", 6, [2004], 300, 45, 200),
]
AMMO = {"shotgun": 2049, "super shotgun": 2049, "rocket launcher": 20003, "plasma rifle": 20004}


def shots_of(rows, first, period, count, held):
    """Damage and hits of each period."""
    damage, hits = [], []
    for i in range(count):
        begin, end = first + i * period, first + (i + 1) * period
        if end >= len(rows):
            break
        damage.append(int(rows[end]["DAMAGECOUNT"] - rows[begin]["DAMAGECOUNT"]))
        hits.append(int(rows[end]["HITCOUNT"] - rows[begin]["HITCOUNT"]))
    return damage, hits


def run_weapons(vzd, binary, only, report):
    for name, slot, take, distance, period, count in WEAPONS:
        if only and only not in name:
            continue
        # The player walks over its weapon and much ammunition, then stands before the dummy.
        things = [(1, 0, 0, 0), (20001, distance + 100, 0, 180)]
        things += [(kind, 40, 0, 0) for kind in take]
        ammo = AMMO.get(name, 2048)
        things += [(ammo, 60 + 2 * i, 0, 0) for i in range(4)]
        columns = [tuple(text % slot if "%" in text else text for text in pair) for pair in WEAPON_COLUMNS]
        start = 20 + 60
        per_episode = {"shotgun": 40, "super shotgun": 20, "rocket launcher": 40}.get(name, 150)
        ours, theirs = ([], []), ([], [])
        episode = 0
        with tempfile.TemporaryDirectory() as folder:
            cfg = range_cfg(folder, range_wad(things))
            while len(theirs[0]) < count:
                shots = min(per_episode, count - len(theirs[0]))
                rows = [[0, 1 if 0 <= t < 14 else 0, 0, 0] for t in range(40)]
                rows += [[0, 0, 1, 0]] * 5 + [[0, 0, 0, 0]] * (start - 45)
                held = name == "pistol burst"
                for _ in range(shots):
                    rows += [[1, 0, 0, 0]] * (period if held else 2) + [[0, 0, 0, 0]] * (0 if held else period - 2)
                rows += [[0, 0, 0, 0]] * 20
                seed = 100 + episode
                theirs_rows, _ = play_vizdoom(vzd, cfg, seed, columns, rows)
                ours_rows, _ = play_comrad(binary, cfg, seed, columns, rows, folder)
                last_a, last_b = ours_rows[start - 1], theirs_rows[start - 1]
                if last_a["SELECTED_WEAPON"] != last_b["SELECTED_WEAPON"] or abs(last_a["POSITION_X"] - last_b["POSITION_X"]) > 0.01:
                    report.check(name, False, "weapon in the hand %s against %s, x %s against %s" % (
                        last_a["SELECTED_WEAPON"], last_b["SELECTED_WEAPON"], last_a["POSITION_X"], last_b["POSITION_X"]))
                    break
                for rows_of, into in ((ours_rows, ours), (theirs_rows, theirs)):
                    damage, hits = shots_of(rows_of, start, period, shots, held)
                    into[0].extend(damage)
                    into[1].extend(hits)
                episode += 1
        report.distribution(name + ", damage a shot", ours[0], theirs[0])
        report.distribution(name + ", hits a shot", ours[1], theirs[1])


# name, editor number, distance from the player, plays, tics of each. The demon has twelve plays because four were too
# few: seconds of one play resemble each other, and four plays differed where twelve and sixteen do not.
MONSTERS = [
    ("ZombieMan", 3004, 300, 4, 1500), ("ShotgunGuy", 9, 300, 4, 1500), ("ChaingunGuy", 65, 300, 4, 1500),
    ("DoomImp", 3001, 300, 4, 2000), ("Demon", 3002, 120, 12, 1500), ("LostSoul", 3006, 300, 4, 1500),
    ("Cacodemon", 3005, 300, 4, 2000), ("HellKnight", 69, 300, 4, 2000), ("BaronOfHell", 3003, 300, 4, 2000),
]


def walk_lengths(things, name, stretch=35):
    """How far it came in each second, as the sum of its steps."""
    places = [(t, x, y) for t, _, kind, x, y, _ in things if kind.lower() == name.lower()]
    lengths = []
    for i in range(0, len(places) - stretch, stretch):
        part = places[i:i + stretch + 1]
        lengths.append(sum(math.hypot(b[1] - a[1], b[2] - a[2]) for a, b in zip(part, part[1:])))
    return lengths


def hit_sizes(rows, hits):
    """Damage of the tics in which so many hits were taken; None: any number, as of a shotgun's pellets."""
    return [int(b["DAMAGE_TAKEN"] - a["DAMAGE_TAKEN"]) for a, b in zip(rows, rows[1:])
            if b["HITS_TAKEN"] != a["HITS_TAKEN"] and hits in (None, b["HITS_TAKEN"] - a["HITS_TAKEN"])]


def run_monsters(vzd, binary, only, report):
    columns = [("fwd", "MOVE_FORWARD"), ("attack", "ATTACK")]
    for name, number, distance, plays, tics in MONSTERS:
        if only and only.lower() not in name.lower():
            continue
        things = [(1, 0, 0, 0), (20000, 30, 0, 0), (number, distance + 60, 0, 180)]
        # Several short plays: where a monster walks keeps for a long while.
        rows = [[1 if t < 8 else 0, 0] for t in range(tics)]
        damage, hits, walks = ([], []), [0, 0], ([], [])
        with tempfile.TemporaryDirectory() as folder:
            cfg = range_cfg(folder, range_wad(things, room=(-256, -512, 512, 512)))
            for seed in range(7, 7 + plays):
                both = (play_comrad(binary, cfg, seed, columns, rows, folder, objects=True),
                        play_vizdoom(vzd, cfg, seed, columns, rows, objects=True))
                for side, (played, listed) in enumerate(both):
                    damage[side].extend(hit_sizes(played, None if name == "ShotgunGuy" else 1))
                    hits[side] += int(played[-1]["HITS_TAKEN"] - played[0]["HITS_TAKEN"])
                    walks[side].extend(walk_lengths(listed, name))
        report.distribution(name + ", damage a hit", damage[0], damage[1])
        print("    hits in 1000 tics: %.2f and ViZDoom's %.2f" % tuple(1000.0 * h / (len(rows) * plays) for h in hits))
        report.continuous(name + ", units a second", walks[0], walks[1])


# ---------------------------------------------------------------- every map


# Warnings that say what is so on purpose: mirrors are not drawn, buffers are not traced, an IWAD elsewhere, one map of
# several, linedefs without a back side, the frames that Freedoom of Debian 13 patches (vizdoom has its own Freedoom).
EXPLAINED = ("Line_Mirror", "is not served", "is played instead", "say which one with doom_map", "taken as one-sided",
             "freedoom2.wad DEHACKED")


def maps_of(path):
    """Names of the maps of a WAD."""
    with open(path, "rb") as file:
        data = file.read()
    count, offset = struct.unpack_from("<ii", data, 4)
    names = [data[offset + 16 * i + 8:offset + 16 * i + 16].rstrip(b"\0").decode() for i in range(count)]
    return [names[i] for i in range(count - 1) if names[i + 1] in ("TEXTMAP", "THINGS")]


def run_scenarios(vzd, binary, only, report, tics):
    scenarios = os.path.join(os.path.dirname(vzd.__file__), "scenarios")
    jobs = []
    with tempfile.TemporaryDirectory() as folder:
        for name in sorted(os.listdir(scenarios)):
            path = os.path.join(scenarios, name)
            if name.endswith(".cfg") and name[:-4] not in ("doom", "doom2", "freedoom1", "oblige"):  # other IWADs
                jobs.append((name, path))
            if name.endswith(".wad"):
                for level in maps_of(path):
                    cfg = os.path.join(folder, "%s_%s.cfg" % (name[:-4], level))
                    with open(cfg, "w") as file:
                        file.write("doom_scenario_path = %s\ndoom_map = %s\navailable_buttons = { MOVE_FORWARD MOVE_LEFT "
                                   "TURN_LEFT TURN_RIGHT ATTACK USE SPEED JUMP SELECT_NEXT_WEAPON }\n" % (path, level))
                    jobs.append(("%s %s" % (name, level), cfg))
        for name, cfg in jobs:
            if only and only not in name:
                continue
            messages, rows, same = set(), 0, True
            for seed in range(1, 100):  # episodes end; another one continues
                outputs = []
                for _ in range(2):
                    out = os.path.join(folder, "out.csv")
                    done = subprocess.run([binary, cfg, "--random", str(tics), "--seed", str(seed), "--hash", "--no-timeout",
                                           "--out", out], capture_output=True, text=True)
                    messages.update(line for line in done.stderr.splitlines()
                                    if not any(word in line for word in EXPLAINED))
                    if done.returncode:
                        messages.add("exit code %d" % done.returncode)
                    outputs.append(open(out).read() if os.path.exists(out) else "")
                rows += outputs[0].count("\n") - 3
                same = same and outputs[0] == outputs[1] and rows > 0
                if rows >= tics or not same or messages:
                    break
            report.check(name, same and not messages, "%d tics%s%s" % (
                rows, "" if same else ", not the same twice", "".join("; " + m for m in sorted(messages))))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", choices=("traces", "weapons", "monsters", "scenarios"))
    parser.add_argument("--trace", required=True, help="the program comrad-trace")
    parser.add_argument("--venv", default=os.path.join(os.path.dirname(__file__), "../../build/test-python"))
    parser.add_argument("--only", default="")
    parser.add_argument("--tics", type=int, default=2000, help="of each map of `scenarios`")
    arguments = parser.parse_args()
    vzd = import_vizdoom(arguments.venv, "parity with ViZDoom")
    binary = os.path.abspath(arguments.trace)
    here = os.getcwd()
    folder = tempfile.mkdtemp()  # ViZDoom leaves its settings where it runs
    os.chdir(folder)
    report = Report()
    try:
        if arguments.suite == "scenarios":
            run_scenarios(vzd, binary, arguments.only, report, arguments.tics)
        else:
            {"traces": run_traces, "weapons": run_weapons, "monsters": run_monsters}[arguments.suite](
                vzd, binary, arguments.only, report)
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)
    print("%d failed" % report.failed)
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
