import math

import numpy as np
import pytest

from localizer_node.calibration import Calibration, Marker
from robot.geometry import Pose
from sim_pybullet.overhead import (
    Hanging,
    OverheadCamera,
    board_rgb,
    robot_sheets,
)
from sim_pybullet.scene import Ground
from tests.sim_pybullet.wanderers import (
    HANGING_FRAMES,
    ROBOTS,
    Lamps,
    Score,
    arena,
    coloured,
    drive,
)
from tests.thorough import count


@pytest.fixture(scope="module")
def bare():
    ground = np.full((132, 110, 3), 60, np.uint8)
    floor = Ground(ground, np.zeros((132, 110), np.uint8), 0.02, 0.0, 2.64, (60.0, 60.0, 60.0))
    return OverheadCamera(floor, Hanging(tilt_rad=(0.04, -0.03)), blur_px=0.0, noise=0.0)


def test_pixels_and_places_are_inverse(bare):
    places = np.array([[0.1, 0.1, 0.0], [2.0, 2.5, 0.0], [1.1, 1.3, 0.2], [0.3, 2.2, 0.2]])
    pixels = bare.rig.to_pixels(places)
    for place, pixel in zip(places, pixels, strict=True):
        assert np.allclose(bare.rig.to_floor(pixel, place[2]), place[:2], atol=1e-9)


def test_a_calibration_of_its_lens_and_place_is_the_camera(bare):
    rectifier = Calibration(bare.lens, bare.hanging)
    places = np.array([[0.1, 0.1, 0.12], [2.0, 2.5, 0.12], [1.1, 1.3, 0.12]])
    assert np.allclose(
        rectifier.to_pixels(places[:, :2], 0.12), bare.rig.to_pixels(places), atol=1e-6
    )


@pytest.mark.parametrize("height_m", [0.0, 0.12, 0.3])
def test_a_sheet_appears_where_its_height_puts_it(bare, height_m):
    rng = np.random.default_rng(0)
    empty = bare.render([], rng).astype(float)
    for x, y in ((0.3, 0.4), (1.9, 2.2), (1.1, 1.3)):
        sheet = coloured("blue", x, y, 0.6, (0.06, 0.06, height_m))
        change = np.abs(bare.render([sheet], rng) - empty).sum(axis=2)
        rows, columns = np.nonzero(change)
        weight = change[rows, columns]
        centre = np.average(np.column_stack((columns, rows)), axis=0, weights=weight)
        assert np.allclose(centre, bare.rig.to_pixels(np.array([x, y, height_m])), atol=0.12)


def test_the_higher_hides_the_lower_and_nothing_stays_behind(bare):
    rng = np.random.default_rng(0)
    empty = bare.render([], rng)
    low = coloured("orange", 1.0, 1.0, 0.0, (0.1, 0.1, 0.0))
    high = coloured("blue", 1.0, 1.0, 0.0, (0.2, 0.2, 0.1))
    covered = bare.render([high, low], rng)
    assert np.array_equal(covered, bare.render([high], rng))
    assert not np.array_equal(covered, empty)
    assert np.array_equal(bare.render([], rng), empty)


def test_sheets_outside_the_picture_change_nothing(bare):
    rng = np.random.default_rng(0)
    away = coloured("blue", 30.0, 1.0, 0.0, (0.2, 0.2, 0.0))
    assert np.array_equal(bare.render([away], rng), bare.render([], rng))


def test_the_same_generator_draws_the_same_picture():
    camera = OverheadCamera(arena()[1], noise=4.0)
    sheets = robot_sheets(Marker(), Pose(1.0, 1.2, 0.4))
    first = camera.render(sheets, np.random.default_rng(7))
    again = camera.render(sheets, np.random.default_rng(7))
    other = camera.render(sheets, np.random.default_rng(8))
    assert first.shape == (720, 1280, 3)
    assert first.dtype == np.uint8
    assert np.array_equal(first, again)
    assert 2.0 < np.std(first.astype(float) - other) < 9.0


def test_boards_show_their_marker():
    two = board_rgb(ROBOTS["two_colour"][0])
    assert two[5, 5, 1] > two[5, 5, 2]  # green in front
    assert two[-5, 5, 2] > two[-5, 5, 1]
    tag = board_rgb(ROBOTS["tag"][0])
    middle = tag[len(tag) // 2]
    assert middle.min() < 10
    assert tag[3, 3, 2] > 150


def test_light_falls_off_to_one_side_and_into_shadow():
    light = Lamps(gradient=0.4, gradient_rad=0.0)
    ground = np.full((132, 110, 3), 100, np.uint8)
    floor = Ground(ground, np.zeros((132, 110), np.uint8), 0.02, 0.0, 2.64, (100.0, 100.0, 100.0))
    camera = OverheadCamera(floor, light=light, blur_px=0.0, noise=0.0)
    picture = camera.render([], np.random.default_rng(0)).mean(axis=2)
    west, east = (camera.rig.to_pixels(np.array([x, 1.3, 0.0])).astype(int) for x in (0.2, 2.0))
    assert picture[west[1], west[0]] < 90 < 110 < picture[east[1], east[0]]
    shaded = OverheadCamera(floor, light=Lamps(shadows=((0.5, 0.5, 0.3, 0.5),)), noise=0.0)
    picture = shaded.render([], np.random.default_rng(0)).mean(axis=2)
    spot = shaded.rig.to_pixels(np.array([0.5, 0.5, 0.0])).astype(int)
    assert picture[spot[1], spot[0]] == pytest.approx(50, abs=2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ROBOTS)
def test_robots_in_the_arena_are_placed_within_a_centimetre_and_three_degrees(kind):
    """Calibrated from clicks, in random light, among blue clutter; -rP shows the figures."""
    score = Score()
    hangings, frames = count(2, 5), count(HANGING_FRAMES // 4, HANGING_FRAMES)
    for seed in range(hangings):
        drive(ROBOTS[kind], frames, seed, score, blue_things=kind != "plain")
    print(
        f"{kind}: {score.told} of {score.expected} poses told, {score.wrong} wrong; position "
        f"{score.position_rms_mm:.1f} mm RMS, {1000 * max(score.position_m):.0f} at most"
    )
    assert score.wrong == 0
    assert score.position_rms_mm <= 10.0
    first = 2 * hangings * len(ROBOTS[kind])  # it tells nobody's before the third picture
    assert score.told > 0.97 * (score.expected - first)
    assert len(score.heading_rad) == (score.told if kind != "plain" else 0)
    if kind != "plain":
        worst_deg = math.degrees(max(score.heading_rad))
        print(f"heading {score.heading_rms_deg:.2f} degrees RMS, {worst_deg:.1f} at most")
        assert score.heading_rms_deg <= 3.0
        assert worst_deg < 30.0
