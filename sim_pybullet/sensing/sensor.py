"""Light that goes astray on its way to the sensor: smears, and lamps in the floor."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from robot.contract import FRAME_WIDTH_PX
from robot.lens import DUCKIEBOT_LENS
from sim_pybullet.look import LightLook, SensorLook

# A turn by one radian moves the middle of a 160 px wide frame by so many pixels.
PX_PER_RAD = DUCKIEBOT_LENS.fx_px * FRAME_WIDTH_PX / DUCKIEBOT_LENS.width_px
_SMALLEST_SMEAR_PX = 0.3
LAMP = 200.0  # grey levels of a lamp that the floor mirrors fully
LOG_BARELY = math.log(1e-3)  # of the spot's brightest, what counts as dark
_NOISE_SIZE = 1 << 16  # values in the noise table; each row of a picture starts anywhere in it
_SMALLEST_BLUR_PX = 0.2  # a narrower one changes no grey level
# Foam, cloth and paint alike reflect near infrared; red and blue pixels let most of it through.
_INFRARED_RGB = np.array((1.15, 0.85, 1.05))


def smeared(frames: np.ndarray, lengths_px: np.ndarray) -> np.ndarray:
    """The frames (N, H, W, 3), averaged in place over so many pixels along the rows of each.

    A robot on the floor turns about the vertical, so that its picture moves sideways.
    """
    for k in np.flatnonzero(lengths_px > _SMALLEST_SMEAR_PX):
        weights = smear_weights(lengths_px[k])[None]
        frames[k] = cv2.filter2D(frames[k], -1, weights, borderType=cv2.BORDER_REPLICATE)
    return frames


def smear_weights(length_px: float) -> np.ndarray:
    """(2 R + 1,) weights of the pixels to both sides in an average over so many."""
    half = int(np.ceil(0.5 * length_px)) if length_px > _SMALLEST_SMEAR_PX else 0
    weights = np.clip(0.5 * length_px + 0.5 - np.abs(np.arange(-half, half + 1)), 0.0, 1.0)
    return weights / weights.sum()


def add_gloss(frame: np.ndarray, rays: np.ndarray, light: LightLook, heading_rad: float) -> None:
    """Add the light's mirror image in the floor to a frame (H, W, 3) uint8, in place.

    Phong's model: the spot lies where a ray (H, W, 3) mirrored by the floor meets the light, whose
    direction is in the world frame. Solids are not told from the floor: the spot lies over them.
    """
    lamp, variance = lamp_in_floor(light, heading_rad), light.gloss_width_rad**2
    near, seen = _near(rays.reshape(-1, 3), lamp, np.float32(1.0 + variance * LOG_BARELY))
    # numpy's exp, not the compiler's: they differ in the last bit
    spot = np.exp((np.minimum(near, np.float32(1.0)) - np.float32(1.0)) / np.float32(variance))
    _add(frame.reshape(-1, 3), seen, np.float32(light.gloss * LAMP) * spot)


def lamp_in_floor(light: LightLook, heading_rad: float) -> np.ndarray:
    """Unit vector (3,) float32 in robot axes to the light's mirror image."""
    ahead, level = light.azimuth_rad - heading_rad, math.cos(light.elevation_rad)
    towards = (level * math.cos(ahead), level * math.sin(ahead), -math.sin(light.elevation_rad))
    return np.array(towards, np.float32)


@njit(nogil=True, cache=True)
def _near(rays: np.ndarray, lamp: np.ndarray, least: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Cosines (M,) of the angles between the lamp and those rays (P, 3) that meet the floor and
    are so alike; their numbers (M,)."""
    near, seen = np.empty(len(rays), np.float32), np.empty(len(rays), np.int32)
    count = 0
    b, c = np.float64(lamp[1]), np.float64(lamp[2])
    for p in range(len(rays)):
        across = np.float32(b * rays[p, 1] + np.float64(rays[p, 0] * lamp[0]))
        cosine = np.float32(c * rays[p, 2] + across)
        near[count], seen[count] = cosine, p
        if cosine > least and rays[p, 2] < 0.0:
            count += 1
    return near[:count], seen[:count]


@njit(nogil=True, cache=True)
def _add(pixels: np.ndarray, which: np.ndarray, light: np.ndarray) -> None:
    """To pixels (P, 3) of these numbers (M,) so much light (M,), in place."""
    for k in range(len(which)):
        pixel = pixels[which[k]]
        for colour in range(3):
            bright = np.float32(pixel[colour]) + light[k] + np.float32(0.5)
            pixel[colour] = np.uint8(min(bright, np.float32(255.0)))


class Mirror(NamedTuple):
    """A floor that mirrors a light: that light, and the pixels' rays (H, W, 3) in robot axes."""

    light: LightLook
    rays: np.ndarray


class Sensors:
    """The sensors of N robots.

    The light's mirror image in the floor, smear, blur, infrared, vignetting, exposure, white
    balance, noise, JPEG, in that order. Blur and noise are those of a frame 160 px wide. A picture
    of another width gets what area averaging would leave of them, so that small pictures may be
    drawn directly; of the whole ``crop_top_px`` rows are missing above, for the vignette.
    """

    def __init__(self, count: int, shape: tuple[int, ...], crop_top_px: int = 0) -> None:
        height, width = shape[:2]
        self._height, self._scale = height, width / FRAME_WIDTH_PX
        self._looks = [SensorLook()] * count
        self._mirrors: list[Mirror | None] = [None] * count
        self._kernels = [_gaussian(0.0)] * count  # of the blur
        self._mixing, self._gains = np.zeros((count, 3, 3)), np.ones((count, 3))
        self._noise = _noise_table(3 * width)
        whole = height + crop_top_px - 1
        row = np.arange(height) - 0.5 * whole + crop_top_px
        column = np.arange(width) - 0.5 * (width - 1)
        corner = max(0.25 * ((width - 1) ** 2 + whole**2), 1.0)  # r is 1 in the whole's corners
        self._rows = (row * row / corner).astype(np.float32)  # of r^2
        self._columns = np.repeat(column * column / corner, 3).astype(np.float32)

    def blank(self, shape: tuple[int, ...]) -> np.ndarray:
        """Black pictures of this shape, uint8, of the kind that is taken."""
        return np.zeros(shape, np.uint8)

    def put(self, i: int, look: SensorLook, mirror: Mirror | None = None) -> None:
        """Robot ``i`` has this sensor, over this floor if it mirrors the light."""
        self._looks[i], self._mirrors[i] = look, mirror
        towards = look.infrared * np.outer(_INFRARED_RGB, np.full(3, 1 / 3))
        self._mixing[i] = (1.0 - look.infrared) * np.eye(3) + towards
        self._gains[i] = look.exposure * np.array(look.white_balance)
        self._kernels[i] = _gaussian(self._scale * look.blur_px)

    def take(
        self,
        frames: np.ndarray,
        robots: np.ndarray,
        rng: np.random.Generator,
        turns_radps: np.ndarray | float = 0.0,
        headings_rad: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """The pictures of robots (M,) from frames (M, H, W, 3) uint8, which may be overwritten.

        ``rng`` is used only where a sensor has noise. M robots turn at ``turns_radps`` (M,) and
        look along ``headings_rad`` (M,) of the frame in which their light's direction is told.
        """
        headings_rad = np.broadcast_to(headings_rad, len(robots))
        for i, frame, heading_rad in zip(robots, frames, headings_rad.tolist(), strict=True):
            mirror = self._mirrors[i]
            if mirror is not None:
                add_gloss(frame, mirror.rays, mirror.light, heading_rad)
        frames = smeared(frames, self._smears_px(robots, turns_radps))
        starts = self._noise_starts(robots, rng)
        for i, frame, begins in zip(robots.tolist(), frames, starts, strict=True):
            self._sense(i, frame, begins)
        return frames

    def _smears_px(self, robots: np.ndarray, turns_radps: np.ndarray | float) -> np.ndarray:
        shutters_s = np.array([self._looks[i].shutter_s for i in robots.tolist()])
        return self._scale * PX_PER_RAD * shutters_s * np.abs(turns_radps)

    def _noise_starts(self, robots: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(M, H) where in the table the noise of each row begins."""
        shape = len(robots), self._height
        if any(self._looks[i].noise for i in robots.tolist()):
            return rng.integers(0, _NOISE_SIZE, shape)
        return np.zeros(shape, np.int64)

    def _sense(self, i: int, frame: np.ndarray, starts: np.ndarray) -> None:
        look, gains, line = self._looks[i], self._gains[i], frame.reshape(self._height, -1)
        kernel = self._kernels[i]
        if len(kernel) > 1:
            _blur(line, kernel)
        if look.infrared > 0.0:
            frame[:] = cv2.transform(frame, self._mixing[i])
        if look.vignetting > 0.0 or look.noise > 0.0 or (gains != 1.0).any():
            shade = look.vignetting, min(1.0, self._scale) * look.noise
            _expose(line, gains, shade, starts, self._noise, self._rows, self._columns)
        if look.jpeg_quality < 100:
            bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
            _, data = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, look.jpeg_quality))
            seen = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))
            cv2.cvtColor(seen, cv2.COLOR_BGR2RGB, dst=frame)


def apply_sensor(
    frames: np.ndarray,
    looks: Sequence[SensorLook],
    rng: np.random.Generator,
    crop_top_px: int = 0,
    turns_radps: np.ndarray | float = 0.0,
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


@lru_cache(maxsize=256)
def _gaussian(sigma_px: float) -> np.ndarray:
    """(2 R + 1,) float32, cut at three standard deviations; (1,) where that changes nothing."""
    radius = math.ceil(3.0 * sigma_px) if sigma_px >= _SMALLEST_BLUR_PX else 0
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / max(sigma_px, 1e-9)) ** 2)
    return np.asarray(kernel / kernel.sum(), np.float32)


@njit(nogil=True, cache=True)
def _expose(
    frame: np.ndarray,
    gains: np.ndarray,
    shade: tuple[float, float],
    starts: np.ndarray,
    table: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """A frame (H, 3 W) times (1 - vignetting r^2) times gains (3,) plus noise; shade: both
    shares. The noise of each row begins at ``starts`` (H,) in the ``table``; r^2 is the sum of
    ``rows`` (H,) and ``columns`` (3 W,)."""
    vignetting, noise, width = np.float32(shade[0]), np.float32(shade[1]), frame.shape[1]
    each = np.empty(width, np.float32)
    for k in range(width):
        each[k] = gains[k % 3]
    for v in range(len(frame)):
        row, noisy = frame[v], table[starts[v] : starts[v] + width]
        middle = np.float32(1.0) - vignetting * rows[v]
        for k in range(width):  # products in full, rounded once, so that every processor agrees
            light = np.float32(middle - np.float64(vignetting) * columns[k]) * each[k]
            value = np.float32(0.5 + np.float64(light) * row[k])
            value = np.float32(value + np.float64(noise) * noisy[k])
            row[k] = np.uint8(np.int32(min(max(value, np.float32(0.0)), np.float32(255.0))))


@njit(nogil=True, cache=True, fastmath=True)
def _blur(frame: np.ndarray, kernel: np.ndarray) -> None:
    """A frame (H, 3 W) convolved in both directions with a kernel (2 R + 1,); edges repeat."""
    height, width = frame.shape
    radius = len(kernel) // 2
    pad = 3 * radius
    before = frame.copy()
    line = np.empty(width + 2 * pad, np.float32)
    total = np.empty(width, np.float32)
    for v in range(height):
        line[:] = np.float32(0.0)
        for j in range(len(kernel)):
            source = before[min(max(v + j - radius, 0), height - 1)]
            for k in range(width):
                line[pad + k] += kernel[j] * np.float32(source[k])
        for k in range(pad):
            line[k] = line[pad + k % 3]
            line[pad + width + k] = line[pad + width - 3 + k % 3]
        total[:] = np.float32(0.5)
        for j in range(len(kernel)):
            shifted = line[3 * j : 3 * j + width]
            for k in range(width):
                total[k] += kernel[j] * shifted[k]
        for k in range(width):
            frame[v, k] = np.uint8(np.int32(total[k]))
