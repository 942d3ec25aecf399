"""``python -m tests.trainer.judge_whereabouts``: robots that are told nothing look for their place.

Each begins anywhere on a lane of a map, with its own navigator and sight, and drives on without a
destination until it believes to know its place, gives up, or a minute is over. Wheels count steps,
pictures come once a decision, nobody else is there.
"""

from __future__ import annotations

import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot.camera.source import Frame
from robot.command_line import OneLineParser, whole
from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS, ImageSpec
from robot.geometry import Pose, compose, wrap_angle
from robot.inference.preprocess import preprocess_batch
from robot.navigation.navigator import MissionNavigator
from robot.navigation.road_map import load_map
from robot.output import write_json
from robot.vision.sight import Glimpse, OnnxSight
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.randomise import load_look_sampler
from trainer.judging.challenge import drive
from trainer.judging.drivers import Driver
from trainer.judging.evaluate import DrivingPolicy, open_policy
from trainer.sight.cli import SHIPPED

TOWNS = tuple(f"judging/towns/{name}" for name in ("delta", "knot", "ribs", "weave"))
RIGHT_M, RIGHT_RAD = 0.12, 0.35
SECONDS = 60.0


@dataclass(frozen=True)
class Found:
    """How one robot fared."""

    map: str
    places: int  # that fit in the end
    junctions: int  # crossed by then
    driven_m: float
    off_m: float | None = None  # of the place that it found; None where it found none
    turned_rad: float | None = None
    stopped: str = ""  # why it would not have driven on

    @property
    def right(self) -> bool:
        """Whether it found its place."""
        if self.off_m is None or self.turned_rad is None:
            return False
        return self.off_m < RIGHT_M and self.turned_rad < RIGHT_RAD


class Searcher(Driver):
    """Robots that look for their places; they stand once they know, or are stopped."""

    guided, image, frames = True, ImageSpec(), 1

    def __init__(self, policy: DrivingPolicy, sight: OnnxSight) -> None:
        self._policy, self._sight = policy, sight
        self._turns = 0
        self.found: dict[int, Found] = {}

    def _begin(self, world: BatchWorld) -> None:
        count = world.n_robots
        self._odometry, self._steps = np.zeros((count, 3)), np.zeros((count, 2))
        self._frames: list[Frame | None] = [None] * count
        guidance: Any = world._guidance
        record = guidance.record

        def counting(counted: np.ndarray) -> None:
            self._steps += counted * PHYSICS_DT_S
            record(counted)

        guidance.record = counting
        self._navigators = [
            MissionNavigator(
                world.task.road_maps[int(world.maps[i])],
                lambda: None,
                lambda i=i: Pose(*self._odometry[i].tolist()),  # type: ignore[misc]
                "robot",
                Glimpse(self._sight, lambda i=i: self._frames[i]),  # type: ignore[misc]
            )
            for i in range(count)
        ]

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        if not self._turns:
            self._begin(world)
        self._move()
        self._turns += 1
        shares = np.zeros((world.n_robots, 2))
        for i in np.flatnonzero(world.active).tolist():
            if i not in self.found:
                shares[i] = self._drive(i, world, seen.image[i])
        return shares

    def _move(self) -> None:
        forward, turn = self._steps.T
        chord = forward * np.sinc(0.5 * turn / math.pi)
        arcs = np.stack((chord * np.cos(0.5 * turn), chord * np.sin(0.5 * turn), turn), axis=1)
        self._odometry = compose(self._odometry, arcs)
        self._steps[:] = 0.0

    def _drive(self, i: int, world: BatchWorld, image: np.ndarray) -> np.ndarray:
        """Shares of the greatest wheel speed (2,) for one robot."""
        now_s, navigator = self._turns * CONTROL_DT_S, self._navigators[i]
        self._frames[i] = Frame(image, self._turns, now_s)
        way = navigator.look(now_s)
        search: Any = navigator._search
        if way.path is not None and not way.off_path and way.pose_within is not None:
            place_m, turned_rad = way.pose_within
            if place_m <= 0.08 and turned_rad <= 0.35:
                picture = preprocess_batch(image[None], self._policy.contract.image)
                action = int(self._policy.values(picture, way.path[None]).argmax(axis=1)[0])
                return np.array(self._policy.contract.actions)[action] / MAX_WHEEL_MPS
        if self._turns < 20 and way.pose is None and way.path is None:
            return np.zeros(2)  # all must have looked first
        name = world.task.road_maps[int(world.maps[i])].name
        why = "off its way" if way.off_path else "unsure" if way.path is not None else ""
        truth = world.poses[i]
        off: tuple[float, ...] = ()
        if way.pose is not None:
            off_m = float(np.hypot(*(np.array(way.pose[:2]) - truth[:2])))
            off = off_m, abs(float(wrap_angle(way.pose[2] - truth[2])))
        assert search is not None  # until the next picture
        told = name, search.places, search.junctions, float(navigator._driven_m)
        self.found[i] = Found(*told, *(off or (None, None)), why)
        return np.zeros(2)


def judge(model: Path, sight: Path, look: str, maps: list[str], seeds: range) -> list[Found]:
    """One robot for each seed."""
    found: list[Found] = []
    for first in range(0, len(seeds), 20):
        searcher = Searcher(open_policy(model), OnnxSight(sight))
        group = seeds[first : first + 20]
        towns, looks = list(map(load_map, maps)), load_look_sampler(look)
        ends = [e.end for e, _ in drive(searcher, "lf", towns, looks, group, SECONDS, films=False)]
        found += searcher.found.values()
        late = len(group) - len(searcher.found)
        print(
            f"{first + len(group)}: {sum(f.right for f in found)} right, {late} late; {set(ends)}"
        )
    return found


def main() -> int:
    """The command."""
    parser = OneLineParser("python -m tests.trainer.judge_whereabouts", description=__doc__)
    parser.add_argument("--model", type=Path, default=SHIPPED.with_name("nav_ppo.onnx"))
    parser.add_argument("--sight", type=Path, default=SHIPPED)
    parser.add_argument("--look", default="reality")
    parser.add_argument("--map", nargs="+", default=list(TOWNS))
    parser.add_argument("--robots", type=whole(1, 10_000), default=100)
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=1000)
    parser.add_argument("--json", type=Path)
    a = parser.parse_args()
    found = judge(a.model, a.sight, a.look, a.map, range(a.seed, a.seed + a.robots))
    said = [each for each in found if each.off_m is not None]
    right = sum(each.right for each in said)
    print(f"{len(said)} of {a.robots} found a place, {right} of them the right one")
    if a.json:
        write_json(a.json, {"robots": [asdict(each) for each in found]})
    return 0


if __name__ == "__main__":
    sys.exit(main())
