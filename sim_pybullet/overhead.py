"""The camera above the arena, drawn exactly: a fisheye over the floor and boards at their height.

Each pixel's ray meets the floor, or a sheet above it, at a known point: no mesh, no PyBullet.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from localizer_node.calibration import Marker
from localizer_node.detect import draw_tag
from robot.geometry import Pose
from robot.lens import CameraRig, Hanging, Lens
from sim_pybullet.look import Rgb
from sim_pybullet.scene import Ground

OVERSAMPLE = 4  # rays per pixel side on printed sheets; half of it on sheets of one colour
PAINT: dict[str, Rgb] = {
    "blue": (28.0, 74.0, 196.0),
    "green": (52.0, 176.0, 84.0),
    "magenta": (206.0, 44.0, 150.0),
    "orange": (238.0, 124.0, 30.0),
}
BODY_RGB: Rgb = (38.0, 38.0, 40.0)
OVERHEAD_LENS = Lens("fisheye", 1280, 720, 720.0, 720.0, 639.5, 359.5, (0.01, -0.004, 0.0, 0.0))


@dataclass(frozen=True)
class Sheet:
    """A flat rectangle parallel to the floor; row 0 of ``rgb`` is its front edge."""

    pose: Pose  # of its middle
    length_m: float  # along the heading
    width_m: float
    height_m: float
    rgb: np.ndarray  # (h, w, 3) uint8


class OverheadCamera:
    """Draws what hangs above ``ground`` sees; pictures are (H, W, 3) uint8 RGB.

    ``light`` gives of floor points (H, W, 2) [m] what the colours are multiplied by (H, W, 3).
    """

    def __init__(
        self,
        ground: Ground,
        hanging: Hanging = Hanging(),  # noqa: B008 (frozen)
        lens: Lens = OVERHEAD_LENS,
        light: Callable[[np.ndarray], np.ndarray] | None = None,
        blur_px: float = 0.6,
        noise: float = 3.0,
    ) -> None:
        self.lens, self.hanging, self.rig = lens, hanging, CameraRig(lens, hanging)
        self._ground, self._blur_px, self._noise = ground, blur_px, noise
        v, u = np.mgrid[0 : lens.height_px, 0 : lens.width_px].astype(float)
        floor_m = self.rig.to_floor(np.stack((u, v), axis=-1))
        even = np.ones((lens.height_px, lens.width_px, 3))
        self._light = (even if light is None else light(floor_m)).astype(np.float32)
        self._floor = self._sample_ground(floor_m) * self._light  # lit, sharp, float32

    def render(self, sheets: Iterable[Sheet], rng: np.random.Generator) -> np.ndarray:
        """One picture of the floor with these sheets on it, the higher above the lower."""
        lit: np.ndarray = self._floor.copy()
        for sheet in sorted(sheets, key=lambda s: s.height_m):
            self._draw(lit, sheet)
        if self._blur_px > 0.0:
            lit = cv2.GaussianBlur(lit, (0, 0), self._blur_px)
        picture = cv2.convertScaleAbs(lit)
        if self._noise > 0.0:
            _add_noise(picture, self._noise, rng)
        return picture

    def _sample_ground(self, floor_m: np.ndarray) -> np.ndarray:
        ground = self._ground
        column = ((floor_m[..., 0] - ground.west_m) / ground.texel_m - 0.5).astype(np.float32)
        row = ((ground.north_m - floor_m[..., 1]) / ground.texel_m - 0.5).astype(np.float32)
        column, row = (np.nan_to_num(a, nan=-1e4) for a in (column, row))
        outside = tuple(float(v) for v in ground.outside_rgb)
        # A picture pixel covers several texels: average them first, or lines would flicker.
        smooth = cv2.GaussianBlur(ground.rgb, (0, 0), max(0.5, 0.0012 / ground.texel_m))
        drawn = cv2.remap(smooth, column, row, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, outside)
        return drawn.astype(np.float32)

    def _draw(self, lit: np.ndarray, sheet: Sheet) -> None:
        """Paint a sheet into a sharp picture (H, W, 3) float32."""
        half = 0.5 * np.array([sheet.length_m, sheet.width_m])
        corners = sheet.pose.to_world(half * [[1, 1], [1, -1], [-1, -1], [-1, 1]])
        outline = self.rig.to_pixels(np.column_stack((corners, np.full(4, sheet.height_m))))
        limit = (self.lens.width_px, self.lens.height_px)
        low = np.clip(np.floor(outline.min(axis=0)) - 1, 0, limit).astype(int)
        high = np.clip(np.ceil(outline.max(axis=0)) + 2, 0, limit).astype(int)
        if np.any(high <= low):
            return
        n = OVERSAMPLE if sheet.rgb.size > 3 else OVERSAMPLE // 2
        height, width = sheet.rgb.shape[:2]
        texture = np.dstack((sheet.rgb, np.full((height, width), 255, np.uint8)))
        # So small a part of the lens's picture is as good as flat: its corners say all.
        edges = np.array(((0, 0), (width, 0), (width, height), (0, height)), np.float32) - 0.5
        fine_px = ((outline - low) * n + (0.5 * n - 0.5)).astype(np.float32)
        view = cv2.getPerspectiveTransform(edges, fine_px)
        fine = cv2.warpPerspective(  # 0, and so clear, beyond the sheet
            texture, view, tuple((high - low) * n), flags=cv2.INTER_NEAREST
        )
        size = (int(high[0] - low[0]), int(high[1] - low[1]))
        drawn = cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        slices = np.s_[low[1] : high[1], low[0] : high[0]]
        below = lit[slices] * (1.0 - drawn[..., 3:] / 255.0)
        lit[slices] = below + drawn[..., :3] * self._light[slices]


@lru_cache(maxsize=2)
def _noise_bank(sigma: float) -> np.ndarray:
    """Sensor noise to cut from, larger than a picture, int16."""
    grain = np.random.default_rng(0).standard_normal((1024, 4608), dtype=np.float32)
    return np.round(grain * sigma).astype(np.int16)


def _add_noise(picture: np.ndarray, sigma: float, rng: np.random.Generator) -> None:
    """Noise of each pixel and colour, cut from a random place of the bank for every 64 rows."""
    bank = _noise_bank(sigma)
    flat = picture.reshape(picture.shape[0], -1)
    for top in range(0, len(flat), 64):
        rows = flat[top : top + 64]
        v, u = (int(rng.integers(0, bank.shape[k] - rows.shape[k])) for k in (0, 1))
        rows[:] = cv2.add(rows, bank[v : v + len(rows), u : u + rows.shape[1]], dtype=cv2.CV_8U)


def board_rgb(marker: Marker) -> np.ndarray:
    """The marker's board as a picture of 2 px per mm, front edge up."""
    board = marker.board
    rows, columns = round(board.length_m * 2000), round(board.width_m * 2000)
    picture = np.empty((rows, columns, 3), np.uint8)
    picture[:] = np.array(PAINT["blue"], np.uint8)
    if marker.kind == "two_colour":
        picture[: round(board.front_m * 2000)] = np.array(PAINT[marker.front], np.uint8)
    if marker.kind == "tag":
        side = round(board.tag_m * 1.25 * 2000)  # black square and one white cell around it
        tag = cv2.resize(draw_tag(marker.tag), (side, side), interpolation=cv2.INTER_NEAREST)
        top, left = (rows - side) // 2, (columns - side) // 2
        picture[top : top + side, left : left + side] = tag
    return picture


def robot_sheets(marker: Marker, pose: Pose, board: np.ndarray | None = None) -> list[Sheet]:
    """A robot as sheets: its dark body in slices, and its board on top."""
    body = np.full((1, 1, 3), BODY_RGB, np.uint8)
    top = marker.board.height_m
    slices = [Sheet(pose, 0.16, 0.13, top * i / 3.0, body) for i in range(3)]
    x_m, y_m = pose.to_world(np.array([marker.board.forward_m, 0.0]))
    rgb = board_rgb(marker) if board is None else board
    size = (marker.board.length_m, marker.board.width_m, top)
    return [*slices, Sheet(Pose(x_m, y_m, pose.heading_rad), *size, rgb)]
