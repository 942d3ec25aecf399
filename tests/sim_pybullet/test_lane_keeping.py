"""What lane keeping rewards, and how it ends."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import ConfigError, MapError
from robot.navigation.path import lane_loop
from robot.navigation.road_map import load_map
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.spec import (
    Choices,
    TaskSpec,
    find_task,
    learned_tasks,
    register,
)

LOOP = load_map("loop")
HALF_LANE_M = 0.19 * 0.585  # the yellow line begins at 0.18 tiles, the white at 0.193
NOMINAL_STEP_M = 0.03  # straight on at 30 cm/s for a tenth of a second
NOBODY = np.zeros(1, dtype=bool)


def task_at(arc_m: float, laps: float = 2.0) -> LaneKeeping:
    """A task of one robot that begins in the middle of the lane at an arc length."""
    task = LaneKeeping([LOOP], 1, laps=laps)
    task.reset(np.array([0]), np.random.default_rng(0))
    task._start(0, lane_loop(LOOP), 0, arc_m, 0.0, 0.0)
    return task


def beside(arc_m: float, offset_m: float = 0.0, error_rad: float = 0.0) -> np.ndarray:
    """The pose (1, 3) that is off the outer lane by this much."""
    x, y, heading = lane_loop(LOOP).pose_at(arc_m)
    left = offset_m * np.array((-np.sin(heading), np.cos(heading)))
    return np.array([[x + left[0], y + left[1], heading + error_rad]])


def test_starts_are_in_the_lane_and_differ() -> None:
    task = LaneKeeping([LOOP], 200)
    poses = task.reset(np.arange(200), np.random.default_rng(1))
    at = task.paths.project(poses[:, :2])
    np.testing.assert_allclose(at.offset_m, task.course.offset_m, atol=2e-3)
    np.testing.assert_allclose(at.arc_m, task.course.arc_m, atol=0.02)
    assert len(np.unique(task.course.arc_m)) == 200


def test_starts_are_on_both_sides_of_the_lane_and_askew_to_both() -> None:
    task = LaneKeeping([LOOP], 400)
    task.reset(np.arange(400), np.random.default_rng(1))
    for seen, most in (
        (task.course.offset_m, 0.25 * HALF_LANE_M),
        (task.course.heading_error_rad, np.radians(10.0)),
    ):
        assert -most <= seen.min() < -0.95 * most
        assert 0.95 * most < seen.max() <= most
        assert abs(np.median(seen)) < 0.15 * most


def test_starts_are_all_around_the_ring() -> None:
    task = LaneKeeping([LOOP], 400)
    task.reset(np.arange(400), np.random.default_rng(1))
    quarters = np.histogram(task.course.arc_m, 4, (0.0, lane_loop(LOOP).length_m))[0]
    assert quarters.sum() == 400
    assert quarters.min() > 70


@settings(deadline=None, max_examples=30)
@given(arc_m=st.floats(0.0, 9.0), offset=st.floats(-0.9, 0.9), error_rad=st.floats(-1.4, 1.4))
def test_at_full_speed_the_reward_is_the_papers(
    arc_m: float, offset: float, error_rad: float
) -> None:
    step = task_at(arc_m).step(
        beside(arc_m + 1.5 * NOMINAL_STEP_M, offset * HALF_LANE_M, error_rad), NOBODY
    )
    expected = -5.0 * abs(offset) + 5.0 * np.cos(error_rad)
    assert step.reward[0] == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("offset", [0.0, 0.5, 0.99])
def test_parked_never_earns_and_the_same_drive_does(offset: float) -> None:
    parked, driving = task_at(1.0), task_at(1.0)
    parked.step(beside(1.0, offset * HALF_LANE_M), NOBODY)
    stays = parked.step(beside(1.0, offset * HALF_LANE_M), NOBODY)
    drives = driving.step(beside(1.0 + NOMINAL_STEP_M, offset * HALF_LANE_M), NOBODY)
    assert stays.reward[0] <= 0.0 < drives.reward[0] - stays.reward[0]


def test_driving_back_is_worse_than_parking() -> None:
    back, parked = task_at(1.0), task_at(1.0)
    error = 1.7  # wrong way, not yet lost
    assert (
        back.step(beside(0.97, 0.0, error), NOBODY).reward < parked.step(beside(1.0), NOBODY).reward
    )


@pytest.mark.parametrize(
    ("offset", "error_deg", "collided", "fails"),
    [
        (0.9, 0.0, False, False),
        (1.1, 0.0, False, True),
        (-1.1, 0.0, False, True),
        (0.0, 95.0, False, False),
        (0.0, -105.0, False, True),
        (0.0, 0.0, True, True),
    ],
)
def test_terminates_off_the_lane_lost_or_in_collision(
    offset: float, error_deg: float, collided: bool, fails: bool
) -> None:
    pose = beside(2.0, offset * HALF_LANE_M, np.radians(error_deg))
    step = task_at(2.0).step(pose, np.array([collided]))
    assert bool(step.terminated[0]) is fails
    assert not step.truncated[0]
    assert not step.success[0]


def test_laps_end_an_episode_with_success() -> None:
    task, length_m = task_at(9.0, laps=0.5), lane_loop(LOOP).length_m
    arcs = 9.0 + NOMINAL_STEP_M * np.arange(1, 1 + round(0.5 * length_m / NOMINAL_STEP_M) + 2)
    steps = [task.step(beside(arc % length_m), NOBODY) for arc in arcs]
    first = next(i for i, step in enumerate(steps) if step.success[0])
    assert steps[first].truncated[0]
    assert not steps[first].terminated[0]
    assert steps[first].facts[0, 0] == pytest.approx(0.5, abs=0.01)
    assert len(steps) - 4 <= first < len(steps)


def test_dawdling_ends_without_success() -> None:
    task = task_at(1.0, laps=0.1)
    for _ in range(1000):
        step = task.step(beside(1.0), NOBODY)
        if step.truncated[0]:
            break
    assert step.truncated[0]
    assert not step.success[0]


def test_each_episode_is_on_one_of_the_maps() -> None:
    inner = LaneKeeping([LOOP, LOOP], 64, "inner")
    inner.reset(np.arange(64), np.random.default_rng(0))
    assert set(inner.maps) == {0, 1}
    lengths = [LaneKeeping([LOOP], 1, lane).paths.length_m[0] for lane in ("outer", "inner")]
    assert lengths[0] > lengths[1]


def test_both_lanes_are_driven_on_every_map_each_its_own_way() -> None:
    ring = load_map("rings/pretzel")
    task = LaneKeeping([LOOP, ring], 80, "both")
    task.reset(np.arange(80), np.random.default_rng(0))
    lengths = {
        (m, round(float(length), 3))
        for m, length in zip(task.maps, task.paths.length_m, strict=True)
    }
    assert len(lengths) == 4
    for road_map, shown in ((LOOP, 0), (ring, 1)):
        outer, inner = lane_loop(road_map), lane_loop(road_map, outer=False)
        assert (shown, round(outer.length_m, 3)) in lengths
        assert (shown, round(inner.length_m, 3)) in lengths
        turned = [np.sum(np.diff(np.unwrap(each.headings_rad))) for each in (outer, inner)]
        assert turned[0] > 5.5  # left round the ring
        assert turned[1] < -5.5  # right round it


def test_training_rings_bend_both_ways() -> None:
    for name in ("bean", "pretzel", "turtle", "wedge", "zigzag"):
        for outer in (True, False):
            bends = np.diff(np.unwrap(lane_loop(load_map(f"rings/{name}"), outer).headings_rad))
            assert bends[bends > 0.02].sum() > 1.4
            assert bends[bends < -0.02].sum() < -1.4


def test_refuses_nothing_to_do_and_roads_that_are_no_ring() -> None:
    with pytest.raises(ConfigError, match="at least one map"):
        LaneKeeping([], 1)
    with pytest.raises(ConfigError, match="lane: unknown 'middle'; valid: both, inner, outer"):
        LaneKeeping([LOOP], 1, "middle")
    with pytest.raises(MapError, match="ring of road"):
        LaneKeeping([load_map("town")], 1)


def test_how_long_an_episode_is() -> None:
    def laps(task: str, **chosen: Any) -> float:
        built = find_task(task).build([LOOP], 1, Choices(**chosen))
        assert isinstance(built, LaneKeeping)
        return built._laps

    assert (laps("lane"), laps("lane", laps=7.0), laps("four_laps")) == (2.0, 7.0, 4.0)
    assert laps("hundred_laps") == 100.0
    assert laps("lane", start_spread=2.5) == 0.5, "in practice more places for as many decisions"
    assert laps("lane", start_spread=2.5, laps=1.5) == 1.5


def test_the_lane_that_is_asked_for() -> None:
    def lengths(**chosen: Any) -> float:
        return float(find_task("lane").build([LOOP], 1, Choices(**chosen)).paths.length_m[0])

    outer, inner = (lane_loop(LOOP, outer=side).length_m for side in (True, False))
    assert lengths() == lengths(lane="outer") == pytest.approx(outer)
    assert lengths(lane="inner") == pytest.approx(inner)
    with pytest.raises(ConfigError, match="style: expected none for the task lane, got 'race'"):
        find_task("lane").build([LOOP], 1, Choices(style="race"))


def test_training_starts_farther_off() -> None:
    task = find_task("lane").build([LOOP], 300, Choices(start_spread=3.0))
    task.reset(np.arange(300), np.random.default_rng(1))
    assert 0.7 * HALF_LANE_M < np.abs(task.course.offset_m).max() <= 0.75 * HALF_LANE_M
    assert 28.0 < np.degrees(np.abs(task.course.heading_error_rad)).max() <= 30.0


def test_numbered_episodes_take_maps_and_lanes_in_turn() -> None:
    ring = load_map("rings/pretzel")
    task, rng = LaneKeeping([LOOP, ring], 1, "both"), np.random.default_rng(0)
    found = []
    for number in range(5):
        task.reset(np.array([0]), rng, number)
        found.append((int(task.maps[0]), float(task.paths.length_m[0])))
    loops = [
        (m, lane_loop(r, outer=o).length_m)
        for o in (True, False)
        for m, r in ((0, LOOP), (1, ring))
    ]
    assert [m for m, _ in found] == [0, 1, 0, 1, 0]
    assert [length for _, length in found] == pytest.approx(
        [each for _, each in (*loops, loops[0])]
    )


def test_an_episode_may_take_twice_as_long_as_at_full_speed() -> None:
    task, steps = task_at(1.0, laps=0.1), 0
    while not task.step(beside(1.0), NOBODY).truncated[0]:
        steps += 1
    wanted = 2.0 * 0.1 * lane_loop(LOOP).length_m / NOMINAL_STEP_M
    assert steps == pytest.approx(wanted, abs=1.0)


@pytest.mark.parametrize(
    ("offset", "turned_deg", "fits"),
    [
        (0.0, 0.0, True),
        (0.95, 0.0, True),
        (-1.05, 0.0, False),
        (0.0, 97.0, True),
        (0.0, -103.0, False),
    ],
)
def test_a_robot_may_be_put_into_its_lane(offset: float, turned_deg: float, fits: bool) -> None:
    task, pose = LaneKeeping([LOOP], 2), beside(2.0, offset * HALF_LANE_M, np.radians(turned_deg))
    if fits:
        task.reset_at(np.array([1]), pose, np.random.default_rng(0))
        assert task.maps.tolist() == [0, 0]
        assert task.course.arc_m[1] == pytest.approx(2.0, abs=5e-3)
        assert task.course.offset_m[1] == pytest.approx(offset * HALF_LANE_M, abs=1e-3)
        assert np.degrees(task.course.heading_error_rad[1]) == pytest.approx(turned_deg, abs=0.5)
        assert task.course.travelled_m[1] == 0.0
    else:
        with pytest.raises(ConfigError, match=r"pose: expected one within 0\.11 m and 1\.75 rad"):
            task.reset_at(np.array([1]), pose, np.random.default_rng(0))


def test_a_pose_says_which_of_both_lanes() -> None:
    task = LaneKeeping([LOOP], 1, "both")
    for outer in (True, False):
        lane = lane_loop(LOOP, outer=outer)
        pose = np.array([lane.pose_at(3.0)])
        task.reset_at(np.array([0]), pose, np.random.default_rng(0))
        assert task.paths.length_m[0] == pytest.approx(lane.length_m)
    with pytest.raises(ConfigError, match="expected to drive on one map, got 2"):
        LaneKeeping([LOOP, LOOP], 1).reset_at(np.array([0]), pose, np.random.default_rng(0))


def test_what_lane_keeping_is_to_others() -> None:
    spec = find_task("lane")
    assert (spec.map, spec.lanes, spec.styles) == ("loop", ("outer", "inner", "both"), ())
    assert (spec.path_points, spec.kind.frames, spec.painted, spec.scale) == (0, 1, 48, 1.0)
    assert (spec.counts_laps, spec.learned, len(spec.actions)) == (True, True, 5)
    assert spec.presets == {"paper": {"net": {"image_fc": 512}}}
    assert spec.environments == {
        "LaneKeeping-v0": {},
        "LaneKeepingInner-v0": {"lane": "inner"},
        "LaneKeepingRandomised-v0": {"look": "randomised"},
    }
    told = [(name, row.learned, row.trained) for name, row in spec.paper.items()]
    assert told == [
        ("ddqn", "about 10,000", "2 M"),
        ("dueling", "within 1 M", "2 M"),
        ("a2c", "never steadily", "longer than the others"),
        ("ppo", "250,000 (steady from 550,000)", "not given"),
    ]
    four, hundred = find_task("four_laps"), find_task("hundred_laps")
    for each in (four, hundred):
        assert (each.learned, each.counts_laps, each.lanes) == (False, False, spec.lanes)
    with pytest.raises(ConfigError, match="task: unknown 'four_laps'"):
        find_task("four_laps", to_learn=True)
    with pytest.raises(ConfigError, match="did you mean 'lane'"):
        find_task("lanes")
    with pytest.raises(ConfigError, match="got 'lane' again"):
        register(spec)
    assert four not in learned_tasks()
    assert spec in learned_tasks()
    usual = TaskSpec("x", "X", "", LaneKeeping, "loop")
    assert (usual.painted, usual.scale, usual.counts_laps, usual.learned) == (48, 1.0, False, True)
    assert Choices() == Choices(None, None, None, 1.0)
