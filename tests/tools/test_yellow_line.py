import json
from pathlib import Path

import numpy as np
import pytest

from robot.errors import MapError
from robot.road_map import load_map
from sim_pybullet.classes import SemanticClass
from sim_pybullet.ground import paint_ground
from sim_pybullet.look import NOMINAL
from tools.yellow_line import main, measure
from tools.yellow_truth import yellow_middle


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
