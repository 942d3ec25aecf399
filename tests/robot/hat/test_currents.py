"""What flows in the windings, by an emulator that knows bridges and wiring from their sheets."""

from __future__ import annotations

import itertools
import math
from typing import List, Tuple

import pytest

from robot.hat import stepper_hat
from robot.hat.config import HatConfig
from sim_pybullet.virtual.rotor import Rotor, RotorModel
from tests.robot.hat.rig import Rig, full_step_m, make_rig
from tests.thorough import count

TIME_CONSTANTS_S = (0.3e-3, 1e-3, 3e-3)  # L / R of motors of this class
MICROSTEPS = (1, 2, 4, 8, 16)


def fine_rig(microsteps: int, time_constant_s: float, run_duty: float = 1.0) -> Rig:
    config = HatConfig(
        microsteps=microsteps,
        run_duty=run_duty,
        hold_duty=0.3 * run_duty,
        bus_hz=1_000_000,
        max_speed_mps=0.1,
    )
    return make_rig(config, RotorModel(time_constant_s=time_constant_s))


def shares_of_an_octant(microsteps: int) -> List[float]:
    """The weaker winding's current at each position, as a share of the stronger one's."""
    offset = 0.5 if microsteps == 1 else 0.0
    angles = [0.5 * math.pi * (k + offset) / microsteps for k in range(4 * microsteps)]
    weaker = (min(abs(math.cos(a)), abs(math.sin(a))) for a in angles)
    return [w / math.sqrt(1.0 - w * w) for w in weaker]


def settled(rotor: Rotor) -> Tuple[float, float]:
    """Where the currents of both windings settle."""
    first, second = rotor.drives
    return first.current, second.current


def record(rig: Rig) -> List[List[Tuple[float, float]]]:
    """The mean currents of both motors' windings after every change, from now on."""
    seen: List[List[Tuple[float, float]]] = [[], []]
    drive_coils = rig.hat.chip._after_change

    def watch() -> None:
        drive_coils()
        for currents, rotor in zip(seen, rig.hat.rotors):
            now = settled(rotor)
            if any(now) and currents[-1:] != [now]:
                currents.append(now)

    rig.hat.chip._after_change = watch
    return seen


@pytest.mark.parametrize("time_constant_s", TIME_CONSTANTS_S)
@pytest.mark.parametrize("run_duty", [0.1, 0.3, 0.5, 0.8, 1.0][:: count(2, 1)])
def test_the_current_is_the_duty_of_what_the_supply_would_drive(
    run_duty: float, time_constant_s: float
) -> None:
    """At least 0.8 of duty * V / R, while stepping and while holding, in every winding in use."""
    rig = fine_rig(16, time_constant_s, run_duty)
    with rig.driver:
        rig.drive(0.02, 0.02, 0.6)
        seen = record(rig)
        rig.drive(0.02, 0.02, 1.0)
        shares = shares_of_an_octant(16)
        for currents in seen:
            assert len(currents) > 60, "most of a turn of the field"
            for a, b in currents:
                stronger, weaker = max(abs(a), abs(b)), min(abs(a), abs(b))
                assert 0.8 * run_duty <= stronger <= 1.01 * run_duty
                meant = min(shares, key=lambda share: abs(share * run_duty - weaker)) * run_duty
                assert weaker >= 0.8 * meant
        rig.come_to_rest()
        assert min(rig.rolled_m) > 0.0
        for rotor in rig.hat.rotors:
            assert max(map(abs, settled(rotor))) >= 0.8 * 0.3 * run_duty
            assert rotor.currents == pytest.approx(settled(rotor), abs=1e-3)


@pytest.mark.parametrize("time_constant_s", TIME_CONSTANTS_S)
@pytest.mark.parametrize("run_duty", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("microsteps", MICROSTEPS[:: count(2, 1)])
def test_every_microstep_turns_the_field_by_its_angle(
    microsteps: int, run_duty: float, time_constant_s: float
) -> None:
    """Each lies within a tenth of a microstep of where it belongs, so that errors never add up."""
    rig = fine_rig(microsteps, time_constant_s, run_duty)
    with rig.driver:
        rig.drive(0.03, 0.03, 0.6)
        seen = record(rig)
        rig.drive(0.03, 0.03, 2.0)
        for currents, way in zip(seen, (1, -1)):  # the right motor is mounted as a mirror image
            off, turns = places(currents, microsteps)
            assert len(turns) > 2 * microsteps, "most of a turn of the field"
            assert max(off) < 0.1
            assert set(turns) == {way % (4 * microsteps)}, "one at a time, and none left out"


def places(currents: List[Tuple[float, float]], microsteps: int) -> Tuple[List[float], List[int]]:
    """How far each field is from the next microstep, and from each to the next [microsteps]."""
    angles = [math.atan2(b, a) / (0.5 * math.pi / microsteps) for a, b in currents]
    found = [angle - (0.5 if microsteps == 1 else 0.0) for angle in angles]
    turns = [(round(b) - round(a)) % (4 * microsteps) for a, b in zip(found, found[1:])]
    return [abs(place - round(place)) for place in found], turns


def exchanged(port: Tuple[int, ...], first: int, second: int) -> Tuple[int, ...]:
    pins = list(port)
    pins[first], pins[second] = pins[second], pins[first]
    return tuple(pins)


def follows(rig: Rig) -> bool:
    """Whether both wheels roll as the driver counts, by microsteps that are where they belong."""
    with rig.driver:
        rig.drive(0.04, -0.02, 0.6)
        seen = record(rig)
        rig.drive(0.04, -0.02, 2.0)
        off, turns = places(seen[0], rig.driver.config.microsteps)
        rig.come_to_rest()
        due_m = [n * rig.driver.config.step_m for n in rig.driver.planner.counts]
        near = all(
            abs(rolled_m - m) < 2.0 * full_step_m(rig.driver.config)
            for rolled_m, m in zip(rig.rolled_m, due_m)
        )
    return near and max(off) < 0.1 and set(turns) == {1}


def quarter_rig() -> Rig:
    return make_rig(HatConfig(microsteps=4, bus_hz=400_000, max_speed_mps=0.1))


def test_the_emulator_follows_the_right_wiring() -> None:
    assert follows(quarter_rig())


@pytest.mark.parametrize(("first", "second"), [*itertools.combinations(range(6), 2)])
def test_exchanged_pins_show(monkeypatch: pytest.MonkeyPatch, first: int, second: int) -> None:
    ports = dict(stepper_hat.PORTS)
    ports["M1M2"] = exchanged(ports["M1M2"], first, second)
    monkeypatch.setattr(stepper_hat, "PORTS", ports)
    assert not follows(quarter_rig())


def test_exchanged_motors_show(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = stepper_hat.PORTS["M1M2"], stepper_hat.PORTS["M3M4"]
    monkeypatch.setattr(stepper_hat, "PORTS", {"M1M2": right, "M3M4": left})
    assert not follows(quarter_rig())


def test_a_rotor_of_every_time_constant_keeps_up_with_the_fastest_driving() -> None:
    for time_constant_s in TIME_CONSTANTS_S:
        rig = make_rig(model=RotorModel(time_constant_s=time_constant_s))
        with rig.driver:
            rig.drive(0.4, 0.4, 3.0)
            assert rig.hat.lost_steps == (0, 0), time_constant_s


def test_a_motor_at_its_rated_share_of_the_supply_turns() -> None:
    """A 6 V motor on 12 V: half the duty is the full torque that it is rated for."""
    rated = RotorModel(holding_torque_nm=2 * RotorModel().holding_torque_nm)
    rig = make_rig(HatConfig(run_duty=0.5, hold_duty=0.2), rated)
    with rig.driver:
        rig.drive(0.3, 0.3, 3.0)
        assert rig.hat.lost_steps == (0, 0)
        assert min(rig.rolled_m) > 0.5
