"""The doctor, on a computer of which everything can be said."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

import pytest

import robot
from robot.cli import main
from robot.cli.doctor import FAIL, OK, WARN, Finding, examine
from robot.computer.machine import CameraLook, Machine
from robot.config import CameraConfig
from robot.contract import Proof
from robot.errors import HardwareError
from robot.hat.bus import I2cBus
from robot.inference.policy import PolicyTiming
from robot.lens import Mount
from robot.link.keys import keygen
from robot.link.messages import Reading
from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import BusFault
from tests.robot.camera.test_newest import FakeStream
from tests.robot.hat.rig import WatchedBus
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy


@dataclass
class Patient:
    """A healthy Jetson Nano; a test takes its health away."""

    python: Tuple[int, int] = (3, 8)
    processor: str = "aarch64"
    packages: Dict[str, str] = field(default_factory=dict)
    without: Tuple[str, ...] = ()
    hats: Dict[int, WatchedBus] = field(default_factory=dict)
    look: CameraLook = field(default_factory=lambda: CameraLook(29.5, (320, 240), False, 100.0))
    health: Tuple[Reading, ...] = (Reading("temperature", 45.0, "°C"), Reading("load", 0.2))
    unreachable: str = ""
    dead_camera: str = ""
    asked_of_disk: Tuple[Path, float] = (Path(), 0.0)

    def package(self, name: str) -> Optional[str]:
        return None if name in self.without else self.packages.get(name, "1.19.2")

    def buses(self) -> List[int]:
        return sorted(self.hats)

    def open_bus(self, number: int) -> I2cBus:
        if number not in self.hats:
            raise HardwareError(
                f"/dev/i2c-{number}: this user may not open it; add the user to i2c"
            )
        return self.hats[number]

    def watch(self, camera: CameraConfig, seconds: float) -> CameraLook:
        if self.dead_camera:
            raise HardwareError(self.dead_camera)
        return self.look

    def readings(self, folder: Path, least_mb: float) -> Tuple[Reading, ...]:
        self.asked_of_disk = (folder, least_mb)
        return self.health

    def connects(self, host: str, port: int) -> str:
        return self.unreachable


def bus_with_hat(address: int = 0x6F) -> WatchedBus:
    bus = WatchedBus()
    VirtualHat(bus, VirtualClock(), address)
    return bus


@pytest.fixture
def patient() -> Patient:
    return Patient(hats={0: WatchedBus(), 1: bus_with_hat()})


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A navigating robot with keys and a measured mount."""
    pytest.importorskip("zmq")
    keys = keygen(tmp_path / "keys")["robot"]
    model = write_policy(tmp_path / "nav.onnx", navigation_contract())
    (tmp_path / "robot.yaml").write_text(
        f"model: {model}\nmap: town\nlink: {{keys: {keys}}}\n"
        "camera: {mount: {pitch_rad: 0.34, height_m: 0.11}}\n"
        "recording: {folder: /no/such/folder/yet}\n"
    )
    return tmp_path / "robot.yaml"


def diagnose(patient: Patient, config: Optional[Path]) -> Dict[str, Finding]:
    return {finding.name: finding for finding in examine(patient, config)}


def test_a_healthy_robot_is_well_in_every_respect(patient: Patient, config: Path) -> None:
    findings = diagnose(patient, config)
    assert {finding.level for finding in findings.values()} == {OK}, findings
    assert not any(finding.remedy for finding in findings.values())
    assert len(findings) == 12
    assert patient.asked_of_disk == (Path("/no/such/folder/yet"), 500.0)


def test_a_robot_with_sight_does_without_a_localizer(patient: Patient, config: Path) -> None:
    sight = Path(robot.__file__).parent / "models" / "sight.onnx"
    config.write_text(config.read_text() + f"sight: {sight}\n")
    patient.unreachable = "timed out"
    found = diagnose(patient, config)["localizer"]
    assert (found.level, found.remedy) == (OK, "")
    assert found.says.endswith("timed out; sight tells the place")


Ail = Callable[[Patient], object]


def sets(**changes: object) -> Ail:
    return lambda patient: [setattr(patient, name, value) for name, value in changes.items()]


def suffers(*reading: Any) -> Ail:
    return sets(health=(Reading(*reading),))


def looks(**changes: object) -> Ail:
    return lambda patient: setattr(patient, "look", patient.look._replace(**changes))


AILMENTS: Dict[str, Tuple[Ail, str, str, str]] = {
    "no smbus2": (sets(without=("smbus2",)), "packages", FAIL, "pip install smbus2"),
    "deadly onnxruntime": (
        sets(packages={"onnxruntime": "1.21.0"}),
        "packages",
        FAIL,
        "onnxruntime==1.19.2",
    ),
    "no bus": (sets(hats={}), "motor HAT", FAIL, "pins 3 and 5"),
    "no HAT": (sets(hats={1: WatchedBus()}), "motor HAT", FAIL, "i2cdetect -y -r 1"),
    "another bus": (sets(hats={7: bus_with_hat(0x60)}), "motor HAT", FAIL, "{bus: 7, addres"),
    "not in the group": (sets(hats={0: WatchedBus()}), "motor HAT", FAIL, "to i2c"),
    "camera absent": (
        sets(dead_camera="/dev/video0: does not open"),
        "camera",
        FAIL,
        "nvargus-daemon",
    ),
    "camera slow": (looks(rate_hz=5.0), "camera", FAIL, "light"),
    "camera slower than told": (looks(rate_hz=15.0), "camera", WARN, "camera.fps"),
    "camera frozen": (looks(frozen=True), "camera", FAIL, "plug the camera again"),
    "lens covered": (looks(brightness=3.0), "camera", WARN, "cap"),
    "localizer away": (sets(unreachable="timed out"), "localizer", WARN, "is it running"),
    "disk filling": (suffers("disk free", 4.0, "%", "warn"), "disk free", WARN, "delete"),
    "little memory": (suffers("memory free", 90, "MB", "warn"), "memory free", WARN, "programs"),
    "hot": (suffers("temperature", 95.0, "°C", "bad"), "temperature", FAIL, "fan"),
    "warm": (suffers("temperature", 82.0, "°C", "warn"), "temperature", WARN, "fan"),
}


@pytest.mark.parametrize("ailment", AILMENTS)
def test_each_ailment_is_found_alone_with_what_to_do(
    patient: Patient, config: Path, ailment: str
) -> None:
    befall, name, level, remedy = AILMENTS[ailment]
    befall(patient)
    findings = diagnose(patient, config)
    assert findings[name].level == level
    assert remedy in findings[name].remedy
    assert remedy in findings[name].line
    assert [f.name for f in findings.values() if f.level != OK] == [name]


SETTINGS: Dict[str, Tuple[Callable[[str], str], str, str, str]] = {
    "unknown key": (lambda text: text + "modle: x\n", "config", FAIL, "did you mean 'model'"),
    "no such model": (lambda t: t.replace("nav.onnx", "x.onnx"), "policy", FAIL, "x.onnx"),
    "no such translator": (
        lambda text: text + "translator: x2.onnx\n",
        "policy",
        FAIL,
        "x2.onnx",
    ),
    "no such sight": (lambda text: text + "sight: x3.onnx\n", "policy", FAIL, "x3.onnx"),
    "no such map": (lambda t: t.replace("town", "twon"), "map", FAIL, "did you mean 'town'"),
    "no such keys": (lambda t: t.replace("keys/robot", "keys/r"), "keys", FAIL, "keygen"),
    "another's keys": (
        lambda t: t.replace("keys/robot", "keys/monitor"),
        "keys",
        FAIL,
        "another machine's folder",
    ),
    "tilted camera": (
        lambda t: t.replace("0.34", "0.44"),
        "camera mount",
        WARN,
        "tilt it up by 6.1°",
    ),
    "unmeasured camera": (
        lambda t: t.replace("{mount: {pitch_rad: 0.34, height_m: 0.11}}", "{}"),
        "camera mount",
        WARN,
        "calibrate camera",
    ),
}


@pytest.mark.parametrize("setting", SETTINGS)
def test_each_wrong_setting_is_found(patient: Patient, config: Path, setting: str) -> None:
    change, name, level, says = SETTINGS[setting]
    config.write_text(change(config.read_text()))
    finding = diagnose(patient, config)[name]
    assert finding.level == level
    assert says in finding.line


def test_keys_that_others_can_read_and_a_navigator_without_a_map_fail(
    patient: Patient, config: Path, tmp_path: Path
) -> None:
    (tmp_path / "keys" / "robot" / "secret.key").chmod(0o644)
    assert "chmod 600" in diagnose(patient, config)["keys"].line
    config.write_text(config.read_text().replace("map: town\n", ""))
    assert "no map is set" in diagnose(patient, config)["policy"].line


@pytest.mark.parametrize(
    ("mount", "level"),
    [
        ("pitch_rad: {2.9}, height_m: {14}", OK),
        ("pitch_rad: {-2.9}, height_m: {-14}", OK),
        ("pitch_rad: {3.1}, height_m: {0}", WARN),
        ("pitch_rad: {-3.1}, height_m: {0}", WARN),
        ("pitch_rad: {0.1}, height_m: {16}", WARN),
        ("pitch_rad: {0.1}, height_m: {-16}", WARN),
    ],
)
def test_a_mount_may_be_off_by_3_degrees_and_15_mm(
    patient: Patient, config: Path, mount: str, level: str
) -> None:
    nominal, (pitch, height) = Mount(), re.findall(r"{(.*?)}", mount)
    pitch_rad = nominal.pitch_rad + math.radians(float(pitch))
    height_m = nominal.height_m + 1e-3 * float(height)
    text = config.read_text().replace("pitch_rad: 0.34", f"pitch_rad: {pitch_rad}")
    config.write_text(text.replace("height_m: 0.11", f"height_m: {height_m}"))
    assert diagnose(patient, config)["camera mount"].level == level


@pytest.mark.parametrize(("took_ms", "level"), [(49.0, OK), (51.0, FAIL)])
def test_a_decision_may_take_half_of_the_time_between_two(
    patient: Patient, config: Path, monkeypatch: pytest.MonkeyPatch, took_ms: float, level: str
) -> None:
    timing = PolicyTiming(took_ms, 2.0 * took_ms)
    monkeypatch.setattr("robot.cli.doctor.time_decisions", lambda *_: timing)
    assert diagnose(patient, config)["policy"].level == level


UNPROVEN = Proof(20, 3, 0.05, 0.4, 0, 0, "it drove 3 of 20")


def test_a_policy_that_is_not_proven_fails(patient: Patient, config: Path) -> None:
    write_policy(config.with_name("nav.onnx"), navigation_contract(taught_from="b", proof=UNPROVEN))
    finding = diagnose(patient, config)["policy"]
    assert (finding.level, finding.remedy) == (FAIL, "the robot does not arm with it")
    assert "proven to 5% of drives" in finding.says


@pytest.mark.parametrize(("levels", "status"), [((OK, WARN), 0), ((OK, FAIL), 1), ((), 0)])
def test_one_failure_is_enough_for_the_exit_status(
    monkeypatch: pytest.MonkeyPatch, levels: Tuple[str, ...], status: int
) -> None:
    findings = [Finding("thing", level, "so") for level in levels]
    monkeypatch.setattr("robot.cli.doctor.examine", lambda *_: iter(findings))
    assert main(["doctor"]) == status


def test_a_stuck_bus_is_told_as_such(patient: Patient, config: Path) -> None:
    patient.hats[1].inject(BusFault.STUCK, count=100)
    finding = diagnose(patient, config)["motor HAT"]
    assert finding.level == FAIL
    assert "cycle the power" in finding.remedy


def test_looking_writes_to_no_chip(patient: Patient, config: Path) -> None:
    diagnose(patient, config)
    assert all(transaction.read_count for transaction in patient.hats[1].log)


def test_a_robot_without_a_link_needs_none(patient: Patient, tmp_path: Path) -> None:
    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    (tmp_path / "robot.yaml").write_text(f"model: {model}\n")
    findings = diagnose(patient, tmp_path / "robot.yaml")
    assert findings["link"].level == OK
    assert "localizer" not in findings


def test_the_command_tells_of_this_computer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    config = tmp_path / "robot.yaml"
    config.write_text(f"model: {model}\nhat: {{bus: 250}}\ncamera: {{kind: v4l2, number: 977}}\n")
    assert main(["doctor", "--config", str(config)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("OK    policy") for line in lines)
    assert any(line.startswith("FAIL  motor HAT") for line in lines)
    camera = next(line for line in lines if line.startswith("FAIL  camera  "))
    assert "/dev/video977" in camera
    assert lines[lines.index(camera) + 1].strip().startswith("->")


@pytest.mark.parametrize(("levels", "frozen"), [((7, 7, 7), True), ((7, 8, 7), False)])
def test_a_camera_is_watched_and_let_go_and_one_new_picture_shows_that_it_lives(
    monkeypatch: pytest.MonkeyPatch, levels: Tuple[int, ...], frozen: bool
) -> None:
    streams: List[FakeStream] = []

    def opened(*_: object) -> FakeStream:
        streams.append(FakeStream([*levels, *[7] * 1000]))
        return streams[-1]

    monkeypatch.setattr("robot.computer.machine.open_stream", opened)
    look = Machine().watch(CameraConfig(), 0.1)
    assert (look.frozen, look.size_px) == (frozen, (160, 120))
    assert look.rate_hz > 10.0
    assert streams[0]._closed


def test_this_computer_can_be_looked_at(tmp_path: Path) -> None:
    machine = Machine()
    assert machine.package("numpy")
    assert machine.package("no-such-package") is None
    assert "refused" in machine.connects("127.0.0.1", 9)
    assert all(math.isfinite(each.value) for each in machine.readings())
