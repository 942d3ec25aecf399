"""How the wheels answer: the project's motor model, fitted to where a robot was.

A drive is cut into pieces. In each the model is driven by the recorded commands, and laid over the
told poses as well as a shift and a turn can. What is then left tells gain, trim, slip, lags and
delay, and where on the robot the eye sits that told the poses.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from robot.contract import DRIVE
from robot.geometry import between, compose, wrap_angle
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import PHYSICS_DT_S, MotorModel

NAMES = ("gain", "trim", "turn_gain", "forward_lag_s", "turn_lag_s", "delay_s")
EYE = ("forward_m", "left_m", "yaw_rad")  # beside where it is believed to sit
# Beyond what `looks/randomised.yaml` knows; also the weak beliefs that a fit begins with.
USUAL = np.array((1.0, 0.0, 1.0, 0.1, 0.1, 0.08, 0.0, 0.0, 0.0))
SPREAD = np.array((0.15, 0.06, 0.2, 0.15, 0.15, 0.15, 0.03, 0.03, 0.2))
LOW = np.array((0.6, -0.2, 0.5, PHYSICS_DT_S, PHYSICS_DT_S, 0.0, -0.1, -0.1, -0.5))  # lags: a step
HIGH = np.array((1.5, 0.2, 1.6, 0.5, 0.5, 0.6, 0.1, 0.1, 0.5))
EVERY = 6  # steps
STEERS_RAD, LATE_S = 0.2, 0.2  # a second's steering, and how soon it is followed
ROUNDS = (4, 4, 12)  # steps, after each of which poses count for as sure as they proved
SUREST = 0.03  # times as sure as a source says, at most
TRUSTED_S, SHORTEST_S = 8.0, 2.0  # for which wheels are, between poses of an arena, and sure ones
_SMALL = np.array((1e-3, 1e-3, 1e-3, 4e-3, 4e-3, 4e-3, 1e-3, 1e-3, 1e-3))  # for derivatives


class Told(NamedTuple):
    """A drive's commands, and poses that something told of it."""

    commands: np.ndarray  # (K, 2) rim speeds [m/s], one for each `PHYSICS_DT_S`; NaN: cut out
    times_s: np.ndarray  # (M,) ascending
    poses: np.ndarray  # (M, 3)
    roots: np.ndarray  # (M, 3, 3) of their information matrices
    piece_s: float  # for which wheels are trusted


def from_above(commands: np.ndarray, told: np.ndarray) -> Told:
    """With poses (M, 4), times first, of an overhead camera or a filter."""
    root = np.diag(1.0 / np.array((0.03, 0.03, 0.09)))  # of an arena, see `sim_pybullet.look`
    order = np.argsort(told[:, 0])
    roots = np.broadcast_to(root, (len(told), 3, 3))
    return Told(commands, told[order, 0], told[order, 1:], roots, TRUSTED_S)


def surer(drive: Told, scale: float) -> Told:
    """With poses that err by so many times what was said; wheels are trusted for less long."""
    piece_s = max(drive.piece_s * min(scale, 1.0) ** 0.5, SHORTEST_S)
    return drive._replace(roots=drive.roots / scale, piece_s=piece_s)


class Motion(NamedTuple):
    """What was found: values and standard deviations (9,), of ``NAMES`` and ``EYE``."""

    values: np.ndarray
    sd: np.ndarray
    scale: float = 1.0  # times what the source says its poses err by


UNKNOWN = Motion(USUAL, SPREAD)


def cut_out(commands: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """How many steps before each moment were cut out, and nobody knows what was commanded."""
    cut, now = np.cumsum(np.isnan(commands[:, 0])), (times_s / PHYSICS_DT_S).astype(int)
    return cut[np.clip(now, 0, len(cut) - 1)]


def obeyed(drive: Told) -> float:
    """Correlation of how the robot turned within a second with how it was told to; 1 if never."""
    rates = np.nan_to_num(drive.commands[:, 1] - drive.commands[:, 0]) / DRIVE.baseline_m
    grid_s = np.arange(len(rates)) * PHYSICS_DT_S
    at_s = np.arange(0.0, grid_s[-1] - 1.5, 0.5) + np.array([[0.0], [1.0]])
    at_s = at_s[:, cut_out(drive.commands, at_s[0]) == cut_out(drive.commands, at_s[1] + LATE_S)]
    asked = np.diff(np.interp(at_s, grid_s, np.cumsum(rates) * PHYSICS_DT_S), axis=0)[0]
    turned = np.interp(at_s + LATE_S, drive.times_s, np.unwrap(drive.poses[:, 2]))
    steered = len(asked) > 0 and asked.std() > STEERS_RAD
    return float(np.corrcoef(asked, np.diff(turned, axis=0)[0])[0, 1]) if steered else 1.0


def reckoned(commands: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(P, K + 1, 3) where the model gets from (0, 0, 0) under commands (K, 2), for P guesses."""
    model = MotorModel(len(values))
    for i, row in enumerate(values.tolist()):
        known = dict(zip(NAMES, row, strict=False), delay_s=0.0)  # late is what told the poses
        model.reset(i, replace(DriveLook(), noise=0.0, **known))
    rng = np.random.default_rng(0)  # of noise, and there is none
    twists = np.zeros((len(values), len(commands), 2))
    later = np.where(np.isnan(commands[:, 0]), len(commands) - 1, np.arange(len(commands)))
    later = np.minimum.accumulate(later[::-1])[::-1]  # what was cut out ended as it went on
    for k, wheels in enumerate(commands[later]):
        twists[:, k] = model.step(np.tile(wheels, (len(values), 1)), rng)
    zero = np.zeros((len(twists), 1, 3))
    step, turn = np.moveaxis(twists * PHYSICS_DT_S, -1, 0)
    middle = np.cumsum(turn, axis=1) - 0.5 * turn
    moves = np.stack((step * np.cos(middle), step * np.sin(middle), turn), axis=-1)
    return np.concatenate((zero, np.cumsum(moves, axis=1)), axis=1)


def at_times(track: np.ndarray, times_s: np.ndarray, late_s: float = 0.0) -> np.ndarray:
    """(T, 3) of a reckoned track (K + 1, 3); headings are not wrapped."""
    grid_s = np.arange(len(track)) * PHYSICS_DT_S
    return np.stack([np.interp(times_s - late_s, grid_s, part) for part in track.T], axis=1)


def laid(ours: np.ndarray, told: np.ndarray, roots: np.ndarray) -> np.ndarray:
    """Poses ours (T, 3), turned and shifted as one to lie over those told (T, 3).

    ``roots`` (T, 3, 3): how sure each is, of whose information matrix it is the square root.
    """
    turn = np.angle(np.exp(1j * (told[:, 2] - ours[:, 2])).sum())
    for _ in range(3):
        c, s = np.cos(turn), np.sin(turn)
        turned = (ours[:, :2] - ours[:, :2].mean(axis=0)) @ np.array(((c, s), (-s, c)))
        moves = np.zeros((len(ours), 3, 3))
        moves[:, (0, 1, 2), (0, 1, 2)] = 1.0
        moves[:, 0, 2], moves[:, 1, 2] = -turned[:, 1], turned[:, 0]
        off = told - np.column_stack((turned, ours[:, 2] + turn))
        off[:, 2] = wrap_angle(off[:, 2])
        slope, aim = (roots @ moves).reshape(-1, 3), (roots @ off[..., None]).ravel()
        shift = np.linalg.solve(slope.T @ slope + 1e-9 * np.eye(3), slope.T @ aim)
        turn += shift[2]
    return np.column_stack((turned + shift[:2], ours[:, 2] + turn))


def pieces(times_s: np.ndarray, piece_s: float, cut: np.ndarray | float = 0.0) -> list[np.ndarray]:
    """Indices of the poses of each piece: none spans a ``cut``, those with few are left out."""
    number = (times_s / piece_s).astype(int) + 1e6 * cut
    found = [np.flatnonzero(number == n) for n in np.unique(number)]
    return [part for part in found if len(part) >= 8]


def fit_motion(drives: Sequence[Told], eye: bool, belief: Motion = UNKNOWN) -> Motion:
    """The motors after drives; ``eye``: whether it is the robot's own that told the poses.

    Some poses are far off: errors count as those of Cauchy's distribution do.
    """
    free = np.arange(len(USUAL)) if eye else np.arange(len(NAMES))
    values, scale = belief.values, 1.0

    def rows(guesses: np.ndarray) -> np.ndarray:
        left = _left_over(drives, guesses) / scale
        return np.concatenate((left, (guesses - belief.values) / belief.sd), axis=1)

    def slopes(values: np.ndarray) -> np.ndarray:
        each = rows(np.concatenate((values[None], values + np.diag(_SMALL)[free])))
        jacobian = np.zeros((each.shape[1], len(values)))
        jacobian[:, free] = ((each[1:] - each[0]) / _SMALL[free, None]).T
        return jacobian

    for tries in ROUNDS:
        how = {"loss": "cauchy", "x_scale": SPREAD, "max_nfev": tries}
        within = LOW - 1e-9, HIGH
        found = least_squares(lambda at: rows(at[None])[0], values, slopes, bounds=within, **how)
        left, counted = np.abs(found.fun[: -len(USUAL)]), scale
        values = found.x
        scale = max(scale * float(np.median(left)) / 0.6745, SUREST) if len(left) else 1.0
    jacobian = found.jac[:, free]
    sd = belief.sd.copy()
    sd[free] = max(1.0, scale / counted) * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return Motion(values, np.minimum(sd, belief.sd), scale)


def _left_over(drives: Sequence[Told], values: np.ndarray) -> np.ndarray:
    """(P, R) residuals of P guesses (P, 9), in standard deviations."""
    each = [np.zeros((len(values), 0))]
    for drive in drives:
        rows, cut = [], cut_out(drive.commands, drive.times_s)
        for track, guess in zip(reckoned(drive.commands, values), values, strict=True):
            ours = compose(at_times(track, drive.times_s, guess[5]), guess[None, len(NAMES) :])
            off = []
            for part in pieces(drive.times_s, drive.piece_s, cut):
                told, roots = drive.poses[part], drive.roots[part]
                missed = told - laid(ours[part], told, roots)
                missed[:, 2] = wrap_angle(missed[:, 2])
                off.append((roots @ missed[..., None]).ravel())
            rows.append(np.concatenate([np.zeros(0), *off]))
        each.append(np.array(rows))
    return np.concatenate(each, axis=1)


def smoothed(drive: Told, motion: Motion) -> np.ndarray:
    """(K + 1, 3) where the robot was at each `PHYSICS_DT_S`: its wheels' way, laid over the poses.

    At every sixth step the way is laid over the poses of the time around it; between two of these
    it leads from the one to the other. Nothing is late any more.
    """
    track = reckoned(drive.commands, motion.values[None])[0]
    late_s, times_s = motion.values[NAMES.index("delay_s")], drive.times_s
    ours = at_times(track, times_s, late_s)
    grid_s = np.arange(0, len(track) + EVERY, EVERY) * PHYSICS_DT_S
    here = at_times(track, grid_s, late_s)
    poses = np.zeros((len(grid_s), 3))
    cut, cut_here = cut_out(drive.commands, times_s), cut_out(drive.commands, grid_s)
    for k, now_s in enumerate(grid_s):
        away_s = np.abs(times_s - now_s) + np.abs(cut - cut_here[k])
        near = np.argsort(away_s)[: round(drive.piece_s * 10)]
        weights = np.exp(-0.5 * (away_s[near] / (drive.piece_s / 4)) ** 2) + 1e-6
        roots = np.concatenate((drive.roots[near] * weights[:, None, None], np.zeros((1, 3, 3))))
        both = np.concatenate((ours[near], here[k : k + 1]))
        poses[k] = laid(both, np.concatenate((drive.poses[near], here[k : k + 1])), roots)[-1]
    steps = np.arange(len(track))
    number, way = steps // EVERY, at_times(track, steps * PHYSICS_DT_S, late_s)
    one, other = (compose(poses[j], between(here[j], way)) for j in (number, number + 1))
    one[:, 2] = np.unwrap(one[:, 2])
    off = other - one
    off[:, 2] = wrap_angle(off[:, 2])
    return one + (steps % EVERY / EVERY)[:, None] * off
