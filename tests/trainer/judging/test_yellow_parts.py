"""The steps from paint to a yellow line, by hand: on floors that are grids of square pixels."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robot.lens import CameraRig, Lens, Mount
from tests.trainer.judging import yellow_line
from tests.trainer.judging.yellow_line import (
    Dash,
    FloorTable,
    chain,
    detect_yellow_line,
    find_dashes,
    fit_line,
    floor_table,
    yellow_mask,
)

ROAD = (50, 50, 50)


def grid(rows: int, columns: int, pixel_m: float = 0.01) -> FloorTable:
    """Row 0 is farthest ahead, column 0 farthest to the left; all of it is near."""
    ahead, left = np.mgrid[rows - 1 : -1 : -1, columns - 1 : -1 : -1] * pixel_m
    near = np.ones((rows, columns), bool)
    return FloorTable(np.stack((ahead, left), axis=-1), np.full(near.shape, pixel_m**2), near, 0.1)


def dash(x_m: float, y_m: float, direction_rad: float = 0.0) -> Dash:
    return Dash(x_m, y_m, direction_rad, 0.05, 0.02, 20)


def seen_colour(rgb: tuple[int, int, int], road: tuple[int, int, int] = ROAD) -> bool:
    """Is one pixel of this colour on such a road taken for paint?"""
    frame = np.full((5, 5, 3), road, np.uint8)
    frame[2, 2] = rgb
    mask = yellow_mask(frame, grid(5, 5))
    assert mask.sum() == mask[2, 2], "the road itself is none"
    return bool(mask[2, 2])


def hued(hue_deg: float, saturation: float, value: float) -> tuple[int, int, int]:
    """RGB of a hue between red and green."""
    low = value * (1.0 - saturation)
    rising = low + (value - low) * (hue_deg / 60.0 if hue_deg <= 60.0 else (120.0 - hue_deg) / 60.0)
    red, green = (value, rising) if hue_deg <= 60.0 else (rising, value)
    return (round(255 * red), round(255 * green), round(255 * low))


@pytest.mark.parametrize(
    ("hue_deg", "saturation", "value", "yellow"),
    [
        (50.0, 0.6, 0.8, True),
        (33.0, 0.6, 0.8, True),
        (31.0, 0.6, 0.8, False),  # orange
        (71.0, 0.6, 0.8, True),
        (73.0, 0.6, 0.8, False),  # green
        (50.0, 0.38, 0.8, True),
        (50.0, 0.33, 0.8, False),  # cream
        (50.0, 0.6, 0.29, True),
        (50.0, 0.6, 0.25, False),  # hardly brighter than the road: 1.35 times 51/255
    ],
)
def test_what_is_yellow_on_a_grey_road(
    hue_deg: float, saturation: float, value: float, yellow: bool
) -> None:
    assert seen_colour(hued(hue_deg, saturation, value)) is yellow


@pytest.mark.parametrize(("value", "yellow"), [(0.24, True), (0.20, False)])
def test_on_the_darkest_road_noise_is_not_paint(value: float, yellow: bool) -> None:
    assert seen_colour(hued(50.0, 0.9, value), road=(5, 5, 5)) is yellow


def test_on_the_brightest_road_a_clipped_pixel_may_still_be_paint() -> None:
    assert seen_colour((235, 200, 80), road=(200, 200, 200))
    assert not seen_colour((220, 190, 70), road=(200, 200, 200))


def test_colours_are_told_in_the_light_of_the_road() -> None:
    """A blue road makes white paint of what looks blue, and yellow of what looks grey."""
    assert seen_colour((200, 180, 150), road=(40, 40, 80))
    assert not seen_colour((200, 180, 150))
    assert not seen_colour((180, 160, 80), road=(60, 60, 25)), "white in warm light"


def test_the_balance_is_two_and_a_half_at_most() -> None:
    """More would turn the weak blue of yellow paint into as much as its red and green."""
    assert seen_colour((200, 180, 40), road=(100, 100, 10))
    assert not seen_colour((200, 180, 70), road=(100, 100, 10))


def test_a_black_road_has_a_colour_too() -> None:
    """One grey level more than it shows: gains of 6 / 4 for what is (3, 3, 5)."""
    assert seen_colour((90, 80, 85), road=(3, 3, 5))
    assert not seen_colour((90, 80, 95), road=(3, 3, 5))


def test_what_the_balance_overexposes_has_no_colour() -> None:
    """Doubled red and green are clipped: a third brighter than blue, not three quarters."""
    assert not seen_colour((200, 180, 175), road=(50, 50, 100))


def test_overexposed_pixels_count_by_their_own_colour_when_it_is_strong() -> None:
    """The balance of a bluish road turns them to another hue; only the camera's own still tells."""
    road = (100, 60, 60)
    assert seen_colour((255, 200, 100), road=road), "saturation 0.61"
    assert not seen_colour((255, 215, 130), road=road), "saturation 0.49"
    assert not seen_colour((220, 172, 86), road=road), "as strong, but not clipped"


def test_nothing_is_paint_that_is_not_near() -> None:
    floor = grid(4, 4)
    frame = np.full((4, 4, 3), ROAD, np.uint8)
    frame[:2] = (220, 180, 40)
    assert yellow_mask(frame, floor).sum() == 8
    floor.near[0] = False
    mask = yellow_mask(frame, floor)
    assert (mask.sum(), mask[1].all()) == (4, True)
    floor.near[:] = False
    assert not yellow_mask(frame, floor).any()


def test_a_bar_is_a_dash_with_its_middle_direction_and_size() -> None:
    floor, mask = grid(40, 40), np.zeros((40, 40), bool)
    mask[10:16, 20:22] = True  # 6 by 2 cm: rows 24 to 29, columns 18 and 19 of the floor
    (found,) = find_dashes(mask, floor)
    assert (found.x_m, found.y_m) == pytest.approx((0.265, 0.185))
    assert found.direction_rad == pytest.approx(0.0, abs=1e-9)
    # of middles of pixels: variance (n^2 - 1) / 12 of n
    assert found.length_m == pytest.approx(0.01 * math.sqrt(35.0))
    assert found.width_m == pytest.approx(0.01 * math.sqrt(3.0))
    assert found.pixels == 12


@pytest.mark.parametrize(("step", "direction_deg"), [(1, -45.0), (-1, 45.0)])
def test_the_direction_of_a_slanted_dash(step: int, direction_deg: float) -> None:
    """Row by row nearer; columns to the right or to the left. Pixels touch by their corners."""
    floor, mask = grid(40, 40), np.zeros((40, 40), bool)
    for k in range(5):
        mask[10 + k, 20 - step * k] = True
    (found,) = find_dashes(mask, floor)
    assert math.degrees(found.direction_rad) == pytest.approx(direction_deg)
    assert found.length_m == pytest.approx(0.01 * math.sqrt(2.0 * 24.0))


def test_a_dash_across_has_a_quarter_turn() -> None:
    floor, mask = grid(40, 40), np.zeros((40, 40), bool)
    mask[10, 20:25] = True
    (found,) = find_dashes(mask, floor)
    assert abs(found.direction_rad) == pytest.approx(math.pi / 2.0)


def test_pixels_weigh_as_much_as_the_floor_that_they_cover() -> None:
    floor, mask = grid(40, 40), np.zeros((40, 40), bool)
    mask[10:14, 20] = True  # 26 to 29 cm ahead
    floor.area_m2[10] *= 5.0
    (found,) = find_dashes(mask, floor)
    assert found.x_m == pytest.approx((5 * 0.29 + 0.28 + 0.27 + 0.26) / 8)


@pytest.mark.parametrize(
    ("rows", "columns", "pieces"),
    [(2, 1, 0), (3, 1, 1), (11, 2, 1), (13, 2, 2), (24, 2, 3), (40, 6, 5), (40, 7, 0)],
)
def test_blobs_are_cut_to_dashes_and_wide_ones_are_none(
    rows: int, columns: int, pieces: int
) -> None:
    """Of 8 cm each, from three pixels on, up to 6 cm wide."""
    floor, mask = grid(60, 20), np.zeros((60, 20), bool)
    mask[5 : 5 + rows, 3 : 3 + columns] = True
    found = find_dashes(mask, floor)
    assert len(found) == pieces
    if pieces:
        assert sum(each.pixels for each in found) == rows * columns
        assert len({each.pixels for each in found}) <= 2


def test_two_blobs_are_two_dashes() -> None:
    floor, mask = grid(40, 40), np.zeros((40, 40), bool)
    mask[5:10, 3:5] = mask[15:20, 3:5] = True
    assert sorted(each.x_m for each in find_dashes(mask, floor)) == pytest.approx([0.22, 0.32])


def test_the_floor_of_a_pinhole_camera_by_hand() -> None:
    """It looks straight down from 1 m: a pixel is 1 cm, and ahead is up in the picture."""
    lens = Lens("pinhole", 40, 20, 100.0, 100.0, 19.5, 9.5)
    rig = CameraRig(lens, Mount(height_m=1.0, forward_m=0.0, pitch_rad=math.pi / 2.0))
    floor = floor_table(rig, 40, 20, 0.1)
    assert floor.points_m[0, 0] == pytest.approx((0.095, 0.195))
    np.testing.assert_allclose(floor.area_m2, 1e-4)
    x, y = floor.points_m[..., 0], floor.points_m[..., 1]
    np.testing.assert_array_equal(floor.near, (x > 0.0) & (x * x + y * y < 0.01))
    assert 0 < floor.near.sum() < 400
    assert floor.reference_m == pytest.approx(-0.1), "the edge, not the last pixel's middle"
    half = floor_table(rig, 20, 10, 0.1)
    assert half.points_m[0, 0] == pytest.approx((0.09, 0.19))
    np.testing.assert_allclose(half.area_m2, 4e-4)


def test_a_camera_that_looks_aside_sees_the_same_floor_turned() -> None:
    lens = Lens("pinhole", 40, 20, 100.0, 100.0, 19.5, 9.5)
    down = Mount(height_m=1.0, forward_m=0.0, pitch_rad=math.pi / 2.0)
    floor = floor_table(CameraRig(lens, replace(down, yaw_rad=0.5)), 40, 20, 0.1)
    np.testing.assert_allclose(floor.area_m2, 1e-4)
    assert floor.reference_m == pytest.approx(-0.1 * math.cos(0.5)), "of the middle column"


def test_what_a_line_may_be() -> None:
    """The figures themselves: nothing else says how large paint is."""
    names = """HUE_DEG MIN_SATURATION RAW_SATURATION MIN_VALUE BRIGHTER MAX_GAIN RANGE_M MIN_PIXELS
        MAX_WIDTH_M DASH_M DASHES MAX_STEP_M MAX_TURN_RAD ALONE_M MAX_BEND_PM MAX_EXTENSION"""
    assert [getattr(yellow_line, name) for name in names.split()] == [
        *((32.0, 72.0), 0.35, 0.55, 0.22, 1.35, 2.5, 1.0, 3),
        *(0.06, 0.08, 5, 0.25, 0.9, 0.5, 2.5, 2.0),
    ]


def test_a_chain_begins_with_the_nearest_and_takes_five() -> None:
    dashes = tuple(dash(0.2 + 0.1 * k, 0.0) for k in range(8))
    assert chain(dashes[::-1]) == dashes[:5]
    assert chain(()) == ()


def test_the_nearest_of_two_that_follow_comes_first() -> None:
    first, near, far = dash(0.2, 0.0), dash(0.3, 0.0), dash(0.4, 0.0)
    assert chain((far, first, near)) == (first, near, far)


@pytest.mark.parametrize(("step_m", "dashes"), [(0.24, 2), (0.26, 1)])
def test_a_chain_ends_at_a_gap(step_m: float, dashes: int) -> None:
    assert len(chain((dash(0.2, 0.0), dash(0.2, step_m)))) == dashes


@pytest.mark.parametrize(("turn_rad", "dashes"), [(0.88, 3), (-0.88, 3), (0.92, 2), (-0.92, 2)])
def test_a_chain_does_not_turn_off(turn_rad: float, dashes: int) -> None:
    third = dash(0.3 + 0.1 * math.cos(turn_rad), 0.1 * math.sin(turn_rad))
    assert len(chain((dash(0.2, 0.0), dash(0.3, 0.0), third))) == dashes


def test_a_chain_may_lead_backwards() -> None:
    """Bearings of 177 and -177 degrees are 6 degrees apart."""
    dashes = (dash(0.0, 0.1), dash(-0.1, 0.105), dash(-0.2, 0.1))
    assert chain(dashes) == dashes


@pytest.mark.parametrize(("x_m", "dashes"), [(0.49, 1), (0.51, 0)])
def test_a_far_dash_alone_is_no_line(x_m: float, dashes: int) -> None:
    assert len(chain((dash(0.0, x_m),))) == dashes
    assert len(chain((dash(x_m, 0.0),))) == dashes
    assert len(chain((dash(x_m, 0.0), dash(x_m + 0.1, 0.0)))) == 2


def test_one_dash_is_a_straight_line_along_its_direction() -> None:
    """It runs by 45 degrees through (0.3, 0.1); the point at 0.1 m lies right of it."""
    line = fit_line((dash(0.3, 0.1, math.pi / 4.0),), 0.1)
    assert line.found
    assert line.heading_rad == pytest.approx(math.pi / 4.0)
    assert line.offset_m == pytest.approx(0.1 / math.sqrt(2.0))
    assert line.crossed
    assert not fit_line((dash(0.3, 0.1, 0.0),), 0.1).crossed
    points = np.array(line.line_m)
    assert points.shape == (12, 2)
    assert points[0] == pytest.approx((0.15, -0.05)), "abreast of the judged point"
    assert points[-1] == pytest.approx((0.3, 0.1))


def test_two_dashes_are_a_straight_line_whatever_their_directions() -> None:
    line = fit_line((dash(0.2, -0.1, 1.0), dash(0.3, -0.05, -1.0)), 0.1)
    assert line.heading_rad == pytest.approx(math.atan(0.5))
    assert line.offset_m == pytest.approx(0.15 * math.cos(math.atan(0.5)))
    assert len(line.dashes) == 2


@pytest.mark.parametrize("bend_pm", [1.0, -2.0])
def test_three_dashes_are_a_parabola(bend_pm: float) -> None:
    """y = b (x - 0.2)^2 - 0.05, its chord from first to third dash along x."""
    ways = (0.1, 0.2, 0.3)
    dashes = tuple(dash(x, bend_pm * (x - 0.2) ** 2 - 0.05) for x in ways)
    line = fit_line(dashes, 0.05)
    slope = 2.0 * bend_pm * -0.15
    assert line.heading_rad == pytest.approx(math.atan(slope))
    at = bend_pm * 0.15**2 - 0.05
    assert line.offset_m == pytest.approx(-at / math.hypot(1.0, slope))
    for x, y in line.line_m:
        assert y == pytest.approx(bend_pm * (x - 0.2) ** 2 - 0.05)
    assert line.line_m[0][0] == pytest.approx(0.05)
    assert line.line_m[-1][0] == pytest.approx(0.3)


def test_no_line_bends_more_than_the_tightest() -> None:
    dashes = tuple(dash(x, 6.0 * (x - 0.2) ** 2) for x in (0.1, 0.2, 0.3))
    for side in (1.0, -1.0):
        line = fit_line(tuple(each._replace(y_m=side * each.y_m) for each in dashes), 0.2)
        x, y = np.array(line.line_m).T
        np.testing.assert_allclose(np.diff(y, 2) / np.diff(x)[0] ** 2, side * 2.0 * 2.5)


@pytest.mark.parametrize(("reference_m", "bent"), [(0.11, True), (0.09, False)])
def test_a_short_piece_far_away_tells_no_bend(reference_m: float, bent: bool) -> None:
    """From 0.5 m on, 0.2 m long: carried on for 0.4 m at most."""
    dashes = tuple(dash(x, 2.0 * (x - 0.6) ** 2) for x in (0.5, 0.6, 0.7))
    line = fit_line(dashes, reference_m)
    assert (abs(line.heading_rad) > 0.1) is bent


def test_a_line_is_judged_along_its_first_three_dashes() -> None:
    """A chord to the fourth would turn the frame, and the line with it beyond a quarter turn."""
    ring = [(0.2 * math.sin(a), 0.2 - 0.2 * math.cos(a)) for a in (0.2, 0.5, 0.8, 1.5, 2.2)]
    line = fit_line(tuple(dash(0.1 + x, y) for x, y in ring[:3]), 0.1)
    longer = fit_line(tuple(dash(0.1 + x, y) for x, y in ring), 0.1)
    assert longer.heading_rad == pytest.approx(line.heading_rad, abs=0.5)
    assert line.heading_rad == pytest.approx(0.0, abs=0.1)


def test_a_chain_that_comes_towards_the_robot_still_leads_ahead() -> None:
    line = fit_line((dash(0.3, 0.1), dash(0.2, 0.1)), 0.1)
    assert line.heading_rad == pytest.approx(0.0)
    assert line.offset_m == pytest.approx(-0.1)


def test_any_size_of_picture_is_taken() -> None:
    lens = Lens("pinhole", 40, 20, 100.0, 100.0, 19.5, 9.5)
    rig = CameraRig(lens, Mount(height_m=1.0, forward_m=0.12, pitch_rad=math.pi / 2.0))
    frame = np.full((20, 40, 3), ROAD, np.uint8)
    frame[2:16, 10:12] = (220, 180, 40)  # 9 cm left of the middle
    found = detect_yellow_line(frame, rig)
    assert found.offset_m == pytest.approx(-0.09, abs=1e-3)
    assert found.heading_rad == pytest.approx(0.0, abs=1e-3)
    assert len(found.dashes) == 2
