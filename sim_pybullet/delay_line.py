"""``DelayLine``: numbers of N robots that are read some time after they were written."""

import math

import numpy as np


class DelayLine:
    """Rows of ``width`` numbers; each robot has a delay of its own, read linearly between steps."""

    def __init__(self, n_robots: int, width: int) -> None:
        self._values = np.zeros((2, n_robots, width))  # a ring that holds the longest delay
        self._whole = np.zeros(n_robots, dtype=int)  # delay = whole + share steps
        self._share = np.zeros((n_robots, 1))
        self._robots = np.arange(n_robots)
        self._now = 0

    def reset(self, i: int, delay_steps: float, value: np.ndarray) -> None:
        """From now on robot ``i`` has this delay; all it can still read are ``value`` (W,)."""
        self._whole[i] = math.floor(delay_steps)
        self._share[i] = delay_steps - self._whole[i]
        missing = int(self._whole[i]) + 2 - len(self._values)
        if missing > 0:
            oldest_first = np.roll(self._values, -self._now - 1, axis=0)
            self._values = np.pad(oldest_first, ((missing, 0), (0, 0), (0, 0)))
            self._now = len(self._values) - 1
        self._values[:, i] = value

    def push(self, values: np.ndarray) -> None:
        """Write the values (N, W) of the next step."""
        self._now = (self._now + 1) % len(self._values)
        self._values[self._now] = values

    def read(self) -> np.ndarray:
        """The values (N, W) that come out of the line at this step."""
        depth = len(self._values)
        newer = self._values[(self._now - self._whole) % depth, self._robots]
        if not self._share.any():
            return np.asarray(newer)
        older = self._values[(self._now - self._whole - 1) % depth, self._robots]
        return np.asarray((1.0 - self._share) * newer + self._share * older)
