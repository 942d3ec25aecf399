"""A camera for tests that are not about pictures: it writes the pose into the picture."""

import numpy as np

from robot.lens import CameraRig
from sim_pybullet.scene import Scene


class PoseCamera:
    """In the place of a ``RayCamera``: x, y and heading in millimetres and milliradians.

    Refuses to draw robots that were given no world, and indices that do not fit the poses.
    """

    shape, device = (4, 3, 3), None

    def __init__(self, n_robots: int) -> None:
        self.scenes: list[Scene | None] = [None] * n_robots
        self.rigs: list[CameraRig | None] = [None] * n_robots

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        self.scenes[i], self.rigs[i] = scene, rig

    def render(self, poses: np.ndarray, robots: np.ndarray | None = None) -> np.ndarray:
        robots = np.arange(len(self.scenes)) if robots is None else robots
        assert poses.shape == (len(robots), 3)
        assert all(self.scenes[i] is not None for i in robots)
        words = np.round(1000.0 * poses).astype(np.int32)[:, None].view(np.uint8)  # (M, 1, 12)
        return np.ascontiguousarray(np.tile(words, (1, 3, 1)).reshape(len(robots), *self.shape))


def shown_poses(pictures: np.ndarray) -> np.ndarray:
    """The poses (M, 3) that a ``PoseCamera`` drew."""
    words = np.ascontiguousarray(pictures.reshape(len(pictures), 3, 12)[:, 0])
    return words.view(np.int32) / 1000.0
