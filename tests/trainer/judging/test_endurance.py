import json
from pathlib import Path

import numpy as np
import pytest

from robot.contract import Action
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from trainer.cli import main
from trainer.judging.endurance import endure

MODEL = Path("robot/models/lane_dueling.onnx")


def test_a_good_policy_stays_in_its_lane_without_an_end(tmp_path: Path) -> None:
    out = tmp_path / "endurance.json"
    arguments = ["endure", "--model", str(MODEL), "--hours", "0.008", "--robots", "2"]
    assert main([*arguments, "--json", str(out)]) == 0
    written = json.loads(out.read_text())
    assert written["stayed"] == 2
    assert written["shortest_h"] == pytest.approx(0.008)
    assert 6.0 < written["driven_lane_m"] < 0.008 * 3600 * 0.32
    assert written["mean_path_distance_m"] <= written["largest_path_distance_m"] < 0.11


def test_the_other_way_round_is_another_lane_and_bad_places_are_refused(tmp_path: Path) -> None:
    out = tmp_path / "e.json"
    arguments = ["endure", "--model", str(MODEL), "--hours", "0.001", "--robots", "1"]
    assert main([*arguments, "--lane", "inner", "--json", str(out)]) == 0
    assert json.loads(out.read_text())["lane"] == "inner"
    assert main([*arguments, "--lane", "middle"]) == 2
    assert main([*arguments, "--json", str(tmp_path)]) == 2


def test_whoever_leaves_the_lane_is_out() -> None:
    class Straight:
        contract = OnnxPolicy(MODEL).contract

        def act(self, pictures: np.ndarray, _: None) -> np.ndarray:
            return np.full(len(pictures), Action.STRAIGHT)

    ticks: list[None] = []
    result = endure(
        Straight(),  # type: ignore[arg-type]
        [load_map("loop")],
        [NOMINAL],
        1.0,
        3,
        5,
        lambda: ticks.append(None),
    )
    assert result.stayed == 0
    assert result.shortest_h < 0.01
    assert len(ticks) < 300


@pytest.mark.parametrize("asked", [["--hours", "0"], ["--hours", "nan"], ["--robots", "0"]])
def test_nothing_to_drive_is_refused(asked: list[str]) -> None:
    assert main(["endure", "--model", str(MODEL), *asked]) == 2
