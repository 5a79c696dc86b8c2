"""Lays out the repository's pages for MkDocs: same paths, links that a browser can follow, Markdown that Python reads alike."""

import os
import pathlib
import re
import shutil

from page_commands import need_of

SKIPPED_FOLDERS = {".git", ".github", "build", "train_dir"}
MADE_BY_TOOLS = {"CMakeCache.txt", "pyvenv.cfg"}  # in build folders and Python environments, whatever their names
PICTURES = {".png", ".gif", ".svg", ".jpg"}
PARTS = ("rollout_buffer", "doomgen", "scenarios", "sim_workers", "policy_workers", "learner", "deploy", "tests")
LINK = re.compile(r"(\[(?:[^\]\[]|\[[^\]]*\])*\]\()([^)\s]+)(\))")
PICTURE = re.compile(r"(<img [^>]*src=\")([^\"]+)(\")")
LIST_ITEM = re.compile(r"( *)([*-]|\d+\.) +\S")


def pages_of(home: pathlib.Path) -> list[pathlib.Path]:
    """The Markdown files of the repository, as paths below `home`."""
    found = []
    for folder, folders, names in os.walk(home):
        if MADE_BY_TOOLS & set(names):
            folders[:] = []
            continue
        folders[:] = sorted(name for name in folders if name not in SKIPPED_FOLDERS)
        found += [pathlib.Path(folder, name).relative_to(home) for name in sorted(names) if name.endswith(".md")]
    return found


def folder_page(folder: pathlib.Path) -> str:
    """Where the generated file tables show `folder`: a page for each part of the tree, a heading for each folder."""
    return f"reference/files/{folder.parts[0]}.md#{folder.as_posix().replace('/', '-')}"


def with_need(below: list[str]) -> str:
    """The first line of a fenced block that names what its commands need; `below` begins with its second."""
    block = below[: next((at for at, line in enumerate(below) if line.startswith("```")), len(below))]
    need = need_of(block)
    return f'```text title="Not run by a test: needs {need}"' if need else "```text"


class Stage:
    """Copies pages, and what they link to, from `home` to `to`. Text files get the suffix .txt, so that browsers show them."""

    def __init__(self, home: pathlib.Path, to: pathlib.Path):
        self.home, self.to = home, to

    def page(self, page: pathlib.Path, text: str | None = None) -> None:
        """Writes one page below `to`; `text` is what it has instead of the file's."""
        lines, fenced = [], False
        before = ""  # the line before, outside of fenced code
        source = ((self.home / page).read_text(encoding="utf-8") if text is None else text).splitlines()
        for number, line in enumerate(source):
            if line.lstrip().startswith("```"):
                fenced = not fenced
                if fenced and line == "```":
                    line = with_need(source[number + 1 :])
                lines.append(line)
                before = line
                continue
            if not fenced:
                item, item_before = LIST_ITEM.match(line), LIST_ITEM.match(before)
                # Python-Markdown begins a list or a table after an empty line only, and nests by four spaces.
                starts_list = item and not item[1] and before.strip() and not item_before and not before.startswith(" ")
                starts_table = line.startswith("|") and before.strip() and not before.startswith("|")
                if starts_list or starts_table:
                    lines.append("")
                if item and item[1]:
                    line = " " * len(item[1]) + line
                before = line
                line = self.with_links(page, line)
            lines.append(line)
        self.write(page, "\n".join(lines) + "\n")

    def write(self, page: pathlib.Path, text: str) -> None:
        path = self.to / page
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def with_links(self, page: pathlib.Path, line: str) -> str:
        """The line with each link outside of `code` made one of the site's."""
        parts = re.split(r"(`[^`]*`)(?!\])", line)
        for index in range(0, len(parts), 1):
            if parts[index].startswith("`") and not parts[index].endswith("](") and "](" not in parts[index]:
                continue
            parts[index] = LINK.sub(lambda match: self.link(page, match), parts[index])
            parts[index] = PICTURE.sub(lambda match: match[1] + self.target(page, match[2]) + match[3], parts[index])
        return "".join(parts)

    def link(self, page: pathlib.Path, match: re.Match) -> str:
        """A link of the site; one that shows a page's file name shows its title instead."""
        text, link = match[1], match[2]
        source = self.home / page.parent / link.partition("#")[0]
        if re.fullmatch(r"\[(?:[\w./]+/)?[A-Z_]+\.md\]\(", text) and source.is_file():
            title = re.search(r"^# (.*)", source.read_text(encoding="utf-8"), re.MULTILINE)
            text = f"[{title[1]}](" if title else text
        return text + self.target(page, link) + match[3]

    def target(self, page: pathlib.Path, link: str) -> str:
        """A link as the site has it; what it leads to is copied. One that leads nowhere stays, for MkDocs to report."""
        if re.match(r"[a-z]+:|#", link):
            return link
        path, _, anchor = link.partition("#")
        source = pathlib.Path(os.path.normpath(self.home / page.parent / path))
        if not source.exists() or not source.is_relative_to(self.home) or source.suffix == ".md":
            return link
        below = source.relative_to(self.home)
        up = pathlib.Path(os.path.relpath(self.to, (self.to / page).parent)).as_posix()
        if source.is_dir():
            readme = below / "README.md"
            return f"{up}/{readme.as_posix() if (self.home / readme).exists() else folder_page(below)}"
        copied = below if source.suffix in PICTURES | {".html"} else below.with_name(below.name + ".txt")
        (self.to / copied).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, self.to / copied)
        return f"{up}/{copied.as_posix()}" + (f"#{anchor}" if anchor else "")
