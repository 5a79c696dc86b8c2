"""Actions of several heads as one number each."""

import numpy as np


class FlatActions:
    """Numbers 0..count - 1 for every combination of the heads' choices, in row-major order: the last head's choice changes fastest.
    With heads of 3, 2 and 4 choices, number = (first * 2 + second) * 4 + third, as np.ravel_multi_index has it."""

    def __init__(self, head_sizes: list[int]) -> None:
        self.head_sizes = tuple(head_sizes)
        self.count = int(np.prod(self.head_sizes))

    def choices(self, numbers: np.ndarray) -> np.ndarray:
        """Integers [...] to int32 [..., heads]. Raises ValueError naming a number outside 0..count - 1."""
        outside = (numbers < 0) | (numbers >= self.count)
        if outside.any():
            raise ValueError(f"action {numbers[outside].flat[0]}: it must lie in 0..{self.count - 1}")
        return np.stack(np.unravel_index(numbers, self.head_sizes), -1).astype(np.int32)

    def mask(self, allowed: np.ndarray) -> np.ndarray:
        """What the heads allow, [..., sum of head sizes] behind one another, to i8 [..., count]: 1 where every choice is allowed."""
        rows = np.ones((*allowed.shape[:-1], 1), np.int8)
        for head in np.split(allowed, np.cumsum(self.head_sizes)[:-1], axis=-1):
            rows = (rows[..., :, None] * head.astype(np.int8)[..., None, :]).reshape(*allowed.shape[:-1], -1)
        return rows
