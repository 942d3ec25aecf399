"""A policy's lane-pose head against where drawn lines say that the robot stood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.inference.preprocess import preprocess
from robot.lens import CameraRig
from trainer.experiments.photographs.lines import Drawn, drawn_line, frames_of, load_lines
from trainer.judging.lane_head import LanePoseHead

LANE_FROM_YELLOW_M = 0.2 * 0.585  # the middle of a lane is a fifth of a tile right of the line
NEAR_M = 0.45  # lines farther away tell little of where the robot stands
_WITHIN_M = 0.15  # of the lane's middle: beyond, the robot stands in another lane
_WITHIN_RAD = 1.0
_TELLING_M, _TELLING_RAD = 0.02, 0.09  # from which on a side is told
_ENLARGED = 3


@dataclass(frozen=True)
class SitePose:
    """How well a head reads the photographs of one place; NaN where nothing can be said."""

    policy: str
    site: str
    photographs: int
    offset_mae_m: float
    heading_mae_rad: float
    offset_order: float  # Spearman's rank correlation
    heading_order: float
    offset_side: float  # share of those 2 cm off and more whose side is told
    heading_side: float  # of those 5 degrees off and more


def standing(drawn: Drawn, size: tuple[int, int], rig: CameraRig) -> tuple[float, float] | None:
    """(offset [m], heading [rad]) in the lane, positive to the left, by a photograph's yellow line.

    None where the robot does not stand in a right-hand lane beside a line that is near.
    """
    lines = [drawn_line(points, size, rig, 0.0) for points in drawn.yellow]
    near = [each for each in lines if each is not None and each.nearest_m < NEAR_M]
    if not near:
        return None
    line = min(near).line
    offset_m, heading_rad = line.offset_m + LANE_FROM_YELLOW_M, -line.heading_rad
    inside = abs(offset_m) < _WITHIN_M and abs(heading_rad) < _WITHIN_RAD
    return (offset_m, heading_rad) if inside else None


def read_photographs(
    policy: str, head: LanePoseHead, image: ImageSpec, photographs: Path, rig: CameraRig
) -> tuple[list[SitePose], np.ndarray]:
    """One row for each site, and a sheet of pictures with both poses drawn in.

    Args:
        policy: its name in the table.
        head: of that policy.
        image: what the policy sees.
        photographs: the folder that holds the sites' folders.
        rig: lens and mounting that are assumed for all of them.

    Raises:
        ConfigError: a photograph is missing.
    """
    lines = load_lines()
    rows, shown = [], []
    for site in lines.sites:
        read, drawn_poses = [], []
        for drawn, frame in frames_of(site, photographs):
            pose = standing(drawn, lines.size, rig)
            if pose is None:
                continue
            drawn_poses.append(pose)
            read.append(head(preprocess(frame, image)[None])[0])
            shown.append(draw_poses(frame, [pose, tuple(read[-1].tolist())]))
        rows.append(site_pose(policy, site.name, np.array(read), np.array(drawn_poses)))
    return rows, _sheet(shown)


def site_pose(policy: str, site: str, read: np.ndarray, drawn: np.ndarray) -> SitePose:
    """Compare poses (N, 2) that a head read with those that were drawn."""
    if not len(drawn):
        return SitePose(policy, site, 0, *[float("nan")] * 6)
    errors = np.abs(read - drawn).mean(axis=0)
    orders = [order(read[:, k], drawn[:, k]) for k in (0, 1)]
    sides = []
    for k, telling in enumerate((_TELLING_M, _TELLING_RAD)):
        off = np.abs(drawn[:, k]) >= telling
        same = (read[off, k] > 0.0) == (drawn[off, k] > 0.0)
        sides.append(float(same.mean()) if off.any() else float("nan"))
    return SitePose(policy, site, len(drawn), *errors.tolist(), *orders, *sides)


def order(a: np.ndarray, b: np.ndarray) -> float:
    """Spearman's rank correlation of two series (N,); NaN below four values."""
    if len(a) < 4:
        return float("nan")
    first, second = (np.argsort(np.argsort(each)) - 0.5 * (len(a) - 1) for each in (a, b))
    return float(first @ second / np.sqrt((first @ first) * (second @ second)))


def draw_poses(frame: np.ndarray, poses: Sequence[tuple[float, float]]) -> np.ndarray:
    """A frame, enlarged, with a robot in its lane for each pose: green drawn, red read."""
    large = cv2.resize(frame, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC)
    height, width = large.shape[:2]
    middle, scale = np.array((width // 2, height - 46)), 40.0 / 0.117  # pixels a metre
    for side in (-1, 1):
        x = int(middle[0] + side * 40)
        cv2.line(large, (x, height - 90), (x, height - 2), (255, 255, 255), 1, cv2.LINE_AA)
    for (offset_m, heading_rad), colour in zip(poses, ((60, 220, 60), (240, 60, 60)), strict=False):
        foot = middle + np.array((-offset_m * scale, 30.0))
        tip = foot + 50 * np.array((-np.sin(heading_rad), -np.cos(heading_rad)))
        ends = [tuple(int(v) for v in point) for point in (foot, tip)]
        cv2.arrowedLine(large, ends[0], ends[1], colour, 3, cv2.LINE_AA, tipLength=0.25)
    return large


def _sheet(shown: Sequence[np.ndarray], columns: int = 5) -> np.ndarray:
    cells = list(shown) + [np.zeros_like(shown[0])] * (-len(shown) % columns)
    return np.vstack([np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)])
