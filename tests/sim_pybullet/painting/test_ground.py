from pathlib import Path

import numpy as np
import pytest

from robot.geometry import bezier_points
from robot.navigation.road_map import load_map, read_map
from sim_pybullet.look import GroundLook
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.scene import Ground, SemanticClass

PLAIN = GroundLook(grain=0.0, seam_depth=0.0)


def class_at(ground: Ground, points_m: np.ndarray) -> np.ndarray:
    columns = ((points_m[:, 0] - ground.west_m) / ground.texel_m).astype(int)
    rows = ((ground.north_m - points_m[:, 1]) / ground.texel_m).astype(int)
    return ground.classes[rows, columns]


def test_lanes_run_over_bare_road() -> None:
    town = load_map("town")
    ground = paint_ground(town, PLAIN)
    for lane in town.lanes:
        if not lane.tile.is_junction:  # there lanes cross lines
            points = bezier_points(lane.control_points_m, np.linspace(0.01, 0.99, 40))
            assert set(class_at(ground, points)) == {SemanticClass.ROAD}, lane


def test_a_straight_tile_reads_white_lane_yellow_lane_white_across() -> None:
    ground = paint_ground(read_map({"tiles": [["straight/N"]], "tile_size": 0.585}, "t"), PLAIN)
    across = np.array([0.066, 0.3, 0.5, 0.7, 0.93]) * 0.585
    seen = set()
    for along in np.linspace(0.01, 0.57, 100):
        kinds = class_at(ground, np.stack((across, np.full(5, along)), axis=-1))
        assert list(kinds[[0, 1, 3, 4]]) == [
            SemanticClass.WHITE_LINE,
            SemanticClass.ROAD,
            SemanticClass.ROAD,
            SemanticClass.WHITE_LINE,
        ]
        seen.add(int(kinds[2]))
    assert seen == {SemanticClass.YELLOW_LINE, SemanticClass.ROAD}  # dashes


@pytest.mark.parametrize("side", range(4))
def test_stop_lines_lie_across_the_lane_that_enters(side: int) -> None:
    tiles = [["empty", "straight/N", "empty"], ["straight/E", "4way", "straight/E"]]
    tiles.append(tiles[0])
    ground = paint_ground(read_map({"tiles": tiles, "tile_size": 0.6}, "t"), PLAIN)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    enters, leaves = np.array([-0.12, 0.29]), np.array([0.12, 0.29])  # from the north, southwards
    rotation = np.linalg.matrix_power(turn, side)
    points = np.stack((rotation @ enters, rotation @ leaves)) + 0.9
    assert list(class_at(ground, points)) == [SemanticClass.RED_LINE, SemanticClass.ROAD]


def test_a_turned_map_has_the_turned_floor() -> None:
    plain = paint_ground(read_map({"tiles": [["curve_left/S"]], "tile_size": 0.585}, "t"), PLAIN)
    turned = paint_ground(read_map({"tiles": [["curve_left/E"]], "tile_size": 0.585}, "t"), PLAIN)
    assert np.array_equal(np.rot90(plain.rgb), turned.rgb)


def test_the_same_look_paints_the_same_floor_and_another_seed_another() -> None:
    loop = load_map("loop")
    look = GroundLook(wear=0.4, patchiness=0.5)
    again = paint_ground(loop, look)
    assert np.array_equal(paint_ground(loop, look).rgb, again.rgb)
    other = paint_ground(loop, GroundLook(wear=0.4, patchiness=0.5, texture_seed=1))
    assert not np.array_equal(other.rgb, again.rgb)
    assert np.array_equal(other.classes, again.classes)


def test_wear_takes_paint_away_and_brightness_scales() -> None:
    loop = load_map("loop")
    new, worn = paint_ground(loop, PLAIN), paint_ground(loop, GroundLook(grain=0, wear=1.0))
    line = new.classes == SemanticClass.WHITE_LINE
    gone = np.mean(worn.rgb[line].mean(axis=-1) < 135)
    assert 0.4 < gone < 0.6
    dim = paint_ground(loop, GroundLook(grain=0.0, seam_depth=0.0, brightness=0.5))
    assert np.abs(dim.rgb.astype(int) * 2 - new.rgb).max() <= 2
    assert dim.outside_rgb == tuple(0.5 * v for v in new.outside_rgb)


def test_lines_end_in_stretches_of_some_length() -> None:
    loop = load_map("loop")
    new = paint_ground(loop, PLAIN)
    line = new.classes == SemanticClass.WHITE_LINE
    broken = paint_ground(loop, GroundLook(grain=0.0, seam_depth=0.0, gaps=0.25))
    gone = (broken.rgb != new.rgb).any(axis=-1)
    assert gone[new.classes == SemanticClass.ROAD].mean() < 0.01  # edges of paint
    assert 0.15 < gone[line].mean() < 0.35
    edges = (np.diff(gone.astype(int), axis=0) != 0).sum() + (np.diff(gone.astype(int)) != 0).sum()
    assert gone.sum() / edges > 4  # texels of gap for each of its border; specks have 1


def test_every_reference_map_can_be_painted(data_dir: Path) -> None:
    for path in sorted((data_dir / "maps").glob("*/*.yaml")):
        road_map = load_map(path)
        if road_map.rows * road_map.columns <= 60:
            ground = paint_ground(road_map, PLAIN)
            assert ground.rgb.shape[:2] == ground.classes.shape
            assert ground.rgb.shape[0] * ground.texel_m == pytest.approx(road_map.height_m)
