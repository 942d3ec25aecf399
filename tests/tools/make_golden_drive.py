"""Makes tests/data/golden_drive.mcap, the drive that every change to the robot must decide alike.

``PYTHONPATH=. python -m tests.tools.make_golden_drive``; only when the contract itself has changed.
Simulated frames (on a floor without grain, so that they pack well), the shipped policy inside.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from robot.config import RecordingConfig, RobotConfig
from robot.geometry import Pose
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import load_map
from robot.parts import Tick
from robot.recording.drive_file import Heard, describe
from robot.recording.recorder import Recorder
from sim_pybullet.look import NOMINAL
from tools.loop.laps import LapDrive, LapRecord

MODEL = Path("robot/models/lane_dueling.onnx")
TARGET = Path("tests/data/golden_drive.mcap")
LAPS, SEED = 0.09, 7
WALL_S = 1.7e9
LEAST_MARGIN = 0.005  # so that no other onnxruntime decides otherwise


def main() -> None:
    """Drive, look whether every decision is clear, and keep the recording."""
    look = replace(NOMINAL, ground=replace(NOMINAL.ground, grain=0.0))
    drive = LapDrive(load_map("loop"), look, OnnxPolicy(MODEL), SEED)
    margins: list[float] = []
    actions: list[int] = []

    def watch(tick: Tick, pose: Pose, lap: LapRecord) -> None:
        recorder.on_tick(tick)
        assert tick.values is not None
        assert tick.action is not None
        worst, best = np.sort(tick.values)[-2:]
        margins.append(float(best - worst))
        actions.append(int(tick.action))

    config = RobotConfig(str(MODEL), name="golden")
    with tempfile.TemporaryDirectory() as folder:
        subject = describe(config, lambda tick: Heard(tick, drive.driver.pose))
        # Any processor must decide alike, whichever made the drive.
        subject = subject._replace(about={**subject.about, "processor": "any"})
        with Recorder(RecordingConfig(folder, 0.0), subject, lambda: WALL_S) as recorder:
            drive.drive(LAPS, watch)
        drive.close()
        (made,) = Path(folder).iterdir()
        data = made.read_bytes()
    print(f"{len(data)} bytes, {len(actions)} turns, actions {actions}, margin {min(margins):.4f}")
    if min(margins) < LEAST_MARGIN:
        raise SystemExit(f"expected margins of {LEAST_MARGIN} or more; try another SEED")
    TARGET.write_bytes(data)


if __name__ == "__main__":
    main()
