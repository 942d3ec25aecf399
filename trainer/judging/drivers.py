"""Who drives the robots of a challenge, under the rules of the road or without."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS, ImageSpec
from robot.geometry import STILL, Pose, WheelSpeeds, wrap_angle
from robot.inference.preprocess import preprocess_batch
from robot.link.messages import FAR_M, Belief, PoseMessage, Telemetry
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import AHEAD_M, DUCK, Company, Neighbours
from robot.navigation.road_map import RoadMap
from robot.navigation.road_watch import RoadWatch, WaySeen
from robot.safety.governors import FirstCome, KeepApart, Lights, Road, Rule, StopLines, govern
from robot.safety.road_ahead import RoadAhead
from robot.safety.wheel_limits import Drive
from robot.vision.sight import OnnxSight, Seen
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.look import ARENA_POSE, PoseLook
from sim_pybullet.sensing.guidance_feed import ALWAYS, PoseError, PoseSources
from sim_pybullet.tasks.traffic import Traffic
from sim_pybullet.traffic.crowd import Body
from trainer.judging.evaluate import DrivingPolicy, _choose

_RULES = KeepApart(), StopLines(), Lights(), FirstCome()  # pure, as they begin
_REPORT = Telemetry("judge", "AUTO", session="judge")
_SMALL = ImageSpec(40, 30)  # for films: who does not look needs no more


class Driver:
    """Who drives all robots of a world once, from their start; this one never moves."""

    guided = False  # whether it gets a path
    image = _SMALL  # what is drawn for it,
    frames = 1  # of it so many at once
    commands = 0  # of its last ones so many are told
    sources = ALWAYS  # what tells a guided one its place

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:  # noqa: ARG002
        """(N,) numbers of actions, or (N, 2) shares of the greatest wheel speed."""
        return np.zeros((world.n_robots, 2))


class Expert(Driver):
    """Knows where everybody is."""

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:  # noqa: ARG002
        """See `Driver`."""
        return world.expert_actions()


class Pilot(Driver):
    """A policy, greedily."""

    def __init__(self, policy: DrivingPolicy) -> None:
        self._policy = policy
        self.guided, self.image = policy.contract.path_points > 0, ImageSpec()
        self.frames, self.commands = policy.contract.frames, policy.contract.commands

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        choices = np.zeros(world.n_robots, dtype=int)
        for robot in np.flatnonzero(world.active).tolist():
            choices[robot] = _choose(self._policy, seen, robot, None)
        return np.array(self._policy.contract.actions)[choices] / MAX_WHEEL_MPS


@dataclass
class Ruled:
    """One robot's memory in an episode."""

    pose: Pose  # a decision ago
    rules: tuple[Rule, ...]
    told: WheelSpeeds = STILL
    driven_m: float = 0.0

    def moved(self, pose: Pose) -> None:
        """It is there now."""
        self.driven_m += float(np.hypot(pose.x_m - self.pose.x_m, pose.y_m - self.pose.y_m))
        self.pose = pose

    def slowed(self, shares: np.ndarray, now_s: float, ahead: RoadAhead) -> np.ndarray:
        """What the rules allow of the wheel speeds wanted (2,), in shares of the greatest."""
        road = Road(now_s, self.driven_m, max(map(abs, self.told)), ahead)
        self.rules, cap = govern(self.rules, road)
        wanted = WheelSpeeds(*(MAX_WHEEL_MPS * shares).tolist())
        self.told = Drive(wanted, self.told, CONTROL_DT_S, cap).limited(MAX_WHEEL_MPS)
        return np.array(self.told) / MAX_WHEEL_MPS


class _View(LaneView):
    """All robots ask of the same poses, of which each is looked up once."""

    line_ahead_m = lru_cache(maxsize=4096)(LaneView.line_ahead_m)


class _Above:
    """The localizer of one group of bodies; its errors follow from the episode's number."""

    def __init__(self, bodies: int, look: PoseLook, number: int) -> None:
        self._errors, self._rng = PoseError(bodies), np.random.default_rng(number)
        self.believed = np.zeros((bodies, 3))  # where who steers by it takes himself to be
        for body in range(bodies):
            self._errors.reset(body, look, self._rng)

    def tell(self, poses: np.ndarray, now_s: float) -> np.ndarray:
        """(B, 3) what arrives now, of true poses (B, 3)."""
        told, _ = self._errors.observe(poses, now_s, self._rng)
        self.believed = self._errors.of_standing(poses)
        return told


class Governed(Pilot):
    """As `Pilot`, slowed by headway, stop lines, lights and right of way, told of everybody.

    ``poses``: "true" ones are of everybody and of now; those of "arena", one's own among them, are
    as far off, late and missing as `sim_pybullet.look.ARENA_POSE` says.
    """

    def __init__(self, policy: DrivingPolicy, poses: str = "true") -> None:
        super().__init__(policy)
        self._look = ARENA_POSE if poses == "arena" else PoseLook()
        self._robots: list[tuple[Ruled, RoadWatch, Neighbours]] = []
        self._above: list[_Above] = []  # of each group
        self._turns = 0

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        task = world.task
        assert isinstance(task, Traffic)
        shares = super().choose(world, seen)
        self._turns += 1
        now_s, ours = self._turns * CONTROL_DT_S, task.group
        poses = world.poses.reshape(-1, ours, 3)
        bodies = task.crowd.bodies(poses)
        red = task.look(world.poses).red
        if not self._robots:  # all begin their only episode
            views = [_View(m) for m in task.road_maps if isinstance(m, RoadMap)]
            for i, number in enumerate(world.numbers.tolist()):
                view, place = views[world.maps[i]], i % ours
                others = Neighbours(view, _name(place), self._look.position_m)
                robot = Ruled(Pose(*world.poses[i].tolist()), _RULES)
                self._robots.append((robot, RoadWatch(view, others), others))
                if place == 0:
                    self._above.append(_Above(task.crowd.kinds.size, self._look, number))
        there = np.zeros((*bodies.shape[:2], 3))
        there[..., :2], there[:, :ours, 2] = bodies, poses[..., 2]
        told = [above.tell(here, now_s) for above, here in zip(self._above, there, strict=True)]
        heard = [self._messages(poses, task.crowd.kinds, ours, now_s) for poses in told]
        believed = np.array([above.believed[:ours] for above in self._above]).reshape(-1, 3)
        if world.guidance is not None:
            believed = world.guidance.poses
        arc_m = task.paths.project(believed[:, :2], task.paths.index_at(task.course.arc_m)).arc_m
        ways_m = task.paths.points_at(arc_m[:, None] + AHEAD_M)
        for i in np.flatnonzero(world.active).tolist():
            group, place = divmod(i, ours)
            robot, watch, neighbours = self._robots[i]
            robot.moved(Pose(*world.poses[i].tolist()))
            neighbours.hear(heard[group], now_s)
            here = Pose(*believed[i].tolist())
            ahead = watch.look(now_s, robot.driven_m, (here, 0.0), ways_m[i])
            ahead = replace(ahead, red_light=bool(red[group, place]))
            shares[i] = robot.slowed(shares[i], now_s, ahead)
        return shares

    def _messages(
        self, told: np.ndarray, kinds: np.ndarray, ours: int, now_s: float
    ) -> list[PoseMessage]:
        """The poses (B, 3) of one group, as a localizer tells them."""
        stamp = now_s - self._look.delay_s, "judge", self._turns, now_s
        found = []
        for body, (x_m, y_m, heading_rad) in enumerate(told.tolist()):
            if math.isfinite(x_m):
                name = _name(body) if kinds[body] == Body.ROBOT else f"{DUCK}{body}"
                seen_rad = float(wrap_angle(heading_rad)) if body < ours else None
                found.append(PoseMessage(name, x_m, y_m, seen_rad, 1.0, *stamp))
        return found


def _name(place: int) -> str:
    return f"{place:03}"


class Together(Pilot):
    """As `Governed`, without a localizer: robots know their places by pictures and wheels, and tell
    them to each other, as real ones do over the link. Lights they do not see.
    """

    def __init__(self, policy: DrivingPolicy, sight: OnnxSight) -> None:
        super().__init__(policy)
        self.sources = PoseSources("start", sight)
        self._robots: list[tuple[Ruled, RoadWatch]] = []
        self._said: dict[int, Telemetry] = {}  # by each, a decision ago
        self._turns = 0

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        task, known = world.task, world.guidance
        assert isinstance(task, Traffic)
        assert known is not None
        shares = super().choose(world, seen)
        if not self._robots:
            views = [_View(m) for m in task.road_maps if isinstance(m, RoadMap)]
            for i, pose in enumerate(world.poses.tolist()):
                group = range(i - i % task.group, i - i % task.group + task.group)
                reports = {_name(k): partial(self._said.get, k) for k in group if k != i}
                view = views[world.maps[i]]
                watch = RoadWatch(view, Company(view, _name(i), reports), WaySeen())
                self._robots.append((Ruled(Pose(*pose), _RULES), watch))
        self._turns += 1
        now_s, poses = self._turns * CONTROL_DT_S, known.poses.tolist()
        within_m = known.within_m.tolist()
        arc_m = task.paths.project(known.poses[:, :2], task.paths.index_at(task.course.arc_m)).arc_m
        ways_m = task.paths.points_at(arc_m[:, None] + AHEAD_M)
        for i in np.flatnonzero(world.active).tolist():
            robot, watch = self._robots[i]
            robot.moved(Pose(*world.poses[i].tolist()))
            if known.seen is not None:
                watch.saw(Seen(*(part[i : i + 1] for part in known.seen)), robot.driven_m, now_s)
            ahead = watch.look(now_s, robot.driven_m, (Pose(*poses[i]), within_m[i]), ways_m[i])
            shares[i] = robot.slowed(shares[i], now_s, ahead)
        for i, (x_m, y_m, heading_rad) in enumerate(poses):
            sure = Belief(min(within_m[i], FAR_M), 0.0, 0.0, 0.0, "sight")
            said = replace(_REPORT, robot=_name(i), pose=(x_m, y_m, heading_rad), belief=sure)
            self._said[i] = replace(said, sequence=self._turns, t_sent_s=now_s)
        return shares


class Sighted(Pilot):
    """As `Pilot`, by its pictures alone, slowed by headway: a robot without a map."""

    def __init__(self, policy: DrivingPolicy, sight: OnnxSight) -> None:
        super().__init__(policy)
        self._sight = sight
        self._robots: list[tuple[Ruled, WaySeen]] = []  # a robot's `LaneWatch`
        self._turns = 0

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        shares = super().choose(world, seen)
        if not self._robots:
            here = [Pose(*pose) for pose in world.poses.tolist()]
            self._robots = [(Ruled(each, (KeepApart(),)), WaySeen()) for each in here]
        self._turns += 1
        now_s, driving = self._turns * CONTROL_DT_S, np.flatnonzero(world.active)
        newest = preprocess_batch(seen.image[driving, ..., -3:], self._sight.contract.image)
        what = self._sight(newest)
        for k, i in enumerate(driving.tolist()):
            robot, way = self._robots[i]
            robot.moved(Pose(*world.poses[i].tolist()))
            way.see(Seen(*(part[k : k + 1] for part in what)), robot.driven_m, now_s)
            shares[i] = robot.slowed(shares[i], now_s, way.ahead(robot.driven_m, now_s))
        return shares
