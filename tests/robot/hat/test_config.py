from pathlib import Path

import pytest
import yaml

from robot.contract import MAX_WHEEL_MPS
from robot.errors import ConfigError
from robot.hat.config import PORTS, HatConfig
from robot.typed_config import from_plain, to_plain


def test_defaults_drive_every_action_and_survive_yaml() -> None:
    config = HatConfig()
    assert config.max_speed_mps >= MAX_WHEEL_MPS
    assert from_plain(HatConfig, to_plain(config)) == config


def test_the_ports_are_those_of_the_schematic() -> None:
    """Adafruit 2348 and its copies: PWMA, AIN2, AIN1, BIN1, BIN2, PWMB."""
    assert PORTS == {"M1M2": (8, 9, 10, 11, 12, 13), "M3M4": (2, 3, 4, 5, 6, 7)}


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        ({"step_per_rev": 48}, "did you mean 'steps_per_rev'"),
        ({"left": {"port": "M1M3"}}, "did you mean 'M1M2'"),
        ({"right": {"port": "M1M2"}}, "another port than left's M1M2"),
        ({"microsteps": 3}, "expected one of"),
        ({"hold_duty": 1.0}, "0 <= hold < run_duty"),
        ({"run_duty": 1.2}, "0 < run_duty <= 1"),
        ({"start_stop_mps": 0.5}, "start_stop_mps: expected <= maximum"),
        ({"acceleration_mps2": 0.0}, "acceleration_mps2: expected 1e-06 to 100.0 in the unit"),
        ({"acceleration_mps2": 800.0}, "acceleration_mps2: expected 1e-06 to 100.0 in the unit"),
        ({"acceleration_mps2": float("nan")}, "expected float, got nan"),
        ({"drive": {"wheel_radius_m": 0.0}}, "wheel_radius_m: expected 0.005 to 1.0 in the unit"),
        ({"drive": {"wheel_radius_m": -0.0325}}, "wheel_radius_m: expected 0.005 to 1.0"),
        ({"drive": {"wheel_radius_m": 3.25}}, "that the name ends with, got 3.25"),
        ({"drive": {"baseline_m": 0.0}}, "baseline_m: expected 0.005 to 1.0 in the unit"),
        ({"drive": {"baseline_m": 11.8}}, "baseline_m: expected 0.005 to 1.0 in the unit"),
        ({"steps_per_rev": 7.5}, "steps_per_rev: expected 12.0 to 20000.0"),
        ({"release_after_s": 60_000}, "release_after_s: expected 1e-06 to 3600.0"),
        ({"bus_hz": 100}, "bus_hz: expected 10000.0 to 1000000.0 in the unit"),
        ({"addresses": [0x3F]}, "sold as 0x6F or 0x60"),
        ({"addresses": [0x70]}, "not 0x70"),
        ({"addresses": []}, "at least one address"),
        ({"bus": -1}, "the number of /dev/i2c"),
        ({"bus_hz": 3_400_000}, "bus_hz: expected 10000.0 to 1000000.0"),
        ({"microsteps": 4}, "376 updates per second, a bus of 100 kHz carries 154"),
        ({"hold_after_s": 90.0}, "<= release"),
        ({"left": {"port": "M1M2", "gain": 1.2}}, "motor gain: expected 0.91 to 1.10, got 1.2"),
    ],
)
def test_wrong_settings_are_refused_with_what_would_be_right(plain: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("(", r"\(")):
        from_plain(HatConfig, plain)


def test_a_faster_bus_carries_more_microsteps() -> None:
    assert HatConfig(microsteps=4, bus_hz=400_000).step_m == pytest.approx(0.00106, rel=0.01)


def test_the_settings_in_the_wiring_guide_are_the_defaults() -> None:
    guide = (Path(__file__).parents[3] / "docs" / "wiring.md").read_text(encoding="utf-8")
    text = guide.split("```yaml\n")[1].split("```")[0]
    assert from_plain(HatConfig, yaml.safe_load(text)) == HatConfig()
