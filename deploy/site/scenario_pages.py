#!/usr/bin/env python3
"""The pages of the games: what the program reports of each as Markdown, and pages with pictures and GIFs beside them.

    scenario_pages.py --comrad PROGRAM --pages DIR [NAME ...]

A page is scenarios/<name>/README.md, whose part between two marks generated() writes, with what media() draws: a GIF of the
scripted team, all views side by side, the map from above and, where there is a kept policy, a GIF of what was learned. What
lies in DIR already and is newer than the program and the scenario is left as it is. Links that lead out of DIR become text.
"""

import argparse
import concurrent.futures
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib

HOME = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HOME / "deploy" / "report"))
import policies  # noqa: E402

BAD_INPUT = 2
TIMEOUT_S = 600
GIF_SECONDS, GIF_SIZE, GIF_BYTES_MAX = 12, "256x144", 1_500_000
LEARNED = "learned.gif"
AMOUNTS = {
    "value": "{v}",
    "event": "once {v} rises",
    "rise": "rise of {v}",
    "fall": "fall of {v}",
    "delta": "change of {v}",
    "new_max": "rise of {v} above its best",
}
CONDITIONS = {"TRUNCATED": "at the time limit", "TERMINATED": "when the episode terminates", "FIRST": "in the first decision"}


def output_of(comrad: str, *words: str) -> str:
    """What `comrad WORDS` prints. Errors: CalledProcessError, with the program's own words on stderr."""
    return subprocess.run([comrad, *words], stdout=subprocess.PIPE, text=True, timeout=TIMEOUT_S, check=True).stdout


def names_of(home: pathlib.Path) -> list[str]:
    """Games with a page, in the order of scenarios/README.md."""
    return re.findall(r"^\| \[(\w+)\]\(\1/README\.md\)", (home / "scenarios/README.md").read_text(encoding="utf-8"), re.MULTILINE)


def grouped(number: float) -> str:
    """4 000; 11.2."""
    return f"{number:,.0f}".replace(",", " ") if abs(number) >= 1000 else f"{number:.3g}"


def table(head: list[str], rows: list[list[str]], align: str = "") -> str:
    """Cells are Markdown already, without '|'."""
    rule = [{"r": "---:"}.get(one, "---") for one in align.ljust(len(head))]
    return "".join(f"| {' | '.join(row)} |\n" for row in [head, rule, *rows])


def score_text(mean: float, half_width: float) -> str:
    digits = f"{half_width:.2g}" if half_width < 100 else grouped(float(f"{half_width:.2g}"))
    return f"{grouped(mean)} ± {digits}" if half_width else grouped(mean)


def words_of(buttons: list[str]) -> str:
    words = ", ".join(buttons).replace("MOVE_", "").replace("SELECT_", "").replace("_", " ").lower()
    return re.sub(r"(?<=weapon)(?=\d)", " ", words)


def actions_of(described: dict) -> str:
    """54 = 3x3x3x2: none, forward, backward; ..."""
    heads = "; ".join(words_of(["none", *buttons]) for buttons in described["head_buttons"])
    return f"{math.prod(described['heads'])} = {'x'.join(map(str, described['heads']))}: {heads}"


def roles_of(described: dict) -> str:
    """What each agent may press, where masks part them."""
    masked = {(one["agent"], one["head"]): [word for word in one["allowed"] if word != "none"] for one in described["masks"]}
    roles = []
    for agent in sorted({agent for agent, _ in masked}):
        heads = [masked.get((agent, head), buttons) for head, buttons in enumerate(described["head_buttons"])]
        roles.append(f"agent {agent}: {'; '.join(words_of(buttons) for buttons in heads if buttons)}")
    return " / ".join(roles)


def facts(described: dict, references: dict, published: dict) -> str:
    """One table: shapes, limit, score, what others reached."""
    names = {one["variable"]: one["name"] for one in described["exported_variables"] if one["name"]}
    teams = [str(count) for count in described["supported_agents"] if count != described["num_agents"]]
    seen = [name.replace("_", " ") for name, is_on in described["observation"].items() if is_on]
    measured = f"; {described['measurements']} measurements" if described["measurements"] else ""
    limit, alpha = described["decision_limit"], described["shared_reward_alpha"]
    score = names.get(described["score"], described["score"])
    if described["score_divisor"]:
        score += f" / {names.get(described['score_divisor'], described['score_divisor'])}"
    rows = [
        ["agents", str(described["num_agents"]) + (f"; {', '.join(teams)} play the same map" if teams else "")],
        ["observation", f"3x72x128 RGB with {', '.join(seen)}{measured}"],
        ["action", actions_of(described)],
        ["roles", roles_of(described)],
        ["limit", f"{grouped(limit)} decisions = {grouped(4 * limit)} tics: truncated"],
        ["score J", f"`{score}`: {described['score_meaning'] or described['score_unit']}; ceiling {grouped(described['ceiling'])} on the default map"],
        ["rewards", f"alpha = {alpha:g}: " + ("every agent gets the team's sum" if alpha else "each agent gets its own")],
        ["difficulty", str(described["difficulty"])],
    ]
    if references:
        played = f"{references['episodes']} episodes, default map"
        rows += [
            ["random play", f"J {score_text(references['random'], references['random_half_width'])} ({played}, {references['random_date']})"],
            ["scripted team", f"J {score_text(references['scripted'], references['scripted_half_width'])} ({played}, {references['date']})"],
        ]
    if published:
        reached = zip(published["algorithms"], published["printed"], published["half_width"])
        scores = ", ".join(f"{algo} {score_text(mean, half)}" for algo, mean, half in reached)
        rows.append(["the paper's agents", f"{scores}; {published['unit']}, 100 M env frames of `--variant reference`"])
    return table(["", ""], [row for row in rows if row[1]])


def amount_of(term: dict, names: dict[str, str]) -> str:
    """What a decision counts for a term, before its weight."""
    variable = names.get(term["variable"], term["variable"])
    shown = f"the agent's `{re.sub(r'_(1|0|a|navigator)$', '', variable)}`" if term["agent_stride"] else f"`{variable}`"
    words = [] if variable == "ONE" and term["when"] else [AMOUNTS[term["kind"]].format(v=shown)]
    if variable in CONDITIONS:
        words = [CONDITIONS[variable]]
    elif variable == "ONE" and words:
        words = ["1, every decision"]
    if term["when"]:
        condition = names.get(term["when"], term["when"])
        words.append(CONDITIONS.get(condition, f"when `{condition}`"))
    if term["unless"]:
        words.append(f"unless `{names.get(term['unless'], term['unless'])}`")
    if term["cap"]:
        words.append(f"at most {term['cap']:g}")
    return ", ".join(words)


def reward_rows(described: dict) -> list[list[str]]:
    """One row a term: name, weight, amount, meaning."""
    names = {one["variable"]: one["name"] for one in described["exported_variables"] if one["name"]}
    return [
        [f"`{term['name']}`", f"{term['weight']:+g}" + " / N" * term["per_agent"], amount_of(term, names), term["meaning"].replace("|", "\\|")]
        for term in described["rewards"]
    ]


def generated(comrad: str, home: pathlib.Path, name: str) -> str:
    """The part of a page that is written by the program."""
    described = json.loads(output_of(comrad, "scenarios", "describe", name, "--json"))
    read = lambda path: tomllib.loads((home / path).read_text(encoding="utf-8"))
    published = read("deploy/report/published.toml")
    paper = {"algorithms": published["algorithms"], **published[name]} if name in published else {}
    parameters = [[f"`{one['name']}`", str(one["default"]), f"{one['low']} to {one['high']}", one["help"].replace("|", "\\|")] for one in described["layout_parameters"]]
    return (
        f"## In numbers\n\n{facts(described, read('scenarios/reference_scores.toml').get(name, {}), paper)}\n## Rewards\n\n"
        f"{table(['term', 'weight', 'amount of a decision', 'meaning'], reward_rows(described), ' r')}\n## Layout parameters\n\n"
        f"`./comrad doomgen {name} --set NAME=VALUE`; pools draw an axis's values. "
        f"[How the maps are drawn](../MAPS.md#{described['title'].lower().replace(' ', '-')}).\n\n"
        f"{table(['parameter', 'default', 'range', 'meaning'], parameters, ' r')}\n"
    )


def record(comrad: str, words: list[str], to: pathlib.Path) -> None:
    """A GIF of one episode's beginning, as long as GIF_BYTES_MAX allow."""
    seconds = float(GIF_SECONDS)
    while True:
        flags = ["--save_video", str(to), "--size", GIF_SIZE, "--seconds", f"{seconds:.1f}", "--json"]
        output_of(comrad, "eval", *words, "--episodes", "1", "--seed", "42", "--num_workers", "1", *flags)
        if to.stat().st_size <= GIF_BYTES_MAX:
            return
        seconds *= 0.9 * GIF_BYTES_MAX / to.stat().st_size


def is_fresh(path: pathlib.Path, comrad: str, home: pathlib.Path, name: str) -> bool:
    """Whether a picture is newer than what drew it and what it shows."""
    sources = [pathlib.Path(comrad).with_name("comrad-sim-video"), *(home / "scenarios" / name).glob("*.*")]
    sources = [one for one in sources if one.suffix in ("", ".toml", ".cc", ".acs", ".decorate") and one.exists()]
    if path.name == LEARNED:
        sources.append(policies.named())
    return path.exists() and all(path.stat().st_mtime > one.stat().st_mtime for one in sources)


def media(comrad: str, home: pathlib.Path, name: str, folder: pathlib.Path, policy: pathlib.Path | None) -> str:
    """Draws what is missing or old into `folder`. Returns the Markdown that shows it."""
    folder.mkdir(parents=True, exist_ok=True)
    title = name.replace("_", " ")
    shown = []
    wanted = {
        "scripted.gif": (f"The scripted team of {title}", lambda path: record(comrad, ["--scenario", name, "--policy", "oracle"], path)),
        "strip.png": ("All agents' views, 100 decisions in", lambda path: shutil.copyfile(home / "scenarios/gallery" / f"{name}.png", path)),
        "map.png": ("The map from above", lambda path: output_of(comrad, "doomgen", "show", name, "--size", "480", "-o", str(path))),
    }
    if policy is not None:
        wanted[LEARNED] = ("What was learned", lambda path: record(comrad, ["--policy", str(policy)], path))
    for file, (caption, draw) in wanted.items():
        path = folder / file
        if not is_fresh(path, comrad, home, name):
            draw(path)
        shown.append(f"![{caption}]({file})\n")
    return "\n".join(shown)


def with_media(text: str, shown: str) -> str:
    """A page with its pictures before its first heading below the title."""
    head, mark, rest = text.partition("\n## ")
    return f"{head}\n{shown}{mark}{rest}"


def all_media(comrad: str, home: pathlib.Path, names: list[str], folder: pathlib.Path) -> dict[str, str]:
    """media() of each game, as many at once as there are cores. Policies are those that fetch-policies finds."""
    with tempfile.TemporaryDirectory(prefix="comrad_pages_") as scratch, concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        source, kept = policies.Source(policies.named()), {}
        for name in set(names) & set(source.policies):
            kept |= policies.fetch(source, [name], pathlib.Path(scratch))
        return dict(zip(names, pool.map(lambda name: media(comrad, home, name, folder / name, kept.get(name)), names)))


def write_pages(comrad: str, home: pathlib.Path, names: list[str], folder: pathlib.Path) -> None:
    """Writes <folder>/<name>/README.md with its pictures. Errors: OSError, CalledProcessError."""
    shown = all_media(comrad, home, names, folder)
    for name in names:
        source = home / "scenarios" / name
        text = with_media((source / "README.md").read_text(encoding="utf-8"), shown[name])
        for picture in re.findall(r"!\[[^\]]*\]\(([\w.]+)\)", text):
            if (source / picture).exists() and not (folder / name / picture).exists():
                shutil.copyfile(source / picture, folder / name / picture)
        text = re.sub(r"(?<!!)\[([^\]]*)\]\((?![a-z]+:|#)[^)]*\)", r"\1", text)
        (folder / name / "README.md").write_text(text, encoding="utf-8")
        print(folder / name / "README.md")


def main() -> int:
    parser = argparse.ArgumentParser(prog="comrad scenarios", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--comrad", required=True, help=argparse.SUPPRESS)
    parser.add_argument("--pages", required=True, type=pathlib.Path, metavar="DIR")
    parser.add_argument("names", nargs="*", metavar="NAME")
    arguments = parser.parse_args()
    known = names_of(HOME)
    unknown = [name for name in arguments.names if name not in known]
    if unknown:
        print(f"comrad scenarios: error: {unknown[0]} has no page; known: {', '.join(known)}", file=sys.stderr)
        return BAD_INPUT
    try:
        write_pages(arguments.comrad, HOME, arguments.names or known, arguments.pages.absolute())
    except (OSError, ValueError) as error:
        print(f"comrad scenarios: error: {error}", file=sys.stderr)
        return BAD_INPUT
    except subprocess.CalledProcessError as error:
        return error.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
