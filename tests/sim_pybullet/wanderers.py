"""How well the localizer does: robots that wander over the drawn arena under its camera."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from localizer_node.calibrate import KnownPoint, calibrate, guess_lens
from localizer_node.calibration import Board, Calibration, Marker, map_outline
from localizer_node.node import Localizer
from robot.bringup.camera_place import Freedom
from robot.contract import ACTION_TWISTS, CONTROL_DT_S
from robot.geometry import Pose
from robot.link.messages import Sighting
from robot.navigation.road_map import RoadMap, load_map
from sim_pybullet.look import GroundLook
from sim_pybullet.overhead import (
    PAINT,
    Hanging,
    OverheadCamera,
    Sheet,
    board_rgb,
    robot_sheets,
)
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.scene import Ground

FPS = 30
HANGING_FRAMES = 200  # until the camera is hung anew
APART_M = 0.24
WRONG_M = 0.10  # a pose farther off than this is another robot's, or nobody's


ROBOTS: dict[str, tuple[Marker, ...]] = {
    "two_colour": (Marker("a"), Marker("b", front="magenta"), Marker("c", front="orange")),
    "tag": tuple(Marker(name, "tag", tag=tag) for name, tag in (("a", 3), ("b", 8), ("c", 14))),
    "plain": (Marker("a", "plain", board=Board(0.18, 0.11)),),
}


@lru_cache(maxsize=1)
def arena() -> tuple[RoadMap, Ground]:
    """The arena's map, and its floor painted."""
    road_map = load_map("arena")
    return road_map, paint_ground(road_map, GroundLook())


@dataclass(frozen=True)
class Lamps:
    """Light that is not even, as of `OverheadCamera`."""

    middle_m: tuple[float, float] = (1.1, 1.32)
    brightness: float = 1.0
    gradient: float = 0.0  # relative fall of the light from one side of the arena to the other
    gradient_rad: float = 0.0  # from where, in the world
    shadows: tuple[tuple[float, float, float, float], ...] = ()  # x, y, radius [m], depth 0..1
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __call__(self, floor_m: np.ndarray) -> np.ndarray:
        """(H, W, 3) factors at floor points (H, W, 2)."""
        towards = (math.cos(self.gradient_rad), math.sin(self.gradient_rad))
        along = (floor_m - self.middle_m) @ towards
        light = self.brightness * np.clip(1.0 + self.gradient * along / 2.5, 0.1, 2.0)
        for x, y, radius, depth in self.shadows:
            distance = np.linalg.norm(floor_m - (x, y), axis=-1) / radius
            light *= 1.0 - depth / (1.0 + np.exp((distance - 1.0) * 12.0))
        light = np.nan_to_num(light, nan=self.brightness)
        return np.asarray(light[..., None] * np.array(self.white_balance))


def random_camera(rng: np.random.Generator) -> OverheadCamera:
    """A camera that is no good, hung by hand, a few centimetres and degrees off.

    Lamps are on one side, people cast shadows, the light is warm or cold.
    """
    place = (1.1 + rng.normal(0, 0.03), 1.32 + rng.normal(0, 0.03), 2.5 + rng.normal(0, 0.02))
    tilt = (rng.normal(0, 0.02), rng.normal(0, 0.02))
    yaw = rng.choice([0.5, -0.5]) * math.pi + rng.normal(0, 0.03)
    shadows = tuple(
        (rng.uniform(0, 2.2), rng.uniform(0, 2.6), rng.uniform(0.2, 0.6), rng.uniform(0.2, 0.5))
        for _ in range(2)
    )
    light = Lamps(
        middle_m=place[:2],
        brightness=rng.uniform(0.75, 1.15),
        gradient=rng.uniform(0.0, 0.5),
        gradient_rad=rng.uniform(-math.pi, math.pi),
        shadows=shadows,
        white_balance=(rng.uniform(0.93, 1.07), 1.0, rng.uniform(0.93, 1.07)),
    )
    blur_px, noise = rng.uniform(0.4, 1.0), rng.uniform(1.0, 5.0)
    hanging = Hanging(place, yaw, tilt)
    return OverheadCamera(arena()[1], hanging, light=light, blur_px=blur_px, noise=noise)


def coloured(
    colour: str, x_m: float, y_m: float, heading_rad: float, size_m: tuple[float, float, float]
) -> Sheet:
    """A piece of one colour: size is (length, width, height above the floor)."""
    return Sheet(Pose(x_m, y_m, heading_rad), *size_m, np.full((1, 1, 3), PAINT[colour], np.uint8))


def clicked(
    camera: OverheadCamera, robots: tuple[Marker, ...], rng: np.random.Generator
) -> Calibration:
    """What a person gets: corners and middles of the edges clicked, the height measured."""
    road_map = arena()[0]
    size = (road_map.width_m, road_map.height_m)
    edge = map_outline(size, points_per_side=2)
    pixels = camera.rig.to_pixels(np.column_stack((edge, np.zeros(len(edge)))))
    pixels += rng.normal(0.0, 0.5, pixels.shape)
    points = [KnownPoint(*map(float, (*p, *q))) for p, q in zip(pixels, edge, strict=True)]
    height = camera.hanging.position_m[2] + rng.normal(0.0, 0.01)
    lens = guess_lens("fisheye", camera.lens.width_px, camera.lens.height_px)
    return calibrate(points, lens, Freedom(True, 1, height), size, robots).calibration


def clutter(rng: np.random.Generator) -> list[Sheet]:
    """Blue things: two on the arena, of no board's size, and two boards' worth beside it."""
    x, y, turn = rng.uniform(0.3, 1.9), rng.uniform(0.3, 2.3), rng.uniform(-3.0, 3.0)
    return [
        coloured("blue", x, y, turn, (0.05, 0.04, 0.0)),
        coloured("blue", 2.2 - x, 2.6 - y, turn, (0.45, 0.03, 0.0)),
        coloured("blue", -0.25, y, turn, (0.16, 0.14, 0.0)),
        coloured("blue", x, 2.95, turn, (0.3, 0.25, 0.2)),
    ]


@dataclass
class Wanderer:
    """Takes random actions, and turns on the spot rather than meet a wall or another robot."""

    pose: Pose
    action: int = 2
    left: int = 0

    def step(self, others: list[Pose], rng: np.random.Generator) -> None:
        """Move on by one picture."""
        if self.left == 0:
            self.action, self.left = int(rng.integers(5)), round(CONTROL_DT_S * FPS)
        self.left -= 1
        forward, turn = ACTION_TWISTS[self.action]
        moved = self.pose.moved(forward / FPS, turn / FPS)
        ahead = self.pose.moved(forward / FPS + 0.05, turn / FPS)
        free = all(math.dist(ahead[:2], other[:2]) > APART_M for other in others)
        if free and 0.12 < ahead.x_m < 2.08 and 0.12 < ahead.y_m < 2.52:
            self.pose = moved
        else:
            self.pose = self.pose.moved(0.0, 2.4 / FPS)


@dataclass
class Score:
    """Errors of every pose told."""

    position_m: list[float] = field(default_factory=list)
    heading_rad: list[float] = field(default_factory=list)
    told: int = 0
    expected: int = 0
    wrong: int = 0

    def add(self, told: Iterable[Sighting], poses: dict[str, Pose]) -> None:
        """Compare the poses told of one picture with the true ones."""
        self.expected += len(poses)
        for one in told:
            true = poses[one.robot]
            error = math.hypot(one.x_m - true.x_m, one.y_m - true.y_m)
            self.told += 1
            self.wrong += error > WRONG_M
            self.position_m.append(error)
            if one.heading_rad is not None:
                turn = (one.heading_rad - true.heading_rad + math.pi) % (2 * math.pi) - math.pi
                self.heading_rad.append(abs(turn))

    @property
    def position_rms_mm(self) -> float:
        """[mm]"""
        return 1000.0 * float(np.sqrt(np.mean(np.square(self.position_m))))

    @property
    def heading_rms_deg(self) -> float:
        """[degrees]"""
        return math.degrees(float(np.sqrt(np.mean(np.square(self.heading_rad)))))


def drive(
    robots: tuple[Marker, ...], frames: int, seed: int, score: Score, blue_things: bool = True
) -> None:
    """One camera, newly hung and calibrated, and its robots for some frames; adds to ``score``."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    localizer = Localizer(clicked(camera, robots, rng))
    crowd = {
        m.robot: Wanderer(Pose(0.5 + 0.55 * i, 0.7 + 0.5 * i, rng.uniform(-3.0, 3.0)))
        for i, m in enumerate(robots)
    }
    boards = {m.robot: board_rgb(m) for m in robots}
    things = clutter(rng) if blue_things else []
    for i in range(frames):
        for name, wanderer in crowd.items():
            wanderer.step([w.pose for n, w in crowd.items() if n != name], rng)
        sheets = [s for m in robots for s in robot_sheets(m, crowd[m.robot].pose, boards[m.robot])]
        picture = camera.render([*things, *sheets], rng)
        score.add(localizer.feed(picture, i / FPS), {n: w.pose for n, w in crowd.items()})
