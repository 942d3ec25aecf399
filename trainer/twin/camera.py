"""Where the camera sits and looks, fitted to where the lines of the map lie in the pictures.

The simulator's own camera draws how much white, yellow and floor beside the road each pixel sees.
That explains the brightness and the yellow of a picture, and how it changes as the camera is moved
tells where the camera is: Gauss and Newton's steps over many pictures, each with its own pose.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from operator import attrgetter
from typing import NamedTuple, Self

import cv2
import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import CameraLook, GroundLook, LightLook, Look, SkyLook
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Scene, SemanticClass

NAMES = (
    *("height_m", "pitch_rad", "roll_rad", "focal_scale", "distortion_scale"),
    *("centre_right_px", "centre_down_px"),
)
# Of these, the width of the lines, a factor, and how much the lens shades the corners; beyond what
# `looks/randomised.yaml` knows.
USUAL = np.array([*(getattr(CameraLook(), name) for name in NAMES), 1.0, 0.15])
WIDTH = len(NAMES)
SPREAD = np.array((0.03, 0.17, 0.05, 0.1, 0.2, 3.5, 3.5, 0.13, 0.15))
POSE_SPREAD = np.array((0.04, 0.04, 0.09))
# For derivatives, each a fraction of a pixel: those of camera and pose must cancel each other.
_SMALL = np.array((1e-3, 3e-3, 3e-3, 3e-3, 15e-3, 0.2, 0.2, 0.05))
_SMALL_POSE = np.array((2e-3, 2e-3, 5e-3))
FAR_M = 0.8
TRIED_M = (0.09, 0.11, 0.13)  # heights to begin with, and pitches
TRIED_RAD = np.radians((-8.0, -4.0, 0.0, 4.0, 8.0))
ROUNDS = ((12, 2, 8), (12, 2, 4), (30, 3, 2))  # by so many pictures so many steps; so many go on
SHARP_STEPS, LAST_STEPS = 3, 8  # of those that are left, and of the best by all pictures
FARTHEST = 6.0  # times a step goes on
SETTLED = 0.02  # of a spread: a pose that moves by less is there
PX_PER_RAD = 76.4  # of a nominal lens in a frame 160 px wide
APART_M, APART_RAD = 0.01, 0.05  # of height and middle of the picture: two cameras, not one
RIVAL = 1.3  # times as much may the next best leave unexplained, to be as likely
SOFT, BLUR_PX = 2, 1.0  # shrunk pictures, to find lines from afar; against aliasing
SOFTER_PX = 2.0  # and pictures may be by so much less sharp, as they move or for JPEG
YELLOW_PX = 1.5  # more of yellow: JPEG keeps colours less sharp than brightness
NEAR_PX = 21  # around a pixel: what is alike there is light; and so near the road a floor is known
_EVERY = 3  # pixels of which one is asked; of shrunk pictures all are
_ALIKE = 4.0  # neighbouring pixels err alike: so many tell as much as one
_TELLS = 8.0  # and between two cameras a picture as much as so few numbers
_NO, _RED, _GREEN, _BLUE = (0.0, 0.0, 0.0), (255.0, 0.0, 0.0), (0.0, 255.0, 0.0), (0.0, 0.0, 255.0)
# Stop lines are both red and green: where two say all, nothing is known.
_COVER = GroundLook(_NO, _RED, _GREEN, (255.0, 255.0, 0.0), _BLUE, grain=0.0, seam_depth=0.0)


def far(shrink: int = 1) -> np.ndarray:
    """(H, W) how far pixels of pictures so many times smaller are off the middle, squared."""
    rows, columns = np.mgrid[-1 : 1 : 120j / shrink, -1 : 1 : 160j / shrink]
    return np.asarray(0.5 * (rows**2 + columns**2), np.float32)


@lru_cache(maxsize=4)
def cover_scene(road_map: RoadMap, width: float) -> Scene:
    """The floor in white, yellow and beside as red, green and blue; lines so many times as wide."""
    ground = paint_ground(road_map, replace(_COVER, line_width_scale=width))
    ground.rgb[ground.classes == SemanticClass.OUTSIDE] = _BLUE
    return Scene(ground, (), SkyLook(), LightLook(ambient=1.0, diffuse=0.0))


def rig_of(values: np.ndarray) -> CameraRig:
    """The nominal camera with these values (7,) of ``NAMES``; what follows them is not asked."""
    camera = replace(CameraLook(), **dict(zip(NAMES, values.tolist(), strict=False)))
    return replace(Look(), camera=camera).rig()


class Eye:
    """Draws cover as a camera sees it, and as it would with each of the values a little otherwise.

    Slopes are taken from both sides: from one, what aliasing does to the picture itself would pull
    every value the same way.
    """

    def __init__(self, views: "Views", values: np.ndarray, camera_too: bool) -> None:
        moves = np.diag(_SMALL)[: camera_too * len(_SMALL)] @ np.eye(len(_SMALL), len(USUAL))
        tried = [values + move for move in (0.0 * USUAL, *moves, *-moves)]
        scenes = {w: cover_scene(views.road_map, w) for w in {each[WIDTH] for each in tried}}
        rigs = [rig_of(each) for each in tried]
        self._slots = np.array([*range(len(rigs)), *(0,) * 6])
        size = 160 // views.shrink, 120 // views.shrink
        self._camera = RayCamera(ImageSpec(*size), len(rigs))
        for k, (rig, each) in enumerate(zip(rigs, tried, strict=True)):
            self._camera.set_robot(k, scenes[each[WIDTH]], rig)
        self._shade, self._camera_too = float(values[-1]), camera_too
        self._small = np.array([*_SMALL[: len(moves)], *_SMALL_POSE], np.float32)
        pixels = np.stack(np.meshgrid(*map(np.arange, size)), axis=-1).astype(float)
        found = CameraRig(rigs[0].lens.scaled(*size), rigs[0].mount).to_floor(pixels)
        self._shrink, self._far = views.shrink, far(views.shrink)[..., None]
        rounded = _unlit(self._far[None, ..., 0]).ravel()  # not all of it goes, at the edges
        self.shading = np.stack((np.ones_like(rounded), rounded), axis=1)
        self._near = np.nan_to_num(np.hypot(found[..., 0], found[..., 1]), nan=np.inf) < FAR_M

    def look(self, pose: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """At a pose (3,): indices (N,) of known pixels; for each plane, (2 + G, N, 3) of cover.

        First what a less sharp lens adds, then how much of each kind covers a pixel, then slopes.
        """
        poses = np.tile(pose, (len(self._slots), 1))
        poses[-6:-3] += np.diag(_SMALL_POSE)
        poses[-3:] -= np.diag(_SMALL_POSE)
        drawn = self._camera.render(poses, self._slots)
        beside, unknown = drawn[0, ..., 2] > 250, drawn[0, ..., :2].min(axis=-1) > 30
        off_road = cv2.erode(beside.astype(np.uint8), np.ones((NEAR_PX, NEAR_PX))) > 0
        off_road |= cv2.dilate(unknown.astype(np.uint8), np.ones((4 // self._shrink + 1,) * 2)) > 0
        known = np.flatnonzero(self._near & ~off_road)[:: _EVERY if self._shrink == 1 else 1]
        shares, half = drawn.astype(np.float32) / 255.0, (len(drawn) - 7) // 2
        more = np.concatenate((shares[1 : 1 + half], shares[-6:-3]))
        more -= np.concatenate((shares[1 + half : -6], shares[-3:]))
        more /= (2.0 * self._small)[:, None, None, None]
        lit, darker = 1.0 - self._shade * self._far, (-self._far * shares[:1])[: self._camera_too]
        each = np.concatenate((lit * shares[:1], lit * more[:-3], darker, lit * more[-3:]))
        bright = _blurred(_unlit(each), BLUR_PX)
        both = bright, _blurred(bright, YELLOW_PX / self._shrink)
        soft_px = SOFTER_PX / self._shrink
        whole = [np.concatenate((_blurred(p[:1], soft_px) - p[:1], p)) for p in both]
        return known, [each.reshape(len(each), -1, 3)[:, known] for each in whole]


def _blurred(pictures: np.ndarray, blur_px: float) -> np.ndarray:
    return np.stack([cv2.GaussianBlur(each, (0, 0), blur_px) for each in pictures])


def _unlit(pictures: np.ndarray) -> np.ndarray:
    """Without what shadows, gloss and patches do, which are large."""
    return np.stack([each - cv2.blur(each, (NEAR_PX, NEAR_PX)) for each in pictures])


def explain(planes: np.ndarray, eye: Eye, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """How a picture's planes (pixels, 2) follow from what the eye draws at a pose (3,).

    Normal equations of camera and pose, (G, G) and (G,); the share of variance that is explained.
    """
    known, covers = eye.look(pose)
    matrix, vector = np.zeros((count := len(covers[0]) - 2, count)), np.zeros(count)
    if len(known) < 200:
        return matrix, vector, 0.0
    left = whole = 0.0
    for plane, cover in zip(planes[known].T, covers, strict=True):
        terms = np.column_stack((eye.shading[known], *cover[:2]))
        weights = np.ones(len(known))
        for _ in range(3):
            heavy = terms * weights[:, None]
            solver = np.linalg.inv(heavy.T @ terms + 1e-6 * np.eye(terms.shape[1])) @ heavy.T
            found = solver @ plane
            missed = plane - terms @ found
            sigma = 1.4826 * np.median(np.abs(missed)) + 0.5
            weights = 1.0 / (1.0 + (missed / (2.5 * sigma)) ** 2)
        slope = (cover[2:] @ found[-3:]).T
        slope -= terms @ (solver @ slope)
        heavy = slope * (weights / (sigma**2 * _ALIKE))[:, None]
        matrix += heavy.T @ slope
        vector += heavy.T @ missed
        left += float((weights * missed**2).sum()) / sigma**2
        whole += float((weights * (plane - plane.mean()) ** 2).sum()) / sigma**2
    return matrix, vector, max(0.0, 1.0 - left / max(whole, 1e-9))


Goal = tuple[np.ndarray, np.ndarray]  # of a step, and the change that leads there, in spreads


class Fitted(NamedTuple):
    """A camera and the poses of its pictures."""

    values: np.ndarray  # (9,) as ``USUAL``
    sd: np.ndarray
    poses: np.ndarray  # (F, 3)
    share: float  # of the pictures' variance that the map explains
    cost: float  # of what is left of it, and of what is moved for it
    rival: np.ndarray | None = None  # (9,) of another camera that explains them nearly as well

    @property
    def shade(self) -> float:
        """How much darker the corners are, a share."""
        return max(0.0, float(self.values[-1]))


class Views(NamedTuple):
    """Pictures taken near poses (F, 3) of a map."""

    planes: np.ndarray  # (F, pixels, 2)
    poses: np.ndarray
    road_map: RoadMap
    shrink: int  # so many times smaller than (120, 160)

    def some(self, chosen: np.ndarray) -> Self:
        """Those of these numbers."""
        return self._replace(planes=self.planes[chosen], poses=self.poses[chosen])


def views_of(
    images: Sequence[np.ndarray], poses: np.ndarray, road_map: RoadMap, shrink: int = 1
) -> Views:
    """Of pictures (120, 160, 3), so many times smaller: the planes are brightness and yellow."""
    size = 160 // shrink, 120 // shrink
    small = np.array(
        [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in images], np.float32
    )
    red, green, blue = np.moveaxis(_blurred(_unlit(small), BLUR_PX), -1, 0)
    yellow = _blurred((red + green) / 2 - blue, YELLOW_PX / shrink)
    planes = np.stack(((red + green + blue) / 3, yellow), axis=-1)
    return Views(planes.reshape(len(images), -1, 2), poses, road_map, shrink)


def fit_camera(images: Sequence[np.ndarray], poses: np.ndarray, road_map: RoadMap) -> Fitted:
    """The camera after pictures (120, 160, 3) taken near poses (F, 3)."""
    soft, sharp = (views_of(images, poses, road_map, shrink) for shrink in (SOFT, 1))
    begins = itertools.product(TRIED_M, USUAL[1] + TRIED_RAD)
    tried = [np.array((height_m, pitch_rad, *USUAL[2:])) for height_m, pitch_rad in begins]
    for count, steps, kept in ROUNDS:
        few = np.linspace(0, len(images) - 1, min(count, len(images))).astype(int)
        found = [descend(soft.some(few), values, steps) for values in tried]
        found = sorted(found, key=attrgetter("cost"))[:kept]
        tried = [each.values for each in found]
    found = [descend(sharp.some(few), each.values, SHARP_STEPS, each.poses) for each in found]
    best = min(found, key=attrgetter("cost"))
    begin, _, _ = settle(soft, best.values, poses)
    return descend(sharp, best.values, LAST_STEPS, begin)._replace(rival=rival_of(best, found))


def rival_of(best: Fitted, others: Sequence[Fitted]) -> np.ndarray | None:
    """A camera apart from the best that explains nearly as much."""
    for other in others:
        pair = np.array((best.values, other.values))
        # Pitch and the lens's centre are hardly told apart; where the middle looks is.
        middles_rad = pair[:, 1] - pair[:, 6] / (PX_PER_RAD * pair[:, 3])
        apart = np.ptp(pair[:, 0]) > APART_M or np.ptp(middles_rad) > APART_RAD
        if apart and other.cost < best.cost + math.log(RIVAL):
            return other.values
    return None


def descend(views: Views, values: np.ndarray, steps: int, at: np.ndarray | None = None) -> Fitted:
    """Gauss and Newton's steps from values (9,); before each the poses find their places.

    Pictures that the map explains less well than most say nothing of the camera.
    """
    now = views.poses if at is None else at
    belief, count, last = np.diag(1.0 / POSE_SPREAD**2), len(USUAL), None
    for step in range(steps):
        now, _, _ = settle(views, values, now, 1 if step else 3)
        eye = Eye(views, values, True)
        found = [explain(*each) for each in zip(views.planes, [eye] * len(now), now, strict=True)]
        both, told, shares = (np.array(each) for each in zip(*found, strict=True))
        # Where poses go: alone, and for the camera's step.
        own = np.linalg.inv(both[:, count:, count:] + belief)
        alone = (own @ (told[:, count:] + (views.poses - now) @ belief)[..., None])[..., 0]
        along, fair = -own @ both[:, count:, :count], shares >= 0.9 * np.median(shares)
        cross = both[fair, :count, count:]
        matrix = (both[fair, :count, :count] + cross @ along[fair]).sum(axis=0)
        matrix += np.diag(1.0 / SPREAD**2)
        vector = (told[fair, :count] - (cross @ alone[fair, :, None])[..., 0]).sum(axis=0)
        vector += (USUAL - values) / SPREAD**2
        change = np.clip(np.linalg.solve(matrix, vector) / SPREAD, -1.0, 1.0)
        goal = values + SPREAD * change
        far_on, last = onward(goal, change, last, FARTHEST), (goal, change)
        before, values = values, np.clip(far_on, USUAL - 3.0 * SPREAD, USUAL + 3.0 * SPREAD)
        now = now + np.clip(alone + along @ (values - before), -POSE_SPREAD, POSE_SPREAD)
    sd, share = np.sqrt(np.diag(np.linalg.inv(matrix))), float(np.median(shares))
    off, unusual = (now - views.poses) / POSE_SPREAD, (values - USUAL) / SPREAD
    moved = (off**2).sum() + (unusual**2).sum()
    cost = math.log(max(1.0 - share, 1e-3)) + moved / (_TELLS * len(now))
    return Fitted(values, sd, now, share, cost)


def onward(goal: np.ndarray, change: np.ndarray, last: Goal | None, farthest: float) -> np.ndarray:
    """Where to go, of a step that leads to ``goal`` by a ``change``, after another one.

    Steps along a valley, in which pitch, lens and poses change and the pictures hardly do, come out
    short: go where the last two lead (Anderson 1965, "Iterative procedures for nonlinear integral
    equations", of depth one).
    """
    if last is None:
        return goal
    less = last[1] - change
    on = max(0.0, less @ change) / max(less @ less, 1e-12)
    return goal + min(on, farthest) * (goal - last[0])


def settle(
    views: Views, values: np.ndarray, begin: np.ndarray, steps: int = 3, farthest: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (F, 3) of the eye in the views, from ``begin`` on.

    Also roots (F, 3, 3) of their information, and how much of each picture is explained. Going on
    by up to ``farthest`` steps is for a camera that is known: by another one it leads astray.
    """
    eye, belief = Eye(views, values, False), np.diag(1.0 / POSE_SPREAD**2)
    now, roots, shares = begin.copy(), np.zeros((len(begin), 3, 3)), np.zeros(len(begin))
    for k, planes in enumerate(views.planes):
        last = None
        for _ in range(steps):
            matrix, vector, shares[k] = explain(planes, eye, now[k])
            own = matrix + belief
            step = np.linalg.solve(own, vector + belief @ (views.poses[k] - now[k]))
            change = np.clip(step / POSE_SPREAD, -1.0, 1.0)
            goal = now[k] + POSE_SPREAD * change
            now[k], last = onward(goal, change, last, farthest), (goal, change)
            if np.abs(change).max() < SETTLED:
                break
        roots[k] = np.linalg.cholesky(own).T
    return now, roots, shares
