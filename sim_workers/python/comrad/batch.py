"""What all environments share: making an EnvBatch, its spaces, seeds and observations."""

import os
import secrets
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from . import _engine
from .arguments import checked_size, checked_text, checked_whole
from .labels import Label
from .maps import Layout, vizdoom_cfg, wads_of
from .window import Window

ARRAYS = {  # by what is wanted beside the picture
    "depth": "depth",
    "labels": "labels",
    "automap": "automap",
    "measurements": "measurement",
    "action_mask": "action_mask",
}
TICS_A_SECOND = 35
MOST_DEPTH = 1e5  # map units; no map is as wide
SCREEN_NAME = "screen"
COPIES = "an environment has threads and an OpenGL context and can be neither copied nor pickled; make another one, and give it get_state()'s answer"


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
    """An EnvBatch; `observations` are those of ARRAYS that are wanted beside the picture. What a .cfg asks for and COMRAD lacks is
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


def picture_space(picture: np.ndarray) -> spaces.Box:
    """Of one agent's picture, the last three axes of `picture`."""
    return spaces.Box(0, 255, picture.shape[-3:], np.uint8)


def observation_space(arrays: dict[str, np.ndarray], observations: tuple[str, ...], mask: spaces.Space) -> spaces.Space:
    """Of one agent: a Box for the picture alone, a Dict where more is wanted; `mask` is the space of its action mask."""
    screen = picture_space(arrays["picture"])
    if not observations:
        return screen
    boxes: dict[str, spaces.Space] = {SCREEN_NAME: screen}
    for name in observations:
        if name == "depth":
            boxes[name] = spaces.Box(0, MOST_DEPTH, arrays["depth"].shape[2:], np.float32)
        elif name == "labels":
            boxes[name] = spaces.Box(0, 255, arrays["labels"].shape[2:], np.uint8)
        elif name == "automap":
            boxes[name] = picture_space(arrays["automap"])
        elif name == "measurements":
            boxes[name] = spaces.Box(-np.inf, np.inf, arrays["measurement"].shape[2:], np.float32)
        else:
            boxes[name] = mask
    return spaces.Dict(boxes)


def checked_mode(render_mode: str | None, metadata: dict[str, Any]) -> str | None:
    if render_mode not in (None, *metadata["render_modes"]):
        raise ValueError(f"render_mode {render_mode!r}: it is None or one of {', '.join(metadata['render_modes'])}")
    return render_mode


def fresh_seed() -> int:
    return secrets.randbits(63)


def side_by_side(planes: np.ndarray) -> np.ndarray:
    """[N, 3, h, w] to one picture [h, N w, 3]."""
    return np.ascontiguousarray(np.concatenate(list(planes.transpose(0, 2, 3, 1)), axis=1))


class OneGame:
    """What an environment of one game has, whosever interface it serves: pictures for eyes, states, its end."""

    render_mode: str | None
    _batch: _engine.EnvBatch
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

    def __reduce_ex__(self, _: Any) -> Any:
        raise TypeError(COPIES)

    def close(self) -> None:
        self._batch.close()
        if self._window:
            self._window.close()

    def _show(self) -> None:
        if self._window:
            self._window.show(self._picture())

    def _picture(self) -> np.ndarray:
        return side_by_side(self._batch.draw(0, *self._render_size))
