"""A sheet of what robots see on a map or track in draws of a look.

``python -m sim_pybullet.show --look randomised --out looks.png``
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from robot.command_line import SEED, OneLineParser, answer, whole
from robot.contract import ImageSpec
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_bytes
from sim_pybullet.racing.track import is_track, load_track
from sim_pybullet.randomise import Sampler, load_look_sampler
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.objects import Place, build_scene, lane_poses
from sim_pybullet.sensing.camera_feed import CameraFeed

COLUMNS = 6
_TURN_RAD = 0.05  # in the last physics step: a robot that turns smears its picture
_GAP_PX = 2


def draws(place: Place, sample: Sampler, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 120, 160, 3) uint8 RGB: a robot on the lane in each of so many draws of a look."""
    feed = CameraFeed(RayCamera(ImageSpec(), count), count)
    poses = lane_poses(place, count, rng)
    for i, pose in enumerate(poses):
        look = sample(rng)
        feed.begin(i, build_scene(place, look, rng), look, pose)
    turned = poses + (0.0, 0.0, 1.0) * rng.uniform(-_TURN_RAD, _TURN_RAD, (count, 1))
    feed.record(turned)
    return feed.pictures(rng)


def sheet(pictures: np.ndarray, columns: int = COLUMNS) -> np.ndarray:
    """The pictures in rows, with white lines between, (H, W, 3) uint8 RGB."""
    rows = -(-len(pictures) // columns)
    framed = np.pad(
        pictures, ((0, rows * columns - len(pictures)), (0, _GAP_PX), (0, _GAP_PX), (0, 0)),
        constant_values=255,
    )  # fmt: skip
    height, width = framed.shape[1:3]
    grid = framed.reshape(rows, columns, height, width, 3).swapaxes(1, 2)
    return np.asarray(grid.reshape(rows * height, columns * width, 3))


def main(arguments: list[str] | None = None) -> int:
    """Write the sheet; exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m sim_pybullet.show", description=__doc__)
    parser.add_argument("--look", default="randomised", help="file, folder or name of looks")
    parser.add_argument(
        "--without", nargs="*", default=[], help="group or group.field to switch off"
    )
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument("--map", default="town", help="file or name of a map or track")
    parser.add_argument("--count", type=whole(1, 600), default=12, help="how many draws")
    parser.add_argument("--seed", type=SEED, default=0)
    options = parser.parse_args(arguments)
    return answer("show", lambda: draw(options))


def draw(options: argparse.Namespace) -> None:
    """Write the sheet asked for; DuckpilotError for wrong input."""
    expect_writable(options.out)
    sample = load_look_sampler(options.look, without=options.without)
    place = load_track(options.map) if is_track(options.map) else load_map(options.map)
    pictures = draws(place, sample, options.count, np.random.default_rng(options.seed))
    _, data = cv2.imencode(".png", sheet(pictures)[..., ::-1])
    write_bytes(options.out, np.asarray(data).tobytes())


if __name__ == "__main__":
    raise SystemExit(main())
