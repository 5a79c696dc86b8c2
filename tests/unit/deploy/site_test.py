#!/usr/bin/env python3
"""The site builds with every link, heading and picture in its place, and nothing in it is loaded from a network.

    site_test.py COMRAD_PROGRAM PYTHON_WITH_MKDOCS

Skipped with code 77 where that Python lacks mkdocs-material (deploy/requirements_docs.txt).
"""

import html.parser
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import urllib.parse

HOME = pathlib.Path(__file__).resolve().parents[3]
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


def main() -> int:
    check_itself()
    comrad, python = sys.argv[1:]
    if subprocess.run([python, "-c", "import material, mkdocs"], stderr=subprocess.DEVNULL, check=False).returncode:
        print(f"{python} cannot import mkdocs-material: ./comrad test installs it (deploy/requirements_test.txt)")
        return SKIPPED
    environment = {**os.environ, "COMRAD_HOME": str(HOME), "COMRAD_DOCS_PYTHON": python}
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([comrad, "docs", "--build", f"{folder}/site"], env=environment, check=False)
        if done.returncode:
            print(f"comrad docs ended with {done.returncode}")
            return 1
        found = findings(pathlib.Path(folder, "site"))
        for one in found[:40]:
            print(one)
        for page in ("index.html", "reference/settings.html", "reference/commands.html", "reference/files/learner.html"):
            if not pathlib.Path(folder, "site", page).exists():
                found.append(page)
                print(f"there is no {page}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
