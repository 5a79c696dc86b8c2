"""ViZDoom's games for one player as Gymnasium's Env, with the spaces of ViZDoom's own wrapper."""

import itertools
import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from ._engine import SavedState, describe
from .arguments import checked_size, checked_state, checked_whole
from .batch import OneGame, TICS_A_SECOND, arguments_of, checked_dtype, checked_mode, gray, make_batch, picture_as, picture_space
from .labels import Label
from .maps import Layout, vizdoom_cfg
from .window import Window

DELTA = "_DELTA"


class ComradGymEnv(OneGame, gymnasium.Env):
    """One player in the game of a ViZDoom .cfg; one step is `frame_skip` tics of 1/35 s.

    config               a .cfg: a path, or the name of one of the vizdoom package, as "basic" or "basic.cfg"
    folder               where the .cfg of that name lies, instead: gym_env("my_game", folder="my_games")
    frame_skip           tics of a step
    max_buttons_pressed  0: an action is MultiBinary, every button by itself; n: Discrete, every combination of up to n buttons, in
                         the order of ViZDoom's wrapper: as binary numbers whose first digit is the .cfg's first button. 0 presses
                         nothing, 1 the last button; `button_names` are the names. Delta buttons take numbers in either case
    render_mode          "rgb_array": render() returns the view at `render_size` (width, height), [h, w, 3] u8; "human": every step
                         shows it in a window (needs pygame); both in colours
    size                 (width, height) of the picture that is seen
    depth, labels,       whether these are observed as well; None: where the .cfg enables their buffers
    automap
    automap_mode         "NORMAL" (walls that were seen), "WHOLE", "OBJECTS", "OBJECTS_WITH_SIZE"; "": as the .cfg sets
    dtype                of pictures: "uint8", 0..255, or "float32", 0..1
    channels_first       pictures are [3, h, w], not [h, w, 3]
    layout               another WAD than the .cfg's, or the same: where the .cfg has no doom_map, all maps of it are played in turn, from
                         the first after a reset with a seed. A folder of WADs or several WADs: so are these, one map of each
    reward               weights of the .cfg's rewards in place of the file's: "living_reward=0"

    Spaces have the names of ViZDoom's wrapper: an observation is {"screen": [h, w, 3] u8, "depth": [h, w, 1] f32 (map units, 0 for
    sky), "labels": [h, w, 1] u8 (labels() explains the values), "automap": [h, w, 3] u8, "gamevariables": f32 in the order of
    the .cfg}, each where it is requested. Of screen_format = GRAY8 screen and automap are [h, w, 1]; every other format is RGB, as
    there. An action is that of the buttons, or {"binary": ..., "continuous": f32} where the .cfg has delta buttons as well.
    Differences: pictures are drawn at `size`, not at the .cfg's resolution; depth is float; the automap has no floor textures and no
    smooth lines; audio and notifications are missing (with a warning); after the last step the observation is the true last
    picture, not zeros. The last step's info holds score to length_tics as ComradParallelEnv's infos[agent] do.

    The same seed and actions give the same episode, to the bit; reset() without a seed begins the next episode of that seed. Copies and
    errors are ComradParallelEnv's.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": TICS_A_SECOND}

    def __init__(
        self,
        config: str | os.PathLike,
        *,
        frame_skip: int = 1,
        max_buttons_pressed: int = 0,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (640, 480),
        size: tuple[int, int] = (320, 240),
        depth: bool | None = None,
        labels: bool | None = None,
        automap: bool | None = None,
        automap_mode: str = "",
        folder: str | os.PathLike | None = None,
        layout: Layout | None = None,
        reward: str = "",
        dtype: str = "uint8",
        channels_first: bool = False,
    ) -> None:
        arguments = arguments_of(locals())
        self.render_mode = checked_mode(render_mode, self.metadata)
        self._render_size = checked_size("render_size", render_size)
        self._window = Window(f"comrad: {config}") if render_mode == "human" else None
        config = vizdoom_cfg(config, folder)
        facts = describe(config)
        if not facts["is_vizdoom"]:
            raise ValueError(
                f"{config} is a scenario for a team, and gym_env plays only a ViZDoom .cfg: use comrad.parallel_env({config!r}), or "
                f"comrad.vector_env({config!r})"
            )
        enabled = facts.get("buffers", ())
        wanted = {"depth": depth, "labels": labels, "automap": automap}
        self._extras = tuple(name for name, asked in wanted.items() if (name in enabled if asked is None else asked))
        self._dtype, self._channels_first = checked_dtype(dtype), bool(channels_first)
        self._is_gray: bool = facts.get("is_gray", False)
        batch = make_batch(
            config,
            num_agents=1,
            layout=layout,
            frame_skip=frame_skip,
            size=size,
            observations=self._extras,
            by_buttons=True,
            automap_mode=automap_mode,
            reward=reward,
            channels_first=channels_first,
        )
        self._take(batch, arguments)
        self.button_names: list[str] = self._batch.button_names()
        self.variable_names: list[str] = self._batch.facts()["measurements"]
        self._binary = [index for index, name in enumerate(self.button_names) if not name.endswith(DELTA)]
        self._delta = [index for index, name in enumerate(self.button_names) if name.endswith(DELTA)]
        if checked_whole("max_buttons_pressed", max_buttons_pressed) < 0:
            raise ValueError(f"max_buttons_pressed {max_buttons_pressed}: it must be 0 or more")
        most = min(int(max_buttons_pressed), len(self._binary))
        combinations = [pressed for count in range(most + 1) for pressed in itertools.combinations(self._binary, count)]
        last = len(self.button_names) - 1
        combinations.sort(key=lambda pressed: sum(1 << (last - button) for button in pressed))  # as ViZDoom's wrapper numbers them
        self._combinations = combinations if max_buttons_pressed else []
        self.action_space = self._make_action_space()
        boxes: dict[str, spaces.Space] = {"screen": picture_space(self._coloured(self._arrays["picture"]), dtype)}
        for name in self._extras:
            if name == "automap":
                boxes[name] = picture_space(self._coloured(self._arrays[name]), dtype)
            else:
                shape = (*self._arrays[name].shape[2:], 1)
                boxes[name] = spaces.Box(0, np.inf, shape, np.float32) if name == "depth" else spaces.Box(0, 255, shape, np.uint8)
        if self.variable_names:
            boxes["gamevariables"] = spaces.Box(-np.inf, np.inf, (len(self.variable_names),), np.float32)
        self.observation_space = spaces.Dict(boxes)

    def _make_action_space(self) -> spaces.Space:
        parts: dict[str, spaces.Space] = {}
        if self._binary:
            parts["binary"] = spaces.Discrete(len(self._combinations)) if self._combinations else spaces.MultiBinary(len(self._binary))
        if self._delta:
            parts["continuous"] = spaces.Box(np.finfo(np.float32).min, np.finfo(np.float32).max, (len(self._delta),), np.float32)
        return spaces.Dict(parts) if len(parts) == 2 else next(iter(parts.values()))

    def _values_of(self, action: Any) -> np.ndarray:
        """What each button gets, f32 [buttons]."""
        if not self.action_space.contains(action):
            raise ValueError(f"action {action!r} is not in {self.action_space}")
        values = np.zeros(len(self.button_names), np.float32)
        both = bool(self._binary and self._delta)
        if self._delta:
            values[self._delta] = action["continuous"] if both else action
        if self._binary:
            binary = action["binary"] if both else action
            if self._combinations:
                values[list(self._combinations[int(binary)])] = 1
            else:
                values[self._binary] = binary
        return values

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, np.ndarray], dict]:
        """As ComradParallelEnv.reset()."""
        super().reset(seed=seed)
        self._reset(seed, options)
        self._show()
        return self._see(), {}

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict]:
        self._batch.send_buttons(self._values_of(action)[None, None])
        self._stepped()
        self._batch.receive()
        terminated, truncated = bool(self._arrays["terminated"][0]), bool(self._arrays["truncated"][0])
        info: dict[str, Any] = self._accounts()[0] if terminated or truncated else {}
        self._show()
        return self._see(), float(self._arrays["reward"][0, 0]), terminated, truncated, info

    def labels(self) -> list[Label]:
        """The things in the picture of labels, by rising value. Raises ValueError where labels are not observed."""
        return self._labels_of(0)

    def set_state(self, state: SavedState) -> dict[str, np.ndarray]:
        """Goes back to a state; returns what is seen there."""
        self._batch.set_state(0, checked_state(state))
        self._has_begun = True
        self._stepped()
        return self._see()

    def _coloured(self, pictures: np.ndarray) -> np.ndarray:
        """Pictures u8 [..., h, w, 3], or [..., 3, h, w], as the .cfg's screen_format has them."""
        return gray(pictures, -3 if self._channels_first else -1) if self._is_gray else pictures

    def _picture_of(self, name: str) -> np.ndarray:
        picture = self._arrays[name][0, 0]
        return picture_as(self._coloured(picture) if self._is_gray else picture.copy(), self._dtype)

    def _see(self) -> dict[str, np.ndarray]:
        seen = {"screen": self._picture_of("picture")}
        for name in self._extras:
            seen[name] = self._picture_of(name) if name == "automap" else self._arrays[name][0, 0].copy()[..., None]
        if self.variable_names:
            seen["gamevariables"] = self._arrays["variable"][0, 0].copy()
        return seen
