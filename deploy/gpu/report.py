"""What deploy/gpu/check.sh found, as gpu.json and gpu.md. Called by it: report.py OUT DRY DEVICE PRESET."""

import datetime
import json
import os
import pathlib
import platform
import subprocess
import sys


def lines_of(command: list[str]) -> list[str]:
    """What a program prints; nothing where it is not there or fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return []
    return done.stdout.strip().splitlines() if done.returncode == 0 else []


def object_in(path: pathlib.Path) -> dict:
    """The JSON object that a part printed; empty where it printed none."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def machine() -> dict:
    gpus = lines_of(["nvidia-smi", "--query-gpu=name,memory.total,driver_version", "--format=csv,noheader"])
    model = [line.split(":", 1)[1].strip() for line in lines_of(["cat", "/proc/cpuinfo"]) if line.startswith("model name")]
    memory = [int(line.split()[1]) for line in lines_of(["cat", "/proc/meminfo"]) if line.startswith("MemTotal")]
    home = os.environ.get("COMRAD_HOME", ".")
    commit = lines_of(["git", "-c", f"safe.directory={home}", "-C", home, "rev-parse", "--short", "HEAD"])
    return {
        "gpus": gpus,
        "cores": len(os.sched_getaffinity(0)),
        "processor": model[0] if model else platform.machine(),
        "memory_gb": round(memory[0] / 1e6) if memory else None,
        "commit": commit[0] if commit else None,
        "date": datetime.date.today().isoformat(),
    }


def gpu_load(path: pathlib.Path) -> dict:
    """Mean load and largest memory over the lines of nvidia-smi."""
    rows = []
    for line in path.read_text().splitlines() if path.exists() else []:
        words = line.split(",")
        if len(words) == 2 and all(word.strip().isdigit() for word in words):
            rows.append([int(word) for word in words])
    if not rows:
        return {}
    return {"gpu_busy_percent": sum(row[0] for row in rows) / len(rows), "gpu_memory_mb": max(row[1] for row in rows)}


def parity(path: pathlib.Path) -> dict:
    """Of each algorithm, the largest differences between the CPU and the device, and whether they are small enough."""
    found = {}
    for suite in object_in(path).get("testsuites", []):
        for case in suite.get("testsuite", []):
            name, _, algo = case.get("name", "").partition("/")
            if not name.startswith("LogitsLosses"):
                continue
            found[algo] = {key: float(value) for key, value in case.items() if key.endswith("_largest_difference")}
            found[algo]["agrees"] = not case.get("failures")
    return found


def main() -> int:
    out, dry, device, preset = pathlib.Path(sys.argv[1]), sys.argv[2] == "1", sys.argv[3], sys.argv[4]
    parts = out / "parts"
    report = {"dry": dry, "device": device, "preset": preset, "machine": machine(), "parts": [], "libtorch": {}, "bench": []}
    for path in sorted(parts.glob("*.end"), key=lambda path: float(path.read_text().split()[1])):
        code, begin, end = path.read_text().split()
        report["parts"].append({"name": path.stem, "ok": code == "0", "seconds": round(float(end) - float(begin), 1)})
    for check in object_in(parts / "doctor.out").get("checks", []):
        if check.get("name") in ("libtorch", "cuda"):
            report["libtorch"][check["name"]] = check.get("found")
    report["parity"] = parity(parts / "parity.json")
    for part in report["parts"]:
        if not part["name"].startswith("bench_"):
            continue
        measured = object_in(parts / (part["name"] + ".out"))
        row = {key: measured.get(key) for key in ("scenario", "algo", "num_agents", "decisions_per_s", "env_frames_per_s", "spread")}
        row["bottleneck"] = measured.get("bottleneck")
        row["policy_thread_us_per_decision"] = measured.get("policy_thread_us_per_decision") or {}
        row.update(gpu_load(parts / (part["name"] + ".gpu")))
        if "gpu_busy" in measured:  # of its window alone
            row["gpu_busy_percent"] = 100 * measured["gpu_busy"]
        row["part"], row["ok"] = part["name"], part["ok"]
        report["bench"].append(row)
    status = object_in(out / "runs/mappo/status.json")
    wall = [part["seconds"] for part in report["parts"] if part["name"] == "train_mappo"]
    report["training"] = {
        "algo": "mappo",
        "scenario": "stag_hunt_arena",
        "state": status.get("state"),
        "env_frames": status.get("env_frames"),
        "J_mean": status.get("J_mean"),
        "wall_s": wall[0] if wall else None,
        **gpu_load(parts / "train_mappo.gpu"),
    }
    (out / "gpu.json").write_text(json.dumps(report, indent=2) + "\n")

    def number(value: object, digits: int = 0) -> str:
        return f"{value:,.{digits}f}".replace(",", " ") if isinstance(value, (int, float)) else "-"

    host = report["machine"]
    text = [f"# GPU check{' (dry, on the CPU)' if dry else ''}", ""]
    text += [f"{', '.join(host['gpus']) or 'no GPU'}; {host['cores']} cores, {host['processor']}, {host['memory_gb']} GB; {host['date']},"]
    text += [f"commit {host['commit']}; device {device}, preset {preset}.", ""]
    text += [f"* {name}: {found}" for name, found in report["libtorch"].items()] + [""]
    text += ["| part | ended | s |", "|---|---|---|"]
    text += [f"| {part['name']} | {'ok' if part['ok'] else '**failed**'} | {number(part['seconds'], 1)} |" for part in report["parts"]]
    kinds = ("logits", "losses", "gradient", "weights")
    text += ["", f"Largest differences between the CPU and {device}:", ""]
    text += ["| algorithm | " + " | ".join(kinds) + " | agrees |", "|---" * (len(kinds) + 2) + "|"]
    for algo, found in report["parity"].items():
        shown = " | ".join(f"{found[kind + '_largest_difference']:.1e}" if kind + "_largest_difference" in found else "-" for kind in kinds)
        text.append(f"| {algo} | {shown} | {'yes' if found['agrees'] else '**no**'} |")
    text += ["", "| part | scenario | N | algorithm | decisions/s | env frames/s | GPU busy, % | GPU memory, MB | gather, weights, pack, forward, scatter, us | limit |", "|---" * 10 + "|"]
    for row in report["bench"]:
        text.append(
            f"| {row['part'].removeprefix('bench_')} | {row['scenario'] or '-'} | {row['num_agents'] or '-'} | {row['algo'] or '-'} | {number(row['decisions_per_s'])} "
            f"| {number(row['env_frames_per_s'])} | {number(row.get('gpu_busy_percent'))} | {number(row.get('gpu_memory_mb'))} "
            f"| {', '.join(number(us, 1) for us in row['policy_thread_us_per_decision'].values()) or '-'} | {row['bottleneck'] or '-'} |"
        )
    done = report["training"]
    if wall:
        text += ["", f"MAPPO on Stag Hunt, {number(done['env_frames'])} env frames: {number(done['wall_s'], 1)} s, state {done['state']}."]
    (out / "gpu.md").write_text("\n".join(text) + "\n")
    print(out / "gpu.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
