#!/usr/bin/env python3
"""Builds the site from the pages in the folders, or serves it on this host.

    docs.py --comrad PROGRAM --build DIR | --serve [ADDRESS:PORT]

Pages keep their paths (stage.py), the program writes the reference (reference.py), MkDocs makes HTML (mkdocs.yml). A link that
leads nowhere, a missing picture or a page that the navigation lacks ends the build. Nothing in the result is loaded from a network.
"""

import argparse
import functools
import http.server
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

import reference
import scenario_pages
from stage import PICTURES, Stage, pages_of

HERE = pathlib.Path(__file__).resolve().parent
HOME = HERE.parents[1]
FAILED, BAD_INPUT = 1, 2


def add_games(stage: Stage, comrad: str) -> None:
    """Puts pictures and GIFs on the pages of the games. They lie in the build folder and are drawn when they are old."""
    drawn = pathlib.Path(os.environ.get("COMRAD_GAME_PICTURES") or pathlib.Path(comrad).resolve().parents[1] / "games")
    for name, shown in scenario_pages.all_media(comrad, HOME, scenario_pages.names_of(HOME), drawn).items():
        page = pathlib.Path("scenarios", name, "README.md")
        stage.page(page, scenario_pages.with_media((HOME / page).read_text(encoding="utf-8"), shown))
        for picture in (drawn / name).iterdir():
            if picture.suffix in PICTURES:
                shutil.copyfile(picture, stage.to / page.parent / picture.name)


def build(comrad: str, to: pathlib.Path) -> int:
    """Writes the site into the folder `to`, which is emptied first. Returns the exit code."""
    with tempfile.TemporaryDirectory(prefix="comrad_docs_") as folder:
        stage = Stage(HOME, pathlib.Path(folder, "docs"))
        for page in pages_of(HOME):
            stage.page(page)
        add_games(stage, comrad)
        reference.write_all(stage, comrad)
        shutil.copyfile(HERE / "mkdocs.yml", pathlib.Path(folder, "mkdocs.yml"))
        shutil.copyfile(HERE / "site.css", stage.to / "site.css")
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", f"{folder}/mkdocs.yml", "-d", str(to)]
        environment = {"NO_MKDOCS_2_WARNING": "1", "DISABLE_MKDOCS_2_WARNING": "true", **os.environ}
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        if done.returncode:
            print("\n".join(line for line in done.stdout.splitlines() if not line.startswith("INFO")), file=sys.stderr)
        return FAILED if done.returncode else 0


def serve(folder: str, address: str) -> int:
    """Serves a folder until Ctrl-C."""
    host, _, port = address.rpartition(":")
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=folder)
    handler.log_message = lambda *_: None
    try:
        server = http.server.ThreadingHTTPServer((host, int(port)), handler)
    except (OSError, ValueError, OverflowError) as error:
        print(f"comrad docs: error: cannot serve at {address}: {error}; write ADDRESS:PORT", file=sys.stderr)
        return BAD_INPUT
    print(f"http://{server.server_address[0]}:{server.server_address[1]}  (Ctrl-C stops)", flush=True)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        return 0


def update(comrad: str) -> int:
    """Writes the generated parts of pages in the checkout."""
    for page, text, wanted in reference.generated_parts(HOME, comrad):
        if text != wanted:
            page.write_text(wanted, encoding="utf-8")
            print(page.relative_to(HOME))
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--comrad", required=True)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--build", type=pathlib.Path)
    what.add_argument("--serve", metavar="ADDRESS:PORT")
    what.add_argument("--update", action="store_true")
    arguments = parser.parse_args()
    if arguments.update:
        return update(arguments.comrad)
    if arguments.build:
        return build(arguments.comrad, arguments.build.resolve())
    with tempfile.TemporaryDirectory(prefix="comrad_site_") as folder:
        return build(arguments.comrad, pathlib.Path(folder)) or serve(folder, arguments.serve)


if __name__ == "__main__":
    sys.exit(main())
