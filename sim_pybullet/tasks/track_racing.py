"""``TrackRacing``: drive fast around a race track without touching its walls (paper B)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot.contract import CONTROL_DT_S, ImageSpec
from sim_pybullet.racing.racing_cars import FRAMES, RACING_ACTIONS, TOP_SPEED_MPS, RacingCars
from sim_pybullet.racing.track import SCALE, Track, centre_line, load_track, mirrored
from sim_pybullet.randomise import load_looks
from sim_pybullet.tasks.base import Mission, Starts, Task, TaskStep, expect_some
from sim_pybullet.tasks.spec import Choices, TaskSpec, register

BETA = 0.006  # paper B, equation 4: reward per m/s and per metre
GAMMA = -0.025  # paper B, equation 4: reward of a collision
SLOWEST_MPS = 4.0  # a mean speed below this takes too long,
PATIENCE_S = 10.0  # once so much time has passed
_PRACTICE_LAPS = 0.08  # in practice, where all of a track and its mirror image is seen
_STRAY_M = 0.5  # beyond the wall, where there is none


@dataclass(frozen=True)
class Style:
    """What a drive is worth besides its speed along the track."""

    centre: float  # weight of the distance from the middle of the road
    calm: float  # what a decision with the wheels at full lock costs
    top_mps: float = TOP_SPEED_MPS  # which a governor holds the car below


STYLES = {
    "race": Style(1.0, 0.0),  # paper B, equation 4
    # As people drive: along the road, wherever on it they are, and with steady hands.
    "cruise": Style(0.0, 0.002, 8.4),
}


class TrackRacing(Task):
    """Drive ``laps`` laps around a track, seeing the last four pictures.

    An episode begins at rest at a random place, a little off the middle and its direction; where
    starts are spread wider, at any speed. The reward is paper B's, in the metres of the real track:
    (v cos(alpha) - distance) beta, v the speed, alpha the angle between it and the track, distance
    from the middle of the road; gamma instead where the car collides. A `Style` may weigh the
    distance otherwise, and turned wheels.

    Terminated: in collision with a wall, beyond the grass where there is no wall, or more than 100
    degrees off (all count as collisions). Truncated: all laps driven (success), or 10 s behind
    a car of 4 m/s.

    ConfigError for no tracks, robots or laps, or a track that is not closed.
    """

    frames = FRAMES
    vehicle: RacingCars
    term_names: tuple[str, ...] = ("speed", "centre", "steering", "collision")
    fact_names: tuple[str, ...] = ("laps", "speed_mps")

    def __init__(
        self,
        road_maps: Sequence[Track],
        n_robots: int,
        laps: float = 1.0,
        style: Style = STYLES["race"],
        start_spread: float = 1.0,
    ) -> None:
        expect_some("TrackRacing", road_maps, n_robots, laps)
        self._lines = [centre_line(track) for track in road_maps]
        halves_m = np.array([line.half_width_m for line in self._lines])
        path = self._lines[0].path
        super().__init__(road_maps, RacingCars(n_robots), n_robots, halves_m, path, start_spread)
        self._limits_m = halves_m + [line.verge_m for line in self._lines] + _STRAY_M * SCALE
        self._laps, self._style = laps, style
        self.vehicle.governed_mps = style.top_mps
        self._poses = np.zeros((n_robots, 3))

    def reset(
        self, robots: np.ndarray, rng: np.random.Generator, number: int | None = None
    ) -> Starts:
        """Begin an episode for these robots (M,) on a random track, at a random place."""
        starts = super().reset(robots, rng, number)
        if self._spread > 1.0:
            self.vehicle.starts_mps[robots] = rng.uniform(0.0, self._style.top_mps, len(robots))
        self._poses[robots] = starts.poses
        return starts

    def reset_at(self, robots: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> Starts:
        """Begin an episode for these robots (M,) at these poses (M, 3), at rest."""
        self.vehicle.starts_mps[robots], self._poses[robots] = 0.0, poses
        return super().reset_at(robots, poses, rng)

    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:  # noqa: ARG002
        path = self._lines[road_map].path
        return path, rng.uniform(0.0, path.length_m)

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course, lost = self._follow(poses)
        way_m = np.hypot(*(poses - self._poses)[:, :2].T) / SCALE
        speed_mps = way_m / CONTROL_DT_S
        self._poses = poses.copy()
        away_m = np.abs(course.offset_m)
        self.vehicle.on_grass[:] = away_m > self.half_lane_m
        terminated = collided | lost | (away_m > self._limits_m[self._maps])
        laps = course.travelled_m / self._lengths_m
        due_m = SLOWEST_MPS * SCALE * (self._steps * CONTROL_DT_S - PATIENCE_S)
        late = course.travelled_m <= due_m
        terms = np.stack(
            (
                np.where(terminated, 0.0, BETA * speed_mps * np.cos(course.heading_error_rad)),
                np.where(terminated, 0.0, -BETA * self._style.centre * away_m / SCALE),
                np.where(terminated, 0.0, -self._style.calm * np.abs(self.vehicle.steering)),
                np.where(terminated, GAMMA, 0.0),
            )
        )
        ends = (terminated, laps >= self._laps, late)
        return self._judged(terms, np.stack((laps, speed_mps)), ends)


def _make(tracks: Sequence[Track], robots: int, chosen: Choices) -> TrackRacing:
    practice = chosen.start_spread > 1.0
    if practice:
        tracks = [*tracks, *map(mirrored, tracks)]
    usual = _PRACTICE_LAPS if practice else 1.0
    laps = usual if chosen.laps is None else chosen.laps
    style = STYLES[chosen.style or "race"]
    return TrackRacing(tracks, robots, laps, style, chosen.start_spread)


register(
    TaskSpec(
        name="track",
        title="Race tracks",
        purpose=(
            "Racing on tracks: for the simulator's cars, `python -m trainer evaluate`. A robot "
            "refuses it, it was trained for another vehicle."
        ),
        kind=TrackRacing,
        map="forest",
        make=_make,
        load=load_track,
        looks=load_looks,  # the looks themselves, if fixed: a track's walls never change
        actions=RACING_ACTIONS,
        styles=tuple(STYLES),
        counts_laps=True,
        painted=12,
        scale=SCALE,
        presets={
            # Pictures reach up to the horizon, where a fast car looks; a reward is what it is.
            "fast": {
                "image": ImageSpec(48, 36, crop_top_px=4),
                "net": {"channels": (16, 32), "centred": True},
                "reward_scale": 1.0,
                "steps": 400_000,
                "evaluation": {"episodes": 8, "every_steps": 10_000},
                "rate_left": 0.1,
                # Who begins at rest finds brakes bad. With a small bonus for entropy they are given
                # up before there is speed to need them for; so it begins large, and falls away.
                "entropy_left": 0.0,
                # 18 kB a stack of pictures, kept twice: 0.7 GB
                "learn": {"gamma": 0.98, "buffer": 20_000},
            },
            "paper": {"net": {"channels": (32, 64, 64, 64), "centred": True}},
            # What a turn is worth shows at once, and choices stay open. With a farther view or less
            # entropy a driver weaves, for which it hardly pays: learned from the true road ahead,
            # it held the wheels straight 16 % of the time instead of 50 %. People are not always
            # near the middle of the road: cars begin anywhere on it, and under any light.
            "cruise": {"start_spread": 4.0, "relit": True},
        },
        environments={
            "TrackRacing-v0": {"pool_size": 10},
            "TrackRacingLooks-v0": {"pool_size": 10, "look": "tracks"},
        },
    )
)
