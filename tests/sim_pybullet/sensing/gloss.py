"""The gloss of a floor on one frame, as a rig sees it."""

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.sensing import sensor


def add_gloss(
    frame: np.ndarray, rig: CameraRig, image: ImageSpec, light: LightLook, heading_rad: float
) -> None:
    """To one frame (H, W, 3) uint8, in place."""
    if light.gloss:
        sensor.add_gloss(frame, pixel_rays(rig, image).directions, light, heading_rad)
