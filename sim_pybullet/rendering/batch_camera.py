"""``BatchCamera``: what draws the pictures of many robots."""

from typing import Any, Protocol

import numpy as np

from robot.lens import CameraRig
from sim_pybullet.scene import Scene


class BatchCamera(Protocol):
    """`RayCamera` on the CPU, `torch_camera.TorchCamera` on a GPU, or none."""

    shape: tuple[int, int, int]  # (H, W, 3) of one picture
    device: str | None  # of torch, where pictures are tensors; None where they are arrays

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""

    def render(
        self, poses: np.ndarray, robots: np.ndarray | None = None, movers: np.ndarray | None = None
    ) -> Any:
        """(N, H, W, 3) uint8 RGB, see `RayCamera.render`."""
