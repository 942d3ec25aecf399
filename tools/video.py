"""A film of a drive: what the robot sees and looks at, where it is, and what it makes of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from robot.contract import ActionTable, action_name
from robot.errors import ContractError
from robot.geometry import Pose
from robot.inference.policy import read_contract
from sim_pybullet.scene import Ground
from tools.monitor.attention import weights_over
from trainer.judging.explain import Explainer
from trainer.mp4 import Mp4

SIZE_PX = (1280, 720)
CAMERA_PX = (800, 600)
MAP_BOX = (816, 64, 448, 486)  # left, top, width, height [px]
QUALITY = 5.0

Colour = tuple[int, int, int]
PAGE, CARD, LINE = (16, 18, 21), (25, 28, 32), (58, 64, 71)
TEXT, QUIET = (232, 234, 237), (151, 158, 167)
PATH, DUCK, TRUE = (110, 168, 254), (242, 183, 5), (255, 70, 160)
LIGHT = (255, 140, 20)  # where the policy looks
STATES = {"AUTO": (63, 182, 114), "MANUAL": (63, 182, 114), "READY": PATH}
STATES |= {"HOLD": (224, 160, 48), "FAULT": (255, 107, 107)}


@dataclass(frozen=True, eq=False)
class Moment:
    """What one picture shows; world frame, metres and radians."""

    camera: np.ndarray  # (H, W, 3) uint8 RGB
    pose: Pose  # the true one
    believed: Pose | None  # the robot's own
    state: str
    reason: str
    path: Sequence[Sequence[float]] = ()  # planned, (M, 2)
    values: Sequence[float] = ()  # of the policy, one an action
    action: int | None = None
    note: str = ""  # how far it has come


class MapView:
    """A floor from above, as large as a box allows, and the trail that a robot leaves on it."""

    def __init__(self, ground: Ground, width_px: int, height_px: int) -> None:
        rows, columns = ground.rgb.shape[:2]
        scale = min(width_px / columns, height_px / rows)
        size = (round(columns * scale), round(rows * scale))
        self.floor = cv2.resize(ground.rgb, size, interpolation=cv2.INTER_AREA)
        self.px_per_m = scale / ground.texel_m
        self.west_m, self.north_m = ground.west_m, ground.north_m
        self.trail: list[tuple[float, float]] = []

    def pixel(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Where a world point [m] is drawn."""
        column = (x_m - self.west_m) * self.px_per_m
        return round(column), round((self.north_m - y_m) * self.px_per_m)

    def draw(self, moment: Moment) -> np.ndarray:
        """The picture (H, W, 3) of a moment; the trail grows by its true pose."""
        self.trail.append((moment.pose.x_m, moment.pose.y_m))
        picture = self.floor.copy()
        self._line(picture, moment.path, PATH, 3)
        self._line(picture, self.trail, TRUE, 2)
        if moment.path and moment.path[0] != moment.path[-1]:  # not a ring
            cv2.circle(picture, self.pixel(*moment.path[-1][:2]), 7, PATH, -1, cv2.LINE_AA)
        cv2.fillConvexPoly(picture, self._outline(moment.pose, 1.0), TRUE, cv2.LINE_AA)
        if moment.believed is not None:
            outline = self._outline(moment.believed, 1.5)
            cv2.polylines(picture, [outline], True, DUCK, 2, cv2.LINE_AA)
        return picture

    def _line(
        self, picture: np.ndarray, points: Sequence[Sequence[float]], colour: Colour, width: int
    ) -> None:
        if len(points) > 1:
            pixels = np.array([self.pixel(*point[:2]) for point in points], dtype=np.int32)
            cv2.polylines(picture, [pixels], False, colour, width, cv2.LINE_AA)

    def _outline(self, pose: Pose, size: float) -> np.ndarray:
        corners = pose.to_world(size * np.array([[0.11, 0.0], [-0.05, 0.065], [-0.05, -0.065]]))
        return np.array([self.pixel(x, y) for x, y in corners], dtype=np.int32)


class DriveFilm:
    """An MP4 of `SIZE_PX`; ``turn_to`` a floor first, and ``close`` it."""

    def __init__(self, path: Path, model: Path, every_s: float) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._every_s, self._actions = every_s, read_contract(model).actions
        try:
            self._explainer: Explainer | None = Explainer(model)
        except ContractError:  # a network without convolutions looks nowhere in particular
            self._explainer = None
        self._video = Mp4(path, 1.0 / every_s, QUALITY)

    def turn_to(self, ground: Ground) -> None:
        """Go on on another floor."""
        self.map = MapView(ground, *MAP_BOX[2:])
        self._before: Pose | None = None

    def add(self, moment: Moment) -> None:
        """One more picture."""
        before, self._before = self._before or moment.pose, moment.pose
        moved_m = math.hypot(moment.pose.x_m - before.x_m, moment.pose.y_m - before.y_m)
        self._video.add(self._picture(moment, moved_m / self._every_s))

    def close(self) -> None:
        """Complete the video, if there is anything in it."""
        self._video.close()

    def _picture(self, moment: Moment, speed_mps: float) -> np.ndarray:
        picture = np.full((SIZE_PX[1], SIZE_PX[0], 3), PAGE, np.uint8)
        seen = moment.camera
        if self._explainer is not None:
            weights = cv2.resize(weights_over(self._explainer, seen), seen.shape[1::-1])[..., None]
            lit = (1.0 - 0.75 * weights) * seen + 0.75 * weights * np.array(LIGHT, np.float32)
            seen = np.asarray(lit, np.uint8)
        large = cv2.resize(seen, CAMERA_PX, interpolation=cv2.INTER_CUBIC)
        picture[: CAMERA_PX[1], : CAMERA_PX[0]] = large
        (left, top, width, height), above = MAP_BOX, self.map.draw(moment)
        left, top = left + (width - above.shape[1]) // 2, top + (height - above.shape[0]) // 2
        picture[top : top + above.shape[0], left : left + above.shape[1]] = above
        _draw_values(picture, moment, self._actions)
        _draw_state(picture, moment, speed_mps)
        return picture


def _draw_values(picture: np.ndarray, moment: Moment, actions: ActionTable) -> None:
    """Below the camera, a cell an action: its name, its value as number and bar."""
    width = CAMERA_PX[0] // len(actions)
    low, high = min(moment.values, default=0.0), max(moment.values, default=0.0)
    for i, wheels in enumerate(actions):
        cell = picture[CAMERA_PX[1] + 10 : SIZE_PX[1] - 10, i * width + 4 : (i + 1) * width - 4]
        ink, cell[:] = (PAGE, DUCK) if i == moment.action else (TEXT, CARD)
        write(cell, (8, 14), action_name(wheels).replace("_", " ").lower(), 13, ink)
        if i < len(moment.values):
            value = moment.values[i]
            write(cell, (8, 36), f"{value:.2f}", 20, ink)
            share = (value - low) / (high - low) if high > low else 0.0
            bottom, right = cell.shape[0] - 10, cell.shape[1] - 8
            cv2.rectangle(cell, (8, bottom - 5), (right, bottom), LINE, -1)
            cv2.rectangle(cell, (8, bottom - 5), (8 + round(share * (right - 8)), bottom), ink, -1)


def _draw_state(picture: np.ndarray, moment: Moment, speed_mps: float) -> None:
    """Above the map the state and why; below it speed, way and what the colours mean."""
    left = MAP_BOX[0]
    cv2.rectangle(picture, (left, 16), (left + 112, 48), STATES.get(moment.state, QUIET), -1)
    write(picture, (left + 12, 22), moment.state, 16, PAGE)
    write(picture, (left + 124, 24), moment.reason[:46], 13, QUIET)
    write(picture, (left, 562), f"{speed_mps:.2f} m/s", 38, TEXT)
    write(picture, (left + 220, 580), moment.note, 18, TEXT)
    meanings = [(0, "planned path", PATH), (128, "true pose and trail", TRUE)]
    if moment.believed is not None:
        meanings.append((298, "believed pose", DUCK))
    for right, name, of in meanings:
        at = left + right
        cv2.rectangle(picture, (at, 640), (at + 14, 654), of, -1)
        write(picture, (at + 22, 638), name, 14, QUIET)
    write(picture, (left, 678), "light on the picture: where the policy looks", 14, QUIET)


def write(picture: np.ndarray, at: tuple[int, int], text: str, height: int, ink: Colour) -> None:
    """Write a line with its upper left corner at a place, cut off at the picture's edge."""
    left, top = at
    room = picture[top : top + round(1.3 * height), left:]
    image = Image.fromarray(room)
    ImageDraw.Draw(image).text((0, 0), text, fill=ink, font=_font(height))
    room[:] = np.asarray(image)


@lru_cache
def _font(height: int) -> ImageFont.FreeTypeFont:
    path = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(str(path), height)
