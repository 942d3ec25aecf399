"""The yellow line of the road in one camera frame: where it runs, and whether we crossed it.

A parabola through the dashes' middles (paper A, section 4.1), fitted on the floor in metres. It is
judged at the nearest point ahead of the robot that its camera sees, the middle of the picture's
lower edge (12 cm ahead of the axle): no picture tells where a line goes below the robot. Traffic
keeps right: the line belongs on the robot's left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robot.errors import ContractError
from robot.geometry import Pose, wrap_angle
from robot.lens import CameraRig
from trainer.judging.yellow_dashes import (
    DEFAULT,
    Dash,
    YellowLineParameters,
    find_dashes,
    floor_table,
    yellow_mask,
)

LINE_POINTS = 12  # of a fit that is drawn
ORIGIN = Dash(0.0, 0.0, 0.0, 0.0, 0.0, 0)


@dataclass(frozen=True)
class YellowLine:
    """The line, robot frame [m], judged at the nearest point ahead of the robot that is seen.

    Without a line ``found`` is False and the numbers are NaN.
    """

    found: bool
    offset_m: float = math.nan  # of the point ahead of the robot, positive to the line's left
    heading_rad: float = math.nan  # of the line there
    dashes: tuple[Dash, ...] = ()  # fitted, the nearest first
    line_m: tuple[tuple[float, float], ...] = ()  # points along the fit, from the robot on

    @property
    def crossed(self) -> bool | None:
        """Whether that point is left of the line; None when no line was found."""
        return self.offset_m > 0.0 if self.found else None


NOT_FOUND = YellowLine(False)


def detect_yellow_line(
    frame: np.ndarray, rig: CameraRig, parameters: YellowLineParameters = DEFAULT
) -> YellowLine:
    """Find the yellow line in a frame (H, W, 3) uint8 RGB of any size.

    Args:
        frame: the whole picture of the camera.
        rig: its lens, for a picture of any size, and its mounting.
        parameters: what counts as a dash.

    Raises:
        ContractError: ``frame`` is no RGB picture.
    """
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        raise ContractError(f"frame: expected (H, W, 3) uint8 RGB, got {frame.shape} {frame.dtype}")
    floor = floor_table(rig, frame.shape[1], frame.shape[0], parameters.range_m)
    mask = yellow_mask(frame, floor, parameters)
    dashes = find_dashes(mask, floor, parameters)
    return fit_line(chain(dashes, parameters), floor.reference_m, parameters)


def chain(dashes: tuple[Dash, ...], parameters: YellowLineParameters = DEFAULT) -> tuple[Dash, ...]:
    """The dashes of one line: from the nearest on, each the next one roughly straight on."""
    left = sorted(dashes, key=lambda dash: math.hypot(dash.x_m, dash.y_m))
    line, left = left[:1], left[1:]
    while left and len(line) < parameters.dashes:
        bearing = _bearing(line[-2], line[-1]) if len(line) > 1 else None
        ahead = [dash for dash in left if _follows(line[-1], dash, bearing, parameters)]
        if not ahead:
            break
        line.append(min(ahead, key=lambda dash: _distance(line[-1], dash)))
        left.remove(line[-1])
    if len(line) == 1 and _distance(line[0], ORIGIN) > parameters.alone_m:
        return ()
    return tuple(line)


def _follows(
    last: Dash, dash: Dash, bearing: float | None, parameters: YellowLineParameters
) -> bool:
    if _distance(last, dash) > parameters.max_step_m:
        return False
    turn = 0.0 if bearing is None else float(wrap_angle(_bearing(last, dash) - bearing))
    return abs(turn) <= parameters.max_turn_rad


def _bearing(start: Dash, end: Dash) -> float:
    return math.atan2(end.y_m - start.y_m, end.x_m - start.x_m)


def _distance(a: Dash, b: Dash) -> float:
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)


def fit_line(
    dashes: tuple[Dash, ...],
    reference_m: float,
    parameters: YellowLineParameters = DEFAULT,
) -> YellowLine:
    """A parabola through the dashes' middles; a straight line where there are only one or two.

    Args:
        dashes: of one line, the nearest first.
        reference_m: how far ahead of the axle the point lies whose side is asked for [m].
        parameters: how much the line may bend.
    """
    if not dashes:
        return NOT_FOUND
    middles = np.array([(dash.x_m, dash.y_m) for dash in dashes])
    direction = dashes[0].direction_rad
    if len(dashes) > 1:
        chord = middles[min(len(dashes) - 1, 2)] - middles[0]
        direction = _forward(math.atan2(chord[1], chord[0]))
    # In this frame, the first dash at its origin, the line is a function of the way along it.
    frame = Pose(dashes[0].x_m, dashes[0].y_m, direction)
    along, across = frame.to_robot(middles).T
    at_m, side_m = frame.to_robot(np.array((reference_m, 0.0)))
    # A short piece far away tells no bend: carried on to the robot it would lead anywhere.
    order = len(dashes) if abs(at_m) <= parameters.max_extension * np.ptp(along) else 2
    terms = np.vander(along, 3)[:, -min(order, len(dashes)) :]
    fitted = np.linalg.lstsq(terms, across, rcond=None)[0]
    curve = np.concatenate((np.zeros(3 - len(fitted)), fitted))
    curve[0] = np.clip(curve[0], -parameters.max_bend_pm, parameters.max_bend_pm)
    slope = 2.0 * curve[0] * at_m + curve[1]
    offset_m = (side_m - np.polyval(curve, at_m)) / math.hypot(1.0, slope)
    ways = np.linspace(min(at_m, 0.0), along.max(), LINE_POINTS)
    points = frame.to_world(np.stack((ways, np.polyval(curve, ways)), axis=1))
    return YellowLine(
        True,
        float(offset_m),
        float(wrap_angle(direction + math.atan(slope))),
        dashes,
        tuple((float(x), float(y)) for x, y in points),
    )


def _forward(direction_rad: float) -> float:
    """The same axis, as the direction that leads ahead of the robot."""
    return math.atan(math.tan(direction_rad))
