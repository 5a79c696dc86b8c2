#!/usr/bin/env python3
"""What hosts are given reads well to the programs that know its language: units, images, manifests, scripts.

    lint_test.py [--venv FOLDER]

Every file is shown to its linter as it is, which must find nothing, and once more with one fault put into a copy, which must be
found. The linters come from deploy/packages_test.txt and, in the Python of the tests (COMRAD_TEST_PYTHON, else the one in --venv),
from deploy/requirements_test.txt. One that is missing is named, and the test ends with 77 where nothing else failed.
"""

import argparse
import collections.abc
import dataclasses
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HOME = pathlib.Path(__file__).resolve().parents[4]
SKIPPED = 77
TIMEOUT_S = 120
EXPOSURE_MAX = 20  # of 100, as `systemd-analyze security` counts


@dataclasses.dataclass
class Case:
    """A file below the root of the sources, the program that reads it, and a fault: `good` becomes `bad`.

    `command` makes the words from the program's path and a file; what only an installed file has right is put right first (`before`).
    Linters that end with 0 whatever they find are judged by what they print (`silent`).
    """

    path: str
    tool: str
    command: collections.abc.Callable[[str, str], list[str]]
    good: str
    bad: str
    silent: bool = False
    before: tuple[str, str] = ("", "")


def verify(tool: str, file: str) -> list[str]:
    return [tool, "verify", file]


def rate(tool: str, file: str) -> list[str]:
    return [tool, "security", "--offline=true", f"--threshold={EXPOSURE_MAX}", file]


def read(tool: str, file: str) -> list[str]:
    return [tool, file]


def shell(path: str, good: str, bad: str) -> Case:
    return Case(path, "shellcheck", lambda tool, file: [tool, "--severity=warning", "-x", "-P", str(HOME), file], good, bad)


UNIT = "deploy/systemd/comrad@.service"
INSTALLED = ("ExecStart=comrad ", "ExecStart=/bin/true ")
CASES = [
    Case(UNIT, "systemd-analyze", verify, "KillMode=mixed", "KillMode=mix", silent=True, before=INSTALLED),
    Case(UNIT, "systemd-analyze", verify, "TimeoutStopSec=60", "TimeoutStopSeconds=60", silent=True, before=INSTALLED),
    Case(UNIT, "systemd-analyze", rate, "CapabilityBoundingSet=\n", "", before=INSTALLED),
    Case("deploy/docker/Dockerfile", "hadolint", read, "FROM debian:${DEBIAN} AS build", "FROM debian AS build"),
    Case("deploy/docker/Dockerfile", "hadolint", read, "WORKDIR /src", "WORKDIR src"),
    Case(
        "deploy/docker/compose.yaml",
        "docker-compose",
        lambda tool, file: [tool, "-f", file, "config", "--quiet"],
        "stop_grace_period:",
        "stop_grace:",
    ),
    Case(
        "deploy/docker/hosts.yaml",
        "docker-compose",
        lambda tool, file: [tool, "-f", file, "config", "--quiet"],
        "depends_on:",
        "depend_on:",
    ),
    Case(
        "deploy/kubernetes/job.yaml",
        "kubernetes-validate",
        lambda tool, file: [tool, "--strict", file],
        "backoffLimit: 20",
        "backoffLimits: 20",
    ),
    Case(
        "deploy/kubernetes/hosts.yaml",
        "kubernetes-validate",
        lambda tool, file: [tool, "--strict", file],
        "secretName: comrad-player-keys",
        "secretNames: comrad-player-keys",
    ),
    shell("deploy/slurm/train.sbatch", 'words=("$@")', "words=($@)"),
    shell("deploy/docker/until_finished", 'before="$word"', 'befor="$word"'),
    shell("deploy/package/postinst", '"$1" = configure', "$1 == configure"),
    shell("deploy/package/prerm", "'comrad@*.service'", "`echo 'comrad@*.service'"),
    shell("deploy/package/root.sh", 'log="${folder%/}.log"', 'logs="${folder%/}.log'),
    shell("deploy/package/build.sh", 'mkdir -p "${out}"', 'mkdir -p "${outs}"'),
    shell("deploy/docker/build.sh", 'image="${out}/', 'images="${out}/'),
    shell("deploy/package/release.sh", 'echo "ok      ${what}"', 'echo "ok      ${whats}"'),
    shell("deploy/wheel/build.sh", 'ls -l "${out}"', 'ls -l "${outs}"'),
    shell("deploy/gpu/check.sh", 'kill "${watcher}"', 'kill "${watchr}"'),
    shell("comrad", 'build="${PWD}/${build}"', 'build=${PWD}/$(ls *.build'),
]


def gpu_unit(folder: pathlib.Path, fault: str) -> pathlib.Path:
    """The unit with the lines for a GPU behind it, as systemd reads a drop-in."""
    text = (HOME / UNIT).read_text().replace(*INSTALLED) + (HOME / "deploy/systemd/gpu.conf").read_text()
    unit = folder / "comrad@.service"
    unit.write_text(text.replace("PrivateDevices=no", fault))
    return unit


def find_tool(name: str, venv: pathlib.Path) -> str | None:
    beside = venv / "bin" / name
    return str(beside) if beside.is_file() else shutil.which(name)


def faults(command: list[str], silent: bool) -> str:
    """What the linter found; empty where it is content."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    printed = (done.stdout + done.stderr).strip()
    return (printed or f"exit code {done.returncode}") if done.returncode != 0 or (silent and printed) else ""


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--venv", type=pathlib.Path, default=pathlib.Path("/nowhere"))
    venv = parser.parse_args().venv
    if chosen := os.environ.get("COMRAD_TEST_PYTHON"):
        venv = pathlib.Path(chosen).parent.parent
    failed, missing = 0, set()

    def check(good: bool, what: str, why: str) -> None:
        nonlocal failed
        failed += not good
        print(f"{'ok  ' if good else 'FAIL'} {what}" + ("" if good else f": {why}"))

    with tempfile.TemporaryDirectory() as scratch:
        for number, case in enumerate(CASES):
            tool = find_tool(case.tool, venv)
            if tool is None:
                missing.add(case.tool)
                continue
            text = (HOME / case.path).read_text().replace(*case.before)
            if text.count(case.good) == 0:
                check(False, case.path, f"it no longer has '{case.good}', which this test makes a fault of")
                continue
            found = {}
            for word, changed in (("whole", text), ("broken", text.replace(case.good, case.bad, 1))):
                file = pathlib.Path(scratch) / f"{number}_{word}" / pathlib.Path(case.path).name
                file.parent.mkdir()
                file.write_text(changed)
                found[word] = faults(case.command(tool, str(file)), case.silent)
            check(not found["whole"], f"{case.tool} reads {case.path}", found["whole"])
            fault = f"'{case.bad}'" if case.bad else f"the want of '{case.good.strip()}'"
            check(bool(found["broken"]), f"{case.tool} sees {fault} in {case.path}", "it found nothing")
        if tool := find_tool("systemd-analyze", venv):
            folder = pathlib.Path(scratch)
            found_in = faults(verify(tool, str(gpu_unit(folder, "PrivateDevices=no"))), True)
            check(not found_in, "systemd-analyze reads deploy/systemd/gpu.conf", found_in)
            check(bool(faults(verify(tool, str(gpu_unit(folder, "PrivateDevices=perhaps"))), True)), "and sees a fault in it", "none")
    if failed:
        return 1
    if missing:
        print(f"[  SKIPPED ] 1 test: not linted, for want of {', '.join(sorted(missing))}; ./comrad test installs them")
        return SKIPPED
    return 0


if __name__ == "__main__":
    sys.exit(main())
