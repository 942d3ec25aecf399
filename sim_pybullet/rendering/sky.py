"""The colour of the sky by direction: one gradient for both cameras."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import SkyLook
from sim_pybullet.rendering.rays import floor_shade, horizon_share, pixel_rays
from sim_pybullet.scene import Scene

Background = tuple[np.ndarray, np.ndarray]  # colours (3 P,) and classes (P,), both uint8
_KEPT: WeakKeyDictionary[Scene, dict[tuple[CameraRig, ImageSpec], Background]] = WeakKeyDictionary()


def sky_rgb(directions: np.ndarray, sky: SkyLook) -> np.ndarray:
    """(..., 3) uint8 of unit directions (..., 3): from the horizon's colour to the zenith's."""
    share = np.sqrt(np.clip(directions[..., 2:], 0.0, 1.0))
    rgb = (1.0 - share) * np.array(sky.horizon_rgb) + share * np.array(sky.zenith_rgb)
    return np.round(rgb).astype(np.uint8)


def background(rig: CameraRig, image: ImageSpec, scene: Scene) -> Background:
    """What pixels show that are not all floor; kept as long as the scene lives.

    A pixel that the horizon cuts blends the sky with the floor far away; one beyond the lens is
    black and counts as sky.
    """
    kept = _KEPT.setdefault(scene, {})
    if (rig, image) not in kept:
        rays = pixel_rays(rig, image)
        share = horizon_share(rays)[..., None]
        far = np.minimum(np.array(scene.ground.outside_rgb) * floor_shade(scene.light), 255.0)
        rgb = (1.0 - share) * sky_rgb(rays.directions, scene.sky) + share * far
        rgb = np.round(np.where(rays.seen[..., None], rgb, 0.0)).astype(np.uint8)
        below = (rays.directions[..., 2] < 0.0) & rays.seen
        kinds = np.where(below, SemanticClass.OUTSIDE, SemanticClass.SKY).astype(np.uint8)
        kept[rig, image] = rgb.ravel(), kinds.ravel()
    return kept[rig, image]
