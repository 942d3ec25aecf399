"""Pinhole views that together cover everything a lens sees, and the way from them to its picture.

A renderer that can only draw pinhole pictures must see at least as far as the lens does, or the
warped picture has a lens's bend without its field of view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering.rays import cast_pixel_rays

WIDEST_TAN = 2.0  # a lens that looks further off its axis is covered by several views
MARGIN_PX = 2


@dataclass(frozen=True)
class PinholeView:
    """One pinhole picture: ``turn`` (3, 3) takes the view's axes (x right, y down, z forward) to
    the robot frame; ``low`` and ``high`` (2,) are tangents, x / z and y / z, of its edges, and
    ``size_px`` (2,) its width and height."""

    turn: np.ndarray
    low: np.ndarray
    high: np.ndarray
    size_px: np.ndarray

    def directions(self) -> np.ndarray:
        """(height, width, 3) unit rays in the robot frame, one per pixel."""
        sides = zip(self.low, self.high, self.size_px, strict=True)
        x, y = (low + (np.arange(n) + 0.5) / n * (high - low) for low, high, n in sides)
        plane = np.stack((*np.meshgrid(x, y), np.ones((len(y), len(x)))), axis=-1) @ self.turn.T
        return np.asarray(plane / np.linalg.norm(plane, axis=-1, keepdims=True))

    def locate(self, directions: np.ndarray) -> np.ndarray:
        """Robot-frame rays (..., 3) -> pixels (..., 2) of this view, for rays in front of it."""
        local = directions @ self.turn
        share = (local[..., :2] / np.maximum(local[..., 2:], 1e-9) - self.low) / (
            self.high - self.low
        )
        return np.asarray(share * self.size_px - 0.5)


@dataclass(frozen=True)
class Cover:
    """The views and, for the lens's picture enlarged ``oversample`` times, where to read them.

    ``maps``: per view (2, sH, sW) float32 source columns and rows; ``owner`` (sH, sW): which view
    to read; ``seen`` (sH, sW): where the lens has a pixel at all.
    """

    views: tuple[PinholeView, ...]
    maps: tuple[np.ndarray, ...]
    owner: np.ndarray
    seen: np.ndarray
    oversample: int

    def warp(self, pictures: list[np.ndarray]) -> np.ndarray:
        """The lens's picture (H, W, 3) uint8 from the views' pictures, averaged over each pixel."""
        large = np.zeros((*self.owner.shape, 3), np.uint8)
        for k, (picture, where) in enumerate(zip(pictures, self.maps, strict=True)):
            read = cv2.remap(
                picture, where[0], where[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            large = np.where((self.owner == k)[..., None], read, large)
        large[~self.seen] = 0
        height, width = self.owner.shape
        size = (width // self.oversample, height // self.oversample)
        return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA))


def cover(rig: CameraRig, image: ImageSpec, oversample: int) -> Cover:
    """Views that cover a rig's picture at ``oversample`` times its resolution."""
    large = ImageSpec(
        image.width_px * oversample, image.height_px * oversample, image.crop_top_px * oversample
    )
    rays = cast_pixel_rays(rig, large)
    turns = _turns(rig, rays.directions[rays.seen])
    local = np.stack([rays.directions @ turn for turn in turns])  # (K, sH, sW, 3)
    owner = np.argmax(local[..., 2] / np.abs(local).max(axis=-1), axis=0)
    used = [k for k in range(len(turns)) if (rays.seen & (owner == k)).any()]
    focal_px = rig.lens.scaled(large.width_px, large.height_px).fx_px  # as sharp as in its middle
    views = tuple(_view(turns[k], local[k][rays.seen & (owner == k)], focal_px) for k in used)
    maps = tuple(
        np.ascontiguousarray(np.moveaxis(view.locate(rays.directions), -1, 0), np.float32)
        for view in views
    )
    return Cover(views, maps, np.searchsorted(used, owner), rays.seen, oversample)


def _turns(rig: CameraRig, directions: np.ndarray) -> list[np.ndarray]:
    """One view along the optical axis, or as many sides of a cube about it as are needed."""
    front = rig.mount.rotation
    local = directions @ front
    if (np.abs(local[:, :2]) < WIDEST_TAN * local[:, 2:]).all():
        return [front]
    quarters = np.array([(0, 0, 0), (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 2, 0)])
    return [front @ cv2.Rodrigues(0.5 * math.pi * turn)[0] for turn in quarters]


def _view(turn: np.ndarray, local: np.ndarray, focal_px: float) -> PinholeView:
    """The smallest view that holds these rays (M, 3) in its axes."""
    plane = local[:, :2] / local[:, 2:]
    margin = MARGIN_PX / focal_px
    low, high = plane.min(axis=0) - margin, plane.max(axis=0) + margin
    return PinholeView(turn, low, high, np.ceil((high - low) * focal_px).astype(int))
