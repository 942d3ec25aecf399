"""Where the camera sits and looks, fitted to where the lines of the map lie in the pictures.

How well an `eye` explains the brightness and the yellow of a picture, and how that changes as it is
moved, tells where the camera is: Gauss and Newton's steps over many pictures, each with its own
pose.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import product, repeat
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from robot.navigation.road_map import RoadMap
from trainer.twin.eye import USUAL, Eye, Views, explain, views_of

# Beyond what `looks/randomised.yaml` knows.
SPREAD = np.array((0.03, 0.17, 0.05, 0.1, 0.2, 3.5, 3.5, 0.13, 0.15))
POSE_SPREAD = np.array((0.04, 0.04, 0.09))
TRIED_M = (0.09, 0.11, 0.13)  # heights to begin with, and pitches
TRIED_RAD = np.radians((-8.0, -4.0, 0.0, 4.0, 8.0))
PIECE = 60  # pictures, for which a process is worth the while
FEW = 24  # pictures to search by
SEARCH, LAST_STEPS = ((2, 8), (2, 4), (3, 4)), 9  # steps, and how many go on; the best by all
AGREE = 5  # times the pictures' weights are found
SOFT, AFAR = 2, (4, 2)  # times smaller are pictures in which lines are found, and first places
PLACE_STEPS = 5  # in each
SETTLED = 0.02  # of a spread: a pose that moves by less is there
PX_PER_RAD = 76.4  # of a nominal lens in a frame 160 px wide
APART_M, APART_RAD = 0.01, 0.05  # of height and middle of the picture: two cameras, not one
CLOSE = 0.25  # of cost: all pictures must tell which it is
_TELLS = 8.0  # between two cameras a picture tells as much as so few numbers
Spread = Callable[..., Iterable[Any]]  # as map


class Fitted(NamedTuple):
    """A camera and the poses of its pictures."""

    values: np.ndarray  # (9,) as ``USUAL``
    sd: np.ndarray
    poses: np.ndarray  # (F, 3)
    share: float  # of the pictures' variance that the map explains
    cost: float  # of what is left of it, and of what is moved for it


def fit_camera(
    images: Sequence[np.ndarray], poses: np.ndarray, road_map: RoadMap, spread: Spread = map
) -> Fitted:
    """The camera after pictures (120, 160, 3) taken near poses (F, 3)."""
    told = images, poses, road_map
    soft, sharp = (views_of(*told, shrink) for shrink in (SOFT, 1))
    tried = [np.array((*two, *USUAL[2:])) for two in product(TRIED_M, USUAL[1] + TRIED_RAD)]
    few = np.linspace(0, len(images) - 1, min(FEW, len(images))).astype(int)
    some = [images[k] for k in few], poses[few], road_map
    begins = [each[0] for each in spread(placed, *map(repeat, some), tried, repeat(AFAR[:1]))]
    for views, steps, kept in (*((soft, *each) for each in SEARCH), (sharp, 3, 4)):
        each = spread(descend, repeat(views.some(few)), tried, repeat(steps), begins)
        found = distinct(each)[:kept]
        tried, begins = [each.values for each in found], [each.poses for each in found]
    ends = (
        descend(sharp, values, LAST_STEPS, placed(*told, values, AFAR)[0], spread)
        for values, _, _, _, cost in found
        if cost < found[0].cost + CLOSE
    )
    return min(ends, key=attrgetter("cost"))


def placed(
    images: Sequence[np.ndarray],
    poses: np.ndarray,
    road_map: RoadMap,
    values: np.ndarray,
    shrinks: Sequence[int],
) -> tuple[np.ndarray, ...]:
    """What `settle` tells, of pictures that are so many times smaller first, so from farther."""
    now = poses
    for shrink in shrinks:
        now, *more = settle(views_of(images, poses, road_map, shrink), values, now, PLACE_STEPS)
    return now, *more


def distinct(cameras: Iterable[Fitted]) -> list[Fitted]:
    """The best first; of those that are one camera, the best."""
    found = list[Fitted]()
    for camera in sorted(cameras, key=attrgetter("cost")):
        if all(apart(camera.values, other.values) for other in found):
            found.append(camera)
    return found


def apart(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether these (9,) are two cameras.

    Pitch and the lens's centre are hardly told apart; where the middle of the picture looks is.
    """
    pair = np.array((one, other))
    middles_rad = pair[:, 1] - pair[:, 6] / (PX_PER_RAD * pair[:, 3])
    return bool(np.ptp(pair[:, 0]) > APART_M or np.ptp(middles_rad) > APART_RAD)


def descend(
    views: Views, values: np.ndarray, steps: int, at: np.ndarray | None = None, spread: Spread = map
) -> Fitted:
    """Gauss and Newton's steps from values (9,); before each the poses find their places.

    Pictures that the map explains less well than most say nothing of the camera.
    """
    now = views.poses if at is None else at
    belief, count = np.diag(1.0 / POSE_SPREAD**2), len(USUAL)
    for step in range(steps):
        parts = np.array_split(np.arange(len(now)), -(-len(now) // PIECE))
        some, places = map(views.some, parts), [now[part] for part in parts]
        each = spread(asked, some, repeat(values), places, repeat(1 if step else 3))
        now, both, told, shares = joined(each)
        # Where poses go: alone, and for the camera's step.
        own = np.linalg.inv(both[:, count:, count:] + belief)
        alone = (own @ (told[:, count:] + (views.poses - now) @ belief)[..., None])[..., 0]
        along = -own @ both[:, count:, :count]
        cross, fair = both[:, :count, count:], shares >= 0.9 * np.median(shares)
        each = both[:, :count, :count] + cross @ along
        pulls = told[:, :count] - (cross @ alone[..., None])[..., 0]
        matrix, way = agreed(each[fair], pulls[fair], (USUAL - values) / SPREAD**2)
        goal = values + np.clip(way, -SPREAD, SPREAD)
        before, values = values, np.clip(goal, USUAL - 3.0 * SPREAD, USUAL + 3.0 * SPREAD)
        now = now + np.clip(alone + along @ (values - before), -POSE_SPREAD, POSE_SPREAD)
    sd, share = np.sqrt(np.diag(np.linalg.inv(matrix))), float(np.median(shares))
    off, unusual = (now - views.poses) / POSE_SPREAD, (values - USUAL) / SPREAD
    moved = (off**2).sum() + (unusual**2).sum()
    cost = math.log(max(1.0 - share, 1e-3)) + moved / (_TELLS * len(now))
    return Fitted(values, sd, now, share, cost)


def asked(views: Views, values: np.ndarray, near: np.ndarray, steps: int) -> tuple[np.ndarray, ...]:
    """Poses (F, 3) settled from ``near`` on, and of each what `explain` says there."""
    now, _, _ = settle(views, values, near, steps)
    eye = Eye(views, values, True)
    found = [explain(*each) for each in zip(views.planes, repeat(eye), now)]
    return now, *map(np.array, zip(*found, strict=True))


def agreed(matrices: np.ndarray, pulls: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, ...]:
    """The step (G,) on which pictures agree most, by normal equations of each, and its matrix.

    One with clutter, or out of its place, errs in all its pixels alike: who pulls away from the
    others counts less (Cauchy's weights, by how surely it pulls).
    """
    belief, weights = np.diag(1.0 / SPREAD**2), np.ones(len(pulls))
    rough = np.linalg.inv(matrices + belief)
    for _ in range(AGREE):
        matrix = np.einsum("f,fij->ij", weights, matrices) + belief
        step = np.linalg.solve(matrix, weights @ pulls + prior)
        away = pulls - matrices @ step
        far_off = np.einsum("fi,fij,fj->f", away, rough, away)
        weights = 1.0 / (1.0 + far_off / (2.0 * np.median(far_off) + 1e-12))
    return matrix, step


def joined(pieces: Iterable[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    """Each array of all pieces in one."""
    return [np.concatenate(each) for each in zip(*pieces, strict=True)]


def settle(
    views: Views, values: np.ndarray, begin: np.ndarray, steps: int = 3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (F, 3) of the eye in the views, from ``begin`` on.

    Also roots (F, 3, 3) of their information, and how much of each picture is explained.
    """
    eye, belief = Eye(views, values, False), np.diag(1.0 / POSE_SPREAD**2)
    now, roots, shares = begin.copy(), np.zeros((len(begin), 3, 3)), np.zeros(len(begin))
    for k, planes in enumerate(views.planes):
        for _ in range(steps):
            matrix, vector, shares[k] = explain(planes, eye, now[k])
            own = matrix + belief
            step = np.linalg.solve(own, vector + belief @ (views.poses[k] - now[k])) / POSE_SPREAD
            now[k] += POSE_SPREAD * np.clip(step, -1.0, 1.0)
            if np.abs(step).max() < SETTLED:
                break
        roots[k] = np.linalg.cholesky(own).T
    return now, roots, shares
