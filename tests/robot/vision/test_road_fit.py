"""Readings of a picture against a straight road that is drawn here, pixel by pixel."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Callable, Optional, Set, Tuple

import cv2
import numpy as np
import pytest

from robot.geometry import Pose
from robot.lens import DUCKIEBOT_LENS, CameraRig, Mount
from robot.navigation.road_map import RoadMap, load_map, read_map
from robot.navigation.road_paint import road_paint
from robot.vision.road_fit import Reading, RoadFit, Verdict, readings, washed_out

ROAD: RoadMap = read_map({"tile_size": 0.585, "tiles": [["straight/E"] * 8]}, "straight")
MIDDLE_M = 0.5 * 0.585 - 0.2 * 0.585  # of the lane that leads east, north of the south edge
START = Pose(1.0, MIDDLE_M, 0.0)
MOUNT, EXACT = Mount(), Pose(0.0, 0.0, 0.0)


@lru_cache(maxsize=None)
def floor_seen(mount: Mount) -> np.ndarray:
    """Where each pixel meets the floor (120, 160, 2) [m], robot frame."""
    rows, columns = np.mgrid[:120, :160]
    rig = CameraRig(DUCKIEBOT_LENS.scaled(160, 120), mount)
    return rig.to_floor(np.stack((columns, rows), axis=-1).astype(float))


def draw(pose: Pose = START, mount: Mount = MOUNT, bend_pm: float = 0.0) -> np.ndarray:
    """What a camera of this mounting sees of the straight road (120, 160, 3).

    At ``START`` that road may bend instead, left by ``bend_pm`` [1/m].
    """
    floor = floor_seen(mount)
    if bend_pm:
        ahead_m, left_m = np.moveaxis(floor, -1, 0)
        middle_m = 1.0 / bend_pm  # left of the robot, of the circles that the lines are on
        out_m = np.sign(bend_pm) * np.hypot(ahead_m, middle_m - left_m)
        floor = np.stack((ahead_m, middle_m - out_m), axis=-1)
    x_m, y_m = np.moveaxis(pose.to_world(floor.reshape(-1, 2)).reshape(120, 160, 2), -1, 0)
    picture = np.full((120, 160, 3), (150, 160, 170), np.uint8)
    with np.errstate(invalid="ignore"):
        picture[np.isfinite(x_m)] = (40, 90, 40)
        across = y_m / 0.585
        picture[(across > 0.0) & (across < 1.0)] = (60, 60, 62)
        for low, high in ((0.025, 0.111), (0.889, 0.975)):
            picture[(across > low) & (across < high)] = (230, 230, 228)
        dash = (x_m * 8.0 / 0.585) % 1.0 < 0.64
        picture[(across > 0.479) & (across < 0.521) & dash] = (230, 190, 40)
    return picture


def drive(
    fit: RoadFit,
    spoil: Optional[Callable[[np.ndarray], np.ndarray]] = None,
    off: Pose = EXACT,
    mount: Mount = MOUNT,
    turns: int = 20,
) -> str:
    """What the verdict is after so many turns at 3 cm each, through a noisy sensor."""
    verdict, rng, said = Verdict(fit.readings), np.random.default_rng(0), ""
    for turn in range(turns):
        pose = START._replace(x_m=START.x_m + 0.03 * turn)
        picture = draw(pose, mount) + 5.0 * rng.standard_normal((120, 160, 3))
        seen = np.clip(picture, 0, 255).astype(np.uint8)
        believed = Pose(pose.x_m + off.x_m, pose.y_m + off.y_m, pose.heading_rad + off.heading_rad)
        fits = fit.fits(seen if spoil is None else spoil(seen), believed)
        assert fits is not None
        said = verdict.add(fits)
    return said


@pytest.fixture(scope="module")
def on_map() -> RoadFit:
    return RoadFit(CameraRig(DUCKIEBOT_LENS), road_paint(ROAD))


@pytest.fixture(scope="module")
def in_lane() -> RoadFit:
    return RoadFit(CameraRig(DUCKIEBOT_LENS))


ROLL = cv2.getRotationMatrix2D((79.5, 59.5), 30.0, 1.0)
SPOILS = {
    "mirrored": lambda picture: picture[:, ::-1].copy(),
    "upside down": lambda picture: picture[::-1, ::-1].copy(),
    "upside down and mirrored": lambda picture: picture[::-1].copy(),
    "rolled": lambda picture: cv2.warpAffine(picture, ROLL, (160, 120)),
    "sheared": lambda picture: np.stack([np.roll(row, k, 0) for k, row in enumerate(picture)]),
}


@pytest.mark.parametrize("name", SPOILS)
def test_a_spoiled_picture_is_called_by_its_name(
    name: str, on_map: RoadFit, in_lane: RoadFit
) -> None:
    turns = 60 if name == "rolled" else 20  # 6 s for what is most like a bend, else 2 s
    assert drive(on_map, SPOILS[name], turns=turns) == name
    assert name == "rolled" or drive(in_lane, SPOILS[name])


@pytest.mark.parametrize("degrees", [-90.0, 90.0])
def test_a_camera_on_its_side_is_noticed_within_two_seconds(
    degrees: float, on_map: RoadFit
) -> None:
    turn = cv2.getRotationMatrix2D((79.5, 59.5), degrees, 1.0)
    spoil = lambda picture: cv2.warpAffine(picture, turn, (160, 120))  # noqa: E731
    assert drive(on_map, spoil, turns=20) == "rolled"


@pytest.mark.parametrize(
    ("share", "level", "washed"),
    [(0.6, 255, True), (0.6, 251, True), (0.6, 245, False), (0.4, 255, False), (0.0, 255, False)],
)
def test_a_floor_that_is_mostly_white_is_washed_out(share: float, level: int, washed: bool) -> None:
    picture = draw()
    picture[:60] = 255  # of the sky nobody asks
    picture[60:, : round(160 * share)] = level
    assert washed_out(picture) is washed
    picture[60:, :, 1] = np.minimum(picture[60:, :, 1], 200)  # a colour is no white
    assert not washed_out(picture)


@pytest.mark.parametrize("columns", [-40, 40, 80])
def test_a_shifted_picture_is_found_where_a_map_says_where_the_road_lies(
    columns: int, on_map: RoadFit
) -> None:
    assert drive(on_map, lambda picture: np.roll(picture, columns, axis=1)) == "shifted"


def test_what_a_shifted_and_a_sheared_picture_are_held_against() -> None:
    """Where three pixels, at the top, above the middle and in it, would have come from."""

    def told(sentence: str) -> Set[Tuple[int, ...]]:
        read = readings(np.zeros(3), np.array([-15.0, -5.0, 0.0]))
        chosen = [each for each in read if each.sentence == sentence]
        return {tuple(np.rint(np.r_[each.columns, each.rows]).astype(int)) for each in chosen}

    aside = {(right, right, right, -15, -5, 0) for right in (-10, 10, -20)}
    down = {(0, 0, 0, 5, -15, -10), (0, 0, 0, -5, 5, 10), (0, 0, 0, 0, 10, -15)}
    assert told("shifted") == aside | down, "by a quarter, a third or half of the picture"
    middle_stays = {(12, 4, 0), (-12, -4, 0)}
    top_stays = {(0, 10, 15), (0, -10, -15)}
    assert told("sheared") == {(*each, -15, -5, 0) for each in middle_stays | top_stays}


def test_a_road_that_leads_north_fits_as_one_that_leads_east(on_map: RoadFit) -> None:
    north = read_map({"tile_size": 0.585, "tiles": [["straight/N"]] * 8}, "north")
    to_north = RoadFit(CameraRig(DUCKIEBOT_LENS), road_paint(north))
    east = on_map.fits(draw(), START)
    assert east is not None
    assert east[1, 0] > 2.0
    turned = Pose(0.585 - MIDDLE_M, START.x_m, 0.5 * math.pi)
    assert to_north.fits(draw(), turned) == pytest.approx(east, abs=0.2)


@pytest.mark.parametrize("left_m", [-0.06, 0.0, 0.06])
@pytest.mark.parametrize("turned_deg", [-8.0, 0.0, 8.0])
@pytest.mark.parametrize("pitched_deg", [-6.0, 0.0, 8.0])
def test_a_pose_and_a_mounting_may_be_off(
    left_m: float, turned_deg: float, pitched_deg: float, on_map: RoadFit, in_lane: RoadFit
) -> None:
    off = Pose(0.05, left_m, math.radians(turned_deg))
    mount = Mount(pitch_rad=Mount().pitch_rad + math.radians(pitched_deg), roll_rad=0.05)
    assert drive(on_map, off=off, mount=mount) == ""
    assert drive(in_lane, mount=mount) == ""


@pytest.mark.parametrize(
    ("bend_pm", "least"), [(-3.5, 1.3), (-1.5, 2.1), (0.0, 2.2), (1.5, 2.1), (3.5, 2.05)]
)
def test_a_lane_may_bend_either_way_gently_or_tightly(
    bend_pm: float, least: float, in_lane: RoadFit
) -> None:
    fits = in_lane.fits(draw(bend_pm=bend_pm), None)
    assert fits is not None
    assert fits[1, 0] > least, "with the mounting as it is, and the picture as it is"


@pytest.mark.parametrize(
    ("turned_deg", "least"),
    [(-30, 2.2), (-20, 2.2), (-10, 2.2), (0, 2.2), (10, 1.9), (20, 1.5), (30, 1.4)],
)
def test_a_robot_may_be_turned_in_its_lane(
    turned_deg: float, least: float, in_lane: RoadFit
) -> None:
    fits = in_lane.fits(draw(START._replace(heading_rad=math.radians(turned_deg))), None)
    assert fits is not None
    assert fits[1, 0] > least


def test_one_lamp_does_not_outweigh_a_road_at_night(on_map: RoadFit) -> None:
    night = (0.15 * draw()).astype(np.uint8)
    lamp = night.copy()
    lamp[80:88, 80:88] = 255
    dark, lit = (on_map.fits(picture, START) for picture in (night, lamp))
    assert dark is not None
    assert lit is not None
    assert lit[:, 0].max() > 0.87 * dark[:, 0].max()
    turned = [reading.sentence for reading in on_map.readings].index("upside down")
    assert lit[:, turned].max() < 0.5, "nor does it make a road of a picture that shows none"


def test_what_lies_beside_the_picture_counts_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(columns: np.ndarray, rows: np.ndarray) -> Tuple[Reading, ...]:
        ways = ((0, 0), (-40, 0), (40, 0), (0, -30), (0, 30))  # by whole pictures
        return tuple(Reading("", columns + right, rows + down) for right, down in ways)

    monkeypatch.setattr("robot.vision.road_fit.readings", moved)
    fits = RoadFit(CameraRig(DUCKIEBOT_LENS)).fits(draw(), None)
    assert fits is not None
    assert fits[1, 0] > 2.0
    assert np.abs(fits[:, 1:]).max() == 0.0


def test_a_robot_beyond_the_yellow_line_sees_what_a_mirror_shows(in_lane: RoadFit) -> None:
    verdict = Verdict(in_lane.readings)
    beyond = draw(START._replace(y_m=0.585 - MIDDLE_M))
    for _ in range(20):
        fits = in_lane.fits(beyond, None)
        assert fits is not None
        said = verdict.add(fits)
    assert said, "as mirrored or sheared"


def test_without_a_pose_the_map_says_nothing(on_map: RoadFit) -> None:
    assert on_map.fits(draw(), None) is None


def test_off_the_map_nothing_fits_better_than_anything(on_map: RoadFit) -> None:
    fits = on_map.fits(draw(), Pose(50.0, 50.0, 0.0))
    assert fits is not None
    assert np.abs(fits).max() == 0.0


def test_pictures_of_any_map_are_judged() -> None:
    fit = RoadFit(CameraRig(DUCKIEBOT_LENS), road_paint(load_map("town")))
    fits = fit.fits(draw(), Pose(1.0, 1.0, 0.3))
    assert fits is not None
    assert np.isfinite(fits).all()


KINDS = tuple(Reading(name, np.zeros(1), np.zeros(1)) for name in ("", "mirrored", "sheared"))


def told(better: float, turns: int) -> list:
    """The verdicts where the second reading fits so much better than the picture as it is."""
    verdict = Verdict(KINDS)
    return [verdict.add(np.array([[0.5, 0.5 + better, 0.2]])) for _ in range(turns)]


def test_twenty_turns_must_favour_another_reading_by_its_margin() -> None:
    assert set(told(0.49, 60)) == {""}
    clear = told(0.6, 20)
    assert clear[:16] == [""] * 16  # 16 of 20 turns: 0.48 in the middle
    assert clear[16:] == ["mirrored"] * 4


def test_the_picture_as_it_is_must_fit_less_than_three_fifths_as_well() -> None:
    for own, said in ((2.0, ""), (1.85, ""), (1.75, "mirrored")):
        verdict = Verdict(KINDS)
        fits = np.array([[own, 3.0, 0.2]])
        assert [verdict.add(fits) for _ in range(20)][-1] == said


def test_one_odd_picture_is_no_evidence() -> None:
    verdict = Verdict(KINDS)
    for turn in range(60):
        odd = 8.0 if turn == 30 else 0.0
        assert verdict.add(np.array([[0.5, 0.5 + odd, 0.0]])) == ""


def test_old_evidence_is_forgotten() -> None:
    verdict = Verdict(KINDS)
    for _ in range(20):
        said = verdict.add(np.array([[0.0, 0.0, 2.0]]))
    assert said == "sheared"
    verdict.forget()
    assert verdict.add(np.array([[0.0, 0.0, 2.0]])) == ""
    for _ in range(20):
        said = verdict.add(np.array([[2.0, 0.0, 0.0]]))
    assert said == ""


def test_one_mounting_must_explain_all_pictures() -> None:
    """Each turn another pitch favours the mirror: none of them does in all."""
    verdict = Verdict(KINDS)
    for turn in range(40):
        fits = np.tile([0.8, 0.6, 0.0], (3, 1))
        fits[turn % 3, 1] = 2.0
        assert verdict.add(fits) == ""


def test_of_two_readings_that_fit_the_better_one_is_told() -> None:
    slow = Reading("shifted", np.zeros(1), np.zeros(1), turns=40)
    verdict = Verdict((*KINDS, slow))
    assert [verdict.add(np.array([[0.0, 3.0, 0.0, 2.0]])) for _ in range(60)][-1] == "mirrored"


MARGINS = {  # by which it must fit better, the share of its fit, and for so many turns
    "mirrored": (0.55, 0.6, 20),
    "upside down": (0.7, 0.6, 20),
    "upside down and mirrored": (0.7, 0.6, 20),
    "sheared": (0.75, 0.5, 20),
    "shifted": (0.6, 0.5, 40),
}


def test_by_how_much_each_reading_must_fit_better(on_map: RoadFit, in_lane: RoadFit) -> None:
    told = [(r.sentence, (r.margin, r.share, r.turns)) for r in on_map.readings[1:]]
    assert {said: each for said, each in told if said != "rolled"} == MARGINS
    rolled = [each for said, each in told if said == "rolled"]
    assert rolled == [(0.7, 0.6, 20)] * 2 + [(0.75, 0.5, 60)] * 2
    known = {reading.sentence for reading in in_lane.readings[1:]}
    assert known == {*MARGINS} - {"shifted"}, "without a map it may be a bend"
