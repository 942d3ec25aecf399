"""``TrackRacing``: drive fast around a race track without touching its walls (paper B).

Its cars are point masses with a steered front axle: the engine pulls less the faster it goes,
brakes and tyres hold the car back, and tyres cannot turn it more sharply than their grip allows at
its speed. All in the metres of the real track; only what ``step`` returns is at the world's scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot.contract import CONTROL_DT_S, ActionTable, ImageSpec
from robot.geometry import wrap_angle
from robot.navigation.path import PathBatch
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import PHYSICS_DT_S, DelayLine, pursuit
from sim_pybullet.racing.track import SCALE, Track, centre_line, load_track, mirrored
from sim_pybullet.randomise import load_looks
from sim_pybullet.tasks.spec import Choices, Mission, Task, TaskSpec, TaskStep, expect_any, register

# Steering (positive to the left) and throttle (negative brakes), in the order of paper B, section
# 3.1: straight, left, right, each with throttle, with brakes, and rolling.
RACING_ACTIONS: ActionTable = tuple(
    (float(steer), float(throttle)) for throttle in (1, -1, 0) for steer in (0, 1, -1)
)
FRAMES = 4  # that a racing policy sees (paper B, section 3.1)
TOP_SPEED_MPS = 25.0
ENGINE_MPS2 = 5.0  # at rest; nothing is left of it at top speed
BRAKE_MPS2 = 9.0
ROLLING_MPS2 = 0.6  # without throttle
GRASS_DRAG_PER_S = 0.5  # of the speed, on grass
GRIP_MPS2 = 9.0  # greatest sideways acceleration on asphalt
GRASS_GRIP_MPS2 = 4.0
SHARPEST_PER_M = 1.0 / 8.0  # curvature at full lock
# The expert:
_AHEAD_S, _AHEAD_M = 0.5, 4.0  # it steers for the point so far ahead
_BEND_M = 6.0  # stretch of road over which it measures a bend
_LOOKS_M = np.arange(0.0, 60.0, _BEND_M)
_CAREFUL = 0.6  # share of the grip it uses in bends


class RacingCars:
    """N cars, in the place of `sim_pybullet.motors.WheeledRobots`.

    A ``DriveLook`` gives the engine's ``gain``, ``turn_gain`` of the steering, ``turn_lag_s``
    between wheel and tyre, ``delay_s`` between command and car, and ``noise`` of the speed.
    """

    actions = RACING_ACTIONS
    governed_mps = TOP_SPEED_MPS  # from where on the engine does not pull; set by the task

    def __init__(self, n_robots: int) -> None:
        self.on_grass = np.zeros(n_robots, dtype=bool)  # set by the task, which knows the track
        self.starts_mps = np.zeros(n_robots)  # speeds that episodes begin with; set by the task
        self.speed_mps = np.zeros(n_robots)
        self.steering = np.zeros(n_robots)  # in shares of full lock, positive to the left
        self._gain, self._turn_gain = np.ones(n_robots), np.ones(n_robots)
        self._follow, self._noise = np.ones(n_robots), np.zeros(n_robots)
        self._commands = DelayLine(n_robots, 2)
        self.counted = np.zeros((n_robots, 2))  # speed [m/s], turn rate [rad/s], world's scale
        self._table = np.array(RACING_ACTIONS)

    def reset(self, i: int, look: DriveLook) -> None:
        """Car ``i`` is on asphalt, its wheels straight, and drives at ``starts_mps``."""
        self.steering[i] = self.counted[i] = 0.0
        self.speed_mps[i] = self.starts_mps[i]
        self.on_grass[i] = False
        self._gain[i], self._turn_gain[i], self._noise[i] = look.gain, look.turn_gain, look.noise
        self._follow[i] = PHYSICS_DT_S / max(look.turn_lag_s, PHYSICS_DT_S)
        self._commands.reset(i, look.delay_s / PHYSICS_DT_S, np.zeros(2))

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Advance by one physics step; (N, 2) forward speed and turn rate at the world's scale.

        Pairs are steering, positive to the left, and throttle.
        """
        self._commands.push(self._table[actions] if actions.ndim == 1 else actions)
        steer, throttle = self._commands.read().T
        self.steering += self._follow * (steer - self.steering)
        self.speed_mps = np.maximum(0.0, self.speed_mps + PHYSICS_DT_S * self._push(throttle))
        curvature = self.steering * np.minimum(SHARPEST_PER_M * self._turn_gain, self._sharpest())
        speed = self.speed_mps * (1.0 + self._noise * rng.standard_normal(len(self.speed_mps)))
        self.counted = np.stack((SCALE * speed, speed * curvature), axis=1)
        return self.counted

    def expert(self, paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
        """(N,) pursuit of the centre line, as fast as the bends ahead allow."""
        ahead_m = SCALE * (_AHEAD_M + _AHEAD_S * self.speed_mps)
        bend = SCALE * pursuit(paths, poses, arc_m + ahead_m)
        share = bend / np.minimum(SHARPEST_PER_M, self._sharpest())
        steer = np.round(np.clip(share, -1.0, 1.0)).astype(int)  # positive to the left
        headings = paths.headings_at(arc_m[:, None] + SCALE * np.append(_LOOKS_M, 60.0))
        bends = np.abs(np.asarray(wrap_angle(np.diff(headings, axis=1)))) / _BEND_M
        in_bend = _CAREFUL * GRIP_MPS2 / np.maximum(bends, 1e-6)  # squared speed
        most = np.sqrt((in_bend + 1.2 * BRAKE_MPS2 * np.maximum(_LOOKS_M - 2.0, 0.0)).min(axis=1))
        throttle = np.where(self.speed_mps > most, -1, (self.speed_mps < most - 1.0).astype(int))
        return 3 * np.array([1, 2, 0])[throttle + 1] + np.array([2, 0, 1])[steer + 1]

    def _push(self, throttle: np.ndarray) -> np.ndarray:
        """(N,) acceleration along the car [m/s^2]."""
        engine = ENGINE_MPS2 * self._gain * (1.0 - self.speed_mps / TOP_SPEED_MPS)
        engine = np.where(self.speed_mps < self.governed_mps, engine, 0.0)
        push = np.where(throttle > 0.0, throttle * engine, throttle * BRAKE_MPS2)
        drag = ROLLING_MPS2 * (throttle <= 0.0) + GRASS_DRAG_PER_S * self.speed_mps * self.on_grass
        return np.asarray(push - drag)

    def _sharpest(self) -> np.ndarray:
        """(N,) curvature [1/m] that the tyres hold at this speed."""
        grip = np.where(self.on_grass, GRASS_GRIP_MPS2, GRIP_MPS2)
        return np.asarray(grip / np.maximum(self.speed_mps, 1.0) ** 2)


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
        expect_any("TrackRacing", road_maps, n_robots, laps)
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
    ) -> np.ndarray:
        """Begin an episode for these robots (M,) on a random track, at a random place."""
        poses = super().reset(robots, rng, number)
        if self._spread > 1.0:
            self.vehicle.starts_mps[robots] = rng.uniform(0.0, self._style.top_mps, len(robots))
        self._poses[robots] = poses
        return poses

    def reset_at(self, robots: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> None:
        """Begin an episode for these robots (M,) at these poses (M, 3), at rest."""
        self.vehicle.starts_mps[robots], self._poses[robots] = 0.0, poses
        super().reset_at(robots, poses, rng)

    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:  # noqa: ARG002
        path = self._lines[road_map].path
        return path, rng.uniform(0.0, path.length_m)

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course, lost = self._follow(poses)
        speed_mps = np.hypot(*(poses - self._poses)[:, :2].T) / SCALE / CONTROL_DT_S
        self._poses = poses.copy()
        away_m = np.abs(course.offset_m)
        self.vehicle.on_grass[:] = away_m > self.half_lane_m
        terminated = collided | lost | (away_m > self._limits_m[self.maps])
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
    laps = chosen.laps if chosen.laps is not None else _PRACTICE_LAPS if practice else 1.0
    return TrackRacing(tracks, robots, laps, STYLES[chosen.style or "race"], chosen.start_spread)


register(
    TaskSpec(
        name="track",
        title="Race tracks",
        purpose=(
            "Racing on tracks: for the simulator's cars, `duckpilot evaluate`. A robot "
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
