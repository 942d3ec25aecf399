from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, Tuple

import pytest
import yaml

from robot.cli.calibrate import edit_yaml
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


def test_a_value_changes_and_every_byte_of_other_sections_stays(path: Path) -> None:
    edits = edit_yaml(path, {("hat", "steps_per_rev"): 47.0})
    before, after = WRITTEN.split("hat:"), path.read_text().split("hat:")
    assert after[0] == before[0]
    assert after[1].endswith("\n\ncamera: {kind: csi}\n# the end\n")
    assert edits == ["hat.steps_per_rev: 48 -> 47"]


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
    edit_yaml(path, {keys: value})
    found: Any = load_yaml(RobotConfig, path)
    for key in keys:
        found = getattr(found, key)
    assert found == value
    for comment in ("# My robot.", "# the good one", "# the end"):
        assert comment in path.read_text()
    before = path.read_text()
    edit_yaml(path, {keys: value})
    assert path.read_text() == before


@pytest.mark.parametrize(
    "hat",
    [
        "",
        "hat: {}\n",
        "hat: {steps_per_rev: 48,\n  microsteps: 1}\n",
        "hat:\n\n  # a motor\n  steps_per_rev: 48\n\n# of mine\n",
        "hat:\n    microsteps: 1",
    ],
)
def test_files_of_every_shape_take_a_value(path: Path, hat: str) -> None:
    for text in (f"model: m.onnx\n{hat}", f"{hat}\nmodel: m.onnx\n"):
        path.write_text(text)
        before = yaml.safe_load(text)
        edit_yaml(path, {("hat", "drive", "baseline_m"): 0.11})
        after = yaml.safe_load(path.read_text())
        assert after.pop("hat") == {
            **(before.pop("hat", None) or {}),
            "drive": {"baseline_m": 0.11},
        }
        assert after == before


def test_a_layout_beyond_it_is_left_to_a_person(path: Path) -> None:
    path.write_text("{model: m.onnx, hat: {steps_per_rev: 48}}\n")
    with pytest.raises(ConfigError, match=r"write there yourself: hat\.microsteps: 1"):
        edit_yaml(path, {("hat", "microsteps"): 1})
    assert path.read_text() == "{model: m.onnx, hat: {steps_per_rev: 48}}\n"


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
        edit_yaml(path, values)
    assert path.read_text() == WRITTEN


def test_what_an_anchor_shares_changes_in_one_place_alone(path: Path) -> None:
    shared = "hat: {left: &l {port: M1M2}, right: {<<: *l, port: M3M4}}\n"
    path.write_text(f"model: m.onnx\n{shared}")
    edit_yaml(path, {("hat", "left", "gain"): 1.01})
    hat = load_yaml(RobotConfig, path).hat
    assert (hat.left.gain, hat.right.gain) == (1.01, 1.0)
