"""The steps of an installation, on a computer made of a folder and of programs that only note."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Dict, List

import pytest

from robot.cli import install, main
from robot.cli.install import ROOT, SCRIPT, make_command
from robot.config import RobotConfig
from robot.errors import ConfigError
from robot.inference.policy import SHIPPED_MODELS
from robot.safety.governors import Rules
from robot.typed_config import load_yaml
from tests.robot.tiny_onnx import lane_contract, write_policy

UNIT = "duckpilot-robot.service"
UNIT_TEXT = (SCRIPT.parent / UNIT).read_text()
PYTHON = "/opt/duckpilot/venv/bin/python"
STATE = "/var/lib/duckpilot"
NOTE = '#!/bin/sh\necho "$(basename $0) $*" >> {notes}\n{ending}\n'


class Computer:
    """A computer with a group i2c and no user yet; its programs write down their calls."""

    def __init__(self, folder: Path) -> None:
        self.root, self.notes, self._programs = folder / "root", folder / "notes", folder / "bin"
        for path in ("etc/udev/rules.d", "etc/systemd/system"):
            (self.root / path).mkdir(parents=True)
        self.checkout = folder / "checkout"
        self.checkout.mkdir()
        (self.checkout / "pyproject.toml").write_text("")
        self.model = write_policy(folder / "mine.onnx", lane_contract())
        self._programs.mkdir()
        last = "for last; do :; done; mkdir -p"
        self._program("install", f'{last} "$last"; mkdir -p "{self.root}/etc/duckpilot"')
        made = f'{last} "$last/bin" && cp "$0" "$last/bin/python"'
        self._program("python", f'test "$2" != venv || {{ {made}; }}')
        self._program("getent", '[ "$1 $2" = "group i2c" ]')
        self._program("id", "false")
        for name in ("groupadd", "useradd", "usermod", "udevadm", "systemctl"):
            self._program(name, "true")

    def _program(self, name: str, ending: str) -> None:
        (self._programs / name).write_text(NOTE.format(notes=self.notes, ending=ending))
        (self._programs / name).chmod(0o755)

    def breaks(self, name: str) -> None:
        self._program(name, "exit 3")

    def install(self) -> int:
        command = make_command(self.checkout, self.model)
        command[3] = str(self._programs / "python")
        path = f"{self._programs}{os.pathsep}{os.environ['PATH']}"
        environment: Dict[str, str] = {**os.environ, "PATH": path}
        return subprocess.run([*command, str(self.root)], env=environment, check=False).returncode

    def file(self, path: str) -> Path:
        return self.root / path.lstrip("/")

    @property
    def lines(self) -> List[str]:
        return self.notes.read_text().splitlines()


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


def test_whatever_a_step_needs_comes_before_it(computer: Computer) -> None:
    assert computer.install() == 0

    def place(part: str) -> int:
        return next(i for i, line in enumerate(computer.lines) if part in line)

    order = (
        *("groupadd", "useradd", "usermod", "-d -o duckpilot", "-m venv", "upgrade pip"),
        *("--constraint", "udevadm control", "udevadm trigger", "daemon-reload", "enable"),
    )
    assert sorted(order, key=place) == list(order)
    assert f"{computer.checkout}/constraints-nano.txt {computer.checkout}" in str(computer.lines)


def test_files_are_written_and_what_a_person_edited_stays(computer: Computer) -> None:
    assert computer.install() == 0
    config = computer.file("/etc/duckpilot/robot.yaml")
    unit = computer.file(f"/etc/systemd/system/{UNIT}")
    rule = computer.file("/etc/udev/rules.d/99-duckpilot-i2c.rules")
    assert computer.file("/opt/duckpilot/lane.onnx").read_bytes() == computer.model.read_bytes()
    sight = (SHIPPED_MODELS / "sight.onnx").read_bytes()
    assert computer.file("/opt/duckpilot/sight.onnx").read_bytes() == sight
    for file in (config, unit, rule):
        assert file.read_bytes() == (SCRIPT.parent / file.name).read_bytes()
    config.write_text("model: mine.onnx\n")
    unit.write_text("# of an older version\n")
    assert computer.install() == 0, "again"
    assert config.read_text() == "model: mine.onnx\n"
    assert "WatchdogSec" in unit.read_text()


def test_a_policy_that_a_person_chose_stays_until_another_is_asked_for(computer: Computer) -> None:
    mine = computer.model.read_bytes()
    assert computer.install() == 0
    shipped = computer.checkout / "robot" / "models" / "lane_sight.onnx"
    shipped.parent.mkdir(parents=True)
    shipped.write_bytes(b"shipped")
    computer.model, other = shipped, computer.model
    assert computer.install() == 0, "after an update"
    assert computer.file("/opt/duckpilot/lane.onnx").read_bytes() == mine
    other.write_bytes(b"better")
    computer.model = other
    assert computer.install() == 0
    assert computer.file("/opt/duckpilot/lane.onnx").read_bytes() == b"better"
    computer.file("/opt/duckpilot/lane.onnx").unlink()
    computer.model = shipped
    assert computer.install() == 0
    assert computer.file("/opt/duckpilot/lane.onnx").read_bytes() == b"shipped"


def test_what_is_offered_in_the_first_configuration_can_be_taken(tmp_path: Path) -> None:
    text = (SCRIPT.parent / "robot.yaml").read_text()
    taken = tmp_path / "robot.yaml"
    taken.write_text(text.replace("# sight:", "sight:").replace("# rules:", "rules:"))
    config = load_yaml(RobotConfig, taken)
    assert (config.sight, config.rules) == ("/opt/duckpilot/sight.onnx", Rules(headway=True))


def test_groups_and_user_are_made_where_there_are_none(computer: Computer) -> None:
    computer.install()
    assert "groupadd --system video" in computer.lines
    assert "groupadd --system i2c" not in computer.lines
    made = [line for line in computer.lines if line.startswith("useradd")]
    assert made[0].endswith(f"--home-dir {STATE} --shell /usr/sbin/nologin duckpilot")
    assert "usermod --append --groups i2c,video,gpio duckpilot" in computer.lines
    owned = "install -d -m 700 -o duckpilot -g duckpilot"
    assert f"{owned} {computer.file('/etc/duckpilot/keys')}" in computer.lines


def test_a_step_that_fails_is_the_last(computer: Computer) -> None:
    computer.breaks("usermod")
    assert computer.install() == 3
    assert computer.lines[-1].startswith("usermod")


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

    config = load_yaml(RobotConfig, SCRIPT.parent / "robot.yaml")
    assert config.model == "/opt/duckpilot/lane.onnx"
    assert config.recording is not None
    assert config.recording.folder.startswith(f"{STATE}/")
    assert config.safety.max_wheel_mps < 0.3
    assert config.link is None


def test_the_unit_passes_systemds_own_check(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze on this computer")
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    text = UNIT_TEXT.replace(PYTHON, str(program))
    unit = tmp_path / UNIT
    unit.write_text(text.replace("User=duckpilot", "User=root"))
    assert complaints(unit) == []
    unit.write_text(text.replace("WatchdogSec=2", "WatchdogSec=soon"))
    assert "soon" in complaints(unit)[0]


def test_the_unit_switches_off_where_the_configuration_says() -> None:
    lines = UNIT_TEXT.splitlines()
    config = "--config /etc/duckpilot/robot.yaml"
    assert f"ExecStart={PYTHON} -m robot drive {config}" in lines
    assert "SupplementaryGroups=i2c video gpio" in lines
    assert f"ExecStopPost={PYTHON} -m robot off {config}" in lines


def complaints(unit: Path) -> List[str]:
    """What systemd says of the unit, less what it says of the computer's others."""
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    said = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return [line for line in said.stdout.decode().splitlines() if UNIT in line]


def test_only_a_checkout_can_be_installed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"pyproject\.toml"):
        make_command(tmp_path, tmp_path / "m.onnx")
    with pytest.raises(ConfigError, match="expected an ONNX policy"):
        make_command(ROOT, tmp_path / "m.onnx")


def test_the_command_shows_itself_dry(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["install", "--dry-run"]) == 0
    shown = capsys.readouterr().out
    assert shown.endswith("nothing was done\n")
    assert shown.splitlines()[0].endswith("/robot/models/lane_sight.onnx")
    assert f"systemctl enable {UNIT}" in shown


@pytest.mark.parametrize(
    ("user", "ended", "status", "said"),
    [
        (1000, 0, 2, "expected the user root"),
        (0, 1, 1, "ended with status 1; mend it"),
        (0, 0, 0, ""),
    ],
)
def test_the_script_is_run_by_root_alone_and_its_failure_is_told(
    computer: Computer,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    user: int,
    ended: int,
    status: int,
    said: str,
) -> None:
    ran: List[List[str]] = []

    def run(command: List[str], check: bool) -> SimpleNamespace:
        ran.append(command)
        return SimpleNamespace(returncode=ended)

    monkeypatch.setattr(install.os, "geteuid", lambda: user)
    monkeypatch.setattr(install.subprocess, "run", run)
    assert main(["install", "--model", str(computer.model)]) == status
    told = capsys.readouterr()
    assert said in told.err
    assert ("systemctl start" in told.out) is (status == 0), "what comes next"
    words = ["sh", str(SCRIPT), str(ROOT), sys.executable, str(computer.model)]
    assert ran == ([words] if user == 0 else [])


@pytest.mark.parametrize("path", ["/opt/duckpilot/lane.onnx", "/etc/duckpilot/robot.yaml"])
def test_what_a_full_disk_cut_off_is_written_again(computer: Computer, path: str) -> None:
    assert computer.install() == 0
    whole = computer.file(path).read_bytes()
    computer.file(path).unlink()
    half = f'case "$last" in *{Path(path).name}*) echo half > "$last"; exit 1;; esac'
    computer._program("cp", f'for last; do :; done; {half}; exec {shutil.which("cp")} "$@"')
    assert computer.install() != 0
    (computer._programs / "cp").unlink()
    assert computer.install() == 0
    assert computer.file(path).read_bytes() == whole
