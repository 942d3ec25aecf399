"""The steps of an installation, on a computer made of a folder and of programs that only note."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest

from robot.cli import install as files
from robot.cli import main
from robot.cli.install import FILES, Step, Write, do, make_plan, told
from robot.computer.footprint import ROOT
from robot.errors import ConfigError, HardwareError
from tests.robot.tiny_onnx import lane_contract, write_policy

UNIT_TEXT = (FILES / files.UNIT).read_text()


@pytest.fixture
def plan(tmp_path: Path) -> List[Step]:
    checkout = tmp_path / "checkout"
    checkout.mkdir()
    (checkout / "pyproject.toml").write_text("")
    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    return make_plan(checkout, "/usr/bin/python3.8", model)


@pytest.fixture
def noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Programs that write down how they were called; there is a group i2c and no user yet."""
    notes, programs = tmp_path / "notes", tmp_path / "programs"
    programs.mkdir()
    there = '[ "$1 $2" = "group i2c" ]'
    for name, ending in {
        **dict.fromkeys(("groupadd", "useradd", "usermod", "systemctl"), "true"),
        "getent": there,
        "id": "false",
    }.items():
        (programs / name).write_text(f'#!/bin/sh\necho "{name} $*" >> {notes}\n{ending}\n')
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    return notes


def test_whatever_a_step_needs_comes_before_it(plan: List[Step]) -> None:
    lines = [told(step)[0] for step in plan]

    def place(part: str) -> int:
        return next(i for i, line in enumerate(lines) if part in line)

    order = ("groupadd", "useradd", "usermod", "-d -o duckpilot", "-m venv", "-m pip", "enable")
    assert sorted(order, key=place) == list(order)
    assert place(files.UNIT_FILE) < place("daemon-reload") < place("enable")
    assert place(files.UDEV_RULE) < place("udevadm control") < place("udevadm trigger")
    assert place(files.PREFIX) < place(f"write {files.MODEL}")


def test_files_are_written_and_what_a_person_edited_stays(tmp_path: Path, plan: List[Step]) -> None:
    writes = [step for step in plan if isinstance(step, Write)]
    for step in writes:
        do(step, tmp_path)
        assert (tmp_path / step.path[1:]).read_bytes() == step.content
    assert {step.path for step in writes} == {
        *(files.MODEL, files.CONFIG, files.UDEV_RULE, files.UNIT_FILE)
    }
    config, unit = tmp_path / files.CONFIG[1:], tmp_path / files.UNIT_FILE[1:]
    config.write_text("model: mine.onnx\n")
    unit.write_text("# of an older version\n")
    for step in writes:
        do(step, tmp_path)
    assert config.read_text() == "model: mine.onnx\n"
    assert "WatchdogSec" in unit.read_text()


def test_groups_and_user_are_made_where_there_are_none(noted: Path, plan: List[Step]) -> None:
    for step in plan:
        if not isinstance(step, Write) and ("sh" in step or "usermod" in step):
            do(step)
    lines = noted.read_text().splitlines()
    assert "groupadd --system video" in lines
    assert "groupadd --system i2c" not in lines
    made = [line for line in lines if line.startswith("useradd")]
    assert made[0].endswith("--home-dir /var/lib/duckpilot --shell /usr/sbin/nologin duckpilot")
    assert lines[-1] == "usermod --append --groups i2c,video,gpio duckpilot"


def test_a_command_that_fails_is_told() -> None:
    with pytest.raises(HardwareError, match="false: ended with status 1"):
        do(("false",))
    with pytest.raises(HardwareError, match="no-such-program: expected a program"):
        do(("no-such-program",))


def test_a_python_without_any_package_can_install() -> None:
    code = "from robot.cli import main; main(['install', '--dry-run'])"
    command = [
        sys.executable,
        "-I",
        "-S",
        "-c",
        f"import sys; sys.path[:0] = [{str(ROOT)!r}]; {code}",
    ]
    assert b"nothing was done" in subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout


def test_the_first_configuration_is_valid() -> None:
    from robot.config import RobotConfig
    from robot.typed_config import load_yaml

    config = load_yaml(RobotConfig, FILES / "robot.yaml")
    assert config.model == files.MODEL
    assert config.recording is not None
    assert config.recording.folder.startswith(f"{files.STATE}/")
    assert config.safety.max_wheel_mps < 0.3
    assert config.link is None


def test_the_unit_passes_systemds_own_check(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze on this computer")
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    text = UNIT_TEXT.replace(f"{files.VENV}/bin/python", str(program))
    unit = tmp_path / files.UNIT
    unit.write_text(text.replace(f"User={files.USER}", "User=root"))
    assert complaints(unit) == []
    unit.write_text(text.replace("WatchdogSec=2", "WatchdogSec=soon"))
    assert "soon" in complaints(unit)[0]


def test_the_unit_switches_off_where_the_configuration_says() -> None:
    lines = UNIT_TEXT.splitlines()
    config = "--config /etc/duckpilot/robot.yaml"
    assert f"ExecStart=/opt/duckpilot/venv/bin/python -m robot drive {config}" in lines
    assert "SupplementaryGroups=i2c video gpio" in lines
    assert f"ExecStopPost=/opt/duckpilot/venv/bin/python -m robot off {config}" in lines


def complaints(unit: Path) -> List[str]:
    """What systemd says of the unit, less what it says of the computer's others."""
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    said = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return [line for line in said.stdout.decode().splitlines() if files.UNIT in line]


def test_only_a_checkout_can_be_installed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"pyproject\.toml"):
        make_plan(tmp_path, sys.executable, tmp_path / "m.onnx")
    with pytest.raises(ConfigError, match="expected an ONNX policy"):
        make_plan(ROOT, sys.executable, tmp_path / "m.onnx")


def test_the_command_shows_itself_dry(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["install", "--dry-run"]) == 0
    shown = capsys.readouterr().out
    assert shown.endswith("nothing was done\n")
    assert f"would write {files.CONFIG}, unless it is there:\n    # The robot." in shown
    assert f"would run: systemctl enable {files.UNIT}" in shown
