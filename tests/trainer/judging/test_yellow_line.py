from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import ContractError
from robot.lens import DUCKIEBOT_LENS, CameraRig, Mount
from tests.trainer.judging.yellow_line import DASHES, detect_yellow_line, floor_table

RIG = CameraRig(DUCKIEBOT_LENS)
SIZE = (160, 120)
ASPHALT, YELLOW, WHITE, RED = (46, 46, 50), (224, 184, 44), (224, 224, 218), (196, 40, 40)
DASH_M, GAP_M, HALF_WIDTH_M = 0.047, 0.026, 0.0123
Curve = Callable[[float], tuple[float, float]]
REFERENCE_M = floor_table(RIG, *SIZE).reference_m


def draw(
    curve: Curve,
    rgb: tuple[int, int, int] = YELLOW,
    dashed: bool = True,
    size: tuple[int, int] = SIZE,
    rig: CameraRig = RIG,
) -> np.ndarray:
    """A road with one line along ``curve`` (metres ahead to a point of the robot frame)."""
    import cv2

    big = CameraRig(rig.lens.scaled(4 * size[0], 4 * size[1]), rig.mount)
    picture = np.full((4 * size[1], 4 * size[0], 3), ASPHALT, np.uint8)
    ways = np.arange(0.05, 1.2, DASH_M + GAP_M if dashed else 0.01)
    for way in ways:
        ends = np.linspace(way, way + (DASH_M if dashed else 0.011), 6)
        middles = np.array([curve(end) for end in ends])
        ahead = np.gradient(middles, axis=0)
        ahead /= np.hypot(*ahead.T)[:, None]
        left = np.stack((-ahead[:, 1], ahead[:, 0]), axis=1) * HALF_WIDTH_M
        outline = np.concatenate((middles + left, (middles - left)[::-1]))
        pixels = big.to_pixels(np.concatenate((outline, np.zeros((12, 1))), axis=1))
        if (np.abs(pixels) < 1e4).all():
            cv2.fillPoly(picture, [np.round(pixels).astype(np.int32)], rgb)
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def straight(offset_m: float, heading_rad: float = 0.0) -> Curve:
    """A line that passes the judged point at this distance to its right."""
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    start = (REFERENCE_M + offset_m * sin, -offset_m * cos)
    return lambda way: (start[0] + (way - 0.1) * cos, start[1] + (way - 0.1) * sin)


def arc(offset_m: float, radius_m: float) -> Curve:
    """A line that runs ahead beside the judged point, bending left with this radius."""
    return lambda way: (
        REFERENCE_M + radius_m * math.sin((way - 0.1) / radius_m),
        -offset_m + radius_m * (1.0 - math.cos((way - 0.1) / radius_m)),
    )


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.2, 0.2), st.floats(-0.5, 0.5))
def test_a_straight_line_is_found_where_it_is(offset_m: float, heading_rad: float) -> None:
    seen = detect_yellow_line(draw(straight(offset_m, heading_rad)), RIG)
    if not seen.found:  # it left the picture on the side that the robot turned away from
        assert offset_m * heading_rad > 0.0
        return
    # Dashes that the picture's edge cuts, or far ones alone, tell the side and little more.
    if len(seen.dashes) == DASHES and seen.dashes[0].x_m < 0.25:
        assert seen.offset_m == pytest.approx(offset_m, abs=0.03)
        assert seen.heading_rad == pytest.approx(heading_rad, abs=0.2)
    if abs(offset_m) > 0.01:
        assert seen.crossed is (offset_m > 0.0)


@pytest.mark.parametrize("radius_m", [0.3, 0.6, -0.6, -0.3])
@pytest.mark.parametrize("offset_m", [-0.1, -0.03, 0.03, 0.1])
def test_a_bend_is_followed(offset_m: float, radius_m: float) -> None:
    seen = detect_yellow_line(draw(arc(offset_m, radius_m)), RIG)
    assert seen.offset_m == pytest.approx(offset_m, abs=0.02)
    assert seen.crossed is (offset_m > 0.0)


def test_a_line_without_gaps_is_found_too() -> None:
    seen = detect_yellow_line(draw(straight(-0.1), dashed=False), RIG)
    assert len(seen.dashes) == DASHES
    assert seen.offset_m == pytest.approx(-0.1, abs=0.01)


@pytest.mark.parametrize("gains", [(1.0, 1.0, 0.6), (0.8, 1.1, 0.7), (1.15, 1.0, 1.2), (0.5,) * 3])
def test_the_light_does_not_matter(gains: tuple[float, float, float]) -> None:
    frame = draw(straight(-0.1, 0.1))
    tinted = np.clip(frame * np.array(gains), 0, 255).astype(np.uint8)
    plain, seen = detect_yellow_line(frame, RIG), detect_yellow_line(tinted, RIG)
    assert seen.offset_m == pytest.approx(plain.offset_m, abs=0.01)


def test_overexposed_paint_is_still_yellow() -> None:
    frame = draw(straight(-0.1))
    bright = np.clip(frame * np.array([1.6, 1.6, 1.0]), 0, 255).astype(np.uint8)
    assert detect_yellow_line(bright, RIG).offset_m == pytest.approx(-0.1, abs=0.02)


@pytest.mark.parametrize("rgb", [WHITE, RED, ASPHALT])
def test_other_lines_are_not_yellow(rgb: tuple[int, int, int]) -> None:
    seen = detect_yellow_line(draw(straight(0.05), rgb), RIG)
    assert (seen.found, seen.crossed, seen.dashes) == (False, None, ())
    assert math.isnan(seen.offset_m)


def test_a_yellow_patch_as_wide_as_a_duck_is_no_line() -> None:
    frame = draw(straight(0.0), ASPHALT)
    frame[70:100, 90:130] = YELLOW
    assert not detect_yellow_line(frame, RIG).found


def test_a_camera_that_sees_no_floor_sees_no_line() -> None:
    up = CameraRig(DUCKIEBOT_LENS, Mount(pitch_rad=-1.5))
    assert not detect_yellow_line(np.full((120, 160, 3), YELLOW, np.uint8), up).found


def test_the_size_of_the_picture_does_not_matter() -> None:
    small = detect_yellow_line(draw(straight(-0.1, 0.2)), RIG)
    large = detect_yellow_line(draw(straight(-0.1, 0.2), size=(640, 480)), RIG)
    assert small.offset_m == pytest.approx(large.offset_m, abs=0.01)


def test_the_drawn_line_passes_through_the_dashes() -> None:
    seen = detect_yellow_line(draw(arc(-0.1, 0.6)), RIG)
    line = np.array(seen.line_m)
    for dash in seen.dashes:
        assert np.hypot(*(line - (dash.x_m, dash.y_m)).T).min() < 0.05


@pytest.mark.parametrize("wrong", [np.zeros((120, 160)), np.zeros((120, 160, 3)), np.zeros(3)])
def test_what_is_no_picture_is_refused(wrong: np.ndarray) -> None:
    with pytest.raises(ContractError, match=r"expected \(H, W, 3\) uint8 RGB"):
        detect_yellow_line(wrong, RIG)
