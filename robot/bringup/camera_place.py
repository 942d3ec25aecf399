"""Where a camera hangs, and optionally its lens, from pixels of known floor points.

A rigid camera over a flat floor: least squares of the reprojection error in pixels by
Levenberg-Marquardt (Hartley and Zisserman, Multiple View Geometry, 2nd ed., A6.2).
"""

import math
from dataclasses import dataclass, replace
from typing import Callable, List, Optional, Tuple

import numpy as np

from robot.errors import ConfigError
from robot.lens import Lens


@dataclass(frozen=True)
class CameraFit:
    """A lens, where it hangs in the world, and how sure that is."""

    lens: Lens
    rotation: np.ndarray  # (3, 3): world directions into the camera frame
    position_m: np.ndarray  # (3,)
    height_sigma_m: float  # standard deviation when points are 1 px uncertain; 0 when given


@dataclass(frozen=True)
class Freedom:
    """What the fit may change besides the camera's place."""

    focal: bool = False
    distortion: int = 0  # how many coefficients, from the first
    height_m: Optional[float] = None  # measured height of the camera; None estimates it

    @property
    def unknowns(self) -> int:
        """How many numbers the fit finds."""
        return 6 + self.focal + self.distortion - (self.height_m is not None)


def fit_camera(pixels: np.ndarray, floor_m: np.ndarray, lens: Lens, freedom: Freedom) -> CameraFit:
    """Fit to pixels (N, 2) of floor points (N, 2) [m], starting from ``lens``.

    ConfigError: the points are mirrored, or too few, or too alike, to fix what is free.
    """
    unknowns = freedom.unknowns
    if 2 * len(pixels) < unknowns:
        told = f"camera: {len(pixels)} points give {2 * len(pixels)} equations for {unknowns} "
        raise ConfigError(f"{told}unknowns; add points, or give the lens or the camera's height")
    start_lens, rotation, position = _start(pixels, floor_m, lens, freedom)
    world = np.column_stack((floor_m, np.zeros(len(floor_m))))

    def camera(p: np.ndarray) -> Tuple[Lens, np.ndarray, np.ndarray]:
        import cv2

        turn = cv2.Rodrigues(np.ascontiguousarray(p[:3]))[0] @ rotation
        place = position.copy()
        used = 5 if freedom.height_m is not None else 6
        place[: used - 3] += p[3:used]
        scale = math.exp(float(np.clip(p[used], -3.0, 3.0))) if freedom.focal else 1.0
        k = np.array(start_lens.distortion, dtype=float)
        k[: freedom.distortion] += p[used + freedom.focal :]
        fx, fy = float(start_lens.fx_px * scale), float(start_lens.fy_px * scale)
        return replace(start_lens, fx_px=fx, fy_px=fy, distortion=tuple(k.tolist())), turn, place

    def residual(p: np.ndarray) -> np.ndarray:
        a_lens, turn, place = camera(p)
        return (a_lens.project((world - place) @ turn.T) - pixels).ravel()

    best, jacobian = _least_squares(residual, np.zeros(unknowns))
    sigma_m = 0.0
    if freedom.height_m is None:
        values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
        sigma_m = float(np.sqrt((vectors[5] ** 2 / np.maximum(values, 1e-12)).sum()))
    return CameraFit(*camera(best), sigma_m)


def _start(
    pixels: np.ndarray, floor_m: np.ndarray, lens: Lens, freedom: Freedom
) -> Tuple[Lens, np.ndarray, np.ndarray]:
    scales = np.geomspace(0.2, 5.0, 41).tolist() if freedom.focal else [1.0]
    world = np.column_stack((floor_m, np.zeros(len(floor_m))))
    starts: List[Tuple[float, Lens, np.ndarray, np.ndarray]] = []
    mirrored = False
    for scale in scales:
        trial = replace(lens, fx_px=lens.fx_px * scale, fy_px=lens.fy_px * scale)
        pose = _pose_from_homography(pixels, floor_m, trial)
        if pose is None:
            continue
        rotation, position = pose
        if position[2] < 0.0:
            mirrored = True
            continue
        if freedom.height_m is not None:
            position = np.array([*position[:2], freedom.height_m])
        cost = float(np.sum((trial.project((world - position) @ rotation.T) - pixels) ** 2))
        if math.isfinite(cost):
            starts.append((cost, trial, rotation, position))
    if mirrored and not starts:
        raise ConfigError(
            "camera: expected the floor seen from above, got it mirrored; the picture is flipped, "
            "or two points are swapped (south-west, south-east, north-east, north-west)"
        )
    if not starts:
        raise ConfigError("camera: none sees the points so; expected pixels in the field of view")
    return min(starts, key=lambda start: start[0])[1:]


def _pose_from_homography(
    pixels: np.ndarray, floor_m: np.ndarray, lens: Lens
) -> Optional[Tuple[np.ndarray, np.ndarray]]:
    import cv2

    rays = lens.unproject(pixels)
    if np.any(~np.isfinite(rays)) or np.any(rays[:, 2] < 0.02):
        return None
    matrix, _ = cv2.findHomography(floor_m, rays[:, :2] / rays[:, 2:])
    if matrix is None:
        return None
    matrix = matrix * (2.0 / (np.linalg.norm(matrix[:, 0]) + np.linalg.norm(matrix[:, 1])))
    centre = matrix @ np.array([*floor_m.mean(axis=0), 1.0])
    matrix = matrix * math.copysign(1.0, float(centre[2]))  # the floor lies before the camera
    axes = np.column_stack((matrix[:, 0], matrix[:, 1], np.cross(matrix[:, 0], matrix[:, 1])))
    left, _, right = np.linalg.svd(axes)
    rotation = left @ right
    return rotation, -rotation.T @ matrix[:, 2]


def _least_squares(
    residual: Callable[[np.ndarray], np.ndarray], p: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Where the residual is least, near ``p``, and its Jacobian there (Levenberg, Marquardt)."""
    damping, r, jacobian = 1e-3, residual(p), _jacobian(residual, p)
    for _ in range(200):
        normal = jacobian.T @ jacobian
        damped = normal + damping * np.diag(np.maximum(np.diag(normal), 1e-12))
        step = np.linalg.solve(damped, -jacobian.T @ r)
        trial = residual(p + step)
        if not (np.isfinite(trial).all() and trial @ trial <= r @ r):
            damping *= 5.0
            if damping > 1e10:
                break
            continue
        gain = r @ r - trial @ trial
        p, r, damping = p + step, trial, max(damping / 5.0, 1e-12)
        jacobian = _jacobian(residual, p)
        if gain <= 1e-14 * (1.0 + r @ r):
            break
    return p, jacobian


def _jacobian(residual: Callable[[np.ndarray], np.ndarray], p: np.ndarray) -> np.ndarray:
    step = 1e-6
    columns = [(residual(p + e) - residual(p - e)) / (2 * step) for e in step * np.eye(len(p))]
    return np.stack(columns, axis=1)
