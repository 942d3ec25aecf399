"""Laws of the motor model, and its agreement with the reference simulator's figures."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import DRIVE
from robot.geometry import Pose
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import PHYSICS_DT_S, MotorModel
from sim_pybullet.town import Town
from tests.sim_pybullet.db18 import DB18_DRIVE

EXACT = DriveLook(forward_lag_s=0.0, turn_lag_s=0.0, noise=0.0)
FULL_MPS = 0.6  # a wheel of the reference at command 1
EARLY_STEP = 39  # the command after this one acts a step early in ``mixed``: the reference's clock
TRACES = ("step_full", "step_0.3", "spin", "left_only", "mixed")


def drive(look: DriveLook, wheels: np.ndarray, seed: int = 0) -> np.ndarray:
    """Twists (T, 2) of one robot under wheel speeds (T, 2)."""
    model, rng = MotorModel(1), np.random.default_rng(seed)
    model.reset(0, look)
    return np.array([model.step(pair[None], rng)[0] for pair in wheels])


@given(left=st.floats(-0.6, 0.6), right=st.floats(-0.6, 0.6))
def test_without_lag_the_command_is_the_motion(left: float, right: float) -> None:
    forward, turn = drive(EXACT, np.array([[left, right]]))[0]
    assert forward == pytest.approx((left + right) / 2)
    assert turn == pytest.approx((right - left) / DRIVE.baseline_m)


@given(gain=st.floats(0.8, 1.2), trim=st.floats(-0.1, 0.1), turn_gain=st.floats(0.6, 1.2))
def test_steps_are_counted_without_what_they_cannot_know(
    gain: float, trim: float, turn_gain: float
) -> None:
    """Lag and delay show in the steps; gain, trim, scrub and noise do not."""
    late = DriveLook(delay_s=0.05, noise=0.0)
    worn = replace(late, gain=gain, trim=trim, turn_gain=turn_gain, noise=0.05)
    model, rng = MotorModel(1), np.random.default_rng(0)
    model.reset(0, worn)
    wheels = rng.uniform(-0.3, 0.3, (20, 2))
    counted = []
    for pair in wheels:
        model.step(pair[None], rng)
        counted.append(model.counted[0])
    np.testing.assert_allclose(counted, drive(late, wheels), atol=1e-12)


@given(seed=st.integers(0, 99), most_mps2=st.floats(0.3, 3.0))
def test_a_ramp_follows_as_fast_as_it_may_and_no_faster(seed: int, most_mps2: float) -> None:
    wheels = np.random.default_rng(seed).uniform(-0.3, 0.3, (8, 2)).repeat(5, axis=0)
    twists = drive(replace(EXACT, acceleration_mps2=most_mps2), wheels)
    turned = np.outer(twists[:, 1], (-0.5, 0.5)) * DRIVE.baseline_m
    rims = np.vstack((np.zeros((1, 2)), twists[:, :1] + turned))
    steps, wanted = np.diff(rims, axis=0), wheels - rims[:-1]
    fastest = np.sign(wanted) * np.minimum(np.abs(wanted), most_mps2 * PHYSICS_DT_S)
    np.testing.assert_allclose(steps, fastest, atol=1e-12)


def test_a_reset_robot_ramps_up_from_rest() -> None:
    model, rng = MotorModel(1), np.random.default_rng(0)
    for _ in range(2):
        model.reset(0, replace(EXACT, acceleration_mps2=0.6))
        for _ in range(9):
            twist = model.step(np.array([[0.3, 0.3]]), rng)[0]
        assert twist[0] == pytest.approx(9 * 0.6 / 30)


@pytest.mark.parametrize("lag_s", [0.02, 0.2, 1.0])
def test_a_lag_reaches_63_percent_after_its_time_constant(lag_s: float) -> None:
    model = MotorModel(1, dt_s=lag_s / 500)
    model.reset(0, replace(EXACT, forward_lag_s=lag_s))
    for _ in range(500):
        twists = model.step(np.full((1, 2), 0.3), np.random.default_rng(0))
    assert twists[0, 0] == pytest.approx(0.3 * (1 - np.exp(-1)), rel=2e-3)


@given(delay_s=st.floats(0.0, 0.5))
def test_delay_holds_back_just_the_way_driven_within_it(delay_s: float) -> None:
    forward = drive(replace(EXACT, delay_s=delay_s), np.full((30, 2), 0.3))[:, 0]
    assert forward.sum() * PHYSICS_DT_S == pytest.approx(0.3 * (30 * PHYSICS_DT_S - delay_s))
    assert not forward[: int(delay_s / PHYSICS_DT_S)].any()


def test_a_longer_delay_of_one_robot_leaves_commands_under_way_of_another() -> None:
    model, rng = MotorModel(2), np.random.default_rng(0)
    model.reset(0, replace(EXACT, delay_s=0.1))
    speeds = 0.1 * np.arange(8)
    seen = []
    for k, speed in enumerate(speeds):
        if k == 4:
            model.reset(1, replace(EXACT, delay_s=0.3))
        seen.append(model.step(np.full((2, 2), speed), rng)[0, 0])
    np.testing.assert_allclose(seen[3:], speeds[:-3])


def test_trim_turns_to_the_left_and_gain_scales() -> None:
    forward, turn = drive(replace(EXACT, trim=0.05, gain=0.9), np.full((1, 2), 0.3))[0]
    assert forward == pytest.approx(0.27)
    assert turn == pytest.approx(2 * 0.05 * 0.3 / DRIVE.baseline_m)


def test_reset_forgets_speed_and_commands_under_way() -> None:
    model, rng = MotorModel(1), np.random.default_rng(0)
    model.reset(0, DB18_DRIVE)
    for _ in range(20):
        model.step(np.full((1, 2), 0.6), rng)
    assert model.twists[0, 0] > 0.4
    model.reset(0, DB18_DRIVE)
    assert not any(model.step(np.zeros((1, 2)), rng).any() for _ in range(10))


def test_reset_forgets_what_was_counted() -> None:
    """A robot that is put down stands: its odometry begins with no speed left over."""
    model, rng = MotorModel(2), np.random.default_rng(0)
    for _ in range(200):
        model.step(np.full((2, 2), 0.3), rng)
    model.reset(0, DriveLook())
    np.testing.assert_array_equal(model.counted[0], 0.0)
    assert model.counted[1, 0] == pytest.approx(0.3, abs=1e-3)


def test_noise_is_seeded_and_unbiased() -> None:
    look, wheels = replace(EXACT, noise=0.1), np.full((4000, 2), 0.3)
    twists = drive(look, wheels, seed=1)
    np.testing.assert_array_equal(twists, drive(look, wheels, seed=1))
    assert not np.array_equal(twists, drive(look, wheels, seed=2))
    assert twists[:, 0].mean() == pytest.approx(0.3, abs=0.002)
    assert twists[:, 0].std() == pytest.approx(0.03 / np.sqrt(2), rel=0.1)


def reference(data_dir: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wheel speeds (T, 2) [m/s] and the poses (T, 3) that the reference simulator makes of them."""
    traces = json.loads((data_dir / "oracle" / "dynamics_db18_nominal.json").read_text())["traces"]
    trace = traces[name]
    wheels = FULL_MPS * np.array(trace["actions_left_right"], dtype=float)
    if name == "mixed":
        wheels[EARLY_STEP] = wheels[EARLY_STEP + 1]
    return wheels, np.array(trace["x_y_theta_v_omega"])[:, :3]


@pytest.mark.parametrize("name", TRACES)
def test_follows_the_reference_simulator(data_dir: Path, name: str) -> None:
    wheels, expected = reference(data_dir, name)
    pose, poses = Pose(0.0, 0.0, 0.0), []
    for forward, turn in drive(DB18_DRIVE, wheels):
        pose = pose.moved(forward * PHYSICS_DT_S, turn * PHYSICS_DT_S)
        poses.append(pose)
    assert np.hypot(*(np.array(poses) - expected)[:, :2].T).max() < 0.001


@pytest.mark.parametrize("name", TRACES)
def test_a_planar_town_follows_it_too(data_dir: Path, name: str) -> None:
    wheels, expected = reference(data_dir, name)
    town, poses = Town([()], 1), []
    for twist in drive(DB18_DRIVE, wheels):
        town.step(twist[None])
        poses.append(town.poses[0])
    town.close()
    assert np.hypot(*(np.array(poses) - expected)[:, :2].T).max() < 0.001
