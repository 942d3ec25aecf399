"""The protocol of the cameras of a batch, and one that draws nothing."""

from typing import Protocol

import numpy as np

from robot.lens import CameraRig
from sim_pybullet.scene import Scene


class BatchCamera(Protocol):
    """Draws what N robots see, each in a world of its own, all or some of them.

    Poses are rows of x [m], y [m], heading [rad] in the world frame of each robot's Scene. Pictures
    come back in fresh arrays: they share no memory with the camera or each other.
    """

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""

    def render(
        self,
        poses: np.ndarray,
        robots: np.ndarray | None = None,
        movers: np.ndarray | None = None,
    ) -> np.ndarray:
        """(M, H, W, 3) uint8 RGB of all robots, or of those whose indices (M,) are given.

        ``movers`` (M, U, 3): where each of them sees what moves, NaN where it is not there.
        """


class NoCamera:
    """Keeps `BatchCamera` for who needs no pictures: black dots."""

    shape = (1, 1, 3)

    def __init__(self, n_robots: int) -> None:
        self._count = n_robots

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Nothing to do."""

    def render(
        self,
        poses: np.ndarray,  # noqa: ARG002
        robots: np.ndarray | None = None,
        movers: np.ndarray | None = None,  # noqa: ARG002
    ) -> np.ndarray:
        """(M, 1, 1, 3) zeros."""
        return np.zeros((self._count if robots is None else len(robots), *self.shape), np.uint8)
