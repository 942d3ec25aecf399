"""The robot's runtime on virtual camera, HAT and wheels; an expert stands in for the policy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from robot.contract import FIVE_ACTIONS, Action, ImageSpec, PolicyContract
from robot.geometry import Pose
from robot.inference.policy import TranslatorContract
from robot.navigation.road_map import load_map
from robot.parts import Tick
from robot.safety.state_machine import State
from sim_pybullet.look import NOMINAL
from sim_pybullet.motors import expert_actions
from sim_pybullet.virtual.world import VirtualWorld
from tools.loop import laps
from tools.loop.__main__ import main
from tools.loop.cli import LoopOptions
from tools.loop.laps import LapDrive, LapRecord
from trainer.export import export_translator


class ExpertPolicy:
    """Knows the true pose; answers in the form of a network."""

    contract = PolicyContract("lane", "expert", ImageSpec(80, 60, 20))

    def __init__(self) -> None:
        self.drive: LapDrive | None = None

    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:
        assert self.drive is not None
        assert images.shape == (1, 40, 80, 3)
        pose = self.drive.world.pose
        arc_m = self.drive.lane.project(*pose[:2]).arc_m
        action = expert_actions(self.drive.lane.batch, np.array([pose]), np.array([arc_m]))[0]
        return np.eye(5, dtype=np.float32)[[action]]


class StubbornPolicy(ExpertPolicy):
    action = Action.LEFT

    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:
        return np.eye(5, dtype=np.float32)[[self.action]]


class StoppingPolicy(ExpertPolicy):
    """The expert with two actions more, of which it takes the stop in every other second."""

    actions = (*FIVE_ACTIONS, (0.0, 0.0), (-0.1, -0.1))
    contract = PolicyContract("lane", "expert", ImageSpec(80, 60, 20), actions=actions)

    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:
        assert self.drive is not None
        values = np.pad(super().values(images, path), ((0, 0), (0, 2)))
        return np.eye(7, dtype=np.float32)[[5]] if self.drive.clock.now() % 2.0 < 1.0 else values


class BrokenPolicy(ExpertPolicy):
    def values(self, images: np.ndarray, path: np.ndarray | None = None) -> np.ndarray:
        assert self.drive is not None
        values = super().values(images, path)
        return values * np.nan if self.drive.clock.now() > 3.0 else values


def ignore(tick: Tick, pose: Pose, record: LapRecord) -> None:
    """Nobody watches."""


def lap_drive(policy: ExpertPolicy) -> LapDrive:
    policy.drive = LapDrive(load_map("loop"), NOMINAL, policy, seed=1)
    return policy.drive


def test_an_expert_drives_a_third_of_a_lap_and_loses_no_step() -> None:
    drive = lap_drive(ExpertPolicy())
    record = drive.drive(0.33, ignore)
    drive.close()
    assert record.laps >= 0.33
    assert record.lost_steps == (0, 0)
    assert np.max(np.abs(record.offsets_m)) < 0.06
    assert drive.runtime.safety.verdict.state is State.DISARMED
    assert not drive.driver.energised


def test_a_policy_with_seven_actions_stops_and_goes_on_by_itself() -> None:
    ticks: list[Tick] = []
    drive = lap_drive(StoppingPolicy())
    record = drive.drive(0.1, lambda tick, pose, record: ticks.append(tick))
    drive.close()
    assert record.laps >= 0.1
    stopped = [tick for tick in ticks if tick.action == 5 and tick.drive is not None]
    assert len(stopped) > 10
    assert all(tick.verdict.state is State.AUTO for tick in stopped)
    assert all(tuple(tick.wheels) == (0.0, 0.0) for tick in stopped)
    assert record.lost_steps == (0, 0)


def test_the_odometry_of_the_steps_stays_near_the_truth() -> None:
    drive = lap_drive(ExpertPolicy())
    record = drive.drive(0.2, ignore)
    drive.close()
    position_m, heading_rad = record.odometry_errors[-1]
    # wheels turn as counted; tyres scrub in bends, by -1 to 6 degrees with the order of turns
    assert position_m < 0.08
    assert abs(heading_rad) < 0.15


@pytest.mark.parametrize("action", [Action.LEFT, Action.RIGHT])
def test_leaving_the_lane_ends_the_drive(action: Action) -> None:
    policy = StubbornPolicy()
    policy.action = action
    drive = lap_drive(policy)
    record = drive.drive(1.0, ignore)
    drive.close()
    assert record.left_lane
    assert record.laps < 0.2
    *within_m, last_m = np.abs(record.offsets_m)
    assert max(within_m) <= 0.19 * 0.585 < last_m < 0.15


def test_touching_something_ends_the_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = lap_drive(ExpertPolicy())
    monkeypatch.setattr(VirtualWorld, "collided", property(lambda world: drive.clock.now() > 1.0))
    record = drive.drive(0.2, ignore)
    drive.close()
    assert record.seconds < 1.5
    assert record.laps < 0.2


def test_who_gets_back_along_its_lane_has_driven_less(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, record = lap_drive(ExpertPolicy()), LapRecord()
    ahead, behind = (drive.lane.pose_at(arc_m) for arc_m in (1.1, 1.0))
    monkeypatch.setattr(drive.world, "advance", lambda *_: drive.world.place(behind))
    drive.world.place(ahead)
    with drive.driver:
        drive._turn(record, ignore)
    drive.close()
    assert record.laps == pytest.approx(-0.1 / drive.lane.length_m, rel=0.05)


def test_a_network_that_answers_nan_stops_the_robot_and_nothing_restarts_it() -> None:
    drive = lap_drive(BrokenPolicy())
    record = drive.drive(1.0, ignore)
    assert record.state == State.FAULT.value
    assert drive.runtime.safety.verdict.state is State.FAULT
    stopped, places = drive.world.pose, []
    drive.driver.open()
    for _ in range(15):
        drive.runtime.step()
        drive.world.advance(drive.driver, drive.clock.now() + 0.1)
        places.append(drive.world.pose)
    drive.driver.close()
    drive.close()
    assert np.hypot(*np.subtract(places[-1], stopped)[:2]) < 0.1, "without current it rolls out"
    assert np.hypot(*np.subtract(places[-1], places[-5])[:2]) < 0.001, "and stands"


def test_wrong_input_ends_with_status_2(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["--laps", "1", "--model", str(tmp_path / "none.onnx")]) == 2
    assert "none.onnx" in capsys.readouterr().err
    assert main(["--model", "a.onnx", "--laps", "-1"]) == 2


def test_the_summary_has_the_promised_keys() -> None:
    record = LapRecord(laps=2.0, offsets_m=[0.01], odometry_errors=[(0.02, 0.01)])
    figures = laps.summary(record, LoopOptions(laps=2.0, model=Path("a.onnx")), "nominal")
    promised = {"schema", "inputs", "missions", "arrived", "stops", "position_rms_m"}
    assert promised | {"heading_rms_rad"} <= figures.keys()
    assert figures["arrived"] == 1
    json.dumps(figures)


def test_the_summary_of_a_drive_that_ended_early() -> None:
    record = LapRecord(1.99, 80.0, False, "FAULT", "frozen")
    record.offsets_m, record.odometry_errors = [-0.02, 0.01], [(0.03, -0.01), (0.04, 0.01)]
    figures = laps.summary(record, LoopOptions(laps=2.0, model=Path("a.onnx")), "nominal")
    assert figures["arrived"] == 0
    assert figures["stops"] == [{"fault": "frozen", "latency_s": None, "state": "FAULT"}]
    told = {name: figures[name] for name in ("mean_path_distance_m", "max_path_distance_m")}
    assert told == pytest.approx({"mean_path_distance_m": 0.015, "max_path_distance_m": 0.02})
    assert figures["position_rms_m"] == pytest.approx(0.0353553, abs=1e-6)
    assert figures["heading_rms_rad"] == pytest.approx(0.01)


def test_only_a_translator_from_real_to_simulated_pictures_is_for_running(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    translator = tmp_path / "t.onnx"
    contract = TranslatorContract("cyclegan", "sim-to-real", ExpertPolicy.contract.image)
    export_translator(torch.nn.Identity(), contract, translator)
    assert main(["--laps", "1", "--translator", str(translator)]) == 2
    assert "expected a translator real-to-sim" in capsys.readouterr().err
