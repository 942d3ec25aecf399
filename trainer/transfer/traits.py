"""What photographs look like, in numbers that a look can imitate.

All are medians over the pictures of a folder, measured at 160x120.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.navigation.road_map import load_map
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.show import draws
from trainer.transfer.pictures import load_pictures, spread

_FLOOR = 0.55  # of the height: below this line most of what is seen is road
_GRID = 0.2  # of the picture's sides: the patches whose brightness shows vignetting


@dataclass(frozen=True)
class Traits:
    """Of a folder of pictures."""

    pictures: int
    road_rgb: tuple[float, ...]  # median of the floor
    paint_rgb: tuple[float, ...]  # brightest twentieth of the floor
    above_rgb: tuple[float, ...]  # median of the top third
    cast_rg: float  # red over green of bright floor: 1 is neutral
    cast_bg: float  # blue over green
    saturation: float  # mean of HSV, 0..1
    contrast: float  # standard deviation of grey levels
    clipped: float  # share of pixels with a channel at 255
    noise: float  # standard deviation, grey levels (Immerkaer 1996), on the flattest third
    edge_px: float  # standard deviation of the blur of the sharpest edges
    streak: float  # gradients across over those along the rows: motion blur pushes it below 1
    corners: float  # brightness of the lower corners over that of the lower middle

    def figures(self) -> dict[str, str]:
        """What stands in a table, by name."""
        return {name: _text(value) for name, value in vars(self).items()}


def measure_folder(folder: Path, most: int) -> Traits:
    """Traits of a folder of pictures, of evenly chosen ones if it has more than ``most``.

    Raises:
        ConfigError: it is absent or holds no pictures.
    """
    images = load_pictures([folder], ImageSpec()).images
    return measure_traits(images[spread(len(images), min(most, len(images)))])


def measure_look(look: str, count: int, map_name: str = "town", seed: int = 0) -> Traits:
    """Traits of so many draws of a look, each on a lane of a map.

    Raises:
        ConfigError: no such look.
    """
    rng = np.random.default_rng(seed)
    return measure_traits(draws(load_map(map_name), load_look_sampler(look), count, rng))


def measure_traits(frames: np.ndarray) -> Traits:
    """Traits of frames (N, 120, 160, 3) uint8 RGB."""
    rows = [_of_frame(frame) for frame in frames]
    columns = np.median(np.array(rows), axis=0).tolist()
    road, paint, above, rest = columns[0:3], columns[3:6], columns[6:9], columns[9:]
    return Traits(len(frames), tuple(road), tuple(paint), tuple(above), *rest)


def _text(value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{each:.0f}" for each in value)
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _of_frame(frame: np.ndarray) -> list[float]:
    height, width = frame.shape[:2]
    floor = frame[round(_FLOOR * height) :].reshape(-1, 3).astype(float)
    brightness = floor.mean(1)
    paint = floor[brightness >= np.quantile(brightness, 0.95)].mean(0)
    above = np.median(frame[: height // 3].reshape(-1, 3), axis=0)
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    saturation = cv2.cvtColor(frame, cv2.COLOR_RGB2HSV)[..., 1].mean() / 255.0
    across = np.abs(np.diff(grey, axis=1))
    along = np.abs(np.diff(grey, axis=0))
    v, u = round(_GRID * height), round(_GRID * width)
    corners = 0.5 * (np.median(grey[-v:, :u]) + np.median(grey[-v:, -u:]))
    middle = np.median(grey[-v:, (width - u) // 2 : (width + u) // 2])
    return [
        *np.median(floor, axis=0),
        *paint,
        *above,
        paint[0] / max(paint[1], 1.0),
        paint[2] / max(paint[1], 1.0),
        float(saturation),
        float(grey.std()),
        float((frame == 255).any(-1).mean()),
        _noise(grey),
        _edge_px(grey),
        float(across.mean() / max(float(along.mean()), 1e-6)),
        float(corners / max(float(middle), 1.0)),
    ]


def _noise(grey: np.ndarray) -> float:
    """From what a difference of two Laplacians leaves, where the picture is flat."""
    kernel = np.array(((1, -2, 1), (-2, 4, -2), (1, -2, 1)), np.float32)
    left = np.abs(cv2.filter2D(grey, -1, kernel))[1:-1, 1:-1]
    gradient = cv2.GaussianBlur(np.abs(cv2.Laplacian(grey, -1, ksize=3)), (0, 0), 2.0)[1:-1, 1:-1]
    flat = gradient <= np.quantile(gradient, 0.3)
    return float(np.sqrt(np.pi / 2.0) * left[flat].mean() / 6.0)


def _edge_px(grey: np.ndarray) -> float:
    """An edge of contrast C under a Gaussian blur s is at most C / (s sqrt(2 pi)) steep."""
    row = np.ones((1, 13), np.uint8)
    slopes, contrasts = (
        np.abs(np.gradient(grey, axis=1)),
        cv2.dilate(grey, row) - cv2.erode(grey, row),
    )
    strong = slopes >= np.quantile(slopes, 0.995)
    ratios = contrasts[strong] / np.maximum(slopes[strong], 1.0)
    return float(np.median(ratios) / np.sqrt(2.0 * np.pi))
