"""A sheet of what robots see in draws of a look.

``python -m sim_pybullet.show_looks --look randomised --out looks.png``
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from robot.command_line import SEED, OneLineParser, answer, whole
from robot.contract import ImageSpec
from robot.navigation.road_map import RoadMap, load_map
from robot.output import expect_writable
from sim_pybullet.randomise import Sampler, load_look_sampler
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.objects import build_scene
from sim_pybullet.sensing.camera_feed import CameraFeed
from sim_pybullet.show_cameras import lane_poses, write_picture

COLUMNS = 6
_TURN_RAD = 0.05  # in the last physics step: a robot that turns smears its picture
_GAP_PX = 2


def draws(road_map: RoadMap, sample: Sampler, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 120, 160, 3) uint8 RGB: a robot on the lane in each of so many draws of a look."""
    feed = CameraFeed(RayCamera(ImageSpec(), count), count)
    poses = lane_poses(road_map, count, rng)
    for i, pose in enumerate(poses):
        look = sample(rng)
        feed.begin(i, build_scene(road_map, look, rng), look, pose)
    turned = poses + (0.0, 0.0, 1.0) * rng.uniform(-_TURN_RAD, _TURN_RAD, (count, 1))
    feed.record(turned)
    return feed.pictures(rng)


def sheet(pictures: np.ndarray, columns: int = COLUMNS) -> np.ndarray:
    """The pictures in rows, with white lines between, (H, W, 3) uint8 RGB."""
    rows = -(-len(pictures) // columns)
    height, width = pictures.shape[1] + _GAP_PX, pictures.shape[2] + _GAP_PX
    whole = np.full((rows * height, columns * width, 3), 255, np.uint8)
    for k, picture in enumerate(pictures):
        top, left = k // columns * height, k % columns * width
        whole[top : top + height - _GAP_PX, left : left + width - _GAP_PX] = picture
    return whole


def main(arguments: list[str] | None = None) -> int:
    """Write the sheet; exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m sim_pybullet.show_looks", description=__doc__)
    parser.add_argument("--look", default="randomised", help="file, folder or name of looks")
    parser.add_argument(
        "--without", nargs="*", default=[], help="group or group.field to switch off"
    )
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument("--map", default="town", help="map file or shipped map")
    parser.add_argument("--count", type=whole(1, 600), default=24, help="how many draws")
    parser.add_argument("--seed", type=SEED, default=0)
    options = parser.parse_args(arguments)
    return answer("show_looks", lambda: draw(options))


def draw(options: argparse.Namespace) -> None:
    """Write the sheet asked for; DuckpilotError for wrong input."""
    expect_writable(options.out)
    sample = load_look_sampler(options.look, without=options.without)
    rng = np.random.default_rng(options.seed)
    pictures = draws(load_map(options.map), sample, options.count, rng)
    write_picture(options.out, sheet(pictures))


if __name__ == "__main__":
    raise SystemExit(main())
