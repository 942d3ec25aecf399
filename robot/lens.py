"""Lenses and camera mountings: from a pixel to a ray in the robot's frame and back.

Camera frame as in OpenCV: x right, y down, z forward. Robot frame: x forward, y left, z up.
Pixel (0, 0) is the centre of the top-left pixel.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Tuple, Union

import numpy as np

from robot.errors import ConfigError, expect_between, expect_one_of

MODELS = ("pinhole", "plumb_bob", "fisheye")


@dataclass(frozen=True)
class Lens:
    """Intrinsics as OpenCV has them: K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] and distortion D.

    ``plumb_bob`` is OpenCV's k1, k2, p1, p2, k3 model, ``fisheye`` its equidistant k1..k4 model
    (Kannala and Brandt 2006), ``pinhole`` has no D.
    """

    model: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: Tuple[float, ...] = ()

    def __post_init__(self) -> None:
        expect_one_of("lens model", self.model, MODELS)
        valid = {"pinhole": (0,), "plumb_bob": (4, 5), "fisheye": (4,)}[self.model]
        got = len(self.distortion)
        if got not in valid:
            raise ConfigError(f"{self.model} lens: expected {valid} coefficients, got {got}")
        if min(self.width_px, self.height_px, self.fx_px, self.fy_px) <= 0:
            raise ConfigError(f"lens: expected sizes and focal lengths above 0, got {self}")

    @property
    def matrix(self) -> np.ndarray:
        """K, (3, 3)."""
        rows = [self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]
        return np.array(rows)

    def scaled(self, width_px: int, height_px: int) -> "Lens":
        """The same lens read out at another picture size (pixel areas, not centres, scale)."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        return replace(
            self,
            width_px=width_px,
            height_px=height_px,
            fx_px=self.fx_px * sx,
            fy_px=self.fy_px * sy,
            cx_px=(self.cx_px + 0.5) * sx - 0.5,
            cy_px=(self.cy_px + 0.5) * sy - 0.5,
        )

    def of_picture(self, width_px: int, height_px: int) -> "Lens":
        """As `scaled`, of what is not stretched; ConfigError: a picture of another shape."""
        if self.width_px * height_px != self.height_px * width_px:
            told = f"expected a picture of the lens' shape, {self.width_px}x{self.height_px}"
            raise ConfigError(f"{told}, got {width_px}x{height_px}")
        return self.scaled(width_px, height_px)

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) as (u, v) -> unit rays (..., 3) in the camera frame."""
        import cv2

        pixels = np.asarray(pixels, dtype=np.float64)
        if self.model == "fisheye":
            return self._unproject_fisheye(pixels)
        flat = pixels.reshape(-1, 1, 2)
        if self.model == "plumb_bob":
            d, eye = np.array(self.distortion), np.eye(3)
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
            plane = cv2.undistortPointsIter(flat, self.matrix, d, eye, eye, criteria)
        else:
            plane = (flat - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        plane = plane.reshape((*pixels.shape[:-1], 2))
        rays = np.concatenate((plane, np.ones((*plane.shape[:-1], 1))), axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def _unproject_fisheye(self, pixels: np.ndarray) -> np.ndarray:
        # cv2.fisheye.undistortPoints stops at 90 degrees from the axis; a lens does not.
        plane = (pixels - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        radius = np.linalg.norm(plane, axis=-1)
        k = self.distortion
        theta = radius.copy()
        for _ in range(20):  # Newton on theta_d(theta) = radius
            t2 = theta * theta
            value = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
            slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
            theta = np.clip(theta - (value - radius) / slope, 0.0, math.pi)
        scale = np.sin(theta) / np.where(radius > 1e-12, radius, 1.0)
        return np.stack((plane[..., 0] * scale, plane[..., 1] * scale, np.cos(theta)), axis=-1)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the camera frame -> pixels (..., 2).

        NaN behind a non-fisheye lens, and where its distortion polynomial folds back on itself.
        """
        points = np.asarray(points, dtype=np.float64)
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        if self.model == "fisheye":
            radius = np.hypot(x, y)
            theta = np.arctan2(radius, z)
            k1, k2, k3, k4 = self.distortion
            t2 = theta * theta
            theta_d = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
            scale = theta_d / np.where(radius > 1e-12, radius, 1.0)
            plane = np.stack((x * scale, y * scale), axis=-1)
        else:
            depth = np.where(z > 1e-9, z, np.nan)
            x, y = x / depth, y / depth
            k1, k2, p1, p2, k3 = (*self.distortion, *([0.0] * 5))[:5]
            r2 = x * x + y * y
            r2 = np.where(r2 <= _fold_radius(self.distortion) ** 2, r2, np.nan)
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
            plane = np.stack((x * radial + dx, y * radial + dy), axis=-1)
        return plane * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)


@lru_cache(maxsize=None)
def _fold_radius(distortion: Tuple[float, ...]) -> float:
    """Undistorted radius from which on a plumb-bob lens maps outer points inwards again."""
    k1, k2, _, _, k3 = (*distortion, *([0.0] * 5))[:5]
    r = np.linspace(0.0, 10.0, 2001)
    r2 = r * r
    falls = np.flatnonzero(np.diff(r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))) <= 0.0)
    return float(r[falls[0]]) if len(falls) else math.inf


@dataclass(frozen=True)
class Mount:
    """Where the camera sits on the robot, and which way it looks."""

    height_m: float = 0.108
    forward_m: float = 0.066  # ahead of the wheel axle
    left_m: float = 0.0
    pitch_rad: float = math.radians(19.15)  # downward
    yaw_rad: float = 0.0  # leftward
    roll_rad: float = 0.0  # clockwise as the camera sees it: its right side dips

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            most = {"m": 1.0, "rad": 3.2}.get(name.split("_")[-1], math.inf)  # also of looks
            expect_between(f"camera {name}", value, 0.01 if name == "height_m" else -most, most)

    @property
    def position_m(self) -> np.ndarray:
        """(3,) in the robot frame."""
        return np.array([self.forward_m, self.left_m, self.height_m])

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): turns a direction of the camera frame into the robot frame."""
        level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        return yaw @ pitch @ roll @ level


@dataclass(frozen=True)
class Hanging:
    """Where a camera hangs that looks down on a floor; the frame is the floor's, z up."""

    position_m: Tuple[float, float, float] = (1.1, 1.32, 2.5)
    yaw_rad: float = math.pi / 2.0  # of picture-right from x, counter-clockwise
    tilt_rad: Tuple[float, float] = (0.0, 0.0)  # about picture-right and picture-down

    @classmethod
    def of(cls, position_m: np.ndarray, rotation: np.ndarray) -> "Hanging":
        """From a place (3,) [m], and a rotation (3, 3) of the camera's directions into the frame's.

        As the tilt has no part about the optical axis, the yaw is the twist about that.
        """
        x_m, y_m, height_m = map(float, position_m)
        seen = np.diag((1.0, -1.0, -1.0)) @ rotation
        # Of a unit quaternion 4ww, 4wz and 4zz: at half a turn w is none, and only 4zz is exact.
        ww, wz = 1.0 + np.trace(seen), seen[1, 0] - seen[0, 1]
        zz = 1.0 - seen[0, 0] - seen[1, 1] + seen[2, 2]
        yaw_rad = -2.0 * (math.atan2(wz, ww) if ww > zz else math.atan2(zz, wz))
        level = cls((x_m, y_m, height_m), yaw_rad)
        turn = level.rotation.T @ rotation  # cv2.Rodrigues would call less than 1e-5 rad level
        right, down = (turn[2, 1] - turn[1, 2]) / 2.0, (turn[0, 2] - turn[2, 0]) / 2.0
        sine = math.hypot(right, down)
        scale = math.atan2(sine, (np.trace(turn) - 1.0) / 2.0) / sine if sine else 1.0
        return replace(level, tilt_rad=(float(right * scale), float(down * scale)))

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): turns a direction of the camera frame into the floor's."""
        import cv2

        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        straight = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
        return np.asarray(straight @ cv2.Rodrigues(np.array([*self.tilt_rad, 0.0]))[0])


@dataclass(frozen=True)
class CameraRig:
    """A lens on a mounting, or hanging over a floor: the frame is the robot's, or the floor's."""

    lens: Lens
    mount: Union[Mount, Hanging] = Mount()

    def rays(self) -> np.ndarray:
        """Unit directions (H, W, 3) in the frame, one per pixel."""
        v, u = np.mgrid[0 : self.lens.height_px, 0 : self.lens.width_px]
        return self.lens.unproject(np.stack((u, v), axis=-1)) @ self.mount.rotation.T

    def to_pixels(self, points_m: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the frame [m] -> pixels (..., 2)."""
        relative = np.asarray(points_m, dtype=float) - self.mount.position_m
        return self.lens.project(relative @ self.mount.rotation)

    def to_floor(self, pixels: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Pixels (..., 2) -> points (..., 2) so high above the floor [m]; NaN above the horizon."""
        directions = self.lens.unproject(pixels) @ self.mount.rotation.T
        down = np.where(directions[..., 2] < -1e-6, directions[..., 2], np.nan)
        x_m, y_m, above_m = self.mount.position_m
        return np.array((x_m, y_m)) + directions[..., :2] * ((height_m - above_m) / down)[..., None]


# The lens of the Duckietown simulator and robots: 111 x 84 degrees (a calibration of a real robot).
_AXES_PX = (305.5718893575089, 308.8338858195428, 303.0797142544728, 231.8845403702499)
_BENT = (-0.2, 0.0305, 0.0005859930422629722, -0.0006697840226199427, 0.0)
DUCKIEBOT_LENS = Lens("plumb_bob", 640, 480, *_AXES_PX, _BENT)
