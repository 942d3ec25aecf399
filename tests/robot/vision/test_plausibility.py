"""What the eyes doubt, on pictures made here; honest rendered drives are in tests/sim_pybullet."""

from __future__ import annotations

import math
from typing import Callable, Iterator, Optional, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.camera.source import Frame
from robot.geometry import Pose, WheelSpeeds
from robot.lens import DUCKIEBOT_LENS, CameraRig
from robot.vision.plausibility import PictureDoubts, Sight, has_moved, shows_something
from robot.vision.road_fit import Reading, RoadFit

SHAPE = (120, 160, 3)
STILL, AHEAD = WheelSpeeds(0.0, 0.0), WheelSpeeds(0.3, 0.3)
ZERO = np.zeros(1)
Picture = Callable[[int, np.random.Generator], np.ndarray]


def noisy(picture: np.ndarray, deviation: float, rng: np.random.Generator) -> np.ndarray:
    return np.clip(picture + deviation * rng.standard_normal(SHAPE), 0, 255).astype(np.uint8)


def scene(contrast: float = 60.0) -> np.ndarray:
    """Large bright shapes on a darker ground, wider than a frame."""
    picture = np.full((120, 480, 3), 90.0)
    rng = np.random.default_rng(3)
    for x in range(0, 470, 24):
        top = int(rng.integers(10, 80))
        picture[top : top + 30, x : x + 12] += contrast
    return picture


def drive(
    picture: Picture, turns: int = 30, wheels: WheelSpeeds = AHEAD, seed: int = 0
) -> Iterator[Tuple[float, Sight]]:
    """Ten decisions a second, each with a new frame; the times and what the eyes say."""
    doubts, rng = PictureDoubts(), np.random.default_rng(seed)
    for number in range(turns):
        now_s = 100.0 + 0.1 * number
        frame = Frame(picture(number, rng), number, now_s)
        yield now_s, doubts.look(frame, None, wheels, now_s)


def passing(number: int, rng: np.random.Generator) -> np.ndarray:
    return noisy(scene()[:, 2 * number : 2 * number + 160], 4.0, rng)


def test_a_scene_that_passes_by_is_not_doubted() -> None:
    sights = [sight for _, sight in drive(passing, 100)]
    assert max(sight.blind_s for sight in sights[1:]) == 0.0
    assert max(sight.still_s for sight in sights) <= 0.3


def test_before_the_second_picture_nothing_has_been_seen() -> None:
    _, first = next(drive(passing))
    assert first.blind_s == math.inf


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("deviation", [0.0, 5.0, 40.0, 120.0])
def test_a_covered_lens_shows_nothing_from_its_first_picture_on(
    level: int, deviation: float
) -> None:
    def covered(number: int, rng: np.random.Generator) -> np.ndarray:
        if number < 10:
            return passing(number, rng)
        return noisy(np.full(SHAPE, float(level)), deviation, rng)

    for now_s, sight in drive(covered):
        if now_s > 100.95:
            assert sight.blind_s == pytest.approx(now_s - 100.9)


@settings(max_examples=40, deadline=None)
@given(
    colour=st.tuples(*[st.integers(0, 255)] * 3),
    deviation=st.floats(0.0, 80.0),
    grain=st.sampled_from([1, 2, 3, 4, 6, 8]),
    seed=st.integers(0, 1000),
)
def test_any_colour_with_noise_of_any_grain_is_blind(
    colour: Tuple[int, int, int], deviation: float, grain: int, seed: int
) -> None:
    def covered(_: int, rng: np.random.Generator) -> np.ndarray:
        small = rng.standard_normal((-(-120 // grain), -(-160 // grain), 3))
        grains = small.repeat(grain, axis=0).repeat(grain, axis=1)[:120, :160]
        return np.clip(np.array(colour) + deviation * grains, 0, 255).astype(np.uint8)

    assert all(sight.blind_s > 0.0 for _, sight in drive(covered, 12, seed=seed))


def test_a_finger_before_the_lens_is_blind() -> None:
    y, x = np.mgrid[:120, :160]
    light = np.exp(-(((x - 60) / 90.0) ** 2) - ((y - 70) / 70.0) ** 2)[..., None]
    finger = light * (110.0, 18.0, 12.0) + (40.0, 5.0, 5.0)
    sights = [sight for _, sight in drive(lambda _, rng: noisy(finger, 4.0, rng))]
    assert all(sight.blind_s == math.inf for sight in sights)


def test_the_darkest_scene_that_is_still_one() -> None:
    """Five grey levels of contrast in noise are seen, a fifth of that is not."""
    faint, none = ([], [])
    for contrast, blind in ((16.0, faint), (2.0, none)):
        picture = scene(contrast)[:, :160] * 0.5
        for _, sight in drive(lambda _, rng, p=picture: noisy(p, 6.0, rng)):
            blind.append(sight.blind_s)
    assert max(faint[1:]) == 0.0
    assert min(none) == math.inf


def test_one_odd_picture_is_forgiven() -> None:
    def flash(number: int, rng: np.random.Generator) -> np.ndarray:
        return np.full(SHAPE, 255, np.uint8) if number == 12 else passing(number, rng)

    sights = [sight for _, sight in drive(flash)]
    assert max(sight.blind_s for sight in sights[1:]) == pytest.approx(0.2)


@pytest.mark.parametrize("deviation", [0.0, 3.0, 12.0, 30.0])
def test_a_picture_that_stands_while_the_wheels_turn_grows_old(deviation: float) -> None:
    held = scene()[:, :160]
    for now_s, sight in drive(lambda _, rng: noisy(held, deviation, rng)):
        assert sight.still_s == pytest.approx(now_s - 100.0)
        assert now_s < 100.15 or sight.blind_s == 0.0


def test_a_flickering_pixel_and_a_changing_light_do_not_make_it_move() -> None:
    def held(number: int, rng: np.random.Generator) -> np.ndarray:
        picture = noisy(scene()[:, :160], 2.0, rng)
        picture[40:44, 40:44] = 255 * (number % 2)
        return np.clip(picture + 3.0 * (number % 3), 0, 255).astype(np.uint8)

    assert [sight.still_s for _, sight in drive(held)][-1] == pytest.approx(2.9)


def test_a_robot_that_stands_may_see_a_picture_that_stands() -> None:
    held = scene()[:, :160]
    for _, sight in drive(lambda _, rng: noisy(held, 3.0, rng), wheels=STILL):
        assert sight.still_s == 0.0


def test_the_time_begins_when_the_wheels_do() -> None:
    doubts, rng = PictureDoubts(), np.random.default_rng(0)
    for number in range(20):
        wheels = AHEAD if number >= 10 else STILL
        frame = Frame(noisy(scene()[:, :160], 3.0, rng), number, 0.1 * number)
        sight = doubts.look(frame, None, wheels, 0.1 * number)
    assert sight.still_s == pytest.approx(0.9, abs=0.11)


def test_a_frame_that_is_shown_again_is_no_new_one() -> None:
    doubts, rng = PictureDoubts(), np.random.default_rng(0)
    first = Frame(passing(0, rng), 7, 0.0)
    for turn in range(6):
        sight = doubts.look(first, None, AHEAD, 0.1 * turn)
    assert sight.blind_s == math.inf, "one frame has no second to be found again in"
    assert sight.still_s == pytest.approx(0.5)


def test_without_a_frame_both_ages_grow() -> None:
    doubts, rng = PictureDoubts(), np.random.default_rng(0)
    for number in range(3):
        doubts.look(Frame(passing(number, rng), number, 0.1 * number), None, AHEAD, 0.1 * number)
    sight = doubts.look(None, None, AHEAD, 0.7)
    assert (sight.blind_s, sight.still_s) == pytest.approx((0.5, 0.5), abs=0.11)


class Liar(RoadFit):
    """Says of every picture, of which a road can be asked, that it fits better mirrored."""

    def __init__(self) -> None:
        self._honest = RoadFit(CameraRig(DUCKIEBOT_LENS))
        self.readings = (Reading("", ZERO, ZERO), Reading("mirrored", ZERO, ZERO))

    def fits(self, frame: np.ndarray, pose: Optional[Pose]) -> Optional[np.ndarray]:
        return None if self._honest.fits(frame, pose) is None else np.array([[0.0, 2.0]])


@pytest.mark.parametrize("light", [1.0, 4.0])
def test_where_a_road_lies_is_not_asked_of_a_floor_that_is_mere_white(light: float) -> None:
    doubts, rng = PictureDoubts(Liar()), np.random.default_rng(0)
    for number in range(30):
        picture = np.clip(light * passing(number, rng).astype(float), 0, 255).astype(np.uint8)
        sight = doubts.look(Frame(picture, number, 0.1 * number), None, AHEAD, 0.1 * number)
    assert bool(sight.wrong) is (light == 1.0)


def test_a_doubt_ends_when_the_wheels_stand_and_is_not_taken_up_again_at_once() -> None:
    doubts, rng, wrong = PictureDoubts(Liar()), np.random.default_rng(0), []
    for number in range(50):
        wheels = STILL if number == 30 else AHEAD
        frame = Frame(passing(number, rng), number, 0.1 * number)
        wrong.append(bool(doubts.look(frame, None, wheels, 0.1 * number).wrong))
    assert wrong[29], "two seconds of it are enough"
    assert wrong[30:36] == [False] * 6


@pytest.mark.parametrize(("blocks", "moved"), [(29, False), (31, True)])
def test_a_picture_has_moved_when_a_tenth_of_its_blocks_has(blocks: int, moved: bool) -> None:
    before, now = np.zeros((120, 160), np.float32), np.zeros((120, 160), np.float32)
    for k in range(blocks):
        row, column = divmod(k, 20)
        now[8 * row : 8 * row + 8, 8 * column : 8 * column + 8] = 20.0
    assert has_moved(before, now) is moved


@pytest.mark.parametrize(
    ("levels", "alike", "shown"), [(1.9, 1.0, False), (2.1, 1.0, True), (9.0, 0.35, False)]
)
def test_two_levels_of_structure_that_is_found_again_are_something(
    levels: float, alike: float, shown: bool
) -> None:
    """Of structures (15, 20), the middle of which, (13, 12), is looked for."""
    one, other = np.random.default_rng(1).standard_normal((2, 15, 20))
    middle = np.s_[1:-1, 4:-4]
    one -= one[middle].mean()
    other -= other[middle].mean()
    other -= one * (one * other)[middle].sum() / (one**2)[middle].sum()
    one, other = (levels * each / each[middle].std() for each in (one, other))
    now = alike * one + math.sqrt(1.0 - alike**2) * other
    assert shows_something(one.astype(np.float32), now.astype(np.float32)) is shown
