"""What callers may pass: each check raises TypeError or ValueError that names the argument."""

from typing import Any

import numpy as np

from ._engine import SavedState


def checked_whole(name: str, value: Any) -> int:
    """Raises TypeError for what is no whole number."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} is {value!r}; a whole number is wanted")
    return int(value)


def checked_size(name: str, size: Any) -> tuple[int, int]:
    """Raises TypeError for what is no (width, height)."""
    if not isinstance(size, (tuple, list)) or len(size) != 2:
        raise TypeError(f"{name} is {size!r}; (width, height) is wanted")
    return checked_whole(f"{name}'s width", size[0]), checked_whole(f"{name}'s height", size[1])


def checked_seed(seed: Any, name: str = "seed") -> int:
    """Raises TypeError and ValueError for what is no seed."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)):
        raise TypeError(f"a {name} is an integer, not {type(seed).__name__}")
    if not 0 <= int(seed) < 2**64:
        raise ValueError(f"{name} {seed}: it must lie in 0..2^64 - 1")
    return int(seed)


def checked_text(name: str, value: Any) -> str:
    """Raises TypeError for what is no text."""
    if not isinstance(value, str):
        raise TypeError(f"{name} is {value!r}; a text is wanted")
    return value


def checked_state(state: Any) -> SavedState:
    """Raises TypeError for what is no state of a world."""
    if not isinstance(state, SavedState):
        raise TypeError(f"a state is what get_state() returned, not {type(state).__name__}")
    return state
