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

import math
from collections import deque
from typing import Deque, List, NamedTuple, Tuple

import numpy as np

from robot.geometry import Pose, wrap_angle

STEPS_S = 3.0  # older pictures are not compared
USUAL_OF = 50  # ways that tell how far poses usually err
IN_A_ROW = 3  # poses that must contradict as many others

# The worst, as standard deviations: of the arena's poses, and of the widest look's wheels.
POSITION_M, HEADING_RAD = 0.03, math.radians(5.0)
CORRELATION_S = 2.0  # over which these errors drift
WHITE_M, WHITE_RAD = 0.005, math.radians(1.0)  # new in every pose
FORWARD_SCALE, TURN_SCALE, DRIFT_RAD_PER_M = 0.06, 0.11, 0.4
TIMING_M = 0.009  # 30 ms at full speed
MEMORY_S = 1.6
CONTRADICTION = 28.0  # squared distance in standard deviations, of three numbers

# The fine measure, against errors as they were.
FINE_MEMORY_S = 2.4
FINE_CONTRADICTION = 16.0
FINE_USEFUL_M = 0.0035  # poses that err by more, from one to the next, hide a drift
FINE_CAUTION = 1.2  # times the variance that was seen
FINE_WHITE_M = 0.0015  # no poses are held to be better, from one to the next
FINE_M, FINE_RAD = 0.005, math.radians(0.7)  # nor over any way, nor their usual headings
FINE_STRETCH = 0.012  # of the localizer's picture here and there
FINE_SCALE = 0.034  # of wheels not yet known: with the picture's, 14 % just pass
FINE_ASKEW_RAD = 0.02  # of a board not yet known: 5 degrees just pass
FINE_TIMING_S = 0.06  # by which wheels answer, and pictures are dated, late
FINE_ASIDE_M = 0.005  # by which the board is not above the axle's middle: a centimetre passes
FINE_LAG_S = 0.5
_LAG_S = FINE_LAG_S - 1e-3  # a way of half a second, whatever rounding does

_TIME, _SEEN_X, _SEEN_Y, _SEEN_RAD, _X, _Y, _RAD, _LED_X, _LED_Y = range(9)  # of a row
_MEDIAN = 2.0 * math.log(2.0)  # of the square of a distance in the plane, in variances


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

    def __init__(self) -> None:
        # variances of the poses' errors as they were, over one pose and over half a second
        self._usual_m2 = np.full(2, POSITION_M**2)
        self._usual_of = 0  # how many ways
        self._steps: Deque[Tuple[float, float, float, float]] = deque()  # time, pose by steps
        self._rows = np.zeros((0, 9))
        self.reset()

    def reset(self) -> None:
        """A mission begins: forget the way and the wheels; not how good the poses usually are."""
        self.doubt = WayDoubt()
        self._forget(math.inf)
        self._learned, self._weight_m2 = 0.0j, 0.0  # sums of conj(led) * seen, led^2: of old ways
        self._began = False  # whether the wheels stepped in this mission

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
        row = np.array([captured_s, *seen, *self._stepped_to(captured_s), 0.0, 0.0])
        if len(self._rows):
            last = self._rows[-1]  # steps led on from there, in the headings that were seen
            if not self._began and (last[_X:_LED_X] != row[_X:_LED_X]).any():
                self._began, self._rows = True, self._rows[-1:]  # coils that come on swing wheels
            first, second = last[_SEEN_RAD] - last[_RAD], row[_SEEN_RAD] - row[_RAD]
            heading_rad = first + 0.5 * wrap_angle(second - first)
            turned = Pose(last[_LED_X], last[_LED_Y], heading_rad)
            row[_LED_X:] = turned.to_world(row[_X:_RAD] - last[_X:_RAD])
        self._rows = np.vstack((self._rows, row))
        self._forget(captured_s)
        if self._began and len(self._rows) >= 2 * IN_A_ROW:
            self.doubt = self._judge()
        return self.doubt

    def _stepped_to(self, when_s: float) -> List[float]:
        times_s, x_m, y_m, heading_rad = np.array(self._steps).T
        tracks = (x_m, y_m, np.unwrap(heading_rad))
        return [float(np.interp(when_s, times_s, track)) for track in tracks]

    def _forget(self, now_s: float) -> None:
        """Drop ways that grew old, and learn of them how these wheels drive, and poses err."""
        rows = self._rows
        known = rows[rows[:, _TIME] < now_s - FINE_MEMORY_S]
        first = 0
        for first, begins in enumerate(rows):
            later = int(np.searchsorted(known[:, _TIME], begins[_TIME] + _LAG_S))
            if later >= len(known):
                break
            seen, led = (complex(way) for way in _ways(begins, rows[later]))
            spread_m2 = 2.0 * self._usual_m2[1] + (FORWARD_SCALE * abs(led)) ** 2
            likely = abs(seen - led) ** 2 < 9.0 * spread_m2  # outliers tell nothing of the wheels
            if likely and _steady(rows[first : later + 1]):
                self._learned += led.conjugate() * seen
                self._weight_m2 += abs(led) ** 2
            scale, _, _ = self._wheels(self._usual_m2[1])
            self._learn_errors(seen - scale * led, rows[first : first + 2])
        self._rows = rows[first:]

    def _learn_errors(self, long: complex, next_rows: np.ndarray) -> None:
        """How far poses are from where steps lead: over half a second, and from one to the next.
        A running median, which a robot that is carried or poses that drift hardly move."""
        if self.doubt.doubtful:
            return
        seen, led = _ways(next_rows[0], next_rows[1])
        errors_m2 = np.abs(np.array([seen - led, long])) ** 2 / _MEDIAN
        self._usual_of += 1
        if self._usual_of == 1:
            self._usual_m2 = np.maximum(errors_m2, FINE_WHITE_M**2)
        rate = max(1.0 / self._usual_of, 2.0 / USUAL_OF)
        self._usual_m2 *= np.where(errors_m2 > self._usual_m2, 1.0 + rate, 1.0 / (1.0 + rate))
        self._usual_m2 = np.maximum(self._usual_m2, FINE_WHITE_M**2)

    def _judge(self) -> WayDoubt:
        rows = self._rows[self._rows[:, _TIME] >= self._rows[-1, _TIME] - FINE_MEMORY_S]
        if len(rows) < 2 * IN_A_ROW:
            return WayDoubt()
        now, then = rows[-IN_A_ROW:], rows[:-IN_A_ROW]
        near = then[then[:, _TIME] >= rows[-1, _TIME] - MEMORY_S]
        worst, first = _in_a_row(_coarse(now, near))
        seen, led = np.abs(_ways(near[first], rows[-1]) if first >= 0 else (0.0, 0.0))
        stands = bool(seen < 0.5 * led)
        ahead = np.exp(1j * rows[:, _SEEN_RAD])  # a robot that stands has a heading, too
        speed = np.abs(_velocities(rows))
        changed = _between(np.cumsum(np.diff(speed, prepend=speed[0]) * ahead))
        late_m, aside_m = FINE_TIMING_S * changed, FINE_ASIDE_M * _between(ahead)
        fine, _ = _in_a_row(self._fine(now, then, late_m**2 + aside_m**2))
        return WayDoubt(worst / CONTRADICTION, fine / FINE_CONTRADICTION, stands)

    def _fine(self, now: np.ndarray, then: np.ndarray, noise_m2: np.ndarray) -> np.ndarray:
        """Squared distances (3, n) by what these poses and wheels were of late."""
        short, long = self._variances()
        if short > FINE_CAUTION * FINE_USEFUL_M**2:
            return np.zeros_like(noise_m2)
        seen, led = _ways(then[None], now[:, None])
        scale, along_var, across_var = self._wheels(long)
        along, across = _split(seen - scale * led, led)
        # part of it is new in every pose, and the rest walks on
        elapsed_s = now[:, None, _TIME] - then[None, :, _TIME]
        noise = noise_m2 + short + (long - short) * elapsed_s / FINE_LAG_S + FINE_M**2
        way_m2 = np.abs(led) ** 2
        along_var, across_var = along_var + FINE_STRETCH**2, across_var + FINE_RAD**2
        squared = along**2 / (noise + way_m2 * along_var)
        return np.asarray(squared + across**2 / (noise + way_m2 * across_var))

    def _wheels(self, long_m2: float) -> Tuple[complex, float, float]:
        """How these wheels drive, as far as is known; variances of that along and across the
        way. ``long_m2`` is the variance of the ways that it was learned from."""
        if self._weight_m2 == 0.0:
            return 1.0 + 0.0j, FINE_SCALE**2, FINE_ASKEW_RAD**2
        period_s = (self._rows[-1, _TIME] - self._rows[0, _TIME]) / (len(self._rows) - 1)
        # so many of the ways that were learned from share each piece of the way
        known = self._weight_m2 / (max(1.0, FINE_LAG_S / period_s) * long_m2)
        along, across = (1.0 / (known + 1.0 / prior**2) for prior in (FINE_SCALE, FINE_ASKEW_RAD))
        off = self._learned / self._weight_m2 - 1.0
        return 1.0 + known * (along * off.real + 1j * across * off.imag), along, across

    def _variances(self) -> np.ndarray:
        """(2,) of the poses' errors, per coordinate: over one pose, and over half a second
        [m^2]. As they usually are, or worse where most of the last seconds' are worse from one
        to the next: a drift hardly changes that, noise does."""
        usual_m2 = np.maximum.accumulate(self._usual_m2)
        seen, led = _ways(self._rows[:-1], self._rows[1:])
        errors = seen - led
        middle = np.median(errors.real) + 1j * np.median(errors.imag)  # some may be anything
        variance_m2 = float(np.median(np.abs(errors - middle) ** 2)) / _MEDIAN
        return np.asarray(FINE_CAUTION * max(1.0, variance_m2 / usual_m2[0]) * usual_m2)


def _ways(then: np.ndarray, now: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """The ways seen and led between rows (..., 9), as complex numbers [m]."""
    step = now - then
    seen = step[..., _SEEN_X] + 1j * step[..., _SEEN_Y]
    return seen, step[..., _LED_X] + 1j * step[..., _LED_Y]


def _velocities(rows: np.ndarray) -> np.ndarray:
    """(n,) by steps, up to each row, as complex numbers [m/s]."""
    _, led = _ways(rows[:-1], rows[1:])
    speeds = led / np.diff(rows[:, _TIME])
    return np.concatenate((speeds[:1], speeds))


def _between(values: np.ndarray) -> np.ndarray:
    """(3, n) distances of the last three from those before."""
    return np.asarray(np.abs(values[-IN_A_ROW:, None] - values[None, :-IN_A_ROW]))


def _steady(rows: np.ndarray) -> bool:
    """Whether a way was driven at one speed: setting off, a robot lags behind its steps."""
    if len(rows) < IN_A_ROW:
        return False
    speeds = np.abs(_velocities(rows[[0, len(rows) // 2, -1]])[1:])
    return bool(abs(speeds[0] - speeds[1]) < 0.1 * speeds.max())


def _coarse(now: np.ndarray, then: np.ndarray) -> np.ndarray:
    """Squared distances (3, n) of rows by the worst that poses and wheels may be."""
    seen, led = _ways(then[None], now[:, None])
    keep = np.exp(-(now[:, None, _TIME] - then[None, :, _TIME]) / CORRELATION_S)
    along, across = _split(seen - led, led)
    way_m = np.abs(led)
    both = 2.0 * POSITION_M**2 * (1.0 - keep) + 2.0 * WHITE_M**2
    along_var = both + (FORWARD_SCALE * way_m) ** 2 + TIMING_M**2
    heading_var = HEADING_RAD**2 * 0.5 * (1.0 + keep) + 0.5 * WHITE_RAD**2
    stepped_rad = wrap_angle(now[:, None, _RAD] - then[None, :, _RAD])
    seen_rad = wrap_angle(now[:, None, _SEEN_RAD] - then[None, :, _SEEN_RAD])
    turned_var = 2.0 * HEADING_RAD**2 * (1.0 - keep) + 2.0 * WHITE_RAD**2
    turned_var += (TURN_SCALE * stepped_rad) ** 2 + (DRIFT_RAD_PER_M * way_m) ** 2
    squared = along**2 / along_var + across**2 / (both + way_m**2 * heading_var)
    return np.asarray(squared + wrap_angle(seen_rad - stepped_rad) ** 2 / turned_var)


def _split(error: np.ndarray, led: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Errors along and across the ways led."""
    way = np.abs(led)
    direction = np.where(way > 1e-6, led / np.maximum(way, 1e-6), 1.0)
    turned = error * np.conj(direction)
    return turned.real, turned.imag


def _in_a_row(squared: np.ndarray) -> Tuple[float, int]:
    """The worst that all of (3, n) agree on in three columns in a row, and the first of these."""
    if squared.shape[1] < IN_A_ROW:
        return 0.0, -1
    every = squared.min(axis=0)
    least = np.minimum(np.minimum(every[:-2], every[1:-1]), every[2:])
    at = int(np.argmax(least))
    return float(least[at]), at
