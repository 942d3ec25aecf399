"""What an image sensor makes of the light behind the lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from robot.contract import FRAME_WIDTH_PX
from sim_pybullet.look import SensorLook
from sim_pybullet.sensing.optics import PX_PER_RAD, smeared, with_infrared
from sim_pybullet.sensing.sensor_kernel import blur, expose

_NOISE_SIZE = 1 << 16  # values in the noise table; each row of a picture starts anywhere in it
_SMALLEST_BLUR_PX = 0.2  # a narrower one changes no grey level


def apply_sensor(
    frames: np.ndarray,
    looks: Sequence[SensorLook],
    rng: np.random.Generator,
    crop_top_px: int = 0,
    turns_radps: np.ndarray | None = None,
) -> np.ndarray:
    """Smear, blur, infrared, vignetting, exposure, white balance, noise, JPEG, in that order.

    Blur and noise are those of a frame 160 px wide. A picture of another width gets what area
    averaging would leave of them, so that small pictures may be drawn directly.

    Args:
        frames: (N, H, W, 3) uint8 RGB; left as they are.
        looks: one for each frame.
        rng: used only where a look has noise.
        crop_top_px: how many rows of the whole picture are missing above, for the vignette.
        turns_radps: (N,) how fast each robot turns; without it nothing is smeared.

    Returns:
        (N, H, W, 3) uint8; ``frames`` itself when all looks are nominal.
    """
    if len(looks) != len(frames):
        raise ValueError(
            f"apply_sensor: expected {len(frames)} looks, one per frame, got {len(looks)}"
        )
    if all(look == _NOMINAL for look in looks):
        return frames
    scale = frames.shape[2] / FRAME_WIDTH_PX
    seen = frames
    if turns_radps is not None:
        shutters = np.array([look.shutter_s for look in looks])
        seen = smeared(seen, scale * PX_PER_RAD * shutters * np.abs(turns_radps))
    seen = _blurred(seen, [scale * look.blur_px for look in looks])
    seen = with_infrared(seen, [look.infrared for look in looks])
    if any(_changes_values(look) for look in looks):
        gains = [look.exposure * np.array(look.white_balance) for look in looks]
        noise = [min(1.0, scale) * look.noise for look in looks]
        seen = _exposed(seen, gains, [look.vignetting for look in looks], noise, rng, crop_top_px)
    return _compressed(seen, [look.jpeg_quality for look in looks])


_NOMINAL = SensorLook()


def _changes_values(look: SensorLook) -> bool:
    gains = (look.exposure, *look.white_balance)
    return look.vignetting > 0.0 or look.noise > 0.0 or any(gain != 1.0 for gain in gains)


def _blurred(frames: np.ndarray, sigmas_px: list[float]) -> np.ndarray:
    if max(sigmas_px) < _SMALLEST_BLUR_PX:
        return frames
    radius = math.ceil(3.0 * max(sigmas_px))
    sigmas = np.maximum(np.array(sigmas_px), 1e-3)[:, None]
    kernels = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigmas) ** 2)
    kernels *= np.abs(np.arange(-radius, radius + 1)) <= np.ceil(3.0 * sigmas)  # each its own
    kernels /= kernels.sum(axis=1, keepdims=True)
    flat = frames.reshape(*frames.shape[:2], -1)
    return np.asarray(blur(flat, kernels.astype(np.float32))).reshape(frames.shape)


def _compressed(frames: np.ndarray, qualities: list[int]) -> np.ndarray:
    if min(qualities) >= 100:
        return frames
    compressed = frames.copy()
    for frame, quality in zip(compressed, qualities, strict=True):
        if quality < 100:
            _, data = cv2.imencode(".jpg", frame[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, quality))
            frame[:] = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1]
    return compressed


@lru_cache(maxsize=4)
def _noise_table(longest_row: int) -> np.ndarray:
    """A fixed stretch of unit normal noise that any row may be read from, float32."""
    noise = np.random.default_rng(0).standard_normal(_NOISE_SIZE, np.float32)
    return np.concatenate((noise, noise[:longest_row]))


def _exposed(
    frames: np.ndarray,
    gains: list[np.ndarray],
    vignettings: list[float],
    noise: list[float],
    rng: np.random.Generator,
    crop_top: int,
) -> np.ndarray:
    """Frames times (1 - vignetting r^2) times gain plus noise; r is 1 in the whole's corners."""
    count, height, width, _ = frames.shape
    starts = np.zeros((count, height), np.int64)
    if any(noise):
        starts = rng.integers(0, _NOISE_SIZE, (count, height))
    row = np.arange(height) - 0.5 * (height + crop_top - 1) + crop_top
    column = np.arange(width) - 0.5 * (width - 1)
    corner = max(0.25 * ((width - 1) ** 2 + (height + crop_top - 1) ** 2), 1.0)
    exposed = expose(
        frames.reshape(count, height, -1),
        np.tile(np.array(gains, np.float32), width),
        np.array(vignettings, np.float32),
        (row * row / corner).astype(np.float32),
        np.repeat(column * column / corner, 3).astype(np.float32),
        np.array(noise, np.float32),
        starts,
        _noise_table(3 * width),
    )
    return np.asarray(exposed).reshape(frames.shape)
