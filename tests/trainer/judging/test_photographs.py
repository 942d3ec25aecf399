import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.lens import CameraRig
from robot.typed_config import load_yaml
from sim_pybullet.look import NOMINAL
from tests.trainer.judge_photographs import (
    Answer,
    DrawnLine,
    Judged,
    agrees,
    drawn_line,
    figures,
    judge,
    main,
    pursuit,
    seers,
)
from tests.trainer.judging.yellow_line import NOT_FOUND, YellowLine, floor_table
from trainer.division import division
from trainer.sight.photographs import SHIPPED, Annotations

SIZE = (FRAME_WIDTH_PX, FRAME_HEIGHT_PX)
RIG = NOMINAL.rig()


def drawn_straight(offset_m: float, heading_rad: float) -> tuple[tuple[float, float], ...]:
    """What a person would draw of a straight line ``offset_m`` right of the axle's middle."""
    ways = np.linspace(0.16, 0.7, 12)
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    foot = -offset_m * np.array((-s, c))
    points = foot + ways[:, None] * np.array((c, s))
    camera = CameraRig(RIG.lens.scaled(*SIZE), RIG.mount)
    pixels = camera.to_pixels(np.column_stack((points, np.zeros(len(points))))) + 0.5
    inside = ((pixels >= 0.0) & (pixels <= SIZE)).all(axis=1)
    return tuple((float(x), float(y)) for x, y in pixels[inside])


@given(st.floats(-0.15, 0.05), st.floats(-0.4, 0.4))
def test_a_drawn_line_says_where_the_robot_stood(offset_m: float, heading_rad: float) -> None:
    points = drawn_straight(offset_m, heading_rad)
    found = drawn_line(points, SIZE, RIG, 0.0)
    assert found is not None
    assert found.line.offset_m == pytest.approx(offset_m, abs=0.004)
    assert found.line.heading_rad == pytest.approx(heading_rad, abs=0.02)


def line(offset_m: float) -> YellowLine:
    return YellowLine(True, offset_m, 0.0)


@pytest.mark.parametrize(
    ("found", "drawn", "said"),
    [
        (line(-0.1), [DrawnLine(0.3, line(-0.2))], True),
        (line(0.1), [DrawnLine(0.3, line(-0.2))], False),
        (line(0.1), [DrawnLine(0.3, line(-0.2)), DrawnLine(0.5, line(0.2))], True),
        (NOT_FOUND, [DrawnLine(0.3, line(-0.2))], False),
        (NOT_FOUND, [DrawnLine(2.0, line(-0.2))], True),
        (line(0.1), [DrawnLine(2.0, line(-0.2))], False),
        (line(0.1), [], False),
        (NOT_FOUND, [], True),
        (NOT_FOUND, [DrawnLine(1.0, line(-0.2))], None),
        (line(0.1), [DrawnLine(0.3, line(-0.005))], None),
    ],
)
def test_what_is_said_of_a_detection(
    found: YellowLine, drawn: list[DrawnLine], said: bool | None
) -> None:
    assert agrees(found, drawn) is said


def test_annotations_are_many_lie_in_their_pictures_and_every_site_belongs_to_one_part() -> None:
    annotations = load_yaml(Annotations, SHIPPED)
    sites = division().sites
    assert sorted(site.name for site in annotations.sites) == sorted(sites.training + sites.judging)
    photographs = [each for site in annotations.sites for each in site.photographs]
    assert len({each.file for each in photographs}) == len(photographs)
    assert sum(bool(each.actions) for each in photographs) >= 250
    assert sum(bool(each.yellow or each.white) for each in photographs) >= 250
    for each in photographs:
        assert len(each.actions) in (0, 5)
        assert set(each.actions) <= set("saw")
        assert "s" in (each.actions or "s")
        assert each.actions != "sssss"
        for points in (*each.yellow, each.white or ((0, 0), (1, 1))):
            array = np.array(points)
            assert len(array) >= 2
            assert (array >= 0.0).all()
            assert (array <= annotations.size).all()


def test_person_and_detector_say_the_same_on_nearly_nine_photographs_of_ten(data_dir: Path) -> None:
    """And on three of four at every site by which it may be chosen."""
    judged = judge(seers(())["yellow-line detector"], data_dir / "real", "training")
    found = figures(judged)
    assert found["yellow_side_asked"] >= 100
    assert found["yellow_side"] >= 0.88
    assert min(site["yellow_side"] for site in found["sites"].values()) >= 0.75


@given(st.floats(-0.1, 0.1), st.floats(-1.5, 1.5))
def test_pursuit_turns_back_to_the_lane_and_with_it_and_alike_to_both_sides(
    offset_m: float, heading_rad: float
) -> None:
    assert (pursuit(offset_m, 0.0, 0.0) - 2) * offset_m >= 0.0  # LEFT is 0, RIGHT is 4
    assert pursuit(-offset_m, -heading_rad, 0.0) == 4 - pursuit(offset_m, heading_rad, 0.0)
    assert [pursuit(0.0, 0.0, bend) for bend in (3.0, 0.0, -3.0)] == [1, 2, 3]
    assert [pursuit(0.0, -turned, 0.0) for turned in (1.2, 0.4, 0.0, -0.4, -1.2)] == [0, 1, 2, 3, 4]


def row(site: str, letter: str | None, doubt: float, side: bool | None = None) -> Judged:
    return Judged(site, letter, doubt, side, None, None)


def test_shares_the_worst_site_and_the_surest_half() -> None:
    rows = [row("a", "s", 0.1 * k, True) for k in range(10)]
    rows += [row("b", "w", 2.0 + k, False) for k in range(4)] + [row("b", "a", 3.0)] * 6
    rows += [row("small", "w", 0.05)] * 2 + [row("a", None, 0.0)]
    found = figures(rows)
    assert (found["pictures"], found["chosen"]) == (23, 22)
    assert found["sensible"] == pytest.approx(10 / 22)
    assert found["wrong"] == pytest.approx(6 / 22)
    assert (found["worst_site"], found["worst_wrong"]) == ("b", 0.4)
    assert found["surest_half_wrong"] == pytest.approx(2 / 11)
    assert found["yellow_side"] == pytest.approx(10 / 14)
    assert found["white_near"] is None
    assert found["sites"]["small"]["wrong"] == 1.0


@pytest.fixture
def black(tmp_path: Path) -> Path:
    """Every annotated photograph, all of them black."""
    for site in load_yaml(Annotations, SHIPPED).sites:
        folder = tmp_path / site.folder / "images"
        folder.mkdir(parents=True, exist_ok=True)
        for each in site.photographs:
            cv2.imwrite(str(folder / each.file), np.zeros((120, 160, 3), np.uint8))
    return tmp_path


def test_each_answer_is_compared_with_what_the_person_wrote_down(black: Path) -> None:
    annotations = load_yaml(Annotations, SHIPPED)
    sites = [site for site in annotations.sites if site.name in division().sites.judging]
    drawn = iter([each for site in sites for each in site.photographs])
    reference_m = floor_table(RIG, *SIZE).reference_m

    def person(_: np.ndarray) -> Answer:
        """Chooses what is sensible, and sees the lines that are drawn."""
        each = next(drawn)
        yellow = [drawn_line(points, annotations.size, RIG, reference_m) for points in each.yellow]
        near = [line.line for line in yellow if line is not None and line.nearest_m < 1.0]
        action = each.actions.index("s") if each.actions else 0
        return Answer(action, 0.0, near[0] if near else NOT_FOUND)

    found = figures(judge(person, black, "judging"))
    assert found["chosen"] >= 150
    assert found["sensible"] == 1.0
    assert found["yellow_side"] == 1.0
    assert found["yellow_near"] == 1.0
    blind = figures(judge(lambda _: Answer(2, 0.0, NOT_FOUND), black, "judging"))
    assert 0.2 < blind["sensible"] < 0.8
    assert blind["yellow_near"] == 0.0


def test_the_command_writes_figures_site_by_site_and_refuses_what_is_not_there(
    black: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "figures.json"
    assert main([str(black), "--json", str(out)]) == 0
    assert "| lane_coached | " in capsys.readouterr().out
    judged = json.loads(out.read_text())["judged"]
    assert {"nav_ppo", "sight", "yellow-line detector", "always straight"} <= set(judged)
    assert set(judged["sight"]["sites"]) == set(division().sites.judging)
    with pytest.raises(SystemExit, match="2"):
        main([str(black), "--part", "choosing"])
    assert main([str(tmp_path / "none")]) == 2
    assert "expected an annotated photograph, found none" in capsys.readouterr().err


def test_the_reference_point_is_the_middle_of_the_lower_edge() -> None:
    floor = floor_table(RIG, *SIZE)
    assert 0.1 < floor.reference_m < 0.14
