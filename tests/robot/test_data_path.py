"""The way of a picture to the wheels is as short as docs/design.md lists it."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any, List, Set

import numpy as np

from robot.camera.source import NewestFrame
from robot.computer.clock import MonotonicClock
from robot.hat.config import HatConfig
from robot.hat.thread import motors_on
from robot.inference.policy import OnnxPolicy
from robot.runtime.loop import Runtime
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import MOVING, Command, Safety
from sim_pybullet.virtual.hat import VirtualHat
from tests.robot.hat.rig import WatchedBus
from tests.robot.tiny_onnx import lane_contract, write_policy

ROOT = Path(__file__).parent.parent.parent


def listed() -> List[str]:
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    section = text.split("## From the camera to the wheels")[1].split("\n## ")[0]
    return re.findall(r"^\d\. `([\w/]+\.py)`", section, re.MULTILINE)


class NoiseStream:
    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def grab(self) -> np.ndarray:
        time.sleep(0.02)
        return self._rng.integers(0, 255, (120, 160, 3), dtype=np.uint8)

    def close(self) -> None:
        pass


def test_one_turn_takes_a_picture_through_the_listed_modules_to_the_bus(tmp_path: Path) -> None:
    names = listed()
    assert 3 <= len(names) <= 8
    called: Set[str] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call" and (ROOT / "robot") in path.parents:
            called.add(path.relative_to(ROOT / "robot").as_posix())

    clock, bus = MonotonicClock(), WatchedBus()
    VirtualHat(bus, clock)
    patient = SafetyLimits(frame_age_s=9.0, loop_age_s=9.0)
    policy = OnnxPolicy(write_policy(tmp_path / "lane.onnx", lane_contract()))
    with NewestFrame(NoiseStream, clock.now) as camera, motors_on(bus, HatConfig()) as motors:
        runtime = Runtime(camera, policy, motors, Safety(clock.now, patient), clock)
        while runtime.step().frame is None:
            time.sleep(0.02)
        assert runtime.ask(Command.ARM).accepted
        assert runtime.ask(Command.AUTO).accepted
        written = len(bus.log)
        sys.setprofile(note)
        try:
            tick = runtime.step()
        finally:
            sys.setprofile(None)
        assert tick.verdict.state in MOVING, tick.verdict.sentence
        assert len(bus.log) > written, "the coils were told something"
    assert set(names) <= called
