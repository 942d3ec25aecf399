from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from robot.errors import ConfigError, MapError
from robot.navigation.path import Path
from robot.navigation.road_map import load_map, read_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.manoeuvres import Manoeuvres, manoeuvres

ROBOTS = 32


def turns_deg(path: Path) -> np.ndarray:
    """(200,) how far the path has turned since its start, to the left."""
    arcs = np.linspace(0.0, path.length_m, 200)
    headings = np.unwrap([path.pose_at(arc).heading_rad for arc in arcs])
    return np.degrees(headings - headings[0])


def test_the_arena_has_the_papers_32_paths():
    paths = manoeuvres(load_map("arena"))
    turned = Counter(round(turns_deg(path)[-1] / 90.0) for path in paths[:8])
    assert turned == {1: 4, -1: 4}, "four bends to the left and four to the right, then junctions"
    assert len(paths) == 8 + 24


@pytest.mark.parametrize("name", ["arena", "town", "hamlet"])
def test_every_path_is_a_drive_without_gaps_over_three_tiles(name):
    road_map = load_map(name)
    for path in manoeuvres(road_map):
        arcs = np.linspace(0.0, path.length_m, 200)
        poses = np.array([path.pose_at(arc) for arc in arcs])
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        assert steps.max() < 1.1 * path.length_m / 199
        assert path.length_m > 2.0 * road_map.tile_size_m


def test_beside_a_manoeuvre_a_path_goes_straight_where_it_can():
    """Two crossings side by side: none of their twelve ways turns in the other one, too."""
    up = ["grass", "straight/N", "straight/N", "grass"]
    crossings = ["straight/E", "4way", "4way", "straight/E"]
    paths = manoeuvres(read_map({"tiles": [up, crossings, up], "tile_size": 0.5}, "pair"))
    assert len(paths) == 24
    straight_on = 0
    for path in paths:
        turned = turns_deg(path)
        straight_on += abs(turned[-1]) < 30.0
        in_all = np.abs(np.diff(turned)).sum()
        assert in_all == pytest.approx(0.0 if abs(turned[-1]) < 30.0 else 90.0, abs=3.0)
    assert straight_on == 8


def test_the_expert_drives_each_of_them_once():
    task = Manoeuvres([load_map("arena")], ROBOTS)
    world = BatchWorld(task, [NOMINAL], seed=0, numbers=range(ROBOTS))
    world.reset()
    driven: dict[int, float] = {}
    while world.active.any():
        lengths_m, numbers = task.paths.length_m.copy(), world.numbers
        step = world.step(world.expert_actions())
        for robot in step.finished.robots:
            assert step.task.success[robot]
            driven[numbers[robot]] = lengths_m[robot]
    world.close()
    expected = [path.length_m for path in task.manoeuvres]
    assert [driven[number] for number in range(32)] == pytest.approx(expected)


def test_what_has_no_manoeuvres_is_refused():
    with pytest.raises(ConfigError, match="expected one map, got 2"):
        Manoeuvres([load_map("arena"), load_map("town")], 4)
    with pytest.raises(MapError, match="expected bends or junctions"):
        manoeuvres(read_map({"tiles": [["straight/E"] * 4], "tile_size": 0.5}, "road"))


def test_no_manoeuvre_leads_through_what_stands_in_a_lane():
    arena = load_map("arena")
    bend = next(lane for lane in arena.lanes if lane.tile.kind.startswith("curve"))
    at = bend.pose_at(0.5)
    place = [at.x_m / arena.tile_size_m, arena.rows - at.y_m / arena.tile_size_m]
    barred = replace(arena, objects=[{"kind": "duckie", "pos": place}])
    left = manoeuvres(barred)
    assert 20 < len(left) < 32
    for path in left:
        assert np.hypot(*(path.points_m - at[:2]).T).min() > 0.09
