"""The side of the yellow line, told from simulated frames, against the map."""

import numpy as np
import pytest

from robot.errors import MapError
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.scene import SemanticClass
from tests.thorough import count
from tests.trainer.judging.yellow_truth import measure, yellow_middle


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
def test_the_side_of_the_line_is_right_in_99_of_100_frames() -> None:  # -rP shows the figures
    result = measure("loop", NOMINAL, frames=count(1_000, 10_000), seed=1)
    print(result)
    assert result.agreement >= 0.99
    assert result.judged >= 0.9 * result.frames
    assert result.unknown_share < 0.05
    assert result.unknown_though_visible_share < 0.01
    assert result.offset_rms_m < 0.03
