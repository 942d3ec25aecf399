"""The one protocol that both cameras keep."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Camera(Protocol):
    """Draws what N robots see.

    Poses are (N, 3) float64 rows of x [m], y [m], heading [rad] in the world frame of each robot's
    Scene. Pictures come back in fresh arrays: they share no memory with the camera or each other.
    """

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""

    def render(self, poses: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect."""

    def segment(self, poses: np.ndarray) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""
