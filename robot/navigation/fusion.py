"""Where the robot is: late, drifting overhead poses fused with its own step odometry.

An extended Kalman filter (Thrun, Burgard and Fox, Probabilistic Robotics, 3.3) whose state holds,
beside the pose, what spoils either source:

* how far the robot's wheels are from what its step counts promise: scale of the way driven, scale
  of the angle turned, and drift of the heading while driving straight. No wheel is farther off than
  its bound: without one, a scale of nearly nothing explains a robot that stands while it steps. An
  estimate beyond it is projected back, and the rest of the state with it (Simon, Kalman filtering
  with state constraints, IET Control Theory and Applications 4, 2010, section 2.3);
* what sight says wrong of offset, heading and, as a share of it, the way to a red line, where there
  is sight: its camera is mounted by hand;
* the error of the overhead poses, which drifts. Taken for white it would be averaged away over a
  few pictures, which it is not (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to
  Tracking and Navigation, 8.3: coloured measurement noise by state augmentation).

Steps move the estimate at once; an overhead pose corrects the estimate of the moment its picture
was taken, and the motion since is replayed. N robots at once: the simulator runs the very filter
of the robot.
"""

import math
from dataclasses import dataclass
from typing import Callable, List, Tuple

import numpy as np

from robot.geometry import between, carried, compose, ellipses_95, radius_95, uncompose, wrap_angle

HISTORY_S = 3.0  # older pictures are refused
_UNKNOWN_HEADING_RAD = 1e3  # standard deviation of a heading that was not measured
_POSE, _CALIBRATION, _ERROR = slice(0, 3), slice(3, 6), slice(6, 9)  # parts of the state
SEEN = slice(9, 12)  # the part that only robots with sight have
SEEN_LINE = 11  # of that, of the red line
_FORWARD, _TURN, _DRIFT = 3, 4, 5  # the calibration


# Estimates (N, 3), steps since -> innovation (N, K), design (N, K, S), covariance (N, K, K).
Compare = Callable[[np.ndarray, np.ndarray], Tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class FusionConfig:
    """Standard deviations of what goes into the filter. The overhead defaults are the arena's."""

    position_m: float = 0.03  # of each overhead coordinate
    heading_rad: float = math.radians(5.0)
    correlation_s: float = 2.0  # over which the overhead errors drift
    jitter: float = 0.5  # share of these errors that is new in every picture
    forward_scale: float = 0.05  # of metres per step
    turn_scale: float = 0.1  # tyres scrub, baselines are not exact
    drift_rad_per_m: float = 0.2  # one wheel is larger than the other
    # The most that wheels, tyres and axles can be off: forward, turn, drift. The widest look has
    # wheels of +-15 %, turns of -28 to +27 % and drifts of 1.2 rad/m.
    bounds: Tuple[float, float, float] = (0.2, 0.35, 1.4)
    step_noise: float = 0.02  # of the way driven, per square root of a metre
    turn_noise: float = 0.05  # of the angle turned, per square root of a radian
    wander_rad: float = 0.1  # of the heading, per square root of a metre
    gate: float = 16.3  # squared Mahalanobis distance that 1 of 1000 honest poses exceeds
    rejections: int = 5  # so many unbelievable poses in a row mean that the estimate is wrong
    sight: bool = False  # whether there are states for the error of sight
    seen_offset_m: float = 0.008  # of that error, which goes with camera, lens and light
    seen_heading_rad: float = math.radians(2.5)
    seen_line: float = 0.08  # share of a red line's distance
    seen_correlation_s: float = 20.0  # over which it drifts


class PoseFusion:
    """The filter of ``count`` robots; so many overhead poses in a row were ``rejected`` (N,)."""

    def __init__(self, count: int = 1, config: FusionConfig = FusionConfig()) -> None:
        self.config = config
        self.rejected = np.zeros(count, dtype=int)
        self._states = SEEN.stop if config.sight else SEEN.start
        wheels = (config.forward_scale, config.turn_scale, config.drift_rad_per_m)
        overhead = (config.position_m, config.position_m, config.heading_rad)
        self._overhead_variance = np.square(overhead)
        seen = (config.seen_offset_m, config.seen_heading_rad, config.seen_line)
        self._seen_variance = np.square(seen)
        # Of a robot whose place is known, and its wheels and sight not yet.
        known = np.concatenate((np.zeros(3), np.square(wheels), np.zeros(3), self._seen_variance))
        self._first = np.diag(known[: self._states])
        self._state = np.zeros((count, self._states))
        self._covariance = np.zeros((count, self._states, self._states))
        self._measured_s = np.full(count, -math.inf)
        self._odometry = np.zeros((count, 3))  # by calibrated steps
        self._times_s: List[float] = []
        self._history: List[np.ndarray] = []  # odometry (N, 3) at each time
        self.reset(np.arange(count))

    def reset(self, robots: np.ndarray) -> None:
        """Forget where these robots (boolean mask or indices) are, and how they drive."""
        self._state[robots] = 0.0
        self._state[robots, _POSE] = np.nan
        self.rejected[robots] = 0
        self._measured_s[robots] = -math.inf
        self._covariance[robots] = self._first

    def put(self, robots: np.ndarray, poses: np.ndarray, deviations: Tuple[float, ...]) -> None:
        """Let robots (M,) be at poses (M, 3), by a word with these standard deviations (3,)."""
        self.reset(robots)
        self._state[robots, _POSE] = poses
        self._covariance[robots, _POSE, _POSE] = np.diag(np.square(deviations))
        self._covariance[robots, _ERROR, _ERROR] = np.diag(self._overhead_variance)

    @property
    def poses(self) -> np.ndarray:
        """(N, 3) estimates in the world, NaN until the first overhead pose."""
        return self._state[:, _POSE]

    @property
    def ellipses(self) -> np.ndarray:
        """(N, 3) that hold 95 % of where robots may be: half axes [m], direction of the longer."""
        return ellipses_95(self._covariance[:, :2, :2])

    def relearn(self, robots: np.ndarray) -> None:
        """Forget how these robots (boolean mask or indices) drive, not where they are."""
        covariance = self._covariance[robots]
        covariance[:, _CALIBRATION, :] = self._first[_CALIBRATION]
        covariance[:, :, _CALIBRATION] = self._first[:, _CALIBRATION]
        self._covariance[robots] = covariance
        self._state[robots, _CALIBRATION] = 0.0

    @property
    def at_bound(self) -> np.ndarray:
        """(N,) whether the wheels seem to be off by as much as wheels can be: a doubt in itself."""
        return np.asarray((np.abs(self._state[:, _CALIBRATION]) >= self.config.bounds).any(axis=1))

    @property
    def scale_deviations(self) -> np.ndarray:
        """(N,) standard deviation of how far wheels are from the metres that they promise."""
        return np.asarray(np.sqrt(self._covariance[:, _FORWARD, _FORWARD]))

    @property
    def certainty(self) -> np.ndarray:
        """(N, 2) within how far of the truth position [m] and heading [rad] are, 95 % sure."""
        turned = 1.96 * np.sqrt(self._covariance[:, 2, 2])  # 95 % of a normal
        return np.stack((radius_95(self._covariance[:, :2, :2]), turned), axis=1)

    def move(self, forward_m: np.ndarray, turn_rad: np.ndarray, now_s: float) -> None:
        """Dead-reckon arcs (N,) [m], (N,) [rad] that end ``now_s``; for every tick."""
        forward_scale, turn_scale, drift = self._state[:, _CALIBRATION].T
        forward = (1.0 + forward_scale) * forward_m
        turn = (1.0 + turn_scale) * turn_rad + drift * forward_m
        half = 0.5 * turn
        chord = forward * np.sinc(half / math.pi)
        step = np.stack((chord * np.cos(half), chord * np.sin(half), turn), axis=1)
        moved = compose(self.poses, step)
        # of a robot whose place is unknown only the calibration means anything
        displaced = np.nan_to_num(moved[:, :2] - self.poses[:, :2])
        along = np.nan_to_num(self.poses[:, 2] + half)
        c, s = np.cos(along), np.sin(along)
        elapsed_s = now_s - self._times_s[-1] if self._times_s else 0.0
        config = self.config
        keep = math.exp(-elapsed_s / config.correlation_s)
        keep_seen = math.exp(-elapsed_s / config.seen_correlation_s)
        change = np.zeros_like(self._covariance)  # Jacobian of the new state by the old one
        kept = np.array((1.0,) * 6 + (keep,) * 3 + (keep_seen,) * 3)[: self._states]
        change[:, range(self._states), range(self._states)] = kept
        change[:, 0, 2], change[:, 1, 2] = -displaced[:, 1], displaced[:, 0]
        change[:, 0, _FORWARD], change[:, 1, _FORWARD] = forward_m * c, forward_m * s
        for number, steps in ((_TURN, turn_rad), (_DRIFT, forward_m)):
            change[:, 2, number] = steps
            change[:, 0, number] = -0.5 * displaced[:, 1] * steps
            change[:, 1, number] = 0.5 * displaced[:, 0] * steps
        noise = np.zeros_like(self._covariance)
        length_m = np.abs(forward_m)
        variance = config.step_noise**2 * length_m
        noise[:, 0, 0], noise[:, 1, 1] = variance * c * c, variance * s * s
        noise[:, 0, 1] = noise[:, 1, 0] = variance * c * s
        noise[:, 2, 2] = config.turn_noise**2 * np.abs(turn_rad) + config.wander_rad**2 * length_m
        noise[:, range(6, 9), range(6, 9)] = (1.0 - keep**2) * self._overhead_variance
        if config.sight:
            noise[:, range(9, 12), range(9, 12)] = (1.0 - keep_seen**2) * self._seen_variance
        self._covariance = change @ self._covariance @ change.transpose(0, 2, 1) + noise
        self._state[:, 6:] *= kept[6:]
        self._state[:, _POSE] = moved
        self._odometry = compose(self._odometry, step)
        self._times_s.append(now_s)
        self._history.append(self._odometry)
        while self._times_s[0] < now_s - HISTORY_S:
            del self._times_s[0], self._history[0]

    def measure(self, measured: np.ndarray, captured_s: np.ndarray) -> None:
        """Take overhead poses (N, 3) of pictures taken at times (N,) [s].

        A row of NaN is a robot without a new pose; a heading alone may be NaN too. Poses that the
        filter cannot believe, or older than its memory, are counted in ``rejected`` and ignored.
        """
        state, since, covariance = self._then(captured_s)
        fresh = np.isfinite(measured[:, :2]).all(axis=1) & (captured_s > self._measured_s)
        unknown = np.isnan(self.poses[:, 0]) | (self.rejected >= self.config.rejections)
        lost = fresh & unknown & np.isfinite(measured[:, 2] + since[:, 0])
        design = np.zeros((len(state), 3, self._states))  # measured is the pose and its error
        design[:, range(3), range(3)] = design[:, range(3), range(6, 9)] = 1.0
        jitter = np.zeros((len(state), 3, 3))
        jitter[:, range(3), range(3)] = self.config.jitter**2 * self._overhead_variance
        jitter[np.isnan(measured[:, 2]), 2, 2] = _UNKNOWN_HEADING_RAD**2
        innovation = measured - state[:, _POSE] - state[:, _ERROR]
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        known = np.isfinite(state[:, 0]) & np.isfinite(since[:, 0])
        distance = self._update(state, covariance, innovation, design, jitter)
        taken = lost | (fresh & known & (distance < self.config.gate))
        # Who was lost is where it was measured, with that error. What it learned of its wheels led
        # it astray, or to nothing: it begins anew, too.
        error = np.diag(self._overhead_variance)
        begun = self._first.copy()
        begun[_POSE, _POSE], begun[_ERROR, _ERROR] = error * (1.0 + self.config.jitter**2), error
        begun[_POSE, _ERROR] = begun[_ERROR, _POSE] = -error
        state[lost], covariance[lost] = 0.0, begun
        state[lost, _POSE] = measured[lost]
        self._take(taken, state, since, covariance)
        self._measured_s[taken] = captured_s[taken]
        self.rejected = np.where(taken, 0, self.rejected + fresh)

    def correct(self, compare: Compare, captured_s: np.ndarray, asked: np.ndarray) -> np.ndarray:
        """Take what else was measured of the poses at times (N,) [s].

        ``compare`` is told the estimates then, and the steps since, both (N, 3); it gives what
        was measured less what they let expect (N, K), NaN where nothing was measured, how that
        goes with the state (N, K, S), and its covariance (N, K, K). Gives how far off that is (N,),
        a squared Mahalanobis distance, NaN where nothing was measured. What is farther off than
        ``gate`` is ignored.
        """
        state, since, covariance = self._then(captured_s)
        poses = state[:, _POSE]
        innovation, design, noise = compare(poses, since)
        known = np.isfinite(innovation).all(axis=1) & np.isfinite(poses).all(axis=1)
        distance = self._update(state, covariance, innovation, design, noise)
        self._take(asked & known & (distance < self.config.gate), state, since, covariance)
        return np.where(known, distance, np.nan)

    def seen_error(self) -> np.ndarray:
        """(N, 3) what sight says wrong: offset [m], heading [rad], share of the line's distance."""
        return self._state[:, SEEN].copy()

    def _then(self, when_s: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The states at times (N,), steps since, and covariance; NaN before the history begins."""
        times = np.array(self._times_s)
        then = self._odometry
        if len(times) > 1:
            after = np.clip(np.searchsorted(times, when_s), 1, len(times) - 1)
            share = (when_s - times[after - 1]) / (times[after] - times[after - 1])
            history, robots = np.stack(self._history), np.arange(len(when_s))
            before = history[after - 1, robots]
            step = between(before, history[after, robots])
            then = compose(before, step * np.clip(share, 0.0, 1.0)[:, None])
        then = np.where((when_s >= times[0])[:, None], then, np.nan)
        since = between(then, self._odometry)
        state = self._state.copy()
        state[:, _POSE] = uncompose(self.poses, since)
        return state, since, carried(self._covariance, state[:, :2] - self._state[:, :2])

    def _take(
        self, taken: np.ndarray, state: np.ndarray, since: np.ndarray, covariance: np.ndarray
    ) -> None:
        """Let corrected estimates of some robots (N,) count, with the steps since."""
        now = compose(state, since)
        self._covariance[taken] = carried(covariance, now[:, :2] - state[:, :2])[taken]
        state[:, _POSE] = now
        self._state[taken] = state[taken]

    def age_s(self, now_s: float) -> np.ndarray:
        """(N,) time since the picture of the last overhead pose that was taken [s]."""
        return now_s - self._measured_s

    def _update(
        self,
        state: np.ndarray,
        covariance: np.ndarray,
        innovation: np.ndarray,
        design: np.ndarray,
        noise: np.ndarray,
    ) -> np.ndarray:
        """Correct estimates in place, so that no calibration is beyond its bound. Gives the
        squared Mahalanobis distances (N,) of the innovations."""
        seen = covariance @ design.transpose(0, 2, 1)
        inverse = np.linalg.inv(design @ seen + noise)
        gain = seen @ inverse
        difference = np.nan_to_num(innovation)
        state += np.einsum("nij,nj->ni", gain, difference)
        covariance -= gain @ seen.transpose(0, 2, 1)
        covariance += covariance.transpose(0, 2, 1).copy()  # symmetric, or rounding would grow
        covariance *= 0.5
        bounds = np.array(self.config.bounds)
        for number, bound in zip((_FORWARD, _TURN, _DRIFT), bounds):
            excess = state[:, number] - np.clip(state[:, number], -bound, bound)
            if excess.any():
                share = covariance[:, :, number] / covariance[:, number, number, None]
                state -= share * excess[:, None]
        state[:, _CALIBRATION] = np.clip(state[:, _CALIBRATION], -bounds, bounds)
        return np.einsum("ni,nij,nj->n", difference, inverse, difference)
