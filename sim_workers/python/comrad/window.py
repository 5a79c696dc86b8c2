"""A window for render_mode "human", by pygame."""

import importlib
import os
from typing import Any

import numpy as np


class Window:
    """Shows pictures; opened by the first one. Raises ImportError with words where pygame is not installed, RuntimeError
    where there is no display."""

    def __init__(self, title: str) -> None:
        try:
            self._pygame: Any = importlib.import_module("pygame")
        except ImportError:
            raise ImportError('render_mode "human" needs pygame; run: pip install pygame') from None
        self._title = title
        self._surface: Any = None

    def show(self, picture: np.ndarray) -> None:
        """`picture`: [h, w, 3] u8."""
        height, width, _ = picture.shape
        if self._surface is None:
            try:
                self._pygame.display.init()
                driver = self._pygame.display.get_driver()
                if driver in ("dummy", "offscreen") and "SDL_VIDEODRIVER" not in os.environ:  # SDL's last resort, which shows nothing
                    raise self._pygame.error(f"SDL found none but {driver}")
                self._surface = self._pygame.display.set_mode((width, height))
            except self._pygame.error as failure:
                raise RuntimeError(f'render_mode "human" needs a display ({failure}); use render_mode "rgb_array" here') from None
            self._pygame.display.set_caption(self._title)
        self._pygame.event.pump()
        self._pygame.surfarray.blit_array(self._surface, picture.transpose(1, 0, 2))
        self._pygame.display.flip()

    def close(self) -> None:
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None
