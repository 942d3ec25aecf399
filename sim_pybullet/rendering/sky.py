"""The colour of the sky by direction: one gradient for both cameras."""

from __future__ import annotations

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import SkyLook
from sim_pybullet.rendering.rays import PixelRays, floor_shade, horizon_share, pixel_rays
from sim_pybullet.scene import Scene
from sim_pybullet.weak_cache import WeakCache


def sky_rgb(directions: np.ndarray, sky: SkyLook) -> np.ndarray:
    """(..., 3) uint8 of unit directions (..., 3): from the horizon's colour to the zenith's."""
    share = np.sqrt(np.clip(directions[..., 2:], 0.0, 1.0))
    rgb = (1.0 - share) * np.array(sky.horizon_rgb) + share * np.array(sky.zenith_rgb)
    return np.round(rgb).astype(np.uint8)


def background(rig: CameraRig, image: ImageSpec, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """What pixels show that are not all floor: colours (3 P,) and classes (P,), both uint8.

    Kept as long as the scene lives.

    A pixel that the horizon cuts blends the sky with the floor far away; one beyond the lens is
    black and counts as sky.
    """

    def make() -> tuple[np.ndarray, np.ndarray]:
        return _background(pixel_rays(rig, image), scene)

    return _BACKGROUNDS.get(scene, (rig, image), make)


_BACKGROUNDS: WeakCache[tuple[np.ndarray, np.ndarray]] = WeakCache()


def _background(rays: PixelRays, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    share = horizon_share(rays)[..., None]
    far = np.minimum(np.array(scene.ground.outside_rgb) * floor_shade(scene.light), 255.0)
    rgb = (1.0 - share) * sky_rgb(rays.directions, scene.sky) + share * far
    rgb = np.round(np.where(rays.seen[..., None], rgb, 0.0)).astype(np.uint8)
    below = (rays.directions[..., 2] < 0.0) & rays.seen
    kinds = np.where(below, SemanticClass.OUTSIDE, SemanticClass.SKY).astype(np.uint8)
    return rgb.ravel(), kinds.ravel()
