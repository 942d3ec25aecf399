"""What an eye sees of a map's lines, and how much of a picture that explains.

The simulator's own camera draws how much white, yellow and floor beside the road each pixel sees,
and how that changes as the camera is moved a little.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Self

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import CameraLook, GroundLook, LightLook, Look, SkyLook
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Scene, SemanticClass

NAMES = (
    *("height_m", "pitch_rad", "roll_rad", "focal_scale", "distortion_scale"),
    *("centre_right_px", "centre_down_px"),
)
# Of these, the width of the lines, a factor, and how much the lens shades the corners.
USUAL = np.array([*(getattr(CameraLook(), name) for name in NAMES), 1.0, 0.15])
WIDTH = len(NAMES)
# For derivatives, each a fraction of a pixel: those of camera and pose must cancel each other.
_SMALL = np.array((1e-3, 3e-3, 3e-3, 3e-3, 15e-3, 0.2, 0.2, 0.05))
_SMALL_POSE = np.array((2e-3, 2e-3, 5e-3))
FAR_M, HORIZON_M = 0.8, 3.0  # of floor that is asked; no light from beyond gets into it
BLUR_PX = 1.0  # against aliasing
SOFTER_PX = 2.0  # and pictures may be by so much less sharp, as they move or for JPEG
YELLOW_PX = 1.5  # more of yellow: JPEG keeps colours less sharp than brightness
NEAR_PX = {1: 21, 2: 13, 4: 9}  # around a pixel, by shrink: what is alike there is light
_EVERY = 3  # pixels of which one is asked; of shrunk pictures all are
_ALIKE = 4.0  # neighbouring pixels err alike: so many tell as much as one
_NO, _RED, _GREEN, _BLUE = (0.0, 0.0, 0.0), (255.0, 0.0, 0.0), (0.0, 255.0, 0.0), (0.0, 0.0, 255.0)
# Stop lines are both red and green: where two say all, nothing is known.
_COVER = GroundLook(_NO, _RED, _GREEN, (255.0, 255.0, 0.0), _BLUE, grain=0.0, seam_depth=0.0)


def far(shrink: int = 1) -> np.ndarray:
    """(H, W) how far pixels of pictures so many times smaller are off the middle, squared."""
    rows, columns = np.mgrid[-1 : 1 : 120j / shrink, -1 : 1 : 160j / shrink]
    return np.asarray(0.5 * (rows**2 + columns**2), np.float32)


@lru_cache(maxsize=4)
def cover_scene(road_map: RoadMap, width: float) -> Scene:
    """The floor in white, yellow and beside as red, green and blue; lines so many times as wide."""
    ground = paint_ground(road_map, replace(_COVER, line_width_scale=width))
    ground.rgb[ground.classes == SemanticClass.OUTSIDE] = _BLUE
    return Scene(ground, (), SkyLook(), LightLook(ambient=1.0, diffuse=0.0))


def rig_of(values: np.ndarray) -> CameraRig:
    """The nominal camera with these values (7,) of ``NAMES``; what follows them is not asked."""
    camera = replace(CameraLook(), **dict(zip(NAMES, values.tolist(), strict=False)))
    return replace(Look(), camera=camera).rig()


class Views(NamedTuple):
    """Pictures taken near poses (F, 3) of a map."""

    planes: np.ndarray  # (F, pixels, 2)
    poses: np.ndarray
    road_map: RoadMap
    shrink: int  # so many times smaller than (120, 160)

    def some(self, chosen: np.ndarray) -> Self:
        """Those of these numbers."""
        return self._replace(planes=self.planes[chosen], poses=self.poses[chosen])


def views_of(
    images: Sequence[np.ndarray], poses: np.ndarray, road_map: RoadMap, shrink: int = 1
) -> Views:
    """Of pictures (120, 160, 3), so many times smaller: the planes are brightness and yellow."""
    size = 160 // shrink, 120 // shrink
    planes = np.empty((len(images), size[0] * size[1], 2), np.float32)
    for image, plane in zip(images, planes, strict=True):
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        red, green, blue = np.moveaxis(_unlit(small, shrink), -1, 0)
        kinds = (red + green + blue) / 3, (red + green) / 2 - blue
        for k, blur_px in enumerate(blurs_px(shrink)):
            plane[:, k] = _blurred(kinds[k], blur_px).ravel()
    return Views(planes, poses, road_map, shrink)


class Eye:
    """Draws cover as a camera sees it, and as it would with each of the values a little otherwise.

    Slopes are taken from both sides: from one, what aliasing does to the picture itself would pull
    every value the same way.
    """

    def __init__(self, views: Views, values: np.ndarray, camera_too: bool) -> None:
        moves = np.diag(_SMALL)[: camera_too * len(_SMALL)] @ np.eye(len(_SMALL), len(USUAL))
        tried = [values + move for move in (0.0 * USUAL, *moves, *-moves)]
        scenes = {w: cover_scene(views.road_map, w) for w in {each[WIDTH] for each in tried}}
        rigs = [rig_of(each) for each in tried]
        self._slots = np.array([*range(len(rigs)), *(0,) * 6])
        size = 160 // views.shrink, 120 // views.shrink
        self._camera = RayCamera(ImageSpec(*size), len(rigs))
        for k, (rig, each) in enumerate(zip(rigs, tried, strict=True)):
            self._camera.set_robot(k, scenes[each[WIDTH]], rig)
        self._shade, self._camera_too = float(values[-1]), camera_too
        self._small = np.array([*_SMALL[: len(moves)], *_SMALL_POSE], np.float32)
        pixels = np.stack(np.meshgrid(*map(np.arange, size)), axis=-1).astype(float)
        found = CameraRig(rigs[0].lens.scaled(*size), rigs[0].mount).to_floor(pixels)
        self.shrink, self._far = views.shrink, far(views.shrink)[..., None]
        rounded = _unlit(self._far[..., 0], self.shrink).ravel()  # not all of it goes, at the edges
        self.shading = np.stack((np.ones_like(rounded), rounded), axis=1)
        away_m = np.nan_to_num(np.hypot(found[..., 0], found[..., 1]), nan=np.inf)
        self._window = np.ones((NEAR_PX[self.shrink],) * 2)
        below = cv2.erode((away_m < HORIZON_M).astype(np.uint8), self._window) > 0
        self._near = (away_m < FAR_M) & below

    def look(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At a pose (3,): indices (N,) of known pixels; how much of each kind covers a pixel.

        Unlit, (H, W, 3); and the slopes of that, lit, (G, H, W, 3).
        """
        poses = np.tile(pose, (len(self._slots), 1))
        poses[-6:-3] += np.diag(_SMALL_POSE)
        poses[-3:] -= np.diag(_SMALL_POSE)
        drawn = self._camera.render(poses, self._slots)
        beside, unknown = drawn[0, ..., 2] > 250, drawn[0, ..., :2].min(axis=-1) > 30
        off_road = cv2.erode(beside.astype(np.uint8), self._window) > 0
        off_road |= cv2.dilate(unknown.astype(np.uint8), np.ones((4 // self.shrink + 1,) * 2)) > 0
        known = np.flatnonzero(self._near & ~off_road)[:: _EVERY if self.shrink == 1 else 1]
        shares, half = drawn.astype(np.float32) / 255.0, (len(drawn) - 7) // 2
        more = np.concatenate((shares[1 : 1 + half], shares[-6:-3]))
        more -= np.concatenate((shares[1 + half : -6], shares[-3:]))
        more /= (2.0 * self._small)[:, None, None, None]
        lit, darker = 1.0 - self._shade * self._far, (-self._far * shares[:1])[: self._camera_too]
        slopes = np.concatenate((lit * more[:-3], darker, lit * more[-3:]))
        return known, _unlit(lit * shares[0], self.shrink), slopes


def _blurred(picture: np.ndarray, blur_px: float) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), blur_px))


def _unlit(picture: np.ndarray, shrink: int) -> np.ndarray:
    """Without what shadows, gloss and patches do, which are large."""
    return np.asarray(picture - cv2.blur(picture, (NEAR_PX[shrink],) * 2))


def explain(planes: np.ndarray, eye: Eye, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """How a picture's planes (pixels, 2) follow from what the eye draws at a pose (3,).

    Normal equations of camera and pose, (G, G) and (G,); the share of variance that is explained.
    """
    known, kinds, slopes = eye.look(pose)
    matrix, vector = np.zeros((count := len(slopes), count)), np.zeros(count)
    if len(known) < 200:
        return matrix, vector, 0.0
    left = whole = 0.0
    for plane, blur_px in zip(planes[known].T, blurs_px(eye.shrink), strict=True):
        cover = _blurred(kinds, blur_px)
        softer = _blurred(cover, SOFTER_PX / eye.shrink) - cover
        each = (part.reshape(-1, 3)[known] for part in (softer, cover))
        terms = np.column_stack((eye.shading[known], *each))
        weights = np.ones(len(known), np.float32)
        for _ in range(3):
            heavy = terms * weights[:, None]
            normal = np.asarray(heavy.T @ terms, float) + 1e-6 * np.eye(terms.shape[1])
            solver = np.asarray(np.linalg.inv(normal) @ heavy.T, np.float32)
            found = solver @ plane
            missed = plane - terms @ found
            sigma = 1.4826 * np.median(np.abs(missed)) + 0.5
            weights = 1.0 / (1.0 + (missed / (2.5 * sigma)) ** 2)
        moved = np.ascontiguousarray(np.moveaxis(slopes @ found[-3:], 0, -1))
        slope = _blurred(_unlit(moved, eye.shrink), blur_px).reshape(-1, count)[known]
        slope -= terms @ (solver @ slope)
        heavy = slope * (weights / (sigma**2 * _ALIKE))[:, None]
        matrix += heavy.T @ slope
        vector += heavy.T @ missed
        left += float((weights * missed**2).sum()) / sigma**2
        whole += float((weights * (plane - plane.mean()) ** 2).sum()) / sigma**2
    return matrix, vector, max(0.0, 1.0 - left / max(whole, 1e-9))


def blurs_px(shrink: int) -> tuple[float, float]:
    """Of brightness and yellow, in pictures so many times smaller."""
    return BLUR_PX, math.hypot(BLUR_PX, YELLOW_PX / shrink)
