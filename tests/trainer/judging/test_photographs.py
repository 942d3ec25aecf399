from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.lens import CameraRig
from sim_pybullet.look import NOMINAL
from tests.trainer.judging.drawn_lines import (
    AGREES,
    INVENTED,
    MISSED,
    NOT_JUDGED,
    WRONG_SIDE,
    DrawnLine,
    drawn_line,
    load_lines,
    verdict,
    verdicts,
)
from trainer.judging.yellow_line import NOT_FOUND, YellowLine, floor_table

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
        (line(-0.1), [DrawnLine(0.3, line(-0.2))], AGREES),
        (line(0.1), [DrawnLine(0.3, line(-0.2))], WRONG_SIDE),
        (line(0.1), [DrawnLine(0.3, line(-0.2)), DrawnLine(0.5, line(0.2))], AGREES),
        (NOT_FOUND, [DrawnLine(0.3, line(-0.2))], MISSED),
        (NOT_FOUND, [DrawnLine(2.0, line(-0.2))], AGREES),
        (line(0.1), [DrawnLine(2.0, line(-0.2))], INVENTED),
        (line(0.1), [], INVENTED),
        (NOT_FOUND, [], AGREES),
        (NOT_FOUND, [DrawnLine(1.0, line(-0.2))], NOT_JUDGED),
        (line(0.1), [DrawnLine(0.3, line(-0.005))], NOT_JUDGED),
    ],
)
def test_what_is_said_of_a_detection(found: YellowLine, drawn: list[DrawnLine], said: str) -> None:
    assert verdict(found, drawn) == said


def test_shipped_lines_lie_in_their_pictures_and_cover_all_sites() -> None:
    lines = load_lines()
    names = [drawn.file for site in lines.sites for drawn in site.photographs]
    assert len(names) == len(set(names)) >= 60
    assert len(lines.sites) == 6
    for site in lines.sites:
        for drawn in site.photographs:
            for points in (*drawn.yellow, drawn.white):
                array = np.array(points).reshape(-1, 2)
                assert (array >= 0.0).all()
                assert (array <= lines.size).all()
            for points in drawn.yellow:
                assert len(points) >= 2


def test_the_detector_agrees_with_people_on_nine_photographs_of_ten(data_dir: Path) -> None:
    """And on eight of ten at every site."""
    sites = verdicts(data_dir / "real", RIG)
    judged = {site: said.total() - said[NOT_JUDGED] for site, said in sites.items()}
    assert sum(judged.values()) >= 60
    assert sum(said[AGREES] for said in sites.values()) >= 0.9 * sum(judged.values())
    assert [site for site, said in sites.items() if said[AGREES] < 0.8 * judged[site]] == []


def test_the_reference_point_is_the_middle_of_the_lower_edge() -> None:
    floor = floor_table(RIG, *SIZE)
    assert 0.1 < floor.reference_m < 0.14
