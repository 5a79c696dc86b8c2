#!/usr/bin/env python3
"""Plays each scenario's default map with two players in ViZDoom and in COMRAD, with the same buttons, and compares
every exported global, each player's own variables, the rewards and the ends.

    scenario_parity.py --doomgen BIN --play BIN [--only NAME] [--episodes K] [--decisions D] [--table FILE]

Of each scenario one episode in which nobody presses anything, and K episodes of uniform random choices of every action
head, D decisions of four tics. Our engine plays every script of choices with --worlds seeds, for what the game's own
chance does with it. The two of ViZDoom step in turn, tic by tic; what the one who joins presses counts a tic later than what
the host does, so it presses a tic earlier, and does not predict its own body.

A quantity is compared in three ways. `agreed`: where all of our worlds have the same value after a decision, chance has had
no part in it, and ViZDoom must have it too. Where it has not, it plays the same choices with other seeds (--again): rare
chance and presses lost on the way go away, a difference of the rules stays. `exact`: equal in both engines after every
decision of every episode. Else its last value in an episode is ranked among those of our worlds that were played with the
same choices (ties and ends broken by a seeded draw): where both engines are alike the ranks of the K episodes are uniform,
which a Kolmogorov-Smirnov test compares (p). A scenario fails where an agreed value stays different, where lost presses kept half
of the episodes or more from being judged by agreed values, where a quantity has p below
1 in 100 000 (there are some 600 of them), or where the WAD does not run. The episode without presses is judged by agreed values
alone, however few plays --again allows the others.
Everything random is seeded, so a run that passes passes again.

Needs a Python with `vizdoom`, as vizdoom_parity.py does, and reports it in the same way where it cannot be had.
"""
import argparse
import collections
import concurrent.futures
import csv
import io
import json
import multiprocessing
import os
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import tomllib

from vizdoom_parity import Report, import_vizdoom, kolmogorov_smirnov_uniform

HERE = os.path.dirname(os.path.abspath(__file__))
SCENARIOS = os.path.join(HERE, "..", "..", "scenarios")
LEFT_TO_CHANCE = os.path.join(HERE, "left_to_chance.json")  # scenario -> counters of its script that chance decides
AGENTS = 2
TICS = 4  # of a decision
TAIL = 1e-5
IDLE = 1  # seed of the episode in which nobody presses anything
# Counters of scripts that left_to_chance.json lists (how many demons there are, for one) are ranked, but not agreed either:
# ViZDoom's early draws are alike for many seeds, so that a rare draw can come back in each play of it and in none of our worlds.
CONFIRMATIONS = 3  # plays without a lost press in which an agreed value has to differ: late steps without a turn are not seen
AGREED_SHOWN = 6  # differences of a scenario, the earliest ones
USERS = ["USER%d" % number for number in range(1, 61)]
OWN = ["HEALTH", "ARMOR", "DEAD", "DEATHCOUNT", "KILLCOUNT", "HITCOUNT", "HITS_TAKEN", "DAMAGECOUNT", "DAMAGE_TAKEN",
       "SELECTED_WEAPON", "ATTACK_READY", "AMMO2", "AMMO3", "WEAPON1", "WEAPON2", "WEAPON3", "ITEMCOUNT",
       "POSITION_X", "POSITION_Y", "POSITION_Z", "ANGLE", "PLAYER_NUMBER"]
VARIABLES = USERS + OWN
CONTINUOUS = {"POSITION_X": 0.01, "POSITION_Y": 0.01, "POSITION_Z": 0.01, "ANGLE": 1e-4}  # what still counts as equal


def scenario_names():
    return sorted(name for name in os.listdir(SCENARIOS) if os.path.exists(os.path.join(SCENARIOS, name, "layout.cc")))


def random_choices(heads, decisions, seed):
    """[decision][agent][head]; each choice is kept for one to four decisions."""
    generator = random.Random(seed)
    held = [[[0, 0] for _ in heads] for _ in range(AGENTS)]  # choice, decisions left
    rows = []
    for _ in range(decisions):
        for agent in held:
            for slot, buttons in zip(agent, heads):
                if slot[1] == 0:
                    slot[:] = [generator.randrange(len(buttons) + 1), generator.randint(1, 4)]
                slot[1] -= 1
        rows.append([[slot[0] for slot in agent] for agent in held])
    return rows


# ---------------------------------------------------------------- ViZDoom: a process for each player


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Script:
    """Presses what is written: choices [decision][agent][head]."""

    def __init__(self, choices):
        self.choices = choices

    def prepare(self, game, player):
        self.player = player

    def choose(self, game, tic):
        """The choice of each head in the tic that comes, counted from 0; None after the last one."""
        if tic >= len(self.choices) * TICS:
            return None
        # What the one who joins presses counts a tic later than what the host does.
        counts_in = min(tic + (self.player > 0), len(self.choices) * TICS - 1)
        return self.choices[counts_in // TICS][self.player]


def play_as(player, wad, spec, heads, presser, seed, port, folder, answer, tic_gate):
    try:
        import vizdoom as vzd
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # its progress of joining
        os.chdir(tempfile.mkdtemp(dir=folder))  # it leaves its settings where it runs
        game = vzd.DoomGame()
        game.set_doom_game_path(os.path.join(os.path.dirname(vzd.__file__), "freedoom2.wad"))
        game.set_doom_scenario_path(wad)
        game.set_doom_map("map01")
        game.set_doom_skill(3)
        game.set_window_visible(False)
        game.set_sound_enabled(False)
        game.set_screen_resolution(vzd.ScreenResolution.RES_160X120)
        game.set_render_crosshair(bool(spec.get("render", {}).get("crosshair", False)))
        game.set_mode(vzd.Mode.PLAYER)
        game.set_seed(seed)
        game.set_episode_timeout(0)
        presser.prepare(game, player)
        names = [name for head in heads for name in head]
        game.set_available_buttons([getattr(vzd.Button, name) for name in names])
        wanted = [getattr(vzd.GameVariable, name) for name in VARIABLES]
        game.set_available_game_variables(wanted)
        if player == 0:
            game.add_game_args("-host %d -port %d +viz_connect_timeout 60 +sv_noautoaim 1 +sv_nocrouch 1 "
                               "+sv_nofreelook 1 +viz_respawn_delay %d %s" % (
                                   AGENTS, port, spec.get("respawn_delay_tics", 0) // 35,
                                   "+sv_forcerespawn 1" if spec.get("respawn") else ""))
        else:
            game.add_game_args("-join 127.0.0.1 -port %d +viz_connect_timeout 60 +cl_noprediction 1" % port)
        game.add_game_args("+name P%d +colorset 0" % player)
        game.init()
        rows, tic, began = [], 0, game.get_episode_time()  # which is 0 again in an episode that is over

        def note():
            rows.append((began + tic, int(game.is_episode_finished()),
                         [game.get_game_variable(variable) for variable in wanted]))

        note()
        # Without the gate one of the two is ahead at times, and the other then plays several tics at once.
        while (choice := presser.choose(game, tic)) is not None:
            pressed = []
            for buttons, chosen in zip(heads, choice):
                pressed += [float(chosen == index) for index in range(1, len(buttons) + 1)]
            tic_gate.wait(30)
            game.make_action(pressed, 1)
            tic += 1
            over = game.is_episode_finished()
            if over or tic % TICS == 0:
                note()
            if over:
                break
        # Nobody leaves before everybody has read its last row: a game that ends takes the last tic from the others, though
        # their clocks count it.
        tic_gate.wait(30)
        answer.put((player, rows))
        game.close()
    except Exception as problem:  # to the parent, which has no other way to know
        answer.put((player, "%s: %s" % (type(problem).__name__, problem)))


def play_vizdoom(wad, spec, heads, presser, seed, folder, limit_s=150):
    """Rows [decision][agent] of {name: value}; raises RuntimeError where a player could not play. `presser` is a Script, or
    another object with its methods that can be sent to a process."""
    context = multiprocessing.get_context("spawn")
    answer, port, tic_gate = context.Queue(), free_port(), context.Barrier(AGENTS)
    players = [context.Process(target=play_as, args=(player, wad, spec, heads, presser, seed, port, folder, answer, tic_gate))
               for player in range(AGENTS)]
    for player in players:
        player.start()
    try:
        played = dict(answer.get(timeout=limit_s) for _ in players)
    except Exception:
        raise RuntimeError("a player did not answer")
    finally:
        for player in players:
            player.join(10)
            if player.is_alive():
                player.kill()
                player.join()
    for rows in played.values():
        if isinstance(rows, str):
            raise RuntimeError(rows)
    result = []
    for parts in zip(*(played[player] for player in range(AGENTS))):
        result.append([dict(zip(VARIABLES, values), tics=tics, finished=finished) for tics, finished, values in parts])
    return result


# ---------------------------------------------------------------- ours


def play_comrad(binary, scenario, wad, idle_tics, choices, seeds, folder):
    """{seed: rows [decision][agent]}."""
    actions = os.path.join(folder, "actions.csv")
    with open(actions, "w") as file:
        for decision in choices:
            file.write(",".join(str(choice) for agent in decision for choice in agent) + "\n")
    done = subprocess.run([binary, "play", scenario, wad, str(AGENTS), str(idle_tics), actions, ",".join(VARIABLES)] +
                          [str(seed) for seed in seeds], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError("scenario_play: " + done.stderr.strip())
    episodes = collections.defaultdict(list)
    for row in csv.DictReader(io.StringIO(done.stdout)):
        rows = episodes[int(row["seed"])]
        if int(row["agent"]) == 0:
            rows.append([])
        rows[-1].append({name: float(row[name]) for name in VARIABLES} |
                        {"tics": int(row["tics"]), "finished": int(row["finished"])})
    return episodes


def returns_of(binary, scenario, episodes, folder):
    """{key: [return of each agent]}, by the scenario's own reward terms, of rows of either engine."""
    table = os.path.join(folder, "table.csv")
    with open(table, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["seed", "decision", "agent", "tics", "finished"] + VARIABLES)
        for key, rows in episodes.items():
            for decision, agents in enumerate(rows):
                for agent, row in enumerate(agents):
                    writer.writerow([key, decision, agent, row["tics"], row["finished"]] +
                                    ["%.10g" % row[name] for name in VARIABLES])
    done = subprocess.run([binary, "rewards", scenario, str(AGENTS), table], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError("scenario_play: " + done.stderr.strip())
    result = collections.defaultdict(list)
    for line in done.stdout.splitlines():
        key, _, value = line.split(",")
        result[int(key)].append(float(value))
    return result


# ---------------------------------------------------------------- comparing


def quantities():
    """(name, variable, agent)."""
    return [(name, name, 0) for name in USERS] + \
           [("%s of %d" % (name, agent + 1), name, agent) for name in OWN for agent in range(AGENTS)]


def is_equal(name, a, b):
    if name == "HEALTH":  # ViZDoom's falls below 0 in the dead
        a, b = max(a, 0), max(b, 0)
    return abs(a - b) <= CONTINUOUS.get(name, 1e-6)


def clipped(name, value):
    return max(value, 0.0) if name == "HEALTH" else value


def rank(value, others, tolerance, generator):
    """Where `value` stands among `others`, in 0..1: uniform where it is one of them."""
    below = sum(other < value - tolerance for other in others)
    same = sum(abs(other - value) <= tolerance for other in others)
    return (below + generator.random() * (same + 1)) / (len(others) + 1)


class Comparison:
    """All that is said of one scenario."""

    def __init__(self, name):
        self.name = name
        self.exact, self.off = [], {}       # names; name -> first difference of the idle episode from one of our worlds
        self.idle, self.idle_off = 0, []    # as `agreed` and `agreed_off`, of the idle episode
        self.agreed_off = []                # (decision, name, seed of the choices, ours, theirs)
        self.agreed = 0                     # values compared after a decision
        self.judged = 0                     # episodes in which they were: none in which presses were lost in every try
        self.tested = {}                    # name -> (ours, theirs, p)
        self.problem = ""
        self.replayed = 0


def lost_press(ours, theirs):
    """Whether ViZDoom's network lost or doubled a press of the player who joined, as it does where the machine is busy: a
    living player's turns in a decision follow from its presses alone."""
    turned = lambda rows, decision: (rows[decision][1]["ANGLE"] - rows[decision - 1][1]["ANGLE"]) % 360.0
    for decision in range(1, min(len(ours), len(theirs))):
        if any(rows[decision][0]["finished"] or rows[decision][1]["DEATHCOUNT"] > 0 for rows in (ours, theirs)):
            return False
        off = abs(turned(ours, decision) - turned(theirs, decision))
        if min(off, 360.0 - off) > 0.01:
            return True
    return False


def without_end(rows):
    """Of an episode that ended all but the last row: ViZDoom keeps the variables of the tic before the end."""
    return rows[:-1] if rows[-1][0]["finished"] and len(rows) > 1 else rows


def differences(ours, theirs):
    """{quantity: (decision, ours, theirs)}: where each differs first. Rows after an end are left out."""
    found = {}
    last = min(len(ours), len(theirs))
    for decision in range(last):
        if ours[decision][0]["finished"] or theirs[decision][0]["finished"]:
            break
        for label, name, agent in quantities():
            if label not in found:
                a, b = ours[decision][agent][name], theirs[decision][agent][name]
                if not is_equal(name, a, b):
                    found[label] = (decision, a, b)
    return found


def is_over(rows, decision):
    return decision >= len(rows) or rows[decision][0]["finished"]


def agreed_values(ours):
    """{(decision, quantity, name, agent): value}: what all of our worlds have alike after a decision."""
    worlds = list(ours.values())
    found = {}
    for decision in range(min(len(rows) for rows in worlds)):
        if any(is_over(rows, decision) for rows in worlds):
            break
        for label, name, agent in quantities():
            values = [rows[decision][agent][name] for rows in worlds]
            if is_equal(name, min(values), max(values)):
                found[decision, label, name, agent] = values[0]
    return found


def unlike(agreed, theirs, lasting):
    """Of the agreed values those that ViZDoom has not, the first one of each quantity, {key: (ours, theirs)}. `lasting`: that
    it has not after the next decision either."""
    found, seen = {}, set()
    for key, value in agreed.items():
        decision, label, name, agent = key
        if label in seen or is_over(theirs, decision):
            continue
        if is_equal(name, value, theirs[decision][agent][name]):
            continue
        following = (decision + 1, label, name, agent)
        if not lasting or (following in agreed and not is_over(theirs, decision + 1) and
                           not is_equal(name, agreed[following], theirs[decision + 1][agent][name])):
            seen.add(label)
            found[key] = (value, theirs[decision][agent][name])
    return found


def compare(scenario, arguments, folder, left_to_chance):
    result = Comparison(scenario)
    wad = os.path.join(folder, scenario + ".wad")
    done = subprocess.run([arguments.doomgen, scenario, "--num_agents", str(AGENTS), "--out", wad], capture_output=True, text=True)
    if done.returncode:
        result.problem = "doomgen: " + done.stderr.strip()
        return result
    with open(os.path.join(SCENARIOS, scenario, "scenario.toml"), "rb") as file:
        spec = tomllib.load(file)
    heads = [head["buttons"] for head in spec["heads"]]
    decisions = arguments.decisions
    try:
        # Nobody presses anything. ViZDoom shows its first state a tic or more after the map began.
        idle = [[[0] * len(heads)] * AGENTS] * decisions
        idle_theirs = play_vizdoom(wad, spec, heads, Script(idle), IDLE, folder)
        start = idle_theirs[0][0]["tics"]
        idle_ours = play_comrad(arguments.play, scenario, wad, start, idle, list(range(IDLE, IDLE + arguments.worlds)), folder)
        result.off = differences(idle_ours[IDLE], idle_theirs)
        if arguments.verbose:
            print("   ", scenario, "start", start, "idle:", result.off)
        both, their_returns, our_returns = [], {}, {}
        different = set()
        seeds = range(1000, 1000 + arguments.episodes)
        scripts = {IDLE: idle} | {seed: random_choices(heads, decisions, seed) for seed in seeds}
        turns = any("TURN_LEFT" in head for head in heads)

        def play_both(seed):
            ours = play_comrad(arguments.play, scenario, wad, start, scripts[seed],
                               [seed * 1000 + world for world in range(arguments.worlds)], tempfile.mkdtemp(dir=folder))
            for attempt in range(arguments.tries):
                # Seeds far apart: from neighbouring ones ViZDoom draws first numbers that are alike.
                theirs = play_vizdoom(wad, spec, heads, Script(scripts[seed]), seed * 2654435761 % 2**31, folder)
                if not turns or not lost_press(next(iter(ours.values())), theirs):
                    return ours, theirs, attempt
            return ours, theirs, arguments.tries

        def agreed_but_unlike(seed, ours, theirs):
            """(values compared, [(decision, quantity, seed, ours, theirs)]) of one script; none compared where too many plays of
            it lost a press."""
            plays = max(arguments.again, CONFIRMATIONS) if seed == IDLE else arguments.again
            agreed = {key: value for key, value in agreed_values(ours).items() if key[1] not in left_to_chance}
            first_world, confirmed = next(iter(ours.values())), 0
            if turns and lost_press(first_world, theirs):
                return 0, []
            # Where nobody turns, presses that came a tic late are not seen: there a difference has to last.
            off = unlike(agreed, theirs, not turns)
            for again in range(1, plays + 1):
                if not off or confirmed == CONFIRMATIONS:
                    break
                other = play_vizdoom(wad, spec, heads, Script(scripts[seed]), (seed + 7919 * again) * 2654435761 % 2**31, folder)
                if turns and lost_press(first_world, other):
                    continue
                confirmed += 1
                still = {label for _, label, _, _ in unlike(agreed, other, not turns)}
                off = {key: row for key, row in off.items() if key[1] in still and
                       not is_over(other, key[0]) and not is_equal(key[2], row[0], other[key[0]][key[3]][key[2]])}
            if off and confirmed < CONFIRMATIONS:
                return 0, []
            return len(agreed), sorted((decision, label, seed) + row for (decision, label, _, _), row in off.items())

        result.idle, result.idle_off = agreed_but_unlike(IDLE, idle_ours, idle_theirs)
        with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:  # of processes that wait for each other
            played = list(pool.map(play_both, seeds))
        result.replayed = sum(attempts for _, _, attempts in played)
        for seed, (ours, theirs, _) in zip(seeds, played):
            agreed, off = agreed_but_unlike(seed, ours, theirs)
            result.agreed += agreed
            result.judged += agreed > 0
            result.agreed_off += off
        for episode, (ours, theirs, _) in enumerate(played):
            both.append((theirs, list(ours.values())))
            for rows in ours.values():
                different.update(differences(rows, theirs))
            their_returns[episode] = returns_of(arguments.play, scenario, {0: without_end(theirs)}, folder)[0]
            our_returns[episode] = list(returns_of(
                arguments.play, scenario, {seed: without_end(rows) for seed, rows in ours.items()}, folder).values())
    except RuntimeError as problem:
        result.problem = str(problem)
        return result
    result.exact = [label for label, _, _ in quantities() if label not in different]
    generator = random.Random(scenario)

    def test(label, samples):
        """samples: of each episode (theirs, [ours])."""
        tolerance = CONTINUOUS.get(label.split(" of ")[0], 1e-4)  # ViZDoom's numbers are rounded
        ranks = [rank(value, others, tolerance, generator) for value, others in samples]
        mean = lambda values: sum(values) / len(values)
        result.tested[label] = (mean([mean(others) for _, others in samples]), mean([value for value, _ in samples]),
                                kolmogorov_smirnov_uniform(ranks))

    for label, name, agent in quantities():
        if label in different:
            test(label, [(clipped(name, without_end(theirs)[-1][agent][name]),
                          [clipped(name, without_end(rows)[-1][agent][name]) for rows in ours])
                         for theirs, ours in both])
    for agent in range(AGENTS):
        test("return of %d" % (agent + 1), [(their_returns[i][agent], [one[agent] for one in our_returns[i]])
                                            for i in range(arguments.episodes)])
    test("decisions played", [(len(theirs), [len(rows) for rows in ours]) for theirs, ours in both])
    return result


def differing(off):
    """What a check shows of such a list."""
    return "".join("; %s after decision %d of script %d: %.6g here, %.6g there" % (label, decision, seed, a, b)
                   for decision, label, seed, a, b in off[:AGREED_SHOWN]) + (
                       "; %d in all" % len(off) if len(off) > AGREED_SHOWN else "")


def table(results, arguments):
    lines = ["| scenario | agreed values | equal after every decision | nobody presses: first difference | by chance: quantity, ours, ViZDoom's, p (the least three) | return: ours, ViZDoom's, p | decisions: ours, ViZDoom's, p |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    number = lambda value: "%.4g" % value
    for result in results:
        if result.problem:
            lines.append("| %s | | | %s | | | |" % (result.name, result.problem))
            continue
        rest = {label: row for label, row in result.tested.items()
                if not label.startswith("return") and label != "decisions played"}
        least = sorted(rest.items(), key=lambda item: item[1][2])[:3]
        show = lambda row: "%s, %s, %.2g" % (number(row[0]), number(row[1]), row[2])
        off = ["%s after %d: %s, %s" % (label, row[0], number(row[1]), number(row[2])) for label, row in result.off.items()]
        lines.append("| %s | %d, %d differ | %d of %d | %s | %s | %s | %s |" % (
            result.name, result.agreed, len(result.agreed_off), len(result.exact), len(quantities()), "; ".join(off[:3]) + (" ..." if len(off) > 3 else "") or "none",
            "; ".join("%s %s" % (label, show(row)) for label, row in least) or "none",
            "; ".join(show(result.tested["return of %d" % (agent + 1)]) for agent in range(AGENTS)),
            show(result.tested["decisions played"])))
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--doomgen", required=True, help="the program comrad-doomgen")
    parser.add_argument("--play", required=True, help="the program scenario_play")
    parser.add_argument("--venv", default=os.path.join(os.path.dirname(__file__), "../../build/test-python"))
    parser.add_argument("--only", default="", help="names with commas between")
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--decisions", type=int, default=175)
    parser.add_argument("--tries", type=int, default=5, help="of an episode in which a press was lost on the way")
    parser.add_argument("--again", type=int, default=8, help="plays with other seeds, at most, where agreed values differ; 0: those are not judged")
    parser.add_argument("--jobs", type=int, default=2, help="games of ViZDoom at a time")
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--table", default="", help="file for the table")
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args()
    import_vizdoom(arguments.venv, "parity of scenarios with ViZDoom")
    arguments.doomgen, arguments.play = os.path.abspath(arguments.doomgen), os.path.abspath(arguments.play)
    with open(LEFT_TO_CHANCE) as file:
        left_to_chance = json.load(file)
    report, results = Report(), []
    folder = tempfile.mkdtemp()
    try:
        for name in scenario_names():
            if arguments.only and name not in arguments.only.split(","):
                continue
            result = compare(name, arguments, folder, left_to_chance.get(name, []))
            results.append(result)
            if result.problem:
                report.check(name, False, result.problem)
                continue
            bad = {label: row for label, row in result.tested.items() if row[2] < TAIL}
            report.check(name + ", nobody presses", result.idle and not result.idle_off, "%d values on which all of our worlds agree%s" % (
                result.idle, differing(result.idle_off)))
            if arguments.again:
                report.check(name + ", agreed values", not result.agreed_off and 2 * result.judged > arguments.episodes,
                             "%d values on which all of our worlds agree, in %d of %d episodes%s" % (
                                 result.agreed, result.judged, arguments.episodes, differing(result.agreed_off)))
            report.check(name, not bad, "%d of %d quantities equal after every decision, %d by chance, %d played again, least p %.2g%s" % (
                len(result.exact), len(quantities()), len(result.tested), result.replayed, min(row[2] for row in result.tested.values()),
                "".join("; %s %.4g against %.4g, p %.1g" % ((label,) + row) for label, row in bad.items())))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = table(results, arguments)
    print(text)
    if arguments.table:
        with open(arguments.table, "w") as file:
            file.write(text)
    print("%d failed" % report.failed)
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
