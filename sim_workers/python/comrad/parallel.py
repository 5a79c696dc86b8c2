"""Scenarios as PettingZoo's ParallelEnv."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from ._engine import SavedState
from .arguments import checked_seed, checked_size, checked_state
from .batch import ARRAYS, OneGame, SCREEN_NAME, TICS_A_SECOND, checked_mode, fresh_seed, make_batch, observation_space
from .labels import Label
from .maps import Layout
from .window import Window


class ComradParallelEnv(OneGame, ParallelEnv):
    """N agents, "agent_0" to "agent_{N-1}", who see, press and earn at once; one step is `frame_skip` tics of 1/35 s.

    scenario      a name, the path of a folder with a scenario.toml, or of a ViZDoom .cfg
    num_agents    N; None: what the scenario is made for
    layout        the map: a seed, {"seed": 7, "radius": 1200} (parameters of the recipe), a WAD, a folder of WADs or several WADs,
                  which episodes play in turn; None: the default map, seed 42
    render_mode   "rgb_array": render() returns all views side by side, [h, N w, 3] u8, drawn at `render_size` (width, height);
                  "human": every step shows them in a window (needs pygame)
    frame_skip    tics of a step
    size          (width, height) of the pictures that agents see
    observations  what is seen beside the picture: "depth" [h, w] f32 (map units, 0 for sky), "labels" [h, w] u8 (labels(agent) says
                  what the values mean), "automap", another picture, "measurements" [M] f32, "action_mask", a tuple of i8 [choices]
                  for each head, as action_space(agent).sample(mask=...) takes it. With any of them an observation is a dictionary
                  with the picture as "screen", else the picture itself, [h, w, 3] u8 ([3, h, w] with channels_first)
    automap_mode  "NORMAL" (walls that the agent has seen), "WHOLE", "OBJECTS" or "OBJECTS_WITH_SIZE"; "": NORMAL, or as a .cfg says
    folder        where the .cfg of that name lies: parallel_env("my_game", folder="my_games")
    reward        weights of reward terms in place of the scenario's, as comrad train's --reward: "kills=2,living=0"
    heads         action heads in place of the scenario's, as --heads

    An action is MultiDiscrete: a choice for each head, 0 presses nothing (comrad.describe() names the buttons). All agents stay
    until the episode's end, which is everybody's; one that died and does not come back has infos[agent]["active"] False and what
    it presses changes nothing. At the end infos hold the episode's score J, its ceiling, return and length in tics. state() is the
    true state of the world, f32 [S], as `state_names` says: positions, angles, speeds, health, and what the scenario's script exports.

    The same seed, map and actions give the same episode, to the bit. Raises ValueError, FileNotFoundError, TypeError with words.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "name": "comrad", "is_parallelizable": True}

    def __init__(
        self,
        scenario: str | os.PathLike,
        *,
        num_agents: int | None = None,
        layout: Layout | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (640, 360),
        frame_skip: int = 4,
        size: tuple[int, int] = (128, 72),
        channels_first: bool = False,
        observations: Sequence[str] = (),
        automap_mode: str = "",
        folder: str | os.PathLike | None = None,
        reward: str = "",
        heads: str = "",
    ) -> None:
        self.render_mode = checked_mode(render_mode, self.metadata)
        self._window = Window(f"comrad: {scenario}") if render_mode == "human" else None
        self._render_size = checked_size("render_size", render_size)
        self._batch = make_batch(
            scenario,
            num_agents=num_agents,
            layout=layout,
            frame_skip=frame_skip,
            size=size,
            observations=observations,
            automap_mode=automap_mode,
            folder=folder,
            channels_first=channels_first,
            reward=reward,
            heads=heads,
        )
        self._observations = tuple(observations)
        self._arrays = self._batch.arrays()
        facts = self._batch.facts()
        self.scenario = facts["name"]
        self.metadata = {**self.metadata, "name": f"comrad_{self.scenario}", "render_fps": max(1, round(TICS_A_SECOND / frame_skip))}
        self.possible_agents = [f"agent_{index}" for index in range(facts["num_agents"])]
        self.agents: list[str] = []
        self.state_names: list[str] = self._batch.state_names()
        pressed = spaces.MultiDiscrete(self._batch.head_sizes())
        self._head_ends = np.cumsum(pressed.nvec)[:-1]
        mask = spaces.Tuple([spaces.MultiBinary(int(count)) for count in pressed.nvec])
        seen = observation_space(self._arrays, self._observations, mask)
        self.observation_spaces = {agent: seen for agent in self.possible_agents}
        self.action_spaces = {agent: pressed for agent in self.possible_agents}
        self.state_space = spaces.Box(-np.inf, np.inf, self._arrays["state"].shape[1:], np.float32)
        self._has_begun = False
        self._seed: int | None = None
        self._episode = 0

    def observation_space(self, agent: str) -> spaces.Space:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], dict[str, dict]]:
        """Begins an episode. With a seed: the first that follows from it; without: the next one. options={"episode_seed": n}
        begins the very episode that an Episode or `comrad eval --episodes_file` names."""
        exact = (options or {}).get("episode_seed")
        if exact is not None:
            self._batch.reset([(checked_seed(exact), None)])
        else:
            if seed is not None or self._seed is None:
                self._seed, self._episode = fresh_seed() if seed is None else checked_seed(seed), 0
            else:
                self._episode += 1
            self._batch.reset([(self._seed, self._episode)])
        self._has_begun = True
        self.agents = list(self.possible_agents)
        self._show()
        return self._see(), self._infos()

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Observations, rewards, terminations, truncations, infos, each by agent. `actions`: one for each agent, integers [heads]."""
        if not isinstance(actions, Mapping):
            raise TypeError(f"actions is a {type(actions).__name__}; a dictionary is wanted, an action for each agent")
        if self.agents:
            missing = [agent for agent in self.agents if agent not in actions]
            if missing:
                raise ValueError(f"actions: {missing[0]} is missing; every agent of {', '.join(self.agents)} presses something")
        heads = self.action_spaces[self.possible_agents[0]].shape
        rows = []
        for agent in self.possible_agents:
            row = np.asarray(actions[agent]) if agent in actions else np.zeros(heads, np.int32)
            if row.shape != heads or not np.issubdtype(row.dtype, np.integer):
                raise ValueError(f"action of {agent}: {heads[0]} integers are wanted, a choice for each head, not {actions[agent]!r}")
            rows.append(row)
        self._batch.send(np.ascontiguousarray([rows], np.int32))
        self._batch.receive()
        rewards = {agent: float(self._arrays["reward"][0, index]) for index, agent in enumerate(self.agents)}
        terminated, truncated = bool(self._arrays["terminated"][0]), bool(self._arrays["truncated"][0])
        seen, infos = self._see(), self._infos(is_over=terminated or truncated)
        answer = (
            seen,
            rewards,
            {agent: terminated for agent in self.agents},
            {agent: truncated for agent in self.agents},
            infos,
        )
        if terminated or truncated:
            self.agents = []
        self._show()
        return answer

    def state(self) -> np.ndarray:
        """The true state, f32 [S], as `state_names` says. Raises ValueError before the first reset()."""
        if not self._has_begun:
            raise ValueError("call reset() before state()")
        return self._arrays["state"][0].copy()

    def labels(self, agent: str) -> list[Label]:
        """The things in an agent's picture of labels, by rising value. Raises ValueError where labels are not observed."""
        if agent not in self.possible_agents:
            raise ValueError(f"agent {agent!r} is none of {', '.join(self.possible_agents)}")
        return self._labels_of(self.possible_agents.index(agent))

    def set_state(self, state: SavedState) -> dict[str, Any]:
        """Goes back to a state; returns what the agents see there."""
        self._batch.set_state(0, checked_state(state))
        self._has_begun = True
        is_over = bool(self._arrays["terminated"][0] or self._arrays["truncated"][0])
        self.agents = [] if is_over else list(self.possible_agents)
        return {agent: self._seen_by(index) for index, agent in enumerate(self.possible_agents)}

    def _see(self) -> dict[str, Any]:
        return {agent: self._seen_by(index) for index, agent in enumerate(self.agents)}

    def _seen_by(self, index: int) -> Any:
        """A copy of what one agent sees."""
        screen = self._arrays["picture"][0, index].copy()
        if not self._observations:
            return screen
        seen: dict[str, Any] = {SCREEN_NAME: screen}
        for name in self._observations:
            if name == "action_mask":
                allowed = self._arrays["action_mask"][0, index].astype(np.int8)
                seen[name] = tuple(np.split(allowed, self._head_ends))
            else:
                seen[name] = self._arrays[ARRAYS[name]][0, index].copy()
        return seen

    def _infos(self, is_over: bool = False) -> dict[str, dict]:
        infos: dict[str, dict[str, Any]] = {}
        for index, agent in enumerate(self.agents):
            infos[agent] = {"active": bool(self._arrays["active"][0, index])}
            if is_over:
                infos[agent]["episode"] = {
                    "score": float(self._arrays["score"][0]),
                    "ceiling": float(self._arrays["ceiling"][0]),
                    "return": float(self._arrays["agent_return"][0, index]),
                    "length_tics": int(self._arrays["length_tics"][0]),
                }
        return infos
