import numpy as np
import pytest

from robot.navigation.road_map import load_map
from sim_pybullet.look import ClutterLook
from sim_pybullet.scenery.clutter import clutter_solids


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
