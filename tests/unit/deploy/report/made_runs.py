"""Makes small run folders as `comrad train` leaves them, for tests of what reads them."""

import json
import math
import pathlib
import random

SETTINGS = {
    "num_agents": 2,
    "layout_seed": 42,
    "layout_pool": "",
    "gamma": 0.99,
    "train_for_env_frames": 1e6,
    "stats_avg": 100,
}


def toml_value(value) -> str:
    return str(value).lower() if isinstance(value, bool) else json.dumps(value)


def write_run(
    train_dir: pathlib.Path,
    scenario: str,
    algo: str,
    seed: int,
    *,
    start: float,
    end: float,
    reports: int = 40,
    frames: float = 1e6,
    state: str = "finished",
    message: str = "",
    name: str = "",
    explicit: dict | None = None,
    **settings,
) -> pathlib.Path:
    """A run whose J rises from `start` to nearly `end`, with noise of the seed. Returns its folder.

    explicit   the table of config.toml that names what the machine, the scenario and the run's name decided"""
    noise = random.Random(f"{scenario} {algo} {seed}")
    experiment = name or f"{scenario}_{algo}_{seed}"
    folder = train_dir / experiment
    (folder / "logs").mkdir(parents=True)
    chosen = {
        **SETTINGS,
        "scenario": scenario,
        "algo": algo,
        "seed": seed,
        "experiment": experiment,
        "train_dir": str(train_dir),
        "wad": f"layouts/{scenario}_42.wad",
        **settings,
    }
    lines_of = lambda table: "".join(f"{key} = {toml_value(value)}\n" for key, value in table.items())
    config = lines_of(chosen) if explicit is None else f"{lines_of(chosen)}\n[explicit]\n{lines_of(explicit)}"
    (folder / "config.toml").write_text(config)
    pace = noise.uniform(2.5, 4.5)
    lines = []
    for number in range(1, reports + 1):
        share = number / reports
        score = start + (end - start) * (1 - math.exp(-pace * share)) + noise.gauss(0, 0.02) * (end - start)
        report = {
            "time_s": 900 * share * noise.uniform(0.98, 1.02),
            "env_frames": round(frames * share),
            "decisions": round(frames * share / 4),
            "perf/_fps": noise.gauss(1100, 40),
            "perf/_sample_throughput": noise.gauss(280, 10),
            "train/version_diff_avg": noise.gauss(3.5, 0.4),
            "train/version_diff_max": 9,
            "train/loss": 1 - share / 2,
            "train/grad_norm": noise.gauss(0.6, 0.05),
            "stats/learner_busy_fraction": 0.6,
        }
        if number > 1:  # no episode has ended before
            report["policy_stats/avg_true_objective"] = score
        if algo in ("ippo", "mappo", "happo"):
            report |= {
                "train/entropy": 3.2 - share,
                "train/explained_variance": 0.8 * share,
                "train/kl_divergence": 0.01,
            }
        else:
            report |= {
                "train/q_tot_mean": 5 * share,
                "train/td_error_mean": 0.5 - 0.3 * share,
                "train/epsilon": 1 - 0.9 * share,
            }
        lines.append(json.dumps(report) + "\n")
    (folder / "metrics.jsonl").write_text("".join(lines))
    (folder / "status.json").write_text(
        json.dumps(
            {
                "state": state,
                "env_frames": round(frames),
                "message": message,
                "elapsed_s": 1000.0,
                "cpu_s": {"simulators": 900.0, "policy workers": 600.0, "learner": 400.0, "supervisor": 10.0},
            }
        )
    )
    return folder


def write_evaluation(
    folder: pathlib.Path,
    scenario: str,
    policy: str,
    mean: float,
    *,
    spread: float = 1.0,
    episodes: int = 20,
    file: str = "",
    **fields,
) -> pathlib.Path:
    """An answer of `comrad eval --each --json`: `episodes` scores around `mean`."""
    noise = random.Random(f"{scenario} {policy}")
    scores = [noise.gauss(mean, spread) for _ in range(episodes)]
    average = sum(scores) / episodes
    deviation = math.sqrt(sum((score - average) ** 2 for score in scores) / (episodes - 1))
    answer = {
        "scenario": scenario,
        "policy": policy,
        "episodes": episodes,
        "seed": 42,
        "num_agents": 2,
        "layout": "seed 42",
        "J_mean": average,
        "J_ci95": 2.093 * deviation / math.sqrt(episodes),
        "ceiling": 0,
        "greedy": policy not in ("random", "oracle"),
        "each": [{"episode": at, "J": score} for at, score in enumerate(scores)],
        **fields,
    }
    (folder / "eval").mkdir(parents=True, exist_ok=True)
    path = folder / "eval" / (file or f"{scenario}_{policy}.json")
    path.write_text(json.dumps(answer))
    return path


def write_positions(
    folder: pathlib.Path, scenario: str, policy: str, *, agents: int = 2, episodes: int = 3, decisions: int = 200
) -> pathlib.Path:
    """What `comrad eval --positions_file` writes: agents that walk about a room of 1024 x 512 units with a pillar."""
    noise = random.Random(f"{scenario} {policy}")
    room, pillar = [(0, 0), (1024, 0), (1024, 512), (0, 512)], [(480, 200), (544, 200), (544, 264), (480, 264)]
    lines = [[*a, *b, 1] for outline in (room, pillar) for a, b in zip(outline, outline[1:] + outline[:1])]
    lines.append([768, 0, 768, 512, 0])
    text = (
        json.dumps(
            {"scenario": scenario, "policy": policy, "num_agents": agents, "episodes": episodes, "layout": "seed 42"}
        )
        + "\n"
    )
    text += json.dumps({"layout": "00000000000000aa", "lines": lines}) + "\n"
    for _ in range(episodes):
        positions = []
        for agent in range(agents):
            flat = []
            for step in range(decisions + 1):
                flat += [
                    round(512 + 400 * math.sin(step / 30 + agent) + noise.gauss(0, 15)),
                    round(256 + 200 * math.cos(step / (20 + 10 * agent)) + noise.gauss(0, 10)),
                ]
            positions.append(flat)
        text += json.dumps({"layout": "00000000000000aa", "decisions": decisions, "positions": positions}) + "\n"
    (folder / "eval").mkdir(parents=True, exist_ok=True)
    path = folder / "eval" / f"{scenario}_{policy}.jsonl"
    path.write_text(text)
    return path


def write_sweep(folder: pathlib.Path, planned: list[dict], records: dict[str, dict]) -> None:
    """What `comrad sweep` leaves beside its runs: sweep.json with the settings of each, as text, and a record of each attempt."""
    runs = [
        {
            "name": "{scenario}_{algo}_{seed}".format(**settings),
            "train_for_env_frames": 1e6,
            "settings": {"train_for_env_frames": "1000000.0"}
            | {name: str(value) for name, value in settings.items()}
            | {"num_workers": "2", "learner_threads": "2"},
        }
        for settings in planned
    ]
    (folder / "records").mkdir(parents=True, exist_ok=True)
    (folder / "sweep.json").write_text(
        json.dumps({"name": folder.name, "file": "study.toml", "cores_per_run": 2, "results": None, "runs": runs})
    )
    for name, record in records.items():
        whole = {"state": "failed", "attempts": 1, "host": "node1", "exit_code": 2, "error": "", **record}
        (folder / "records" / f"{name}.json").write_text(json.dumps(whole))


# scenario -> random play, scripted team, and how far of the way each algorithm gets.
STUDY = {
    "coop_health_gathering": (650, 7400, {"ippo": 0.55, "mappo": 0.42, "vdn": 0.20}),
    "lava_pit": (0, 11, {"ippo": 0.30, "mappo": 0.62, "vdn": 0.45}),
    "ammo_carrier": (900, 8100, {"ippo": 0.70, "mappo": 0.25, "vdn": 0.35}),
}
SEEDS = (42, 68, 81)
TWO_SCENARIOS = ("lava_pit", "ammo_carrier")  # as many as tables and figures over scenarios need


def write_study(train_dir: pathlib.Path, *, evaluations: bool = True, scenarios: tuple[str, ...] = tuple(STUDY)) -> None:
    """Scenarios by three algorithms by three seeds, evaluations of all, and baselines."""
    for scenario in scenarios:
        low, high, shares = STUDY[scenario]
        write_evaluation(train_dir, scenario, "random", low, spread=0.01 * (high - low))
        write_evaluation(train_dir, scenario, "oracle", high, spread=0.02 * (high - low))
        for algo, share in shares.items():
            for seed in SEEDS:
                reached = low + (high - low) * share * random.Random(f"{scenario} {seed} {algo}").uniform(0.8, 1.2)
                run = write_run(train_dir, scenario, algo, seed, start=low, end=reached, reports=12)
                if evaluations:
                    write_evaluation(train_dir, scenario, run.name, reached, spread=0.1 * (high - low))
                    if (scenario, algo, seed) == ("ammo_carrier", "ippo", SEEDS[0]):
                        write_positions(train_dir, scenario, run.name)
