#!/usr/bin/env python3
"""The site builds with every link, heading and picture in its place, nothing in it is loaded from a network, and the commands on
pages are right: those that need nothing special are run, of the others flags and, for `comrad train`, values are checked.

    site_test.py COMRAD_PROGRAM PYTHON_WITH_MKDOCS

Skipped with code 77 where that Python lacks mkdocs-material (deploy/requirements_docs.txt).
"""

import html.parser
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
import urllib.parse
import urllib.request

HOME = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(HOME / "deploy" / "site"))
from page_commands import NEEDS, blocks_of, commands_in, is_complete, need_of  # noqa: E402
from reference import generated_parts  # noqa: E402
from scenario_pages import names_of  # noqa: E402
from stage import pages_of  # noqa: E402

TIMEOUT_S = 600
ONLY_TRAIN = {"--serve", "--insecure_network", "--allow_no_update"}  # flags of `comrad train` that `comrad config` has not
SKIPPED = 77
LOADED = {"script": "src", "img": "src", "link": "href", "source": "src", "iframe": "src"}  # what a browser fetches by itself


class Page(html.parser.HTMLParser):
    """The names that a page has, what it loads, and where its links lead."""

    def __init__(self, text: str):
        super().__init__()
        self.names, self.loads, self.links = set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.names |= {values[key] for key in ("id", "name") if values.get(key)}
        if values.get(LOADED.get(tag)):
            self.loads.append(values[LOADED[tag]])
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])


def findings(site: pathlib.Path) -> list[str]:
    """What is wrong with a built site, one line each."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    found = []
    for path, page in pages.items():
        if path.name == "404.html":  # served for any address: its links are those of the root
            continue
        shown = path.relative_to(site)
        found += [f"{shown} loads {one}" for one in page.loads if re.match(r"(https?:)?//", one)]
        for link in [one for one in page.loads + page.links if not re.match(r"[a-z]+:|//", one)]:
            where, _, anchor = link.partition("#")
            target = path if not where else pathlib.Path(os.path.normpath(path.parent / urllib.parse.unquote(where)))
            if target.is_dir():
                target /= "index.html"
            if not target.exists():
                found.append(f"{shown}: {link} leads nowhere")
            elif anchor and target in pages and urllib.parse.unquote(anchor) not in pages[target].names:
                found.append(f"{shown}: {link}: there is no such heading")
    for path in site.rglob("*.css"):
        found += [f"{path.relative_to(site)} loads {one}" for one in re.findall(r"(?:url\(|@import )['\"]?(https?:[^)'\"]*)", path.read_text(encoding="utf-8"))]
    return found


def check_itself() -> None:
    """Each fault above is found once in a site that has it."""
    with tempfile.TemporaryDirectory() as folder:
        site = pathlib.Path(folder)
        (site / "a.html").write_text(
            '<h1 id="one">1</h1><a href="#one"></a><a href="#two"></a><a href="gone.html"></a><a href="https://example.org"></a>'
            '<img src="no.png"><script src="https://example.org/x.js"></script>',
            encoding="utf-8",
        )
        (site / "a.css").write_text("@import 'https://example.org/x.css'", encoding="utf-8")
        found = findings(site)
        assert len(found) == 5, found


class PageCommands:
    """Checks the commands on pages with a built program, in a scratch folder that a page's commands share."""

    def __init__(self, comrad: str, folder: str):
        self.comrad, self.folder, self.help, self.run_count, self.checked_count = comrad, folder, {}, 0, 0

    def start(self, *words: str) -> subprocess.CompletedProcess:
        environment = {**os.environ, "COMRAD_HOME": str(HOME)}
        return subprocess.run(
            [self.comrad, *words], cwd=self.folder, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )

    def help_of(self, words: list[str]) -> str:
        """The help of a command, with that of its second word where it has separate flags."""
        name, second = words[0], words[1] if len(words) > 1 and re.fullmatch(r"[a-z]\w+", words[1]) else ""
        key = (name, second if name in ("bench", "doomgen", "sweep") else "")
        if key not in self.help:
            self.help[key] = self.start("help", name, *(["--all"] if name in ("train", "serve", "join", "config") else [])).stdout
            if self.help[key] and key[1]:
                self.help[key] += self.start(*key, "--help").stdout
        return self.help[key]

    def fault(self, words: list[str]) -> str | None:
        """What is wrong with one command, or None."""
        text = self.help_of(words)
        if not text:
            return f"there is no command {words[0]}"
        self.checked_count += 1
        if is_complete(words) and words[0] == "train":
            words = ["config", *[word for word in words[1:] if word not in ONLY_TRAIN]]
            if any(word.endswith((".toml", ".pt", ".cfg")) or word in ("--keys", "--layout_pool") for word in words):
                return None
        elif not is_complete(words) or words[0] in NEEDS or ("--nodes" in words and not shutil.which("zdbsp")):
            return None if words[0] == "test" else self.unknown_flag(words, text)  # ctest gets the words of test
        done = self.start(*words)
        self.run_count += 1
        return None if done.returncode == 0 else f"ended with {done.returncode}: {done.stderr.strip()}"

    def unknown_flag(self, words: list[str], text: str) -> str | None:
        """A flag that the help of the command does not have."""
        if words[0] in ("bench", "eval", "sweep"):
            text += self.help_of(["config"])
        for word in words[1:]:
            flag = re.match(r"--\w+", word)
            if flag and not re.search(rf"{flag[0]}\b", text):
                return f"comrad {words[0]} has no flag {flag[0]}"
        return None


def wrong_commands(comrad: str) -> list[str]:
    """Faults of the commands in the fenced blocks of all pages."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        checker = PageCommands(comrad, folder)
        assert checker.fault(["trian", "--seed", "1"]) and checker.fault(["eval", "--sead", "1"]) and checker.fault(["train", "--algo", "ipo"])
        assert need_of(["./comrad eval --policy x"]) == NEEDS["eval"] and need_of(["./comrad config --seed 1"]) is None
        for page in pages_of(HOME):
            for line, block in blocks_of((HOME / page).read_text(encoding="utf-8")):
                for words in commands_in(block):
                    fault = checker.fault(words)
                    if fault:
                        found.append(f"{page}:{line}: comrad {' '.join(words)}: {fault}")
        assert checker.checked_count > 50 and checker.run_count > 10, (checker.checked_count, checker.run_count)
    return found


def serving_fails() -> str | None:
    """What is wrong with serving a folder: a request for a page, then Ctrl-C; and a wrong address."""
    with tempfile.TemporaryDirectory() as folder:
        pathlib.Path(folder, "index.html").write_text("<h1>Served</h1>", encoding="utf-8")
        program = [sys.executable, "-B", "-c", "import sys, docs; sys.exit(docs.serve(sys.argv[1], sys.argv[2]))", folder]
        start = {"cwd": HOME / "deploy" / "site", "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen([*program, "127.0.0.1:0"], **start) as server:
            address = server.stdout.readline().split()
            page = urllib.request.urlopen(address[0], timeout=60).read().decode() if address else ""
            server.send_signal(signal.SIGINT)
            if "Served" not in page or server.wait(60) != 0:
                return f"comrad docs --serve gave {page!r} and ended with {server.returncode}"
        wrong = subprocess.run([*program, "nowhere"], check=False, **start)
        return None if wrong.returncode == 2 and "ADDRESS:PORT" in wrong.stderr else f"a wrong address: {wrong.stderr}"


def unanswered(site: pathlib.Path) -> list[str]:
    """Rows of the questions of newcomers without a link, of which the first page and the menu lead to all."""
    page = (HOME / "deploy/site/questions.md").read_text(encoding="utf-8")
    rows = [row for row in page.splitlines() if row.startswith("| ") and "?" in row]
    found = [f"questions.md: {row}" for row in rows if "](" not in row]
    if len(rows) < 10:
        found.append(f"questions.md has {len(rows)} questions")
    if "deploy/site/questions.html" not in Page((site / "index.html").read_text(encoding="utf-8")).links:
        found.append("index.html does not lead to questions.html")
    return found


def place_pictures(folder: pathlib.Path) -> str:
    """Pictures of all games, so that a site needs no time to play them."""
    for name in names_of(HOME):
        (folder / name).mkdir(parents=True)
        for file in ("scripted.gif", "strip.png", "map.png"):
            shutil.copyfile(HOME / "scenarios/gallery" / f"{name}.png", folder / name / file)
    return str(folder)


def wrong_pages(comrad: str) -> list[str]:
    """Faults of `comrad scenarios --pages` for one game."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([comrad, "scenarios", "--pages", folder, "lava_pit"], check=False)
        page = pathlib.Path(folder, "lava_pit", "README.md")
        if done.returncode or not page.exists():
            return [f"comrad scenarios --pages ended with {done.returncode}"]
        text = page.read_text(encoding="utf-8")
        found = [f"the page loads {one}, which is not there" for one in re.findall(r"!\[[^\]]*\]\(([^)]*)\)", text) if not (page.parent / one).exists()]
        terms = tomllib.loads((HOME / "scenarios/lava_pit/scenario.toml").read_text(encoding="utf-8"))["rewards"]
        found += [f"the page lacks reward {one['name']}" for one in terms if f"| `{one['name']}` | {one['weight']:+g}" not in text]
        found += [f"the page has the link {one}" for one in re.findall(r"(?<!!)\[[^\]]*\]\((?!http)[^)]*\)", text)]
        gif = (page.parent / "scripted.gif").read_bytes()
        if not gif.startswith(b"GIF8") or not 10_000 < len(gif) <= 1_500_000:
            found.append(f"the scripted team's GIF has {len(gif)} bytes")
        wrong = subprocess.run([comrad, "scenarios", "--pages", folder, "lava_pitt"], capture_output=True, text=True, check=False)
        if wrong.returncode != 2 or wrong.stderr.count("\n") != 1 or "lava_pit" not in wrong.stderr:
            found.append(f"a game that is not there: {wrong.returncode} {wrong.stderr}")
    return found


def main() -> int:
    check_itself()
    comrad, python = map(os.path.abspath, sys.argv[1:])
    os.environ["COMRAD_HOME"] = str(HOME)
    old = [str(page.relative_to(HOME)) for page, text, wanted in generated_parts(HOME, comrad) if text != wanted]
    if old:
        print(f"{', '.join(old)}: the program writes other tables; run `comrad docs --update`")
        return 1
    wrong = wrong_commands(comrad) + wrong_pages(comrad)
    if wrong:
        print("\n".join(wrong))
        return 1
    fault = serving_fails()
    if fault:
        print(fault)
        return 1
    if subprocess.run([python, "-c", "import material, mkdocs"], stderr=subprocess.DEVNULL, check=False).returncode:
        print(f"{python} cannot import mkdocs-material: ./comrad test installs it (deploy/requirements_test.txt)")
        return SKIPPED
    environment = {**os.environ, "COMRAD_HOME": str(HOME), "COMRAD_DOCS_PYTHON": python}
    with tempfile.TemporaryDirectory() as folder:
        environment["COMRAD_GAME_PICTURES"] = place_pictures(pathlib.Path(folder, "games"))
        done = subprocess.run([comrad, "docs", "--build", f"{folder}/site"], env=environment, check=False)
        if done.returncode:
            print(f"comrad docs ended with {done.returncode}")
            return 1
        found = findings(pathlib.Path(folder, "site")) + unanswered(pathlib.Path(folder, "site"))
        for one in found[:40]:
            print(one)
        for page in ("index.html", "reference/settings.html", "reference/commands.html", "reference/files/learner.html"):
            if not pathlib.Path(folder, "site", page).exists():
                found.append(page)
                print(f"there is no {page}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
