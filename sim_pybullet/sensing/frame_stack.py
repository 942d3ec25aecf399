"""``FrameStack``: the last pictures of N robots, one behind the other along the colour axis."""

from __future__ import annotations

import numpy as np


class FrameStack:
    """Keeps ``frames`` pictures (H, W, 3) of each robot; the newest comes last."""

    def __init__(self, n_robots: int, frames: int, shape: tuple[int, int, int]) -> None:
        self._frames, self._channels = frames, shape[2]
        self.shape = (*shape[:2], frames * shape[2])  # of what one robot sees
        self._stack = np.zeros((n_robots, *self.shape), np.uint8)

    def push(self, pictures: np.ndarray, robots: np.ndarray | None = None) -> np.ndarray:
        """The next picture of every robot, or of robots (M,); their stacks in a fresh array."""
        if self._frames == 1:
            return pictures
        chosen = slice(None) if robots is None else robots
        older = self._stack[chosen][..., self._channels :]
        self._stack[chosen] = np.concatenate((older, pictures), axis=-1)
        return np.array(self._stack[chosen])

    def restart(self, robots: np.ndarray, pictures: np.ndarray) -> np.ndarray:
        """The first pictures (M, H, W, 3) of robots (M,), which stand for their past as well."""
        if self._frames == 1:
            return pictures
        self._stack[robots] = np.tile(pictures, self._frames)
        return self._stack[robots]
