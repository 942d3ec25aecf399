"""Paths: arc length, nearest points against brute force, batches against single paths."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import MapError, PlanError
from robot.navigation.path import NO_HINT, SPACING_M, Path, PathBatch, lane_loop
from robot.navigation.road_map import load_map, read_map

LOOP = lane_loop(load_map("loop"))
STRAIGHT = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
LEFT = np.array([[0.0, 0.0], [0.4, 0.0], [0.6, 0.2], [0.6, 0.6]])
RIGHT = np.array([[0.6, 0.6], [0.6, 1.0], [1.0, 1.2], [1.4, 1.2]])
OPEN = Path.from_beziers([LEFT, RIGHT])
PATHS = {"closed": LOOP, "open": OPEN}


def brute_force(path: Path, x: float, y: float) -> float:
    ends = np.roll(path.points_m, -1, axis=0) if path.closed else path.points_m[1:]
    starts = path.points_m[: len(ends)]
    best = math.inf
    for a, b in zip(starts, ends):
        along = np.clip(np.dot((x, y) - a, b - a) / np.dot(b - a, b - a), 0, 1)
        best = min(best, float(np.hypot(*(a + along * (b - a) - (x, y)))))
    return best


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_points_are_evenly_spaced_by_arc_length(path: Path) -> None:
    step = path.arc_m[1]
    assert step <= SPACING_M + 1e-9
    np.testing.assert_allclose(np.diff(path.arc_m), step)
    chords = np.hypot(*np.diff(path.points_m, axis=0).T)
    np.testing.assert_allclose(chords, step, rtol=0.01)
    assert path.length_m == pytest.approx(step * (len(path.arc_m) - (not path.closed)))


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
@settings(max_examples=40, deadline=None)
@given(x=st.floats(-0.5, 3.5), y=st.floats(-0.5, 2.5))
def test_projection_is_the_nearest_point(path: Path, x: float, y: float) -> None:
    found = path.project(x, y)
    foot = np.array(path.pose_at(found.arc_m)[:2])
    assert np.hypot(*(foot - (x, y))) == pytest.approx(brute_force(path, x, y), abs=1e-9)
    if 0 < found.arc_m < path.length_m:
        assert abs(found.offset_m) <= np.hypot(*(foot - (x, y))) + 1e-9
    assert 0 <= found.arc_m <= path.length_m + 1e-9


@settings(deadline=None)
@given(arc=st.floats(0.01, LOOP.length_m - 0.01), offset=st.floats(-0.1, 0.1))
def test_offset_is_positive_to_the_left(arc: float, offset: float) -> None:
    pose = LOOP.pose_at(arc)
    x, y = pose.to_world(np.array([0.0, offset]))
    found = LOOP.project(x, y)
    assert found.offset_m == pytest.approx(offset, abs=1e-3)
    assert LOOP.batch.advance_m(np.array([arc]), np.array([found.arc_m]))[0] == pytest.approx(
        0.0, abs=0.01
    )
    assert math.cos(found.heading_rad - pose.heading_rad) > 0.99


def test_a_hint_follows_two_laps_and_finds_what_a_whole_search_finds() -> None:
    rng = np.random.default_rng(0)
    hint, before, driven = None, 0.0, 0.0
    for arc in np.arange(0.0, 2 * LOOP.length_m, 0.036):
        x, y = LOOP.pose_at(arc).to_world(np.array([0.0, rng.normal(0.0, 0.02)]))
        found = LOOP.project(x, y, hint)
        assert found == LOOP.project(x, y)
        driven += LOOP.batch.advance_m(np.array([before]), np.array([found.arc_m]))[0]
        hint, before = found.index, found.arc_m
    assert driven == pytest.approx(2 * LOOP.length_m, abs=0.05)


def test_a_hint_moves_on_along_the_path_as_far_as_it_improves() -> None:
    path = Path.from_beziers([STRAIGHT])
    assert path.project(2.9, 0.1, hint=0).arc_m == pytest.approx(2.9)
    assert path.project(0.0, 0.1, hint=149).arc_m == pytest.approx(0.0)
    assert path.project(9.0, 0.0, hint=100).arc_m == pytest.approx(3.0)
    assert path.project(0.5, 0.1, hint=500).arc_m == pytest.approx(0.5), "of a longer path"
    beyond, last = LOOP.pose_at(0.5), LOOP.pose_at(-0.5)  # round a closed path's beginning, too
    for hint in range(len(LOOP.arc_m) - 20, len(LOOP.arc_m)):
        assert LOOP.project(*beyond[:2], hint=hint).arc_m == pytest.approx(0.5, abs=1e-3)
    for hint in range(20):
        arc_m = LOOP.project(*last[:2], hint=hint).arc_m
        assert arc_m == pytest.approx(LOOP.length_m - 0.5, abs=1e-3)


def test_a_hint_keeps_to_its_branch_where_the_path_crosses_itself() -> None:
    across = np.array([[1.5, 1.0], [1.5, 0.5], [1.5, -0.5], [1.5, -1.0]])
    back = np.array([[3.0, 0.0], [4.0, 0.0], [1.5, 3.0], [1.5, 1.0]])
    path = Path.from_beziers([STRAIGHT, back, across])
    first = path.project(1.5, 0.001, hint=int(1.4 / path.arc_m[1]))
    assert first.arc_m == pytest.approx(1.5, abs=1e-3)
    second = path.project(1.501, 0.0, hint=len(path.arc_m) - 55)
    assert second.arc_m == pytest.approx(path.length_m - 1.0, abs=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_batch_equals_single_paths(seed: int) -> None:
    rng = np.random.default_rng(seed)
    paths = [LOOP, OPEN, lane_loop(load_map("loop"), outer=False), Path.from_beziers([STRAIGHT])]
    xy = rng.uniform((-0.2, -0.2), (3.5, 2.4), (4, 2))
    hint = np.array([NO_HINT, 3, 90, NO_HINT])
    for batch, chosen in (
        (PathBatch(paths), paths),
        (PathBatch([LOOP]), [LOOP] * 4),
        (PathBatch(paths, np.array([2, 0, 1, 1])), [paths[i] for i in (2, 0, 1, 1)]),
    ):
        found = batch.project(xy, hint)
        for i, path in enumerate(chosen):
            one = path.project(*xy[i], None if hint[i] == NO_HINT else int(hint[i]))
            assert one.index == found.index[i]
            assert (one.arc_m, one.offset_m, one.heading_rad) == pytest.approx(
                (found.arc_m[i], found.offset_m[i], found.heading_rad[i]), abs=1e-12
            )
        ahead = batch.points_at(found.arc_m[:, None] + np.array([0.0, 0.3]))
        for i, path in enumerate(chosen):
            np.testing.assert_allclose(ahead[i, 1], path.pose_at(found.arc_m[i] + 0.3)[:2])


def test_a_path_in_a_batch_can_be_replaced_by_a_longer_one() -> None:
    batch = PathBatch([OPEN, OPEN])
    batch.replace(1, LOOP)
    xy = np.array([[0.1, 0.3], [3.2, 1.0]])
    found = batch.project(xy)
    assert found.arc_m[0] == OPEN.project(*xy[0]).arc_m
    assert found.arc_m[1] == LOOP.project(*xy[1]).arc_m
    np.testing.assert_allclose(batch.length_m, (OPEN.length_m, LOOP.length_m))


def test_the_index_at_an_arc_length_is_what_a_search_finds_there() -> None:
    batch = PathBatch([lane_loop(load_map("loop")), lane_loop(load_map("loop"), outer=False)])
    for arc_m in (0.011, 2.345, 6.789):
        arcs_m = np.full(2, arc_m)
        found = batch.project(batch.points_at(arcs_m[:, None])[:, 0])
        np.testing.assert_array_equal(batch.index_at(arcs_m), found.index)


def test_an_open_path_goes_on_straight_and_a_closed_one_round() -> None:
    end = OPEN.pose_at(OPEN.length_m)
    np.testing.assert_allclose(
        OPEN.pose_at(OPEN.length_m + 0.5)[:2], end.to_world(np.array([0.5, 0.0])), atol=1e-9
    )
    bent = Path.from_beziers([np.array([[0.0, 0.0], [0.4, 0.0], [0.6, 0.2], [0.6, 0.4]])])
    for beyond_m, heading_rad in ((-0.5, 0.0), (bent.length_m + 0.5, 0.5 * math.pi)):
        assert bent.pose_at(beyond_m).heading_rad == pytest.approx(heading_rad)
    np.testing.assert_allclose(LOOP.pose_at(LOOP.length_m + 0.5), LOOP.pose_at(0.5))


def test_lane_loop_of_the_shipped_ring() -> None:
    outer, inner = LOOP, lane_loop(load_map("loop"), outer=False)
    assert 9.0 < inner.length_m + 1.0 < outer.length_m < 10.0
    for path, turns in ((outer, 1), (inner, -1)):
        around = np.unwrap(np.append(path.headings_rad, path.headings_rad[0]))
        assert around[-1] - around[0] == pytest.approx(turns * 2 * math.pi)


def test_lane_loops_of_every_ring_are_smooth(data_dir: FilePath) -> None:
    rings = 0
    for file in sorted((data_dir / "maps").rglob("*.yaml")):
        road_map = load_map(file)
        for outer in (True, False):
            try:
                path = lane_loop(road_map, outer)
            except MapError:
                continue
            rings += 1
            closed = np.vstack((path.points_m, path.points_m[:1]))
            assert np.hypot(*np.diff(closed, axis=0).T).max() <= 1.001 * SPACING_M
    assert rings > 30


def test_of_several_rings_the_longest_counts() -> None:
    small = ["curve_left/W", "curve_left/N"], ["curve_left/S", "curve_left/E"]
    large = [[west, "straight/E", east] for west, east in small]
    for west, east, reaches in ((small, large, (1.5, 3.0)), (large, small, (0.0, 1.5))):
        tiles = [[*a, "grass", *b] for a, b in zip(west, east)]
        road_map = read_map({"tiles": tiles, "tile_size": 0.5}, "two rings")
        for outer in (True, False):
            x_m = lane_loop(road_map, outer).points_m[:, 0]
            assert reaches[0] < x_m.min() < x_m.max() < reaches[1]


@pytest.mark.parametrize(
    ("tiles", "message"),
    [
        ([["3way_left/N"]], "without junctions, got 3way_left at row 0, column 0"),
        ([["straight/E"]], "closed ring of road"),
        ([["grass"]], "closed ring of road"),
    ],
)
def test_lane_loop_refuses_what_is_no_ring(tiles: list[list[str]], message: str) -> None:
    with pytest.raises(MapError, match=message):
        lane_loop(read_map({"tiles": tiles, "tile_size": 0.5}, "no ring"))


def test_beziers_must_follow_one_another() -> None:
    with pytest.raises(PlanError, match=r"gap of 3\.000 m after number 0"):
        Path.from_beziers([STRAIGHT, STRAIGHT])
    with pytest.raises(PlanError, match="got none"):
        Path.from_beziers([])
