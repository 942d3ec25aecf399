"""``GuidanceFeed``: the path inputs of N robots as they would compute them, from what they know."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.geometry import wrap_angle
from robot.inference.preprocess import preprocess_batch
from robot.navigation.fusion import FusionConfig, PoseFusion
from robot.navigation.lane_view import LaneView
from robot.navigation.path import PathBatch, path_inputs
from robot.navigation.road_map import RoadMap
from robot.navigation.sight_fix import SightFix
from robot.vision.sight import OnnxSight, Seen
from sim_pybullet.look import PoseLook
from sim_pybullet.motors import PHYSICS_DT_S, DelayLine

# When overhead poses come: for so many seconds of so many, from an episode's start on.
OVERHEAD = {"always": (1.0, 1.0), "1-in-20": (1.0, 20.0), "start": (0.0, 1.0)}


@dataclass(frozen=True)
class PoseSources:
    """What tells robots where they are, beside their wheels and the poses of their start."""

    overhead: str = "always"  # one of `OVERHEAD`
    sight: OnnxSight | None = None


ALWAYS = PoseSources()


class GuidanceFeed:
    """Between the true poses and the policy.

    Every robot fuses the overhead poses that its ``PoseLook`` lets through with the steps of its
    wheels, by the filter that real robots run (`robot.navigation.fusion`), and follows its path
    from where it believes to be. A robot whose ``PoseLook`` has no error knows its true pose, where
    overhead poses always come.
    """

    def __init__(
        self, n_robots: int, sources: PoseSources = ALWAYS, road_maps: Sequence[RoadMap] = ()
    ) -> None:
        """``road_maps``: what robots with sight may drive on."""
        self.poses = np.zeros((n_robots, 3))  # where they believe to be: x [m], y [m], heading
        self.seen: Seen | None = None  # of the newest pictures; None before, and without sight
        self._sources = sources
        self._exact = np.ones(n_robots, dtype=bool)
        config = FusionConfig(sight=sources.sight is not None)
        self._errors, self._fusion = PoseError(n_robots), PoseFusion(n_robots, config)
        self._views = [LaneView(m) for m in road_maps] if sources.sight else []
        self._fix = SightFix(self._fusion, self._views[:1] * n_robots)
        self._began = np.zeros(n_robots, dtype=int)  # after so many decisions
        self._driven = np.zeros((n_robots, 2))  # [m] and [rad] since the last decision
        self._hints = np.zeros(n_robots, dtype=int)
        self._decisions = self._moved = 0  # so far, and when the filter moved last
        self._move()

    def begin(
        self,
        robots: np.ndarray,
        looks: Sequence[PoseLook],
        poses: np.ndarray,
        hints: np.ndarray,
        rngs: Sequence[np.random.Generator],
    ) -> None:
        """These robots (M,) begin an episode where they have stood long enough to know it.

        ``looks`` and ``rngs`` are theirs; ``poses`` (N, 3) are true, and ``hints`` (N,) say where
        all robots are on their paths, see `robot.navigation.path.PathBatch.index_at`.
        """
        for i, look, rng in zip(robots.tolist(), looks, rngs, strict=True):
            exact = replace(look, correlation_s=PoseLook.correlation_s) == PoseLook()
            self._exact[i] = exact and self._sources.overhead == "always"
            self._errors.reset(i, look, rng)
        if not self._exact[robots].all():
            if self._moved < self._decisions:
                self._move()
            told = np.full_like(poses, np.nan)
            told[robots] = self._errors.of_standing(poses)[robots]
            self._fusion.reset(robots)
            self._fusion.measure(told, np.full(len(poses), self._now_s))
        self._hints[robots] = hints[robots]
        self._began[robots] = self._decisions
        self._driven[robots] = 0.0
        self._believe(poses)

    def record(self, counted: np.ndarray) -> None:
        """One physics step at these twists (N, 2), see `sim_pybullet.motors.MotorModel.counted`."""
        self._driven += counted * PHYSICS_DT_S

    def update(self, poses: np.ndarray, rng: np.random.Generator) -> None:
        """A decision led to these true poses (N, 3)."""
        self._decisions += 1
        if self._exact.all():
            self._driven[:] = 0.0  # nobody needs the filter
        else:
            self._move()
            told, captured_s = self._errors.observe(poses, self._now_s, rng)
            for_s, every_s = OVERHEAD[self._sources.overhead]
            silent = (self._decisions - self._began) * CONTROL_DT_S % every_s >= for_s
            self._fusion.measure(np.where(silent[:, None], np.nan, told), captured_s)
        self._believe(poses)

    def see(self, images: np.ndarray, who: np.ndarray, new: np.ndarray, maps: np.ndarray) -> None:
        """Pictures (M, H, W, 3) of these robots (M,) came now, after the poses of this moment.

        They are frames, or as sight takes them. ``new``, ``maps`` (N,): who has one, on which map.
        """
        sight = self._sources.sight
        if sight is None:
            return
        whole = np.zeros((len(new), *images.shape[1:]), np.uint8)
        whole[who] = images
        if images.shape[1:] != sight.contract.image.shape:
            whole = preprocess_batch(whole, sight.contract.image)
        self._fix.views = [self._views[k] for k in maps.tolist()]
        self.seen = sight(whole)
        self._fix.see(self.seen, new & ~self._exact, self._now_s)
        self.poses = np.where(self._exact[:, None], self.poses, self._fusion.poses)

    @property
    def within_m(self) -> np.ndarray:
        """(N,) how well they know their places, by 95 % [m]."""
        return np.where(self._exact, 0.0, self._fusion.certainty[:, 0])

    def path_inputs(self, paths: PathBatch) -> np.ndarray:
        """(N, 10) float32, see `robot.navigation.path.path_inputs`, on paths of the robots."""
        at = paths.project(self.poses[:, :2], self._hints)
        self._hints = at.index
        return path_inputs(paths, self.poses, at.arc_m)

    @property
    def _now_s(self) -> float:
        return self._decisions * CONTROL_DT_S

    def _move(self) -> None:
        forward_m, turn_rad = self._driven.T.copy()
        self._fusion.move(forward_m, turn_rad, self._now_s)
        self._moved = self._decisions
        self._driven[:] = 0.0

    def _believe(self, poses: np.ndarray) -> None:
        self.poses = np.where(self._exact[:, None], poses, self._fusion.poses)


OUTLIER_M = 1.0  # an outlier is up to this far off in each coordinate


class PoseError:
    """One ``PoseLook`` per robot; errors are Ornstein-Uhlenbeck processes.

    ``observe`` is called at every decision; delays are rounded to whole ones.
    """

    def __init__(self, count: int) -> None:
        self._deviations = np.zeros((count, 3))
        self._keep = np.ones((count, 1))  # of the error, from one call to the next
        self._delay_s = np.zeros(count)
        self._gap_begins, self._longest_gap_s = np.zeros(count), np.zeros(count)
        self._outlier = np.zeros(count)
        self._errors = np.zeros((count, 3))
        self._gap_s = np.zeros(count)  # rest of the current dropout
        self._sent = DelayLine(count, 3)

    def reset(self, robot: int, look: PoseLook, rng: np.random.Generator) -> None:
        """Begin an episode of one robot, its error drawn from the stationary distribution."""
        self._deviations[robot] = look.position_m, look.position_m, look.heading_rad
        self._keep[robot] = math.exp(-CONTROL_DT_S / max(look.correlation_s, 1e-6))
        calls = round(look.delay_s / CONTROL_DT_S)
        self._delay_s[robot] = calls * CONTROL_DT_S
        self._gap_begins[robot] = look.dropout_per_s * CONTROL_DT_S
        self._longest_gap_s[robot] = look.dropout_s
        self._outlier[robot] = look.outlier
        self._errors[robot] = rng.standard_normal(3) * self._deviations[robot]
        self._gap_s[robot] = 0.0
        self._sent.reset(robot, calls, np.full(3, np.nan))

    def of_standing(self, poses: np.ndarray) -> np.ndarray:
        """What was told (N, 3) of robots that have stood at these poses (N, 3) for a while."""
        return _off(poses, self._errors)

    def observe(
        self, poses: np.ndarray, now_s: float, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """What arrives now, of true poses (N, 3): poses, NaN rows where none does; when they were
        captured (N,) [s]."""
        spread = np.sqrt(1.0 - self._keep**2) * self._deviations
        self._errors = self._keep * self._errors + spread * rng.standard_normal(spread.shape)
        seen = _off(poses, self._errors)
        outliers = rng.random(len(poses)) < self._outlier
        seen[outliers, :2] += rng.uniform(-OUTLIER_M, OUTLIER_M, (len(poses), 2))[outliers]
        seen[self._missing(rng)] = np.nan
        self._sent.push(seen)
        arrived = self._sent.read()
        return arrived, np.where(np.isnan(arrived[:, 0]), -math.inf, now_s - self._delay_s)

    def _missing(self, rng: np.random.Generator) -> np.ndarray:
        """(N,) bool: in a gap. No gap follows another without a pose between them."""
        begins = (rng.random(len(self._gap_s)) < self._gap_begins) & (self._gap_s <= 0.0)
        self._gap_s -= CONTROL_DT_S
        lengths = rng.random(len(self._gap_s)) * self._longest_gap_s
        self._gap_s = np.where(begins, lengths, self._gap_s)
        return np.asarray(self._gap_s > 0.0)


def _off(poses: np.ndarray, errors: np.ndarray) -> np.ndarray:
    seen = poses + errors
    seen[:, 2] = wrap_angle(seen[:, 2])
    return np.asarray(seen)
