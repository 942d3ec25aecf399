"""A sheet of pictures: PyBullet's camera, the ray camera and the classes, side by side.

python -m sim_pybullet.show_cameras --out cameras.png [--map town] [--look look.yaml]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from robot.command_line import SEED, OneLineParser, answer, whole
from robot.contract import ImageSpec
from robot.errors import MapError
from robot.geometry import bezier_points, bezier_tangents
from robot.lens import CameraRig
from robot.navigation.road_map import RoadMap, load_map
from robot.output import expect_writable, write_bytes
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import NOMINAL, load_look
from sim_pybullet.rendering.pybullet_camera import PyBulletCamera
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Scene
from sim_pybullet.scenery.objects import build_scene

FRAME = ImageSpec(160, 120)
ENLARGED = 2  # times, so that a person can see the pixels
CLASS_RGB = {
    SemanticClass.SKY: (120, 170, 220),
    SemanticClass.OUTSIDE: (90, 110, 80),
    SemanticClass.ROAD: (60, 60, 66),
    SemanticClass.WHITE_LINE: (255, 255, 255),
    SemanticClass.YELLOW_LINE: (250, 210, 40),
    SemanticClass.RED_LINE: (220, 40, 40),
    SemanticClass.OBJECT: (150, 90, 190),
    SemanticClass.SIGN: (240, 130, 30),
    SemanticClass.PERSON: (255, 120, 190),
    SemanticClass.VEHICLE: (40, 190, 180),
    SemanticClass.KERB: (170, 170, 150),
    SemanticClass.WALL: (130, 90, 60),
}


def lane_poses(road_map: RoadMap, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) poses in the middle of lanes, along them, on different tiles where there are."""
    if not road_map.lanes:
        raise MapError(f"{road_map.name}: expected a map with roads, got none; try --map town")
    chosen = rng.choice(len(road_map.lanes), count, replace=count > len(road_map.lanes))
    poses = []
    for lane in (road_map.lanes[k] for k in chosen):
        t = rng.uniform(0.0, 1.0, 1)
        x, y = bezier_points(lane.control_points_m, t)[0]
        dx, dy = bezier_tangents(lane.control_points_m, t)[0]
        poses.append((x, y, np.arctan2(dy, dx)))
    return np.array(poses)


def sheet(scene: Scene, rig: CameraRig, poses: np.ndarray) -> np.ndarray:
    """One row per pose, (H, W, 3) uint8 RGB: PyBullet, ray camera, the ray camera's classes."""
    ray = RayCamera(FRAME, len(poses))
    for i in range(len(poses)):
        ray.set_robot(i, scene, rig)
    reference = PyBulletCamera(scene, rig, FRAME)
    columns = [reference.render(poses), ray.render(poses), coloured(ray.segment(poses))]
    reference.close()
    rows = [np.hstack(frames) for frames in zip(*columns, strict=True)]
    picture = np.vstack([_captions(FRAME.width_px, ("PyBullet", "ray camera", "classes")), *rows])
    return np.asarray(picture)


def main(arguments: list[str] | None = None) -> int:
    """Write the sheet; exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m sim_pybullet.show_cameras", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument("--map", default="town", help="map file or shipped map")
    parser.add_argument("--look", type=Path, help="YAML file of a Look")
    parser.add_argument("--poses", type=whole(1, 100), default=4, help="how many rows")
    parser.add_argument("--seed", type=SEED, default=0)
    options = parser.parse_args(arguments)
    return answer("show_cameras", lambda: draw(options))


def draw(options: argparse.Namespace) -> None:
    """Write the sheet asked for; DuckpilotError for wrong input."""
    expect_writable(options.out, inputs=[options.look])
    rng = np.random.default_rng(options.seed)
    look = load_look(options.look) if options.look else NOMINAL
    road_map = load_map(options.map)
    poses = lane_poses(road_map, options.poses, rng)
    picture = sheet(build_scene(road_map, look, rng), look.rig(), poses)
    large = cv2.resize(picture, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_NEAREST)
    write_picture(options.out, large)


def coloured(labels: np.ndarray) -> np.ndarray:
    """Classes (...) as colours (..., 3) uint8 RGB."""
    palette = np.zeros((len(SemanticClass), 3), np.uint8)
    for kind, rgb in CLASS_RGB.items():
        palette[kind] = rgb
    return palette[labels]


def _captions(width: int, texts: tuple[str, ...]) -> np.ndarray:
    strips = []
    for text in texts:
        strip = np.full((14, width, 3), 255, np.uint8)
        cv2.putText(strip, text, (4, 10), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (0, 0, 0), 1, cv2.LINE_AA)
        strips.append(strip)
    return np.hstack(strips)


def write_picture(path: Path, rgb: np.ndarray) -> None:
    """Write (H, W, 3) uint8 RGB as PNG, whole or not at all, as small as can be."""
    _, data = cv2.imencode(".png", rgb[..., ::-1], (cv2.IMWRITE_PNG_COMPRESSION, 9))
    write_bytes(path, np.asarray(data).tobytes())


if __name__ == "__main__":
    sys.exit(main())
