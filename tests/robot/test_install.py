"""Installation on a computer made of a folder, which objects to what a real one would refuse."""

from __future__ import annotations

import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Dict, List, Sequence, Set

import pytest

from robot.cli import main
from robot.computer.footprint import ROOT
from robot.errors import ConfigError, HardwareError
from robot.install import files
from robot.install.changes import KEPT, Change, at
from robot.install.files import config_text, unit_text
from robot.install.plan import Source, install, make_plan, uninstall
from tests.robot.tiny_onnx import lane_contract, write_policy


class FolderHost:
    """Carries the commands of an installation out below ``root``."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.users: Set[str] = set()
        self.groups: Dict[str, List[str]] = {"i2c": [], "video": ["somebody"]}
        self.ran: List[str] = []
        self.failing = ""
        for path in ("/var/lib", "/etc/udev/rules.d", "/etc/systemd/system", "/opt"):
            at(self, path).mkdir(parents=True)

    def run(self, command: Sequence[str]) -> None:
        self.ran.append(" ".join(command))
        if self.failing and self.failing in self.ran[-1]:
            raise HardwareError(f"{self.ran[-1]}: ended with status 1")
        program = {"groupadd": self._groupadd, "useradd": self._useradd, "gpasswd": self._gpasswd}
        program.update(install=self._install, systemctl=self._systemctl, rmdir=self._rmdir)
        program.update(rm=self._rm, groupdel=self._groupdel, userdel=self._userdel)
        program.get(command[0], self._other)(list(command))

    def has_user(self, name: str) -> bool:
        return name in self.users

    def has_group(self, name: str) -> bool:
        return name in self.groups

    def members(self, group: str) -> List[str]:
        return list(self.groups.get(group, []))

    def files(self) -> Dict[str, bytes]:
        found = [path for path in self.root.rglob("*") if path.is_file()]
        return {str(path.relative_to(self.root)): path.read_bytes() for path in found}

    def _groupadd(self, command: List[str]) -> None:
        assert command[-1] not in self.groups
        self.groups[command[-1]] = []

    def _groupdel(self, command: List[str]) -> None:
        del self.groups[command[-1]]

    def _useradd(self, command: List[str]) -> None:
        assert command[-1] not in self.users
        self.users.add(command[-1])

    def _userdel(self, command: List[str]) -> None:
        self.users.remove(command[-1])

    def _gpasswd(self, command: List[str]) -> None:
        action, user, group = command[1:]
        assert user in self.users
        if action == "--add":
            self.groups[group].append(user)
        else:
            self.groups[group].remove(user)

    def _install(self, command: List[str]) -> None:
        owner = command[command.index("-o") + 1]
        assert owner == "root" or owner in self.users
        at(self, command[-1]).mkdir(parents=True)

    def _rmdir(self, command: List[str]) -> None:
        path = at(self, command[-1])
        if not any(path.iterdir()):
            path.rmdir()

    def _rm(self, command: List[str]) -> None:
        shutil.rmtree(at(self, command[-1]))

    def _systemctl(self, command: List[str]) -> None:
        wants = at(self, "/etc/systemd/system/multi-user.target.wants")
        if command[1] == "enable":
            assert at(self, files.UNIT_FILE).is_file()
            wants.mkdir(exist_ok=True)
            (wants / command[-1]).touch()
        elif command[1] == "disable":
            (wants / command[-1]).unlink()
            wants.rmdir()

    def _other(self, command: List[str]) -> None:
        if command[1:3] == ["-m", "venv"]:
            at(self, command[3]).mkdir(parents=True, exist_ok=True)
        elif command[1:4] == ["-I", "-m", "pip"]:
            assert at(self, command[0]).parents[1].is_dir(), "pip before the environment"
        else:
            assert command[0] == "udevadm"


@pytest.fixture
def host(tmp_path: Path) -> FolderHost:
    return FolderHost(tmp_path / "root")


@pytest.fixture
def plan(tmp_path: Path) -> List[Change]:
    checkout = tmp_path / "checkout"
    (checkout / "robot").mkdir(parents=True)
    (checkout / "robot" / "__init__.py").write_text("")
    (checkout / "pyproject.toml").write_text("")
    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    return make_plan(Source(checkout, "/usr/bin/python3.8", model))


def silent(_line: str) -> None:
    pass


def test_a_dry_run_changes_nothing_and_tells_every_file_and_command(
    host: FolderHost, plan: List[Change]
) -> None:
    before, lines = host.files(), []  # type: ignore[var-annotated]
    count = install(plan, host, lines.append, dry=True)
    assert (host.files(), host.ran) == (before, [])
    assert count == len([change for change in plan if change.needed(host)])
    install(plan, host, silent, dry=False)
    assert [f"would run: {command}" for command in host.ran] == [
        line for line in lines if line.startswith("would run: ")
    ]
    told = [line.split()[2].rstrip(":") for line in lines if line.startswith("would write ")]
    assert {f"/{name}" for name in host.files()} - {files.MANIFEST} == {
        *told,
        f"/etc/systemd/system/multi-user.target.wants/{files.UNIT}",
    }


def test_a_second_time_there_is_nothing_to_do(host: FolderHost, plan: List[Change]) -> None:
    assert install(plan, host, silent, dry=False) > 10
    after, host.ran = host.files(), []
    assert install(plan, host, silent, dry=False) == 0
    assert (host.files(), host.ran) == (after, [])


def test_undoing_restores_what_was_there(host: FolderHost, plan: List[Change]) -> None:
    at(host, files.UDEV_RULE).write_text("# somebody's own\n")
    before, groups = host.files(), {name: list(users) for name, users in host.groups.items()}
    install(plan, host, silent, dry=False)
    assert at(host, files.UDEV_RULE + KEPT).read_text() == "# somebody's own\n"
    assert host.groups["i2c"] == [files.USER]
    assert uninstall(plan, host, silent, dry=True) > 10
    uninstall(plan, host, silent, dry=False)
    assert (host.files(), host.groups, host.users) == (before, groups, set())
    assert not at(host, files.PREFIX).exists()
    assert uninstall(plan, host, silent, dry=False) == 0


def test_what_a_person_edited_or_made_stays(host: FolderHost, plan: List[Change]) -> None:
    install(plan, host, silent, dry=False)
    at(host, files.CONFIG).write_text("model: mine.onnx\n")
    (at(host, files.KEYS) / "robot").mkdir()
    assert install(plan, host, silent, dry=False) == 0
    uninstall(plan, host, silent, dry=False)
    assert at(host, files.CONFIG).read_text() == "model: mine.onnx\n"
    assert (at(host, files.KEYS) / "robot").is_dir()


@pytest.mark.parametrize("failing", ["pip", "udevadm", "daemon-reload", "enable", "useradd"])
def test_after_a_failure_it_goes_on_where_it_stopped(
    host: FolderHost, plan: List[Change], failing: str
) -> None:
    before = host.files()
    host.failing = failing
    with pytest.raises(HardwareError, match=failing):
        install(plan, host, silent, dry=False)
    host.failing, host.ran = "", []
    install(plan, host, silent, dry=False)
    assert any(failing in command for command in host.ran)
    uninstall(plan, host, silent, dry=False)
    assert host.files() == before
    assert host.groups == {"i2c": [], "video": ["somebody"]}


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


def test_the_first_configuration_is_valid(tmp_path: Path) -> None:
    from robot.config import RobotConfig
    from robot.typed_config import load_yaml

    (tmp_path / "robot.yaml").write_text(config_text("lane.onnx"))
    config = load_yaml(RobotConfig, tmp_path / "robot.yaml")
    assert config.safety.max_wheel_mps < 0.3
    assert config.link is None


def test_the_unit_passes_systemds_own_check(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze on this computer")
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    text = unit_text("i2c video").replace(f"{files.VENV}/bin/python", str(program))
    unit = tmp_path / files.UNIT
    unit.write_text(text.replace(f"User={files.USER}", "User=root"))
    assert complaints(unit) == []
    unit.write_text(text.replace("WatchdogSec=2", "WatchdogSec=soon"))
    assert "soon" in complaints(unit)[0]


def test_the_unit_switches_off_where_the_configuration_says() -> None:
    lines = unit_text("i2c").splitlines()
    config = "--config /etc/duckpilot/robot.yaml"
    assert f"ExecStart=/opt/duckpilot/venv/bin/python -m robot drive {config}" in lines
    assert f"ExecStopPost=/opt/duckpilot/venv/bin/python -m robot off {config}" in lines


def complaints(unit: Path) -> List[str]:
    """What systemd says of the unit, less what it says of the computer's others."""
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    said = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return [line for line in said.stdout.decode().splitlines() if files.UNIT in line]


def test_only_a_checkout_can_be_installed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"pyproject\.toml"):
        make_plan(Source(tmp_path, sys.executable, tmp_path / "m.onnx"))
    with pytest.raises(ConfigError, match="expected an ONNX policy"):
        make_plan(Source(ROOT, sys.executable, tmp_path / "m.onnx"))


def test_the_commands_show_themselves_dry(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("install", "uninstall"):
        assert main([command, "--dry-run"]) == 0
        assert capsys.readouterr().out.endswith("changes; nothing was done\n")
