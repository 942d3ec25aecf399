from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, Tuple

import pytest
import yaml

from robot.bringup.yaml_edit import edit_yaml, set_value
from robot.config import RobotConfig
from robot.errors import ConfigError
from robot.typed_config import load_yaml

WRITTEN = """\
# My robot.
model: lane.onnx   # the good one
hat:
  # from the shop
  steps_per_rev: 48   # guessed
  left: {port: M1M2}

camera: {kind: csi}
# the end
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "robot.yaml").write_text(WRITTEN)
    return tmp_path / "robot.yaml"


def test_a_value_changes_and_every_other_byte_stays(path: Path) -> None:
    edits = edit_yaml(RobotConfig, path, {("hat", "steps_per_rev"): 47.0})
    assert path.read_text() == WRITTEN.replace("48 ", "47.0 ")
    assert [str(edit) for edit in edits] == ["hat.steps_per_rev: 48 -> 47"]


NEW: Dict[str, Tuple[Tuple[str, ...], Any]] = {
    "in a block": (("hat", "microsteps"), 1),
    "in braces": (("camera", "flip"), 2),
    "new section in braces": (("camera", "mount", "pitch_rad"), 0.3),
    "new section in a block": (("hat", "drive", "baseline_m"), 0.1),
    "new section in the file": (("safety", "max_wheel_mps"), 0.2),
    "deep in braces": (("hat", "left", "gain"), 1.02),
    "a tiny number": (("hat", "hold_duty"), 1e-6),
    "a list": (("hat", "addresses"), (0x60,)),
}


@pytest.mark.parametrize("case", NEW)
def test_new_keys_find_their_place_and_comments_stay(path: Path, case: str) -> None:
    keys, value = NEW[case]
    edit_yaml(RobotConfig, path, {keys: value})
    found: Any = load_yaml(RobotConfig, path)
    for key in keys:
        found = getattr(found, key)
    assert found == value
    for comment in ("# My robot.", "# the good one", "# from the shop", "# guessed", "# the end"):
        assert comment in path.read_text()
    before = path.read_text()
    edit_yaml(RobotConfig, path, {keys: value})
    assert path.read_text() == before


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# nothing yet\n",
        "a:\n",
        "a:   # soon\n",
        "a: {}\n",
        "a: ~\n",
        "b: 1",
        "{b: 1}\n",
        "a: 3\n",
    ],
)
def test_files_of_every_shape_take_a_value(text: str) -> None:
    before = yaml.safe_load(text) or {}
    after = yaml.safe_load(set_value(text, ("a", "x", "y"), 1.5))
    assert after["a"] == {"x": {"y": 1.5}}
    assert {key: item for key, item in after.items() if key != "a"} == {
        key: item for key, item in before.items() if key != "a"
    }


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({("hat", "microsteps"): 3}, "expected one of"),
        ({("hat", "micro_steps"): 2}, "did you mean 'microsteps'"),
    ],
)
def test_what_the_robot_would_refuse_is_not_written(
    path: Path, values: Dict[Tuple[str, ...], Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        edit_yaml(RobotConfig, path, values)
    assert path.read_text() == WRITTEN


def test_an_anchor_that_others_share_is_left_to_a_person(path: Path) -> None:
    text = "model: m.onnx\nhat: {left: &l {port: M1M2}, right: {port: M3M4}}\n"
    path.write_text(text.replace("right: {port: M3M4}", "right: {<<: *l, port: M3M4}"))
    before = path.read_text()
    edit_yaml(RobotConfig, path, {("hat", "right", "gain"): 1.01})
    assert load_yaml(RobotConfig, path).hat.right.gain == 1.01
    path.write_text(before)
    with pytest.raises(ConfigError, match=r"write there yourself: hat\.left\.gain: 1\.01"):
        edit_yaml(RobotConfig, path, {("hat", "left", "gain"): 1.01})
    assert path.read_text() == before
