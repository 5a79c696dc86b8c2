#!/usr/bin/env python3
"""Draws small games from a seed, plays them in ViZDoom and in COMRAD with the same buttons, and compares every variable.

    random_games.py --trace BIN --acs BIN [--seeds 1-500] [--explained FILE] [--keep DIR] [--shrink]

A game is a room of islands that are higher, lower, shut or hurtful, with things of random UDMF fields, actors of a random
DECORATE lump, lines with specials, a script that does something at random tics and writes what it reads into USER1.., and
random game arguments and rewards. 350 tics of random buttons: every game variable and the reward must be the same after each
tic, positions within 0.01 unit, velocities within 2 of 65536. The first difference of a game is printed; --keep writes its WAD, cfg,
buttons and script,
--shrink first leaves out of it what the difference does not need.

What each engine draws from its own chance is left out by construction: shots that spread or hit for a random amount meet no
body, actors of the map begin with a state of one tic (the first state's length of a thing of the map is drawn), monsters are
dormant and drop nothing, one deathmatch start at most, fields of chance in actions are 0. Nor are things counted that a script
just gave: ViZDoom keeps them for a tic. What else is left out is in sim_workers/PARITY.md. A game in which ViZDoom differs from
itself, played again with the same seed or with another, is printed as such and fails nothing; nor does one in which it crashes.

--explained names a list of the seeds that may differ (explained_seeds.txt). A seed that differs and is not in it fails, as do one
that differs at another tic or in another variable than listed, and a listed one that agrees.

Needs a Python with `vizdoom`, as vizdoom_parity.py, whose engines and buttons it takes.
"""
import argparse
import copy
import os
import pickle
import random
import re
import shutil
import struct
import subprocess
import sys
import tempfile

from vizdoom_parity import BUTTONS, Report, import_vizdoom, play_comrad, random_script, vizdoom_game, write_actions

TICS = 350
SECTIONS = ("chance", "explained", "not yet explained")  # of a list of seeds that may differ
CHANCE_SEEDS = (1, 2, 3, 4, 5, 6, 7, 8)  # two ways of equal chance both show in all but one of 128 games
PLACES = ("POSITION_X", "POSITION_Y", "POSITION_Z", "CAMERA_POSITION_X", "CAMERA_POSITION_Y", "CAMERA_POSITION_Z",
    "VIEW_HEIGHT")
VARIABLES = [
    "KILLCOUNT", "ITEMCOUNT", "SECRETCOUNT", "FRAGCOUNT", "DEATHCOUNT", "HITCOUNT", "HITS_TAKEN", "DAMAGECOUNT", "DAMAGE_TAKEN",
    "HEALTH", "ARMOR", "DEAD", "ON_GROUND", "ATTACK_READY", "ALTATTACK_READY", "SELECTED_WEAPON", "SELECTED_WEAPON_AMMO",
    *["AMMO%d" % i for i in range(10)], *["WEAPON%d" % i for i in range(10)],
    "POSITION_X", "POSITION_Y", "POSITION_Z", "ANGLE", "PITCH", "ROLL", "VIEW_HEIGHT", "VELOCITY_X", "VELOCITY_Y", "VELOCITY_Z",
    "CAMERA_POSITION_X", "CAMERA_POSITION_Y", "CAMERA_POSITION_Z", "CAMERA_ANGLE", "CAMERA_PITCH", "CAMERA_ROLL", "CAMERA_FOV",
    "PLAYER_NUMBER", "PLAYER_COUNT", "PLAYER1_FRAGCOUNT", "PLAYER2_FRAGCOUNT",
]
MORE_BUTTONS = [
    ("ALTATTACK", "ALTATTACK"), ("SELECT_NEXT_WEAPON", "SELECT_NEXT_WEAPON"), ("SELECT_PREV_WEAPON", "SELECT_PREV_WEAPON"),
    ("ACTIVATE_SELECTED_ITEM", "ACTIVATE_SELECTED_ITEM"), ("SELECT_NEXT_ITEM", "SELECT_NEXT_ITEM"),
    *[("SELECT_WEAPON%d" % i, "SELECT_WEAPON%d" % i) for i in range(1, 8)],
]
SELECTORS = [name for name, _ in MORE_BUTTONS[1:]]
ITEMS = [2011, 2012, 2014, 2013, 83, 2015, 2018, 2019, 2007, 2048, 2008, 2049, 2010, 2046, 2047, 17, 8, 5, 6, 13, 38, 39, 40,
    2022,
         2023, 2024, 2025, 2026, 2045]
WEAPONS = [2001, 82, 2002, 2003, 2004, 2005, 2006]
SCENERY = [30, 35, 43, 47, 2028, 34, 15, 24, 63, 79, 80]
TARGETS = [2035, 2035, 3001, 3002, 3005, 69]  # barrels; monsters that drop nothing
CLASSES = ["Stimpack", "Medikit", "HealthBonus", "Soulsphere", "Megasphere", "ArmorBonus", "GreenArmor", "BlueArmor", "Clip",
    "ClipBox",
           "Shell", "ShellBox", "RocketAmmo", "RocketBox", "Cell", "CellPack", "Backpack", "RedCard", "BlueSkull", "Berserk",
           "BlurSphere", "InvulnerabilitySphere", "RadSuit", "Infrared"]
GAME_FLAGS = ["nohealth", "weaponstay", "oldfalldamage", "falldamage", "spawnfarthest", "noarmor", "noexit", "itemrespawn",
    "fastmonsters", "allowjump", "noweaponspawn", "allowcrouch", "cooploseinventory", "cooplosekeys", "cooploseweapons",
    "cooplosearmor", "cooplosepowerups", "cooploseammo", "coophalveammo", "weapondrop", "doubleammo", "degeneration",
    "barrelrespawn", "respawnprotect", "samespawnspot", "norespawn", "infiniteinventory", "killallmonsters", "respawnsuper"]
FLAGS = ["skill1", "skill2", "skill3", "skill4", "skill5", "single", "coop", "dm", "class1"]


# ---------------------------------------------------------------- drawing


class Drawer:
    """Draws one game. Its parts are lists from which any element can be left out."""

    def __init__(self, seed):
        self.seed = seed
        self.r = random.Random("game %d" % seed)
        r = self.r
        self.with_targets = r.random() < 0.6
        self.skill = r.randint(1, 5)
        self.args, self.cfg = [], []
        self.islands, self.things, self.actors, self.deeds, self.readings, self.lines = [], [], [], [], [], []
        self.weapons, self.missiles, self.pickups, self.bodies = [], [], [], []
        self.draw_arguments()
        self.draw_islands()
        self.draw_actors()
        self.draw_things()
        self.draw_script()
        rows = random_script(seed, TICS)
        held, left = {}, {}
        self.rows = []
        for row in rows:
            # Of the weapon keys one at a time: a player's input here has room for one.
            for name in ("ALTATTACK", "select"):
                if left.get(name, 0) <= 0:
                    left[name] = r.randint(1, 12)
                    held[name] = int(r.random() < 0.15) if name == "ALTATTACK" else r.choice(SELECTORS + [""] * 2 * len(SELECTORS))
                left[name] -= 1
            self.rows.append(row + [held["ALTATTACK"]] + [int(held["select"] == name) for name in SELECTORS])

    def some(self, chance):
        return self.r.random() < chance

    def place(self, far=64):
        """A place of the room that is not at the start and in no shut island."""
        while True:
            x, y = self.r.randint(-460, 460), self.r.randint(-460, 460)
            shut = any(island["fields"]["heightfloor"] == island["fields"]["heightceiling"] and
                max(abs(x - island["x"]), abs(y - island["y"])) < island["half"] + 64 for island in self.islands)
            if max(abs(x), abs(y)) > far and not shut:
                return x, y

    def draw_arguments(self):
        r = self.r
        if self.some(0.15):
            self.args.append("-deathmatch")
        if self.some(0.15):
            self.args.append("-host 1")
        for name, values in (("sv_nojump", (1,)), ("sv_nocrouch", (1,)), ("sv_nofreelook", (1,)), ("sv_noautoaim", (1,)),
                             ("sv_infiniteammo", (1,)), ("sv_forcerespawn", (1,)), ("cl_run", (1,))):
            if self.some(0.06):
                self.args.append("+%s %d" % (name, r.choice(values)))
        # From separate dice, so that the other parts of a seed's game stay what they were.
        own = random.Random("flags %d" % self.seed)
        for name in GAME_FLAGS:
            if own.random() < 0.03:
                self.args.append("+sv_%s 1" % name)
        if own.random() < 0.03:
            self.args.append("+sv_gravity %d" % own.choice([0, 400, 1600]))
        if own.random() < 0.03:
            self.args.append("+sv_aircontrol %s" % own.choice(["1", "0.1"]))
        for name in ("living_reward", "death_penalty", "kill_reward", "secret_reward", "item_reward", "hit_reward",
            "hit_taken_reward",
                     "damage_made_reward", "damage_taken_reward", "health_reward", "armor_reward", "map_exit_reward"):
            if self.some(0.3):
                self.cfg.append("%s = %d" % (name, r.randint(-9, 9)))

    def draw_islands(self):
        r = self.r
        cells = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
        for number, (i, j) in enumerate(r.sample(cells, r.randint(1, 6)), 1):
            fields = {"heightfloor": r.choice([-64, -24, -8, 0, 0, 8, 16, 24, 24, 32, 56, 72]),
                "heightceiling": r.choice([128, 192, 256, 256])}
            if self.some(0.1):
                fields["heightceiling"] = fields["heightfloor"]
            if self.some(0.35):
                fields["special"] = r.choice([1024, 68 + 1024, 69, 71, 72, 115, 256 + 71, 8, 12, 65, 66, 2048, 75])
            elif self.some(0.15):
                fields["damageamount"] = r.choice([1, 3, 20, 120])
                fields["damageinterval"] = r.choice([8, 32, 35])
                if self.some(0.3):
                    fields["damagetype"] = '"Fire"'
            if self.some(0.15):
                fields["gravity"] = r.choice([0.25, 0.5, 2.0])
            island = {"id": number, "x": 320 * i, "y": 320 * j, "half": r.choice([64, 96, 128]), "turned": self.some(0.25),
                "fields": fields}
            self.islands.append(island)
            for side in range(4):
                if self.some(0.35):
                    self.lines.append(self.line_special(number, side))
        for side in range(4):
            if self.some(0.2):
                self.lines.append(self.line_special(0, side))

    def line_special(self, island, side):
        r = self.r
        tag = r.choice([island or 1, r.randint(1, 4)])
        special, args = r.choice([
            (12, (tag, r.choice([16, 32, 64]), r.choice([17, 35, 150]))), (11, (tag, r.choice([16, 64]), 0)),
            (62, (tag, r.choice([16, 32, 64]), r.choice([17, 35, 105]))), (23, (tag, r.choice([4, 16, 64]),
                r.choice([8, 16, 24, 48]))),
            (20, (tag, r.choice([8, 16]), r.choice([8, 24]))), (70, (90, 0, 0)), (71, (90, 0, 0)), (80,
                (2, 0, r.randint(0, 9), r.randint(0, 9))),
            (226, (2, 0, r.randint(0, 9))), (72, (r.randrange(256), r.randint(1, 20), r.randint(0, 1), 0)), (73,
                (r.randint(1, 15), 0, 0)),
            (248, (r.randint(1, 30), r.choice([0, 150]), 0)), (128, (0, r.randint(1, 60), 0, r.randint(0, 1))), (154,
                (90, 0, 0)),
            (25, (tag, 16)), (22, (tag, 16)), (64, (tag, 32, 35)), (96, (tag, 16, 16)), (41, (tag, 8, 16)), (40, (tag, 8, 16)),
            (37, (tag, 32, r.randint(0, 40), r.randint(0, 1))), (138, (tag, 32, 16, 0, 0)), (13,
                (tag, 32, 35, r.choice([1, 2, 129]))),
        ])
        way = r.choice(["playercross", "playercross", "playeruse", "playeruse", "anycross", "impact", "playerpush"])
        fields = {"special": special, way: "true", "repeatspecial": "true" if self.some(0.6) else "false"}
        fields.update(("arg%d" % i, value) for i, value in enumerate(args))
        return {"island": island, "side": side, "fields": fields}

    # ------------------------------------------------ DECORATE

    def add_actor(self, kind, parent, number, lines, states):
        name = "Drawn%s%d" % (kind, len(self.actors))
        body = ["  " + line for line in lines]
        text = "actor %s%s%s\n{\n%s\n  States\n  {\n%s\n  }\n}\n" % (name, " : " + parent if parent else "",
            " %d" % number if number else "",
                                                             "\n".join(body), "\n".join("  " + line for line in states))
        self.actors.append({"name": name, "number": number, "lines": lines, "text": text})
        return name

    def action(self, depth=0):
        """An action without chance that any actor may do."""
        r = self.r
        choices = [
            lambda: "A_Explode(%d, %d%s)" % (r.choice([0, 5, 20, 64, 128]), r.choice([32, 64, 128, 200]),
                r.choice(["", ", 0", ", 1", ", 1, 0, %d" % r.choice([0, 16, 64])])),
            lambda: "A_RadiusThrust(%d, %d%s)" % (r.choice([100, 1000, 4000]), r.choice([64, 128, 256]),
                r.choice(["", ", 0", ", 1", ", RTF_NOIMPACTDAMAGE"])),
            lambda: "A_ChangeVelocity(%d, %d, %d, %d)" % (r.randint(-6, 6), r.randint(-6, 6), r.randint(-2, 9),
                r.randint(0, 3)),
            lambda: "A_ScaleVelocity(%s)" % r.choice(["0.5", "1.5", "-1.0", "0"]),
            lambda: "ThrustThing(%d, %d, %d, 0)" % (r.randrange(256), r.randint(1, 12), r.randint(0, 1)),
            lambda: "ThrustThingZ(0, %d, %d, %d)" % (r.randint(1, 40), r.randint(0, 1), r.randint(0, 1)),
            lambda: "A_Stop",
            lambda: "A_NoGravity",
            lambda: "A_Gravity",
            lambda: "A_LowGravity",
            lambda: "A_SetGravity(%s)" % r.choice(["0.3", "2.0"]),
            lambda: "A_SetSolid",
            lambda: "A_UnsetSolid",
            lambda: "A_SetShootable" if self.with_targets else "A_Stop",
            lambda: "A_UnSetShootable",
            lambda: "A_SetAngle(%d)" % r.randrange(360), lambda: "A_SetPitch(%d)" % r.randint(-40, 40),
            lambda: "A_DamageSelf(%d)" % r.randint(-5, 30), lambda: "A_FadeOut(%s)" % r.choice(["0.1", "0.3"]),
            lambda: "A_GiveInventory(\"%s\", %d)" % (r.choice(CLASSES), r.randint(1, 20)),
            lambda: "ACS_ExecuteAlways(2, 0, %d, %d, 0)" % (r.randint(0, 9), r.randint(0, 9)),
            lambda: "A_ChangeFlag(\"%s\", %d)" % (r.choice(["SOLID", "NOGRAVITY", "INVULNERABLE", "NOCLIP", "DROPOFF"]),
                r.randint(0, 1)),
            lambda: "DamageThing(%d)" % r.randint(1, 20), lambda: "HealThing(%d)" % r.randint(1, 20),
            lambda: "A_SpawnItem(\"%s\", %d, %d, 0)" % (r.choice(CLASSES + self.pickups), r.choice([0, 20, 40]),
                r.choice([0, 16])),
            lambda: self.spawn_item_ex(),
        ]
        if self.missiles:
            choices += [lambda: "A_CustomMissile(\"%s\", %d, %d, %d, 2, %d)" % (r.choice(self.missiles),
                r.choice([0, 16, 32]), r.choice([0, 8]), r.choice([0, 45, 180]), r.choice([0, -30, 20]))] * 2
        return r.choice(choices)()

    def spawn_item_ex(self):
        r = self.r
        return "A_SpawnItemEx(\"%s\", %d, %d, %d, %d, %d, %d, %d%s)" % (
            r.choice(CLASSES + self.pickups + self.bodies + self.missiles), r.randint(-40, 60), r.randint(-30,
                30), r.randint(0, 32), r.randint(-4, 8),
            r.randint(-4, 4), r.randint(-2, 8), r.choice([0, 90, 200]), r.choice(["", ", SXF_NOCHECKPOSITION",
                ", SXF_ABSOLUTEPOSITION", ", SXF_ABSOLUTEVELOCITY", ", SXF_SETMASTER"]))

    def steps(self, label, last, loud=0.7):
        """A sequence of states; the first is one tic long."""
        r = self.r
        lines = [label + ":", "  TNT1 A 1"]
        for _ in range(r.randint(0, 3)):
            lines.append("  TNT1 A %d%s" % (r.randint(1, 20), " " + self.action() if self.some(loud) else ""))
        return lines + ["  " + last]

    def draw_actors(self):
        r = self.r
        for _ in range(r.randint(0, 2)):
            lines = ["Projectile", "Speed %d" % r.choice([5, 10, 20, 35]), "Radius %d" % r.choice([4, 6, 11, 16]),
                "Height %d" % r.choice([4, 8, 16]),
                     "Damage (%d)" % r.choice([0, 3, 10, 40])]
            lines += r.sample(["+RIPPER", "-NOGRAVITY", "Gravity 0.3", "+NOEXTREMEDEATH", "+BLOODLESSIMPACT", "+THRUGHOST",
                "+FORCERADIUSDMG", "+PIERCEARMOR",
                               "DamageType Fire", "+SKYEXPLODE", "+DONTSPLASH", "+FLOORHUGGER"], r.randint(0, 2))
            states = ["Spawn:", "  TNT1 A 1", "  TNT1 A %d" % r.randint(1, 5), "  loop"] + self.steps("Death", "stop")
            self.missiles.append(self.add_actor("Missile", "", 20100 + len(self.actors), lines, states))
        for _ in range(r.randint(0, 3)):
            self.draw_pickup()
        for _ in range(r.randint(0, 3)):
            self.draw_body()
        for _ in range(r.randint(0, 2)):
            self.draw_weapon()

    def draw_pickup(self):
        r = self.r
        flags = r.sample(["+COUNTITEM", "+INVENTORY.ALWAYSPICKUP", "+INVENTORY.AUTOACTIVATE", "+INVENTORY.INVBAR",
            "+INVENTORY.QUIET", "+NOGRAVITY",
                          "+FLOATBOB", "+DROPPED", "+INVENTORY.IGNORESKILL"], r.randint(0, 3))
        flags += ["Radius %d" % r.choice([8, 20, 32])] if self.some(0.5) else []
        amount = "Inventory.Amount %d" % r.choice([1, 2, 7, 30])
        limit = "Inventory.MaxAmount %d" % r.choice([1, 5, 50, 130, 300])
        spawn = ["Spawn:", "  TNT1 A 1", "  TNT1 A -1", "  stop"]
        number = 20200 + len(self.actors)
        kind = r.randrange(7)
        if kind == 0:
            name = self.add_actor("Health", "Health", number, [amount, limit] + flags, spawn)
        elif kind == 1:
            name = self.add_actor("Armor", "BasicArmorPickup", number,
                ["Armor.SavePercent %s" % r.choice(["33.335", "50", "80", "100"]),
                    "Armor.SaveAmount %d" % r.choice([10, 50, 150])] + flags, spawn)
        elif kind == 2:
            name = self.add_actor("Bonus", "BasicArmorBonus", number, ["Armor.SavePercent %s" % r.choice(["33.335", "50"]),
                "Armor.SaveAmount %d" % r.choice([1, 10]), "Armor.MaxSaveAmount %d" % r.choice([20, 200])] + flags, spawn)
        elif kind == 3:
            name = self.add_actor("Ammo", "Ammo", number, [amount, limit, "Ammo.BackpackAmount %d" % r.randint(0, 20),
                "Ammo.BackpackMaxAmount %d" % r.choice([50, 400])] + flags, spawn)
        elif kind == 4:
            name = self.add_actor("Power", "PowerupGiver", number,
                ["Powerup.Type %s" % r.choice(["Invulnerable", "IronFeet", "Speed", "Strength", "LightAmp", "Speed",
                    "Damage", "Protection"]), "Powerup.Duration %d" % r.choice([20, 70, -2, 500])] + flags, spawn)
        else:
            give = ["  TNT1 A 0 %s" % r.choice([self.action(), "A_GiveInventory(\"%s\", %d)" % (r.choice(CLASSES),
                r.randint(1, 30)), "A_TakeInventory(\"Clip\", %d)" % r.randint(1, 20)]) for _ in range(r.randint(1, 3))]
            states = spawn + ["Pickup:"] + give + ["  stop"] + ["Use:",
                "  TNT1 A 0 %s" % self.action(), r.choice(["  stop", "  fail"])]
            name = self.add_actor("Custom", "CustomInventory", number, [amount] + flags, states)
        self.pickups.append(name)

    def draw_body(self):
        r = self.r
        lines = ["Radius %d" % r.choice([8, 16, 20, 40]), "Height %d" % r.choice([8, 16, 20, 24, 32, 56, 100]),
            "Mass %d" % r.choice([10, 100, 1000]), "Health %d" % r.choice([1, 20, 100])]
        lines += ["+NOBLOOD", "PainChance %d" % r.choice([0, 256])]
        lines += ["+SOLID"] if self.some(0.6) else []
        if self.with_targets and self.some(0.6):
            lines.append("+SHOOTABLE")
        lines += r.sample(["+NOGRAVITY", "Gravity 0.4", "+COUNTKILL", "+ISMONSTER", "+NODAMAGETHRUST", "+DONTTHRUST",
            "+INVULNERABLE", "+GHOST", "+NORADIUSDMG", "+SPAWNCEILING",
                           "+CANPASS", "+DROPOFF", "+SLIDESONWALLS", "+DONTGIB", "+NOTELEPORT", "+MOVEWITHSECTOR", "DamageFactor \"Fire\", 0.5", "DamageFactor \"Normal\", 2.0", "+NODAMAGE", "+BUDDHA", "GibHealth 5",
                           "DeathHeight 12", "+FRIENDLY"], r.randint(0, 3))
        states = self.steps("Spawn", r.choice(["loop", "wait", "TNT1 A -1"]), loud=0.5)
        if states[-1].endswith("-1"):
            states.append("  stop")
        if self.some(0.5):
            states += ["Pain:", "  TNT1 A 3", "  TNT1 A 3 A_Pain", "  goto Spawn"]
        if self.some(0.8):
            states += self.steps("Death", r.choice(["stop", "TNT1 A -1"]))
            states += ["  stop"] if states[-1].endswith("-1") else []
            states += ["XDeath:", "  TNT1 A 5", "  TNT1 A 5 A_NoBlocking", "  TNT1 A -1", "  stop"] if self.some(0.4) else []
        self.bodies.append(self.add_actor("Body", "", 20300 + len(self.actors), lines, states))

    def draw_weapon(self):
        r = self.r
        ammo = r.choice(["Clip", "Shell", "RocketAmmo", "Cell"])
        lines = ["Weapon.SlotNumber %d" % r.randint(1, 7), "Weapon.SelectionOrder %d" % r.choice([100, 1000, 5000]),
            "Weapon.AmmoType \"%s\"" % ammo,
                 "Weapon.AmmoUse %d" % r.randint(0, 3), "Weapon.AmmoGive %d" % r.randint(0, 30)]
        lines += r.sample(["+WEAPON.NOAUTOFIRE", "+WEAPON.AMMO_OPTIONAL", "+WEAPON.NOALERT", "+WEAPON.WIMPY_WEAPON",
            "+WEAPON.EXPLOSIVE", "+WEAPON.DONTBOB", "+WEAPON.PRIMARY_USES_BOTH", "Weapon.Kickback 0", "Weapon.Kickback 300"], r.randint(0, 2))
        shots = ["A_FireBullets(0, 0, 1, %d, \"BulletPuff\", %d)" % (r.randint(1, 30), r.choice([2, 3])),
            "A_Recoil(%d)" % r.randint(1, 8), "A_GiveInventory(\"Shell\", 1)",
                 "A_GiveInventory(\"HealthBonus\", 1)", "A_FireBullets(0, 0, 1, %d, \"BulletPuff\", 3, %d)" % (r.randint(1,
                     30), r.choice([100, 300]))]
        if self.missiles:
            shots += ["A_FireCustomMissile(\"%s\", %d, %d, %d, %d)" % (r.choice(self.missiles), r.choice([0, 10, -30]),
                r.randint(0, 1), r.choice([0, 8]), r.choice([0, 4]))] * 4
        fire = ["  TNT1 A %d" % r.randint(1, 8), "  TNT1 A %d %s" % (r.randint(0, 10), r.choice(shots)),
            "  TNT1 A %d" % r.randint(1, 12)]
        fire += ["  TNT1 A %d A_ReFire" % r.randint(0, 8)] if self.some(0.5) else []
        states = ["Ready:", "  TNT1 A 1 A_WeaponReady", "  loop", "Select:", "  TNT1 A 1 A_Raise", "  loop", "Deselect:",
            "  TNT1 A 1 A_Lower", "  loop",
                  "Spawn:", "  TNT1 A 1", "  TNT1 A -1", "  stop", "Fire:"] + fire + ["  goto Ready"]
        if self.some(0.4):
            lines += ["Weapon.AmmoType2 \"%s\"" % r.choice(["Clip", "Cell"]), "Weapon.AmmoUse2 %d" % r.randint(0, 3)]
            states += ["AltFire:", "  TNT1 A %d %s" % (r.randint(1, 10), r.choice(shots)), "  TNT1 A %d" % r.randint(1, 9),
                "  goto Ready"]
        self.weapons.append(self.add_actor("Weapon", "Weapon", 20400 + len(self.actors), lines, states))

    # ------------------------------------------------ things

    def thing(self, kind, x, y, **fields):
        result = {"x": "%d.0" % x, "y": "%d.0" % y, "type": kind, **{flag: "true" for flag in FLAGS}}
        result.update(fields)
        return result

    def draw_things(self):
        r = self.r
        self.start = [self.thing(1, 0, 0, angle=r.randrange(0, 360, 45))]
        if any("deathmatch" in arg for arg in self.args):
            self.start.append(self.thing(11, 0, 0, angle=90))
        x, y = self.place()
        self.start.append(self.thing(9001, x, y, id=91, height=r.choice([0, 30]), angle=r.randrange(360)))  # a map spot
        x, y = self.place()
        self.start.append(self.thing(14, x, y, id=90, angle=r.randrange(360)))
        drawn = [actor["number"] for actor in self.actors if actor["name"] not in self.missiles]
        kinds = [r.choice(ITEMS) for _ in range(r.randint(2, 9))] + [r.choice(SCENERY) for _ in range(r.randint(0, 3))]
        kinds += [r.choice(drawn) for _ in range(r.randint(0, 8)) if drawn]
        if self.with_targets:
            kinds += [r.choice(TARGETS) for _ in range(r.randint(0, 4))]
        else:
            kinds += [r.choice(WEAPONS) for _ in range(r.randint(0, 3))]
        for number, kind in enumerate(kinds, 1):
            x, y = self.place(90 if kind in SCENERY + TARGETS or kind >= 20300 else 40)
            if self.some(0.5) and kind in ITEMS + WEAPONS + drawn:  # near the player, who meets it
                x, y = r.choice([-1, 1]) * r.randint(90, 200), r.randint(-120, 120)
            fields = {"id": r.choice([number, number, 20, 0]), "angle": r.randrange(360)}
            for flag in FLAGS:
                if self.some(0.06):
                    fields[flag] = "false"
            for name, values in (("height", [8, 16, 32, 60, 100]), ("pitch", [-30, 10]), ("alpha", [0.0, 0.4]),
                ("scale", [0.5, 2.0]), ("health", [2, 0.5, -33, 3]),
                                 ("gravity", [0.5, 2.0, -0.5]), ("score", [7]), ("ambush", ["true"]), ("friend",
                                     ["true"]), ("standing", ["true"]), ("invisible", ["true"]),
                                 ("translucent", ["true"]), ("countsecret", ["true"])):
                if self.some(0.08):
                    fields[name] = r.choice(values)
            if kind in TARGETS[2:]:
                fields["dormant"] = "true"
            elif self.some(0.06):
                fields["dormant"] = "true"
            if self.some(0.2):
                special, args = r.choice([(80, (2, 0, number, 3)), (226, (2, 0, number)), (72, (r.randrange(256), 8, 0)),
                    (73, (7,)), (248, (9,)), (128, (0, 30, 0, 1)), (119, (20, 15)), (62, (1, 32, 35)), (23, (2, 16, 16))])
                fields["special"] = special
                fields.update(("arg%d" % i, value) for i, value in enumerate(args))
            self.things.append(self.thing(kind, x, y, **fields))

    # ------------------------------------------------ the script

    def tid(self):
        return self.r.choice([0, 0, 1, 2, 3, 4, 5, 6, 20, 30])

    def fixed(self, low, high):
        return "%.2f" % (self.r.randint(low * 4, high * 4) / 4)

    def deed(self):
        r, tid, tag = self.r, self.tid, r_tag(self.r)
        classes = CLASSES + self.pickups + self.bodies + self.missiles + self.weapons
        inventory = CLASSES + self.pickups + self.weapons
        # Not of pools of chance: a built-in missile's damage, a monster's drop.
        choices = [
            lambda: "Thing_Damage(%d, %d, 0)" % (tid(), r.choice([1, 5, 20, 60, -10])),
            lambda: "Thing_Damage2(%d, %d, \"%s\")" % (tid(), r.choice([1, 7, 30]),
                r.choice(["Fire", "None", "Drowning", "Slime"])),
            lambda: "DamageThing(%d, 0)" % r.randint(1, 30),
            lambda: "HealThing(%d, %d)" % (r.randint(1, 60), r.choice([0, 0, 120])),
            lambda: "ThrustThing(%d, %d, %d, %d)" % (r.randrange(256), r.randint(1, 40), r.randint(0, 1), tid()),
            lambda: "ThrustThingZ(%d, %d, %d, %d)" % (tid(), r.randint(1, 60), r.randint(0, 1), r.randint(0, 1)),
            lambda: "SetActorVelocity(%d, %s, %s, %s, %s, %s)" % (tid(), self.fixed(-12, 12), self.fixed(-12, 12),
                self.fixed(-4, 12), r.choice(["TRUE", "FALSE"]), r.choice(["TRUE", "FALSE"])),
            lambda: "SetActorProperty(%d, %s)" % (tid(), r.choice(["APROP_Health, %d" % r.choice([1, 30, 150]),
                "APROP_Speed, %s" % r.choice(["0.5", "2.0", "1.5"]), "APROP_Invulnerable, %d" % r.randint(0,
                    1), "APROP_JumpZ, %s" % r.choice(["4.0", "14.0"]),
                                                      "APROP_Gravity, %s" % r.choice(["0.25", "1.0", "3.0",
                                                          "0.0"]), "APROP_DamageFactor, %s" % r.choice(["0.5", "2.0", "0.0"]), "APROP_Alpha, 0.5", "APROP_Mass, %d" % r.choice([20, 400]), "APROP_Score, 3",
                                                      "APROP_SpawnHealth, %d" % r.choice([60,
                                                          150]), "APROP_ScaleX, 2.0", "APROP_Friendly, %d" % r.randint(0, 1), "APROP_Dropped, 1", "APROP_NoTarget, 1", "APROP_ReactionTime, %d" % r.randint(0, 20), "APROP_ViewHeight, %s" % r.choice(["20.0", "50.0"])])),
            lambda: "SetActorAngle(%d, %s)" % (tid(), self.fixed(0, 1)),
            lambda: "SetActorPitch(%d, %s)" % (tid(), r.choice(["0.1", "-0.1", "0.0"])),
            lambda: "SetActorPosition(%d, %s, %s, %s, %d)" % (tid(), self.fixed(-400, 400), self.fixed(-400, 400),
                self.fixed(0, 60), r.randint(0, 1)),
            lambda: "SpawnForced(\"%s\", %s, %s, %s, 30, %d)" % (r.choice(classes), self.fixed(-300, 300),
                self.fixed(-300, 300), self.fixed(0, 90), r.randrange(256)),
            lambda: "Spawn(\"%s\", GetActorX(0) + %s, GetActorY(0) + %s, GetActorZ(0) + %s, 30, %d)" % (r.choice(classes),
                self.fixed(-80, 80), self.fixed(-80, 80), self.fixed(-8, 70), r.randrange(256)),
            lambda: "SpawnSpot(\"%s\", %d, 30, %d)" % (r.choice(classes), r.choice([91, 1, 2]), r.randrange(256)),
            lambda: "SpawnSpotFacing(\"%s\", 91, 30)" % r.choice(classes),
            lambda: "GiveInventory(\"%s\", %d)" % (r.choice(inventory), r.choice([1, 1, 2, 20])),
            lambda: "TakeInventory(\"%s\", %d)" % (r.choice(inventory), r.choice([1, 2, 50])),
            lambda: "GiveActorInventory(%d, \"%s\", %d)" % (tid(), r.choice(inventory), r.choice([1, 3])),
            lambda: "UseInventory(\"%s\")" % r.choice(inventory),
            lambda: "SetAmmoCapacity(\"%s\", %d)" % (r.choice(["Clip", "Shell", "Cell"]), r.choice([10, 60, 500])),
            lambda: "Thing_Destroy(%d, %d)" % (r.choice([1, 2, 3, 4, 20, 30]), r.randint(0, 1)),
            lambda: "Thing_Remove(%d)" % r.choice([1, 2, 3, 30]),
            lambda: "Thing_Activate(%d)" % r.choice([1, 2, 3, 5]) if not self.with_targets else "Delay(0)",
            lambda: "Thing_Deactivate(%d)" % r.choice([1, 2, 3, 5]),
            lambda: "Thing_Move(%d, 91, %d)" % (tid(), r.randint(0, 1)),
            lambda: "Thing_ChangeTID(%d, %d)" % (r.choice([1, 2, 3]), r.choice([4, 20, 30])),
            lambda: "Thing_Stop(%d)" % tid(),
            lambda: "Floor_RaiseByValue(%d, %d, %d)" % (tag(), r.choice([8, 32, 100]), r.choice([8, 24, 64])),
            lambda: "Floor_LowerByValue(%d, %d, %d)" % (tag(), r.choice([8, 32, 100]), r.choice([8, 24, 64])),
            lambda: "Ceiling_LowerByValue(%d, %d, %d)" % (tag(), r.choice([8, 32]), r.choice([32, 100])),
            lambda: "Ceiling_CrushAndRaiseA(%d, %d, %d, %d, %d)" % (tag(), 16, 16, r.choice([1, 5]), r.choice([0, 1, 2])),
            lambda: "Plat_DownWaitUpStay(%d, 32, 35)" % tag(),
            lambda: "Plat_PerpetualRaise(%d, 16, 17)" % tag(),
            lambda: "Plat_UpByValue(%d, 16, 35, %d)" % (tag(), r.randint(1, 6)),
            lambda: "Door_Raise(%d, 32, 35)" % tag(),
            lambda: "Door_Close(%d, 32)" % tag(),
            lambda: "FloorAndCeiling_RaiseByValue(%d, 16, 32)" % tag(),
            lambda: "Floor_RaiseAndCrush(%d, 16, %d, %d)" % (tag(), r.choice([5, 10]), r.choice([1, 2])),
            lambda: "Generic_Floor(%d, 16, 24, 0, %d)" % (tag(), r.choice([0, 8])),
            lambda: "Floor_Waggle(%d, 32, 16, 0, 3)" % r.choice([island["id"] for island in self.islands
                if island["fields"]["heightceiling"] > island["fields"]["heightfloor"] + 64] or [9]),
            lambda: "Elevator_RaiseToNearest(%d, 16)" % tag(),
            lambda: "Floor_RaiseInstant(%d, 0, %d)" % (tag(), r.randint(1, 4)),
            lambda: "Floor_MoveToValue(%d, 16, %d, %d)" % (tag(), r.randint(0, 40), r.randint(0, 1)),
            lambda: "Pillar_Build(%d, 16, 0)" % tag(),
            lambda: "Sector_SetGravity(%d, %d, %d)" % (tag(), r.choice([0, 1, 2]), r.choice([0, 50])),
            lambda: "Sector_SetFriction(%d, %d)" % (tag(), r.choice([50, 120, 180])),
            lambda: "Sector_SetDamage(%d, %d, 0)" % (tag(), r.choice([1, 5, 20, 50])),
            lambda: "Sector_SetWind(%d, %d, %d, %d)" % (tag(), r.randint(5, 60), r.randrange(256), r.randint(0, 1)),
            lambda: "Sector_SetCurrent(%d, %d, %d, 0)" % (tag(), r.randint(5, 60), r.randrange(256)),
            lambda: "Scroll_Floor(%d, %d, %d, %d)" % (tag(), r.randint(-60, 60), r.randint(-60, 60), r.randint(0, 2)),
            lambda: "SetGravity(%s)" % r.choice(["400.0", "800.0", "1600.0"]),
            lambda: "SetAirControl(%s)" % r.choice(["0.0", "0.1", "1.0"]),
            lambda: "SetPlayerProperty(0, %d, %s)" % (r.randint(0, 1),
                r.choice(["PROP_FROZEN", "PROP_NOTARGET", "PROP_INSTANTWEAPONSWITCH", "PROP_TOTALLYFROZEN",
                    "PROP_INVULNERABILITY", "PROP_SPEED", "PROP_STRENGTH", "PROP_BUDDHA", "PROP_RADIATIONSUIT"])),
            lambda: "Teleport(90, 0, 0)",
            lambda: "Teleport_NoFog(90, %d, 0)" % r.randint(0, 1),
            lambda: "Teleport_NoStop(90, 0, 0)",
            lambda: "TeleportOther(%d, 90, 1)" % r.choice([1, 2, 3]),
            lambda: "SetActorState(%d, \"%s\", %s)" % (r.choice([1, 2, 3, 4]), r.choice(["Spawn", "Death", "Pain"]),
                r.choice(["TRUE", "FALSE"])),
            lambda: "ACS_Execute(2, 0, %d, %d, %d)" % (r.randint(0, 9), r.randint(0, 9), r.randint(0, 9)),
            lambda: "SetThingSpecial(%d, ACS_Execute, 2, 0, 5)" % r.choice([1, 2, 3]),
            lambda: "ClearInventory()",
            lambda: "SetWeapon(\"%s\")" % r.choice(self.weapons + ["Shotgun", "Fist", "Pistol"]),
            lambda: "reward += %d.0" % r.randint(-5, 5),
            lambda: "Thing_Raise(%d)" % r.choice([1, 2, 3, 4]),
            lambda: "NoiseAlert(0, 0)",
        ]
        if self.missiles:
            choices += [lambda: "SpawnProjectile(%d, \"%s\", %d, %d, %d, %d, 30)" % (r.choice([91, 1, 2, 3]),
                r.choice(self.missiles), r.randrange(256), r.choice([40, 120]), r.choice([0, 30]), r.randint(0, 1))] * 3
        return r.choice(choices)()

    def draw_script(self):
        r = self.r
        for _ in range(r.randint(3, 16)):
            tic, deed = r.choice([0, 1, 2, r.randrange(2, 300), r.randrange(2, 120)]), self.deed()
            self.deeds.append((max(tic, 2) if deed.startswith("SetActorPitch") else tic, deed))
        if self.with_targets:  # what hits for a random amount is not in the hand
            first = " TakeInventory(\"Fist\", 1); TakeInventory(\"Pistol\", 1); "
            self.deeds.append((0,
                first.strip().rstrip(";") + "".join("; GiveInventory(\"%s\", 1); GiveInventory(\"Clip\", 50)" % name for name in self.weapons)))
        tid = lambda: r.choice([0, 1, 2, 3, 4, 5, 6, 7, 8, 20, 30])
        tag = r_tag(r)
        choices = [
            lambda: "GetActorX(%d)" % tid(),
            lambda: "GetActorY(%d)" % tid(),
            lambda: "GetActorZ(%d)" % tid(),
            lambda: "GetActorZ(%d)" % tid(),
            lambda: "GetActorVelX(%d)" % tid(),
            lambda: "GetActorVelY(%d)" % tid(),
            lambda: "GetActorVelZ(%d)" % tid(),
            lambda: "GetActorAngle(%d)" % tid(),
            lambda: "GetActorPitch(%d)" % tid(),
            lambda: "GetActorFloorZ(%d)" % tid(),
            lambda: "GetActorCeilingZ(%d)" % tid(),
            *[lambda: "GetActorProperty(%d, %s)" % (tid(), r.choice(["APROP_Health", "APROP_Speed", "APROP_Alpha",
                "APROP_Invulnerable", "APROP_JumpZ", "APROP_Gravity", "APROP_Mass", "APROP_SpawnHealth", "APROP_Dormant", "APROP_Friendly", "APROP_Friendly",
                                                             "APROP_Height", "APROP_Radius", "APROP_ReactionTime", "APROP_Score", "APROP_Dropped", "APROP_RenderStyle", "APROP_ScaleX", "APROP_ViewHeight", "APROP_DamageFactor", "APROP_Ambush", "APROP_NoTarget", "APROP_AttackZOffset"]))] * 4,
            *[lambda: "CheckInventory(\"%s\")" % r.choice(CLASSES + self.pickups + self.weapons + ["Fist", "Pistol",
                "Shotgun", "RocketLauncher", "BasicArmor"])] * 3,
            lambda: "GetAmmoCapacity(\"%s\")" % r.choice(["Clip", "Shell", "Cell", "RocketAmmo"]),
            *[lambda: "ThingCount(T_NONE, %d)" % r.choice([1, 2, 3, 4, 5, 6, 20, 30])] * 2,
            lambda: "ThingCountName(\"%s\", 0)" % r.choice(self.bodies + ["ExplosiveBarrel"]),
            lambda: "IsTIDUsed(%d)" % r.choice([1, 2, 30]),
            lambda: "ClassifyActor(%d)" % tid(),
            lambda: "CheckFlag(%d, \"%s\")" % (tid(), r.choice(["SOLID", "SHOOTABLE", "NOGRAVITY", "CORPSE", "INVULNERABLE",
                "COUNTITEM", "DROPPED"])),
            lambda: "GetSectorFloorZ(%d, 0, 0)" % tag(),
            lambda: "GetSectorCeilingZ(%d, 0, 0)" % tag(),
            lambda: "Timer()",
            lambda: "PlayerHealth()",
            lambda: "PlayerFrags()",
            lambda: "CheckInventory(\"BasicArmor\")",
            lambda: "GetPlayerInput(-1, %s)" % r.choice(["INPUT_BUTTONS", "INPUT_FORWARDMOVE", "INPUT_SIDEMOVE", "INPUT_YAW",
                "INPUT_PITCH", "MODINPUT_BUTTONS", "MODINPUT_FORWARDMOVE"]),
            lambda: "GetLevelInfo(%s)" % r.choice(["LEVELINFO_KILLED_MONSTERS", "LEVELINFO_TOTAL_MONSTERS",
                "LEVELINFO_TOTAL_ITEMS", "LEVELINFO_FOUND_ITEMS", "LEVELINFO_TOTAL_SECRETS"]),
            lambda: "GetActorViewHeight(%d)" % r.choice([0, 1]),
            lambda: "CheckActorInventory(%d, \"%s\")" % (tid(), r.choice(CLASSES)),
            lambda: "GetActorLightLevel(%d)" % tid(),
            lambda: "CheckSight(0, %d, 0)" % r.choice([1, 2, 3]),
            lambda: "GameSkill()",
            lambda: "GameType()",
            lambda: "PlayerCount()",
            lambda: "ActivatorTID()",
            lambda: "StrLen(GetActorClass(%d))" % tid(),
            lambda: "CheckWeapon(\"%s\")" % r.choice(self.weapons + ["Pistol", "Fist"]),
            lambda: "PlayerNumber()",
            lambda: "StrLen(GetWeapon())",
        ]
        while len(self.readings) < 40:
            reading = r.choice(choices)()
            if reading not in self.readings:
                self.readings.append(reading)

    # ------------------------------------------------ writing

    def textmap(self):
        text = 'namespace = "zdoom";\n'
        vertices, sides, lines = [], [], []
        sectors = [{"heightfloor": 0, "heightceiling": 256, "id": 99}]

        def loop(corners, front, back, island):
            first = len(vertices)
            vertices.extend(corners)
            for i in range(4):
                fields = {"v1": first + i, "v2": first + (i + 1) % 4, "sidefront": len(sides)}
                sides.append(front)
                if back is None:
                    fields["blocking"] = "true"
                else:
                    fields.update(sideback=len(sides), twosided="true")
                    sides.append(back)
                for line in self.lines:
                    if line["island"] == island and line["side"] == i:
                        fields.update(line["fields"])
                lines.append(fields)

        loop([(-512, -512), (-512, 512), (512, 512), (512, -512)], 0, None, 0)
        for island in self.islands:
            x, y, half = island["x"], island["y"], island["half"]
            corners = [(x - half, y - half), (x - half, y + half), (x + half, y + half), (x + half, y - half)]
            if island["turned"]:
                corners = [(x - half, y), (x, y + half), (x + half, y), (x, y - half)]
            # The front lies on the right of a line: the island inside, where its corners go round with the clock.
            loop(corners[::-1], 0, len(sectors), island["id"])
            sectors.append({**island["fields"], "id": island["id"]})
        text += "".join("vertex { x = %d.0; y = %d.0; }\n" % vertex for vertex in vertices)
        text += "".join("linedef { %s }\n" % fields_text(line) for line in lines)
        text += "".join('sidedef { sector = %d; texturemiddle = "%s"; }\n' % (sector, "BRICK9" if i < 4 else "-") for i,
            sector in enumerate(sides))
        text += "".join('sector { %s texturefloor = "FLAT4"; textureceiling = "FLOOR0_1"; lightlevel = 192; }\n' % fields_text(sector) for sector in sectors)
        left_out = set(range(20100, 20500)) - {actor["number"] for actor in self.actors}  # by a shrinker
        things = [thing for thing in self.start + self.things if thing["type"] not in left_out]
        return text + "".join("thing { %s }\n" % fields_text(thing) for thing in things)

    def script(self):
        text = '#include "zcommon.acs"\nglobal int 0:reward;\n'
        text += "".join("global int %d:user%d;\n" % (i, i) for i in range(1, len(self.readings) + 3))
        text += "script 1 ENTER\n{\n  int t = 0;\n  while (TRUE)\n  {\n"
        text += "".join("    if (t == %d) { %s; }\n" % (tic, deed) for tic, deed in self.deeds)
        text += "".join("    user%d = %s;\n" % (i, reading) for i, reading in enumerate(self.readings, 1))
        more = len(self.readings) + 1
        text += "    t++;\n    Delay(1);\n  }\n}\n"
        text += "script 2 (int a, int b, int c) { user%d = user%d * 3 + a + 10 * b + 100 * c + 1; reward += a * 0.5; }\n" % (more, more)
        text += "script 3 DEATH { user%d += 1; }\nscript 4 RESPAWN { user%d += 100; }\nscript 5 RETURN { user%d += 10000; }\n" % (more + 1, more + 1, more + 1)
        return text

    def write(self, folder, acs):
        """The path of the cfg of a folder that gets all files of the game."""
        source, lump = os.path.join(folder, "game.acs"), os.path.join(folder, "game.o")
        with open(source, "w") as file:
            file.write(self.script())
        done = subprocess.run([acs, source, "-o", lump], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError("comrad-acs failed: " + (done.stderr + done.stdout).strip())
        with open(lump, "rb") as file:
            behavior = file.read()
        decorate = "".join(actor["text"] for actor in self.actors)
        with open(os.path.join(folder, "game.wad"), "wb") as file:
            file.write(wad_bytes([("DECORATE", decorate.encode()), ("MAP01", b""), ("TEXTMAP", self.textmap().encode()),
                                  ("BEHAVIOR", behavior), ("ENDMAP", b"")]))
        with open(os.path.join(folder, "game.decorate"), "w") as file:
            file.write(decorate)
        with open(os.path.join(folder, "game.textmap"), "w") as file:
            file.write(self.textmap())
        path = os.path.join(folder, "game.cfg")
        with open(path, "w") as file:
            file.write("doom_scenario_path = game.wad\ndoom_map = MAP01\ndoom_skill = %d\n" % self.skill)
            file.write("".join(line + "\n" for line in self.cfg))
            file.write("game_args = %s\n" % " ".join(self.args) if self.args else "")
        return path

    def parts(self):
        """The lists of which a shrinker may leave elements out."""
        return [self.args, self.cfg, self.things, self.deeds, self.lines, self.islands, self.actors, self.readings]

    def listed(self, tics):
        """Lines that show what is left of a game whose first `tics` tics count."""
        lines = [" ".join(["skill %d" % self.skill] + self.args + self.cfg)]
        lines += ["tic %d: %s" % deed for deed in sorted(self.deeds)]
        lines += ["thing: " + fields_text({k: v for k,
            v in thing.items() if k not in FLAGS or v != "true"}) for thing in self.things]
        lines += ["island %s: %s" % (island["id"],
            fields_text({k: v for k, v in island.items() if k not in ("id",
                "fields")} | island["fields"])) for island in self.islands]
        lines += ["line %d of island %d: %s" % (line["side"], line["island"],
            fields_text(line["fields"])) for line in self.lines]
        lines += [line for actor in self.actors for line in actor["text"].splitlines()]
        names = {COLUMNS[i][1] for row in self.rows[:tics] for i, value in enumerate(row) if value}
        return lines + ["pressed: " + ", ".join(sorted(names))]

    def name_of(self, variable):
        number = re.match(r"USER(\d+)$", variable)
        if not number:
            return variable
        index = int(number.group(1)) - 1
        return self.readings[index] if index < len(self.readings) else ["script 2",
            "deaths"][index - len(self.readings)] if index < len(self.readings) + 2 else "?"


def r_tag(generator):
    return lambda: generator.choice([1, 1, 2, 2, 3, 4])


def fields_text(fields):
    return " ".join("%s = %s;" % pair for pair in fields.items())


def wad_bytes(lumps):
    body, directory = b"", b""
    for name, data in lumps:
        directory += struct.pack("<ii8s", 12 + len(body), len(data), name.encode())
        body += data
    return struct.pack("<4sii", b"PWAD", len(lumps), 12 + len(body)) + body + directory


# ---------------------------------------------------------------- playing and comparing

COLUMNS = BUTTONS + MORE_BUTTONS
NAMES = VARIABLES + ["USER%d" % i for i in range(1, 61)]


def play_both(vzd, arguments, game, folder, tics):
    cfg = game.write(folder, arguments.acs)
    rows = game.rows[:tics]
    theirs = play_vizdoom(vzd, cfg, 1, NAMES, rows)
    ours, _ = play_comrad(arguments.trace, cfg, 1, COLUMNS, rows, folder, more=["--variables", ",".join(NAMES)])
    return ours, theirs


class PackageCrash(Exception):
    """The process that played in ViZDoom ended by a signal."""


def play_vizdoom(vzd, cfg, seed, names, rows):
    """The rows of a game in ViZDoom. A child process plays: the package crashes at the start of some games."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        with os.fdopen(writer, "wb") as file:
            try:
                pickle.dump(played_rows(vzd, cfg, seed, names, rows), file)
            except Exception as problem:  # ViZDoom's classes of errors differ from version to version
                pickle.dump(str(problem).strip() or type(problem).__name__, file)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as file:
        answer = file.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status < 0:
        raise PackageCrash("signal %d" % -status)
    played = pickle.loads(answer)
    if isinstance(played, str):
        raise RuntimeError(played)
    return played


def played_rows(vzd, cfg, seed, names, rows):
    os.chdir(os.path.dirname(cfg))  # where ViZDoom keeps settings, cl_run among them, for the next game
    game = vizdoom_game(vzd, cfg, seed, [], [name for _, name in COLUMNS])
    try:
        wanted = [(name, getattr(vzd.GameVariable, name)) for name in names]
        result = []
        reward = 0.0
        for t in range(len(rows) + 1):
            row = {name: game.get_game_variable(variable) for name, variable in wanted}
            row.update(reward=reward, finished=float(game.is_episode_finished()))
            result.append(row)
            if row["finished"] or t == len(rows):
                return result
            reward = game.make_action([float(value) for value in rows[t]], 1)
        return result
    finally:
        game.close()


def tolerance_of(game, name):
    """How far two values of a variable may be from each other."""
    label = game.name_of(name)
    if name in PLACES:
        return 0.01
    if re.match(r"GetActor[XYZ]\(|GetActorFloorZ|GetActorCeilingZ", label):
        return 0.01 * 65536
    # The last bits of a missile's speed come from an estimate that differs from processor to processor in ViZDoom.
    if re.match(r"GetActorVel[XYZ]\(", label):
        return 2
    return 2.1 / 65536 if name.startswith("VELOCITY_") else 5e-6


def first_difference(game, ours, theirs):
    """(tic, name, ours, theirs) of the first tic with a difference, None where there is none; then all of that tic."""
    for t, (a, b) in enumerate(zip(ours, theirs)):
        found = [(t, name, a[name], b[name]) for name in NAMES + ["reward",
            "finished"] if abs(a[name] - b[name]) > tolerance_of(game, name)]
        if found:
            return found
    if len(ours) != len(theirs):
        return [(min(len(ours), len(theirs)), "rows", len(ours), len(theirs))]
    return []


def try_game(vzd, arguments, game, tics=TICS):
    """The differences of the first tic that has one, with a text where an engine refused the game."""
    folder = tempfile.mkdtemp(dir=os.getcwd())
    try:
        return first_difference(game, *play_both(vzd, arguments, game, folder, tics)), ""
    except RuntimeError as problem:
        return [], str(problem)[:300]
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def by_chance(vzd, arguments, game, tic):
    """What ViZDoom does differently up to that tic when it plays again, with the same seed or another; empty where nothing."""
    folder = tempfile.mkdtemp(dir=os.getcwd())
    try:
        cfg = game.write(folder, arguments.acs)
        first = play_vizdoom(vzd, cfg, 1, NAMES, game.rows[:tic])
        others = (play_vizdoom(vzd, cfg, seed, NAMES, game.rows[:tic]) for seed in CHANCE_SEEDS)
        return next(filter(None, (first_difference(game, first, other) for other in others)), [])
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def shrink(vzd, arguments, game, found):
    """A game with the same difference from which nothing more can be left out."""
    tic, label = found[0][0], game.name_of(found[0][1])
    labels = {game.name_of(name) for _, name, _, _ in found}

    def still(other):
        try:
            differences, _ = try_game(vzd, arguments, other, min(tic + 1, TICS))
        except PackageCrash:
            return False
        return bool(differences) and any(other.name_of(name) in labels for _, name, _, _ in differences)

    game = copy.deepcopy(game)
    for number in range(len(game.parts())):
        size = max(1, len(game.parts()[number]))
        while size >= 1:
            start = 0
            while start < len(game.parts()[number]):
                other = copy.deepcopy(game)
                part = other.parts()[number]
                taken = part[start:start + size]
                del part[start:start + size]
                if number == len(game.parts()) - 1 and label in taken:
                    start += size
                    continue
                if still(other):
                    game = other
                else:
                    start += size
            size //= 2
    for column in range(len(COLUMNS)):
        if any(row[column] for row in game.rows[:tic + 1]):
            other = copy.deepcopy(game)
            for row in other.rows:
                row[column] = 0
            if still(other):
                game = other
    return game


def describe(game, found):
    lines = ["tic %d: %s is %s, ViZDoom's %s" % (t, game.name_of(name), ours, theirs) for t, name, ours, theirs in found[:6]]
    return "; ".join(lines)


def read_explained(path):
    """{seed: (section, tic, variable)} of a list: headings in brackets, then lines `seed tic variable: reason`."""
    listed, section = {}, ""
    with open(path) as file:
        for number, line in enumerate(file, 1):
            line = line.strip()
            if not line or line.startswith("#"):
                continue
            if line.startswith("["):
                section = line.strip("[]")
                if section not in SECTIONS:
                    sys.exit("%s:%d: [%s] is no heading; expected one of %s" % (path, number, section, ", ".join(SECTIONS)))
                continue
            match = re.match(r"(\d+) (\d+) (.+?): \S", line)
            if not match or not section:
                sys.exit("%s:%d: expected `seed tic variable: reason` below a heading" % (path, number))
            if int(match[1]) in listed:
                sys.exit("%s:%d: seed %s is listed twice" % (path, number, match[1]))
            listed[int(match[1])] = (section, int(match[2]), match[3])
    return listed


def check_listed(game, found, entry):
    """Why the list is wrong about a game, or an empty text. Which way chance took does not count."""
    section, tic, variable = entry
    if not found:
        return "agrees now; take it off the list"
    if section != "chance" and (found[0][0] != tic or variable not in [game.name_of(name) for _, name, _, _ in found]):
        return "listed for %s of tic %d; %s" % (variable, tic, describe(game, found))
    return ""


def check_seed(vzd, arguments, seed, report):
    """How the game came out: "agree", "differ", "chance", "crash", or its section of the list."""
    game = Drawer(seed)
    entry = arguments.listed.get(seed)
    try:
        found, refused = try_game(vzd, arguments, game)
        if entry and not refused:
            wrong = check_listed(game, found, entry)
            report.check("seed %d" % seed, not wrong, wrong or "%s: %s" % (entry[0], describe(game, found)))
            return "differ" if wrong else entry[0]
        chance = by_chance(vzd, arguments, game, found[0][0]) if found else []
    except PackageCrash as crash:
        print("[  CRASHED  ] seed %d: the package, %s" % (seed, crash), flush=True)
        return "crash"
    if chance:
        print("[ BY CHANCE ] seed %d: ViZDoom differs from itself: %s" % (seed, describe(game, chance)), flush=True)
        return "chance"
    report.check("seed %d" % seed, not found and not refused, refused or describe(game, found) or "%d tics" % TICS)
    if found and arguments.shrink:
        game = shrink(vzd, arguments, game, found)
        print("    " + describe(game, try_game(vzd, arguments, game, found[0][0] + 1)[0]))
        print("\n".join("    " + line for line in game.listed(found[0][0])), flush=True)
    if found and arguments.keep:
        folder = os.path.join(arguments.keep, "seed_%d" % seed)
        os.makedirs(folder, exist_ok=True)
        game.write(folder, arguments.acs)
        write_actions(os.path.join(folder, "actions.csv"), COLUMNS, game.rows[:found[0][0] + 1])
    return "differ" if found or refused else "agree"


def seeds_of(text):
    """"7", or "1-500"."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trace", required=True, help="the program comrad-trace")
    parser.add_argument("--acs", required=True, help="the program comrad-acs")
    parser.add_argument("--venv", default=os.path.join(os.path.dirname(__file__), "../../build/test-python"))
    parser.add_argument("--seeds", nargs="+", type=seeds_of, default=[range(1, 9)], metavar="SEED|FIRST-LAST")
    parser.add_argument("--explained", help="list of the seeds that may differ")
    parser.add_argument("--keep", help="folder for the files of games that differ")
    parser.add_argument("--shrink", action="store_true",
        help="leave out of a game that differs what its difference does not need")
    arguments = parser.parse_args()
    vzd = import_vizdoom(arguments.venv, "random games beside ViZDoom")
    for name in ("trace", "acs", "keep"):
        if getattr(arguments, name):
            setattr(arguments, name, os.path.abspath(getattr(arguments, name)))
    seeds = [seed for some in arguments.seeds for seed in some]
    arguments.listed = read_explained(arguments.explained) if arguments.explained else {}
    here = os.getcwd()
    folder = tempfile.mkdtemp()  # ViZDoom leaves its settings where it runs
    os.chdir(folder)
    report = Report()
    try:
        ends = [check_seed(vzd, arguments, seed, report) for seed in seeds]
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)
    counts = tuple(ends.count(end) for end in ("agree", "differ", "chance", "crash", "explained", "not yet explained"))
    print("%d agree, %d differ; ViZDoom differs from itself in %d and crashes in %d; %d are explained, %d not yet" % counts)
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
