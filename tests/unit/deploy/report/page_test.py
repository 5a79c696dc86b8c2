#!/usr/bin/env python3
"""Opens a report in headless Chromium: no word in the console, no request, and every figure shows something.

    page_test.py

Needs chromium (deploy/packages_test.txt) and what draws the report (deploy/packages_report.txt); skipped with code 77 where one
is missing.
"""

import contextlib
import html
import io
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[3] / "deploy" / "report")]
SKIPPED = 77
CHROMIUM_FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--virtual-time-budget=20000",
]
WIDTH, HEIGHT = 1100, 12000  # of the window and of its picture, which hold the whole page
# The page's own check: put before </body> of a copy, because the page has no script.
# Its greeting shows that what a page writes to the console would be seen.
PROBE = """<script>console.error("heard"); addEventListener("load", () => { document.body.dataset.probe = JSON.stringify({
  figures: [...document.querySelectorAll("figure")].map(one => { const image = one.querySelector("img"), box = image.getBoundingClientRect();
    return {caption: one.querySelector("figcaption").textContent, loaded: image.complete && image.naturalWidth > 0,
            box: [box.left, box.top + scrollY, box.width, box.height].map(Math.round)}; }),
  height: document.documentElement.scrollHeight, tables: document.querySelectorAll("table").length,
  dead: [...document.querySelectorAll("a[href^='#']")].filter(one => !document.querySelector(one.getAttribute("href"))).length,
  requests: performance.getEntriesByType("resource").filter(one => !one.name.startsWith("data:")).map(one => one.name)}); });</script>"""


def chromium(folder: pathlib.Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        ["chromium", *CHROMIUM_FLAGS, f"--user-data-dir={folder / 'profile'}", *words],
        capture_output=True,
        text=True,
        timeout=300,
    )


def main() -> int:
    if shutil.which("chromium") is None:
        print(
            "[  SKIPPED ] 1 test, the report in a browser: no chromium; ./comrad test installs it (deploy/packages_test.txt)"
        )
        return SKIPPED
    try:
        import matplotlib.image
        import numpy as np
        import scipy  # noqa: F401 (only asked whether it is there)

        import report
    except ImportError as missing:
        print(
            f"[  SKIPPED ] 1 test, the report in a browser: {missing}; install the packages of deploy/packages_report.txt"
        )
        return SKIPPED
    import made_runs

    failed = []

    def check(claim: str, holds: bool) -> None:
        print(f"{'ok  ' if holds else 'FAIL'} {claim}")
        if not holds:
            failed.append(claim)

    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        made_runs.write_study(folder / "runs", scenarios=made_runs.TWO_SCENARIOS)
        made_runs.write_run(
            folder / "runs", "lava_pit", "vdn", 97, start=0, end=3, frames=2e5, state="failed", message="no space"
        )
        with contextlib.redirect_stdout(io.StringIO()):
            ended = report.main([str(folder / "runs"), "--output", str(folder)])
        check("the report is written", ended == 0)
        page = folder / "report.html"
        probed = folder / "probed.html"
        probed.write_text(page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"), encoding="utf-8")

        picture = folder / "page.png"
        asked = chromium(
            folder, f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={picture}", "--dump-dom", probed.as_uri()
        )
        check("the browser opens the page", asked.returncode == 0 and "<h1>" in asked.stdout)
        check("nothing but the probe's greeting is in the console", asked.stderr.count("CONSOLE") == 1)
        found = re.search(r'data-probe="([^"]*)"', asked.stdout)
        if not found:
            sys.exit(f"the probe did not run:\n{asked.stderr[-2000:]}")
        facts = json.loads(html.unescape(found.group(1)))
        check("nothing is fetched", facts["requests"] == [])
        check("every link of the page leads somewhere", facts["dead"] == 0)
        check("there are tables", facts["tables"] >= 8)
        wanted = (
            "J over env frames",
            "interquartile mean",
            "gap between",
            "every run is a point",
            "learning diagnostics",
            "occupancy",
        )
        for words in wanted:
            check(f"there is a figure: {words}", any(words in one["caption"] for one in facts["figures"]))

        check("the picture holds the whole page", facts["height"] <= HEIGHT)
        pixels = matplotlib.image.imread(picture)[:, :, :3]
        for one in facts["figures"]:
            left, top, width, height = one["box"]
            cut = pixels[top : top + height, left : left + width].reshape(-1, 3)
            colours = len(np.unique((cut * 15).round().astype(int) @ (256, 16, 1)))
            inked = float((cut.min(axis=1) < 0.85).mean())
            check(
                f"{one['caption'][:60]}: {width}x{height}, {colours} colours, {inked:.1%} inked",
                one["loaded"] and width > 300 and height > 80 and colours >= 6 and inked > 0.004,
            )
    print(f"{len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
