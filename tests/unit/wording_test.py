#!/usr/bin/env python3
"""Comments, string literals and test names of the sources use the field's words, not private names or persons for programs.

    wording_test.py [ROOT]              the check, after a check of itself
    wording_test.py ROOT --list [PATH]  every finding below PATH, as file:line: word: text

Reads C++, CUDA, .def, IDL, ACS, Python, shell, CMake and TOML files. RULES has a pattern, and what to write instead; EXCEPTIONS has
files where a pattern means something else.

First the same check runs over sources made for it that break each rule once, and must find every fault.
"""
import io
import os
import re
import sys
import tempfile
import tokenize

NOT_OURS = {".git", "build", "train_dir", "golden", "results", "corpus"}
MADE_BY_TOOLS = {"CMakeCache.txt", "pyvenv.cfg"}  # a build folder, a Python environment

RULES = [
    # Persons, for programs and files.
    (r"who|whom|whoever|nobody|somebody|everybody|anybody|someone|everyone|anyone", "name the component"),
    (r"tells|told", "reports, prints"),
    (r"says", "contains, reports, prints"),
    (r"knows", "contains, stores"),
    (r"wants", "requires"),
    (r"asks|asks? for|asked for", "requests"),
    (r"wish(?:es)?", "request"),
    # Private names.
    (r"(?:signal |layout )?desks?", "mailbox, queue"),
    (r"guests?", "peer"),
    (r"strangers?", "unknown peer"),
    (r"feeders?", "trajectory sender"),
    (r"late pay", "post-death reward"),
    (r"run hub", "run resources"),
    (r"crews?", "thread pool"),
    (r"doors?", "join endpoint, control socket"),
    (r"made up|made anew", "synthetic, rebuilt"),
    (r"mend(?:s|ed)?", "fixed"),
    # Idioms.
    (r"goes on|go on|went on|going on", "continues, resumes"),
    (r"stands in|stand in", "is in"),
    (r"may be had", "is available"),
    (r"of (?:its|their) own", "own, separate"),
    (r"words? too many", "unexpected argument"),
]
PATTERN = re.compile(
    "|".join(rf"(?P<r{i}>\b(?:{pattern})\b)".replace(" ", r"\s+") for i, (pattern, _) in enumerate(RULES)), re.IGNORECASE
)

# Players, monsters and other actors of the game.
PERSONS = "who|whom|nobody|somebody|everybody|anybody|someone|everyone|anyone"
PLACES_OF_THE_GAME = [
    "sim_workers/engine", "sim_workers/oracle", "tests/parity", "tests/unit/sim_workers/acs", "tests/unit/sim_workers/actors",
    "tests/unit/sim_workers/map", "tests/unit/sim_workers/play", "tests/unit/sim_workers/render",
    "tests/unit/sim_workers/specials", "tests/unit/sim_workers/tic", "tests/unit/sim_workers/world",
    *(f"{tests}scenarios/{game}" for tests in ("", "tests/unit/") for game in (
        "ammo_carrier", "armory_siege", "coop_health_gathering", "coop_puzzle", "dumb_enemies", "foraging_commons",
        "lava_maze", "lava_pit", "platform_chain", "rhythm_sync", "smart_enemies", "stag_hunt_arena", "stealth_labyrinth",
        "demon_hunt")),
]  # fmt: skip
# Folder or file, pattern: what has another meaning there.
EXCEPTIONS = [
    *((place, PERSONS) for place in PLACES_OF_THE_GAME),
    *((place, "doors?") for place in (
        "doomgen", "scenarios", "sim_workers", "tests/parity", "tests/support", "tests/unit/doomgen", "tests/unit/scenarios",
        "tests/unit/sim_workers")),
    ("learner/sources/layout_service.cc", "desks"),  # a key in checkpoints
    ("rollout_buffer/dds", "door"),  # a partition of published keys
    ("rollout_buffer/link/join", "guests"),  # guests.json
    ("tests/unit/rollout_buffer/link/join", "guests"),
    ("tests/integration/hosts_long_test.cc", "guests"),  # guests.json
    ("tests/integration/decision_accounts.h", "guests"),
]  # fmt: skip

C_LIKE = re.compile(
    r"""//[^\n]*|/\*.*?\*/|R"(?P<tag>[^(\s]*)\(.*?\)(?P=tag)"|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])'""", re.DOTALL
)
HASHED = re.compile(r"""#[^\n]*|\"\"\".*?\"\"\"|'''.*?'''|"(?:\\.|[^"\\])*"|'[^'\n]*'""", re.DOTALL)
MARKS = re.compile(r"""^(?://[/!]?<?|#+)|[ \t]+#+(?=\s)|(?<=\n)[ \t]*\*|^"|"$""", re.MULTILINE)
TEST_NAME = re.compile(r"\bTEST(?:_F|_P)?\(\s*\w+,\s*(\w+)\)")
BRACES = re.compile(r"\{[^{}\n]*\}")
INCLUDE = re.compile(r"\s*#\s*include\b")


def c_like_texts(text):
    for match in C_LIKE.finditer(text):
        start = text.rfind("\n", 0, match.start()) + 1
        if not INCLUDE.match(text[start : match.start()]):
            yield match.start(), match.group()


def hashed_texts(text):
    for match in HASHED.finditer(text):
        yield match.start(), match.group()


def python_texts(text):
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in kinds:
            # An f-string's {names} are code. The spaces keep offsets.
            yield starts[token.start[0] - 1] + token.start[1], BRACES.sub(lambda match: " " * len(match.group()), token.string)


def shell_texts(text):
    """Comments, and whole lines that hold a quote: enough to find messages."""
    offset = 0
    for line in text.splitlines(keepends=True):
        if "#" in line or '"' in line or "'" in line:
            yield offset, line
        offset += len(line)


def reader_of(name):
    if name.endswith((".cc", ".h", ".cu", ".cuh", ".def", ".idl", ".acs")):
        return c_like_texts
    if name.endswith((".py", ".pyi")):
        return python_texts
    if name.endswith((".sh", ".sbatch")) or name in ("comrad", "run", "postinst", "prerm", "until_finished"):
        return shell_texts
    if name.endswith((".toml", ".cmake", ".yaml", ".yml")) or name == "CMakeLists.txt":
        return hashed_texts
    return None


def sources(root):
    for folder, folders, names in os.walk(root):
        if MADE_BY_TOOLS & set(names):
            folders[:] = []
            continue
        folders[:] = sorted(name for name in folders if name not in NOT_OURS)
        for name in sorted(names):
            path = os.path.relpath(os.path.join(folder, name), root)
            if reader_of(name) and os.path.abspath(os.path.join(folder, name)) != os.path.abspath(__file__):
                yield path


def is_exception(path, found):
    return any(
        (path == where or path.startswith(where + "/")) and re.fullmatch(pattern, found, re.IGNORECASE)
        for where, pattern in EXCEPTIONS
    )


def test_names(text):
    """Offset and words of each GoogleTest name."""
    for match in TEST_NAME.finditer(text):
        yield match.start(1), re.sub(r"(?<=.)(?=[A-Z])", " ", match.group(1))


def read_by_persons(text, pieces):
    """`text` with a NUL for each character of code. Comments and literals with only blanks between them stay one text, without the
    marks at their ends, so that a phrase may go over several lines."""
    shown = ["\0"] * len(text)
    end = 0
    for start, piece in pieces:
        if text[end:start].isspace():
            shown[end:start] = text[end:start]
        shown[start : start + len(piece)] = MARKS.sub(lambda match: " " * len(match.group()), piece)
        end = start + len(piece)
    return "".join(shown)


def findings(root, paths):
    for path in paths:
        with open(os.path.join(root, path), encoding="utf-8") as file:
            text = file.read()
        shown = read_by_persons(text, reader_of(os.path.basename(path))(text))
        for match in PATTERN.finditer(shown):
            found = " ".join(match.group().split())
            if not is_exception(path, found):
                line = text.count("\n", 0, match.start()) + 1
                yield path, line, found, RULES[int(match.lastgroup[1:])][1], text.splitlines()[line - 1].strip()
        for start, words in test_names(text) if path.endswith(".cc") else ():
            match = PATTERN.search(words)
            if match and not is_exception(path, match.group()):
                yield path, text.count("\n", 0, start) + 1, match.group(), RULES[int(match.lastgroup[1:])][1], words


def check_itself():
    """Each reader finds a planted word where a person reads it, and none in names, code and include lines."""
    planted = {
        "two_lines.cc": 'int a;  // goes\n// on\nauto b = "asks"\n         " for";\nint goes; // goes\nint on;\n',
        "a.cc": '#include "door/guest.h"\nint who = 1, crew_size = 2;\n// Never waits for\n// somebody.\nauto a = "it wants b";\n',
        "names.cc": 'TEST(Arena, IsToldWhoWaits) {}\nTEST_F(Who, Waits) {}\n',
        "b.h": '/* Nobody\n   knows. */\nauto c = R"x(told)x";\n',
        "c.def": 'SETTING(bool, x, true, any(),\n        "asks for more")\n',
        "d.py": 'who = 1\n"""Made up."""\nprint(f"of its own {who}")  # goes on\n',
        "e.sh": "who=1\nfail \"a stranger\" # a guest\n",
        "f.toml": '[who]\nsummary = "a wish" # feeder\n',
        "g.acs": '// late pay\nint door = 1;\n',
        "h.idl": "/// Whoever writes.\nstruct Guest {};\n",
        "i/CMakeLists.txt": "# one word too many\nset(who 1)\n",
        "j.txt": "nobody reads this\n",
    }
    expected = {
        ("names.cc", 1, "Told"), ("two_lines.cc", 1, "goes on"), ("two_lines.cc", 3, "asks"), ("a.cc", 4, "somebody"), ("a.cc", 5, "wants"), ("b.h", 1, "Nobody"), ("b.h", 2, "knows"), ("b.h", 3, "told"),
        ("c.def", 2, "asks"), ("d.py", 2, "Made up"), ("d.py", 3, "of its own"), ("d.py", 3, "goes on"),
        ("e.sh", 2, "stranger"), ("e.sh", 2, "guest"), ("f.toml", 2, "wish"), ("f.toml", 2, "feeder"),
        ("g.acs", 1, "late pay"), ("h.idl", 1, "Whoever"), ("i/CMakeLists.txt", 1, "word too many"),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as root:
        for name, text in planted.items():
            os.makedirs(os.path.dirname(os.path.join(root, name)), exist_ok=True)
            with open(os.path.join(root, name), "w", encoding="utf-8") as file:
                file.write(text)
        found = {(path, line, word) for path, line, word, _, _ in findings(root, sources(root))}
    if found != expected:
        sys.exit(f"the check is broken: missed {sorted(expected - found)}, false {sorted(found - expected)}")


def main():
    root = sys.argv[1] if len(sys.argv) > 1 else "."
    below = sys.argv[3] if len(sys.argv) > 3 else ""
    check_itself()
    lists = len(sys.argv) > 2
    paths = [path for path in sources(root) if path.startswith(below if lists else "")]
    count = 0
    for path, line, word, instead, text in findings(root, paths):
        count += 1
        print(f"{path}:{line}: {word}: {text}" if lists else f"{path}:{line}: '{word}' (write: {instead}): {text}")
    if not paths:
        sys.exit(f"no sources below {root}")
    print(f"{count} findings in {len(paths)} files")
    sys.exit(0 if lists or count == 0 else 1)


if __name__ == "__main__":
    main()
