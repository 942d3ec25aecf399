"""The gloss of a floor on one frame."""

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.look import LightLook
from sim_pybullet.sensing.sensor import Gloss


def add_gloss(
    frame: np.ndarray, rig: CameraRig, image: ImageSpec, light: LightLook, heading_rad: float
) -> None:
    """As ``Gloss`` to one frame (H, W, 3) uint8, in place."""
    gloss = Gloss(1, image)
    gloss.put(0, rig, light)
    gloss.add(frame[None], np.array([heading_rad]), np.zeros(1, int))
