"""``TrackRacing``: drive fast around a race track without touching its walls (paper B)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.errors import ConfigError
from robot.path_batch import PathBatch
from sim_pybullet.racing_cars import FRAMES, RacingCars
from sim_pybullet.tasks.base import Starts, TaskStep
from sim_pybullet.tasks.following import (
    MAX_HEADING_ERROR_RAD,
    START_HEADING_RAD,
    START_OFFSET,
    Course,
    PathFollower,
)
from sim_pybullet.track import SCALE, Track, centre_line

BETA = 0.006  # paper B, equation 4: reward per m/s and per metre
GAMMA = -0.025  # paper B, equation 4: reward of a collision
SLOWEST_MPS = 4.0  # a mean speed below this takes too long
_STRAY_M = 0.5  # beyond the wall, where there is none


class TrackRacing:
    """Drive ``laps`` laps around a track, seeing the last four pictures.

    An episode begins at rest at a random place, a little off the middle and its direction. The
    reward is paper B's, in the metres of the real track: (v cos(alpha) - distance) beta, v the
    speed, alpha the angle between it and the track, distance from the middle of the road; gamma
    instead where the car collides.

    Terminated: in collision with a wall, beyond the grass where there is no wall, or more than 100
    degrees off (all count as collisions). Truncated: all laps driven (success), or slower than
    4 m/s on average.

    Args:
        road_maps: tracks; each episode is on one of them.
        n_robots: N.
        laps: of an episode.

    Raises:
        ConfigError: no tracks, no robots or no laps, or a track that is not closed.
    """

    guided = False
    frames = FRAMES
    term_names: tuple[str, ...] = ("speed", "centre", "collision")
    fact_names: tuple[str, ...] = ("laps", "speed_mps")

    def __init__(self, road_maps: Sequence[Track], n_robots: int, laps: float = 1.0) -> None:
        if not road_maps or n_robots < 1 or laps <= 0.0:
            raise ConfigError(
                "TrackRacing: expected at least one track, one robot and laps above 0, got "
                f"{len(road_maps)} tracks, {n_robots} robots, {laps} laps"
            )
        self.road_maps = tuple(road_maps)
        self.n_robots = n_robots
        self.vehicle = RacingCars(n_robots)
        self._lines = [centre_line(track) for track in road_maps]
        self._halves_m = np.array([line.half_width_m for line in self._lines])
        self._limits_m = self._halves_m + [line.verge_m for line in self._lines] + _STRAY_M * SCALE
        self._lengths_m = np.array([line.path.length_m for line in self._lines])
        self._laps = laps
        self._follower = PathFollower(self._lines[0].path, n_robots)
        self._poses = np.zeros((n_robots, 3))
        self._maps = np.zeros(n_robots, dtype=int)
        self._steps = np.zeros(n_robots, dtype=int)

    @property
    def paths(self) -> PathBatch:
        """The centre line that each car follows."""
        return self._follower.paths

    @property
    def course(self) -> Course:
        """Where each car is on its track."""
        return self._follower.course

    @property
    def half_lane_m(self) -> np.ndarray:
        """(N,) distance from the middle of the road to its edge."""
        return np.asarray(self._halves_m[self._maps])

    def reset(self, robots: np.ndarray, rng: np.random.Generator) -> Starts:
        """Begin an episode for these robots (M,) on a random track, at a random place."""
        maps = rng.integers(len(self.road_maps), size=len(robots))
        poses = np.zeros((len(robots), 3))
        for k, (i, m) in enumerate(zip(robots.tolist(), maps.tolist(), strict=True)):
            path, most_m = self._lines[m].path, START_OFFSET * self._halves_m[m]
            poses[k] = self._follower.start(
                i,
                path,
                rng.uniform(0.0, path.length_m),
                rng.uniform(-most_m, most_m),
                rng.uniform(-START_HEADING_RAD, START_HEADING_RAD),
            )
        self._maps[robots], self._steps[robots], self._poses[robots] = maps, 0, poses
        return Starts(poses, maps)

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course = self._follower.follow(poses)
        way_m = np.hypot(*(poses - self._poses)[:, :2].T) / SCALE
        speed_mps = way_m / CONTROL_DT_S
        self._poses = poses.copy()
        self._steps += 1
        away_m = np.abs(course.offset_m)
        self.vehicle.on_grass[:] = away_m > self.half_lane_m
        lost = np.abs(course.heading_error_rad) > MAX_HEADING_ERROR_RAD
        terminated = collided | lost | (away_m > self._limits_m[self._maps])
        laps = course.travelled_m / self._lengths_m[self._maps]
        success = ~terminated & (laps >= self._laps)
        slowest_m = self._steps * CONTROL_DT_S * SLOWEST_MPS * SCALE
        late = slowest_m >= self._laps * self._lengths_m[self._maps]
        terms = np.stack(
            (
                np.where(terminated, 0.0, BETA * speed_mps * np.cos(course.heading_error_rad)),
                np.where(terminated, 0.0, -BETA * away_m / SCALE),
                np.where(terminated, GAMMA, 0.0),
            )
        )
        facts = np.stack((laps, speed_mps))
        return TaskStep(terms, facts, terminated, ~terminated & (success | late), success)
