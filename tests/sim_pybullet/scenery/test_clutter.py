from dataclasses import replace

import numpy as np
import pytest

from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL, ClutterLook
from sim_pybullet.scenery.clutter import clutter_solids, roadside
from sim_pybullet.scenery.objects import place_solids


@pytest.mark.parametrize("name", ["loop", "town"])
def test_nothing_stands_on_the_road_or_in_the_way(name: str) -> None:
    road_map = load_map(name)
    look = ClutterLook(boxes=20, people=10)
    solids = clutter_solids(road_map, look, np.random.default_rng(0))
    assert len(solids) > 30
    for solid in solids:
        assert not road_map.on_road(solid.x_m, solid.y_m)
        assert not solid.collides
        assert 0.05 < solid.base_m + solid.size_m[2] < 2.2
    assert clutter_solids(road_map, look, np.random.default_rng(0)) == solids
    assert clutter_solids(road_map, ClutterLook(), np.random.default_rng(0)) == ()


def test_things_stand_on_and_beside_the_road_where_nobody_can_meet_them() -> None:
    road_map = load_map("town")
    things = roadside(road_map, 200, np.random.default_rng(0))
    assert len(things) == 200
    kinds = {item.kind.split("_")[0] for item in things}
    assert {"duckie", "sign", "duckiebot", "cone"} <= kinds
    lanes = np.concatenate([lane.control_points_m[[0, 3]] for lane in road_map.lanes])
    for item in things:
        assert np.hypot(*(lanes - (item.x_m, item.y_m)).T).min() < 0.6 + road_map.tile_size_m
        assert 0.03 < item.height_m <= 0.5
    ducks = [item for item in things if item.kind == "duckie"]
    assert any(road_map.on_road(item.x_m, item.y_m) for item in ducks)
    look = replace(NOMINAL, clutter=ClutterLook(things=30))
    solids, bare = (
        place_solids(road_map, each, np.random.default_rng(1)) for each in (look, NOMINAL)
    )
    assert len(solids) > len(bare) + 30
    assert not any(solid.collides for solid in solids[len(bare) :])
    assert roadside(load_map("loop"), 0, np.random.default_rng(0)) == ()
