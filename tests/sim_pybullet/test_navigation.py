"""What navigation asks for, rewards, and how it ends."""

import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import ConfigError, MapError, PlanError
from robot.geometry import Pose
from robot.navigation.path import Path
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.navigation import Navigation, RandomRoutes
from sim_pybullet.tasks.spec import Choices, find_task
from tests.robot.navigation.test_closed_lanes import with_barrier
from tests.sim_pybullet.flat_camera import PoseCamera

ARENA = load_map("arena")
HALF_LANE_M = 0.19 * 0.44
NOMINAL_STEP_M = 0.03
ARRIVAL_M = 0.05
OFF_PATH_M = 0.25 * 0.44
NOBODY = np.zeros(1, dtype=bool)


def mission(seed: int = 0, remaining_m: float | None = None) -> tuple[Navigation, Path]:
    """A task of one robot that begins on its path, at its start or near its end, and the path."""
    path = RandomRoutes(ARENA).draw(np.random.default_rng(seed))
    task = Navigation([ARENA], 1)
    task.reset(np.array([0]), np.random.default_rng(0))
    arc_m = 0.0 if remaining_m is None else path.length_m - remaining_m
    task._start(0, path, 0, arc_m, 0.0, 0.0)
    task._lengths_m[0] = path.length_m
    return task, path


def beside(path: Path, arc_m: float, offset_m: float = 0.0, error_rad: float = 0.0) -> np.ndarray:
    """The pose (1, 3) that is off the path by this much."""
    x, y, heading = path.pose_at(arc_m)
    left = offset_m * np.array((-np.sin(heading), np.cos(heading)))
    return np.array([[x + left[0], y + left[1], heading + error_rad]])


def test_navigators_are_guided_and_see_one_picture() -> None:
    assert Navigation.guided
    assert Navigation.frames == 1


def test_starts_are_at_the_beginnings_of_long_enough_paths() -> None:
    task = Navigation([ARENA, load_map("town")], 100)
    poses = task.reset(np.arange(100), np.random.default_rng(1))
    assert set(task.maps) == {0, 1}
    sizes_m = np.array([task.road_maps[m].tile_size_m for m in task.maps])
    assert np.all(task.paths.length_m >= 3.0 * sizes_m)
    for pose, m in zip(poses, task.maps, strict=True):
        assert task.road_maps[m].on_road(*pose[:2])
    at = task.paths.project(poses[:, :2], np.zeros(100, dtype=int))
    assert at.arc_m.max() < 0.05
    assert np.abs(at.offset_m).max() < 0.25 * 0.19 * sizes_m.max() + 2e-3


def test_training_starts_farther_off_and_still_in_the_lane() -> None:
    def offsets(spread: float) -> np.ndarray:
        task = Navigation([ARENA], 100, spread)
        poses = task.reset(np.arange(100), np.random.default_rng(1))
        return task.paths.project(poses[:, :2], np.zeros(100, dtype=int)).offset_m

    assert np.abs(offsets(1.0)).max() < 0.25 * HALF_LANE_M + 2e-3
    assert 0.5 * HALF_LANE_M < np.abs(offsets(2.5)).max() < HALF_LANE_M


def test_starts_and_destinations_cover_all_tiles() -> None:
    routes, rng = RandomRoutes(ARENA), np.random.default_rng(0)
    paths = [routes.draw(rng) for _ in range(400)]
    for end in (0, -1):
        tiles = {tuple((path.points_m[end] // ARENA.tile_size_m).astype(int)) for path in paths}
        assert len(tiles) == len(ARENA.road_tiles)


def test_an_arrival_is_a_success_and_cut_off_not_terminal() -> None:
    task, path = mission(remaining_m=0.1)
    before = ARRIVAL_M + 0.005
    assert not task.step(beside(path, path.length_m - before), NOBODY).success[0]
    step = task.step(beside(path, path.length_m - 0.9 * ARRIVAL_M), NOBODY)
    assert step.success[0]
    assert step.truncated[0]
    assert not step.terminated[0]
    assert step.facts[0, 0] == pytest.approx(0.9 * ARRIVAL_M, abs=2e-3)


def test_driving_past_the_destination_in_one_step_is_an_arrival() -> None:
    task, path = mission(remaining_m=0.06)
    assert task.step(beside(path, path.length_m + 0.02), NOBODY).success[0]


def test_a_path_that_ends_where_it_begins_is_not_done_at_its_start() -> None:
    """A destination behind the robot: the whole way round lies ahead."""
    routes, rng = RandomRoutes(ARENA), np.random.default_rng(0)
    path = next(
        path
        for path in iter(lambda: routes.draw(rng), None)
        if np.hypot(*(path.points_m[0] - path.points_m[-1])) < 0.05
    )
    task, _ = mission()
    task._start(0, path, 0, 0.0, 0.0, 0.0)
    task._lengths_m[0] = path.length_m
    step = task.step(beside(path, 0.0), NOBODY)
    assert not step.success[0]
    assert task.course.arc_m[0] < 0.05


@pytest.mark.parametrize(
    ("offset", "error_deg", "collided", "fails"),
    [
        (0.9, 0.0, False, False),
        (-1.1, 0.0, False, True),
        (0.0, 95.0, False, False),
        (0.0, 105.0, False, True),
        (0.0, 0.0, True, True),
    ],
)
def test_terminates_off_the_path_lost_or_in_collision(
    offset: float, error_deg: float, collided: bool, fails: bool
) -> None:
    task, path = mission()
    pose = beside(path, 0.3, offset * OFF_PATH_M, np.radians(error_deg))
    step = task.step(pose, np.array([collided]))
    assert bool(step.terminated[0]) is fails
    assert not step.truncated[0]


def test_dawdling_ends_without_success() -> None:
    task, path = mission()
    steps = 0
    while not (step := task.step(beside(path, 0.1), NOBODY)).truncated[0]:
        steps += 1
    assert not step.success[0]
    assert steps == pytest.approx(2.0 * path.length_m / NOMINAL_STEP_M, abs=1)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 50), offset=st.floats(-0.9, 0.9), error_rad=st.floats(-1.4, 1.4))
def test_at_full_speed_the_reward_is_the_papers(seed: int, offset: float, error_rad: float) -> None:
    task, path = mission(seed)
    straight = next(a for a in np.arange(0.1, 9.0, 0.1) if _is_straight(path, a))
    task.step(beside(path, straight), NOBODY)
    pose = beside(path, straight + 1.05 * NOMINAL_STEP_M, offset * HALF_LANE_M, error_rad)
    expected = -5.0 * abs(offset) + 5.0 * np.cos(error_rad)
    assert task.step(pose, NOBODY).reward[0] == pytest.approx(expected, abs=0.05)


def _is_straight(path: Path, arc_m: float) -> bool:
    turn = np.diff([path.pose_at(arc_m + d).heading_rad for d in (0.0, 0.1)])[0]
    return bool(abs(turn) < 1e-3)


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_the_expert_arrives(name: str) -> None:
    count = 60
    world = BatchWorld(Navigation([load_map(name)], count), [NOMINAL], camera=PoseCamera(count))
    world.reset()
    pending = np.ones(count, dtype=bool)
    while pending.any():
        step = world.step(world.expert_actions())
        ended = step.finished.robots
        assert np.all(step.task.success[ended] | ~pending[ended])
        pending[ended] = False
    world.close()


def test_refuses_nothing_to_do() -> None:
    with pytest.raises(ConfigError, match="at least one map"):
        Navigation([], 1)
    with pytest.raises(ConfigError, match="one robot"):
        Navigation([ARENA], 0)


def test_refuses_a_map_with_no_long_route(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "short.yaml"
    file.write_text("tiles:\n- [straight/E, straight/E]\ntile_size: 0.585\n")
    with pytest.raises(MapError, match="tiles of road apart"):
        Navigation([load_map(file)], 1)


def test_every_tile_begins_and_ends_as_many_missions() -> None:
    """A crossing has twelve lanes, a straight road two; which is driven into counts for neither."""
    routes, rng = RandomRoutes(ARENA), np.random.default_rng(0)
    paths = [routes.draw(rng) for _ in range(1500)]
    assert min(path.length_m for path in paths) >= 3.0 * 0.44
    counts: dict[tuple[int, ...], int] = {}
    for path in paths:
        tile = tuple((path.points_m[0] // ARENA.tile_size_m).astype(int))
        counts[tile] = counts.get(tile, 0) + 1
    even = 1500 / len(ARENA.road_tiles)
    assert 0.5 * even < min(counts.values()) <= max(counts.values()) < 1.7 * even


def test_a_mission_from_a_place_begins_there() -> None:
    routes, rng = RandomRoutes(ARENA), np.random.default_rng(0)
    begin = Pose(2.07, 0.6, np.pi / 2.0)
    for _ in range(5):
        path = routes.draw(rng, begin)
        np.testing.assert_allclose(path.points_m[0], (2.07, 0.6), atol=2e-3)
        assert path.length_m >= 3.0 * 0.44
    with pytest.raises(PlanError, match="start on the road"):
        routes.draw(rng, Pose(0.7, 0.7, 0.0))
    task = Navigation([ARENA], 2)
    task.reset_at(np.array([1]), np.array([begin]), rng)
    assert task.course.arc_m[1] == pytest.approx(0.0, abs=5e-3)


def test_what_navigation_is_to_others() -> None:
    spec = find_task("navigation")
    assert (spec.map, spec.painted, spec.path_points, spec.kind.frames) == ("arena", 144, 10, 1)
    assert (spec.learned, spec.counts_laps, spec.lanes) == (True, False, ())
    evaluation = {"episodes": 60, "rounds": 3, "every_steps": 8_000, "every_share": 0.25}
    fast = {"steps": 24_000, "start_spread": 4.0, "rate_left": 0.03}
    fast["evaluation"] = {**evaluation, "stop_after_perfect": 0}  # type: ignore[assignment]
    assert spec.presets == {"fast": fast}
    told = {name: (row.trained, row.driving) for name, row in spec.paper.items()}
    assert told == {"dueling": ("1.5 M", "96.4 % of 1000"), "ppo": ("3 M", "66 % of 1000")}
    assert spec.environments == {
        "Navigation-v0": {"pose_error": "none"},
        "NavigationArenaPose-v0": {"pose_error": "arena"},
    }
    built = spec.build([ARENA], 3, Choices(start_spread=2.0))
    assert isinstance(built, Navigation)
    assert (built.n_robots, built._spread) == (3, 2.0)
    with pytest.raises(ConfigError, match="laps: expected none for the task navigation"):
        spec.build([ARENA], 1, Choices(laps=1.0))


def test_nobody_begins_beside_a_thing() -> None:
    ring, at = with_barrier("loop", 4)
    task, rng = LaneKeeping([ring], 1, "both"), np.random.default_rng(0)
    for _ in range(200):
        (pose,) = task.reset(np.array([0]), rng)
        assert np.hypot(*(pose[:2] - at)) > 0.25
    town, at = with_barrier("town", 10)
    routes = RandomRoutes(town)
    for _ in range(30):
        away = np.hypot(*(routes.draw(rng).points_m - at).T)
        assert away.min() > 0.05
