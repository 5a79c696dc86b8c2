#!/usr/bin/env python3
"""Watches and plays as a person does: headless Chromium opens the pages of `comrad watch` and `comrad play`, sees pictures change,
presses keys, plays Lava Pit to its end with the scripted team and with a second browser, and hostile clients change nothing.

    live_page_test.py BIN_DIR [--pictures DIR]

Needs chromium (deploy/packages_test.txt); ends with code 77 where it is missing.
"""

import argparse
import contextlib
import http.client
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from browser import PATIENCE_S, Browser, Page, wait_for

SKIPPED = 77
MOVED = """(() => { const view = document.querySelector(".view"); const bytes = view.getContext("2d").getImageData(0, 0, view.width, view.height).data;
  let sum = 0; for (let i = 0; i < bytes.length; i += 97) sum = (sum * 31 + bytes[i]) % 1000000007; return sum; })()"""

failed: list[str] = []


def check(claim: str, holds) -> None:
    print(f"{'ok  ' if holds else 'FAIL'} {claim}", flush=True)
    if not holds:
        failed.append(claim)


def below(pid: int) -> list[int]:
    """Processes that descend from `pid`."""
    children: dict[int, list[int]] = {}
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError):
                children.setdefault(int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1]), []).append(
                    int(entry.name)
                )
    found, new = [], [pid]
    while new:
        new = [child for parent in new for child in children.get(parent, [])]
        found += new
    return found


class Program:
    """comrad watch or comrad play."""

    started: list["Program"] = []

    def __init__(self, comrad: str, words: list[str], scratch: pathlib.Path):
        self.temporary = pathlib.Path(tempfile.mkdtemp(dir=scratch))
        self.errors = open(self.temporary.with_suffix(".err"), "w+", encoding="utf-8")
        self.process = subprocess.Popen(
            [comrad, *words, "--no_browser"],
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            env={**os.environ, "TMPDIR": str(self.temporary)},
        )

        Program.started.append(self)

    def addresses(self, count: int = 1) -> list[str]:
        lines = [self.process.stdout.readline().strip() for _ in range(count)]
        return [line.rsplit(" ", 1)[-1] for line in lines]

    def said(self) -> str:
        self.errors.seek(0)
        return self.errors.read()

    def end(self, name: str) -> None:
        processes = below(self.process.pid)
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(PATIENCE_S)
        check(f"{name} ends with 0 after Ctrl-C", code == 0)
        wait_for(
            lambda: not any(pathlib.Path(f"/proc/{pid}").exists() for pid in processes), "its processes end, too"
        )
        check(f"{name} leaves no file behind", list(self.temporary.iterdir()) == [])
        self.process.stdout.close()


def answer(address: str, path: str = "/", method: str = "GET", **headers: str) -> int:
    at = urllib.parse.urlsplit(address)
    connection = http.client.HTTPConnection(at.hostname, at.port, timeout=PATIENCE_S)
    connection.request(method, path, headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def deaf_client(address: str) -> socket.socket:
    """A WebSocket that never reads."""
    at = urllib.parse.urlsplit(address)
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.connect((at.hostname, at.port))
    client.sendall(
        f"GET /live?{at.query} HTTP/1.1\r\nHost: {at.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    return client


def hostile(address: str, page: Page) -> None:
    """Nothing of this reaches the game."""
    at = urllib.parse.urlsplit(address)
    good = f"/?{at.query}"
    check("without the token nothing is served", answer(address, "/") == 403 and answer(address, "/live") == 403)
    check("a wrong token is refused", answer(address, "/?token=" + "0" * 32) == 403)
    check("a foreign origin is refused", answer(address, good, Origin="http://evil.example") == 403)
    check("a foreign host name is refused", answer(address, good, Host="evil.example") == 403)
    check("other paths are none", answer(address, f"/other?{at.query}") == 404)
    check("other methods are refused", answer(address, good, method="POST") == 405)
    for broken in (b"\x16\x03\x01\x02", b"GET / HTTP/9\r\n\r\n", b"GET /" + b"a" * 20000, b"\r\n\r\n"):
        with socket.create_connection((at.hostname, at.port)) as client, contextlib.suppress(OSError):
            client.sendall(broken)
            client.settimeout(PATIENCE_S)
            while client.recv(4096):
                pass
    deaf = deaf_client(address)
    wait_for(lambda: server_holds(at.port, deaf), "the WebSocket is open")
    seen = page.number("pictures")
    wait_for(lambda: not server_holds(at.port, deaf), "a client that does not read is left")
    check("a client that does not read holds nothing up", page.number("pictures") > seen + 100)
    deaf.close()


def server_holds(port: int, client: socket.socket) -> bool:
    """Whether the server's end of the connection is open (state 01): the client, which does not read, would not see it end."""
    ends = (f":{port:04X}", f":{client.getsockname()[1]:04X}")
    rows = [line.split() for line in pathlib.Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return any(row[1].endswith(ends[0]) and row[2].endswith(ends[1]) and row[3] == "01" for row in rows)


def photograph(page: Page, path: pathlib.Path) -> None:
    page.picture(path.with_suffix(".jpg"))
    page.picture(path.with_suffix(".png"))


def leave(page: Page, pace: str) -> None:
    """Clicks Run or Pause where the page shows `pace`, and begins an episode that waits: the one before may have ended by itself."""
    if page.data("pace") == "waiting":
        page.tap("Enter", "Enter")
    elif page.data("pace") == pace:
        page.run("document.getElementById('hold').click()")


def play_to_the_end(page: Page) -> float:
    """Runs and walks on until the episode is over; its score."""
    ended = page.number("ended")
    page.key("KeyW", "w", "down")

    def ends() -> bool:
        leave(page, "paused")
        return page.number("ended") > ended

    wait_for(ends, "the episode ends")
    page.key("KeyW", "w", "up")
    return page.number("last")


def test_play(comrad: str, browser: Browser, scratch: pathlib.Path, pictures: pathlib.Path | None) -> pathlib.Path:
    saved = scratch / "saved"
    program = Program(comrad, ["play", "lava_pit", "--save", str(saved), "--size", "640x360"], scratch)
    (address,) = program.addresses()
    check("the address is this machine's, with a token", re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[0-9a-f]{32}", address))
    page = browser.open(address)
    wait_for(lambda: page.data("pace") == "waiting" and page.number("pictures") > 0, "the game waits for its player")
    check("the page shows the goal", "bridge" in page.run("document.getElementById('goal').textContent"))
    check("the page shows the keys", "move forward" in page.run("document.getElementById('keys').textContent"))
    check("a player sees no map and no partner's thoughts", page.run("!game.lines && !now.agents[1].choice && !now.agents[0].at"))
    still = page.number("tic")
    page.tap("Enter", "Enter")
    wait_for(lambda: page.data("pace") == "running" and page.number("tic") > still + 8, "tics pass after Enter")
    first, seen = page.run(MOVED), page.number("pictures")
    page.key("KeyE", "e", "down")
    wait_for(lambda: json.loads(page.data("choice"))[0] == 2, "the agent turns right while E is down")
    wait_for(lambda: page.number("pictures") > seen + 5 and page.run(MOVED) != first, "the view turns with it")
    if pictures:
        photograph(page, pictures / "play")
    page.key("KeyE", "e", "up")
    wait_for(lambda: json.loads(page.data("choice"))[0] == 0, "it stops turning when E is up")
    # Step by step.
    def pauses() -> bool:
        leave(page, "running")
        return page.data("pace") == "paused"

    wait_for(pauses, "it pauses")
    tic, began = page.number("tic"), page.number("began")
    page.tap("Enter", "Enter")
    wait_for(
        lambda: page.number("tic") == tic + 4 or page.number("began") > began, "Enter plays one decision, or the episode's rest"
    )
    score = play_to_the_end(page)
    check(f"an episode with the scripted partner is played to its end, J = {score}", score >= 0)
    wait_for(lambda: not page.run("document.getElementById('overlay').hidden"), "the score is shown")
    check("the score is said", "Score J" in page.run("document.getElementById('overlay').textContent"))
    check(f"the page complains of nothing: {page.complaints()[:1]}", page.complaints() == [])
    files = wait_for(lambda: sorted(saved.glob("*.comrad")), "the episode is kept")
    head = json.loads(files[0].read_bytes().partition(b"\n")[0])
    check("it is kept with its score", abs(head["score"] - score) < 1e-6 and head["policy"] == "0=person,1=oracle")
    page.close()
    program.end("comrad play")
    return saved


def test_two_people(comrad: str, browser: Browser, scratch: pathlib.Path) -> None:
    program = Program(comrad, ["play", "lava_pit", "--people", "2", "--size", "320x180"], scratch)
    addresses = program.addresses(2)
    check("each seat has a separate address", len(set(addresses)) == 2)
    pages = [browser.open(address) for address in addresses]
    for page in pages:
        wait_for(lambda page=page: page.data("pace") == "waiting" and page.number("pictures") > 0, "both wait")
    check("each page plays its own agent", [page.run("mine") for page in pages] == [0, 1])
    pages[1].tap("Enter", "Enter")
    wait_for(lambda: all(page.data("pace") == "running" for page in pages), "one begins for both")
    for page, other, code in ((pages[0], pages[1], "KeyA"), (pages[1], pages[0], "KeyD")):
        page.key(code, code[-1].lower(), "down")
        wait_for(lambda page=page: json.loads(page.data("choice"))[2] != 0, "its own agent moves")
        check("the other one's agent does not", json.loads(other.data("choice"))[2] == 0)
        page.key(code, code[-1].lower(), "up")
        wait_for(lambda page=page: json.loads(page.data("choice"))[2] == 0, "it stops")
    hostile(addresses[0], pages[0])
    for page in pages:
        check(f"no complaints: {page.complaints()[:1]}", page.complaints() == [])
        page.close()
    program.end("comrad play --people 2")


def test_watch(comrad: str, browser: Browser, scratch: pathlib.Path, pictures: pathlib.Path | None) -> None:
    program = Program(
        comrad, ["watch", "--scenario", "stag_hunt_arena", "--policy", "oracle,random", "--size", "320x180"], scratch
    )
    (address,) = program.addresses()
    page = browser.open(address)
    wait_for(lambda: page.number("pictures") > 10 and page.number("tic") > 20, "pictures come")
    check("there is a view for each agent", page.run("document.querySelectorAll('.view').length == game.agents"))
    check("there is a map", page.run("game.lines.length >= 4 && !document.getElementById('mapbox').hidden"))
    first = page.run(MOVED)
    wait_for(lambda: page.run(MOVED) != first, "the picture changes")
    page.tap("Space", " ")
    wait_for(lambda: page.data("pace") == "paused", "Space pauses")
    tic = page.number("tic")
    page.tap("Period", ".")
    wait_for(lambda: page.number("tic") == tic + 4, "a point plays one decision")
    page.tap("Space", " ")
    wait_for(lambda: page.number("tic") > tic + 20, "Space resumes")
    page.run("document.getElementById('faster').click()")
    wait_for(lambda: page.run("now.speed") == 2, "faster")
    def draw_with(renderer: str) -> None:
        page.run(f"$('renderer').value = '{renderer}'; $('renderer').onchange({{ target: $('renderer') }})")

    draw_with("osmesa")
    wait_for(lambda: page.run("now.renderer == 'osmesa'"), "another renderer draws")
    draw_with("egl")
    wait_for(lambda: page.run("now.renderer == 'egl' || (now.renderer == 'osmesa' && now.refused && $('error').textContent)"), "one that cannot be had is refused")
    draw_with("painter")
    wait_for(lambda: page.run("now.renderer == 'painter' && !now.refused"), "and the first draws again")
    if pictures:
        wait_for(lambda: page.number("tic") > 400, "there are tracks")
        photograph(page, pictures / "watch")
    page.run("document.getElementById('seed').value = '7'; document.getElementById('policy').value = 1; document.getElementById('again').click()")
    began = page.number("began")
    wait_for(lambda: page.number("began") > began and page.run("session.policy") == 1, "another player plays")
    check("with the seed that was typed", page.run("session.seed") == "7")
    hostile(address, page)
    for width in (400, 2500):
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        check(f"nothing overflows {width} pixels", page.run("document.documentElement.scrollWidth <= innerWidth"))
    check(f"the page complains of nothing: {page.complaints()[:1]}", page.complaints() == [])
    page.close()
    program.end("comrad watch")


def test_recorded(comrad: str, browser: Browser, scratch: pathlib.Path, saved: pathlib.Path) -> None:
    head = json.loads(sorted(saved.glob("*.comrad"))[0].read_bytes().partition(b"\n")[0])
    program = Program(comrad, ["watch", str(saved), "--size", "320x180"], scratch)
    (address,) = program.addresses()
    page = browser.open(address)
    wait_for(lambda: page.number("tic") > 0, "the recorded episode is played")
    for _ in range(4):
        page.run("document.getElementById('faster').click()")
    wait_for(lambda: page.number("ended") > 0, "it ends again")
    check("with the same score after as many decisions", page.number("last") == head["score"])
    page.close()
    program.end("comrad watch of recorded episodes")


def test_run(comrad: str, browser: Browser, scratch: pathlib.Path, pictures: pathlib.Path | None) -> None:
    runs = scratch / "runs"
    train = [
        comrad, "train", "--scenario", "lava_pit", "--algo", "ippo", "--train_dir", str(runs), "--experiment", "small",
        "--num_workers", "1", "--num_envs_per_worker", "4", "--rollout", "16", "--batch_size", "128", "--num_epochs", "1",
        "--rnn_size", "32", "--device", "cpu", "--experiment_summaries_interval", "1", "--save_every_sec", "5",
        "--train_for_env_frames", "1e9",
    ]  # fmt: skip
    training = subprocess.Popen(train, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: list(runs.glob("small/checkpoint/checkpoint_*.pt")), "the run has a checkpoint")
        program = Program(comrad, ["watch", str(runs / "small"), "--size", "320x180"], scratch)
        (address,) = program.addresses()
        page = browser.open(address)
        wait_for(lambda: page.number("tic") > 0 and page.data("run") == "small", "its newest checkpoint plays beside it")
        check("values and probabilities are shown", page.run("now.agents[0].logits.some(x => x) && now.agents[0].value != 0"))
        first = page.run("session.checkpoint")
        check("the checkpoint is named", first.startswith("checkpoint_"))
        wait_for(lambda: page.run("(run.curves.env_frames || []).length > 1 && run.status.workers.length"), "its curves and workers")
        for _ in range(4):
            page.run("document.getElementById('faster').click()")
        wait_for(lambda: page.run("session.checkpoint") not in (first, ""), "a newer checkpoint plays when there is one")
        wait_for(lambda: page.number("tic") > 0, "and it moves")
        if pictures:
            photograph(page, pictures / "watch_run")
        check(f"the page complains of nothing: {page.complaints()[:1]}", page.complaints() == [])
        page.close()
        program.end("comrad watch of a run")
    finally:
        training.send_signal(signal.SIGINT)
        training.wait(PATIENCE_S)
    status = json.loads((runs / "small/status.json").read_text())
    check("the run was not disturbed", status["decisions_account"]["lost_with_simulators"] == 0 and training.returncode == 0)


def test_refusals(comrad: str, scratch: pathlib.Path) -> None:
    taken = socket.create_server(("127.0.0.1", 0))
    port = str(taken.getsockname()[1])
    (scratch / "junk").mkdir()
    (scratch / "junk" / "x.comrad").write_text("{}\n")
    for words, said in (
        (["watch", "no_such_run"], "no_such_run"),
        (["watch"], "name what to watch"),
        (["play", "lava_pitt"], "lava_pit"),
        (["play", "lava_pit", "--port", port], "is taken by another process"),
        (["play", "lava_pit", "--interface", "0.0.0.0"], "--token"),
        (["play", "lava_pit", "--interface", "192.0.2.1", "--token", "x" * 16], "no address of this machine"),
        (["play", "lava_pit", "--token", "short"], "16 to 128"),
        (["play", "lava_pit", "--size", "9x9"], "--size=9x9"),
        (["play", "lava_pit", "--people", "3"], "2"),
        (["watch", str(scratch / "junk")], "no episode"),
        (["eval", "--policy", "person", "--scenario", "lava_pit"], "comrad play"),
    ):
        done = subprocess.run([comrad, *words], capture_output=True, text=True, timeout=PATIENCE_S)
        lines = [line for line in done.stderr.splitlines() if "error" in line]
        check(f"{' '.join(words[:3])} is refused in a line: {lines}", done.returncode != 0 and len(lines) == 1 and said in lines[0])
    taken.close()


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("bin_dir")
    parser.add_argument("--pictures", type=pathlib.Path)
    parser.add_argument("--only", default="")
    asked = parser.parse_args()
    if shutil.which("chromium") is None:
        print("[  SKIPPED ] 1 test, live pages in a browser: no chromium; ./comrad test installs it (deploy/packages_test.txt)")
        return SKIPPED
    comrad = str(pathlib.Path(asked.bin_dir) / "comrad")
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        scratch = pathlib.Path(folder)
        browser = Browser(scratch / "profile")
        try:
            def wanted(name: str) -> bool:
                return not asked.only or name in asked.only.split(",")

            if wanted("refusals"):
                test_refusals(comrad, scratch)
            if wanted("play"):
                saved = test_play(comrad, browser, scratch, asked.pictures)
                test_recorded(comrad, browser, scratch, saved)
            if wanted("people"):
                test_two_people(comrad, browser, scratch)
            if wanted("watch"):
                test_watch(comrad, browser, scratch, asked.pictures)
            if wanted("run"):
                test_run(comrad, browser, scratch, asked.pictures)
        finally:
            browser.close()
            for program in Program.started:  # of a test that failed
                program.process.terminate()
                program.process.wait(PATIENCE_S)
    print(f"{len(failed)} failed, {time.monotonic() - began:.0f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
