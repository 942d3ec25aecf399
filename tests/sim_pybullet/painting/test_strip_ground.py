"""The other painter: other code and other noise, but lines in the same places."""

from dataclasses import replace

import numpy as np
import pytest

from robot.errors import ConfigError
from robot.geometry import bezier_points
from robot.navigation.road_map import load_map
from sim_pybullet.look import GroundLook, look_from_plain
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.painting.shadows import cast_shadows
from sim_pybullet.scene import Ground, SemanticClass

LINES = (SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE, SemanticClass.RED_LINE)
STRIPS = GroundLook(painter="strips", wear=0.2, shadows=0.5, patchiness=0.3)


def classes_at(ground: Ground, points_m: np.ndarray) -> np.ndarray:
    columns = ((points_m[:, 0] - ground.west_m) / ground.texel_m).astype(int)
    rows = ((ground.north_m - points_m[:, 1]) / ground.texel_m).astype(int)
    return ground.classes[rows.clip(0, ground.classes.shape[0] - 1), columns]


@pytest.mark.parametrize("name", ["loop", "town"])
def test_both_painters_lay_lines_in_the_same_places(name: str) -> None:
    road_map = load_map(name)
    grounds = [paint_ground(road_map, look) for look in (GroundLook(), STRIPS)]
    rng = np.random.default_rng(0)
    points = rng.uniform((0, 0), (road_map.width_m, road_map.height_m), (60_000, 2))
    tiles, strips = (classes_at(ground, points) for ground in grounds)
    for line in LINES:
        ours, theirs = (tiles == line).mean(), (strips == line).mean()
        if ours > 0:
            assert 0.5 < theirs / ours < 1.5, line
    both = np.isin(tiles, LINES) & np.isin(strips, LINES)
    either = np.isin(tiles, LINES) | np.isin(strips, LINES)
    assert both.sum() / either.sum() > 0.45  # dashes begin elsewhere, tape is narrower
    outside = tiles == SemanticClass.OUTSIDE
    np.testing.assert_array_equal(outside, strips == SemanticClass.OUTSIDE)


def test_lanes_run_over_bare_road() -> None:
    loop = load_map("loop")
    ground = paint_ground(loop, STRIPS)
    for lane in loop.lanes:
        points = bezier_points(lane.control_points_m, np.linspace(0.01, 0.99, 40))
        assert set(classes_at(ground, points)) == {SemanticClass.ROAD}


def test_the_same_look_paints_the_same_floor_and_another_seed_another() -> None:
    loop = load_map("loop")
    first, again = paint_ground(loop, STRIPS), paint_ground(loop, STRIPS)
    assert np.array_equal(first.rgb, again.rgb)
    other = paint_ground(loop, replace(STRIPS, texture_seed=1))
    assert not np.array_equal(first.rgb, other.rgb)


def test_an_unknown_painter_is_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean 'strips'"):
        look_from_plain({"ground": {"painter": "strip"}})


@pytest.mark.parametrize("painter", ["tiles", "strips"])
def test_shadows_only_darken(painter: str) -> None:
    loop = load_map("loop")
    lit = GroundLook(painter=painter, grain=0.0)
    floors = [
        paint_ground(loop, replace(lit, shadows=strength)).rgb.astype(int) for strength in (0, 0.6)
    ]
    assert (floors[1] <= floors[0] + 1).all()
    assert 0.01 < (floors[1] < floors[0] - 5).any(-1).mean() < 0.9


def test_shadows_stay_within_their_strength() -> None:
    left = cast_shadows((200, 300), 0.003, 0.4, np.random.default_rng(1))
    assert left.shape == (200, 300)
    assert 0.599 <= left.min() <= left.max() <= 1.0
