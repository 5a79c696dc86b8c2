#!/usr/bin/env python3
"""Kept policies: the best checkpoint of each scenario as one archive, and back into run directories.

    policies.py pack --learner PROGRAM --output FILE.tar.xz FOLDER [FOLDER ...]
    policies.py fetch --train_dir DIR [NAME ...]

`comrad pack-policies` and `comrad fetch-policies` start it. FOLDER is a sweep's whose runs have results ([results] in its file): of
each scenario the run with the highest mean J of its evaluation is taken, unless its result is stale. The archive holds
policies.json, which names each file's SHA-256, and <scenario>/config.toml and <scenario>/checkpoint/*.pt without the moments of
the optimizer and with rounded weights. fetch reads COMRAD_POLICIES, the archive or the folder where it was unpacked; without it the few
policies that lie beside the scenarios.
"""

import argparse
import hashlib
import io
import json
import lzma
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile

from report_lines import number, read_object, read_settings

BAD_INPUT = 2
INDEX, FORMAT = "policies.json", "comrad-policies-1"
ARCHIVE_BYTES_MAX = 40_000_000
BESIDE_SCENARIOS = pathlib.Path(__file__).resolve().parents[2] / "scenarios" / "policies.tar.xz"
FILE_BYTES_MAX = 1 << 30
OF_FLOATS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 2, "lp": 2, "pb": 2}]  # numbers of four bytes
SCENARIO, FILE = re.compile(r"\w+(@\w+)?"), re.compile(r"config\.toml|checkpoint/[\w.-]+\.pt")


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def candidates(folder: pathlib.Path) -> list[tuple[pathlib.Path, dict]]:
    """The runs of a sweep that have a fresh result and a checkpoint. Raises OSError, and ValueError with a sentence."""
    if not (folder / "sweep.json").is_file():
        raise ValueError(f"{folder} is no folder of a sweep; name one, train_dir/<name> of its file")
    results = read_object(folder / "sweep.json").get("results")
    kept = results.get("folder") if isinstance(results, dict) else None
    if not kept:
        raise ValueError(f"{folder}: its sweep keeps no results; add [results] to its file and start comrad sweep again")
    found = []
    for run in sorted(path.parent for path in folder.glob("*/config.toml")):
        result = pathlib.Path(kept, run.name, "result.json")
        if not result.is_file() or not any((run / "checkpoint").glob("checkpoint_*.pt")):
            continue
        answer = read_object(result)
        if not answer.get("stale") and math.isfinite(number(answer.get("J_mean"))):
            found.append((run, answer))
    return found


def newest_checkpoint(run: pathlib.Path) -> pathlib.Path:
    return max((run / "checkpoint").glob("checkpoint_*.pt"), key=lambda path: int(path.stem.split("_")[1]))


def scenario_of(run: pathlib.Path) -> str:
    settings = read_settings(run)
    scenario, variant = pathlib.PurePath(settings["scenario"]).name, settings.get("variant")
    return f"{scenario}@{variant}" if variant and "@" not in scenario else scenario


def portable_settings(run: pathlib.Path) -> bytes:
    """The run's settings without those that name its own place, which have their defaults elsewhere."""
    here = re.compile(rf'\w+ = "{re.escape(str(run.resolve().parent))}(/[^"]*)?"\n?')
    return "".join(line for line in (run / "config.toml").read_text(encoding="utf-8").splitlines(True) if not here.fullmatch(line)).encode()


def add_file(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    """Without times and owners, so that the same policies make the same archive."""
    entry = tarfile.TarInfo(name)
    entry.size = len(content)
    archive.addfile(entry, io.BytesIO(content))


def pack(learner: str, output: pathlib.Path, folders: list[pathlib.Path]) -> None:
    """Writes the archive. Raises OSError, and ValueError with a sentence."""
    best: dict[str, tuple[pathlib.Path, dict]] = {}
    for run, answer in [one for folder in folders for one in candidates(folder)]:
        scenario = scenario_of(run)
        if scenario not in best or answer["J_mean"] > best[scenario][1]["J_mean"]:
            best[scenario] = run, answer
    if not best:
        raise ValueError("no run there has a checkpoint and a result that is not stale; finish the sweep first")
    contents, index = {}, {"format": FORMAT, "policies": {}}
    with tempfile.TemporaryDirectory(prefix="comrad_policies_") as scratch:
        for scenario, (run, answer) in sorted(best.items()):
            checkpoint = newest_checkpoint(run)
            small = pathlib.Path(scratch, checkpoint.name)
            settings = pathlib.Path(scratch, "config.toml")
            settings.write_bytes(portable_settings(run))
            done = subprocess.run([learner, "--to_be_played", checkpoint, small, settings], capture_output=True, text=True, check=False)
            if done.returncode:
                raise ValueError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"{learner} could not read {checkpoint}")
            files = {"config.toml": settings.read_bytes(), f"checkpoint/{checkpoint.name}": small.read_bytes()}
            small.unlink()
            contents |= {f"{scenario}/{name}": content for name, content in files.items()}
            about = {key: answer.get(key) for key in ("algo", "seed", "env_frames", "J_mean", "J_ci95", "scenario_version", "commit", "checkpoint_hash")}
            index["policies"][scenario] = {"run": run.name, **about, "files": {name: sha256(content) for name, content in files.items()}}
    contents = {INDEX: (json.dumps(index, indent=1) + "\n").encode(), **contents}
    part = output.with_name(output.name + ".part")
    try:
        with lzma.open(part, "wb", filters=OF_FLOATS) as zipped, tarfile.open(fileobj=zipped, mode="w") as archive:
            for name, content in contents.items():
                add_file(archive, name, content)
        if part.stat().st_size > ARCHIVE_BYTES_MAX:
            raise ValueError(f"the archive has {part.stat().st_size / 1e6:.0f} MB, at most {ARCHIVE_BYTES_MAX / 1e6:.0f}; name fewer sweeps, or train smaller networks")
        part.replace(output)
    finally:
        part.unlink(missing_ok=True)
    for scenario, one in index["policies"].items():
        print(f"{scenario}: {one['run']}, J {one['J_mean']:.4g}")
    print(f"{output}: {output.stat().st_size / 1e6:.1f} MB")


def named() -> pathlib.Path:
    """What COMRAD_POLICIES names, or what lies beside the scenarios."""
    return pathlib.Path(os.environ.get("COMRAD_POLICIES") or BESIDE_SCENARIOS)


class Source:
    """Kept policies, from an archive or the folder where it was unpacked. Raises OSError, and ValueError with a sentence."""

    def __init__(self, path: pathlib.Path):
        self.path, self.members = path, None
        if self.path.is_file():
            try:
                with tarfile.open(self.path, "r:xz") as archive:
                    members = [one for one in archive if one.isfile() and one.size <= FILE_BYTES_MAX]
                    self.members = {one.name.removeprefix("./"): archive.extractfile(one).read() for one in members}
            except (tarfile.TarError, lzma.LZMAError, EOFError, OSError) as error:
                raise ValueError(f"{path} is no whole .tar.xz ({error}); get it again") from None
        try:
            index = json.loads(self.content(INDEX))
        except (OSError, KeyError, ValueError):
            index = None
        if not isinstance(index, dict) or index.get("format") != FORMAT or not isinstance(index.get("policies"), dict):
            raise ValueError(f"{path} has no {INDEX} of comrad pack-policies; COMRAD_POLICIES names an archive or the folder where it was unpacked")
        self.policies = index["policies"]

    def content(self, name: str) -> bytes:
        return self.members[name] if self.members is not None else (self.path / name).read_bytes()

    def files(self, scenario: str) -> dict[str, bytes]:
        """A policy's files, checked. Raises ValueError with a sentence."""
        listed = self.policies[scenario].get("files") if isinstance(self.policies[scenario], dict) else None
        if not SCENARIO.fullmatch(scenario) or not isinstance(listed, dict) or not all(map(FILE.fullmatch, listed)) or len(listed) < 2:
            raise ValueError(f"{INDEX} names files of {scenario} that no policy has; get the archive again")
        found = {}
        for name, digest in listed.items():
            try:
                found[name] = self.content(f"{scenario}/{name}")
            except (OSError, KeyError):
                raise ValueError(f"{scenario}/{name} is missing; get the archive again") from None
            if sha256(found[name]) != digest:
                raise ValueError(f"{scenario}/{name} is damaged: its SHA-256 differs from that in {INDEX}; get the archive again")
        return found


def fetch(source: Source, names: list[str], train_dir: pathlib.Path) -> dict[str, pathlib.Path]:
    """Puts policies into run directories <train_dir>/policy_<scenario>. Returns them. Raises OSError, and ValueError with a sentence."""
    for name in names:
        if name not in source.policies:
            raise ValueError(f"there is no policy of {name}; there are {', '.join(sorted(source.policies))}")
    put = {}
    for name in names or sorted(source.policies):
        files, run = source.files(name), train_dir / f"policy_{name}"
        put[name] = run
        if run.exists():
            if any(not (run / file).is_file() or (run / file).read_bytes() != content for file, content in files.items()):
                raise ValueError(f"{run} holds another policy; rename or remove it")
            continue
        part = train_dir / f".policy_{name}.part"
        shutil.rmtree(part, ignore_errors=True)
        for file, content in files.items():
            (part / file).parent.mkdir(parents=True, exist_ok=True)
            (part / file).write_bytes(content)
        part.rename(run)
    return put


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ways = parser.add_subparsers(dest="way", required=True)
    packed = ways.add_parser("pack")
    packed.add_argument("--learner", required=True)
    packed.add_argument("--output", required=True, type=pathlib.Path)
    packed.add_argument("folders", nargs="+", type=pathlib.Path)
    fetched = ways.add_parser("fetch")
    fetched.add_argument("--train_dir", required=True, type=pathlib.Path)
    fetched.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    try:
        if arguments.way == "pack":
            pack(arguments.learner, arguments.output, arguments.folders)
            return 0
        source = Source(named())
        for name, run in fetch(source, arguments.names, arguments.train_dir).items():
            one = source.policies[name]
            print(f"{run}: {one.get('algo')}, seed {one.get('seed')}, J {number(one.get('J_mean')):.4g}; comrad watch {run}")
    except (OSError, ValueError) as error:
        print(f"comrad {arguments.way}-policies: error: {error}", file=sys.stderr)
        return BAD_INPUT
    return 0


if __name__ == "__main__":
    sys.exit(main())
