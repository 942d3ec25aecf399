"""The task ``traffic``: what ends an episode, whose fault it is, what it is worth."""

from pathlib import Path

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchStep, BatchWorld
from sim_pybullet.look import NOMINAL
from sim_pybullet.rendering.ray_camera import NoCamera
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.tasks.traffic import Traffic
from sim_pybullet.traffic.scenario import Scenario, load_scenario

SLOW, STOP = 5, 6
SMALL = ImageSpec(40, 30, 10)


def world_of(task: Traffic, numbers: range | None = None, pictures: bool = False) -> BatchWorld:
    camera = None if pictures else NoCamera()
    image = SMALL if pictures else None
    return BatchWorld(task, [NOMINAL], image, 1, 1, camera, numbers=numbers)


def traffic(robots: int = 1, **how: object) -> Traffic:
    return Traffic([load_map("loop")], robots, Scenario(**how))  # type: ignore[arg-type]


def facts(world: BatchWorld, step: BatchStep, robot: int = 0) -> dict[str, float]:
    names = world.task.fact_names
    return dict(zip(names, step.task.facts[:, robot].tolist(), strict=True))


def test_its_actions_are_the_five_slow_and_stop() -> None:
    spec = find_task("traffic")
    assert len(spec.actions) == 7
    assert spec.actions[SLOW] == (0.12, 0.12)
    assert spec.actions[STOP] == (0.0, 0.0)
    assert spec.kind.frames == 3


def test_standing_still_earns_nothing() -> None:
    world = world_of(traffic(4))
    world.reset()
    total = sum(world.step(np.full(4, STOP)).reward for _ in range(50))
    assert (total <= 0.0).all()
    driven = world_of(traffic(4))
    driven.reset()
    assert (sum(driven.step(driven.expert_actions()).reward for _ in range(50)) > 50.0).all()


def test_who_stands_for_a_minute_has_not_done_the_task() -> None:
    world = world_of(traffic(), range(1))
    world.reset()
    steps = [world.step(np.full(1, STOP)) for _ in range(600)]
    assert [bool(step.task.truncated[0]) for step in steps] == [False] * 599 + [True]
    assert not steps[-1].task.success[0]
    assert not world.active.any()


@pytest.mark.parametrize("name", ["lfp", "lfv", "mixed"])
def test_the_expert_drives_among_them(name: str) -> None:
    task = Traffic([load_map("loop")], 4, load_scenario(name))
    world = world_of(task, range(4))
    world.reset()
    for _ in range(300):
        step = world.step(world.expert_actions())
        assert not step.task.terminated.any()
    assert (step.task.facts[0] > 5.0).all()


def test_eight_robots_of_ours_share_a_town_and_meet_nobody() -> None:
    spec = find_task("traffic_junctions")
    task = spec.build([load_map("town")], 8)
    world = world_of(task, range(8))  # type: ignore[arg-type]
    world.reset()
    assert task.guided
    assert (world.maps == world.maps[0]).all()
    for _ in range(250):
        step = world.step(world.expert_actions())
        assert not step.task.terminated.any()
    assert (step.task.facts[0] > 4.0).all()


@pytest.mark.parametrize(
    ("ahead_m", "moves_m", "whom", "fault"),
    [
        (0.16, 0.03, 2, 1),  # drives into it
        (-0.1, 0.03, 2, 0),  # it is behind
        (0.13, 0.0, 2, 0),  # stands, and the other has come
        (0.2, 0.03, 0, 0),
    ],
)
def test_whose_fault_a_collision_is(ahead_m: float, moves_m: float, whom: int, fault: int) -> None:
    task = traffic(robots_parked=("parked",))
    (pose,) = task.reset(np.array([0]), np.random.default_rng(0))
    ahead = np.array((np.cos(pose[2]), np.sin(pose[2]), 0.0))
    task.crowd.parked[0, 0] = pose + ahead_m * ahead
    step = task.step((pose + moves_m * ahead)[None], np.zeros(1, dtype=bool))
    assert step.facts[1:3, 0].tolist() == [whom, fault]
    assert bool(step.terminated[0]) == (whom > 0)
    assert (step.terms[-1, 0] < 0.0) == bool(fault)


def beside_it(ahead_m: float, who: str) -> tuple[Traffic, np.ndarray, np.ndarray]:
    """A robot in the middle of its lane, with a duck or a parked robot so far ahead of it."""
    task = traffic(robots_parked=("parked",), nduckies=1, delta_y_m=0.0, theta_tol_deg=0.0)
    (pose,) = task.reset(np.array([0]), np.random.default_rng(0))
    ahead = np.array((np.cos(pose[2]), np.sin(pose[2]), 0.0))
    task.crowd.parked[:] = task.crowd.ducks.poses[:] = np.nan
    poses = task.crowd.parked if who == "robot" else task.crowd.ducks.poses
    poses[0, 0] = pose + ahead_m * ahead
    return task, pose, ahead


@pytest.mark.parametrize(
    ("who", "apart_m", "whom"),
    [("duck", 0.099, 1), ("duck", 0.101, 0), ("robot", 0.149, 2), ("robot", 0.151, 0)],
)
def test_how_near_a_duck_and_a_robot_are_met(who: str, apart_m: float, whom: int) -> None:
    task, pose, _ = beside_it(apart_m, who)
    step = task.step(pose[None], np.zeros(1, dtype=bool))
    assert step.facts[1, 0] == whom
    assert bool(step.terminated[0]) == task.met[0] == (whom > 0)


@pytest.mark.parametrize(("moves_m", "fault"), [(0.0015, 0), (0.0025, 1)])
def test_who_is_slower_than_two_centimetres_a_second_stands(moves_m: float, fault: int) -> None:
    task, pose, ahead = beside_it(0.14, "robot")
    step = task.step((pose + moves_m * ahead)[None], np.zeros(1, dtype=bool))
    assert step.facts[1:3, 0].tolist() == [2, fault]
    assert step.terms[-1, 0] == -20.0 * fault


def test_against_a_thing_it_is_at_fault_also_where_it_stands() -> None:
    task, pose, _ = beside_it(0.9, "robot")
    step = task.step(pose[None], np.ones(1, dtype=bool))
    assert step.facts[1:3, 0].tolist() == [3, 1]


def test_of_two_the_nearer_is_who_was_met() -> None:
    task, pose, ahead = beside_it(0.12, "robot")
    task.crowd.ducks.poses[0, 0] = pose + 0.09 * ahead
    assert task.step(pose[None], np.zeros(1, dtype=bool)).facts[1, 0] == 1


def test_driving_on_costs_more_the_nearer_somebody_is_and_standing_nothing() -> None:
    """Within 0.3 m of free way; at full speed four where none is left."""
    for apart_m, cost in ((0.43, 0.8), (0.34, 2.0), (0.28, 2.4)):  # free in steps of 4 cm
        task, pose, ahead = beside_it(apart_m, "robot")
        drives = task.step((pose + 0.03 * ahead)[None], np.zeros(1, dtype=bool))
        assert drives.terms[2, 0] == pytest.approx(
            -4.0 * (1.0 - drives.facts[3, 0] / 0.3), abs=0.01
        )
        assert drives.terms[2, 0] == pytest.approx(-cost, abs=0.6)
        stands = task.step((pose + 0.03 * ahead)[None], np.zeros(1, dtype=bool))
        assert stands.terms[2, 0] == pytest.approx(0.0, abs=1e-9)


def test_the_least_time_to_a_collision_is_kept_for_an_episode() -> None:
    task, pose, ahead = beside_it(0.35, "robot")
    told = []
    for way_m in (0.0, 0.03, 0.06, 0.06, 0.06):
        step = task.step((pose + way_m * ahead)[None], np.zeros(1, dtype=bool))
        told.append(step.facts[4, 0])
    assert told[0] == 60.0
    assert told[2] == told[3] == told[4] < 1.0
    task.reset_at(np.array([0]), pose[None], np.random.default_rng(0))
    task.crowd.parked[:] = task.crowd.ducks.poses[:] = np.nan
    assert task.step(pose[None], np.zeros(1, dtype=bool)).facts[4, 0] == 60.0


@pytest.mark.parametrize(("leads_m", "ttc_s"), [(0.03, 60.0), (0.01, (0.33 - 0.15) / 0.2)])
def test_who_drives_on_ahead_is_met_later_or_never(leads_m: float, ttc_s: float) -> None:
    how = {"robots_pcs": ("a", "b"), "delta_y_m": 0.0, "theta_tol_deg": 0.0}
    task = traffic(2, **how)
    (pose, _) = task.reset(np.arange(2), np.random.default_rng(0))
    ahead = np.array((np.cos(pose[2]), np.sin(pose[2]), 0.0))
    poses = np.stack((pose, pose + 0.35 * ahead))
    task._poses[:] = poses
    for _ in range(2):
        poses = poses + np.array(((0.03,), (leads_m,))) * ahead
        step = task.step(poses, np.zeros(2, dtype=bool))
        if ttc_s < 60.0:
            break
    assert step.facts[4, 0] == pytest.approx(ttc_s, abs=0.01)


@pytest.mark.parametrize(("tiles", "success"), [(2.9, False), (3.05, True)])
def test_three_tiles_in_a_minute_are_what_was_asked(tiles: float, success: bool) -> None:
    task, pose, _ = beside_it(0.9, "robot")
    task.course = task.course._replace(travelled_m=np.full(1, 0.585 * tiles))
    task._steps[:] = 599
    step = task.step(pose[None], np.zeros(1, dtype=bool))
    assert step.truncated[0]
    assert bool(step.success[0]) is success
    assert step.facts[0, 0] == pytest.approx(tiles)


@pytest.mark.parametrize("ahead_m", [0.31, 0.33, 0.35])
def test_the_time_to_a_collision_is_as_long_as_the_way_there(ahead_m: float) -> None:
    task = traffic(robots_parked=("parked",), delta_y_m=0.0, theta_tol_deg=0.0)
    (pose,) = task.reset(np.array([0]), np.random.default_rng(0))
    ahead = np.array((np.cos(pose[2]), np.sin(pose[2]), 0.0))
    task.crowd.parked[0, 0] = pose + ahead_m * ahead
    task.step((pose + 0.03 * ahead)[None], np.zeros(1, dtype=bool))
    step = task.step((pose + 0.06 * ahead)[None], np.zeros(1, dtype=bool))
    least_ttc_s = step.facts[task.fact_names.index("least_ttc_s"), 0]
    assert least_ttc_s == pytest.approx((ahead_m - 0.06 - 0.15) / 0.3, abs=0.01)


def test_cars_that_obey_nobody_and_sleep_drive_through_nobody() -> None:
    npcs = tuple(f"npc{k}" for k in range(7))
    how = {"robots_npcs": npcs, "npc_obeying": 0.0, "npc_mistakes_per_min": 30.0, "min_dist": 0.3}
    task = Traffic([load_map("town")], 3, Scenario(**how))  # type: ignore[arg-type]
    world = world_of(task, range(3))
    world.reset()
    stood = 0
    for _ in range(200):
        world.step(np.full(3, STOP))
        xy_m = task.crowd.bodies(task._grouped(world.poses))
        apart = np.linalg.norm(xy_m[:, :, None] - xy_m[:, None], axis=-1) + np.eye(8)
        assert apart.min() > 0.134
        stood += int((apart < 0.15).any(axis=(1, 2)).sum())
    assert stood > 0, "nobody met anybody"


NAMED = """
tile_size: 0.585
tiles:
- [curve_left/W, straight/W, curve_left/N]
- [straight/S, grass, straight/N]
- [3way_left/S, straight/E, 3way_left/N]
- [straight/S, grass, straight/N]
- [curve_left/S, straight/E, curve_left/E]
objects:
  walks: {kind: duckie, pos: [1.5, 0.05], rotate: 270, height: 0.08, static: false}
  stands: {kind: duckie, pos: [1.5, 4.95], rotate: 90, height: 0.08}
  drives: {kind: duckiebot, pos: [2.7, 3.5], rotate: 90, height: 0.12, static: false}
  parks: {kind: duckiebot, pos: [0.7, 3.5], rotate: 90, height: 0.12}
  light: {kind: trafficlight, pos: [2.95, 2.05], height: 0.4}
  stop: {kind: sign_stop, pos: [2.95, 3.1], rotate: 270, height: 0.18}
  ban: {kind: sign_no_left_turn, pos: [2.95, 3.1], rotate: 270, height: 0.18}
"""


def test_what_a_map_file_names_is_there_and_does_what_it_is_for(tmp_path: Path) -> None:
    file = tmp_path / "named.yaml"
    file.write_text(NAMED)
    how = Scenario(duckie_wait_s=(0.0, 0.0), npc_speed_mps=(0.2, 0.2))
    task = Traffic([load_map(str(file))], 1, how)
    streets, crowd = task.streets, task.crowd
    assert (len(streets.movers[0]), len(streets.lights[0])) == (2, 1)
    assert set(task.road_maps[0].objects or ()) == {"stands", "parks", "light", "stop", "ban"}
    away_m = np.hypot(*(streets.blocked_m[0] - 0.585 * np.array((0.7, 1.5))).T)
    assert away_m.max() < 0.15, "only who parks is in the way"
    world = world_of(task, range(1))
    world.reset()
    told = []
    for _ in range(150):
        world.step(np.full(1, STOP))
        duck, phase = crowd.ducks.poses[0, 0], crowd.lights.phases[0, 0]
        told.append((*crowd.drivers.poses[0, 0], duck[1], phase))
    x, y, heading, duck_y, phases = np.array(told).T
    assert np.ptp(duck_y) == pytest.approx(0.585, abs=1e-6)
    assert set(phases) == {0, 1}
    before_m = 2 * 0.585 - y[np.hypot(np.diff(x), np.diff(y)).argmin()]
    assert before_m == pytest.approx(0.17, abs=0.03), "it stood at the junction"
    assert y.max() > 3 * 0.585, "it went on"
    assert np.abs(heading[y < 3 * 0.585] - 0.5 * np.pi).max() < 0.2, "straight on"


def test_off_the_tiles_of_road_it_ends() -> None:
    task = traffic()
    poses = task.reset(np.array([0]), np.random.default_rng(0))
    assert not task.step(poses, np.zeros(1, dtype=bool)).terminated[0]
    assert task.step(np.array([[-0.05, 0.5, 0.0]]), np.zeros(1, dtype=bool)).terminated[0]


def test_it_begins_where_it_is_told_to_and_nobody_else_does() -> None:
    task = traffic(2, robots_npcs=("n1", "n2", "n3"))
    poses = np.array([path.pose_at(1.0) for path in task.streets.tours[0]])
    task.reset_at(np.arange(2), poses, np.random.default_rng(0))
    assert (np.abs(task.course.offset_m) < 0.01).all()
    away = task.crowd.drivers.poses[..., :2] - poses[:, None, :2]
    assert (np.hypot(away[..., 0], away[..., 1]) > 0.45).all()


def test_an_episode_is_the_same_whichever_others_are_driven() -> None:
    ends = []
    for numbers, robots in ((range(4), 4), (range(2, 4), 2)):
        world = world_of(Traffic([load_map("loop")], robots, load_scenario("mixed")), numbers)
        world.reset()
        for _ in range(60):
            step = world.step(world.expert_actions())
        ends.append((step.poses[-2:], step.task.facts[:, -2:]))
    for first, second in zip(*ends, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)


def test_who_shares_a_world_is_seen_by_the_other() -> None:
    """Two robots, the second 0.3 m ahead of the first: only the first sees the other."""
    task = Traffic([load_map("loop")], 2, Scenario(robots_pcs=("a", "b")))
    world = world_of(task, range(2), pictures=True)
    world.reset()
    moving = task.moving(world.poses)
    assert np.isnan(moving[0, 0]).all()
    np.testing.assert_allclose(moving[0, 1], world.poses[1])
    np.testing.assert_allclose(moving[1, 0], world.poses[0])
    pose = world.poses[0]
    beside = pose + 0.3 * np.array((np.cos(pose[2]), np.sin(pose[2]), 0.0))
    seen, alone = np.full((2, 2, 3), np.nan), np.full((2, 2, 3), np.nan)
    seen[0, 1] = beside
    camera = world.feed._camera
    poses = np.stack((pose, beside))
    there, away = (camera.render(poses, None, moving) for moving in (seen, alone))
    assert (there[0] != away[0]).any()
    assert np.array_equal(there[1], away[1])


def test_who_has_ended_stands_where_it_is_until_the_others_have() -> None:
    task = Traffic([load_map("loop")], 2, Scenario(robots_pcs=("a", "b")))
    with pytest.raises(ConfigError, match="episodes: expected 2, one for each robot, got 4"):
        world_of(task, range(4))
    world = world_of(task, range(2))
    world.reset()
    straight_off = np.array([2, STOP])
    for _ in range(100):
        world.step(straight_off)
        if not world.active[0]:
            break
    assert world.active.tolist() == [False, True]
    stood = world.poses[0]
    world.step(straight_off)
    np.testing.assert_array_equal(world.poses[0], stood)
    assert world.numbers.tolist() == [-1, 1]


def test_robots_must_fill_their_worlds() -> None:
    with pytest.raises(ConfigError, match="multiple of 2"):
        Traffic([load_map("loop")], 3, Scenario(robots_pcs=("a", "b")))
    with pytest.raises(ConfigError, match="scenario: expected none for the task lane"):
        find_task("lane").build([load_map("loop")], 1, Choices(scenario="lfp"))
