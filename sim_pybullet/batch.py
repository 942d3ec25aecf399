"""``BatchWorld``: N robots that learn one task, each in an episode of its own, stepped together."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS, PATH_POINTS, ImageSpec
from robot.errors import ConfigError, ContractError
from robot.geometry import Pose
from robot.inference.policy import Translator
from robot.navigation.road_map import RoadMap
from sim_pybullet.episodes import DrawnEpisodes, Looks, NumberedEpisodes
from sim_pybullet.look import NOMINAL, Look
from sim_pybullet.motors import PHYSICS_STEPS
from sim_pybullet.rendering.ray_camera import BatchCamera, RayCamera
from sim_pybullet.sensing.camera_feed import CameraFeed
from sim_pybullet.sensing.guidance_feed import ALWAYS, GuidanceFeed, PoseSources
from sim_pybullet.tasks.spec import Course, Task, TaskStep
from sim_pybullet.town import Town


class Observation(NamedTuple):
    """What the policies of M robots get."""

    image: np.ndarray  # (M, H, W, 3 F) uint8 RGB, the task's F last frames, the newest last
    path: np.ndarray | None  # (M, told) float32 beside it, see robot.contract.PolicyContract


class Finished(NamedTuple):
    """The episodes that ended with a step."""

    robots: np.ndarray  # (M,) indices, ascending
    observation: Observation  # the last of the ended episode
    metrics: tuple["DriveMetrics", ...]  # of the ended episode


class BatchStep(NamedTuple):
    """What a step of all robots led to; robots that ended have begun their next episode."""

    observation: Observation  # of the next episode where one ended
    reward: np.ndarray  # (N,) float64
    task: TaskStep
    course: Course  # before any next episode began
    poses: np.ndarray  # (N, 3) true ones, before any next episode began
    collided: np.ndarray  # (N,) bool
    finished: Finished


class BatchWorld:
    """Bodies, vehicles, cameras and a task, for N robots at once.

    The same arguments, seed and actions give the same pictures, bit for bit. ``feed`` tells what
    they show, ``guidance`` where robots of a task with a path believe to be.

    Args:
        pool_size: painted worlds per map, with a sampler of Looks.
        camera: in place of a `RayCamera`; where it draws on a device of torch, the images of
            observations are tensors there, all episodes are drawn, and nobody has sight.
        numbers: of the episodes; without it they have none and never end, see
            `sim_pybullet.episodes`.
        translator: what every picture passes through before the policy sees it.
        sources: what tells robots on maps where they are.
        blank_in_junctions: pictures taken there are black, for policies and for sight.
        commands: so many of its last commands each robot is told.

    Attributes:
        commands: (N, 2 K) these, the oldest first, as shares of the greatest wheel speed.
    """

    def __init__(
        self,
        task: Task,
        looks: Looks,
        image: ImageSpec | None = None,
        seed: int = 0,
        pool_size: int = 16,
        camera: BatchCamera | None = None,
        translator: Translator | None = None,
        numbers: Sequence[int] | None = None,
        sources: PoseSources = ALWAYS,
        blank_in_junctions: bool = False,
        commands: int = 0,
    ) -> None:
        image = image or ImageSpec()
        if not isinstance(image, ImageSpec):
            raise ConfigError(f"image: expected an ImageSpec(width_px, height_px), got {image!r}")
        self._maps = [place for place in task.road_maps if isinstance(place, RoadMap)]
        if blank_in_junctions and not self._maps:
            raise ConfigError("zero: expected image, got junctions; a race track has none")
        self._blank_in_junctions = blank_in_junctions
        self.task = task
        self.n_robots = n = task.n_robots
        self._episodes: DrawnEpisodes | NumberedEpisodes
        if numbers is None:
            self._episodes = DrawnEpisodes(task.road_maps, looks, n, seed, pool_size, task.group)
        else:
            self._episodes = NumberedEpisodes(task.road_maps, looks, n, seed, numbers, task.group)
        self._town = Town(self._episodes.solids, n, reach_m=self._episodes.reach_m)
        drawing = camera or RayCamera(image, n, task.movers)
        self.feed = CameraFeed(
            drawing, n, image.crop_top_px, translator, movers=len(task.movers), frames=task.frames
        )
        self.guidance = None
        if task.guided:
            self.guidance = GuidanceFeed(n, sources, self._maps)
        self._recorder, self.commands = DriveRecorder(n), np.zeros((n, 2 * commands))
        self._looks = [NOMINAL] * n

    def close(self) -> None:
        """Free the physics client."""
        self._town.close()

    def seed(self, seed: int) -> None:
        """Begin the random numbers anew; the painted worlds stay as they are."""
        self._episodes.seed(seed)

    @property
    def told(self) -> int:
        """How many numbers each robot gets beside the picture."""
        return PATH_POINTS * self.task.guided + self.commands.shape[1]

    @property
    def poses(self) -> np.ndarray:
        """(N, 3) true poses: x [m], y [m], heading [rad], each on the map of its robot."""
        return self._town.poses

    @property
    def maps(self) -> np.ndarray:
        """(N,) int, the map that each robot is on: index into the task's road_maps."""
        return self.task.maps.copy()

    @property
    def looks(self) -> tuple[Look, ...]:
        """What each robot's episode looks and moves like."""
        return tuple(self._looks)

    @property
    def numbers(self) -> np.ndarray:
        """(N,) int, of each robot's episode; below 0: there is none left for it."""
        return self._episodes.numbers.copy()

    @property
    def active(self) -> np.ndarray:
        """(N,) bool: who has an episode to drive. Of the others nothing is drawn nor judged."""
        return self._episodes.numbers >= 0

    def expert_actions(self) -> np.ndarray:
        """(N,) what the task's expert would do now, who knows the true poses."""
        return self.task.expert(self._town.poses)

    def reset(self, poses: np.ndarray | None = None) -> Observation:
        """Begin an episode of every robot, at these poses (N, 3) if any are given.

        DuckpilotError where an episode cannot begin there.
        """
        return self._observe(self._begin(np.arange(self.n_robots), poses))

    def step(self, actions: np.ndarray) -> BatchStep:
        """Let every robot carry out its action for `robot.contract.CONTROL_DT_S`.

        Args:
            actions: (N,) numbers of the vehicle's actions, or (N, 2) from -1 to 1: any pair of
                speeds, see the vehicle's ``step``.

        ContractError: not one action of the vehicle per robot.
        """
        collided = self._drive(_checked(actions, self.n_robots, len(self.task.vehicle.actions)))
        poses, active = self._town.poses, self.active
        judged = self._episodes.together(self.task.step(poses, collided))
        judged = judged._replace(  # nothing ends for robots that have no episode
            terminated=judged.terminated & active,
            truncated=judged.truncated & active,
            success=judged.success & active,
        )
        course, collided = self.task.course, collided | self.task.met
        if self.guidance is not None:
            self.guidance.update(poses, self._episodes.rng("pose"))
        self._recorder.add(course.progress_m, course.offset_m, self.task.half_lane_m)
        observation = self._observe()
        ended = np.flatnonzero(judged.terminated | judged.truncated)
        image, path = observation
        last = Observation(image[ended], None if path is None else path[ended])
        finished = Finished(ended, last, tuple(self._recorder.metrics(int(i)) for i in ended))
        if len(ended):
            begun = self._begin(ended)
            observation = _replaced(observation, begun, self._observe(begun))
        return BatchStep(observation, judged.reward, judged, course, poses, collided, finished)

    def _drive(self, actions: np.ndarray) -> np.ndarray:
        vehicle, collided = self.task.vehicle, np.zeros(self.n_robots, dtype=bool)
        rng, active = self._episodes.rng("motor"), self.active
        shares = actions
        if actions.ndim == 1:
            table = np.array(vehicle.actions)  # of cars, it is of shares
            shares = table[actions] / max(MAX_WHEEL_MPS, table.max())
        self.commands = np.hstack((self.commands, shares))[:, 2:]
        self.task.think(self._town.poses)
        for k in range(PHYSICS_STEPS):
            twists = vehicle.step(actions, rng)
            if self.task.group > 1:
                twists[~active] = 0.0  # who has failed stands there
            self._town.step(twists)
            poses = self._town.poses
            self.feed.record(poses, self.task.moving(poses, (k + 1) / PHYSICS_STEPS))
            if self.guidance is not None:
                self.guidance.record(vehicle.counted)
            collided |= self._town.collided
        return collided

    def _begin(self, wanting: np.ndarray, poses: np.ndarray | None = None) -> np.ndarray:
        """The next episode of these robots (M,); those for whom there is one."""
        robots = self._episodes.begin(wanting)
        if not len(robots):
            return robots
        if poses is None:
            poses = self._episodes.starts(self.task, robots)
        else:
            self.task.reset_at(robots, poses, self._episodes.rng("task"))
        looks, scenes = [], []
        for i, pose in zip(robots.tolist(), poses, strict=True):
            world, painted, look = self._episodes.setting(i, int(self.task.maps[i]))
            self._town.furnish(world, painted.scene.solids)
            self._town.place(i, Pose(*pose), world)
            self.task.vehicle.reset(i, look.drive)
            self._looks[i] = look
            scenes.append((painted.scene, look))
            looks.append(look.pose)
        moving = self.task.moving(self._town.poses)
        for i, pose, (scene, look) in zip(robots.tolist(), poses, scenes, strict=True):
            self.feed.begin(i, scene, look, pose, None if moving is None else moving[i])
        if self.guidance is not None:
            hints = self.task.paths.index_at(self.task.course.arc_m)
            rngs = [self._episodes.own("pose", i) for i in robots.tolist()]
            self.guidance.begin(robots, looks, self._town.poses, hints, rngs)
        self._recorder.begin(robots)
        self.commands[robots] = 0.0
        return robots

    def _observe(self, begun: np.ndarray | None = None) -> Observation:
        """What robots see that have just begun; else what all active ones see (N), the others 0."""
        everyone = begun is None and bool(self.active.all())
        robots = np.flatnonzero(self.active) if begun is None else begun
        drawn = None if everyone else robots
        skip, noise = (self._episodes.rng(kind, drawn) for kind in ("skip", "noise"))
        image = self.feed.pictures(skip, drawn, noise)
        if self._blank_in_junctions:
            image[self._shown_junctions(robots)] = 0
        if begun is None and self.guidance is not None:
            self.guidance.see(image[..., -3:], robots, self.feed.fresh, self.task.maps)
        path = None if self.guidance is None else self.guidance.path_inputs(self.task.paths)
        if self.commands.size:
            told = self.commands.astype(np.float32)
            path = told if path is None else np.hstack((path, told))
        if path is not None and not everyone:
            path = path[robots]
        seen = Observation(image, path)
        if everyone or begun is not None:
            return seen
        nothing = None if path is None else np.zeros((self.n_robots, path.shape[1]), path.dtype)
        zeros = np.zeros((self.n_robots, *image.shape[1:]), image.dtype)
        return _replaced(Observation(zeros, nothing), robots, seen)

    def _shown_junctions(self, robots: np.ndarray) -> np.ndarray:
        """(M,) bool: whose newest picture was taken in a junction."""
        maps, shown = self.task.maps[robots].tolist(), self.feed.shown[robots, 0, :2].tolist()
        tiles = [self._maps[k].tile_at(*at) for k, at in zip(maps, shown, strict=True)]
        return np.array([tile is not None and tile.is_junction for tile in tiles], dtype=bool)


def _checked(actions: np.ndarray, n_robots: int, choices: int) -> np.ndarray:
    actions = np.asarray(actions)
    if actions.ndim == 2:
        wanted = f"({n_robots}, 2) numbers from -1 to 1"
        valid = actions.shape == (n_robots, 2) and (np.abs(actions) <= 1.0).all()  # nor a NaN
    else:
        wanted = f"({n_robots},) whole numbers from 0 to {choices - 1}"
        whole = actions.shape == (n_robots,) and np.issubdtype(actions.dtype, np.integer)
        valid = whole and ((actions >= 0) & (actions < choices)).all()
    if not valid:
        raise ContractError(f"actions: expected {wanted}, got {actions!r}")
    return actions


def _replaced(whole: Observation, robots: np.ndarray, parts: Observation) -> Observation:
    for into, part in zip(whole, parts, strict=True):
        if into is not None:
            into[robots] = part
    return whole


class DriveMetrics(NamedTuple):
    """One episode of one robot."""

    driven_lane_m: float  # along the path, while in the lane
    survival_time_s: float
    deviation_m_s: float  # integral of the distance from the path over time
    outside_lane_s: float
    mean_offset_m: float  # mean distance from the path


class DriveRecorder:
    """Adds up the figures of N robots while they drive."""

    def __init__(self, n_robots: int) -> None:
        self._sums = np.zeros((4, n_robots))  # way in the lane, offsets [m], steps outside, steps

    def begin(self, robots: np.ndarray) -> None:
        """Forget the episodes of these robots: indices (M,)."""
        self._sums[:, robots] = 0.0

    def add(self, progress_m: np.ndarray, offset_m: np.ndarray, half_lane_m: np.ndarray) -> None:
        """One decision: progress along the path, distance from it, half the lane's width, (N,)."""
        away_m = np.abs(offset_m)
        outside = away_m > half_lane_m
        driven_m = np.where(outside, 0.0, progress_m)
        self._sums += np.stack((driven_m, away_m, outside, np.ones(len(away_m))))

    def metrics(self, i: int) -> DriveMetrics:
        """The episode of robot ``i`` up to now; the mean offset of no decisions is zero."""
        driven_m, offsets_m, outside, steps = self._sums[:, i].tolist()
        return DriveMetrics(
            driven_m,
            steps * CONTROL_DT_S,
            offsets_m * CONTROL_DT_S,
            outside * CONTROL_DT_S,
            offsets_m / max(steps, 1.0),
        )
