"""Many environments behind one call, as Gymnasium's VectorEnv."""

import os
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from ._engine import SavedState
from .arguments import checked_seed, checked_size, checked_state, checked_whole
from .batch import ARRAYS, SCREEN_NAME, COPIES, checked_mode, fresh_seed, make_batch, observation_space, side_by_side
from .labels import Label
from .maps import Layout


def usable_cores() -> int:
    return len(os.sched_getaffinity(0))


class ComradVectorEnv(gymnasium.vector.VectorEnv):
    """`num_envs` environments E of one scenario, stepped and drawn by `num_threads` threads (None: the cores of this process).

    Observations, rewards and endings are arrays over environments; of a scenario with N agents each has a further axis [E, N, ...]
    behind the first, and rewards are [E, N] f32. With one agent (num_agents=1, a ViZDoom .cfg) that axis is left out and rewards are
    [E] f64, as Gymnasium has it. Actions are integers [E, N, heads] ([E, heads] with one agent), choices as in ComradParallelEnv.

    observations, automap_mode and folder are those of ComradParallelEnv, except that "action_mask" is i8 [..., A] over the choices
    of all heads behind one another.

    copy      True: what step() returns is the caller's. False: it is the memory that the engine writes to, without a copy and
              valid until the next step, for NumPy and everything that speaks DLPack (torch.from_dlpack(observation))
    layout    a seed, parameters, or WADs as in ComradParallelEnv; environment e plays map (e + k E) mod count in its k-th episode

    Episodes begin again by themselves as AutoresetMode.NEXT_STEP says: the step after the last one ignores its action, returns the
    new episode's first observation, and rewards of 0. In the step that ends episodes, infos["episode"] holds score, ceiling, return
    and length in tics of each environment, and infos["_episode"] [E] says whose count. infos["active"] [E, N], infos["state"] [E, S].

    send(actions) and receive() are step() in two halves, to do something else meanwhile.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        scenario: str | os.PathLike,
        *,
        num_envs: int = 16,
        num_threads: int | None = None,
        num_agents: int | None = None,
        layout: Layout | None = None,
        frame_skip: int = 4,
        size: tuple[int, int] = (128, 72),
        channels_first: bool = False,
        observations: Sequence[str] = (),
        automap_mode: str = "",
        folder: str | os.PathLike | None = None,
        copy: bool = True,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (320, 180),
        reward: str = "",
        heads: str = "",
    ) -> None:
        self.render_mode = checked_mode(render_mode, self.metadata)
        self._render_size = checked_size("render_size", render_size)
        num_envs = checked_whole("num_envs", num_envs)
        self._copy = bool(copy)
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
            num_envs=num_envs,
            num_threads=usable_cores() if num_threads is None else checked_whole("num_threads", num_threads),
            autoreset=True,
            reward=reward,
            heads=heads,
        )
        self._observations = tuple(observations)
        self._arrays = self._batch.arrays()
        self.num_envs = num_envs
        self.num_agents: int = self._batch.facts()["num_agents"]
        self.state_names: list[str] = self._batch.state_names()
        head_sizes = np.asarray(self._batch.head_sizes())
        mask = spaces.MultiBinary(int(head_sizes.sum()))
        agent_sees = observation_space(self._arrays, self._observations, mask)
        alone = self.num_agents == 1
        row = head_sizes if alone else np.tile(head_sizes, (self.num_agents, 1))
        self.single_observation_space = agent_sees if alone else batch_space(agent_sees, self.num_agents)
        self.single_action_space = spaces.MultiDiscrete(row)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = spaces.MultiDiscrete(np.tile(row, (num_envs, *[1] * row.ndim)))
        self._is_over = np.zeros(num_envs, bool)

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Begins an episode in every environment: in number i that of seed + i, or of seed[i]. options={"reset_mask": bool [E]}
        leaves the others as they are."""
        if seed is None:
            begin = fresh_seed() >> 1
            seeds = [begin + index for index in range(self.num_envs)]
        elif isinstance(seed, (int, np.integer)):
            seeds = [checked_seed(int(seed) + index) for index in range(self.num_envs)]
        else:
            seeds = [fresh_seed() if one is None else checked_seed(one) for one in seed]
            if len(seeds) != self.num_envs:
                raise ValueError(f"{len(seeds)} seeds were given for {self.num_envs} environments")
        mask = np.ones(self.num_envs, bool)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != bool:
                raise ValueError(f"reset_mask: {self.num_envs} booleans are wanted")
        self._batch.reset([(one, 0) if begins else None for one, begins in zip(seeds, mask)])
        self._is_over = np.where(mask, False, self._is_over)
        return self._see(), self._infos()

    def send(self, actions: np.ndarray) -> None:
        """Begins a step in every environment and comes back at once. Raises ValueError for wrong shapes, dtypes and choices."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape or not np.issubdtype(actions.dtype, np.integer):
            raise ValueError(f"actions are {actions.dtype} {actions.shape}; integers {self.action_space.shape} are wanted")
        self._batch.send(np.ascontiguousarray(actions.reshape(self.num_envs, self.num_agents, -1), np.int32))

    def receive(self) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        """What the step that was sent brought: observations, rewards, terminations, truncations, infos."""
        self._batch.receive()
        terminated, truncated = self._arrays["terminated"].astype(bool), self._arrays["truncated"].astype(bool)
        self._is_over = terminated | truncated
        reward = self._arrays["reward"]
        if self.num_agents == 1:
            reward = reward[:, 0].astype(np.float64)
        elif self._copy:
            reward = reward.copy()
        return self._see(), reward, terminated, truncated, self._infos()

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        self.send(actions)
        return self.receive()

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each environment, its agents side by side."""
        if self.render_mode is None:
            return None
        return tuple(side_by_side(self._batch.draw(index, *self._render_size)) for index in range(self.num_envs))

    def get_state(self, index: int) -> SavedState:
        """The whole world of one environment, to come back to with set_state()."""
        return self._batch.get_state(index)

    def set_state(self, index: int, state: SavedState) -> None:
        self._batch.set_state(index, checked_state(state))
        self._is_over[index] = self._arrays["terminated"][index] or self._arrays["truncated"][index]

    def labels(self, index: int, agent: int = 0) -> list[Label]:
        """The things in the picture of labels of an agent of one environment, by rising value. Raises ValueError where labels are not
        observed, and for indices outside."""
        return [Label(*values) for values in self._batch.labels(index, agent)]

    def __reduce_ex__(self, _: Any) -> Any:
        raise TypeError(COPIES)

    def observe(self) -> Any:
        """What is seen now."""
        return self._see()

    def close_extras(self, **_: Any) -> None:
        self._batch.close()

    def _mine(self, values: np.ndarray) -> np.ndarray:
        """Without the agents' axis where there is one agent; a copy where those are wanted."""
        values = values[:, 0] if self.num_agents == 1 else values
        return values.copy() if self._copy else values

    def _see(self) -> Any:
        screen = self._mine(self._arrays["picture"])
        if not self._observations:
            return screen
        seen = {SCREEN_NAME: screen}
        for name in self._observations:
            values = self._mine(self._arrays[ARRAYS[name]])
            seen[name] = values.view(np.int8) if name == "action_mask" else values
        return seen

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {
            "active": self._mine(self._arrays["active"]).view(bool),
            "state": self._arrays["state"].copy() if self._copy else self._arrays["state"],
        }
        if self._is_over.any():
            infos["episode"] = {
                "score": self._arrays["score"].copy(),
                "ceiling": self._arrays["ceiling"].copy(),
                "return": self._mine(self._arrays["agent_return"]),
                "length_tics": self._arrays["length_tics"].copy(),
            }
            infos["_episode"] = self._is_over.copy()
        return infos
