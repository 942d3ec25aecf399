"""Road maps against the reference simulator's figures, and refusals that say what is wrong."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import MapError
from robot.navigation.road_map import (
    FLOOR_KINDS,
    ORIENTATIONS,
    ROAD_SIDES,
    STEPS,
    load_map,
    parse_tile,
    read_map,
    shipped_maps,
)
from tests.robot.navigation.oracle import oracle_map, oracle_maps, reference_lanes, sim_to_world

OPPOSITE = {"S": "N", "N": "S", "E": "W", "W": "E"}


@pytest.fixture(scope="session")
def oracle(data_dir: Path) -> dict[str, Any]:
    return oracle_maps(data_dir)


def test_lanes_equal_the_reference(data_dir: Path, oracle: dict[str, Any]) -> None:
    for name, expected in oracle.items():
        road_map = oracle_map(data_dir, name)
        assert (road_map.rows, road_map.columns) == (
            expected["grid_height"],
            expected["grid_width"],
        )
        lanes = {(t.column, t.row): reference_lanes(t, road_map) for t in road_map.road_tiles}
        assert set(lanes) == {tuple(tile["coords"]) for tile in expected["tiles"]}
        for tile in expected["tiles"]:
            np.testing.assert_allclose(
                np.array(lanes[tuple(tile["coords"])]),
                sim_to_world(tile["curves"], road_map),
                atol=1e-6,
                err_msg=f"{name} {tile['coords']}",
            )


def test_every_file_loads_and_its_lanes_stay_on_their_tiles(data_dir: Path) -> None:
    files = sorted((data_dir / "maps").rglob("*.yaml"))
    assert len(files) > 40
    for road_map in [*map(load_map, files), *map(load_map, shipped_maps())]:
        for lane in road_map.lanes:
            centre = np.array([lane.tile.column + 0.5, road_map.rows - lane.tile.row - 0.5])
            offset = np.abs(lane.control_points_m / road_map.tile_size_m - centre)
            assert offset.max() == pytest.approx(0.5)


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_shipped_roads_meet(name: str) -> None:
    road_map = load_map(name)
    for tile in road_map.road_tiles:
        for side in tile.road_sides:
            row, column = tile.row + STEPS[side][0], tile.column + STEPS[side][1]
            assert 0 <= row < road_map.rows
            assert 0 <= column < road_map.columns
            assert OPPOSITE[side] in road_map.tiles[row][column].road_sides


def test_arena_is_the_one_of_the_paper() -> None:
    arena = load_map("arena")
    assert (arena.width_m, arena.height_m) == pytest.approx((2.20, 2.64))
    assert [tile.kind[:4] for tile in arena.road_tiles if tile.is_junction] == ["3way"] * 4


@given(
    kind=st.sampled_from([*ROAD_SIDES, *FLOOR_KINDS]),
    orientation=st.sampled_from(ORIENTATIONS),
)
def test_tiles_round_trip(kind: str, orientation: str) -> None:
    tile = parse_tile(f"{kind}/{orientation}", 2, 3)
    assert (tile.kind, tile.row, tile.column) == (kind, 2, 3)
    assert ORIENTATIONS[tile.quarter_turns] == orientation
    bare = parse_tile(kind, 0, 0)
    assert (bare.kind, ORIENTATIONS[bare.quarter_turns]) == (kind, "E")


def test_left_and_right_junctions_are_mirror_images() -> None:
    assert parse_tile("3way_left/N", 0, 0).road_sides == ("N", "W", "S")
    assert parse_tile("3way_right/N", 0, 0).road_sides == ("N", "S", "E")


@pytest.mark.parametrize("kind", ROAD_SIDES)
def test_every_pair_of_road_sides_has_one_lane_and_no_u_turn(kind: str) -> None:
    for orientation in ORIENTATIONS:
        road_map = read_map({"tiles": [[f"{kind}/{orientation}"]], "tile_size": 1.0}, "one")
        sides = road_map.tiles[0][0].road_sides
        ends = [
            (side_of(lane.control_points_m[0]), side_of(lane.control_points_m[3]))
            for lane in road_map.lanes
        ]
        assert sorted(ends) == sorted((a, b) for a in sides for b in sides if a != b)


def side_of(point: np.ndarray) -> str:
    x, y = point
    return next(s for s, gap in zip("SENW", (y, 1 - x, 1 - y, x)) if gap < 1e-9)


@given(
    row=st.integers(0, 2),
    column=st.integers(0, 3),
    word=st.text(min_size=1).filter(lambda s: "4" not in s),
)
def test_an_unknown_tile_is_named_with_its_place(row: int, column: int, word: str) -> None:
    tiles = [["straight/E"] * 4 for _ in range(3)]
    tiles[row][column] = f"x{word}"
    with pytest.raises(MapError, match=f"row {row}, column {column}: unknown tile") as error:
        read_map({"tiles": tiles, "tile_size": 0.585}, "bad")
    assert "curve_left" in str(error.value)


GOOD: Dict[str, Any] = {"tiles": [["straight/E", "floor"]], "tile_size": 0.585}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tiles": [["straight/E", "straight/Q"]]}, "row 0, column 1: unknown orientation 'Q'"),
        ({"tiles": [["straight/E"], ["floor", "floor"]]}, "row 1: expected 1 tiles"),
        ({"tiles": [["straight/E", 4]]}, "row 0, column 1: expected a tile"),
        ({"tiles": []}, "expected a list of rows"),
        ({"tiles": "straight"}, "expected a list of rows"),
        ({"tiles": [[]]}, "row 0: expected a list of tiles"),
        ({"tile_size": 0}, "above 0 m"),
        ({"tile_size": "big"}, "expected a number"),
        ({"tile_size": None}, "expected a number"),
        ({"tile_size": True}, "expected a number, got True"),
        ({"tile_size": 5.1}, "at most 5 m, got 5.1"),
        ({"object": {}}, "did you mean 'objects'"),
    ],
)
def test_bad_maps_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(MapError, match=message):
        read_map({**GOOD, **change}, "bad")


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["tile", "slot", "p", "~SE2Transform", "x"]), inner)
    ),
    max_leaves=6,
)


@settings(max_examples=200, deadline=None)
@given(
    changes=st.dictionaries(st.sampled_from([*GOOD, "start_tile", "start_pose"]), JUNK, max_size=2)
)
def test_junk_is_refused_as_a_bad_map_or_read(changes: Any) -> None:
    with contextlib.suppress(MapError):
        read_map({**GOOD, **changes}, "junk")


def test_a_map_needs_its_tile_size() -> None:
    with pytest.raises(MapError, match="tile_size is missing"):
        read_map({"tiles": [["floor"]]}, "bad")


def test_an_unknown_map_is_refused_with_the_shipped_ones(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="did you mean 'arena'"):
        load_map("arenna")
    with pytest.raises(MapError, match="expected a map file"):
        load_map(tmp_path / "absent.yaml")
    bad = tmp_path / "bad.yaml"
    bad.write_text("tiles: [")
    with pytest.raises(MapError, match="expected YAML"):
        load_map(bad)


@given(x=st.floats(-1, 4), y=st.floats(-1, 4))
def test_tile_at_agrees_with_the_grid(x: float, y: float) -> None:
    arena = load_map("arena")
    tile = arena.tile_at(x, y)
    assert (tile is None) == (not (0 <= x < arena.width_m and 0 <= y < arena.height_m))
    if tile is not None:
        west, north = tile.column * 0.44, (arena.rows - tile.row) * 0.44
        assert west - 1e-9 <= x <= west + 0.44 + 1e-9
        assert north - 0.44 - 1e-9 <= y <= north + 1e-9


def test_the_south_and_west_border_belong_to_the_grid_and_the_others_do_not() -> None:
    arena = load_map("arena")
    assert arena.tile_at(0.0, 0.0) is arena.tiles[-1][0]
    assert arena.tile_at(arena.width_m, 1.0) is None
    assert arena.tile_at(1.0, arena.height_m) is None
    for corner, sides in ((arena.tiles[0][0], "NW"), (arena.tiles[-1][-1], "SE")):
        assert [arena.beyond(corner, side) for side in sides] == [None, None]
