"""Reads run folders and the answers of `comrad eval --json`.

Nothing that is read here is trusted: a run may still be written, may have been killed in the middle of a line, or may be no
run at all. What cannot be used is left out and named in `problems`; nothing raises for a damaged file.

A run's files are described in deploy/COMMANDS.md, the names in metrics.jsonl in learner/METRICS.md.
"""

import dataclasses
import math
import pathlib
import re

import numpy as np

from report_lines import LINE_BYTES_MAX, number, one_line, parse_json, read_object, read_reports, read_settings, read_text

SCORE = "policy_stats/avg_true_objective"
CURVE, RESULT = "curve.csv", "result.json"  # of a kept result

ON_POLICY = ("ippo", "mappo", "happo")
OFF_POLICY = ("idqn", "vdn", "qmix", "qplex_d", "qplex_q")

# What follows the name of a folder that was searched.
NO_RUN = (
    "holds no run yet; a run is a folder with config.toml and metrics.jsonl, in it or one folder below; name another folder, "
    "or start a run with comrad train --train_dir FOLDER or comrad sweep FILE.toml"
)

POSITIONS_BYTES_MAX = 1 << 28
AGENTS_MAX = 8
MAP_UNITS_MAX = 32768  # Doom's coordinates

# Settings that do not change what is learned: which run it is, where it lies, how it is watched, what its machine decides, and
# how it reaches other hosts. A test compares them with the rows of rollout_buffer/settings and with what makes a kept result
# stale (deploy/sweep/sweep_results.cc).
NOT_LEARNED = frozenset(
    """
    experiment train_dir restart_behavior seed load_checkpoint_kind save_every_sec keep_checkpoints save_best_every_sec
    save_best_after_env_frames save_best_after save_milestones_sec save_milestones_env_frames eval_every_env_frames
    eval_episodes eval_maps video_every_env_frames experiment_summaries_interval progress_interval metrics_port stats_avg
    wad device policy_device num_workers worker_num_splits policy_workers policy_processes min_batch max_batch max_wait_us
    policy_threads learner_threads learners trajectory_slabs micro_batch_size set_workers_cpu_affinity replay_gb replay_file
    replay_compress save_replay
    serve publish serve_workers serve_frame_workers serve_bf16_weights link hosts host_keys interface peers port_base
    link_buffer_mb link_datagram_bytes insecure_network
    """.split()
)


@dataclasses.dataclass
class Metrics:
    """The reports of a run, rising in env frames.

    env_frames, time_s   [R] f64  agents x tics that were learned from; seconds of training, NaN of a kept result
    values               name -> [R] f64, NaN where a report lacks the name or holds null
    damaged_lines        lines that were no report
    """

    env_frames: np.ndarray = dataclasses.field(default_factory=lambda: np.empty(0))
    time_s: np.ndarray = dataclasses.field(default_factory=lambda: np.empty(0))
    values: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    damaged_lines: int = 0

    def __len__(self) -> int:
        return len(self.env_frames)

    def column(self, name: str) -> np.ndarray:
        """[R] f64, all NaN for a name that no report has."""
        return self.values.get(name, np.full(len(self), np.nan))

    def series(self, name: str, over: str = "env_frames") -> tuple[np.ndarray, np.ndarray]:
        """x and y of the reports that have `name`; `over` is env_frames or time_s."""
        x, y = getattr(self, over), self.column(name)
        there = np.isfinite(x) & np.isfinite(y)
        return x[there], y[there]


@dataclasses.dataclass
class Run:
    """One run folder. `settings` is its config.toml; `status` its status.json, empty where there is none; `result` a kept
    result's result.json, else empty."""

    folder: pathlib.Path
    settings: dict
    metrics: Metrics
    status: dict = dataclasses.field(default_factory=dict)
    problems: list[str] = dataclasses.field(default_factory=list)
    result: dict = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def scenario(self) -> str:
        return pathlib.PurePath(self.settings["scenario"]).name

    @property
    def algo(self) -> str:
        return self.settings["algo"]

    @property
    def seed(self) -> int:
        return self.settings["seed"]

    @property
    def explicit_precision(self) -> str:
        """The precision that this run was started with; empty where the machine chose it, and where config.toml does not report it."""
        explicit = self.settings.get("explicit", self.settings.get("asked_for"))  # asked_for: runs of older versions
        is_explicit = isinstance(explicit, dict) and "precision" not in explicit
        return str(self.settings.get("precision", "")) if is_explicit else ""

    @property
    def state(self) -> str:
        """starting, running, paused, finished, failed; of a sweep also interrupted, missing (sweep_files.py); "unknown" without a
        status.json."""
        state = self.status.get("state")
        return state if isinstance(state, str) and state else "unknown"

    @property
    def env_frames(self) -> float:
        """Of the last report; 0 before the first."""
        return float(self.metrics.env_frames[-1]) if len(self.metrics) else 0.0

    def last_error(self) -> str:
        """What a failed run reports of itself: its status, else the last line of error in its log."""
        message = self.status.get("message")
        if isinstance(message, str) and message.strip():
            return one_line(message)
        for name in ("supervisor.log", "learner.log"):
            try:
                with open(self.folder / "logs" / name, "rb") as log:
                    log.seek(max(0, log.seek(0, 2) - 65536))
                    lines = log.read().decode("utf-8", "replace").splitlines()
            except OSError:
                continue
            for line in reversed(lines):
                if re.search(r"error|critical|failed|killed", line, re.IGNORECASE):
                    return one_line(line)
        return "it left no message"


@dataclasses.dataclass
class Evaluation:
    """One answer of `comrad eval --json`.

    policy       "random", "oracle", or the name of the run that played
    scores       [E] f64, J of each episode where the answer has them (`--each`), else empty
    half_width   of the 95 % interval of `mean` over episodes; NaN for one episode
    """

    file: pathlib.Path
    policy: str
    scenario: str
    layout: str
    num_agents: int
    episodes: int
    mean: float
    half_width: float
    ceiling: float
    greedy: bool
    scores: np.ndarray

    def protocol(self) -> str:
        """What must be the same where evaluations are compared."""
        return f"{self.episodes} {'greedy' if self.greedy else 'stochastic'} episodes, {self.num_agents} agents, {self.layout}"


def read_metrics(path: pathlib.Path) -> Metrics:
    """Raises OSError and ValueError where there is no such file; skips and counts damaged lines (report_lines.py)."""
    rows, damaged = read_reports(path)
    names = dict.fromkeys(name for _, _, report in rows for name in report if name not in ("env_frames", "time_s"))
    times = np.array([time_s for _, time_s, _ in rows], dtype=float)
    return Metrics(
        env_frames=np.array([frames for frames, _, _ in rows], dtype=float),
        time_s=np.maximum.accumulate(times) if len(times) else times,
        values={name: np.array([number(report.get(name)) for _, _, report in rows], dtype=float) for name in names},
        damaged_lines=len(damaged),
    )


def read_curve(path: pathlib.Path) -> Metrics:
    """curve.csv of a kept result (deploy/sweep/sweep_results.h): J over env frames; time_s is NaN. Raises OSError, ValueError."""
    head, *lines = read_text(path).splitlines() or [""]
    if head != "env_frames,J":
        raise ValueError(f"{path.name}: its first line is not env_frames,J")
    points = np.array([line.split(",") for line in lines], dtype=float).reshape(-1, 2)  # ValueError names what is no number
    rises = np.diff(points[:, 0], prepend=-math.inf) > 0
    if not (np.isfinite(points).all() and rises.all()):
        raise ValueError(f"{path.name}: a point is not finite, or env_frames do not rise")
    return Metrics(points[:, 0], np.full(len(points), np.nan), {SCORE: points[:, 1]})


def read_kept(folder: pathlib.Path) -> Run:
    """A kept result. Raises ValueError with a sentence."""
    settings = {"scenario_version": 1} | read_settings(folder)
    try:
        result, metrics = read_object(folder / RESULT), read_curve(folder / CURVE)
    except OSError as error:
        raise ValueError(one_line(str(error))) from error
    status = {"state": "finished", "env_frames": number(result.get("env_frames"))}
    return Run(folder, settings, metrics, status, result=result)


def read_run(folder: pathlib.Path) -> Run:
    """Raises ValueError with a sentence for a folder that cannot be used as a run."""
    if (folder / CURVE).is_file():
        return read_kept(folder)
    settings = {"scenario_version": 1} | read_settings(folder)  # older runs do not say one
    problems = []
    try:
        metrics = read_metrics(folder / "metrics.jsonl")
    except (OSError, ValueError) as error:
        problems.append(one_line(str(error)))
        metrics = Metrics()
    if metrics.damaged_lines:
        problems.append(
            f"metrics.jsonl: {metrics.damaged_lines} damaged line{'s' if metrics.damaged_lines > 1 else ''} skipped"
        )
    if len(metrics) and not np.isfinite(metrics.column(SCORE)).any():
        problems.append("metrics.jsonl: no episode ended")
    status = {}
    try:
        status = parse_json(read_text(folder / "status.json"))
        if not isinstance(status, dict):
            raise ValueError("it holds no object")
    except (OSError, ValueError) as error:
        problems.append(f"status.json: {one_line(str(error))}")
        status = {}
    return Run(folder, settings, metrics, status, problems)


def find_runs(folder: pathlib.Path) -> tuple[list[Run], list[tuple[str, str]]]:
    """Reads every run in `folder`, which is a run itself or holds runs, two levels down at most.

    Returns the runs by name, and the folders that look like a run but cannot be read, with the reason."""
    runs, left_out = [], []
    if (folder / "config.toml").is_file():
        folders = [folder]
    else:
        folders = sorted(
            {
                path.parent
                for pattern in ("*/config.toml", "*/*/config.toml", "*/metrics.jsonl", "*/*/metrics.jsonl")
                for path in folder.glob(pattern)
                if not any(part.startswith(".") for part in path.relative_to(folder).parts)
            }
        )
    for one in folders:
        try:
            runs.append(read_run(one))
        except ValueError as error:
            left_out.append((one.name, str(error)))
    return runs, left_out


def episode_values(answer: dict, name: str) -> np.ndarray:
    """J or return of each episode, [E] f64: from an answer of `comrad eval --each`, or from a kept result's array."""
    each, kept = answer.get("each"), answer.get(name)
    if isinstance(each, list):
        return np.array([number(one.get(name)) if isinstance(one, dict) else math.nan for one in each], dtype=float)
    return np.array([number(value) for value in kept], dtype=float) if isinstance(kept, list) else np.empty(0)


def read_evaluation(path: pathlib.Path) -> list[Evaluation]:
    """A file with one answer of `comrad eval --json` in each line, or one list of them.

    Raises OSError, and ValueError with a sentence for a file that holds anything else."""
    text = read_text(path)
    try:
        answers = parse_json(text)
    except ValueError:
        answers = [parse_json(line) for line in text.splitlines() if line.strip()]
    found = []
    of_policies = []
    for answer in answers if isinstance(answers, list) else [answers]:
        if not isinstance(answer, dict):
            raise ValueError("it holds no answer of `comrad eval --json`")
        several = answer.get("policies")
        of_policies += [one for one in several if isinstance(one, dict)] if isinstance(several, list) else [answer]
    for answer in of_policies:
        policy, scenario = answer.get("policy"), answer.get("scenario")
        mean, episodes = number(answer.get("J_mean")), number(answer.get("episodes"))
        if not (isinstance(policy, str) and isinstance(scenario, str) and math.isfinite(mean) and episodes >= 1):
            raise ValueError("policy, scenario, episodes or J_mean is missing: it is no answer of `comrad eval --json`")
        scores = episode_values(answer, "J")
        found.append(
            Evaluation(
                file=path,
                policy=pathlib.PurePath(policy).name,
                scenario=pathlib.PurePath(scenario).name,
                layout=str(answer.get("layout", "")),
                num_agents=int(np.nan_to_num(number(answer.get("num_agents")))),
                episodes=int(episodes),
                mean=mean,
                half_width=number(answer.get("J_ci95")),
                ceiling=number(answer.get("ceiling")),
                greedy=answer.get("greedy") is True,
                scores=scores if np.isfinite(scores).all() else np.empty(0),
            )
        )
    return found


def evaluation_files(folder: pathlib.Path, ending: str) -> list[pathlib.Path]:
    """Files in eval/, beside the runs or inside of one."""
    return sorted({path for depth in ("", "*/", "*/*/") for path in folder.glob(f"{depth}eval/*.{ending}")})


def find_evaluations(folder: pathlib.Path) -> tuple[list[Evaluation], list[tuple[str, str]]]:
    """Reads eval/*.json below `folder` and below each run in it, and kept results; also the files that cannot be read, with
    the reason."""
    found, left_out = [], []
    kept = sorted(path for pattern in (f"*/{RESULT}", "random_*.json") for path in folder.glob(pattern))
    for path in evaluation_files(folder, "json") + kept:
        try:
            found += read_evaluation(path)
        except (OSError, ValueError) as error:
            left_out.append((str(path.relative_to(folder)), one_line(str(error))))
    return found, left_out


@dataclasses.dataclass
class Occupancy:
    """Where the agents of one evaluation were, on the map on which they spent most decisions.

    lines      [L, 5] f64  x1, y1, x2, y2 in map units; 1 in the last column where the line blocks
    positions  per agent [M, 2] f64, one row a decision of all its episodes there
    maps       how many maps the evaluation played"""

    file: pathlib.Path
    policy: str
    scenario: str
    layout: str
    lines: np.ndarray
    positions: list[np.ndarray]
    episodes: int
    maps: int


def read_occupancy(path: pathlib.Path) -> Occupancy:
    """A file of `comrad eval --positions_file`. Raises OSError, and ValueError with a sentence for anything else."""
    if path.stat().st_size > POSITIONS_BYTES_MAX:
        raise ValueError(f"it has more than {POSITIONS_BYTES_MAX >> 20} MB")
    with open(path, "rb") as file:
        head = parse_json(file.readline(LINE_BYTES_MAX).decode("utf-8", "replace"))
        if not (
            isinstance(head, dict) and isinstance(head.get("policy"), str) and isinstance(head.get("scenario"), str)
        ):
            raise ValueError("its first line does not say which policy played which scenario")
        maps: dict[str, np.ndarray] = {}
        episodes: dict[str, list[list[np.ndarray]]] = {}
        while line := file.readline(LINE_BYTES_MAX):
            part = parse_json(line.decode("utf-8", "replace"))
            if not isinstance(part, dict) or not isinstance(part.get("layout"), str):
                raise ValueError("a line names no layout")
            try:
                if "lines" in part:
                    maps[part["layout"]] = np.array(part["lines"], dtype=float).reshape(-1, 5)
                else:
                    agents = [np.array(flat, dtype=float).reshape(-1, 2) for flat in part.get("positions", [])]
                    episodes.setdefault(part["layout"], []).append(agents)
            except (TypeError, ValueError):
                raise ValueError("a line holds no map and no positions") from None
    episodes = {layout: found for layout, found in episodes.items() if layout in maps}
    if not episodes:
        raise ValueError("it holds no episode")
    layout = max(episodes, key=lambda name: sum(len(agents[0]) if agents else 0 for agents in episodes[name]))
    counts = {len(agents) for agents in episodes[layout]}
    if len(counts) != 1 or not 1 <= (agents := counts.pop()) <= AGENTS_MAX:
        raise ValueError("its episodes have no agents, or different numbers of them")
    positions = [np.concatenate([episode[agent] for episode in episodes[layout]]) for agent in range(agents)]
    if not all(
        len(one) and np.isfinite(one).all() and (np.abs(one) <= MAP_UNITS_MAX).all() for one in positions
    ) or not (len(maps[layout]) and np.isfinite(maps[layout]).all() and (np.abs(maps[layout]) <= MAP_UNITS_MAX).all()):
        raise ValueError("it holds places outside of any map")
    return Occupancy(
        path,
        pathlib.PurePath(head["policy"]).name,
        pathlib.PurePath(head["scenario"]).name,
        one_line(str(head.get("layout", "")), 60),
        maps[layout],
        positions,
        len(episodes[layout]),
        len(maps),
    )


def find_occupancies(folder: pathlib.Path) -> tuple[list[Occupancy], list[tuple[str, str]]]:
    """Reads eval/*.jsonl below `folder` and below each run in it, and the files that cannot be read, with the reason."""
    found, left_out = [], []
    for path in evaluation_files(folder, "jsonl"):
        try:
            found.append(read_occupancy(path))
        except (OSError, ValueError) as error:
            left_out.append((str(path.relative_to(folder)), one_line(str(error))))
    return found, left_out
