"""The way that the wheels' steps tell, against the way that the overhead poses tell.

A robot that is held, lifted or blocked steps and stays; a frozen overhead picture shows a robot
that stays and it drives; poses that jump to another robot, or drift away, lead where no wheel led.
Poses are compared with earlier ones of the last seconds: the steps between the two say how far
apart they must lie, in the direction of the headings that were seen. Two measures of what is too
far:

* the worst error that poses may have, and the widest that wheels may be off;
* the errors that these poses had of late, and these wheels in this mission. What was true to a few
  millimetres and no longer is, is in doubt, however little it is off (a test of a mean against the
  variance of its increments). Noise of any strength passes, a steady drift does not.

Three poses in a row must contradict three others in a row: an outlier is no reason to stop.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Deque, NamedTuple, Tuple

import numpy as np

from robot.geometry import Pose, wrap_angle

STEPS_S = 3.0  # older pictures are not compared
USUAL_OF = 50  # ways that tell how far poses usually err
IN_A_ROW = 3  # poses that must contradict as many others
_TIME, _SEEN_X, _SEEN_Y, _SEEN_RAD, _X, _Y, _RAD, _LED_X, _LED_Y = range(9)  # of a row


@dataclass(frozen=True)
class WayLimits:
    """Errors as standard deviations. The poses' are the arena's, the wheels' the widest look's."""

    position_m: float = 0.03
    heading_rad: float = math.radians(5.0)
    correlation_s: float = 2.0  # over which these errors drift
    white_m: float = 0.005  # new in every pose
    white_rad: float = math.radians(1.0)
    forward_scale: float = 0.06
    turn_scale: float = 0.11
    drift_rad_per_m: float = 0.4
    timing_m: float = 0.009  # 30 ms at full speed
    memory_s: float = 1.6
    contradiction: float = 28.0  # squared distance in standard deviations, of three numbers
    fine_memory_s: float = 2.4
    fine_contradiction: float = 18.0
    fine_useful_m: float = 0.0035  # poses that err by more, from one to the next, hide a drift
    fine_caution: float = 1.5  # times the variance that was seen
    fine_white_m: float = 0.0015  # no poses are held to be better, from one to the next
    fine_m: float = 0.005  # nor over any way
    fine_rad: float = math.radians(0.7)  # nor their headings, against what was usual
    fine_scale: float = 0.036  # of wheels not yet known: 15 % just pass
    fine_askew_rad: float = 0.02  # of a board not yet known: 5 degrees just pass
    fine_timing_s: float = 0.06  # by which wheels answer, and pictures are dated, late
    fine_lag_s: float = 0.5


class WayDoubt(NamedTuple):
    """What does not fit, as squared distances over their limits: above 1 is a doubt."""

    coarse: float = 0.0
    fine: float = 0.0
    stands: bool = False  # the poses hardly moved while the wheels stepped

    @property
    def doubtful(self) -> bool:
        """Whether the two ways contradict each other."""
        return self.coarse > 1.0 or self.fine > 1.0


class WayCheck:
    """Of one robot, in one mission. Times come from the caller's one clock."""

    def __init__(self, limits: WayLimits = WayLimits()) -> None:
        self._limits = limits
        # variances of the poses' errors as they were, over one pose and over half a second
        self._usual_m2 = np.full(2, limits.position_m**2)
        self._usual_of = 0  # how many ways
        self._steps: Deque[Tuple[float, float, float, float]] = deque()  # time, pose by steps
        self._rows = np.zeros((0, 9))
        self.reset()

    def reset(self) -> None:
        """A mission begins: forget the way and the wheels; not how good the poses usually are."""
        self.doubt = WayDoubt()
        self._forget(math.inf)
        self._learned = 0.0j  # sum of conj(led) * seen, over the ways that grew old
        self._weight_m2 = 0.0  # and of their squares

    def stepped(self, now_s: float, odometry: Pose) -> None:
        """Where the robot is by its steps alone, from anywhere; for every tick."""
        self._steps.append((now_s, *odometry))
        while self._steps[0][0] < now_s - STEPS_S:
            self._steps.popleft()

    def see(self, captured_s: float, seen: Pose) -> WayDoubt:
        """Compare an overhead pose, of a picture taken at ``captured_s``, with those before it.

        One that is no newer than the last, or older than the steps that are known, changes nothing.
        """
        last_s = self._rows[-1, _TIME] if len(self._rows) else -math.inf
        if not self._steps or captured_s <= last_s or captured_s < self._steps[0][0]:
            return self.doubt
        return self._add(captured_s, seen, self._stepped_to(captured_s))

    def _stepped_to(self, when_s: float) -> Pose:
        steps = np.array(self._steps)
        after = int(np.clip(np.searchsorted(steps[:, 0], when_s), 0, len(steps) - 1))
        before = max(after - 1, 0)
        gap_s = steps[after, 0] - steps[before, 0]
        share = min(1.0, (when_s - steps[before, 0]) / gap_s) if gap_s > 0.0 else 1.0
        x_m, y_m = steps[before, 1:3] + share * (steps[after, 1:3] - steps[before, 1:3])
        turned_rad = float(wrap_angle(steps[after, 3] - steps[before, 3]))
        return Pose(float(x_m), float(y_m), float(steps[before, 3]) + share * turned_rad)

    def _add(self, captured_s: float, seen: Pose, odometry: Pose) -> WayDoubt:
        row = np.array([captured_s, *seen, *odometry, 0.0, 0.0])
        if len(self._rows):
            row[_LED_X:] = self._led_to(self._rows[-1], row)
        self._rows = np.vstack((self._rows, row))
        self._forget(captured_s)
        if len(self._rows) >= 2 * IN_A_ROW:
            self.doubt = self._judge()
        return self.doubt

    @staticmethod
    def _led_to(last: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Where steps led from ``last`` (2,), in the headings that were seen."""
        first, second = last[_SEEN_RAD] - last[_RAD], row[_SEEN_RAD] - row[_RAD]
        turn = first + 0.5 * wrap_angle(second - first)
        c, s = math.cos(turn), math.sin(turn)
        x, y = row[_X] - last[_X], row[_Y] - last[_Y]
        return last[_LED_X:] + np.array([c * x - s * y, s * x + c * y])

    def _forget(self, now_s: float) -> None:
        """Drop ways that grew old, and learn of them how these wheels drive, and poses err."""
        rows, before_s = self._rows, now_s - self._limits.fine_memory_s
        known = rows[rows[:, _TIME] < before_s]
        first = 0
        for first, begins in enumerate(rows):
            later = int(np.searchsorted(known[:, _TIME], begins[_TIME] + self._lag_s))
            if later >= len(known):
                break
            seen, led = (complex(way) for way in _ways(begins, rows[later]))
            if self._steady(rows[first : later + 1]):
                self._learn_scale(seen, led)
            self._learn_errors(seen - led, rows[first : first + 2])
        self._rows = rows[first:]

    @staticmethod
    def _steady(rows: np.ndarray) -> bool:
        """Whether a way was driven at one speed: setting off, a robot lags behind its steps."""
        if len(rows) < IN_A_ROW:
            return False
        _, led = _ways(rows[[0, len(rows) // 2]], rows[[len(rows) // 2, -1]])
        speeds = np.abs(led) / np.diff(rows[[0, len(rows) // 2, -1], _TIME])
        return bool(abs(speeds[0] - speeds[1]) < 0.25 * speeds.max())

    def _learn_scale(self, seen: complex, led: complex) -> None:
        """How far these wheels are off; outliers tell nothing of that."""
        spread_m2 = 2.0 * self._usual_m2[1] + (self._limits.forward_scale * abs(led)) ** 2
        if abs(seen - led) ** 2 < 9.0 * spread_m2:
            self._learned += led.conjugate() * seen
            self._weight_m2 += abs(led) ** 2

    def _learn_errors(self, long: complex, next_rows: np.ndarray) -> None:
        """How far poses are from where steps lead: over half a second, and from one to the next.

        A running median, which a robot that is carried or poses that drift hardly move.
        """
        if self.doubt.doubtful:
            return
        seen, led = _ways(next_rows[0], next_rows[1])
        errors_m2 = np.abs(np.array([seen - led, long])) ** 2 / (2.0 * math.log(2.0))
        self._usual_of += 1
        if self._usual_of == 1:
            self._usual_m2 = np.maximum(errors_m2, self._limits.fine_white_m**2)
        rate = max(1.0 / self._usual_of, 2.0 / USUAL_OF)
        self._usual_m2 *= np.where(errors_m2 > self._usual_m2, 1.0 + rate, 1.0 / (1.0 + rate))
        self._usual_m2 = np.maximum(self._usual_m2, self._limits.fine_white_m**2)

    @property
    def _lag_s(self) -> float:
        return self._limits.fine_lag_s - 1e-3

    def _judge(self) -> WayDoubt:
        limits, rows = self._limits, self._rows
        rows = rows[rows[:, _TIME] >= rows[-1, _TIME] - limits.fine_memory_s]
        if len(rows) < 2 * IN_A_ROW:
            return WayDoubt()
        now, then = rows[-IN_A_ROW:], rows[:-IN_A_ROW]
        seen, led = _ways(then[None], now[:, None])
        elapsed_s = now[:, None, _TIME] - then[None, :, _TIME]
        near = then[:, _TIME] >= rows[-1, _TIME] - limits.memory_s
        coarse = self._coarse(now, then, seen, led, elapsed_s)
        worst, at = _in_a_row(coarse[:, near])
        stands = False
        if at >= 0:
            first = at + int(np.argmax(near))
            stands = bool(abs(seen[-1, first]) < 0.5 * abs(led[-1, first]))
        velocity = _velocities(rows)
        changed = np.abs(velocity[-IN_A_ROW:, None] - velocity[None, :-IN_A_ROW])
        fine, _ = _in_a_row(self._fine(seen, led, elapsed_s, changed))
        return WayDoubt(worst / limits.contradiction, fine / limits.fine_contradiction, stands)

    def _coarse(
        self,
        now: np.ndarray,
        then: np.ndarray,
        seen: np.ndarray,
        led: np.ndarray,
        elapsed_s: np.ndarray,
    ) -> np.ndarray:
        """Squared distances (3, n) by the worst that poses and wheels may be."""
        limits = self._limits
        keep = np.exp(-elapsed_s / limits.correlation_s)
        along, across = _split(seen - led, led)
        way_m = np.abs(led)
        both = 2.0 * limits.position_m**2 * (1.0 - keep) + 2.0 * limits.white_m**2
        along_var = both + (limits.forward_scale * way_m) ** 2 + limits.timing_m**2
        heading_var = limits.heading_rad**2 * 0.5 * (1.0 + keep) + 0.5 * limits.white_rad**2
        stepped_rad = wrap_angle(now[:, None, _RAD] - then[None, :, _RAD])
        seen_rad = wrap_angle(now[:, None, _SEEN_RAD] - then[None, :, _SEEN_RAD])
        turned_var = 2.0 * limits.heading_rad**2 * (1.0 - keep) + 2.0 * limits.white_rad**2
        turned_var += (limits.turn_scale * stepped_rad) ** 2
        turned_var += (limits.drift_rad_per_m * way_m) ** 2
        squared = along**2 / along_var + across**2 / (both + way_m**2 * heading_var)
        return np.asarray(squared + wrap_angle(seen_rad - stepped_rad) ** 2 / turned_var)

    def _fine(
        self, seen: np.ndarray, led: np.ndarray, elapsed_s: np.ndarray, changed_mps: np.ndarray
    ) -> np.ndarray:
        """Squared distances (3, n) by what these poses and wheels were of late."""
        limits = self._limits
        short, long = self._variances()
        if short > limits.fine_caution * limits.fine_useful_m**2:
            return np.zeros_like(elapsed_s + changed_mps)
        known = self._weight_m2 / (self._overlap * long)
        along_var, across_var = (
            1.0 / (known + 1.0 / prior**2) for prior in (limits.fine_scale, limits.fine_askew_rad)
        )
        scale = 1.0 + 0.0j
        if self._weight_m2 > 0.0:
            off = self._learned / self._weight_m2 - 1.0
            scale += known * (along_var * off.real + 1j * across_var * off.imag)
        along, across = _split(seen - scale * led, led)
        # part of it is new in every pose, and the rest walks on
        noise = short + (long - short) * elapsed_s / limits.fine_lag_s + limits.fine_m**2
        noise += (limits.fine_timing_s * changed_mps) ** 2
        way_m2 = np.abs(led) ** 2
        across_var += limits.fine_rad**2
        squared = along**2 / (noise + way_m2 * along_var)
        return np.asarray(squared + across**2 / (noise + way_m2 * across_var))

    @property
    def _overlap(self) -> float:
        """How many of the ways that were learned from share each piece of the way."""
        rows = self._rows
        period_s = (rows[-1, _TIME] - rows[0, _TIME]) / (len(rows) - 1)
        return max(1.0, self._limits.fine_lag_s / period_s)

    def _variances(self) -> np.ndarray:
        """(2,) of the poses' errors, per coordinate: over one pose, and over half a second [m^2].

        As they usually are, or worse where most of the last seconds' are worse from one to the
        next: a drift hardly changes that, noise does.
        """
        usual_m2 = np.maximum.accumulate(self._usual_m2)
        seen, led = _ways(self._rows[:-1], self._rows[1:])
        worse = max(1.0, _variance(seen - led) / usual_m2[0])
        return np.asarray(self._limits.fine_caution * worse * usual_m2)


def _ways(then: np.ndarray, now: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """The ways seen and led between rows (..., 9), as complex numbers [m]."""
    step = now - then
    return (
        step[..., _SEEN_X] + 1j * step[..., _SEEN_Y],
        step[..., _LED_X] + 1j * step[..., _LED_Y],
    )


def _velocities(rows: np.ndarray) -> np.ndarray:
    """(n,) by steps, up to each row, as complex numbers [m/s]."""
    _, led = _ways(rows[:-1], rows[1:])
    speeds = led / np.diff(rows[:, _TIME])
    return np.concatenate((speeds[:1], speeds))


def _split(error: np.ndarray, led: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Errors along and across the ways led."""
    way = np.abs(led)
    direction = np.where(way > 1e-6, led / np.maximum(way, 1e-6), 1.0)
    turned = error * np.conj(direction)
    return turned.real, turned.imag


def _variance(errors: np.ndarray) -> float:
    """Of one coordinate of most errors, about their middle; some may be anything."""
    if not len(errors):
        return 0.0
    middle = np.median(errors.real) + 1j * np.median(errors.imag)
    return float(np.median(np.abs(errors - middle) ** 2)) / (2.0 * math.log(2.0))


def _in_a_row(squared: np.ndarray) -> Tuple[float, int]:
    """The worst that all of (3, n) agree on in three columns in a row, and the first of these."""
    if squared.shape[1] < IN_A_ROW:
        return 0.0, -1
    every = squared.min(axis=0)
    least = np.minimum(np.minimum(every[:-2], every[1:-1]), every[2:])
    at = int(np.argmax(least))
    return float(least[at]), at
