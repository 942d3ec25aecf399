"""Drives to record: a whole robot of fakes around a real, tiny policy."""

from __future__ import annotations

from pathlib import Path
from typing import List, Optional

import numpy as np

from robot.camera.source import Frame
from robot.config import RecordingConfig, RobotConfig
from robot.contract import PolicyContract
from robot.geometry import Pose, WheelSpeeds
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import FRAME_SHAPE
from robot.parts import Guidance, Tick
from robot.recording.drive_file import Heard, Subject, describe
from robot.recording.recorder import Recorder
from robot.runtime.loop import Runtime
from robot.safety.state_machine import MOVING, Command, Safety
from tests.robot.clocks import FakeClock
from tests.robot.fakes import FakeCamera, FakeMotors, FakeNavigator
from tests.robot.tiny_onnx import navigation_contract, write_policy

WALL_S = 1.7e9


class ColourCamera(FakeCamera):
    """Pictures in red, green, blue and black by turns, with noise: the tiny policy's actions."""

    def read(self) -> Optional[Frame]:
        frame = super().read()
        assert frame is not None
        tint = np.array([(255, 20, 20), (20, 255, 20), (20, 20, 255), (8, 8, 8)])[
            frame.sequence % 4
        ]
        image = (frame.image.astype(float) * tint / 255.0).astype(np.uint8)
        return frame._replace(image=image.reshape(FRAME_SHAPE))


class Robot:
    """Drives in lock-step; ``subject`` describes it for a recorder."""

    def __init__(self, folder: Path, contract: Optional[PolicyContract] = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.model = write_policy(folder / "model.onnx", contract or navigation_contract())
        self.clock = FakeClock()
        self.safety = Safety(self.clock)
        self.navigator = FakeNavigator()
        self._rng = np.random.default_rng(0)
        self.runtime = Runtime(
            ColourCamera(self.clock),
            OnnxPolicy(self.model),
            FakeMotors(lambda: self.safety.verdict.state in MOVING),
            self.safety,
            self.clock,
            navigator=self.navigator,
        )

    def subject(self) -> Subject:
        return describe(
            RobotConfig(str(self.model), name="daisy"),
            lambda tick: Heard(tick, Pose(0.5, 0.0, -0.5)),
        )

    def turns(self, count: int) -> List[Tick]:
        return [self.turn() for _ in range(count)]

    def turn(self) -> Tick:
        path = self._rng.uniform(-1.0, 1.0, 10).astype(np.float32)
        self.navigator.guidance = Guidance(path, Pose(1.0, 2.0, 0.5), pose_age_s=0.1)
        tick = self.runtime.step()
        self.clock.now_s += float(self._rng.uniform(0.05, 0.15))
        return tick

    def ask(self, command: Command, wheels: Optional[WheelSpeeds] = None) -> None:
        answer = self.runtime.ask(command, wheels)
        assert answer.accepted, answer.sentence

    def drive(self, count: int) -> List[Tick]:
        """Some turns at rest, armed, by the policy, by hand, and at rest again."""
        ticks = self.turns(3)
        self.ask(Command.ARM)
        ticks += self.turns(2)
        self.ask(Command.AUTO)
        ticks += self.turns(count)
        self.ask(Command.MANUAL, WheelSpeeds(0.2, -0.1))
        ticks += self.turns(3)
        self.ask(Command.STOP)
        return ticks + self.turns(2)


def record(robot: Robot, folder: Path, ticks: List[Tick]) -> List[Path]:
    """Record these turns; the files, oldest first."""
    with Recorder(RecordingConfig(str(folder), 0.0), robot.subject(), lambda: WALL_S) as recorder:
        for tick in ticks:
            recorder.on_tick(tick)
    assert recorder.dropped == 0
    return sorted(folder.iterdir(), key=lambda path: (len(path.name), path.name))
