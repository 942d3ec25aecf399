"""Ducks, drivers, lights and the right of way, each by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.errors import ConfigError, MapError
from robot.navigation.map_objects import objects_of
from robot.navigation.planner import LaneGraph
from robot.navigation.road_map import RoadMap, load_map, read_map
from sim_pybullet.rendering.solid_geometry import solid_rows
from sim_pybullet.traffic.ahead import AHEAD_M, meeting, nearest
from sim_pybullet.traffic.crowd import Approach, Crowd, RightOfWay
from sim_pybullet.traffic.drivers import Drivers
from sim_pybullet.traffic.ducks import Ducks
from sim_pybullet.traffic.lights import Lights, lamps
from sim_pybullet.traffic.near import steps_ahead
from sim_pybullet.traffic.scenario import SCENARIOS_FOLDER, Scenario, load_scenario
from sim_pybullet.traffic.streets import Layout, Streets, tours

NOBODY = np.full((1, 1, 2), np.nan)


def test_a_robot_sees_what_is_ahead_on_its_path_and_nothing_else() -> None:
    points = np.stack((AHEAD_M, np.zeros_like(AHEAD_M)), axis=-1)[None]
    bodies = np.array([[(-0.1, 0.0), (0.4, 0.2), (0.6, 0.05), (0.9, 0.0), (np.nan, np.nan)]])
    steps = steps_ahead(points, np.zeros((1, 3)), bodies, np.full((1, 5), 0.15))
    (free_m,), (ends,) = nearest(steps)
    assert ends == 2
    assert 0.44 - 0.041 <= free_m <= 0.6 - 0.14
    (free_m,), (ends,) = nearest(steps[:, :2])
    assert ends == -1
    assert free_m > 0.95


@given(st.floats(0.1, 0.9), st.floats(-0.14, 0.14))
def test_how_far_it_is_to_a_body_is_told_exactly(x_m: float, y_m: float) -> None:
    near_m = 0.15
    points = np.stack((AHEAD_M, 0.0 * AHEAD_M), axis=-1)[None]
    body = np.array([[(x_m, y_m)]])
    free_m, _ = nearest(steps_ahead(points, np.zeros((1, 3)), body, np.full((1, 1), near_m)))
    told = meeting(points, np.zeros((1, 3)), body[:, 0], np.full(1, near_m), free_m)
    assert told[0] == pytest.approx(max(x_m - np.sqrt(near_m**2 - y_m**2), 0.0), abs=1e-9)
    np.testing.assert_allclose(told[1], [(1.0, 0.0)])


def test_who_leads_through_a_bend_goes_on_along_it() -> None:
    turn = AHEAD_M[:20] / 0.2
    bend = 0.2 * np.stack((np.sin(turn), 1.0 - np.cos(turn)), axis=-1)
    for free_m in (0.0, 0.2, 0.6):
        heading = (free_m + 0.02) / 0.2
        expected = np.array((np.cos(heading), np.sin(heading)))
        _, way = meeting(bend, np.zeros(3), np.zeros(2), np.zeros(1), np.array(free_m))
        np.testing.assert_allclose(way, expected, atol=1e-9)


def test_a_duck_waits_crosses_at_its_speed_and_comes_back() -> None:
    rng, ducks = np.random.default_rng(0), Ducks(1, 2)
    way_m, how = 0.6, Scenario(duckie_speed_mps=(0.12, 0.12), duckie_wait_s=(3.0, 3.0))
    ducks.begin(0, np.array([(1.0, 2.0, np.pi / 2, way_m)]), how, rng)
    assert np.isnan(ducks.poses[0, 1]).all()
    ys = []
    for _ in range(170):
        ducks.step(NOBODY)
        ys.append(ducks.poses[0, 0, 1])
    assert ys[28] == 2.0  # it waits for 3 s
    assert ys[59] - ys[49] == pytest.approx(0.12)  # metres in a second
    assert max(ys) == pytest.approx(2.0 + way_m)
    assert ys[80] == ys[100] == pytest.approx(2.0 + way_m)  # it waits on the other side
    assert ys[165] == pytest.approx(2.0)


def test_a_duck_does_not_walk_into_a_robot_in_front_of_it_but_goes_back() -> None:
    rng, ducks, xs = np.random.default_rng(0), Ducks(1, 1), []
    how = Scenario(duckie_speed_mps=(0.1, 0.1), duckie_wait_s=(0.0, 0.0))
    ducks.begin(0, np.array([(0.0, 0.0, 0.0, 0.6)]), how, rng)
    for _ in range(60):
        ducks.step(np.array([[(0.4, 0.0)]]))
        xs.append(ducks.poses[0, 0, 0])
    assert 0.1 < 0.4 - max(xs) < 0.35
    assert min(xs[int(np.argmax(xs)) :]) < 0.02


def test_a_driver_stops_behind_what_is_ahead_and_goes_on() -> None:
    loop = load_map("loop")
    path = tours(LaneGraph(loop), np.random.default_rng(0))[0]
    drivers = Drivers(1, 1, path)
    drivers.begin(0, [(path, 0.0)], Scenario(npc_speed_mps=(0.2, 0.2)), np.random.default_rng(0))
    ahead_m, clear = 0.8, np.full((1, 1), np.inf)
    for _ in range(80):
        drivers.step(np.array([[ahead_m - drivers.arc_m[0, 0]]]), clear)
    assert drivers.speeds_mps[0, 0] < 0.01
    assert 0.6 < drivers.arc_m[0, 0] < 0.75
    offsets = []
    for _ in range(200):
        drivers.step(clear, clear)
        offsets.append(path.project(*drivers.poses[0, 0, :2]).offset_m)
    assert drivers.speeds_mps[0, 0] == pytest.approx(0.2)
    assert np.abs(offsets).max() < 0.03


def test_a_mistake_is_a_second_without_looking() -> None:
    path = tours(LaneGraph(load_map("loop")), np.random.default_rng(0))[0]
    drivers, stops = Drivers(1, 1, path), np.zeros((1, 1))
    how = Scenario(npc_speed_mps=(0.2, 0.2), npc_mistakes_per_min=600.0)
    drivers.begin(0, [(path, 0.0)], how, np.random.default_rng(0))
    drivers.speeds_mps[:] = 0.2
    for _ in range(10):
        drivers.step(stops, stops + np.inf)
    assert drivers.speeds_mps[0, 0] > 0.0


def test_four_cars_at_one_crossing_go_one_at_a_time_and_all_go() -> None:
    way = RightOfWay(1, 4, 1)
    line_m, gone = np.full((1, 4), 0.17), []
    for _ in range(400):
        inside = np.where((line_m < 0.0) & (line_m > -0.6), 0, -1)
        coming = np.where(line_m > 0.0, 0, -1)
        shown_m = np.where(line_m > 0.0, line_m, np.inf)
        red, still = np.zeros((1, 4), dtype=bool), np.zeros((1, 4))
        approach = Approach(coming, shown_m, inside, np.ones((1, 4)), red, still)
        may = way.ask(approach, still) & (line_m > -1.0)
        assert (inside == 0).sum() <= 1
        line_m = line_m - 0.02 * may
        gone += [car for car in np.flatnonzero(line_m[0] < -0.7) if car not in gone]
    assert sorted(gone) == [0, 1, 2, 3]


def at_the_line(
    free_m: float = 1.0, red: bool = False, inside: int = -1, line_m: float = 0.17
) -> Approach:
    """Two cars before one junction, the second of them perhaps on its crossing."""
    return Approach(
        np.array([[0, 0 if inside < 0 else -1]]),
        np.array([[line_m, 0.17 if inside < 0 else np.inf]]),
        np.array([[-1, inside]]),
        np.full((1, 2), free_m),
        np.full((1, 2), red),
        np.zeros((1, 2)),
    )


def waits(approach: Approach, decisions: int) -> list[bool]:
    """After each decision, whether the first car may go; both stand."""
    way = RightOfWay(1, 2, 1)
    return [bool(way.ask(approach, np.zeros((1, 2)))[0, 0]) for _ in range(decisions)]


def test_who_has_stood_for_half_a_second_may_go() -> None:
    assert waits(at_the_line(), 6)[:4] == [False] * 4
    assert waits(at_the_line(), 6)[5]
    assert not any(waits(at_the_line(red=True), 80)), "at a red light nobody may"
    assert not any(waits(at_the_line(inside=0), 80)), "nor while somebody is inside"


@pytest.mark.parametrize(("free_m", "after"), [(0.17 + 0.72, 5), (0.17 + 0.4, 60), (0.5, 200)])
def test_behind_the_junction_there_must_be_room(free_m: float, after: int) -> None:
    """0.7 m; for who has stood for six seconds half of it."""
    may = waits(at_the_line(free_m), 100)
    assert may.index(True) == pytest.approx(after, abs=1.1) if after < 100 else not any(may)


def test_who_has_stood_longer_goes_first() -> None:
    way = RightOfWay(1, 2, 1)
    for _ in range(3):
        way.ask(at_the_line(line_m=0.5), np.zeros((1, 2)))  # the second is there already
    for _ in range(10):
        way.ask(at_the_line(red=True), np.zeros((1, 2)))
    assert way.ask(at_the_line(), np.zeros((1, 2))).tolist() == [[False, True]]


def test_who_has_the_way_and_cannot_go_loses_it_after_six_seconds() -> None:
    way, told = RightOfWay(1, 2, 1), []
    for decision in range(90):
        room_m = np.array([[1.0 if decision < 10 else 0.2, 1.0]])
        may = way.ask(at_the_line()._replace(free_m=room_m), np.zeros((1, 2)))
        told.append(may[0].tolist())
    assert told[60] == [True, False]
    assert told[70] == [False, True]


def test_what_is_behind_a_robot_is_not_in_its_way() -> None:
    points = np.stack((AHEAD_M, np.zeros_like(AHEAD_M)), axis=-1)[None]
    steps = steps_ahead(points, np.zeros((1, 3)), np.array([[(-0.05, 0.0)]]), np.full((1, 1), 0.15))
    assert steps.tolist() == [[25]]


def test_cars_keep_to_the_right_of_the_middle() -> None:
    path = tours(LaneGraph(load_map("loop")), np.random.default_rng(0))[0]
    drivers, clear, offsets = Drivers(1, 1, path), np.full((1, 1), np.inf), []
    drivers.begin(0, [(path, 0.0)], Scenario(npc_speed_mps=(0.2, 0.2)), np.random.default_rng(0))
    for _ in range(300):
        drivers.step(clear, clear)
        offsets.append(path.project(*drivers.poses[0, 0, :2]).offset_m)
    assert np.mean(offsets) == pytest.approx(-0.015, abs=0.003)
    assert np.ptp(offsets) == pytest.approx(2.0 * 0.008, abs=0.004)


def test_as_many_obey_and_err_as_the_scenario_says() -> None:
    path = tours(LaneGraph(load_map("loop")), np.random.default_rng(0))[0]
    drivers = Drivers(1, 2000, path)
    how = Scenario(npc_obeying=0.8, npc_mistakes_per_min=6.0)
    drivers.begin(0, [(path, 0.0)], how, np.random.default_rng(0))
    assert drivers.obeying.mean() == pytest.approx(0.8, abs=0.03)
    assert (drivers._mistakes_s < 60.0).sum(axis=-1).mean() == pytest.approx(6.0, abs=0.2)


@pytest.mark.parametrize(("off_m", "walks"), [(0.33, True), (0.31, False)])
def test_a_duck_leaves_twenty_centimetres_to_a_robot(off_m: float, walks: bool) -> None:
    """From 12 cm before it, where it looks."""
    ducks = Ducks(1, 1)
    how = Scenario(duckie_speed_mps=(0.1, 0.1), duckie_wait_s=(0.0, 0.0))
    ducks.begin(0, np.array([(0.0, 0.0, 0.0, 0.6)]), how, np.random.default_rng(0))
    ducks.step(np.array([[(off_m, 0.0)]]))
    assert bool(ducks.poses[0, 0, 0] > 0.0) is walks


def test_a_duck_stands_two_seconds_before_a_robot_then_it_goes_back() -> None:
    ducks, turned = Ducks(1, 1), []
    how = Scenario(duckie_speed_mps=(0.1, 0.1), duckie_wait_s=(0.0, 0.0))
    ducks.begin(0, np.array([(0.0, 0.0, 0.0, 0.6)]), how, np.random.default_rng(0))
    for _ in range(30):
        ducks.step(np.array([[(0.2, 0.0)]]))
        turned.append(bool(ducks.poses[0, 0, 2] > 3.0))
    assert turned.index(True) == pytest.approx(20, abs=1)


def test_cars_begin_as_far_beside_and_askew_as_the_scenario_tolerates() -> None:
    how, streets = Scenario(min_dist=0.0), Streets([load_map("loop")])
    layout = Layout(streets, 0, how, np.random.default_rng(0))
    starts = [layout.car(1.0) for _ in range(300)]
    beside_m = [start.path.project(*start.pose[:2]).offset_m for start in starts]
    np.testing.assert_allclose(beside_m, [start.offset_m for start in starts], atol=1e-3)
    assert max(map(abs, beside_m)) == pytest.approx(0.03, abs=0.001)
    askew_deg = np.degrees([start.turned_rad for start in starts])
    assert np.abs(askew_deg).max() == pytest.approx(10.0, abs=0.3)


def test_a_light_is_green_for_two_ways_of_four_in_turn() -> None:
    cross = read_map({"tile_size": 0.585, "tiles": [["4way"]],
                      "objects": [{"kind": "trafficlight", "pos": [0.5, 0.5], "height": 0.3}]},
                     "cross")  # fmt: skip
    rng, lights = np.random.default_rng(1), Lights(1, 1)
    lights.begin(0, objects_of(cross), np.array([0]), rng)
    headings = np.array([[0.0, np.pi / 2, np.pi, -np.pi / 2]])
    seen = []
    for _ in range(200):
        red = lights.red(np.zeros((1, 4), int), headings)[0]
        assert red[0] == red[2] != red[1] == red[3]
        assert bool(red[0]) == bool(lights.phases[0, 0]), "in phase 0 who comes along it goes"
        assert not lights.red(np.full((1, 4), -1), headings).any()
        assert np.isfinite(lights.shown()[0, :, 0]).sum() == 1
        seen.append(bool(red[0]))
        lights.step()
    changes = np.flatnonzero(np.diff(seen))
    assert set(np.diff(changes)) <= set(range(40, 72))
    rows, owners = solid_rows((*lamps(0), *lamps(1))), np.repeat((0, 1), len(lamps(0)))
    assert (rows[owners == 0, -3:] != rows[owners == 1, -3:]).any()


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENARIOS_FOLDER.glob("*.yaml")))
@pytest.mark.parametrize("map_name", ["loop", "judging/rings/zed", "judging/towns/knot"])
def test_everybody_begins_apart_from_everybody(name: str, map_name: str) -> None:
    how, streets = load_scenario(name), Streets([load_map(map_name)])
    for seed in range(5):
        layout = Layout(streets, 0, how, np.random.default_rng(seed))
        cars = [layout.car(1.0).pose[:2] for _ in (*how.robots_pcs, *how.robots_npcs)]
        ducks = layout.ducks().reshape(-1, 4)
        for k, (x, y) in enumerate(cars):
            assert all(np.hypot(x - a, y - b) > how.min_dist - how.delta_y_m for a, b in cars[:k])
            assert (np.hypot(*(ducks[:, :2] - (x, y)).T) > how.duckie_min_dist_from_robot).all()
        assert (ducks[:, 3] > 0).sum() == how.walking


def test_a_scenario_file_of_the_ai_driving_olympics_is_read_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "lfp.yaml"
    file.write_text("""
map_name: LF-norm-loop
robots_npcs: [npc0]
robots_pcs: [ego0]
robots_parked: [parked0]
theta_tol_deg: 20
dist_tol_m: 0.05
min_dist: 0.3
delta_y_m: 0.02
only_straight: false
nduckies: 4
duckie_min_dist_from_other_duckie: 0.2
duckie_min_dist_from_robot: 0.5
duckie_y_bounds: [-0.1, -0.05]
tree_density: 0.5
tree_min_dist: 0.2
pc_robot_protocol: {_type: protocol}
npc_robot_protocol: {_type: protocol}
""")
    assert load_scenario(file) == Scenario(
        ("ego0",), ("npc0",), ("parked0",), 0.3, 20.0, 0.02, False, 4, 0.2, 0.5, (-0.1, -0.05)
    )


def test_scenarios_say_what_is_wrong_with_them(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'lf'"):
        load_scenario("lpf")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("nduckie: 3\n")
    with pytest.raises(ConfigError, match="nduckies"):
        load_scenario(wrong)
    with pytest.raises(ConfigError, match="no more walking than nduckies"):
        Scenario(walking=1)


def with_objects(objects: list[dict[str, object]]) -> RoadMap:
    tiles = [
        ["curve_left/W", "straight/W", "curve_left/N"],
        ["straight/S", "grass", "straight/N"],
        ["curve_left/S", "straight/E", "curve_left/E"],
    ]
    return read_map({"tile_size": 0.585, "tiles": tiles, "objects": objects}, "ring")


def test_what_a_map_says_moves_is_no_longer_part_of_the_scenery() -> None:
    duck = {"kind": "duckie", "pos": [1.5, 0.1], "height": 0.08}
    streets = Streets([with_objects([duck, {**duck, "pos": [1.5, 2.9], "static": False}])])
    assert len(streets.movers[0]) == 1
    assert list(streets.road_maps[0].objects.values()) == [duck]


def test_nobody_tours_through_a_barrier() -> None:
    ring = with_objects([])
    lane = ring.lanes[0].control_points_m.mean(axis=0) / 0.585
    barrier = {"kind": "barrier", "pos": [float(lane[0]), float(3.0 - lane[1])], "height": 0.1}
    open_, closed = Streets([ring]), Streets([with_objects([barrier])])
    assert len(open_.tours[0]) == 2
    assert len(closed.tours[0]) == 1
    assert not open_.blocked_m[0].size
    assert closed.blocked_m[0].size


def test_a_small_ring_has_room_for_all_in_some_order() -> None:
    crowd = Crowd(Streets([load_map("rings/pretzel")]), load_scenario("mixed"), 1)
    for seed in range(200):  # cars that came first left no room for the last duck in 44 of these
        assert len(crowd.begin(0, 0, np.random.default_rng(seed))) == 1


def test_a_scenario_without_room_is_refused_at_last() -> None:
    many = replace(load_scenario("lfp"), nduckies=60)
    crowd = Crowd(Streets([load_map("loop")]), many, 1)
    with pytest.raises(MapError, match=r"loop: expected room for the ducks.*ask for fewer"):
        crowd.begin(0, 0, np.random.default_rng(0))


@pytest.mark.parametrize(
    "how",
    [
        {"npc_speed_mps": (-0.2, 0.1)},
        {"duckie_wait_s": (-3.0, -1.0)},
        {"npc_mistakes_per_min": -1.0},
        {"nduckies": -1, "walking": -2},
        {"min_dist": -0.5},
        {"npc_headway_s": (2.0, 1.0)},
        {"robots_pcs": ()},
        {"nduckies": 1, "walking": 2},
    ],
)
def test_a_scenario_that_cannot_be_is_refused(how: dict) -> None:
    with pytest.raises(ConfigError, match="only duckie_y_bounds below 0"):
        Scenario(**how)
    assert Scenario(duckie_y_bounds=(-0.3, -0.2)).duckie_y_bounds[0] < 0.0
