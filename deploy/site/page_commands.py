"""The commands on pages: how to find them, and what each needs that a test has not. site_test runs the others."""

import re
import shlex
from collections.abc import Iterator

# What a command needs that the suite cannot give on a page's behalf. Its flags are checked all the same; the settings of
# `comrad train` also by `comrad config`. Commands that are not named here are run.
NEEDS = {
    "train": "time to train",
    "test": "time for the suite",
    "bench": "an idle machine",
    "sweep": "time for many runs",
    "eval": "a trained run",
    "plot": "a trained run",
    "report": "trained runs",
    "export": "trained runs",
    "pack-policies": "finished sweeps",
    "fetch-policies": "a folder of runs",
    "ctl": "a run that is alive",
    "acs": "a script",
    "join": "another host",
    "serve": "another host",
    "docs": "a browser",
    "watch": "a browser",
    "play": "a browser",
    "top": "a run that is alive",
    "doctor": "your machine",
}
PLACEHOLDER = re.compile(r"\.\.\.|[A-Z]{3,}|\$|[|<>]|\bpath/to/|\bK\b")  # a word that a reader replaces
COMMAND = re.compile(r"\s*(?:\w+:?\$ +)?(?:\./|~/comrad/bin/)?comrad +([a-z]\S*.*)")


def words_of(line: str) -> list[str] | None:
    """The words of a line of a shell that starts comrad, without `comrad`, comments and redirections; None for another line."""
    match = COMMAND.match(line)
    if not match or "──" in line:
        return None
    try:
        words = shlex.split(re.split(r" [<>|&]{1,2}(?: |/)", match[1])[0], comments=True)
    except ValueError:
        return None
    return [word.strip("[]") for word in words]


def commands_in(block: list[str]) -> list[list[str]]:
    """The commands of the lines of a fenced block; a backslash at the end of a line joins it with the next."""
    joined = re.sub(r"\\\n", " ", "\n".join(block)).splitlines()
    return [words for line in joined if (words := words_of(line))]


def blocks_of(text: str) -> Iterator[tuple[int, list[str]]]:
    """The fenced blocks of a page: the number of the first line and the lines."""
    lines, begin = text.splitlines(), None
    for number, line in enumerate(lines):
        if line.lstrip().startswith("```"):
            if begin is not None:
                yield begin + 2, lines[begin + 1 : number]
            begin = number if begin is None else None


def is_complete(words: list[str]) -> bool:
    """Whether a command can be run as it is written."""
    return not any(PLACEHOLDER.search(word) for word in words)


def need_of(block: list[str]) -> str | None:
    """What the commands of a block need that a test has not; None where all are run, or where there are none."""
    for words in commands_in(block):
        if words[0] in NEEDS:
            return NEEDS[words[0]]
        if not is_complete(words):
            return "names of your own"
    return None
