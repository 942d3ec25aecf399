import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import MapError
from robot.navigation.path import lane_loop
from robot.navigation.road_map import load_map
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import NOMINAL
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.objects import build_scene
from tools.yellow_line import main
from tools.yellow_line_sheet import BORDERS, COLUMNS, TILE
from tools.yellow_line_sheet import main as sheet_main
from tools.yellow_truth import measure, yellow_middle


def test_the_truth_runs_through_the_paint() -> None:
    road_map = load_map("loop")
    line = yellow_middle(road_map)
    ground = paint_ground(road_map, NOMINAL.ground)
    rows, columns = np.nonzero(ground.classes == SemanticClass.YELLOW_LINE)
    rng = np.random.default_rng(0)
    for i in rng.integers(0, len(rows), 300):
        x_m = ground.west_m + (columns[i] + 0.5) * ground.texel_m
        y_m = ground.north_m - (rows[i] + 0.5) * ground.texel_m
        assert abs(line.project(x_m, y_m).offset_m) < 0.014  # half the line, and a texel


def test_a_road_with_junctions_has_no_truth() -> None:
    with pytest.raises(MapError, match="ring"):
        yellow_middle(load_map("arena"))


@pytest.mark.slow
def test_the_side_of_the_line_is_right_in_99_of_100_frames() -> None:
    result = measure("loop", NOMINAL, frames=2000, seed=1)
    assert result.agreement >= 0.99
    assert result.judged >= 0.9 * result.frames
    assert result.unknown_share < 0.05
    assert result.unknown_though_visible_share < 0.01
    assert result.offset_rms_m < 0.03


def test_the_command_writes_what_it_measured(tmp_path: Path) -> None:
    out = tmp_path / "new" / "yellow.json"
    assert main(["--frames", "60", "--json", str(out)]) == 0
    result = json.loads(out.read_text(encoding="utf-8"))
    assert result["schema"] == 1
    assert result["frames"] == 60
    assert result["inputs"]["map"] == "loop"


def test_wrong_input_is_one_line_and_exit_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--frames", "0"]) == 2
    assert main(["--map", "lop"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 2
    assert "expected 1 or more, got 0" in lines[0]
    assert "loop" in lines[1]


def test_the_sheet_draws_what_was_found(tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    road_map = load_map("loop")
    camera = RayCamera(ImageSpec(), 1)
    camera.set_robot(0, build_scene(road_map, NOMINAL, np.random.default_rng(0)), NOMINAL.rig())
    lane = lane_loop(road_map)
    for i, arc_m in enumerate(np.linspace(0.0, lane.length_m, 6)):
        picture = camera.render(np.array([lane.pose_at(float(arc_m))]))[0]
        cv2.imwrite(str(frames / f"{i}.png"), picture[..., ::-1])
    out = tmp_path / "sheet.png"
    assert sheet_main(["--images", str(frames), "--out", str(out)]) == 0
    sheet = cv2.imread(str(out))[..., ::-1]
    assert sheet.shape == (2 * TILE[1], COLUMNS * TILE[0], 3)
    assert tuple(sheet[0, 0]) == BORDERS[False], "a robot in its lane has not crossed the line"
    assert sheet_main(["--images", str(tmp_path / "none"), "--out", str(out)]) == 2
