"""What the robot's computer says of itself, with and without sensors."""

from __future__ import annotations

from pathlib import Path

from robot.computer.health import Health, memory_free_mb, temperatures_c
from robot.link.telemetry import Reading
from tests.robot.clocks import FakeClock


def test_zones_that_answer_are_read(tmp_path: Path) -> None:
    told = {"CPU": "41500\n", "off": "nonsense", "cold": "-256000", "GPU": "38000"}
    told["PMIC-Die"] = "100000"  # a Nano's, which always reads 100
    for number, (name, text) in enumerate(told.items()):
        zone = tmp_path / f"thermal_zone{number}"
        zone.mkdir()
        (zone / "type").write_text(f"{name}\n")
        (zone / "temp").write_text(text)
    assert temperatures_c(tmp_path) == {"CPU": 41.5, "GPU": 38.0}
    assert temperatures_c(tmp_path / "none") == {}


def test_memory_is_read_where_linux_tells(tmp_path: Path) -> None:
    (tmp_path / "meminfo").write_text("MemTotal: 4096 kB\nMemAvailable: 2048 kB\n")
    assert memory_free_mb(tmp_path / "meminfo") == 2.0
    assert memory_free_mb(tmp_path / "none") is None


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
