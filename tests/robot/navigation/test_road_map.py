"""Road maps against the reference simulator's figures, and refusals that say what is wrong."""

from __future__ import annotations

import contextlib
import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import MapError
from robot.geometry import Pose
from robot.navigation.road_map import RoadMap, load_map, read_map, shipped_maps
from robot.navigation.tiles import FLOOR_KINDS, ORIENTATIONS, ROAD_SIDES, STEPS, parse_tile

OPPOSITE = {"S": "N", "N": "S", "E": "W", "W": "E"}


@pytest.fixture(scope="session")
def oracle(data_dir: Path) -> dict[str, Any]:
    return json.loads((data_dir / "oracle" / "map_geometry.json").read_text())["maps"]


def sim_to_world(points: Any, road_map: RoadMap) -> np.ndarray:
    """The simulator's (..., 3) x, up, z (south) as our (..., 2) x, y."""
    array = np.array(points)
    return np.stack((array[..., 0], road_map.height_m - array[..., 2]), axis=-1)


def oracle_map(data_dir: Path, name: str) -> RoadMap:
    return load_map(data_dir / "maps" / "duckietown" / f"{name}.yaml", compat=True)


def test_lanes_equal_the_reference(data_dir: Path, oracle: dict[str, Any]) -> None:
    for name, expected in oracle.items():
        road_map = oracle_map(data_dir, name)
        assert (road_map.rows, road_map.columns) == (
            expected["grid_height"],
            expected["grid_width"],
        )
        lanes = defaultdict(list)
        for lane in road_map.lanes:
            lanes[lane.tile_column, lane.tile_row].append(lane.control_points_m)
        assert set(lanes) == {tuple(tile["coords"]) for tile in expected["tiles"]}
        for tile in expected["tiles"]:
            np.testing.assert_allclose(
                np.array(lanes[tuple(tile["coords"])]),
                sim_to_world(tile["curves"], road_map),
                atol=1e-6,
                err_msg=f"{name} {tile['coords']}",
            )


def test_objects_equal_the_reference_in_compat(data_dir: Path, oracle: dict[str, Any]) -> None:
    for name, expected in oracle.items():
        road_map = oracle_map(data_dir, name)
        solid = [thing for thing in road_map.objects if thing.kind != "floor_tag"]
        assert [thing.kind for thing in solid] == [o["kind"] for o in expected["objects"]]
        for thing, other in zip(solid, expected["objects"]):
            position = sim_to_world(other["pos"], road_map)
            np.testing.assert_allclose((thing.x_m, thing.y_m), position, atol=1e-6)
            turned = math.degrees(thing.heading_rad) - other["angle_deg"]
            assert (turned + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-4)
            assert (thing.static, thing.optional) == (other["static"], other["optional"])


def test_objects_differ_from_the_reference_only_where_it_departs_from_the_format(
    data_dir: Path,
) -> None:
    udem1 = load_map(data_dir / "maps" / "duckietown" / "udem1.yaml")
    tree = udem1.objects[0]
    assert (tree.x_m, tree.y_m) == pytest.approx((2.5 * 0.585, 2.5 * 0.585))
    stop_sign = udem1.objects[2]  # rotate: 90, counter-clockwise
    assert stop_sign.heading_rad == pytest.approx(math.pi / 2)
    robotarium = load_map(data_dir / "maps" / "duckietown" / "robotarium1.yaml")
    signs = [thing for thing in robotarium.objects if thing.kind.startswith("sign")]
    assert signs
    assert len({(thing.x_m, thing.y_m) for thing in signs}) == len(signs)
    assert not any(robotarium.on_road(thing.x_m, thing.y_m) for thing in signs)


def test_both_object_styles_give_the_same_map(data_dir: Path) -> None:
    for name in ("udem1", "loop_obstacles"):
        new = load_map(data_dir / "maps" / "duckietown" / f"{name}.yaml")
        old = load_map(data_dir / "maps" / "duckietown_2020" / f"{name}.yaml")
        assert new.tiles == old.tiles
        assert [(o.kind, o.x_m, o.y_m, o.heading_rad, o.height_m) for o in new.objects] == [
            (o.kind, o.x_m, o.y_m, o.heading_rad, o.height_m) for o in old.objects
        ]


def test_every_file_loads_and_its_lanes_stay_on_their_tiles(data_dir: Path) -> None:
    files = sorted((data_dir / "maps").rglob("*.yaml"))
    assert len(files) > 40
    for road_map in [*map(load_map, files), *map(load_map, shipped_maps())]:
        for lane in road_map.lanes:
            centre = np.array([lane.tile_column + 0.5, road_map.rows - lane.tile_row - 0.5])
            offset = np.abs(lane.control_points_m / road_map.tile_size_m - centre)
            assert offset.max() == pytest.approx(0.5)


def test_start_tile_and_pose(data_dir: Path) -> None:
    maps = data_dir / "maps" / "duckietown"
    board = load_map(maps / "calibration_map_ext.yaml")
    assert board.start_tile == (3, 0)
    assert board.start_pose == pytest.approx(Pose(0.48, 4 * 0.585 - 0.2925, 0.0))
    assert load_map(maps / "straight_road_down.yaml").start_tile is None


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_shipped_roads_meet_and_objects_stand_beside_them(name: str) -> None:
    road_map = load_map(name)
    for tile in road_map.road_tiles:
        for side in tile.road_sides:
            row, column = tile.row + STEPS[side][0], tile.column + STEPS[side][1]
            assert 0 <= row < road_map.rows
            assert 0 <= column < road_map.columns
            assert OPPOSITE[side] in road_map.tiles[row][column].road_sides
    for thing in road_map.objects:
        assert not road_map.on_road(thing.x_m, thing.y_m), thing


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
    assert (tile.kind, tile.orientation, tile.row, tile.column) == (kind, orientation, 2, 3)
    bare = parse_tile(kind, 0, 0)
    assert (bare.kind, bare.orientation) == (kind, "E")


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


INFINITE_TAG = {"family": "36h11", "size": 1, "tag_id": math.inf}
GOOD: Dict[str, Any] = {"tiles": [["straight/E", "floor"]], "tile_size": 0.585}


@given(
    east=st.floats(0.0, 2.0),
    south=st.floats(0.0, 3.0),
    degrees=st.floats(-180.0, 180.0),
)
def test_the_position_forms_agree(east: float, south: float, degrees: float) -> None:
    """One place, written in each of the four forms, in a grid of 3 rows and 2 columns."""
    size_m = 0.6
    x_m, y_m = east * size_m, (3 - south) * size_m
    corner = (1 * size_m + 0.09, 2 * size_m + 0.035)  # slot 0 of tile [1, 2]
    forms: Dict[str, Any] = {
        "pos": {"pos": [east, south], "rotate": degrees},
        "pose": {"pose": transform(x_m, y_m, degrees)},
        "place": {
            "place": {
                "tile": [1, 0],
                "relative": transform(x_m - 1.5 * size_m, y_m - 0.5 * size_m, degrees),
            }
        },
        "attach": {
            "attach": {"tile": [1, 2], "slot": 0},
            "pose": transform(x_m - corner[0], y_m - corner[1], degrees),
        },
    }
    objects = {name: {"kind": "duckie", **form} for name, form in forms.items()}
    tiles = [["floor"] * 2] * 3
    road_map = read_map({"tiles": tiles, "tile_size": size_m, "objects": objects}, "forms")
    for thing in road_map.objects:
        assert (thing.x_m, thing.y_m) == pytest.approx((x_m, y_m), abs=1e-9)
        turned = thing.heading_rad - math.radians(degrees)
        assert math.cos(turned) == pytest.approx(1.0)


def transform(x_m: float, y_m: float, degrees: float) -> Dict[str, Any]:
    return {"~SE2Transform": {"p": [x_m, y_m], "theta_deg": degrees}}


def test_slots_are_in_metres_and_in_compat_in_tiles() -> None:
    sign = {"kind": "sign_stop", "attach": {"tile": [1, 1], "slot": 3}}
    data = {"tiles": [["floor"] * 2] * 2, "tile_size": 0.6, "objects": [sign]}
    ours, theirs = (read_map(data, "slots", compat).objects[0] for compat in (False, True))
    assert (ours.x_m, ours.y_m) == pytest.approx((0.6 - 0.09, 0.6 + 0.035))
    assert (theirs.x_m, theirs.y_m) == pytest.approx((0.6 * (1 - 0.09), 0.6 * (1 + 0.035)))


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
        ({"object": {}}, "did you mean 'objects'"),
        ({"start_tile": 3}, "start_tile: expected 2 numbers"),
        ({"objects": 3}, "expected objects as a mapping or a list"),
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
KEYS = (
    "kind",
    "pos",
    "pose",
    "place",
    "attach",
    "rotate",
    "height",
    "scale",
    "static",
    "color",
    "tag",
)


@settings(max_examples=200, deadline=None)
@given(
    changes=st.dictionaries(st.sampled_from([*GOOD, "start_tile", "start_pose"]), JUNK, max_size=2),
    thing=st.dictionaries(st.sampled_from(KEYS), JUNK, max_size=3),
)
def test_junk_is_refused_as_a_bad_map_or_read(changes: Any, thing: Any) -> None:
    objects = [{"kind": "duckie", "pos": [1, 1], **thing}]
    with contextlib.suppress(MapError):
        read_map({**GOOD, "objects": objects, **changes}, "junk")


def test_a_map_needs_its_tile_size() -> None:
    with pytest.raises(MapError, match="tile_size is missing"):
        read_map({"tiles": [["floor"]]}, "bad")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"kind": "duck", "pos": [1, 1]}, "unknown kind 'duck'; did you mean 'duckie'"),
        ({"pos": [1, 1]}, "unknown kind None"),
        ({"kind": ["duckie"], "pos": [1, 1]}, "unknown kind"),
        ({"kind": "duckie", "pos": [1, 10**400]}, "expected a number"),
        ({"kind": "duckie", "pos": [1, 1], "tag": INFINITE_TAG}, "~TagInstance"),
        ({"kind": "duckie"}, "expected one position"),
        ({"kind": "duckie", "pos": [1, 1], "pose": {}}, "got pos and pose"),
        ({"kind": "duckie", "pos": [1]}, "expected 2 numbers"),
        ({"kind": "duckie", "pos": [1, float("nan")]}, "expected a number"),
        ({"kind": "duckie", "pos": [1, 1], "height": 1, "scale": 1}, "height or scale, got both"),
        ({"kind": "duckie", "pos": [1, 1], "height": -1}, "above 0 m"),
        ({"kind": "duckie", "pos": [1, 1], "rotate": "left"}, "rotate: expected a number"),
        ({"kind": "duckie", "pos": [1, 1], "statik": False}, "did you mean 'static'"),
        ({"kind": "duckie", "pos": [1, 1], "static": "no"}, "expected true or false"),
        ({"kind": "sign_stop", "attach": {"tile": [0, 0], "slot": 8}}, "expected 0 to 7"),
        ({"kind": "sign_stop", "attach": {"tile": [9, 0], "slot": 0}}, "column 0 to 2"),
        ({"kind": "sign_stop", "place": {"relative": None}}, "place.tile: expected 2 numbers"),
        ({"kind": "duckie", "pose": {"~SE2Transform": [1, 2]}}, "with p and theta_deg"),
        ({"kind": "sign_stop", "pos": [1, 1], "tag": {"size": 1}}, "~TagInstance"),
        ("duckie", "expected a mapping"),
    ],
)
def test_bad_objects_are_refused(entry: Any, message: str) -> None:
    with pytest.raises(MapError, match=message):
        read_map({**GOOD, "objects": {"thing": entry}}, "bad")


def test_extra_keys_of_other_tools_are_tolerated() -> None:
    thing = {"kind": "duckie", "pos": [0.5, 0.5], "vendor": "x"}
    road_map = read_map({**GOOD, "version": 2, "author": "x", "objects": [thing]}, "extra")
    assert road_map.objects[0].kind == "duckie"


def test_an_unknown_map_is_refused_with_the_shipped_ones(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="did you mean 'arena'"):
        load_map("arenna")
    with pytest.raises(MapError, match="no such map file"):
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
