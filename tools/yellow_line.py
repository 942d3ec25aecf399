"""How often `trainer.judging.yellow_line` tells the right side of the line, over simulated frames.

    python -m tools.yellow_line --frames 10000 --json runs/yellow_line.json

Poses are drawn evenly along a ring of road, to both sides of its yellow line, headings within 30
degrees of the line's. Left out are frames with no line found (their share is stated, and how many
of them show any of it) and those whose judged point lies within 1 cm of the line.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from robot.command_line import SEED, OneLineParser, answer
from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX, ImageSpec
from robot.errors import ConfigError
from robot.lens import CameraRig
from robot.navigation.path import Path as RoadPath
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_json
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import NOMINAL, Look, load_look
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.objects import build_scene
from tools.yellow_truth import yellow_middle
from trainer.judging.yellow_dashes import DEFAULT, floor_table
from trainer.judging.yellow_line import detect_yellow_line

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
    reference_m = floor_table(rig, FRAME_WIDTH_PX, FRAME_HEIGHT_PX, DEFAULT.range_m).reference_m
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
    for start in track(range(0, frames, BATCH), "frames", console=Console(stderr=True)):
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
    if not judged.any():
        raise ConfigError(f"--frames: expected enough frames to judge some, got {len(found)}")
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


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = OneLineParser(
        prog="python -m tools.yellow_line", description=__doc__.splitlines()[0] if __doc__ else None
    )
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--map", default="loop")
    parser.add_argument("--look", type=Path, help="YAML file of a Look; nominal by default")
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--json", type=Path, help="file to write")
    options = parser.parse_args(arguments)

    def work() -> None:
        if options.frames < 1:
            raise ConfigError(f"--frames: expected 1 or more, got {options.frames}")
        expect_writable(options.json, inputs=[options.look])
        look = load_look(options.look) if options.look else NOMINAL
        result = measure(options.map, look, options.frames, options.seed)
        inputs = {key: str(value) for key, value in vars(options).items() if value is not None}
        figures = {"schema": 1, "inputs": inputs, **asdict(result)}
        print(json.dumps(figures, indent=2))
        if options.json:
            write_json(options.json, figures)

    return answer("tools.yellow_line", work)


if __name__ == "__main__":
    sys.exit(main())
