"""What a robot's camera would see on a road that is wider than any of Duckietown's.

A picture of the floor does not tell a wide road from a camera close to the ground: only the road's
width in camera heights can be seen. Looked at from higher up, a wide road is like a narrow one.
"""

from __future__ import annotations

import cv2
import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.lens import CameraRig

_HORIZON = -1e-3  # a ray's fall a unit of length; flatter ones do not reach the floor


def higher_view(rig: CameraRig, times: float) -> np.ndarray:
    """(H, W, 2) float32: which pixel of a frame each pixel seen from higher up comes from.

    Floor points move towards the camera's foot, ``times`` nearer; what is above the horizon stays.

    Args:
        rig: the camera that took the frame, and would be lifted.
        times: how much higher; 1 changes nothing.
    """
    camera = CameraRig(rig.lens.scaled(FRAME_WIDTH_PX, FRAME_HEIGHT_PX), rig.mount)
    rays = camera.rays()
    on_floor = rays[..., 2] < _HORIZON
    fall = np.where(on_floor, -rays[..., 2], 1.0)[..., None]
    floor = rays / fall * (times, times, 1.0)
    seen = np.where(on_floor[..., None], floor, rays)
    return np.asarray(camera.lens.project(seen @ camera.mount.rotation), np.float32)


def lifted(frame: np.ndarray, view: np.ndarray) -> np.ndarray:
    """A frame (120, 160, 3) uint8 by a `higher_view`; beyond its edges these are repeated."""
    columns, rows = view[..., 0], view[..., 1]
    return cv2.remap(frame, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
