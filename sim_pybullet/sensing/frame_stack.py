"""``FrameStack``: the last pictures of N robots, one behind the other along the colour axis."""

from __future__ import annotations

import numpy as np


class FrameStack:
    """Keeps ``frames`` pictures of each robot; the newest comes last.

    Args:
        n_robots: N.
        frames: how many.
        shape: (H, W, 3) of a picture.
    """

    def __init__(self, n_robots: int, frames: int, shape: tuple[int, int, int]) -> None:
        self._frames, self._channels = frames, shape[2]
        self._stack = np.zeros((n_robots, *shape[:2], frames * shape[2]), np.uint8)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3 frames) of what one robot sees."""
        height, width, channels = self._stack.shape[1:]
        return (height, width, channels)

    def push(self, pictures: np.ndarray) -> np.ndarray:
        """The next picture of every robot, (N, H, W, 3); their stacks in a fresh array."""
        if self._frames == 1:
            return pictures
        self._stack = np.concatenate((self._stack[..., self._channels :], pictures), axis=-1)
        return self._stack.copy()

    def restart(self, robots: np.ndarray, pictures: np.ndarray) -> np.ndarray:
        """The first pictures (M, H, W, 3) of robots (M,), which stand for their past as well."""
        if self._frames == 1:
            return pictures
        self._stack[robots] = np.tile(pictures, self._frames)
        return self._stack[robots]
