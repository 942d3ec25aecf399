"""What sight, which learned from simulated pictures only, says of photographs; run with -rP."""

import math
from collections import Counter
from pathlib import Path

import numpy as np

from robot.contract import ACTION_TWISTS, FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.inference.preprocess import preprocess
from robot.lens import CameraRig
from robot.vision.sight import OnnxSight
from sim_pybullet.look import NOMINAL
from tests.trainer.judging.drawn_lines import (
    AGREES,
    NOT_JUDGED,
    SURELY_NEAR_M,
    drawn_line,
    frames_of,
    load_lines,
    verdicts,
)
from trainer.judging.yellow_line import YellowLine, floor_table
from trainer.sight.cli import SHIPPED

RIG, AHEAD_M = NOMINAL.rig(), 0.2
YELLOW_M = 0.2 * 0.585  # from the middle of a lane to the left
REFERENCE_M = floor_table(RIG, FRAME_WIDTH_PX, FRAME_HEIGHT_PX).reference_m
CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])


def action(offset_m: float, heading_rad: float) -> int:
    """Pure pursuit of a straight lane, `AHEAD_M` ahead."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    x, y = c * AHEAD_M - s * offset_m, -s * AHEAD_M - c * offset_m
    return int(np.abs(2.0 * y / (x * x + y * y) - CURVATURES).argmin())


def test_the_yellow_line_lies_where_people_draw_it_on_six_photographs_of_ten(
    data_dir: Path,
) -> None:
    sight = OnnxSight(SHIPPED)

    def line_of(frame: np.ndarray, rig: CameraRig) -> YellowLine:
        seen = sight(preprocess(frame, sight.contract.image)[None])
        offset_m, heading_rad, bend_pm, _ = seen.figures[0].tolist()
        there_m = offset_m + REFERENCE_M * math.sin(heading_rad) - 0.5 * bend_pm * REFERENCE_M**2
        direction_rad = bend_pm * REFERENCE_M - heading_rad
        return YellowLine(bool(seen.road[0] > 0.5), there_m - YELLOW_M, direction_rad)

    sites = verdicts(data_dir / "real", RIG, line_of)
    print(sites)
    judged = sum(said.total() - said[NOT_JUDGED] for said in sites.values())
    assert judged >= 60
    assert sum(said[AGREES] for said in sites.values()) >= 0.6 * judged


def test_pursuit_of_what_is_seen_is_hardly_ever_far_from_pursuit_of_what_people_draw(
    data_dir: Path,
) -> None:
    sight, lines, apart = OnnxSight(SHIPPED), load_lines(), Counter[int]()
    for site in lines.sites:
        for drawn, frame in frames_of(site, data_dir / "real"):
            people = [drawn_line(p, lines.size, RIG, REFERENCE_M) for p in drawn.yellow]
            left = [p.line for p in people if p and p.nearest_m < SURELY_NEAR_M]
            if not left or left[0].offset_m > 0.0:
                continue
            turned_rad = -left[0].heading_rad
            aside_m = left[0].offset_m + YELLOW_M - REFERENCE_M * math.sin(turned_rad)
            seen = sight(preprocess(frame, sight.contract.image)[None]).figures[0].tolist()
            apart[abs(action(seen[0], seen[1]) - action(aside_m, turned_rad))] += 1
    print(dict(apart))
    assert apart.total() >= 50
    assert sum(count for steps, count in apart.items() if steps > 1) <= 0.1 * apart.total()
