import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from localizer_node.calibration import map_outline
from localizer_node.detect import Detection, Detector
from robot.lens import Hanging
from tests.localizer_node.rigs import FISHEYE, LENSES, MAP_M, Rig, grid

yaws = st.floats(-math.pi, math.pi)
tilts = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))
heights = st.floats(0.0, 0.3)
rigs = st.builds(
    lambda lens, yaw, tilt: Rig(lens, yaw_rad=yaw, tilt_rad=tilt),
    st.sampled_from(LENSES),
    yaws,
    tilts,
)


@given(rigs, heights)
@settings(max_examples=60, deadline=None)
def test_pixels_agree_with_euclid_at_every_height(rig, height_m):
    places = grid(5, margin_m=0.2)
    pixels = rig.see(places, height_m)
    rectifier = rig.calibration()
    seen = np.isfinite(pixels).all(axis=1)
    assert seen.sum() > 20
    assert np.allclose(rectifier.to_pixels(places, height_m)[seen], pixels[seen], atol=1e-6)
    assert np.allclose(rectifier.camera.to_floor(pixels, height_m)[seen], places[seen], atol=2e-5)


@given(st.floats(0.01, 0.5), st.floats(0.1, 1.6), yaws, tilts)
@settings(max_examples=50, deadline=None)
def test_a_raised_point_is_displaced_outward_by_r_h_over_H_minus_h(h, r, azimuth, tilt):
    rig = Rig(FISHEYE, tilt_rad=tilt)
    foot, big_h = np.array(rig.position_m[:2]), rig.position_m[2]
    outward = np.array([math.cos(azimuth), math.sin(azimuth)])
    pixel = rig.see(foot + r * outward, h)
    on_floor = rig.calibration().camera.to_floor(pixel)
    assert np.allclose(on_floor - (foot + r * outward), outward * r * h / (big_h - h), atol=1e-5)


@given(yaws, tilts)
@example(0.0, (0.0, 1.2e-07))
@example(1.0, (1e-05, 0.0))
@example(math.pi, (0.125, 0.125))
@settings(max_examples=30, deadline=None)
def test_a_camera_hangs_as_its_rotation_says(yaw, tilt):
    rig = Rig(yaw_rad=yaw, tilt_rad=tilt)
    hanging = Hanging.of(np.array(rig.position_m), rig.to_camera.T)
    assert hanging.position_m == rig.position_m
    assert np.allclose(hanging.rotation, rig.to_camera.T, atol=1e-12)


def test_linearised_is_the_derivative():
    rectifier = Rig(tilt_rad=(0.08, 0.03)).calibration()
    pixels = np.array([[300.0, 200.0], [900.0, 600.0]])
    places, slope = rectifier.linearised(pixels, 0.12)
    step = np.array([1.5, -2.0])
    assert np.allclose(
        rectifier.camera.to_floor(pixels + step, 0.12), places + slope @ step, atol=3e-5
    )


def test_a_pixel_that_shows_no_floor_gives_nan():
    rig = Rig(replace(FISHEYE, fx_px=500.0, fy_px=500.0), tilt_rad=(0.9, 0.0))
    top_and_bottom = np.array([[640.0, 0.0], [640.0, 1279.0]])
    shown = np.isfinite(rig.calibration().camera.to_floor(top_and_bottom)).all(axis=1)
    assert shown.sum() == 1


def test_the_region_of_interest_bounds_the_search():
    calibration = Rig().calibration()
    assert calibration.roi_rect() == (0, 0, 1280, 1280)
    bounded = replace(calibration, roi_px=((100.5, 50.0), (1400.0, 60.0), (640.0, 600.2)))
    assert bounded.roi_rect() == (100, 50, 1280, 602)


def test_who_is_more_than_five_centimetres_beside_the_map_is_none_of_ours():
    inside = Detector(Rig().calibration())._inside
    for place, on_it in (
        ((-0.04, 1.0), True),
        ((2.24, 1.0), True),
        ((2.3, 1.0), False),
        ((1.0, -0.06), False),
        ((1.0, 1.0), True),
        ((math.nan, 1.0), False),
    ):
        assert inside(Detection("robot", "plain", *place, None, 1.0, 640.0, 640.0)) is on_it


def test_the_outline_runs_round_the_map():
    ring = map_outline(MAP_M, points_per_side=10)
    sides = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    assert len(ring) == 40
    assert sides.sum() == pytest.approx(2 * sum(MAP_M))
