"""A contact sheet: what a policy wants to do on each of many pictures."""

from __future__ import annotations

import math
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from robot.contract import DRIVE, ActionTable
from robot.geometry import WheelSpeeds

TILE = (240, 180)  # width, height of a picture on the sheet [px]
STRIP_PX = 44  # below it: a bar for each action
COLUMNS = 6
MOST_TILES = 60
INK, PAPER = (235, 235, 235), (24, 24, 28)
CHOSEN, OTHER = (80, 220, 110), (110, 115, 130)
ARROW_S = 0.6  # the arrow shows the way of so many seconds
ARROW_PX_PER_M = 330.0

Rgb = Tuple[int, int, int]
XY = Tuple[int, int]


class Labelled(NamedTuple):
    """One frame (120, 160, 3) uint8 RGB with a policy's answer."""

    name: str
    frame: np.ndarray
    action: int
    values: np.ndarray  # (actions,)


def draw_sheet(pictures: Sequence[Labelled], actions: ActionTable) -> np.ndarray:
    """All pictures, or ``MOST_TILES`` of them evenly spaced, as one picture (H, W, 3) uint8 RGB."""
    count = min(len(pictures), MOST_TILES)
    chosen = [pictures[i] for i in np.linspace(0, len(pictures) - 1, count).round().astype(int)]
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    high = TILE[1] + STRIP_PX
    sheet = np.full((rows * high, columns * TILE[0], 3), PAPER, np.uint8)
    for i, picture in enumerate(chosen):
        top, left = i // columns * high, i % columns * TILE[0]
        sheet[top : top + high, left : left + TILE[0]] = draw_tile(picture, actions)
    return sheet


def draw_tile(picture: Labelled, actions: ActionTable) -> np.ndarray:
    """One picture with its name, the way of the chosen action and a bar for every action."""
    import cv2

    tile = np.full((TILE[1] + STRIP_PX, TILE[0], 3), PAPER, np.uint8)
    tile[: TILE[1]] = cv2.resize(picture.frame, TILE, interpolation=cv2.INTER_CUBIC)
    _write(tile, picture.name, (4, 12))
    start = (TILE[0] // 2, TILE[1] - 6)
    _arrow(tile, arrow_points(actions[picture.action], start), CHOSEN, 3)
    _bars(tile, picture, actions)
    return tile


def arrow_points(wheels: Tuple[float, float], start: XY, scale: float = 1.0) -> List[XY]:
    """The way of an action from above, forward up, as pixels from ``start``."""
    twist = DRIVE.twist(WheelSpeeds(*wheels))
    x_m = y_m = 0.0
    points = [start]
    steps = 12
    for i in range(steps):
        heading = twist.turn_radps * ARROW_S * (i + 0.5) / steps
        x_m += twist.forward_mps * ARROW_S / steps * math.cos(heading)
        y_m += twist.forward_mps * ARROW_S / steps * math.sin(heading)
        pixels = scale * ARROW_PX_PER_M
        points.append((round(start[0] - pixels * y_m), round(start[1] - pixels * x_m)))
    return points


def _bars(tile: np.ndarray, picture: Labelled, actions: ActionTable) -> None:
    """Bar lengths run from the worst value to the best; the glyph above a bar is its action."""
    import cv2

    low, high = float(picture.values.min()), float(picture.values.max())
    span = max(high - low, 1e-12)
    wide = TILE[0] // len(actions)
    for action, wheels in enumerate(actions):
        colour = CHOSEN if action == picture.action else OTHER
        left, bottom = action * wide, TILE[1] + STRIP_PX
        _arrow(tile, arrow_points(wheels, (left + 14, bottom - 12), 0.4), colour, 1)
        share = (float(picture.values[action]) - low) / span
        end = left + 4 + round((wide - 8) * share)
        cv2.rectangle(tile, (left + 4, bottom - 8), (max(end, left + 5), bottom - 4), colour, -1)
        _write(tile, f"{picture.values[action]:.2g}", (left + 22, bottom - 20), colour)


def _arrow(tile: np.ndarray, points: List[XY], colour: Rgb, width: int) -> None:
    import cv2

    line = np.array(points, np.int32)[:, None]
    if width > 1:
        cv2.polylines(tile, [line], False, PAPER, width + 3, cv2.LINE_AA)
    cv2.polylines(tile, [line], False, colour, width, cv2.LINE_AA)
    back = np.array(points[-4]) - points[-1]
    back = back / max(float(np.hypot(*back)), 1e-9) * (3 + 3 * width)
    for turn in (0.5, -0.5):
        c, s = math.cos(turn), math.sin(turn)
        barb = (back[0] * c - back[1] * s, back[0] * s + back[1] * c)
        end = (round(points[-1][0] + barb[0]), round(points[-1][1] + barb[1]))
        cv2.line(tile, points[-1], end, colour, width, cv2.LINE_AA)


def _write(tile: np.ndarray, text: str, at: XY, colour: Rgb = INK) -> None:
    import cv2

    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(tile, text, at, font, 0.33, PAPER, 3, cv2.LINE_AA)
    cv2.putText(tile, text, at, font, 0.33, colour, 1, cv2.LINE_AA)
