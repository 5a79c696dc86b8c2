"""What all environments share: making an EnvBatch, its spaces, seeds and observations."""

import os
import secrets
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from . import _engine
from .arguments import checked_seed, checked_size, checked_text, checked_whole
from .labels import Label
from .maps import Layout, vizdoom_cfg, wads_of
from .window import Window

ARRAYS = {  # by what is wanted beside the picture
    "depth": "depth",
    "labels": "labels",
    "automap": "automap",
    "measurements": "measurement",
    "action_mask": "action_mask",
    "agent_id": "agent_id",
}
DTYPES = ("uint8", "float32")
TICS_A_SECOND = 35
MOST_DEPTH = 1e5  # map units; no map is as wide
SCREEN_NAME = "screen"
COPIES = (
    "an environment in the middle of an episode can be neither copied nor pickled: its world lives in threads of this process. Copy it "
    "before the first step or after reset(); in this process another one can continue from its get_state(), by set_state()"
)
Key = tuple[int, int | None]  # an episode: the number-th that follows from a seed, or (its own seed, None)


def make_batch(
    scenario: str | os.PathLike,
    *,
    num_agents: int | None,
    layout: Layout | None,
    frame_skip: int,
    size: tuple[int, int],
    observations: Sequence[str],
    folder: str | os.PathLike | None = None,
    **options: Any,
) -> _engine.EnvBatch:
    """An EnvBatch; `observations` are those of ARRAYS that are wanted beside the picture. What a .cfg requests and COMRAD lacks is
    a UserWarning. Raises ValueError, FileNotFoundError."""
    if isinstance(observations, str):
        raise TypeError(f"observations is a list of names, as ({observations!r},)")
    unknown = [name for name in observations if name not in ARRAYS]
    if unknown:
        raise ValueError(f"observations: {unknown[0]!r} is none of {', '.join(ARRAYS)}")
    scenario = vizdoom_cfg(scenario, folder)
    facts = _engine.describe(scenario)
    for text in facts.get("warnings", ()):
        warnings.warn(f"comrad: {text}", stacklevel=4)  # where the environment is made
    if facts.get("is_gray") and not options.get("by_buttons"):
        warnings.warn(f"comrad: {scenario}: screen_format = GRAY8, but pictures are RGB here; comrad.gym_env has gray ones", stacklevel=4)
    agents = facts["num_agents"] if num_agents is None else checked_whole("num_agents", num_agents)
    if agents < 1:
        raise ValueError(f"num_agents is {agents}; a team has 1 or more")
    for name in ("automap_mode", "reward", "heads"):
        checked_text(name, options.get(name, ""))
    width, height = checked_size("size", size)
    return _engine.EnvBatch(
        scenario=scenario,
        maps=wads_of(scenario, layout, agents),
        num_agents=agents,
        frame_skip=checked_whole("frame_skip", frame_skip),
        width=width,
        height=height,
        depth="depth" in observations,
        labels="labels" in observations,
        automap="automap" in observations,
        **options,
    )


def arguments_of(scope: dict[str, Any]) -> dict[str, Any]:
    """What a constructor was called with; `scope` is locals() in its first line."""
    return {name: value for name, value in scope.items() if name not in ("self", "__class__")}


def checked_dtype(dtype: str) -> str:
    if dtype not in DTYPES:
        raise ValueError(f"dtype {dtype!r}: it is one of {', '.join(DTYPES)}")
    return dtype


def picture_space(picture: np.ndarray, dtype: str) -> spaces.Box:
    """Of one agent's picture, the last three axes of `picture`."""
    return spaces.Box(0, 255 if dtype == "uint8" else 1, picture.shape[-3:], np.dtype(dtype).type)


def picture_as(picture: np.ndarray, dtype: str) -> np.ndarray:
    """A picture u8 as it is, or f32 in 0..1."""
    return picture if dtype == "uint8" else picture.astype(np.float32) / np.float32(255)


def gray(pictures: np.ndarray, axis: int) -> np.ndarray:
    """Pictures u8 with one channel on `axis` in place of three: ViZDoom's GRAY8 to the last digit."""
    red, green, blue = np.split(pictures, 3, axis)
    return (0.21 * red + 0.72 * green + 0.07 * blue).astype(np.uint8)


def observation_space(arrays: dict[str, np.ndarray], observations: tuple[str, ...], mask: spaces.Space, dtype: str) -> spaces.Space:
    """Of one agent: a Box for the picture alone, a Dict where more is wanted; `mask` is the space of its action mask."""
    screen = picture_space(arrays["picture"], dtype)
    if not observations:
        return screen
    boxes: dict[str, spaces.Space] = {SCREEN_NAME: screen}
    for name in observations:
        if name == "depth":
            boxes[name] = spaces.Box(0, MOST_DEPTH, arrays["depth"].shape[2:], np.float32)
        elif name == "labels":
            boxes[name] = spaces.Box(0, 255, arrays["labels"].shape[2:], np.uint8)
        elif name == "automap":
            boxes[name] = picture_space(arrays["automap"], dtype)
        elif name == "agent_id":
            boxes[name] = spaces.Box(0, 1, arrays["agent_id"].shape[2:], np.float32)
        elif name == "measurements":
            boxes[name] = spaces.Box(-np.inf, np.inf, arrays["measurement"].shape[2:], np.float32)
        else:
            boxes[name] = mask
    return spaces.Dict(boxes)


def checked_mode(render_mode: str | None, metadata: dict[str, Any]) -> str | None:
    if render_mode not in (None, *metadata["render_modes"]):
        raise ValueError(f"render_mode {render_mode!r}: it is None or one of {', '.join(metadata['render_modes'])}")
    return render_mode


def side_by_side(planes: np.ndarray) -> np.ndarray:
    """[N, 3, h, w] to one picture [h, N w, 3]."""
    return np.ascontiguousarray(np.concatenate(list(planes.transpose(0, 2, 3, 1)), axis=1))


class Batched:
    """What all environments share: their arrays, how episodes begin and end, copies."""

    _batch: _engine.EnvBatch
    _arrays: dict[str, np.ndarray]
    _arguments: dict[str, Any]

    def _take(self, batch: _engine.EnvBatch, arguments: dict[str, Any]) -> None:
        """Serves `batch`; `arguments` of the constructor make it again."""
        self._batch, self._arguments = batch, arguments
        arrays = batch.arrays()
        envs, agents = arrays["active"].shape
        self._arrays = {**arrays, "agent_id": np.tile(np.eye(agents, dtype=np.float32), (envs, 1, 1))}
        self._has_begun = self._is_stepped = False
        self._begun: list[Key | None] = [None] * envs  # episodes that were begun and not stepped

    def _begin(self, keys: Sequence[Key | None]) -> None:
        """Begins the episodes `keys`; where there is none, an environment stays as it is."""
        self._batch.reset(list(keys))
        self._has_begun = True
        self._begun = [old if new is None else new for old, new in zip(self._begun, keys)]
        self._is_stepped = self._is_stepped and None in self._begun

    def _stepped(self) -> None:
        self._is_stepped = True
        self._begun = [None] * len(self._begun)

    def _next_keys(self) -> list[Key]:
        """The episode that follows in each environment; before the first, those of a seed drawn at random."""
        if not self._has_begun:
            seed = secrets.randbits(62)
            return [(seed + index, 0) for index in range(len(self._begun))]
        return [(seed, number + 1) for seed, number in zip(self._arrays["stream_seed"].tolist(), self._arrays["episode_number"].tolist())]

    def _account(self) -> dict[str, np.ndarray]:
        """Of the episodes that ended or continue: score J [E], the map's ceiling [E], their ratio [E] (NaN without a ceiling), returns
        [E, N], lengths in steps and in tics [E]."""
        score, ceiling = self._arrays["score"], self._arrays["ceiling"]
        share = np.divide(score, ceiling, out=np.full_like(score, np.nan), where=ceiling > 0)
        return {
            "score": score.copy(),
            "ceiling": ceiling.copy(),
            "score_share": share,
            "episode_return": self._arrays["agent_return"].copy(),
            "episode_length": self._arrays["length_steps"].astype(np.int64),
            "length_tics": self._arrays["length_tics"].astype(np.int64),
        }

    def __reduce_ex__(self, _: Any) -> Any:
        if self._is_stepped:
            raise TypeError(COPIES)
        return _made_again, (type(self), self._arguments, self._begun)


def _made_again(kind: type, arguments: dict[str, Any], begun: list[Key | None]) -> Any:
    env = kind(**arguments)
    if any(begun):
        env._begin(begun)
    return env


class OneGame(Batched):
    """What an environment of one game has, whosever interface it serves: pictures for eyes, states, its end."""

    render_mode: str | None
    _window: Window | None
    _render_size: tuple[int, int]

    def render(self) -> np.ndarray | None:
        """The views of all agents side by side, [h, N w, 3] u8, where render_mode is "rgb_array"."""
        return self._picture() if self.render_mode == "rgb_array" else None

    def get_state(self) -> _engine.SavedState:
        """The whole world as it stands, to come back to with set_state(), in this environment or another of the same scenario."""
        return self._batch.get_state(0)

    def _labels_of(self, agent: int) -> list[Label]:
        return [Label(*values) for values in self._batch.labels(0, agent)]

    def state_hash(self) -> int:
        """A hash of the whole world: two episodes with equal hashes at every step were the same."""
        return self._batch.hash(0)

    def _reset(self, seed: int | None, options: dict[str, Any] | None) -> None:
        """With a seed: the first episode that follows from it; without: the next one; options={"episode_seed": n}: that very one."""
        exact = (options or {}).get("episode_seed")
        if exact is not None:
            self._begin([(checked_seed(exact), None)])
        else:
            self._begin(self._next_keys() if seed is None else [(checked_seed(seed), 0)])

    def _accounts(self) -> list[dict[str, float | int]]:
        """Each agent's numbers of the episode so far."""
        account = self._account()
        returns = account.pop("episode_return")[0].tolist()
        shared = {name: values[0].item() for name, values in account.items()}
        return [{**shared, "episode_return": own} for own in returns]

    def close(self) -> None:
        self._batch.close()
        if self._window:
            self._window.close()

    def _show(self) -> None:
        if self._window:
            self._window.show(self._picture())

    def _picture(self) -> np.ndarray:
        return side_by_side(self._batch.draw(0, *self._render_size))
