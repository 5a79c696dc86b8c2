"""The pages that the program and the sources write: commands, settings, errors, and what each file is for."""

import functools
import html
import os
import pathlib
import re
from collections.abc import Iterator

import scenario_pages
from scenario_pages import output_of
from stage import MADE_BY_TOOLS, PARTS, folder_page

SETTINGS_HEAD = re.compile(r"^Settings \(built-in", re.MULTILINE)


def cell(text: str) -> str:
    """Text in a table's cell: nothing in it is Markdown or HTML."""
    return re.sub(r"([\\`*_\[\]{}|#~])", r"\\\1", html.escape(text, quote=False))


def commands(comrad: str) -> str:
    """A page of every command with its flags."""
    page = "# Commands\n\nWritten by the program: `comrad help COMMAND`. Settings of a run: [Settings](settings.md).\n"
    for name, summary in re.findall(r"^  ([a-z-]+) +(\S.*)$", output_of(comrad, "help"), re.MULTILINE):
        if name in ("help", "version"):
            continue
        text = SETTINGS_HEAD.split(output_of(comrad, "help", name))[0].rstrip()
        page += f"\n## comrad {name}\n\n{cell(summary[0].upper() + summary[1:])}.\n\n```text\n{text}\n```\n"
    return page


def settings(comrad: str) -> str:
    """A page of every setting of a run, in the program's groups."""
    text = SETTINGS_HEAD.split(output_of(comrad, "help", "config", "--all"), maxsplit=1)[1]
    page = (
        "# Settings\n\nWritten by the program: `comrad help config --all`. Each is a flag of `comrad train` (`--seed 7`), a key of a TOML file\n"
        "(`--config FILE`) and a key of a run's `config.toml`. Defaults are those of coop_health_gathering with ippo on the machine that\n"
        "made this page; `comrad config --scenario NAME --algo NAME` prints the values of another run and where each comes from.\n"
    )
    rows: list[list[str]] = []

    def table() -> str:
        body = "".join(f"| `{name}` | {cell(kind)} | {cell(' '.join(words))} |\n" for name, kind, *words in rows)
        rows.clear()
        return f"\n| setting | value | meaning |\n| --- | --- | --- |\n{body}" if body else ""

    for line in text.splitlines()[1:]:
        flag = re.match(r"  --(\w+)(?: (\S+))?(?:  +(\S.*))?$", line)
        if flag:
            rows.append([flag[1], flag[2] or "", *([flag[3]] if flag[3] else [])])
        elif re.match(r" {20,}\S", line) and rows:
            rows[-1].append(line.strip())
        elif re.match(r"[A-Z][\w ,-]*$", line):
            page += table() + f"\n## {line}\n"
    return page + table()


def errors(home: pathlib.Path) -> str:
    """A page of exit codes and kinds of errors, from the headers that define them."""
    process = (home / "rollout_buffer/core/process.h").read_text(encoding="utf-8")
    expected = (home / "rollout_buffer/core/expected.h").read_text(encoding="utf-8")
    codes = re.findall(r"^constexpr int kExit(\w+) = (\d+);(?:  ///< (.*))?$", process, re.MULTILINE)
    kinds = re.findall(r"^  k(\w+), +///< (.*)$", re.search(r"enum class ErrorCode \{(.*?)\};", expected, re.DOTALL)[1], re.MULTILINE)

    def words(name: str) -> str:
        return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()

    page = (
        "# Errors and exit codes\n\nA message is one line on stderr: what happened, what was expected, what to do. "
        "[What goes wrong](../deploy/FAULTS.md) lists failures of a run and what it does.\n\n"
        "| exit code | name | meaning |\n| --- | --- | --- |\n"
    )
    page += "".join(f"| {code} | {words(name)} | {cell(meaning)} |\n" for name, code, meaning in codes)
    page += "| 130 |  | interrupted twice |\n\n## Kinds of errors\n\n| kind | meaning |\n| --- | --- |\n"
    return page + "".join(f"| {words(name)} | {cell(meaning)} |\n" for name, meaning in kinds)


def first_sentence(path: pathlib.Path) -> str:
    """Of a header's first comment, or of a Python file's docstring."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        found = re.match(r'(?:#![^\n]*\n)?"""(.*?)"""', text, re.DOTALL)
        paragraph = found[1].split("\n\n")[0] if found else ""
    else:
        paragraph = re.match(r"(?://.*\n)*", text)[0]
        paragraph = re.split(r"\n//\s*\n", paragraph)[0]
        paragraph = "\n".join(line.removeprefix("//").strip() for line in paragraph.splitlines())
    return re.split(r"(?<=[.!?])\s+(?=[A-Z\"`'])", " ".join(paragraph.split()), maxsplit=1)[0].rstrip(":")


def files(home: pathlib.Path, part: str) -> tuple[str, list[str]]:
    """A page of the files of one part of the tree, folder by folder, and the files that do not say what they are for."""
    page = f"# Files of {part}\n\nThe first sentence of each header and Python file. [What the folder is for](../../{part}/README.md).\n"
    silent = []
    for folder, folders, names in os.walk(home / part):
        folders[:] = sorted(set(folders) - {"__pycache__"})
        if MADE_BY_TOOLS & set(names):
            folders[:] = []
            continue
        below = pathlib.Path(folder).relative_to(home)
        rows = ""
        for name in sorted(names):
            if not name.endswith((".h", ".py")) or name == "__init__.py":
                continue
            sentence = first_sentence(pathlib.Path(folder, name))
            rows += f"| `{name}` | {cell(sentence)} |\n"
            if not sentence:
                silent.append((below / name).as_posix())
        anchor = folder_page(below).partition("#")[2]
        if rows:
            page += f"\n## {below.as_posix()} {{ #{anchor} }}\n\n| file | what it is for |\n| --- | --- |\n{rows}"
        else:
            page += f'\n<a id="{anchor}"></a>\n'
    return page, silent


def generated_parts(home: pathlib.Path, comrad: str) -> Iterator[tuple[pathlib.Path, str, str]]:
    """The parts of pages in the repository that the program writes: the page, the text as it is, and as it should be."""
    parts = [(home / "learner/METRICS.md", "comrad help metrics", lambda: output_of(comrad, "help", "metrics", "--markdown"))]
    for recipe in sorted(home.glob("scenarios/*/layout.cc")):
        name = recipe.parent.name
        parts.append((recipe.parent / "README.md", "comrad scenarios describe", functools.partial(scenario_pages.generated, comrad, home, name)))
    for page, mark, write in parts:
        text = page.read_text(encoding="utf-8")
        before, begin, rest = text.partition(f"<!-- {mark}: begin -->\n")
        _, end, after = rest.partition(f"<!-- {mark}: end -->\n")
        if not begin or not end:
            raise SystemExit(f"comrad docs: error: {page}: expected lines <!-- {mark}: begin --> and <!-- {mark}: end -->")
        yield page, text, before + begin + write() + end + after


def write_all(stage, comrad: str) -> None:
    """Writes the generated pages. Errors: SystemExit where a header lacks its first comment."""
    stage.write(pathlib.Path("reference/commands.md"), commands(comrad))
    stage.write(pathlib.Path("reference/settings.md"), settings(comrad))
    stage.write(pathlib.Path("reference/errors.md"), errors(stage.home))
    silent = []
    for part in PARTS:
        page, without = files(stage.home, part)
        silent += without if part != "tests" else []
        stage.write(pathlib.Path(f"reference/files/{part}.md"), page)
    if silent:
        raise SystemExit(f"comrad docs: error: a first comment on the purpose of the file is missing in {', '.join(silent)}")
