"""Pictures of robots that drive, and what the map says each of them shows.

The expert drives missions and is disturbed now and then, so that it is seen off its lane and
returning. Besides there are pictures from anywhere, most of which show no lane to drive in, and
from beside the lanes: who is in the oncoming one is told how far, and comes back.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from robot.contract import ImageSpec
from robot.geometry import Pose, bezier_points, bezier_tangents
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import Other
from robot.navigation.road_map import RoadMap
from sim_pybullet.batch import BatchWorld
from sim_pybullet.episodes import LookPool, Looks
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.sensing.sensor import apply_sensor
from sim_pybullet.tasks.spec import Task
from trainer.sight.bystanders import clear_m, half_m, standing

IMAGE = ImageSpec(80, 60, 20)
ROBOTS = 20
FIGURES = 5  # labels that are measured: those of `robot.vision.sight.FIGURES`
LINE_FIGURE, FREE = FIGURES - 2, FIGURES - 1
# Columns of the labels beside them; -1 is: nobody can tell, or nobody should be asked.
LINE, ROAD, THING, KIND, NEW, CROSSING, DRIVEN_M = range(FIGURES, FIGURES + 7)
_COLUMNS = FIGURES + 7
LINE_M = (0.12, 0.45)  # from the axle: a line that must be seen; nearer ones leave the picture
NO_LINE_M = (0.06, 0.6)  # nearer or farther than these there is none
THING_M, NO_THING_M = 0.5, 0.65  # from the nose: what must be seen, and beyond what nothing need
START_SPREAD = 4.0
_DISTURBED = 0.04  # chance of a disturbance in a decision, of 2 to 6 decisions
IN_LANE_M, _ONCOMING_M = 0.14, 0.3  # to either side of its middle; to the left, beyond yellow
_ELSEWHERE_M, _BEYOND_M = 0.19, 0.35  # farther than these, nothing of it need be seen
_ALONG_RAD, _ACROSS_RAD = 1.25, 1.5
_STRAIGHT_ON_RAD = 0.35  # in a junction: who is turned farther has no way ahead that one could see
_WORLDS = 2  # painted, of each map
_AT_ONCE = 16  # pictures of each map from anywhere, in one look
_BY_LANES = 4  # so many times these from lanes and the oncoming ones
_MARGIN_M = 0.3


class Pictures(NamedTuple):
    """What robots saw, and what there was to see."""

    images: np.ndarray  # (M, 40, 80, 3) uint8 RGB
    labels: np.ndarray  # (M, 12) float32; NaN where there is no such figure


def is_seen(offset_m: float, heading_rad: float) -> bool:
    """Whether who is so far to the left of its lane, and turned so far, must see it."""
    return -IN_LANE_M <= offset_m <= _ONCOMING_M and abs(heading_rad) <= _ALONG_RAD


def of_photograph(lane: Sequence[float], thing: bool) -> np.ndarray:
    """(12,) what one shows: offset, heading and curvature of a lane, and if something is on it."""
    found = np.full(_COLUMNS, np.nan, np.float32)
    found[:3] = lane
    found[LINE:] = -1.0, 1.0, float(thing), -1.0, 0.0, 0.0, 0.0
    return found


def label(view: LaneView, pose: Sequence[float], others: Sequence[Other] = ()) -> np.ndarray:
    """(12,) what a picture taken at a pose shows: it is new, and nothing was driven before it."""
    found = np.full(_COLUMNS, np.nan, np.float32)
    found[LINE:] = 0.0, 0.0, -1.0, -1.0, 1.0, 0.0, 0.0
    road = view.at(*pose)
    if road is None:
        return found
    found[CROSSING] = road.in_junction
    turned_rad, left_m = abs(road.heading_rad), road.offset_m
    most_m = _ELSEWHERE_M if road.in_junction else _BEYOND_M
    if turned_rad > _ACROSS_RAD or not -_ELSEWHERE_M <= left_m <= most_m:
        return found
    found[[LINE, ROAD]] = -1.0
    if not is_seen(0.0 if road.in_junction else left_m, road.heading_rad):
        return found
    found[ROAD] = 1.0
    found[:3] = left_m, road.heading_rad, road.curvature_pm
    if left_m > IN_LANE_M and not road.in_junction:
        return found
    if not road.in_junction or turned_rad < _STRAIGHT_ON_RAD:
        most_m, least_m = clear_m(view, Pose(*pose), others)
        found[THING] = 1.0 if most_m <= THING_M else 0.0 if least_m >= NO_THING_M else -1.0
        found[FREE] = most_m if most_m < NO_THING_M else np.nan
    near, far = NO_LINE_M
    if near <= road.line_m <= far:
        found[LINE_FIGURE] = road.line_m
        found[KIND] = road.kind
        found[LINE] = 1.0 if LINE_M[0] <= road.line_m <= LINE_M[1] else -1.0
    else:
        found[LINE] = 0.0
        found[KIND] = -1.0 if road.in_junction or road.line_m < 2.0 * far else 0.0
    return found


def drive(task: Task, looks: Looks, seed: int, decisions: int) -> Pictures:
    """What `ROBOTS` experts at a task see, decision by decision: M is of both."""
    rng = np.random.default_rng((seed, 1))
    views = [LaneView(place) for place in task.road_maps if isinstance(place, RoadMap)]
    halves_m = [half_m(mover) for mover in task.movers]
    still = cache(lambda scene: standing(scene.solids))
    world = BatchWorld(task, looks, IMAGE, seed, _WORLDS)
    observation, driven_m = world.reset(), np.zeros(ROBOTS)
    astray, wrong = np.zeros(ROBOTS, dtype=int), np.zeros(ROBOTS, dtype=int)
    images = np.empty((decisions, ROBOTS, *IMAGE.shape), np.uint8)
    labels = np.empty((decisions, ROBOTS, _COLUMNS), np.float32)
    last = np.full((ROBOTS, 3), np.nan)
    for k in range(decisions):
        images[k] = observation.image[..., -3:]  # the newest
        shown, where, scenes = world.feed.shown.copy(), world.maps, world.feed.scenes
        poses = shown[:, 0]
        for i, places in enumerate(shown[:, 1:].tolist()):
            moving = [Other(x, y, half_m=m) for (x, y, _), m in zip(places, halves_m, strict=True)]
            others = still(scenes[i]) + [m for m in moving if math.isfinite(m.x_m + m.half_m)]
            labels[k, i] = label(views[where[i]], poses[i].tolist(), others)
        labels[k, :, NEW] = (poses != last).any(axis=1)
        labels[k, :, DRIVEN_M] = driven_m
        last = poses
        begins = (astray == 0) & (rng.random(ROBOTS) < _DISTURBED)
        astray = np.where(begins, rng.integers(2, 7, ROBOTS), np.maximum(astray - 1, 0))
        wrong = np.where(begins, rng.integers(0, 5, ROBOTS), wrong)
        step = world.step(np.where(astray > 0, wrong, world.expert_actions()))
        observation, driven_m = step.observation, step.course.progress_m
    world.close()
    return Pictures(images.reshape(-1, *IMAGE.shape), labels.reshape(-1, _COLUMNS))


def anywhere(maps: Sequence[RoadMap], looks: Looks, seed: int) -> Pictures:
    """What cameras see that stand and look anywhere on the maps and around them, or by a lane."""
    rng = np.random.default_rng((seed, 2))
    pool = LookPool(maps, looks, rng, 1)
    camera = RayCamera(IMAGE, _AT_ONCE)
    images, labels = [], []
    for road_map, world in zip(maps, pool.worlds, strict=True):
        view, others = LaneView(road_map), standing(world.scene.solids)
        least = -_MARGIN_M, -_MARGIN_M, -np.pi
        most = road_map.width_m + _MARGIN_M, road_map.height_m + _MARGIN_M, np.pi
        for k in range(1 + _BY_LANES):
            look = world.episode_look(rng)
            for i in range(_AT_ONCE):
                camera.set_robot(i, world.scene, look.rig())
            poses = _by_lanes(road_map, rng) if k else rng.uniform(least, most, (_AT_ONCE, 3))
            seen = camera.render(poses)
            images.append(apply_sensor(seen, [look.sensor] * _AT_ONCE, rng, IMAGE.crop_top_px))
            labels += [label(view, pose, others) for pose in poses.tolist()]
    return Pictures(np.concatenate(images), np.stack(labels))


def _by_lanes(road_map: RoadMap, rng: np.random.Generator) -> np.ndarray:
    """In lanes and in the oncoming ones, turned to any side."""
    poses = np.empty((_AT_ONCE, 3))
    for pose in poses:
        control = road_map.lanes[rng.integers(len(road_map.lanes))].control_points_m
        place = np.array((rng.random(),))
        x, y = bezier_tangents(control, place)[0].tolist()
        left = np.array((-y, x)) / math.hypot(x, y)
        pose[:2] = bezier_points(control, place)[0] + rng.uniform(-IN_LANE_M, _BEYOND_M) * left
        pose[2] = math.atan2(y, x) + rng.uniform(-_ALONG_RAD, _ALONG_RAD)
    return poses


def joined(parts: Sequence[Pictures]) -> Pictures:
    """All of them, one after the other."""
    return Pictures(*(np.concatenate(each) for each in zip(*parts, strict=True)))
