from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Dict

import pytest

from robot.config import CameraConfig, RobotConfig
from robot.errors import ConfigError
from robot.lens import DUCKIEBOT_LENS
from robot.link.sockets import LinkConfig, OtherRobot
from robot.safety.governors import FirstCome, KeepApart, Rules, StopLines
from robot.typed_config import from_plain, load_yaml, to_plain


def test_the_model_is_enough() -> None:
    config = from_plain(RobotConfig, {"model": "m.onnx"})
    assert config == RobotConfig("m.onnx")
    assert (config.recording, config.link, config.map) == (None, None, ""), "unless one asks"
    assert from_plain(RobotConfig, to_plain(config)) == config


def test_a_monitor_is_waited_for_no_longer_than_until_it_is_forgotten() -> None:
    """After 2 s another monitor's word counts, so by then the robot must have stopped."""
    safety = {"safety": {"link_age_s": 1.5}}
    assert from_plain(RobotConfig, {"model": "m.onnx", **safety}).safety.link_age_s == 1.5
    safety["safety"]["link_age_s"] = 2.0
    with pytest.raises(ConfigError, match=r"safety\.link_age_s: expected 0\.0 to 1\.5, got 2\.0"):
        from_plain(RobotConfig, {"model": "m.onnx", **safety})


@pytest.mark.parametrize("focal_mm", [3.04, 63.9])
def test_a_focal_length_is_in_pixels(focal_mm: float) -> None:
    with pytest.raises(ConfigError, match=r"camera\.lens\.fx_px: expected 64\.0 to 64000\.0, got"):
        CameraConfig(lens=replace(DUCKIEBOT_LENS, fx_px=focal_mm))
    assert CameraConfig(lens=replace(DUCKIEBOT_LENS, fx_px=64.0)).lens.fx_px == 64.0


def test_a_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(
        "model: nav.onnx\nmap: town\nname: daisy\n"
        "camera: {kind: v4l2, number: 1}\n"
        "hat: {bus: 7, left: {port: M3M4}, right: {port: M1M2, reversed: true}}\n"
        "safety: {frame_age_s: 0.3, max_wheel_mps: 0.2}\n"
        "link: {keys: k, base_port: 6000}\n",
        encoding="utf-8",
    )
    config = load_yaml(RobotConfig, path)
    assert config.camera == CameraConfig("v4l2", 1)
    assert (config.hat.bus, config.hat.left.port) == (7, "M3M4")
    assert config.safety.max_wheel_mps == 0.2
    assert config.link is not None
    assert config.link.base_port == 6000
    assert from_plain(RobotConfig, to_plain(config)) == config


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({}, "missing model"),
        ({"model": "m", "camra": {}}, "did you mean 'camera'"),
        ({"model": "m", "camera": {"kind": "v4l"}}, "did you mean 'v4l2'"),
        ({"model": "m", "camera": {"kind": "socket"}}, "expected a path with kind socket"),
        ({"model": "m", "camera": {"path": "x"}}, "and only with it"),
        ({"model": "m", "camera": {"fps": 5}}, "camera.fps: expected 10 to 120, got 5"),
        ({"model": "m", "camera": {"flip": 9}}, "flip 0 to 7"),
        ({"model": "m", "camera": {"flip": -1}}, "flip 0 to 7"),
        ({"model": "m", "camera": {"number": -1}}, "number 0 to 999"),
        ({"model": "m", "camera": {"number": 1000}}, "number 0 to 999"),
        ({"model": "m", "camera": {"kind": "v4l2", "fps": 121}}, "fps: expected 10 to 120"),
        ({"model": "m", "recording": {"folder": ""}}, "leave the recording section out"),
        ({"model": "m", "safety": {"frame_age": 1}}, "did you mean 'frame_age_s'"),
        ({"model": "m", "safety": {"loop_age_s": True}}, "expected float, got True (bool)"),
        ({"model": "m", "hat": {"bus": True}}, "expected int, got True (bool)"),
        ({"model": "m", "rules": {"headway": 1}}, "expected bool, got 1 (int)"),
        ({"model": "m", "safety": {"loop_age_s": -1}}, "loop_age_s: expected a positive number"),
        ({"model": "m", "hat": {"max_speed_mps": 0.2}}, "at least safety.max_wheel_mps"),
        ({"model": "m", "hat": {"command_timeout_s": 0.1}}, "command_timeout_s: expected 0.2 to 2"),
        ({"model": "m", "hat": {"command_timeout_s": 500}}, "command_timeout_s: expected 0.2 to 2"),
        ({"model": "m", "camera": {"mount": {"pitch_rad": 19.15}}}, "pitch_rad: expected -3.2 to"),
        (
            {"model": "m", "camera": {"mount": {"forward_m": 6.6}}},
            "forward_m: expected -1.0 to 1.0",
        ),
        *(
            ({"model": "m", "safety": {name: value}}, f"safety.{name}: expected 0.0 to {most}, got")
            for name, value, most in (
                ("frame_age_s", 200, 3.0),
                ("loop_age_s", 200, 3.0),
                ("manual_age_s", 300, 3.0),
                ("blind_s", 500, 3.0),
                ("pose_within_m", 8, 0.5),
                ("pose_within_rad", 20, 3.0),
                ("frozen_frames", 5000, 100),
            )
        ),
        ({"model": "m", "map": "town"}, "expected a link as well"),
    ],
)
def test_what_does_not_fit_is_refused(data: dict, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        from_plain(RobotConfig, data)
    assert said in str(caught.value)


NAVIGATOR: Dict[str, Any] = {
    "map": "town",
    "sight": "sight.onnx",
    "rules": Rules(headway=True),
    "link": LinkConfig("keys", robots=(OtherRobot("robot2", "192.168.1.12"),)),
}


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"rules": Rules(stop_lines=True)}, r"rules\.stop_lines: expected a map as well"),
        ({"rules": Rules(headway=True)}, r"rules\.headway: expected sight as well"),
        ({"sight": "sight.onnx"}, r"sight: expected a map as well, .* or rules\.headway"),
        ({**NAVIGATOR, "rules": Rules()}, r"link\.robots: expected map, sight and rules\.headway"),
        ({**NAVIGATOR, "sight": ""}, r"link\.robots: expected map, sight and rules\.headway"),
    ],
)
def test_rules_and_sight_have_what_they_need(told: dict, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        RobotConfig("lane.onnx", **told)
    RobotConfig("lane.onnx", sight="sight.onnx", rules=Rules(headway=True))
    RobotConfig("nav.onnx", **NAVIGATOR)


def test_right_of_way_needs_the_rules_that_it_counts_on() -> None:
    for lacking in (Rules(stop_lines=True), Rules(headway=True)):
        with pytest.raises(ConfigError, match=r"rules\.right_of_way: expected stop_lines and hea"):
            replace(lacking, right_of_way=True)
    every = Rules(True, True, True).chain()
    assert [type(rule) for rule in every] == [KeepApart, StopLines, FirstCome]
    assert Rules().chain() == ()
