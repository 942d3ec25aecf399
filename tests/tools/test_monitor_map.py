"""The drawing of a map holds every lane, and lines only where nobody turns."""

import numpy as np
import pytest

from robot.navigation.road_map import load_map
from tools.monitor.app import draw_map


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_the_drawing_fits_the_map(name: str) -> None:
    road_map = load_map(name)
    drawing = draw_map(road_map)
    points = np.array(drawing["lanes"]).reshape(-1, 2)
    assert len(drawing["lanes"]) == len(road_map.lanes)
    assert points.min() >= -1e-3
    assert (points <= (drawing["width_m"] + 1e-3, drawing["height_m"] + 1e-3)).all()
    tiles = len(drawing["floor"]) + len(road_map.road_tiles)
    assert tiles == road_map.rows * road_map.columns


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_centre_lines_run_where_tiles_meet(name: str) -> None:
    road_map = load_map(name)
    lines = np.array(draw_map(road_map)["centre_lines"]).reshape(-1, 4, 2)
    junctions = sum(tile.is_junction for tile in road_map.road_tiles)
    assert len(lines) == len(road_map.road_tiles) - junctions
    size = road_map.tile_size_m
    for end in (lines[:, 0], lines[:, 3]):
        halves = end / (size / 2)
        np.testing.assert_allclose(halves, halves.round(), atol=1e-3)
        assert ((halves.round() % 2).sum(axis=1) == 1).all(), "the middle of a tile's side"
