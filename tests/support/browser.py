"""Headless Chromium for tests, spoken to through its DevTools pipe: NUL-separated JSON on the descriptors 3 and 4."""

import base64
import fcntl
import json
import os
import pathlib
import select
import subprocess
import time

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--remote-debugging-pipe",
]
PATIENCE_S = 240  # for a condition, beside any load


def wait_for(condition, what: str):
    """The first true value of `condition`."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.1)
    raise AssertionError(f"not within {PATIENCE_S} s: {what}")


class Browser:
    def __init__(self, folder: pathlib.Path):
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        theirs_in, theirs_out = (fcntl.fcntl(one, fcntl.F_DUPFD, 10) for one in (theirs_in, theirs_out))

        def connect() -> None:
            os.dup2(theirs_in, 3)
            os.dup2(theirs_out, 4)

        self.process = subprocess.Popen(
            ["chromium", *FLAGS, f"--user-data-dir={folder}"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(3, 4),
            preexec_fn=connect,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self.read_end, self.write_end = ours_in, ours_out
        self.received, self.last_id, self.heard = b"", 0, []

    def call(self, method: str, session: str | None = None, **parameters) -> dict:
        self.last_id += 1
        words = {"id": self.last_id, "method": method, "params": parameters}
        if session:
            words["sessionId"] = session
        os.write(self.write_end, json.dumps(words).encode() + b"\0")
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            while b"\0" in self.received:
                message, self.received = self.received.split(b"\0", 1)
                answer = json.loads(message)
                if answer.get("id") == self.last_id:
                    if "error" in answer:
                        raise AssertionError(f"{method}: {answer['error']}")
                    return answer["result"]
                self.heard.append(answer)
            if select.select([self.read_end], [], [], 0.5)[0]:
                more = os.read(self.read_end, 1 << 20)
                if not more:
                    raise AssertionError("the browser has ended")
                self.received += more
        raise AssertionError(f"no answer to {method}")

    def open(self, address: str, width: int = 1280, height: int = 900) -> "Page":
        context = self.call("Target.createBrowserContext")["browserContextId"]
        target = self.call(
            "Target.createTarget", url="about:blank", width=width, height=height, browserContextId=context
        )["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, session, target)
        for domain in ("Page", "Runtime", "Log"):
            page.call(f"{domain}.enable")
        page.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
        )
        page.call("Page.navigate", url=address)
        return page

    def close(self) -> None:
        try:
            self.call("Browser.close")
        except (AssertionError, OSError):
            self.process.kill()
        self.process.wait(60)
        os.close(self.read_end)
        os.close(self.write_end)


class Page:
    def __init__(self, browser: Browser, session: str, target: str):
        self.browser, self.session, self.target = browser, session, target

    def call(self, method: str, **parameters) -> dict:
        return self.browser.call(method, self.session, **parameters)

    def run(self, expression: str):
        """The value of a JavaScript expression."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise AssertionError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def data(self, name: str) -> str:
        return self.run(f"document.body ? document.body.dataset.{name} || '' : ''")

    def number(self, name: str) -> float:
        return float(self.data(name) or 0)

    def key(self, code: str, key: str, kind: str) -> None:
        """`kind`: down or up."""
        if kind == "down":
            self.call("Input.dispatchKeyEvent", type="rawKeyDown", code=code, key=key)
        else:
            self.call("Input.dispatchKeyEvent", type="keyUp", code=code, key=key)

    def tap(self, code: str, key: str) -> None:
        self.key(code, key, "down")
        self.key(code, key, "up")

    def complaints(self) -> list[str]:
        """What the page's scripts threw or wrote to the console as errors."""
        found = []
        for message in self.browser.heard:
            if message.get("sessionId") != self.session:
                continue
            if message["method"] == "Runtime.exceptionThrown":
                found.append(json.dumps(message["params"]["exceptionDetails"])[:500])
            if message["method"] == "Log.entryAdded" and message["params"]["entry"]["level"] == "error":
                found.append(message["params"]["entry"]["text"])
        return found

    def picture(self, path: pathlib.Path, quality: int = 80) -> None:
        """A .png or .jpg."""
        form = {"format": "png"} if path.suffix == ".png" else {"format": "jpeg", "quality": quality}
        data = self.call("Page.captureScreenshot", **form)["data"]
        path.write_bytes(base64.b64decode(data))

    def close(self) -> None:
        self.browser.call("Target.closeTarget", targetId=self.target)
