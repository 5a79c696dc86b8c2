#!/usr/bin/env python3
"""Measures the scores between which reports normalise: random play and the scripted team on each scenario's default map,
in all of its variants.

    deploy/report/measure_references.py [--comrad ./comrad] [--episodes 100] [--seed 5000] [-o scenarios/reference_scores.toml]

Plays what is missing in the output file or of another version; delete an entry, or the file, to measure it anew. Uses `comrad eval` alone.
"""

import argparse
import datetime
import json
import pathlib
import subprocess
import sys
import tomllib

HOME = pathlib.Path(__file__).resolve().parents[2]
HEAD = """# What `comrad report` normalises scores with: J of random play (0) and of the scripted team (1), on the default map
# (layout seed 42) with the default team, mean and half-width of its 95 % interval over episodes (Student t).
# `comrad eval --scenario NAME --policy random|oracle --episodes N --seed S`; deploy/report/measure_references.py writes this file.
# Random play is the one number that pages name; random_seed and random_date are its own where the scripted team is older.
"""


def evaluate(comrad: str, scenario: str, policy: str, episodes: int, seed: int) -> dict:
    """The answer of one `comrad eval`; ends the program with its words where it fails."""
    command = [
        comrad,
        "eval",
        "--scenario",
        scenario,
        "--policy",
        policy,
        "--episodes",
        str(episodes),
        "--seed",
        str(seed),
        "--json",
    ]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"measure_references: {' '.join(command)} ended with {done.returncode}")
    return json.loads(done.stdout)


def text_of(entries: dict[str, dict]) -> str:
    text = HEAD
    for scenario in sorted(entries):
        text += f"\n[{json.dumps(scenario) if '@' in scenario else scenario}]\n" + "".join(
            f"{name} = {json.dumps(value) if isinstance(value, str) else format(value, '.6g') if isinstance(value, float) else value}\n"
            for name, value in entries[scenario].items()
        )
    return text


def games() -> list[tuple[str, int]]:
    """Every scenario and variant with its version."""
    found = []
    for path in HOME.glob("scenarios/*/scenario.toml"):
        version = tomllib.loads(path.read_text(encoding="utf-8")).get("version", 1)
        variants = [f"{path.parent.name}@{one.stem}" for one in path.parent.glob("variants/*.toml")]
        found += [(name, version) for name in (path.parent.name, *variants)]
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--comrad", default=str(HOME / "comrad"))
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("-o", "--output", type=pathlib.Path, default=HOME / "scenarios" / "reference_scores.toml")
    arguments = parser.parse_args()
    entries = tomllib.loads(arguments.output.read_text(encoding="utf-8")) if arguments.output.exists() else {}
    for scenario, version in sorted(games()):
        if entries.get(scenario, {}).get("version") == version:
            continue
        entry = {}
        for name, policy in (("random", "random"), ("scripted", "oracle")):
            answer = evaluate(arguments.comrad, scenario, policy, arguments.episodes, arguments.seed)
            entry |= {name: float(answer["J_mean"]), f"{name}_half_width": float(answer["J_ci95"])}
        entries[scenario] = {
            "num_agents": answer["num_agents"],
            "episodes": arguments.episodes,
            "seed": arguments.seed,
            "version": version,
            "date": datetime.date.today().isoformat(),
            **entry,
        }
        arguments.output.write_text(text_of(entries), encoding="utf-8")
        print(scenario, entry, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
