"""What the robot asks of its hardware, of the emulators and of the real thing alike.

``python -m pytest tests/robot/hardware --robot robot.yaml`` drives a real robot: its wheels must be
off the floor, and its service stopped.
"""

from __future__ import annotations

import time
from typing import Callable, Iterator, List

import numpy as np
import pytest

from robot.camera.source import CAPTURE_PX, Camera, Frame, NewestFrame, open_stream
from robot.computer.clock import MonotonicClock
from robot.config import RobotConfig
from robot.geometry import WheelSpeeds
from robot.hat.bus import FULL, Pca9685, channel_register, open_bus
from robot.hat.driver import WAKE_S
from robot.hat.thread import MotorThread, real_motors
from robot.inference.preprocess import FRAME_SHAPE, check_frame

SPEED_MPS = 0.1
DRIVE_S = 1.0
REFRESH_S = 0.1  # as often as a policy decides
COUNT_TOLERANCE_S = 0.25  # of a computer that is busy with other things
PATIENCE_S = 10.0


@pytest.fixture
def motors(robot: RobotConfig) -> Iterator[MotorThread]:
    with real_motors(robot.hat) as opened:
        yield opened
    assert outputs_off(robot), "closed motors leave every output off"


def outputs_off(robot: RobotConfig) -> bool:
    """Whether the chip itself says that no channel is on."""
    bus = open_bus(robot.hat.socket or robot.hat.bus)
    chip = Pca9685.probe(bus, robot.hat.addresses, MonotonicClock())
    tops = [bus.read(chip.address, channel_register(channel) + 3, 1)[0] for channel in range(16)]
    return all(top & FULL for top in tops)


def drive(motors: MotorThread, wheels: WheelSpeeds, duration_s: float = DRIVE_S) -> None:
    end_s = time.monotonic() + duration_s
    while time.monotonic() < end_s:
        motors.set_wheels(wheels)
        time.sleep(REFRESH_S)


def eventually(holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.02)


@pytest.mark.parametrize("wheels", [(1, 1), (-1, -1), (1, -1), (0, 1)])
def test_the_wheels_step_as_told(robot: RobotConfig, motors: MotorThread, wheels: tuple) -> None:
    speeds = WheelSpeeds(*(SPEED_MPS * way for way in wheels))
    drive(motors, speeds)
    motors.stop()
    ramp_s = SPEED_MPS / robot.hat.acceleration_mps2
    for count, step_m, way in zip(motors.counts, robot.hat.wheel_steps_m, wheels):
        rolled_s = way * count * step_m / SPEED_MPS
        expected_s = abs(way) * (DRIVE_S - WAKE_S - 0.5 * ramp_s)
        assert rolled_s == pytest.approx(expected_s, abs=COUNT_TOLERANCE_S)
    assert motors.healthy


def test_an_old_command_counts_no_longer(robot: RobotConfig, motors: MotorThread) -> None:
    drive(motors, WheelSpeeds(SPEED_MPS, SPEED_MPS))
    time.sleep(robot.hat.command_timeout_s + 0.5)
    before = motors.counts
    time.sleep(0.3)
    assert motors.counts == before
    assert before != (0, 0)


def test_released_motors_have_every_output_off(robot: RobotConfig, motors: MotorThread) -> None:
    drive(motors, WheelSpeeds(SPEED_MPS, SPEED_MPS), 0.6)
    assert not outputs_off(robot)
    motors.release()
    eventually(lambda: outputs_off(robot))


def test_an_update_of_both_motors_leaves_time_for_others(robot: RobotConfig) -> None:
    bus = open_bus(robot.hat.socket or robot.hat.bus)
    chip = Pca9685.probe(bus, robot.hat.addresses, MonotonicClock())
    chip.initialise()
    began_s = time.monotonic()
    for _ in range(50):
        chip.set_channels(3, [0.0] * 10)  # all coils off: no wheel moves
    update_s = (time.monotonic() - began_s) / 50
    chip.all_off()
    assert update_s * robot.hat.max_speed_mps / min(robot.hat.wheel_steps_m) < 0.8
    assert outputs_off(robot)


def watch(camera: Camera, duration_s: float) -> List[Frame]:
    """A control loop's looks."""
    looks: List[Frame] = []
    end_s = time.monotonic() + duration_s
    while time.monotonic() < end_s:
        frame = camera.read()
        assert frame is not None
        looks.append(frame)
        time.sleep(REFRESH_S)
    return looks


def test_the_camera_gives_new_pictures_in_time(robot: RobotConfig) -> None:
    with NewestFrame(lambda: open_stream(robot.camera, CAPTURE_PX), time.monotonic) as camera:
        eventually(lambda: camera.read() is not None)
        looks = watch(camera, 2.0)
        assert time.monotonic() - looks[-1].time_s < 0.4
    for frame in looks:
        check_frame(frame.image)
        assert frame.image.shape == FRAME_SHAPE
    numbers = [frame.sequence for frame in looks]
    assert numbers == sorted(numbers)
    assert len(set(numbers)) > 0.8 * len(looks), "faster than the robot decides"
    assert any(not np.array_equal(a.image, b.image) for a, b in zip(looks, looks[1:])), (
        "the pictures differ by noise at least"
    )
