"""How well the yellow line is told: simulated frames, and where the line really runs by the map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX, ImageSpec
from robot.geometry import bezier_points
from robot.lens import CameraRig
from robot.navigation.path import Path as RoadPath
from robot.navigation.path import lane_loop
from robot.navigation.road_map import Lane, RoadMap, load_map
from sim_pybullet.look import Look
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import SemanticClass
from sim_pybullet.scenery.objects import build_scene
from tests.trainer.judging.yellow_line import detect_yellow_line, floor_table

SAMPLES = 200  # per tile
SPACING_M = 0.01
BATCH = 100
SIDE_M = 0.21  # from the yellow line to the white lines' inner edges
MAX_TURN_RAD = math.radians(30.0)
TOO_CLOSE_M = 0.01


@dataclass(frozen=True)
class Agreement:
    """What was measured; shares are of all frames, offsets [m] of the judged frames."""

    frames: int
    judged: int
    agreement: float  # of the judged frames
    agreement_at_axle: float  # the same answers, against the side of the robot's axle
    unknown_share: float  # no line was found
    unknown_though_visible_share: float  # and the picture holds ten pixels of it
    too_close_share: float
    offset_rms_m: float
    offset_p99_m: float


def measure(map_name: str, look: Look, frames: int, seed: int) -> Agreement:
    """Detect the line in simulated frames and compare with the map.

    Raises:
        DuckpilotError: the map is no ring of road.
    """
    rig = look.rig()
    reference_m = floor_table(rig, FRAME_WIDTH_PX, FRAME_HEIGHT_PX).reference_m
    line = yellow_middle(load_map(map_name))
    found, truth, at_axle, pixels = [], [], [], []
    for poses, pictures, visible in _frames(map_name, look, rig, frames, seed):
        found += [detect_yellow_line(picture, rig).offset_m for picture in pictures]
        truth += [_side_m(line, pose, reference_m) for pose in poses]
        at_axle += [_side_m(line, pose, 0.0) for pose in poses]
        pixels += visible
    return _agreement(*(np.array(each) for each in (found, truth, at_axle, pixels)))


def _frames(
    map_name: str, look: Look, rig: CameraRig, frames: int, seed: int
) -> Iterator[tuple[np.ndarray, np.ndarray, list[int]]]:
    """Batches of poses (N, 3), pictures and how many pixels of yellow line each shows."""
    rng = np.random.default_rng(seed)
    road_map = load_map(map_name)
    line = yellow_middle(road_map)
    scene = build_scene(road_map, look, rng)
    camera = RayCamera(ImageSpec(), min(BATCH, frames))
    for i in range(min(BATCH, frames)):
        camera.set_robot(i, scene, rig)
    for start in range(0, frames, BATCH):
        poses = _random_poses(line, min(BATCH, frames - start), rng)
        labels = camera.segment(poses) == SemanticClass.YELLOW_LINE
        yield poses, camera.render(poses), list(labels.sum(axis=(1, 2)))


def _random_poses(line: RoadPath, count: int, rng: np.random.Generator) -> np.ndarray:
    points = [line.pose_at(arc_m) for arc_m in rng.uniform(0.0, line.length_m, count)]
    sides_m = rng.uniform(-SIDE_M, SIDE_M, count)
    turns = rng.uniform(-MAX_TURN_RAD, MAX_TURN_RAD, count)
    return np.array(
        [
            (*point.to_world(np.array((0.0, side_m))), point.heading_rad + turn)
            for point, side_m, turn in zip(points, sides_m, turns, strict=True)
        ]
    )


def _side_m(line: RoadPath, pose: np.ndarray, ahead_m: float) -> float:
    x_m = pose[0] + ahead_m * math.cos(pose[2])
    y_m = pose[1] + ahead_m * math.sin(pose[2])
    return line.project(x_m, y_m).offset_m


def _agreement(
    found: np.ndarray, truth: np.ndarray, at_axle: np.ndarray, pixels: np.ndarray
) -> Agreement:
    unknown = np.isnan(found)
    judged = ~unknown & (np.abs(truth) > TOO_CLOSE_M)
    judged_at_axle = ~unknown & (np.abs(at_axle) > TOO_CLOSE_M)
    errors = (found - truth)[judged]
    return Agreement(
        frames=len(found),
        judged=int(judged.sum()),
        agreement=float(((found > 0.0) == (truth > 0.0))[judged].mean()),
        agreement_at_axle=float(((found > 0.0) == (at_axle > 0.0))[judged_at_axle].mean()),
        unknown_share=float(unknown.mean()),
        unknown_though_visible_share=float((unknown & (pixels >= 10)).mean()),
        too_close_share=float((np.abs(truth) <= TOO_CLOSE_M).mean()),
        offset_rms_m=float(np.sqrt((errors**2).mean())),
        offset_p99_m=float(np.percentile(np.abs(errors), 99)),
    )


def yellow_middle(road_map: RoadMap) -> RoadPath:
    """The middle between the two lanes of a ring, driven as its outer lane, closed.

    Raises:
        MapError: the road is no ring.
    """
    outer = lane_loop(road_map, outer=True)
    lanes: dict[tuple[int, int], list[Lane]] = {}
    for lane in road_map.lanes:
        lanes.setdefault((lane.tile.row, lane.tile.column), []).append(lane)
    pieces = [
        _between(lanes[tile][0], lanes[tile][1], road_map) for tile in _tiles_along(outer, road_map)
    ]
    pieces = [piece if _leads_along(piece, outer) else piece[::-1] for piece in pieces]
    return _closed_path(np.concatenate([piece[:-1] for piece in pieces]))


def _between(lane: Lane, other: Lane, road_map: RoadMap) -> np.ndarray:
    """(SAMPLES, 2) [m]: half way between two opposite lanes, about the corner of a curve."""
    t = np.linspace(0.0, 1.0, SAMPLES)
    a, b = (bezier_points(np.asarray(each.control_points_m), t) for each in (lane, other))
    if lane.tile.kind == "straight":
        return 0.5 * (a + b[::-1])
    south = road_map.rows - 1 - lane.tile.row
    corners = np.array(
        [(lane.tile.column + i, south + j) for i in (0, 1) for j in (0, 1)], dtype=float
    )
    corners *= road_map.tile_size_m
    middle = 0.5 * (a[SAMPLES // 2] + b[SAMPLES // 2])
    corner = corners[np.argmin(np.hypot(*(corners - middle).T))]
    toward = np.arctan2(*(middle - corner)[::-1])
    angles, radii = _polar(a - corner, toward)
    other_angles, other_radii = _polar(b - corner, toward)
    order = np.argsort(other_angles)
    radii = 0.5 * (radii + np.interp(angles, other_angles[order], other_radii[order]))
    around = angles + toward
    return corner + radii[:, None] * np.stack((np.cos(around), np.sin(around)), axis=1)


def _polar(offsets: np.ndarray, toward_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles from ``toward_rad`` and lengths of vectors (M, 2)."""
    angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - toward_rad
    return (angles + np.pi) % (2.0 * np.pi) - np.pi, np.hypot(*offsets.T)


def _tiles_along(path: RoadPath, road_map: RoadMap) -> list[tuple[int, int]]:
    cells = np.floor(path.points_m / road_map.tile_size_m).astype(int)
    tiles = [(road_map.rows - 1 - int(y), int(x)) for x, y in cells]
    return [tile for i, tile in enumerate(tiles) if tile != tiles[i - 1]]


def _leads_along(piece: np.ndarray, path: RoadPath) -> bool:
    middle = piece[len(piece) // 2]
    heading = path.project(middle[0], middle[1]).heading_rad
    along = piece[len(piece) // 2 + 1] - middle
    return bool(along @ (np.cos(heading), np.sin(heading)) > 0.0)


def _closed_path(points: np.ndarray) -> RoadPath:
    ring = np.vstack((points, points[:1]))
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))))
    count = int(arc[-1] / SPACING_M)
    arc_m = np.arange(count) * (arc[-1] / count)
    spaced = np.stack([np.interp(arc_m, arc, ring[:, i]) for i in (0, 1)], axis=1)
    tangents = np.roll(spaced, -1, axis=0) - np.roll(spaced, 1, axis=0)
    headings = np.arctan2(tangents[:, 1], tangents[:, 0])
    return RoadPath(spaced, headings, arc_m, True, float(arc[-1]))
