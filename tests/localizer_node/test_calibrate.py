import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from localizer_node.calibrate import KnownPoint, calibrate, corner_points, guess_lens
from localizer_node.calibration import Board, Marker, map_corners, map_outline
from localizer_node.detect import Detector
from robot.bringup.camera_place import Freedom, fit_camera
from robot.errors import ConfigError
from robot.lens import Lens
from tests.localizer_node.rigs import FISHEYE, LENSES, MAP_M, PINHOLE, SIDE_PX, Rig, grid

CORNERS = map_corners(MAP_M)
yaws = st.floats(-math.pi, math.pi)
tilts = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))


def board_error_mm(report, rig, height_m=0.12):
    """RMS error of boards all over the map, seen by the true camera."""
    places = grid(6, margin_m=0.1)
    found = report.calibration.camera.to_floor(rig.see(places, height_m), height_m)
    return 1000.0 * float(np.sqrt(np.mean(np.sum((found - places) ** 2, axis=1))))


@given(st.sampled_from(LENSES), yaws, tilts)
@example(FISHEYE, 1.0, (1e-05, 0.0))
@settings(max_examples=25, deadline=None)
def test_a_known_lens_and_four_corners_give_back_the_camera(lens, yaw, tilt):
    rig = Rig(lens, yaw_rad=yaw, tilt_rad=tilt, position_m=(1.0, 1.4, 3.0))
    report = calibrate(rig.known(CORNERS), lens, Freedom(), MAP_M)
    assert report.calibration.residual_mm < 0.01
    assert np.allclose(report.calibration.hanging.position_m, rig.position_m, atol=1e-3)
    assert board_error_mm(report, rig) < 0.1


@given(yaws, tilts, st.floats(400.0, 800.0))
@settings(max_examples=15, deadline=None)
def test_an_unknown_fisheye_is_found_from_points_and_height(yaw, tilt, focal):
    lens = guess_lens("fisheye", SIDE_PX, SIDE_PX)
    true = replace(lens, fx_px=focal, fy_px=focal)
    rig = Rig(true, yaw_rad=yaw, tilt_rad=tilt, position_m=(1.0, 1.4, 3.3))
    report = calibrate(rig.known(CORNERS), lens, Freedom(True, height_m=3.3), MAP_M)
    assert report.calibration.lens.fx_px == pytest.approx(focal, rel=1e-4)
    assert board_error_mm(report, rig) < 0.2


def test_more_points_fix_the_height_and_the_distortion_too():
    rig = Rig(yaw_rad=1.0, tilt_rad=(0.05, -0.08))
    start = guess_lens("fisheye", SIDE_PX, SIDE_PX)
    free = calibrate(rig.known(grid(5), 0.3), start, Freedom(True), MAP_M)
    assert free.calibration.hanging.position_m[2] == pytest.approx(2.5, abs=0.15)
    measured = calibrate(rig.known(grid(5), 0.3), start, Freedom(True, 1, 2.5), MAP_M)
    assert board_error_mm(free, rig) < 6.0
    assert board_error_mm(measured, rig) < 4.0


def test_clicks_half_a_pixel_off_still_place_a_board_within_a_centimetre():
    errors = []
    for seed in range(8):
        rig = Rig(yaw_rad=seed, tilt_rad=(0.03, -0.02))
        points = rig.known(map_outline(MAP_M, 2), noise_px=0.5, seed=seed)
        freedom = Freedom(True, 1, height_m=2.5)
        report = calibrate(points, guess_lens("fisheye", SIDE_PX, SIDE_PX), freedom, MAP_M)
        errors.append(board_error_mm(report, rig))
    assert max(errors) < 10.0


@given(yaws)
@settings(max_examples=15, deadline=None)
def test_the_picture_may_be_turned_any_way(yaw):
    rig = Rig(yaw_rad=yaw)
    calibration = calibrate(rig.known(CORNERS), FISHEYE, Freedom(), MAP_M).calibration
    off_by = calibration.hanging.yaw_rad - yaw
    assert abs((off_by + math.pi) % (2 * math.pi) - math.pi) < 1e-3


def test_the_region_of_interest_holds_the_map_and_the_boards_on_it():
    rig = Rig(yaw_rad=math.pi / 2.0, position_m=(1.1, 1.3, 3.2))
    tall = (Marker(board=Board(height_m=0.25)),)
    calibration = calibrate(rig.known(CORNERS), FISHEYE, Freedom(), MAP_M, tall).calibration
    u0, v0, u1, v1 = calibration.roi_rect()
    for height_m in (0.0, 0.25):
        pixels = rig.see(grid(8), height_m)
        assert np.all((pixels > (u0, v0)) & (pixels < (u1 - 1, v1 - 1)))
    assert (u1 - u0) * (v1 - v0) < 0.8 * SIDE_PX**2


def refused(points, complaint, lens=FISHEYE, freedom=Freedom(), **more):  # noqa: B008
    with pytest.raises(ConfigError, match=complaint):
        calibrate(points, lens, freedom, MAP_M, **more)


def test_too_few_points():
    refused(Rig().known(CORNERS[:3]), "at least 4 points, got 3")


def test_points_on_a_line_with_one_beside_it():
    line = np.column_stack((np.linspace(0.2, 2.0, 5), np.linspace(0.1, 2.5, 5)))
    refused(Rig().known(np.vstack((line, [[2.0, 0.2]]))), "almost on one line")


def test_pixels_on_a_line_of_points_that_are_not():
    points = [KnownPoint(100.0 + 200 * k, 300.0, *map(float, at)) for k, at in enumerate(CORNERS)]
    refused(points, "all but one of the pixels lie almost on one line")


@pytest.mark.parametrize(("count", "checked"), [(4, False), (5, True)])
def test_four_equations_to_spare_show_a_wrong_lens(count, checked):
    known = Rig().known(np.vstack((CORNERS, [[1.0, 1.2]])))[:count]
    assert calibrate(known, FISHEYE, Freedom(), MAP_M).checked is checked


def test_the_parallax_of_a_board_in_the_farthest_corner():
    """A camera so much too high misplaces a board by its distance, times that over its height."""
    known, free = Rig().known(grid(5), 0.3), Freedom(True)
    start = guess_lens("fisheye", SIDE_PX, SIDE_PX)
    pixels = np.array([(p.u_px, p.v_px) for p in known])
    fit = fit_camera(pixels, np.array([(p.x_m, p.y_m) for p in known]), start, free)
    x, y, z = fit.position_m
    reach = max(math.hypot(x - u, y - v) for u, v in CORNERS)
    told = calibrate(known, start, free, MAP_M).parallax_sigma_mm
    assert told == pytest.approx(1000.0 * reach / z * 0.12 / z * fit.height_sigma_m)
    assert told > 0.1
    two = (
        Marker("low", board=Board(height_m=0.06)),
        Marker("high", "tag", board=Board(0.2, 0.2, 0.3)),
    )
    tallest = calibrate(known, start, free, MAP_M, two, 99.0).parallax_sigma_mm
    assert tallest == pytest.approx(told * 0.3 / 0.12)


def test_swapped_corners():
    points = Rig().known(CORNERS)
    pixels = [points[i] for i in (1, 0, 3, 2)]
    swapped = [KnownPoint(p.u_px, p.v_px, *map(float, c)) for p, c in zip(pixels, CORNERS)]
    refused(swapped, "mirrored")


def test_two_corners_confused():
    points = Rig().known(CORNERS)
    pixels = [points[i] for i in (0, 2, 1, 3)]
    crossed = [KnownPoint(p.u_px, p.v_px, *map(float, c)) for p, c in zip(pixels, CORNERS)]
    refused(crossed, "mirrored|residual|no camera")


def test_a_point_outside_the_picture():
    points = [*Rig().known(CORNERS), KnownPoint(1500.0, 100.0, 1.0, 1.0)]
    refused(points, r"point 5 at \(1500, 100\)")


def test_one_wrong_point_is_named():
    points = Rig().known(grid(3))
    p = points[4]
    points[4] = KnownPoint(p.u_px + 30.0, p.v_px, p.x_m, p.y_m)
    refused(points, "the worst is point 5")


def test_the_wrong_lens_model_is_noticed():
    bent = Rig(FISHEYE, position_m=(1.1, 1.3, 1.6)).known(grid(4, margin_m=0.2))
    refused(
        bent, "the lens model", guess_lens("pinhole", SIDE_PX, SIDE_PX), Freedom(True, height_m=1.6)
    )


def test_four_corners_fit_a_wrong_lens_too_and_that_is_said():
    rig = Rig(FISHEYE, position_m=(1.1, 1.32, 2.5))
    start = guess_lens("pinhole", SIDE_PX, SIDE_PX)
    few = calibrate(rig.known(CORNERS), start, Freedom(True, height_m=2.5), MAP_M)
    assert not few.checked
    assert board_error_mm(few, rig) > 10.0
    refused(rig.known(map_outline(MAP_M, 2)), "the lens model", start, Freedom(True, height_m=2.5))
    right = calibrate(rig.known(map_outline(MAP_M, 2)), FISHEYE, Freedom(), MAP_M)
    assert right.checked


def test_a_height_that_cannot_be_told_is_asked_for():
    """A pinhole that looks straight down: twice the focal length from twice as high."""
    points = Rig(PINHOLE, position_m=(1.1, 1.3, 3.2)).known(grid(3), 0.2)
    start = guess_lens("pinhole", SIDE_PX, SIDE_PX)
    refused(points, "measure the height", start, Freedom(True))
    report = calibrate(points, start, Freedom(True, height_m=3.2), MAP_M)
    assert report.parallax_sigma_mm == 0.0
    assert report.calibration.lens.fx_px == pytest.approx(640.0, rel=0.01)


def test_more_unknowns_than_equations():
    refused(Rig().known(CORNERS), "8 equations for 9 unknowns", freedom=Freedom(True, 2))


def test_unknown_lens_model():
    with pytest.raises(ConfigError, match="did you mean 'fisheye'"):
        guess_lens("fish", 640, 480)


def test_corners_come_in_fours():
    points = corner_points([(1.0, 2.0)] * 4, MAP_M)
    assert [(p.x_m, p.y_m) for p in points] == [(0.0, 0.0), (2.2, 0.0), (2.2, 2.64), (0.0, 2.64)]
    with pytest.raises(ConfigError, match="got 3"):
        corner_points([(1.0, 2.0)] * 3, MAP_M)


@pytest.mark.parametrize(("k1", "height_m"), [(-0.35, 1.9), (-0.25, 1.5)])
def test_where_the_map_reaches_beyond_what_the_lens_sees_the_whole_picture_counts(k1, height_m):
    lens = Lens("plumb_bob", 1280, 1280, 640.0, 640.0, 639.5, 639.5, (k1, 0.0, 0.0, 0.0, 0.0))
    rig, marker = Rig(lens, position_m=(1.1, 1.32, height_m)), Marker()
    known = rig.known(grid(4, 0.4))
    made = calibrate(known, lens, Freedom(False, 0, height_m), MAP_M).calibration
    assert made.roi_px == ()
    picture = rig.floor()
    rig.paint_robot(picture, marker, (0.5, 1.0, 0.0))
    (found,) = Detector(made).detect(picture)
    assert (found.x_m, found.y_m) == pytest.approx((0.5, 1.0), abs=0.01)
