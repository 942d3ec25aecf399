import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_pybullet.virtual.rotor import RELEASED, CoilDrive, Rotor, RotorModel

FREE = RotorModel(friction_nm=0.0, damping_nms=0.0)
DAMPED = RotorModel(damping_nms=0.02)


def field(rotor: Rotor, angle_rad: float, level: float = 1.0) -> None:
    phases = (level * math.cos(angle_rad), level * math.sin(angle_rad))
    rotor.drive(*(CoilDrive(current, 1.0) for current in phases))


@given(st.floats(-3.0, 3.0))
def test_rotor_comes_to_rest_at_the_field(angle_rad: float) -> None:
    rotor = Rotor(DAMPED)
    field(rotor, angle_rad)
    rotor.advance(2.0)
    dead_band = DAMPED.friction_nm / DAMPED.holding_torque_nm
    assert rotor.angle_rad * 12 == pytest.approx(angle_rad, abs=2 * dead_band)
    assert rotor.lost_steps == 0


def test_energy_is_kept_without_friction_and_damping() -> None:
    rotor = Rotor(FREE, angle_rad=0.1)
    field(rotor, 0.0)

    def energy_j() -> float:
        potential = -FREE.holding_torque_nm / 12 * math.cos(12 * rotor.angle_rad)
        return 0.5 * FREE.inertia_kgm2 * rotor.speed_radps**2 + potential

    start, swing = energy_j(), 2 * FREE.holding_torque_nm / 12
    for _ in range(500):
        rotor.advance(0.01)
        assert abs(energy_j() - start) < 0.01 * swing


def test_frequency_of_small_oscillations() -> None:
    rotor = Rotor(FREE, angle_rad=0.002)
    field(rotor, 0.0)
    period_s = 2 * math.pi / math.sqrt(12 * FREE.holding_torque_nm / FREE.inertia_kgm2)
    rotor.advance(10 * period_s)
    assert rotor.angle_rad == pytest.approx(0.002, rel=0.03)


def test_load_beyond_the_holding_torque_costs_whole_electrical_turns() -> None:
    rotor = Rotor(DAMPED)
    field(rotor, 0.0)
    rotor.load_nm = -0.9 * DAMPED.holding_torque_nm
    rotor.advance(1.0)
    assert rotor.lost_steps == 0
    rotor.load_nm = -1.3 * DAMPED.holding_torque_nm
    rotor.advance(1.0)
    assert rotor.lost_steps > 0
    assert rotor.lost_steps % 4 == 0


def test_a_field_far_too_fast_leaves_the_rotor_behind() -> None:
    rotor = Rotor(RotorModel())
    for i in range(400):
        field(rotor, i * math.pi / 2)
        rotor.advance(1 / 400)
    assert rotor.lost_steps > 100


def test_released_rotor_turns_freely_and_is_taken_up_where_it_is() -> None:
    rotor = Rotor(RotorModel())
    field(rotor, 0.0)
    rotor.drive(RELEASED, RELEASED)
    rotor.angle_rad += 2.0
    assert rotor.lost_steps == 0
    field(rotor, 0.0)
    assert rotor.lost_steps == 0


def test_currents_follow_by_the_time_constant_and_are_gone_soon_after_a_release() -> None:
    rotor = Rotor(RotorModel(time_constant_s=2e-3))
    rotor.drive(CoilDrive(1.0, 1.0), CoilDrive(-0.5, 1.0))
    rotor.advance(2e-3)
    assert rotor.currents == pytest.approx((1 - math.exp(-1), -0.5 * (1 - math.exp(-1))))
    rotor.advance(0.1)
    assert rotor.currents == pytest.approx((1.0, -0.5))
    rotor.drive(RELEASED, RELEASED)
    rotor.advance(1.2e-3)  # full current is gone after ln 2 of the time constant
    assert rotor.currents[0] > 0.0
    rotor.advance(0.3e-3)
    assert rotor.currents == (0.0, 0.0)
