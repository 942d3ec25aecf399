"""Shadows with edges on the floor: of window bars, furniture and people."""

import math

import cv2
import numpy as np

_COARSE = 4  # texels of the floor per pixel of the mask: edges are softer than that anyway
_BAR_M = (0.04, 0.25)  # widths
_LEG_M = (0.03, 0.3)
_LENGTH_M = (0.3, 1.5)
_SOFT_M = (0.005, 0.06)  # standard deviation of an edge: the sun is not a point, lamps less so


def cast_shadows(
    shape: tuple[int, ...], texel_m: float, strength: float, rng: np.random.Generator
) -> np.ndarray:
    """What is left of the light on a floor (H, W), float32 in 1 - strength .. 1.

    ``rng`` draws a set of parallel bars in half of the floors, and single objects.
    """
    height, width = (-(-size // _COARSE) for size in shape[:2])
    scale = 1.0 / (_COARSE * texel_m)
    mask = np.zeros((height, width), np.uint8)
    if rng.random() < 0.5:
        _bars(mask, scale, rng)
    area_m2 = height * width / scale**2
    for _ in range(round(area_m2 * rng.uniform(0.1, 0.6))):
        start = rng.uniform((0.0, 0.0), (width, height))
        length, thick = rng.uniform(*_LENGTH_M) * scale, rng.uniform(*_LEG_M) * scale
        angle = rng.uniform(0.0, 2.0 * math.pi)
        end = start + length * np.array((math.cos(angle), math.sin(angle)))
        cv2.line(mask, _pixel(start), _pixel(end), 255, max(1, round(thick)), cv2.LINE_AA)
    share = cv2.GaussianBlur(mask, (0, 0), max(0.3, rng.uniform(*_SOFT_M) * scale))
    full = cv2.resize(share, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(1.0 - strength / 255.0 * full, np.float32)


def _bars(mask: np.ndarray, scale: float, rng: np.random.Generator) -> None:
    height, width = mask.shape
    angle, bar = rng.uniform(0.0, math.pi), rng.uniform(*_BAR_M) * scale
    across = np.array((-math.sin(angle), math.cos(angle)))
    along = np.array((math.cos(angle), math.sin(angle)))
    reach = math.hypot(height, width)
    middle = np.array((width / 2.0, height / 2.0))
    for offset in np.arange(-reach / 2.0, reach / 2.0, bar * rng.uniform(2.5, 6.0)):
        begin, end = (middle + offset * across + side * reach * along for side in (-1.0, 1.0))
        cv2.line(mask, _pixel(begin), _pixel(end), 255, max(1, round(bar)), cv2.LINE_AA)


def _pixel(point: np.ndarray) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
