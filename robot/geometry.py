"""Plane geometry and the differential drive.

World frame: metres, x east, y north, heading counter-clockwise from x in (-pi, pi].
Robot frame: origin on the floor below the middle of the wheel axle, x forward, y left, z up.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Tuple, Union

import numpy as np

Scalar = Union[float, np.ndarray]
# Standard deviations that 95 % lie within, on a line and on a disc.
LINE_95, DISC_95 = 1.960, 2.448


def wrap_angle(angle_rad: Scalar) -> Scalar:
    """The same angle in (-pi, pi]."""
    wrapped = -((-np.asarray(angle_rad, dtype=float) + math.pi) % (2.0 * math.pi) - math.pi)
    return float(wrapped) if np.ndim(angle_rad) == 0 else wrapped


class Pose(NamedTuple):
    """Where a robot stands in the world frame: [m], [m], [rad]."""

    x_m: float
    y_m: float
    heading_rad: float

    def to_robot(self, points_m: np.ndarray) -> np.ndarray:
        """World points (..., 2) [m] in this robot's frame."""
        delta = np.asarray(points_m, dtype=float) - (self.x_m, self.y_m)
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x, y = delta[..., 0], delta[..., 1]
        return np.stack((c * x + s * y, -s * x + c * y), axis=-1)

    def to_world(self, points_m: np.ndarray) -> np.ndarray:
        """Points (..., 2) [m] of this robot's frame in the world."""
        points = np.asarray(points_m, dtype=float)
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x = self.x_m + c * points[..., 0] - s * points[..., 1]
        return np.stack((x, self.y_m + s * points[..., 0] + c * points[..., 1]), axis=-1)

    def moved(self, forward_m: float, turn_rad: float) -> "Pose":
        """The pose after an arc of length ``forward_m`` that turns by ``turn_rad`` (exact)."""
        half = turn_rad / 2.0
        chord = forward_m * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
        angle = self.heading_rad + half
        heading = float(wrap_angle(self.heading_rad + turn_rad))
        return Pose(self.x_m + chord * math.cos(angle), self.y_m + chord * math.sin(angle), heading)

    def arc_to(self, other: "Pose") -> Tuple[float, float]:
        """What to give ``moved`` to come to a pose on an arc from here: [m], [rad]."""
        forward_m, left_m = self.to_robot(np.array(other[:2]))
        turn_rad = float(wrap_angle(other.heading_rad - self.heading_rad))
        chord_m = math.copysign(math.hypot(forward_m, left_m), forward_m)
        return float(chord_m / np.sinc(turn_rad / (2.0 * math.pi))), turn_rad


class Twist(NamedTuple):
    """Motion of the robot frame: forward speed [m/s] and turn rate, left positive [rad/s]."""

    forward_mps: float
    turn_radps: float


class WheelSpeeds(NamedTuple):
    """Speed of each wheel's rim over the floor [m/s]."""

    left_mps: float
    right_mps: float


STILL = WheelSpeeds(0.0, 0.0)


@dataclass(frozen=True)
class DifferentialDrive:
    """Two driven wheels on one axle (Siegwart and Nourbakhsh, Autonomous Mobile Robots, 3.2)."""

    baseline_m: float = 0.102  # between the wheels' contact points; Duckiebot, axle drawing
    wheel_radius_m: float = 0.0325  # 65 mm wheel

    def wheels(self, twist: Twist) -> WheelSpeeds:
        """The wheel speeds that make this motion."""
        half = 0.5 * self.baseline_m * twist.turn_radps
        return WheelSpeeds(twist.forward_mps - half, twist.forward_mps + half)

    def twist(self, wheels: WheelSpeeds) -> Twist:
        """The motion that these wheel speeds make, without slip."""
        return Twist(
            0.5 * (wheels.left_mps + wheels.right_mps),
            (wheels.right_mps - wheels.left_mps) / self.baseline_m,
        )


def bezier_points(control_points: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Cubic Bezier: control points (4, D), parameters (M,) in [0, 1] -> points (M, D).

    Control points (M, 4, D) are one curve for each parameter, (C, 1, 4, D) give points (C, M, D).
    """
    t = np.asarray(t, dtype=float)[:, None]
    u = 1.0 - t
    p = np.moveaxis(np.asarray(control_points, dtype=float), -2, 0)
    return u**3 * p[0] + 3 * u**2 * t * p[1] + 3 * u * t**2 * p[2] + t**3 * p[3]


def bezier_tangents(control_points: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Derivative of ``bezier_points`` by t, from the same arguments; not of unit length."""
    t = np.asarray(t, dtype=float)[:, None]
    u = 1.0 - t
    d = np.moveaxis(np.diff(np.asarray(control_points, dtype=float), axis=-2), -2, 0)
    return 3 * u**2 * d[0] + 6 * u * t * d[1] + 3 * t**2 * d[2]


def compose(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Poses (N, 3) moved by steps (N, 3) given in each pose's own frame."""
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    x = pose[:, 0] + c * step[:, 0] - s * step[:, 1]
    y = pose[:, 1] + s * step[:, 0] + c * step[:, 1]
    return np.stack((x, y, wrap_angle(pose[:, 2] + step[:, 2])), axis=1)


def between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The steps (N, 3) that lead from poses ``start`` to ``end``: compose(start, step) == end."""
    delta = end[:, :2] - start[:, :2]
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    x = c * delta[:, 0] + s * delta[:, 1]
    y = -s * delta[:, 0] + c * delta[:, 1]
    return np.stack((x, y, wrap_angle(end[:, 2] - start[:, 2])), axis=1)


def uncompose(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The poses (N, 3) from which steps (N, 3) led to ``pose``."""
    heading = wrap_angle(pose[:, 2] - step[:, 2])
    c, s = np.cos(heading), np.sin(heading)
    x = pose[:, 0] - (c * step[:, 0] - s * step[:, 1])
    return np.stack((x, pose[:, 1] - (s * step[:, 0] + c * step[:, 1]), heading), axis=1)


def radius_95(covariance: np.ndarray) -> np.ndarray:
    """(N,) of the circle round the mean that holds 95 % of what has covariances (N, 2, 2).

    Between a line's 1.960 and a disc's 2.448 standard deviations of the longer axis, within 1 %.
    """
    short, long = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0)).T
    round_ = (short / np.maximum(long, 1e-12)) ** 2.5
    return np.asarray(long * (LINE_95 + (DISC_95 - LINE_95) * round_))


def ellipses_95(covariance: np.ndarray) -> np.ndarray:
    """(N, 3) that hold 95 % of covariances (N, 2, 2): half axes, direction of the longer [rad]."""
    squares, axes = np.linalg.eigh(covariance)
    short, long = DISC_95 * np.sqrt(np.maximum(squares, 0.0)).T
    return np.stack((long, short, np.arctan2(axes[:, 1, 1], axes[:, 0, 1])), axis=1)


def carried(covariance: np.ndarray, displaced_m: np.ndarray) -> np.ndarray:
    """Covariance after displacements (N, 2): a heading error swings the position."""
    jacobian = np.zeros_like(covariance)
    jacobian[:, range(covariance.shape[1]), range(covariance.shape[1])] = 1.0
    moved = np.nan_to_num(displaced_m)  # of a robot whose place is unknown
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -moved[:, 1], moved[:, 0]
    return jacobian @ covariance @ jacobian.transpose(0, 2, 1)
