"""What the robot's computer says of itself, with and without sensors."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from robot.computer.health import Health, memory_free_mb, readings, temperatures_c
from robot.link.messages import Reading
from tests.robot.clocks import FakeClock


def test_zones_that_answer_are_read(tmp_path: Path) -> None:
    told = {"CPU": "41500\n", "off": "nonsense", "cold": "-256000", "hot": "200000", "GPU": "38000"}
    told["PMIC-Die"] = "100000"  # a Nano's, which always reads 100
    for number, (name, text) in enumerate(told.items()):
        zone = tmp_path / f"thermal_zone{number}"
        zone.mkdir()
        (zone / "type").write_text(f"{name}\n")
        (zone / "temp").write_text(text)
    (tmp_path / "thermal_zone9" / "temp").mkdir(parents=True)
    (tmp_path / "thermal_zone9" / "type").write_text("cannot be read\n")
    assert temperatures_c(tmp_path) == {"CPU": 41.5, "GPU": 38.0}
    assert temperatures_c(tmp_path / "none") == {}


def test_memory_is_read_where_linux_tells(tmp_path: Path) -> None:
    (tmp_path / "meminfo").write_text("MemTotal: 4096 kB\nMemAvailable: 2048 kB\n")
    assert memory_free_mb(tmp_path / "meminfo") == 2.0
    assert memory_free_mb(tmp_path / "none") is None
    (tmp_path / "meminfo").write_text("MemTotal: 4096 kB\n")
    assert memory_free_mb(tmp_path / "meminfo") is None, "an old kernel"


@pytest.mark.parametrize(
    ("free_mb", "level"),
    [(9000.0, "ok"), (400.0, "warn"), (201.0, "warn"), (199.0, "bad"), (0.0, "bad")],
)
def test_the_disk_of_the_folder_asked_for_is_judged(
    free_mb: float, level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = SimpleNamespace(total=10_000 * 10**6, free=free_mb * 1e6)
    other = SimpleNamespace(total=100, free=100)
    monkeypatch.setattr("shutil.disk_usage", lambda at: disk if Path(at) == tmp_path else other)
    found = {each.name: each for each in readings(tmp_path / "not" / "yet")}
    assert found["disk free"] == Reading("disk free", round(free_mb / 100), "%", level)


@pytest.mark.parametrize(
    ("hottest_c", "level"), [(79.9, "ok"), (80.0, "warn"), (94.9, "warn"), (95.0, "bad")]
)
def test_the_hottest_sensor_is_judged(
    hottest_c: float, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    zones = {"CPU": hottest_c, "GPU": 30.0}
    monkeypatch.setattr("robot.computer.health.temperatures_c", lambda: zones)
    assert next(readings()) == Reading("temperature", hottest_c, "°C", level)


@pytest.mark.parametrize(("free_mb", "level"), [(201.0, "ok"), (200.0, "warn")])
def test_little_memory_is_a_warning(
    free_mb: float, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot.computer.health.memory_free_mb", lambda: free_mb)
    found = {each.name: each for each in readings()}
    assert found["memory free"] == Reading("memory free", free_mb, "MB", level)


def test_what_cannot_be_measured_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot.computer.health.temperatures_c", dict)
    monkeypatch.setattr("robot.computer.health.memory_free_mb", lambda: None)
    monkeypatch.setattr("os.getloadavg", lambda: (1.234, 8.0, 9.0))
    disk, *others = readings()
    assert (disk.name, others) == ("disk free", [Reading("load", 1.23)])


def test_a_recorder_wants_more_of_the_disk(tmp_path: Path) -> None:
    told = [each for each in readings(tmp_path, least_mb=1e12) if each.name == "disk free"]
    assert [each.level for each in told] == ["bad"]


def test_sensors_are_read_once_a_second() -> None:
    clock, count = FakeClock(), [0]

    def reading() -> Reading:
        count[0] += 1
        return Reading("count", float(count[0]))

    health = Health(clock, (reading,))
    for _ in range(30):
        clock.now_s += 0.1
        last = health.readings()[-1]
    assert 2 <= last.value <= 4
    assert {"disk free", "load"} <= {one.name for one in health.readings()}
