from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX, PolicyContract
from robot.errors import ConfigError
from robot.lens import CameraRig
from sim_pybullet.look import NOMINAL
from trainer.experiments.photographs.agreement import (
    AGREES,
    INVENTED,
    MISSED,
    NOT_JUDGED,
    WRONG_SIDE,
    compare_lines,
    verdict,
)
from trainer.experiments.photographs.lane_pose import LANE_FROM_YELLOW_M, order, site_pose, standing
from trainer.experiments.photographs.lines import Drawn, DrawnLine, drawn_line, load_lines
from trainer.experiments.photographs.run import named
from trainer.experiments.photographs.tables import agreement_table
from trainer.export import export_network
from trainer.judging.lane_head import teach_lane_pose
from trainer.judging.yellow_dashes import DEFAULT, floor_table
from trainer.judging.yellow_line import NOT_FOUND, YellowLine
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy
from trainer.presets import preset

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
    pose = standing(Drawn("x.jpg", (points,)), SIZE, RIG)
    if pose is not None:
        assert pose[0] == pytest.approx(offset_m + LANE_FROM_YELLOW_M, abs=0.004)
        assert pose[1] == pytest.approx(-heading_rad, abs=0.02)


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
    rows = compare_lines(data_dir / "real", RIG)
    judged, agrees = sum(row.judged for row in rows), sum(row.agrees for row in rows)
    assert judged >= 60
    assert agrees / judged >= 0.9
    assert f"{agrees / judged:.1%}" in agreement_table(rows)


def test_the_reference_point_is_the_middle_of_the_lower_edge() -> None:
    floor = floor_table(RIG, *SIZE, DEFAULT.range_m)
    assert 0.1 < floor.reference_m < 0.14


def test_figures_of_poses_that_agree_and_of_poses_that_are_mirrored() -> None:
    drawn = np.array([(0.05, 0.2), (-0.05, -0.2), (0.1, 0.3), (-0.03, -0.1)])
    same, mirrored = (site_pose("p", "s", read, drawn) for read in (drawn, -drawn))
    assert (same.offset_mae_m, same.heading_mae_rad) == (0.0, 0.0)
    assert (same.offset_side, same.heading_side, same.offset_order) == (1.0, 1.0, 1.0)
    assert (mirrored.offset_side, mirrored.heading_side) == (0.0, 0.0)
    assert mirrored.offset_order == -1.0
    assert np.isnan(order(drawn[:3, 0], drawn[:3, 1]))
    assert np.isnan(site_pose("p", "s", np.array([]), np.array([])).offset_mae_m)


def test_a_lane_pose_head_learns_what_its_policys_convolutions_show(tmp_path: Path) -> None:
    torch.manual_seed(1)  # four random filters show the column more or less: 0.76 to 0.93
    config = preset("navigation", "ddqn", "debug")
    policy = tmp_path / "policy.onnx"
    contract = PolicyContract("navigation", "ddqn", config.image, path_points=10)
    export_network(GreedyNetwork(build_policy(config)), contract, policy)
    before = policy.read_bytes()
    rng = np.random.default_rng(0)
    height, width, _ = config.image.shape
    images = rng.integers(30, 60, (300, height, width, 3), dtype=np.uint8)
    columns = rng.integers(0, width - 8, 300)
    for image, column in zip(images, columns, strict=True):
        image[:, column : column + 8] = 220
    across = columns / width - 0.5
    poses = np.stack((0.2 * across, -across), axis=1).astype(np.float32)
    head = teach_lane_pose(policy, images[:200], poses[:200], tmp_path / "head.onnx")
    read = head(images[200:])
    for k in (0, 1):
        assert np.corrcoef(read[:, k], poses[200:, k])[0, 1] > 0.8
    assert policy.read_bytes() == before


def test_policies_are_named_once_and_must_be_files(tmp_path: Path) -> None:
    model = tmp_path / "a.onnx"
    model.touch()
    assert named([f"x={model}"]) == (("x", model),)
    for wrong in ([f"{model}"], [f"x={model}", f"x={model}"], ["x=none.onnx"]):
        with pytest.raises(ConfigError, match=r"name=model\.onnx"):
            named(wrong)
