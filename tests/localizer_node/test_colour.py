import math
from functools import partial

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from localizer_node.calibration import DEFAULT_COLOURS, Colour
from localizer_node.colour import blobs, mask_of
from tests.localizer_node.rigs import FLOOR_RGB, PAINT

to_hsv = partial(cv2.cvtColor, code=cv2.COLOR_RGB2HSV)
BLUE = DEFAULT_COLOURS[0]


def square(centre, half, colour="blue", size=60):
    """A square with sides that end anywhere within a pixel."""
    fine = np.empty((size * 16, size * 16, 3), np.uint8)
    fine[:] = FLOOR_RGB
    low = np.round((np.array(centre) + 0.5 - half) * 16).astype(int)
    high = np.round((np.array(centre) + 0.5 + half) * 16).astype(int)
    fine[low[1] : high[1], low[0] : high[0]] = PAINT[colour]
    return cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA)


@given(st.floats(20.0, 40.0), st.floats(20.0, 40.0), st.floats(4.0, 12.0))
def test_the_centroid_is_right_to_a_fraction_of_a_pixel(u, v, half):
    image = square((u, v), half)
    (blob,) = blobs(image, mask_of(to_hsv(image), BLUE), 20.0, 1e3)
    assert blob.centre_px == pytest.approx((u, v), abs=0.2)
    assert math.sqrt(blob.area_px) == pytest.approx(2.0 * half, abs=1.7)


def test_a_shadow_over_half_the_board_does_not_pull_the_centroid():
    image = square((30.2, 29.7), 9.0)
    image[:, :30] = (image[:, :30] * 0.6).astype(np.uint8)
    (blob,) = blobs(image, mask_of(to_hsv(image), BLUE), 20.0, 1e3)
    assert blob.centre_px == pytest.approx((30.2, 29.7), abs=0.3)


@given(st.sampled_from(sorted(PAINT)), st.floats(0.45, 1.2))
def test_each_paint_has_its_own_colour_in_any_light(paint, light):
    pixel = np.clip(np.array(PAINT[paint]) * light, 0, 255).astype(np.uint8).reshape(1, 1, 3)
    hit = {c.name for c in DEFAULT_COLOURS if mask_of(to_hsv(pixel), c)[0, 0]}
    assert hit == ({paint} if paint != "white" else set())


def test_a_carpet_of_three_shades_of_blue_is_no_board():
    """Each shade is the odd one in hue, saturation or value, so none is like most of it."""
    hsv = np.empty((120, 120, 3), np.uint8)
    for k, shade in enumerate(((100, 200, 160), (115, 150, 160), (115, 200, 240))):
        hsv[:, k::3] = shade
    image = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)
    assert blobs(image, np.full((120, 120), 255, np.uint8), 200.0, 1e3) == []


def test_hues_wrap_around_red():
    red = Colour("red", 340.0, 20.0)
    hues = np.array([0, 5, 15, 90, 165, 172, 179], np.uint8)
    hsv = np.stack((hues, np.full(7, 200, np.uint8), np.full(7, 200, np.uint8)), axis=-1)[None]
    assert (mask_of(hsv, red)[0] > 0).tolist() == [True, True, False, False, False, True, True]


def test_one_hue_is_not_all_of_them():
    hsv = np.stack((np.array([10, 59, 60, 61], np.uint8), *np.full((2, 4), 200, np.uint8)), -1)
    assert (mask_of(hsv[None], Colour("one", 120.0, 120.0))[0] > 0).tolist() == [0, 0, 1, 0]


HUES = {"blue": (200, 250), "green": (95, 165), "magenta": (285, 335), "orange": (10, 36)}
LEAST = {"blue": (0.4, 0.18), "green": (0.35, 0.18), "magenta": (0.4, 0.18), "orange": (0.55, 0.4)}


def test_the_colours_that_boards_may_have():
    """Apart by more than a camera's white balance turns them."""
    boxes = {c.name: (c.hue_min_deg, c.hue_max_deg) for c in DEFAULT_COLOURS}
    assert boxes == HUES
    assert {c.name: (c.saturation_min, c.value_min) for c in DEFAULT_COLOURS} == LEAST
    edges = sorted(HUES.values())
    gaps = [low - high for (_, high), (low, _) in zip(edges, [*edges[1:], (370, 0)])]
    assert min(gaps) >= 35


def test_blobs_come_largest_first_and_specks_not_at_all():
    image = square((15.0, 15.0), 4.0)
    image[40:55, 40:55] = PAINT["blue"]
    image[5, 50] = PAINT["blue"]
    found = blobs(image, mask_of(to_hsv(image), BLUE), 20.0, 1e3)
    assert [round(b.centre_px[0]) for b in found] == [47, 15]


def test_on_a_floor_of_its_own_colour_a_board_is_found_and_the_floor_is_not():
    image = square((30.0, 30.0), 6.0)
    image[:10] = image[-10:] = image[:, :10] = image[:, -10:] = PAINT["blue"]
    image[29:32, 29:32] = FLOOR_RGB
    (blob,) = blobs(image, mask_of(to_hsv(image), BLUE), 20.0, 1e3)
    assert blob.centre_px == pytest.approx((30.0, 30.0), abs=0.1)
    assert math.sqrt(blob.area_px) == pytest.approx(12.0, abs=1.7)
