"""A policy that keeps apart from what its own pictures show, told of nobody."""

import numpy as np

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS
from robot.geometry import Pose
from robot.inference.preprocess import preprocess_batch
from robot.navigation.road_watch import WaySeen
from robot.safety.governors import Rules
from robot.vision.sight import OnnxSight, Seen
from sim_pybullet.batch import BatchWorld, Observation
from trainer.judging.drivers import Pilot
from trainer.judging.evaluate import DrivingPolicy
from trainer.judging.governed import Ruled


class Sighted(Pilot):
    """As `Pilot`, slowed by headway alone: `rules: {headway: true}` of a robot without a map."""

    def __init__(self, policy: DrivingPolicy, sight: OnnxSight) -> None:
        super().__init__(policy)
        self._sight = sight
        self._robots: list[tuple[Ruled, WaySeen]] = []  # a robot's `LaneWatch`
        self._turns = 0

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `trainer.judging.drivers.Driver`."""
        shares = super().choose(world, seen)
        if not self._robots:
            here = [Pose(*pose) for pose in world.poses.tolist()]
            self._robots = [(Ruled(each, Rules(headway=True).chain()), WaySeen()) for each in here]
        self._turns += 1
        now_s, driving = self._turns * CONTROL_DT_S, np.flatnonzero(world.active)
        newest = preprocess_batch(seen.image[driving, ..., -3:], self._sight.contract.image)
        what = self._sight(newest)
        for k, i in enumerate(driving.tolist()):
            robot, way = self._robots[i]
            robot.moved(Pose(*world.poses[i].tolist()))
            way.see(Seen(*(part[k : k + 1] for part in what)), robot.driven_m, now_s)
            ahead = way.ahead(robot.driven_m, now_s)
            slowed = robot.slow(MAX_WHEEL_MPS * shares[i], now_s, ahead)
            shares[i] = np.array(slowed) / MAX_WHEEL_MPS
        return shares
