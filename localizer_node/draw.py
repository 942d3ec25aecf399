"""Pictures for people: what the localizer saw, drawn into what it looked at."""

from __future__ import annotations

import math
from typing import Iterable, Tuple

import numpy as np

from localizer_node.calibration import Calibration, map_outline
from localizer_node.detect import Detection

Rgb = Tuple[int, int, int]
OUTLINE_RGB: Rgb = (250, 210, 60)
FOUND_RGB: Rgb = (60, 230, 110)
ARROW_M = 0.18


def annotated(
    image: np.ndarray, calibration: Calibration, detections: Iterable[Detection]
) -> np.ndarray:
    """A copy of the raw RGB picture with the map's edge and each robot's place and heading."""
    import cv2

    picture = image.copy()
    edge = np.round(calibration.to_pixels(map_outline(calibration.map_size_m))).astype(np.int32)
    cv2.polylines(picture, [edge.reshape(-1, 1, 2)], True, OUTLINE_RGB, 1, cv2.LINE_AA)
    heights = {m.robot: m.board.height_m for m in calibration.robots}
    for found in detections:
        _draw(picture, calibration, found, heights.get(found.robot, 0.0))
    return picture


def _draw(picture: np.ndarray, calibration: Calibration, found: Detection, height_m: float) -> None:
    import cv2

    start = (round(found.u_px), round(found.v_px))
    cv2.circle(picture, start, 4, FOUND_RGB, 2, cv2.LINE_AA)
    if found.heading_rad is not None:
        ahead = np.array([math.cos(found.heading_rad), math.sin(found.heading_rad)])
        tip = calibration.to_pixels(np.array([found.x_m, found.y_m]) + ARROW_M * ahead, height_m)
        end = (round(float(tip[0])), round(float(tip[1])))
        cv2.arrowedLine(picture, start, end, FOUND_RGB, 2, cv2.LINE_AA, tipLength=0.25)
    degrees = "?" if found.heading_rad is None else f"{math.degrees(found.heading_rad):.0f}"
    label = f"{found.robot} {found.x_m:.2f} {found.y_m:.2f} {degrees}"
    where = (start[0] + 14, start[1] - 14)
    cv2.putText(picture, label, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, label, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, FOUND_RGB, 1, cv2.LINE_AA)
