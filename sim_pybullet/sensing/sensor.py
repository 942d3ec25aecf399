"""What an image sensor makes of the light behind the lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from robot.contract import FRAME_WIDTH_PX
from sim_pybullet.look import SensorLook
from sim_pybullet.sensing.jpeg_kernel import quantisers
from sim_pybullet.sensing.optics import PX_PER_RAD, smeared
from sim_pybullet.sensing.sensor_kernel import Grain, SensorTable, sense

_NOISE_SIZE = 1 << 16  # values in the noise table; each row of a picture starts anywhere in it
_SMALLEST_BLUR_PX = 0.2  # a narrower one changes no grey level
# Foam, cloth and paint alike reflect near infrared; red and blue pixels let most of it through.
_INFRARED_RGB = np.array((1.15, 0.85, 1.05))


class Sensors:
    """The sensors of N robots.

    Smear, blur, infrared, vignetting, exposure, white balance, noise, JPEG, in that order. Blur and
    noise are those of a frame 160 px wide. A picture of another width gets what area averaging
    would leave of them, so that small pictures may be drawn directly.

    Args:
        shape: (H, W, 3) of their pictures.
        crop_top_px: how many rows of the whole picture are missing above, for the vignette.
    """

    def __init__(self, count: int, shape: tuple[int, ...], crop_top_px: int = 0) -> None:
        height, width = shape[:2]
        self._height, self._scale = height, width / FRAME_WIDTH_PX
        self._shutters_s = np.zeros(count)
        self._table = SensorTable(
            np.zeros((count, 1), np.float32),
            np.zeros((count, 3, 3), np.int32),
            np.ones((count, 3), np.float32),
            np.zeros(count, np.float32),
            np.zeros(count, np.float32),
            np.zeros((count, 2, 2, 256)),
            np.zeros((count, 4), bool),
        )
        whole = height + crop_top_px - 1
        row = np.arange(height) - 0.5 * whole + crop_top_px
        column = np.arange(width) - 0.5 * (width - 1)
        corner = max(0.25 * ((width - 1) ** 2 + whole**2), 1.0)  # r is 1 in the whole's corners
        self._grain = Grain(
            np.zeros((count, height), np.int64),
            _noise_table(3 * width),
            (row * row / corner).astype(np.float32),
            np.repeat(column * column / corner, 3).astype(np.float32),
        )

    def put(self, i: int, look: SensorLook) -> None:
        """Robot ``i`` has this sensor."""
        table, sigma = self._table, self._scale * look.blur_px
        gains = look.exposure * np.array(look.white_balance)
        shaded = look.vignetting > 0.0 or look.noise > 0.0 or bool((gains != 1.0).any())
        self._shutters_s[i] = look.shutter_s
        table.stages[i] = (
            sigma >= _SMALLEST_BLUR_PX,
            look.infrared > 0.0,
            shaded,
            look.jpeg_quality < 100,
        )
        if sigma >= _SMALLEST_BLUR_PX:
            self._put_blur(i, sigma)
        towards = look.infrared * np.outer(_INFRARED_RGB, np.full(3, 1 / 3))
        mixing = (1.0 - look.infrared) * np.eye(3) + towards
        table.infrared[i] = np.rint(mixing.astype(np.float32) * 1024.0)
        table.gains[i], table.vignetting[i] = gains, look.vignetting
        table.noise[i] = min(1.0, self._scale) * look.noise
        if look.jpeg_quality < 100:
            table.steps[i] = quantisers(look.jpeg_quality)

    def take(
        self,
        frames: np.ndarray,
        robots: np.ndarray,
        rng: np.random.Generator,
        turns_radps: np.ndarray | None = None,
    ) -> np.ndarray:
        """The pictures of robots (M,) from frames (M, H, W, 3) uint8, which may be overwritten.

        ``rng`` is used only where a sensor has noise; M robots turn at ``turns_radps`` (M,).
        """
        if turns_radps is not None:
            shutters_s = self._shutters_s[robots]
            frames = smeared(frames, self._scale * PX_PER_RAD * shutters_s * np.abs(turns_radps))
        if self._table.stages[robots].any():
            grain = self._grain
            if self._table.noise[robots].any():
                starts = rng.integers(0, _NOISE_SIZE, (len(robots), self._height))
                grain = grain._replace(starts=starts)
            sense(frames.reshape(len(frames), self._height, -1), robots, self._table, grain)
        return frames

    def _put_blur(self, i: int, sigma_px: float) -> None:
        radius = math.ceil(3.0 * sigma_px)
        kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
        missing = radius - self._table.blur.shape[1] // 2
        if missing > 0:
            wider = np.pad(self._table.blur, ((0, 0), (missing, missing)))
            self._table = self._table._replace(blur=wider)
        room = self._table.blur.shape[1] // 2
        self._table.blur[i] = 0.0
        self._table.blur[i, room - radius : room + radius + 1] = kernel / kernel.sum()


def apply_sensor(
    frames: np.ndarray,
    looks: Sequence[SensorLook],
    rng: np.random.Generator,
    crop_top_px: int = 0,
    turns_radps: np.ndarray | None = None,
) -> np.ndarray:
    """What sensors make of frames (N, H, W, 3) uint8 RGB, one look for each; see `Sensors`."""
    sensors = Sensors(len(frames), frames.shape[1:], crop_top_px)
    for i, look in zip(range(len(frames)), looks, strict=True):
        sensors.put(i, look)
    return sensors.take(frames.copy(), np.arange(len(frames)), rng, turns_radps)


@lru_cache(maxsize=4)
def _noise_table(longest_row: int) -> np.ndarray:
    """A fixed stretch of unit normal noise that any row may be read from, float32."""
    noise = np.random.default_rng(0).standard_normal(_NOISE_SIZE, np.float32)
    return np.concatenate((noise, noise[:longest_row]))
