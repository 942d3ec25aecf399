from collections import Counter

import numpy as np
import pytest

from robot.errors import ConfigError, MapError
from robot.navigation.road_map import load_map, read_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.manoeuvres import Manoeuvres, manoeuvres

ROBOTS = 32


def test_the_arena_has_the_papers_32_paths():
    names = Counter(each.name for each in manoeuvres(load_map("arena")))
    assert names["left turn"] == names["right turn"] == 4
    assert sum(count for name, count in names.items() if name.startswith("junction")) == 24
    assert sum(names.values()) == 32


@pytest.mark.parametrize("name", ["arena", "town", "hamlet"])
def test_every_path_is_a_drive_without_gaps_over_three_tiles(name):
    road_map = load_map(name)
    for each in manoeuvres(road_map):
        arcs = np.linspace(0.0, each.path.length_m, 200)
        poses = np.array([each.path.pose_at(arc) for arc in arcs])
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        assert steps.max() < 1.1 * each.path.length_m / 199
        assert each.path.length_m > 2.0 * road_map.tile_size_m


def test_beside_a_manoeuvre_a_path_goes_straight_where_it_can():
    """Two crossings side by side: none of their twelve ways turns in the other one, too."""
    up = ["grass", "straight/N", "straight/N", "grass"]
    crossings = ["straight/E", "4way", "4way", "straight/E"]
    paths = manoeuvres(read_map({"tiles": [up, crossings, up], "tile_size": 0.5}, "pair"))
    assert len(paths) == 24
    for each in paths:
        arcs = np.linspace(0.0, each.path.length_m, 200)
        headings = np.unwrap([each.path.pose_at(arc).heading_rad for arc in arcs])
        turned = np.degrees(np.abs(np.diff(headings)).sum())
        assert turned == pytest.approx(0.0 if "straight" in each.name else 90.0, abs=3.0)


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
    expected = [each.path.length_m for each in task.manoeuvres]
    assert [driven[number] for number in range(32)] == pytest.approx(expected)


def test_what_has_no_manoeuvres_is_refused():
    with pytest.raises(ConfigError, match="expected one map, got 2"):
        Manoeuvres([load_map("arena"), load_map("town")], 4)
    with pytest.raises(MapError, match="expected bends or junctions"):
        manoeuvres(read_map({"tiles": [["straight/E"] * 4], "tile_size": 0.5}, "road"))
