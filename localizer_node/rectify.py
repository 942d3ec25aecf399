"""From pixels to the floor and back: region of interest, lens, turn, homography, parallax."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from localizer_node.calibration import Calibration

Rect = Tuple[int, int, int, int]  # u0, v0, u1, v1 of a slice: u1 and v1 are outside


class Rectifier:
    """The geometry of one ``Calibration``: pixels (..., 2) as u, v; floor (..., 2) as x, y [m]."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self._foot_m = np.array(calibration.camera_m[:2])
        self._height_m = calibration.camera_m[2]
        c, s = math.cos(calibration.rotation_rad), math.sin(calibration.rotation_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        floor_from_ray = np.array(calibration.homography).reshape(3, 3) @ turn
        # Known up to a factor; with this sign the third coordinate is positive below the horizon.
        self._floor_from_ray = floor_from_ray * (-1.0 if floor_from_ray[2, 2] < 0.0 else 1.0)
        self._ray_from_floor = np.linalg.inv(self._floor_from_ray)

    def to_floor(self, pixels: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Where what is seen at these pixels, ``height_m`` above the floor, stands.

        A point at height h under a camera at height H looks displaced by r h / (H - h) outward
        from the camera's foot point; here that is undone. NaN where the pixel shows no floor.
        """
        rays = self.calibration.lens.unproject(pixels)
        plane = rays @ self._floor_from_ray.T
        front = (rays[..., 2] > 1e-6) & (plane[..., 2] > 1e-9)
        floor = plane[..., :2] / np.where(front, plane[..., 2], np.nan)[..., None]
        keep = (self._height_m - height_m) / self._height_m
        return self._foot_m + (floor - self._foot_m) * keep

    def to_pixels(self, points_m: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Where floor points, raised to ``height_m``, appear in the raw picture."""
        stretch = self._height_m / (self._height_m - height_m)
        floor = self._foot_m + (np.asarray(points_m, dtype=float) - self._foot_m) * stretch
        rays = np.concatenate((floor, np.ones((*floor.shape[:-1], 1))), axis=-1)
        return self.calibration.lens.project(rays @ self._ray_from_floor.T)

    def linearised(
        self, pixels: np.ndarray, height_m: float = 0.0
    ) -> Tuple[np.ndarray, np.ndarray]:
        """``to_floor`` (..., 2) and its derivative (..., 2, 2) [m/px]: rows x, y, columns u, v."""
        pixels = np.asarray(pixels, dtype=float)
        steps = np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        floor = self.to_floor(pixels[..., None, :] + steps, height_m)
        along_u = floor[..., 1, :] - floor[..., 2, :]
        along_v = floor[..., 3, :] - floor[..., 4, :]
        return floor[..., 0, :], np.stack((along_u, along_v), axis=-1)

    def on_map(self, points_m: np.ndarray, margin_m: float = 0.0) -> np.ndarray:
        """Whether floor points (..., 2) lie on the map or within ``margin_m`` of it."""
        size = np.array(self.calibration.map_size_m)
        points = np.asarray(points_m)
        return np.all((points >= -margin_m) & (points <= size + margin_m), axis=-1)

    def roi_rect(self) -> Rect:
        """The slice of the picture that holds the region of interest."""
        lens = self.calibration.lens
        if not self.calibration.roi_px:
            return (0, 0, lens.width_px, lens.height_px)
        corners = np.array(self.calibration.roi_px)
        low = np.maximum(np.floor(corners.min(axis=0)), 0)
        high = np.minimum(np.ceil(corners.max(axis=0)) + 1, (lens.width_px, lens.height_px))
        return (int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def map_outline(map_size_m: Tuple[float, float], points_per_side: int = 12) -> np.ndarray:
    """The map's edge as a closed ring of points (4 * points_per_side, 2) [m]."""
    t = np.linspace(0.0, 1.0, points_per_side, endpoint=False)[:, None]
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * np.array(map_size_m)
    return np.concatenate([a + (b - a) * t for a, b in zip(corners[:-1], corners[1:])])
