"""What stands on a map, against the reference simulator's figures; refusals say what is wrong."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import MapError
from robot.navigation.map_objects import objects_of
from robot.navigation.road_map import load_map, read_map
from tests.robot.navigation.oracle import oracle_map, oracle_maps, reference_place, sim_to_world


@pytest.fixture(scope="session")
def oracle(data_dir: Path) -> dict[str, Any]:
    return oracle_maps(data_dir)


GOOD: dict[str, Any] = {"tiles": [["straight/E", "floor"]], "tile_size": 0.585}


def test_objects_equal_the_reference_but_for_its_mistakes(
    data_dir: Path, oracle: dict[str, Any]
) -> None:
    for name, expected in oracle.items():
        road_map = oracle_map(data_dir, name)
        solid = [thing for thing in objects_of(road_map) if thing.kind != "floor_tag"]
        assert [thing.kind for thing in solid] == [o["kind"] for o in expected["objects"]]
        for thing, other in zip(solid, expected["objects"]):
            position = sim_to_world(other["pos"], road_map)
            place = reference_place(thing, road_map)
            np.testing.assert_allclose(place[:2], position, atol=1e-6)
            turned = math.degrees(place.heading_rad) - other["angle_deg"]
            assert (turned + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-4)
            assert (thing.static, thing.optional) == (other["static"], other["optional"])


def test_objects_differ_from_the_reference_only_where_it_departs_from_the_format(
    data_dir: Path,
) -> None:
    udem1 = load_map(data_dir / "maps" / "duckietown" / "udem1.yaml")
    tree = objects_of(udem1)[0]
    assert (tree.x_m, tree.y_m) == pytest.approx((2.5 * 0.585, 2.5 * 0.585))
    stop_sign = objects_of(udem1)[2]  # rotate: 90, counter-clockwise
    assert stop_sign.heading_rad == pytest.approx(math.pi / 2)
    robotarium = load_map(data_dir / "maps" / "duckietown" / "robotarium1.yaml")
    signs = [thing for thing in objects_of(robotarium) if thing.kind.startswith("sign")]
    assert signs
    assert len({(thing.x_m, thing.y_m) for thing in signs}) == len(signs)
    assert not any(robotarium.on_road(thing.x_m, thing.y_m) for thing in signs)


def test_both_object_styles_give_the_same_map(data_dir: Path) -> None:
    for name in ("udem1", "loop_obstacles"):
        new = load_map(data_dir / "maps" / "duckietown" / f"{name}.yaml")
        old = load_map(data_dir / "maps" / "duckietown_2020" / f"{name}.yaml")
        assert new.tiles == old.tiles
        assert [(o.kind, o.x_m, o.y_m, o.heading_rad, o.height_m) for o in objects_of(new)] == [
            (o.kind, o.x_m, o.y_m, o.heading_rad, o.height_m) for o in objects_of(old)
        ]


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
    forms: dict[str, Any] = {
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
    for thing in objects_of(road_map):
        assert (thing.x_m, thing.y_m) == pytest.approx((x_m, y_m), abs=1e-9)
        turned = thing.heading_rad - math.radians(degrees)
        assert math.cos(turned) == pytest.approx(1.0)


def transform(x_m: float, y_m: float, degrees: float) -> dict[str, Any]:
    return {"~SE2Transform": {"p": [x_m, y_m], "theta_deg": degrees}}


def test_slots_are_in_metres() -> None:
    sign = {"kind": "sign_stop", "attach": {"tile": [1, 1], "slot": 3}}
    data = {"tiles": [["floor"] * 2] * 2, "tile_size": 0.6, "objects": [sign]}
    (found,) = objects_of(read_map(data, "slots"))
    assert (found.x_m, found.y_m) == pytest.approx((0.6 - 0.09, 0.6 + 0.035))


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"kind": "duck", "pos": [1, 1]}, "unknown kind 'duck'; did you mean 'duckie'"),
        ({"pos": [1, 1]}, "unknown kind None"),
        ({"kind": ["duckie"], "pos": [1, 1]}, "unknown kind"),
        ({"kind": "duckie", "pos": [1, 10**400]}, "expected a number"),
        ({"kind": "duckie"}, "expected one position"),
        ({"kind": "duckie", "pos": [1, 1], "pose": {}}, "got pos and pose"),
        ({"kind": "duckie", "pos": [1]}, "expected 2 numbers"),
        ({"kind": "duckie", "pos": [1, 1, 1]}, "expected 2 numbers"),
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
        ("duckie", "expected a mapping"),
    ],
)
def test_bad_objects_are_refused(entry: Any, message: str) -> None:
    with pytest.raises(MapError, match=message):
        objects_of(read_map({**GOOD, "objects": {"thing": entry}}, "bad"))


def test_extra_keys_of_other_tools_are_tolerated() -> None:
    thing = {"kind": "duckie", "pos": [0.5, 0.5], "vendor": "x"}
    road_map = read_map({**GOOD, "version": 2, "author": "x", "objects": [thing]}, "extra")
    assert objects_of(road_map)[0].kind == "duckie"


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_objects_of_shipped_maps_stand_beside_the_road(name: str) -> None:
    road_map = load_map(name)
    for thing in objects_of(road_map):
        assert not road_map.on_road(thing.x_m, thing.y_m), thing


def test_objects_are_a_mapping_or_a_list() -> None:
    with pytest.raises(MapError, match="expected objects as a mapping or a list"):
        objects_of(read_map({**GOOD, "objects": 3}, "bad"))


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
@given(thing=st.dictionaries(st.sampled_from(KEYS), JUNK, max_size=3))
def test_junk_is_refused_as_a_bad_object_or_read(thing: Any) -> None:
    objects = [{"kind": "duckie", "pos": [1, 1], **thing}]
    with contextlib.suppress(MapError):
        objects_of(read_map({**GOOD, "objects": objects}, "junk"))
