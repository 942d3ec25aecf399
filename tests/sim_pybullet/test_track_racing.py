"""The racing task: paper B's reward, collisions, laps, and four stacked frames."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from robot.contract import CONTROL_DT_S, ImageSpec
from robot.errors import ConfigError
from robot.geometry import wrap_angle
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import NOMINAL
from sim_pybullet.motors import PHYSICS_DT_S, PHYSICS_STEPS
from sim_pybullet.racing.track import SCALE, centre_line, load_track, shipped_tracks
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.tasks.track_racing import RACING_ACTIONS, STYLES, Style, TrackRacing
from tests.sim_pybullet.racing.actions import RacingAction

TRACK = load_track("karting")
LINE = centre_line(TRACK)
SMALL = ImageSpec(32, 24, 6)
CALM = replace(NOMINAL, drive=replace(NOMINAL.drive, noise=0.0))
BETA, GAMMA = 0.006, -0.025  # paper B, equation 4
PATIENCE_S = 10.0
NOBODY = np.array([False])
STRAIGHT_M = 2.2  # of the world along the centre line, in the middle of a straight


@pytest.fixture
def world() -> Iterator[BatchWorld]:
    made = BatchWorld(TrackRacing([TRACK], 4), [CALM], SMALL)
    yield made
    made.close()


def test_cars_are_told_their_last_steering_and_throttle() -> None:
    world = BatchWorld(TrackRacing([TRACK], 9), [CALM], SMALL, commands=5)
    world.reset()
    seen = world.step(np.arange(9)).observation.path
    assert seen is not None
    np.testing.assert_array_equal(seen[:, -2:], np.array(RACING_ACTIONS, np.float32))
    world.close()


def place(task: TrackRacing, offset_m: float, turned_rad: float = 0.0) -> np.ndarray:
    """Begin an episode of car 0 at a point of the straight; poses (1, 3)."""
    x_m, y_m, along_rad = LINE.path.pose_at(STRAIGHT_M)
    left = offset_m * np.array((-np.sin(along_rad), np.cos(along_rad)))
    poses = np.array([(x_m + left[0], y_m + left[1], along_rad + turned_rad)])
    task._start(0, LINE.path, 0, STRAIGHT_M, offset_m, turned_rad)
    task._poses = poses
    return poses


@pytest.mark.parametrize(("offset_m", "turned_rad"), [(0.0, 0.0), (0.1, 0.3), (-0.15, -0.5)])
def test_the_reward_is_the_papers(offset_m: float, turned_rad: float) -> None:
    task = TrackRacing([TRACK], 1)
    before = place(task, offset_m, turned_rad)
    speed_mps, heading = 12.0, before[0, 2]
    way_m = speed_mps * CONTROL_DT_S * SCALE
    after = before + np.array((way_m * np.cos(heading), way_m * np.sin(heading), 0.0))
    step = task.step(after, np.array([False]))
    away_m = abs(offset_m + way_m * np.sin(turned_rad)) / SCALE
    wanted = (speed_mps * np.cos(turned_rad) - away_m) * BETA
    assert step.reward[0] == pytest.approx(wanted, rel=1e-6)
    assert step.facts[1, 0] == pytest.approx(speed_mps)
    collision = task.step(after, np.array([True]))
    assert collision.reward[0] == GAMMA
    assert collision.terminated[0]


def test_beyond_the_grass_and_backwards_are_collisions() -> None:
    for offset_m, turned_rad in ((1.2 * (LINE.half_width_m + LINE.verge_m), 0.0), (0.0, 2.0)):
        task = TrackRacing([TRACK], 1)
        step = task.step(place(task, offset_m, turned_rad), np.array([False]))
        assert step.terminated[0]
        assert not step.truncated[0]
        assert step.reward[0] == GAMMA


def test_cars_on_grass_are_told_so() -> None:
    task = TrackRacing([TRACK], 1)
    for offset_m, grass in ((0.0, False), (LINE.half_width_m + 0.02, True)):
        task.step(place(task, offset_m), np.array([False]))
        assert task.vehicle.on_grass[0] == grass


def test_driving_straight_on_ends_at_a_wall(world: BatchWorld) -> None:
    world.reset()
    for _ in range(200):
        step = world.step(np.full(4, RacingAction.STRAIGHT_ACCELERATE))
        if len(step.finished.robots):
            break
    first = step.finished.robots
    assert step.task.terminated[first].all()
    assert not step.task.success[first].any()


def test_a_parked_car_runs_out_of_time() -> None:
    task = TrackRacing([TRACK], 1)
    poses, count, over = place(task, 0.1), 0, False
    while not over:
        step = task.step(poses, np.array([False]))
        assert step.reward[0] < 0.0
        count, over = count + 1, bool(step.truncated[0])
    assert count == pytest.approx(PATIENCE_S / CONTROL_DT_S, abs=1)
    assert not step.success[0]


@pytest.mark.parametrize(("speed_mps", "late_s"), [(3.0, 40.0), (3.5, 80.0)])
def test_who_falls_ten_seconds_behind_a_car_of_4_mps_is_out_of_time(
    speed_mps: float, late_s: float
) -> None:
    """The real track's metres: at 3 m/s it has driven 120 m after 40 s, the other 120 m in 30 s."""
    task = TrackRacing([TRACK], 1, laps=100.0)
    place(task, 0.0)
    path, way_m = LINE.path, speed_mps * CONTROL_DT_S * SCALE
    for count in range(1, 1000):
        arc_m = (STRAIGHT_M + count * way_m) % path.length_m
        if task.step(np.array(path.pose_at(arc_m))[None], np.array([False])).truncated[0]:
            break
    assert count * CONTROL_DT_S == pytest.approx(late_s, abs=0.5)


def test_all_laps_driven_is_a_success() -> None:
    task = TrackRacing([TRACK], 1, laps=0.5)
    place(task, 0.0)
    path = LINE.path
    for share in (0.2, 0.4, 0.499):
        arc_m = (STRAIGHT_M + share * path.length_m) % path.length_m
        assert not task.step(np.array(path.pose_at(arc_m))[None], NOBODY).success[0]
    arc_m = (STRAIGHT_M + 0.501 * path.length_m) % path.length_m
    step = task.step(np.array(path.pose_at(arc_m))[None], NOBODY)
    assert step.success[0]
    assert step.truncated[0]
    assert step.facts[0, 0] == pytest.approx(0.501, abs=0.002)
    crashed = task.step(np.array(path.pose_at(arc_m))[None], ~NOBODY)
    assert not crashed.success[0]
    assert not crashed.truncated[0]


def test_a_track_without_a_wall_ends_half_a_metre_beyond_its_grass() -> None:
    edge_m = LINE.half_width_m + LINE.verge_m
    for beyond_m, over in ((0.4, False), (0.6, True)):  # of the real track
        task = TrackRacing([TRACK], 1)
        step = task.step(place(task, edge_m + beyond_m * SCALE), NOBODY)
        assert bool(step.terminated[0]) is over


def advance(poses: np.ndarray, twists: np.ndarray) -> np.ndarray:
    """Poses (N, 3) after a physics step, nothing in the way."""
    forward, turn = twists.T * PHYSICS_DT_S
    along = poses[:, 2] + 0.5 * turn
    x, y = poses[:, 0] + forward * np.cos(along), poses[:, 1] + forward * np.sin(along)
    return np.stack((x, y, np.asarray(wrap_angle(poses[:, 2] + turn))), axis=1)


@pytest.mark.parametrize("name", shipped_tracks())
def test_the_expert_drives_every_shipped_track(name: str) -> None:
    cars, rng = 8, np.random.default_rng(0)
    task = TrackRacing([load_track(name)], cars)
    poses = task.reset(np.arange(cars), rng)
    for i in range(cars):
        task.vehicle.reset(i, CALM.drive)
    over, speeds = np.zeros(cars, dtype=bool), []
    while not over.all():
        actions = task.vehicle.expert(task.paths, poses, task.course.arc_m)
        for _ in range(PHYSICS_STEPS):
            poses = advance(poses, task.vehicle.step(actions, rng))
        step = task.step(poses, np.zeros(cars, dtype=bool))
        over |= step.success
        assert not (step.terminated | step.truncated & ~step.success)[~over].any()
        speeds.append(step.facts[1].mean())
    assert np.mean(speeds) > 6.0


def test_the_policy_sees_the_last_four_pictures(world: BatchWorld) -> None:
    height, width, _ = SMALL.shape
    assert world.feed.shape == (height, width, 12)
    first = world.reset().image
    for k in range(3):
        np.testing.assert_array_equal(first[..., :3], first[..., 3 * k : 3 * k + 3])
    seen = [first]
    for _ in range(12):
        seen.append(world.step(np.full(4, RacingAction.STRAIGHT_ACCELERATE)).observation.image)
    for older, newer in pairwise(seen):
        np.testing.assert_array_equal(older[..., 3:], newer[..., :-3])
    assert not np.array_equal(seen[-1][..., -3:], seen[-1][..., :3])


def test_a_new_episode_has_no_pictures_of_the_old_one(world: BatchWorld) -> None:
    world.reset()
    for _ in range(400):
        step = world.step(np.full(4, RacingAction.LEFT_ACCELERATE))
        if len(step.finished.robots):
            break
    i = int(step.finished.robots[0])
    image = step.observation.image[i]
    np.testing.assert_array_equal(image[..., :3], image[..., -3:])
    assert not np.array_equal(step.finished.observation.image[0], image)


def test_nonsense_is_refused() -> None:
    for tracks, robots, laps in (([], 1, 1.0), ([TRACK], 0, 1.0), ([TRACK], 1, 0.0)):
        with pytest.raises(ConfigError, match="at least one map"):
            TrackRacing(tracks, robots, laps)


def test_who_cruises_may_drive_beside_the_middle_but_pays_for_turned_wheels() -> None:
    way = np.array((12.0 * CONTROL_DT_S * SCALE, 0.0, 0.0))

    def reward(style: str, offset_m: float, steering: float) -> float:
        task = TrackRacing([TRACK], 1, style=STYLES[style])
        before = place(task, offset_m)
        task.vehicle.steering[:] = steering
        turn = np.array(((np.cos(before[0, 2]), np.sin(before[0, 2]), 0.0),)) * way[0]
        return float(task.step(before + turn, np.array([False])).reward[0])

    assert reward("cruise", 0.15, 0.0) == pytest.approx(reward("race", 0.0, 0.0))
    assert reward("race", 0.0, 1.0) == reward("race", 0.0, 0.0) > reward("race", 0.15, 0.0)
    dearer = reward("cruise", 0.0, 0.0) - reward("cruise", 0.0, -0.5)
    assert dearer == pytest.approx(0.5 * 0.002)


def test_starts_are_spread_over_the_road_and_over_speeds_where_asked() -> None:
    everyone, most_m = np.arange(200), LINE.half_width_m
    for spread, far, turned, speeds in ((1.0, 0.25, 10.0, 0.0), (4.0, 1.0, 40.0, 8.4)):
        task = TrackRacing([TRACK], 200, style=STYLES["cruise"], start_spread=spread)
        task.reset(everyone, np.random.default_rng(0))
        away, course = np.abs(task.course.offset_m), task.course
        assert 0.9 * far * most_m < away.max() <= far * most_m
        assert 0.9 * turned < np.degrees(np.abs(course.heading_error_rad)).max() <= turned
        begun = task.vehicle.starts_mps
        assert 0.0 <= begun.min() <= 0.1 * speeds
        assert 0.9 * speeds <= begun.max() <= speeds


def test_starts_are_all_around_the_track() -> None:
    task = TrackRacing([TRACK], 400)
    task.reset(np.arange(400), np.random.default_rng(0))
    shares = task.course.arc_m / LINE.path.length_m
    assert 0.0 <= shares.min() < 0.01 < 0.99 < shares.max() < 1.0


def test_who_cruises_drives_no_faster_than_the_governor_lets_it() -> None:
    made = BatchWorld(TrackRacing([TRACK], 2, style=STYLES["cruise"]), [CALM], SMALL)
    made.reset()
    speeds = [
        made.step(np.full(2, RacingAction.STRAIGHT_ACCELERATE)).task.facts[1] for _ in range(25)
    ]
    made.close()
    assert 8.0 < np.max(speeds) < 9.0


def test_in_practice_a_track_and_its_mirror_image_are_driven_for_a_twelfth_of_a_lap() -> None:
    spec = find_task("track")
    race = spec.build([TRACK], 2)
    assert isinstance(race, TrackRacing)
    assert (race._laps, len(race.road_maps), race._style) == (1.0, 1, STYLES["race"])
    practice = spec.build([TRACK], 2, Choices(style="cruise", start_spread=4.0))
    assert isinstance(practice, TrackRacing)
    assert (practice._laps, len(practice.road_maps)) == (0.08, 2)
    assert (practice._style, practice._spread) == (STYLES["cruise"], 4.0)
    chosen = spec.build([TRACK], 2, Choices(laps=3.0, start_spread=4.0))
    assert isinstance(chosen, TrackRacing)
    assert chosen._laps == 3.0
    with pytest.raises(ConfigError, match="lane: expected none for the task track"):
        spec.build([TRACK], 1, Choices(lane="outer"))


def test_a_car_that_is_put_down_begins_at_rest() -> None:
    task = TrackRacing([TRACK], 2, style=STYLES["cruise"], start_spread=4.0)
    task.reset(np.arange(2), np.random.default_rng(0))
    pose = np.array([LINE.path.pose_at(STRAIGHT_M)])
    before = task.vehicle.starts_mps.copy()
    task.reset_at(np.array([1]), pose, np.random.default_rng(0))
    assert task.vehicle.starts_mps[1] == 0.0
    assert task.vehicle.starts_mps[0] == before[0] > 0.0
    poses = np.repeat(pose, 2, axis=0)
    assert task.step(poses, np.zeros(2, dtype=bool)).facts[1, 1] == 0.0, "it has not moved"


def test_what_racing_is_to_others() -> None:
    spec = find_task("track")
    assert (spec.map, spec.styles, spec.lanes) == ("forest", ("race", "cruise"), ())
    assert (spec.painted, spec.scale, spec.kind.frames, spec.path_points) == (12, 0.05, 4, 0)
    assert (spec.counts_laps, spec.learned) == (True, True)
    assert STYLES["race"] == Style(1.0, 0.0, 25.0)
    assert STYLES["cruise"] == Style(0.0, 0.002, 8.4)
    fast = {
        **{"image": ImageSpec(48, 36, 4), "net": {"channels": (16, 32), "centred": True}},
        **{"reward_scale": 1.0, "steps": 400_000, "rate_left": 0.1, "entropy_left": 0.0},
        **{"evaluation": {"episodes": 8, "every_steps": 10_000}},
        **{"learn": {"gamma": 0.98, "buffer": 20_000}},
    }
    assert spec.presets == {
        "fast": fast,
        "paper": {"net": {"channels": (32, 64, 64, 64), "centred": True}},
        "cruise": {"start_spread": 4.0, "relit": True},
    }
    assert spec.environments == {
        "TrackRacing-v0": {"pool_size": 10},
        "TrackRacingLooks-v0": {"pool_size": 10, "look": "tracks"},
    }


def test_each_track_has_limits_of_its_own() -> None:
    """Of two tracks without a wall, beside the middle at the mean of how far one may be."""
    tracks = [load_track("forest"), load_track("karting")]
    limits_m = [line.half_width_m + line.verge_m for line in map(centre_line, tracks)]
    offset_m = float(np.mean(limits_m)) + 0.5 * SCALE
    task, ended = TrackRacing(tracks, 1), []
    for number in (0, 1):
        task.reset(np.zeros(1, int), np.random.default_rng(0), number)
        place = centre_line(tracks[number]).path.pose_at(float(task.course.arc_m[0]))
        pose = np.array([(*place.to_world(np.array((0.0, offset_m))), place.heading_rad)])
        ended.append(bool(task.step(pose, np.zeros(1, bool)).terminated[0]))
    assert ended == [limit_m < max(limits_m) for limit_m in limits_m]
    assert sum(ended) == 1
