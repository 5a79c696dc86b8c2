"""Episodes as files: what `comrad eval --episodes_dir` writes, played again."""

import dataclasses
import json
import os
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np

FORMAT, VERSION = "comrad-episode", 1
MOST_BYTES = 1 << 28


@dataclasses.dataclass
class Episode:
    """One episode: how it began, what every agent chose, how it ended.

    scenario, heads   as ComradParallelEnv takes them
    map               path of the WAD
    episode_seed      the episode's own seed
    actions           u8 [decisions, N, heads]
    score, returns    J, and what each agent earned [N]
    state_hash        of the world at the end, 16 hex digits
    about             everything in the file
    """

    path: pathlib.Path
    scenario: str
    heads: str
    map: pathlib.Path
    episode_seed: int
    frame_skip: int
    actions: np.ndarray
    score: float
    returns: list[float]
    length_tics: int
    state_hash: str
    about: dict[str, Any]

    @property
    def num_agents(self) -> int:
        return self.actions.shape[1]

    def make_env(self, **options: Any) -> Any:
        """The environment that it was played in. `options`: of ComradParallelEnv, beside scenario, team, map, frame skip and heads.
        Raises ValueError where the scenario has another version now."""
        from . import describe, parallel_env

        found = describe(self.scenario)["version"]
        if (made := self.about.get("scenario_version", found)) != found:
            raise ValueError(f"{self.path}: an episode of {self.scenario}'s version {made}, here it has version {found}")
        return parallel_env(
            self.scenario, num_agents=self.num_agents, layout=self.map, frame_skip=self.frame_skip, heads=self.heads, **options
        )

    def replay(self, env: Any = None, **options: Any) -> Iterator[tuple[dict, dict, dict, dict, dict]]:
        """Plays it again and gives what each step() gives, the observations of reset() first (with empty dictionaries behind them).
        Raises RuntimeError at the end where the world is another than it was: another map or version of the engine."""
        own = self.make_env(**options) if env is None else env
        try:
            observations, infos = own.reset(options={"episode_seed": self.episode_seed})
            yield observations, {}, {}, {}, infos
            for choices in self.actions.astype(np.int64):
                yield own.step({agent: choices[index] for index, agent in enumerate(own.possible_agents)})
            found = f"{own.state_hash():016x}"
            if found != self.state_hash:
                raise RuntimeError(f"{self.path}: the replay ends in world {found}, the episode ended in {self.state_hash}; was it made by another version?")
        finally:
            if env is None:
                own.close()


def load_episode(path: str | os.PathLike) -> Episode:
    """Reads a .comrad file. Raises FileNotFoundError, and ValueError for what is no episode, with the reason."""
    file = pathlib.Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"{file}: no such episode")
    if file.stat().st_size > MOST_BYTES:
        raise ValueError(f"{file}: larger than {MOST_BYTES >> 20} MiB; no episode is")
    head, _, data = file.read_bytes().partition(b"\n")
    try:
        about = json.loads(head)
    except ValueError as error:
        raise ValueError(f"{file}: its first line is no JSON: {error}") from None
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise ValueError(f"{file}: not an episode of comrad eval --episodes_dir")
    if about.get("version") != VERSION:
        raise ValueError(f"{file}: format version {about.get('version')}; this package reads {VERSION}")
    try:
        sizes = np.array(about["head_sizes"], np.int64)
        shape = (int(about["decisions"]), int(about["num_agents"]), len(sizes))
        if min(shape) < 0 or len(data) != shape[0] * shape[1] * shape[2]:
            raise ValueError(f"{len(data)} bytes of actions for {shape[0]} decisions of {shape[1]} agents with {shape[2]} heads; it is cut off")
        actions = np.frombuffer(data, np.uint8).reshape(shape)
        if (actions >= sizes).any():
            raise ValueError("an action lies outside its head")
        name = pathlib.PurePosixPath(about["map"])
        if name.is_absolute() or ".." in name.parts:
            raise ValueError(f"its map {name} lies outside its folder")
        wad = file.parent / name
        if not wad.is_file():
            raise ValueError(f"its map {wad} is missing; keep the folder maps beside it")
        return Episode(
            path=file,
            scenario=str(about["scenario"]),
            heads=str(about["heads"]),
            map=wad,
            episode_seed=int(about["episode_seed"]),
            frame_skip=int(about["frame_skip"]),
            actions=actions,
            score=float(about["score"]),
            returns=[float(one) for one in about["returns"]],
            length_tics=int(about["length_tics"]),
            state_hash=str(about["state_hash"]),
            about=about,
        )
    except KeyError as missing:
        raise ValueError(f"{file}: {missing} is missing in its first line") from None
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: {error}") from None
