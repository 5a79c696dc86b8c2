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
from .actions import FlatActions
from .arguments import checked_seed, checked_size, checked_state, checked_whole
from .batch import (
    ARRAYS,
    Batched,
    Key,
    SCREEN_NAME,
    TICS_A_SECOND,
    arguments_of,
    checked_dtype,
    checked_mode,
    make_batch,
    observation_space,
    picture_as,
    side_by_side,
)
from .labels import Label
from .maps import Layout


def usable_cores() -> int:
    return len(os.sched_getaffinity(0))


class ComradVectorEnv(Batched, gymnasium.vector.VectorEnv):
    """`num_envs` environments E of one scenario, stepped and drawn by `num_threads` threads (None: the cores of this process).

    Observations, rewards and endings are arrays over environments; of a scenario with N agents each has a further axis [E, N, ...]
    behind the first, and rewards are [E, N] f32. With one agent (num_agents=1, a ViZDoom .cfg) that axis is left out and rewards are
    [E] f64, as Gymnasium has it. Actions are integers [E, N, heads] ([E, heads] with one agent), choices as in ComradParallelEnv.

    Other options are those of ComradParallelEnv, except that "action_mask" is i8 [..., A] over the choices of all heads behind one
    another; with flat_actions actions are [E, N] ([E]) and masks [..., combinations].

    copy            True: what step() returns is the caller's. False: it is the memory that the engine writes to, without a copy and
                    valid until the next step, for NumPy and everything that speaks DLPack (torch.from_dlpack(observation))
    layout          as in ComradParallelEnv; environment e plays map (e + k E) mod count in the k-th episode of its seed
    team_reward     True: rewards are [E] f64, the sum over agents, as Gymnasium's wrappers of rewards want them
    autoreset_mode  gymnasium.vector.AutoresetMode or its value. "NextStep": the step after an episode's last ignores its action,
                    returns the next one's first observation, and rewards of 0. "SameStep": the last step returns the next episode's
                    first observation; infos["final_obs"] [E] (objects, None where no episode ended) and infos["final_info"] hold the
                    last one's. "Disabled": reset(options={"reset_mask": bool [E]}) begins the next episodes

    infos["active"] [E, N], infos["state"] [E, S]. In the step that ends episodes, infos (in SameStep infos["final_info"]) hold `score`,
    `ceiling`, `score_share`, `episode_length` and `length_tics` [E] and `episode_return` [E, N], each with a mask of those that ended,
    `_score` and so on, [E].

    send(actions) and recv() are step() in two halves, to do something else meanwhile. send(actions, env_ids) steps some environments,
    and recv(min_envs) returns those that are done, at least so many: the asynchronous mode of EnvPool.

    Copies: as ComradParallelEnv; every environment must be before its first step or reset.
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
        dtype: str = "uint8",
        channels_first: bool = False,
        observations: Sequence[str] = (),
        automap_mode: str = "",
        folder: str | os.PathLike | None = None,
        copy: bool = True,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (320, 180),
        reward: str = "",
        heads: str = "",
        flat_actions: bool = False,
        team_reward: bool = False,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        arguments = arguments_of(locals())
        self.render_mode = checked_mode(render_mode, self.metadata)
        self._render_size = checked_size("render_size", render_size)
        num_envs = checked_whole("num_envs", num_envs)
        self._copy, self._dtype = bool(copy), checked_dtype(dtype)
        if dtype != "uint8" and not copy:
            raise ValueError(f"copy=False returns the engine's own uint8; dtype {dtype!r} requires copy=True")
        self._mode = _checked_autoreset(autoreset_mode)
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
            num_envs=num_envs,
            num_threads=usable_cores() if num_threads is None else checked_whole("num_threads", num_threads),
            autoreset=self._mode == AutoresetMode.NEXT_STEP,
            reward=reward,
            heads=heads,
        )
        self._take(batch, arguments)
        self._observations = tuple(observations)
        self.num_envs = num_envs
        self.num_agents: int = self._batch.facts()["num_agents"]
        fps = max(1, round(TICS_A_SECOND / frame_skip))
        self.metadata = {**self.metadata, "autoreset_mode": self._mode, "render_fps": fps}
        self.state_names: list[str] = self._batch.state_names()
        head_sizes = batch.head_sizes()
        self._flat = FlatActions(head_sizes) if flat_actions else None
        self._sums_rewards = bool(team_reward)
        mask = spaces.MultiBinary(self._flat.count if self._flat else sum(head_sizes))
        agent_sees = observation_space(self._arrays, self._observations, mask, dtype)
        alone = self.num_agents == 1
        choices = np.asarray(self._flat.count if self._flat else head_sizes)  # of one agent
        row = choices if alone else np.broadcast_to(choices, (self.num_agents, *choices.shape))
        self._action_shape = row.shape
        self.single_observation_space = agent_sees if alone else batch_space(agent_sees, self.num_agents)
        self.single_action_space = spaces.Discrete(int(row)) if row.ndim == 0 else spaces.MultiDiscrete(row)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = spaces.MultiDiscrete(np.broadcast_to(row, (num_envs, *row.shape)))
        self._is_over = np.zeros(num_envs, bool)
        self._sends_some = False  # the last send() was to some environments

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Begins an episode in every environment. With a seed: in number i the first of seed + i, or of seed[i]; without, and where
        seed[i] is None: the next one of its seed. options={"reset_mask": bool [E]} leaves the others as they are."""
        following = self._next_keys()
        keys: list[Key]
        if seed is None:
            keys = following
        elif isinstance(seed, (int, np.integer)):
            keys = [(checked_seed(int(seed) + index), 0) for index in range(self.num_envs)]
        else:
            if len(seed) != self.num_envs:
                raise ValueError(f"{len(seed)} seeds were given for {self.num_envs} environments")
            keys = [key if one is None else (checked_seed(one), 0) for one, key in zip(seed, following)]
        mask = np.ones(self.num_envs, bool)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != bool:
                raise ValueError(f"reset_mask: {self.num_envs} booleans are wanted")
        self._begin([key if begins else None for key, begins in zip(keys, mask)])
        self._is_over = np.where(mask, False, self._is_over)
        return self._see(), self._infos()

    def send(self, actions: np.ndarray, env_ids: Sequence[int] | np.ndarray | None = None) -> None:
        """Begins a step in every environment, or in those of `env_ids` [n] alone, and comes back at once. `actions`: as action_space,
        with n rows. Raises ValueError for wrong shapes, dtypes and choices, and for environments whose step is on its way."""
        actions = np.asarray(actions)
        indices = None if env_ids is None else [checked_whole("an environment's index", one) for one in env_ids]
        shape = (self.num_envs if indices is None else len(indices), *self._action_shape)
        if actions.shape != shape or not np.issubdtype(actions.dtype, np.integer):
            raise ValueError(f"actions are {actions.dtype} {actions.shape}; integers {shape} are wanted")
        choices = self._flat.choices(actions) if self._flat else actions
        choices = np.ascontiguousarray(choices.reshape(shape[0], self.num_agents, -1), np.int32)
        if indices is None:
            self._batch.send(choices)
        elif self._mode == AutoresetMode.SAME_STEP:
            raise ValueError('send() to some environments has no autoreset_mode "SameStep"; make them with "NextStep" or "Disabled"')
        else:
            self._batch.send_some(indices, choices)
        self._sends_some = indices is not None
        self._stepped()

    def recv(self, min_envs: int | None = None) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        """What the step that was sent brought: observations, rewards, terminations, truncations, infos. After send() to some
        environments: of those that are done, rows [n] in rising order with infos["env_id"] [n], as soon as `min_envs` are (None: all
        that were sent). Raises ValueError where nothing was sent."""
        if self._sends_some:
            wanted = self.num_envs if min_envs is None else checked_whole("min_envs", min_envs)
            if wanted < 1:
                raise ValueError(f"min_envs is {wanted}; wait for 1 or more")
            return self._result(np.array(self._batch.receive_some(wanted)))
        if min_envs is not None:
            raise ValueError("min_envs counts environments that were sent a step by send(actions, env_ids); no step was sent so")
        self._batch.receive()
        result = self._result()
        return self._restarted(result) if self._mode == AutoresetMode.SAME_STEP and self._is_over.any() else result

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        self.send(actions)
        return self.recv()

    def _result(self, rows: np.ndarray | None = None) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Of all environments, or of those of `rows`."""
        chosen = slice(None) if rows is None else rows
        terminated, truncated = self._arrays["terminated"][chosen].astype(bool), self._arrays["truncated"][chosen].astype(bool)
        self._is_over[chosen] = terminated | truncated
        reward = self._mine(self._arrays["reward"], rows)
        if self._sums_rewards and self.num_agents > 1:
            reward = reward.sum(-1, dtype=np.float64)
        elif self.num_agents == 1:
            reward = reward.astype(np.float64)
        infos = self._infos(rows)
        if rows is not None:
            infos["env_id"] = rows
        return self._see(rows), reward, terminated, truncated, infos

    def _restarted(self, result: tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Begins the episodes that follow those that ended; `result` with their first observations, and the last ones in infos."""
        seen, reward, terminated, truncated, infos = result
        over = self._is_over.copy()
        final = np.full(self.num_envs, None, object)
        for index in np.flatnonzero(over):
            final[index] = {name: values[index].copy() for name, values in seen.items()} if self._observations else seen[index].copy()
        reward = reward.copy()  # where copy=False, the engine's own
        infos = {name: value.copy() for name, value in infos.items()}
        infos.update({"_active": over, "_state": over})
        self._begin([key if ended else None for key, ended in zip(self._next_keys(), over)])
        self._is_over[:] = False
        more = {"final_obs": final, "_final_obs": over, "final_info": infos, "_final_info": over}
        return self._see(), reward, terminated, truncated, {**self._infos(), **more}

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
        self._has_begun = True
        self._stepped()
        self._is_over[index] = self._arrays["terminated"][index] or self._arrays["truncated"][index]

    def labels(self, index: int, agent: int = 0) -> list[Label]:
        """The things in the picture of labels of an agent of one environment, by rising value. Raises ValueError where labels are not
        observed, and for indices outside."""
        return [Label(*values) for values in self._batch.labels(index, agent)]

    def observe(self) -> Any:
        """What is seen now."""
        return self._see()

    def close_extras(self, **_: Any) -> None:
        self._batch.close()

    def _mine(self, values: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """Those of `rows`, without the agents' axis where there is one agent; a copy where those are wanted."""
        values = values[:, 0] if self.num_agents == 1 else values
        if rows is not None:
            return values[rows]
        return values.copy() if self._copy else values

    def _see(self, rows: np.ndarray | None = None) -> Any:
        screen = picture_as(self._mine(self._arrays["picture"], rows), self._dtype)
        if not self._observations:
            return screen
        seen = {SCREEN_NAME: screen}
        for name in self._observations:
            values = self._mine(self._arrays[ARRAYS[name]], rows)
            if name == "action_mask":
                seen[name] = self._flat.mask(values) if self._flat else values.view(np.int8)
            else:
                seen[name] = picture_as(values, self._dtype) if name == "automap" else values
        return seen

    def _infos(self, rows: np.ndarray | None = None) -> dict[str, Any]:
        chosen = slice(None) if rows is None else rows
        state = self._arrays["state"][chosen]
        infos: dict[str, Any] = {
            "active": self._mine(self._arrays["active"], rows).view(bool),
            "state": state.copy() if self._copy else state,
        }
        over = self._is_over[chosen]
        if over.any():
            for name, values in self._account().items():
                infos[name] = self._mine(values, rows) if name == "episode_return" else values[chosen]
                infos[f"_{name}"] = over.copy()
        return infos


def _checked_autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        raise ValueError(f"autoreset_mode {mode!r}: it is one of {', '.join(repr(one.value) for one in AutoresetMode)}") from None
