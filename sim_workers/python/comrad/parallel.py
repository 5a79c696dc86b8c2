"""Scenarios as PettingZoo's ParallelEnv."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from ._engine import SavedState
from .actions import FlatActions
from .arguments import checked_size, checked_state
from .batch import (
    ARRAYS,
    OneGame,
    SCREEN_NAME,
    TICS_A_SECOND,
    Key,
    arguments_of,
    checked_dtype,
    checked_mode,
    make_batch,
    observation_space,
    picture_as,
)
from .labels import Label
from .maps import Layout
from .window import Window


class ComradParallelEnv(OneGame, ParallelEnv):
    """N agents, "agent_0" to "agent_{N-1}", that see, press and earn at once; one step is `frame_skip` tics of 1/35 s.

    scenario      a name (with a variant: "lava_pit@reference"), an id ("comrad/LavaPit-v1"), the path of a folder with a
                  scenario.toml, or of a ViZDoom .cfg
    num_agents    N; None: what the scenario is made for
    layout        the map: a seed, {"seed": 7, "radius": 1200} (parameters of the recipe), a WAD, a folder of WADs or several WADs,
                  which the episodes of a seed play in turn, from the first; so are all maps of one WAD where a .cfg has no doom_map.
                  None: the default map, seed 42
    render_mode   "rgb_array": render() returns all views side by side, [h, N w, 3] u8, drawn at `render_size` (width, height);
                  "human": every step shows them in a window (needs pygame)
    frame_skip    tics of a step
    size          (width, height) of the pictures that agents see
    dtype         of pictures: "uint8", 0..255, or "float32", 0..1
    channels_first  pictures are [3, h, w], not [h, w, 3]
    observations  what is seen beside the picture: "depth" [h, w] f32 (map units, 0 for sky), "labels" [h, w] u8 (labels(agent) lists
                  what the values mean), "automap", another picture, "measurements" [M] f32, "action_mask", a tuple of i8 [choices]
                  for each head, as action_space(agent).sample(mask=...) takes it, "agent_id" [N] f32, 1 at the agent's own index.
                  With any of them an observation is a dictionary with the picture as "screen", else the picture itself
    automap_mode  "NORMAL" (walls that the agent has seen), "WHOLE", "OBJECTS" or "OBJECTS_WITH_SIZE"; "": NORMAL, or as a .cfg sets
    folder        where the .cfg of that name lies: parallel_env("my_game", folder="my_games")
    reward        weights of reward terms in place of the scenario's, as comrad train's --reward: "kills=2,living=0"
    heads         action heads in place of the scenario's, as --heads
    flat_actions  True: an action is Discrete, a number for every combination of the heads' choices, the last head's changing fastest
                  (comrad.FlatActions); an action mask is i8 [combinations]

    An action is MultiDiscrete: a choice for each head, 0 presses nothing (comrad.describe() names the buttons). All agents stay
    until the episode's end, which is common to all; one that died and does not come back has infos[agent]["active"] False and what
    it presses changes nothing. infos[agent] also hold, of the episode so far and in the last step of all of it, `score` J, `ceiling`,
    their ratio `score_share` (NaN without a ceiling), the agent's `episode_return`, `episode_length` in steps and `length_tics`.
    state() is the true state of the world, f32 [S], as `state_names` describes: positions, angles, speeds, health, and what the scenario's
    script exports.

    The same seed, map and actions give the same episode, to the bit. Before the first step, and after any reset(), copy.deepcopy and
    pickle make an equal environment; in the middle of an episode they raise TypeError. Other errors: ValueError, FileNotFoundError,
    TypeError, each saying what to do.
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
        dtype: str = "uint8",
        channels_first: bool = False,
        observations: Sequence[str] = (),
        automap_mode: str = "",
        folder: str | os.PathLike | None = None,
        reward: str = "",
        heads: str = "",
        flat_actions: bool = False,
    ) -> None:
        arguments = arguments_of(locals())
        self.render_mode = checked_mode(render_mode, self.metadata)
        self._window = Window(f"comrad: {scenario}") if render_mode == "human" else None
        self._render_size = checked_size("render_size", render_size)
        self._dtype = checked_dtype(dtype)
        batch = make_batch(
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
        self._take(batch, arguments)
        self._observations = tuple(observations)
        facts = self._batch.facts()
        self.scenario = facts["name"]
        self.metadata = {**self.metadata, "name": f"comrad_{self.scenario}", "render_fps": max(1, round(TICS_A_SECOND / frame_skip))}
        self.possible_agents = [f"agent_{index}" for index in range(facts["num_agents"])]
        self.agents: list[str] = []
        self.state_names: list[str] = self._batch.state_names()
        self.np_random, _ = seeding.np_random()  # for wrappers that draw, as SuperSuit's; the world has its own
        head_sizes = batch.head_sizes()
        self._flat = FlatActions(head_sizes) if flat_actions else None
        self._head_ends = np.cumsum(head_sizes)[:-1]
        pressed: spaces.Space = spaces.MultiDiscrete(head_sizes)
        mask: spaces.Space = spaces.Tuple([spaces.MultiBinary(count) for count in head_sizes])
        if self._flat:
            pressed, mask = spaces.Discrete(self._flat.count), spaces.MultiBinary(self._flat.count)
        seen = observation_space(self._arrays, self._observations, mask, self._dtype)
        self.observation_spaces = {agent: seen for agent in self.possible_agents}
        self.action_spaces = {agent: pressed for agent in self.possible_agents}
        self.state_space = spaces.Box(-np.inf, np.inf, self._arrays["state"].shape[1:], np.float32)

    def observation_space(self, agent: str) -> spaces.Space:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], dict[str, dict]]:
        """Begins an episode. With a seed: the first that follows from it; without: the next one. options={"episode_seed": n}
        begins the very episode that an Episode or `comrad eval --episodes_file` names."""
        self._reset(seed, options)
        if seed is not None:
            self.np_random, _ = seeding.np_random(seed)
        self._show()
        return self._see(), self._infos()

    def _begin(self, keys: Sequence[Key | None]) -> None:
        super()._begin(keys)
        self.agents = list(self.possible_agents)

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Observations, rewards, terminations, truncations, infos, each by agent. `actions`: one for each agent, integers [heads], with
        flat_actions an integer. After the end no agent is left, and no action gives empty dictionaries, as PettingZoo has it."""
        if not isinstance(actions, Mapping):
            raise TypeError(f"actions is a {type(actions).__name__}; a dictionary is wanted, an action for each agent")
        if self._has_begun and not self.agents and not actions:
            return {}, {}, {}, {}, {}
        if self.agents:
            missing = [agent for agent in self.agents if agent not in actions]
            if missing:
                raise ValueError(f"actions: {missing[0]} is missing; every agent of {', '.join(self.agents)} presses something")
        shape: tuple[int, ...] = () if self._flat else (len(self._head_ends) + 1,)
        rows = []
        for agent in self.possible_agents:
            row = np.asarray(actions[agent]) if agent in actions else np.zeros(shape, np.int32)
            if row.shape != shape or not np.issubdtype(row.dtype, np.integer):
                wanted = "an integer is wanted" if self._flat else f"{shape[0]} integers are wanted, a choice for each head"
                raise ValueError(f"action of {agent}: {wanted}, not {actions[agent]!r}")
            rows.append(row)
        choices = self._flat.choices(np.stack(rows)) if self._flat else np.stack(rows)
        self._batch.send(np.ascontiguousarray(choices[None], np.int32))
        self._stepped()
        self._batch.receive()
        rewards = {agent: float(self._arrays["reward"][0, index]) for index, agent in enumerate(self.agents)}
        terminated, truncated = bool(self._arrays["terminated"][0]), bool(self._arrays["truncated"][0])
        seen, infos = self._see(), self._infos()
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
        """The true state, f32 [S], as `state_names` describes. Raises ValueError before the first reset()."""
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
        self._stepped()
        is_over = bool(self._arrays["terminated"][0] or self._arrays["truncated"][0])
        self.agents = [] if is_over else list(self.possible_agents)
        return {agent: self._seen_by(index) for index, agent in enumerate(self.possible_agents)}

    def _see(self) -> dict[str, Any]:
        return {agent: self._seen_by(index) for index, agent in enumerate(self.agents)}

    def _seen_by(self, index: int) -> Any:
        """A copy of what one agent sees."""
        screen = picture_as(self._arrays["picture"][0, index].copy(), self._dtype)
        if not self._observations:
            return screen
        seen: dict[str, Any] = {SCREEN_NAME: screen}
        for name in self._observations:
            if name == "action_mask":
                allowed = self._arrays["action_mask"][0, index].astype(np.int8)
                seen[name] = self._flat.mask(allowed) if self._flat else tuple(np.split(allowed, self._head_ends))
            else:
                values = self._arrays[ARRAYS[name]][0, index].copy()
                seen[name] = picture_as(values, self._dtype) if name == "automap" else values
        return seen

    def _infos(self) -> dict[str, dict]:
        # The same names in every step: TorchRL fixes them at the first reset.
        active = self._arrays["active"][0].astype(bool).tolist()
        return {agent: {"active": one, **account} for agent, one, account in zip(self.agents, active, self._accounts())}
