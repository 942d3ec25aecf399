"""What sight tells of a picture, drawn over it: the lane, the red line, and a few words."""

import math
from pathlib import Path

import cv2
import numpy as np

from robot.geometry import Pose
from robot.inference.preprocess import preprocess
from robot.lens import CameraRig
from robot.navigation.lane_view import KINDS
from robot.vision.sight import OnnxSight, Seen
from sim_pybullet.look import NOMINAL
from trainer.judging.explain import redraw
from trainer.mp4 import enlarged

_AHEAD_M = np.linspace(0.1, 0.55, 16)  # where the lane is drawn, before the axle
_HALF_LINE_M = 0.1
_FAR_PX = 1e4  # beyond it the lens says nothing, and figures may not fit
_CYAN, _RED, _WHITE = (0, 230, 230), (255, 40, 40), (255, 255, 255)


def write_seen(sight: OnnxSight, source: Path, out: Path) -> int:
    """Draw what is seen in a picture, a folder of pictures, or a film; how many there were."""
    image, rig = sight.contract.image, NOMINAL.rig()
    return redraw(
        source, out, "seen", lambda frame: drawn(frame, sight(preprocess(frame, image)[None]), rig)
    )


def drawn(frame: np.ndarray, seen: Seen, rig: CameraRig) -> np.ndarray:
    """A frame (120, 160, 3) enlarged to a width of 480, with what was seen in it (N is 1).

    The middle of the lane is drawn as a parabola on the floor under a camera of this rig, the
    fainter the less sure its heading is.
    """
    picture = enlarged(frame)
    offset_m, heading_rad, curvature_pm, line_m = seen.figures[0, :4].tolist()
    scaled = CameraRig(rig.lens.scaled(picture.shape[1], picture.shape[0]), rig.mount)
    left_m = -offset_m + 0.5 * curvature_pm * _AHEAD_M**2
    over, axle = picture.copy(), Pose(0.0, 0.0, -heading_rad)
    if seen.road[0] > 0.5:
        _line(over, axle.to_world(np.stack((_AHEAD_M, left_m), axis=1)), scaled, _CYAN)
    if seen.line[0] > 0.5:
        ends = np.array([(line_m, side - offset_m) for side in (-_HALF_LINE_M, _HALF_LINE_M)])
        _line(over, axle.to_world(ends), scaled, _RED)
    sure = float(np.clip(1.2 - 3.0 * seen.deviations[0, 1], 0.15, 1.0))
    picture = cv2.addWeighted(over, sure, picture, 1.0 - sure, 0.0)
    for row, text in enumerate(_words(seen)):
        cv2.putText(picture, text, (6, 16 + 17 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _WHITE, 1)
    return picture


def _words(seen: Seen) -> tuple[str, ...]:
    figures, deviations = seen.figures[0], seen.deviations[0]
    kind, likely = int(seen.junction[0].argmax()), seen.junction[0].max()
    line, way = (f"{100 * figures[i]:.0f} +-{100 * deviations[i]:.0f} cm" for i in (3, 4))
    line = line if seen.line[0] > 0.5 else "none"
    return (
        f"road {seen.road[0]:.0%}  line {line}  junction {KINDS[kind]} {likely:.0%}",
        f"offset {100 * figures[0]:+.1f} +-{100 * deviations[0]:.1f} cm  heading "
        f"{math.degrees(figures[1]):+.0f} +-{math.degrees(deviations[1]):.0f} deg",
        f"bend {figures[2]:+.1f} /m  way {way if seen.thing[0] > 0.5 else 'free'}",
    )


def _line(picture: np.ndarray, floor_m: np.ndarray, rig: CameraRig, rgb: tuple[int, ...]) -> None:
    pixels = rig.to_pixels(np.column_stack((floor_m, np.zeros(len(floor_m)))))
    near = np.abs(pixels).max(axis=1) < _FAR_PX  # nor a NaN
    points = np.rint(pixels[near]).astype(np.int32)
    cv2.polylines(picture, [points[:, None]], False, rgb, 3, cv2.LINE_AA)
