"""Light that goes astray on its way to the sensor: smears, infrared, and lamps in the floor."""

from __future__ import annotations

import math

import cv2
import numpy as np

from robot.contract import FRAME_WIDTH_PX, ImageSpec
from robot.lens import DUCKIEBOT_LENS, CameraRig
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.rays import pixel_rays

# A turn by one radian moves the middle of a 160 px wide frame by so many pixels.
PX_PER_RAD = DUCKIEBOT_LENS.fx_px * FRAME_WIDTH_PX / DUCKIEBOT_LENS.width_px
_SMALLEST_SMEAR_PX = 0.3
# Foam, cloth and paint alike reflect near infrared; red and blue pixels let most of it through.
_INFRARED_RGB = np.array((1.15, 0.85, 1.05))
_LAMP = 200.0  # grey levels of a lamp that the floor mirrors fully
_BARELY = 1e-3


def smeared(frames: np.ndarray, lengths_px: np.ndarray) -> np.ndarray:
    """Frames (N, H, W, 3) averaged over so many pixels along the rows, one length per frame.

    A robot on the floor turns about the vertical, so that its picture moves sideways.
    """
    if not (lengths_px > _SMALLEST_SMEAR_PX).any():
        return frames
    seen = frames.copy()
    for k in np.flatnonzero(lengths_px > _SMALLEST_SMEAR_PX):
        half = int(np.ceil(0.5 * lengths_px[k]))
        offsets = np.abs(np.arange(-half, half + 1))
        weights = np.clip(0.5 * lengths_px[k] + 0.5 - offsets, 0.0, 1.0)[None]
        seen[k] = cv2.filter2D(
            frames[k], -1, weights / weights.sum(), borderType=cv2.BORDER_REPLICATE
        )
    return seen


def with_infrared(frames: np.ndarray, shares: list[float]) -> np.ndarray:
    """Frames (N, H, W, 3) of sensors that take so much of their light from the near infrared."""
    if not any(shares):
        return frames
    seen = frames.copy()
    for k, share in enumerate(shares):
        if share:
            mixing = (1.0 - share) * np.eye(3) + share * np.outer(_INFRARED_RGB, np.full(3, 1 / 3))
            seen[k] = cv2.transform(frames[k], mixing)
    return seen


def add_gloss(
    frame: np.ndarray, rig: CameraRig, image: ImageSpec, light: LightLook, heading_rad: float
) -> None:
    """Add the light's mirror image in the floor to a frame (H, W, 3) uint8, in place.

    Phong's model: the spot lies where a ray mirrored by the floor meets the light. Solids are not
    told from the floor: the spot lies over them.

    Args:
        frame: the picture.
        rig: that it was taken with.
        image: its size.
        light: its direction is in the world frame.
        heading_rad: of the robot, in the world frame.
    """
    directions = pixel_rays(rig, image).directions  # in the robot's frame
    azimuth, cosine = light.azimuth_rad - heading_rad, np.cos(light.elevation_rad)
    towards = (cosine * np.cos(azimuth), cosine * np.sin(azimuth), -np.sin(light.elevation_rad))
    alike = np.clip(directions @ np.array(towards, np.float32), -1.0, 1.0)
    least = 1.0 + light.gloss_width_rad**2 * math.log(_BARELY)
    lit = (alike > least) & (directions[..., 2] < 0.0)
    if lit.any():  # the lamp is mirrored behind the robot more often than before it
        spot = np.exp((alike[lit] - 1.0) / light.gloss_width_rad**2)
        bright = frame[lit] + (light.gloss * _LAMP * spot)[:, None]
        frame[lit] = np.minimum(bright + 0.5, 255.0).astype(np.uint8)
