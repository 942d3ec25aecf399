import math
from dataclasses import replace

import numpy as np
import pytest

from robot.contract import ACTION_WHEELS
from robot.geometry import Pose
from sim_pybullet.look import NOMINAL
from sim_pybullet.motors import MotorModel
from sim_pybullet.town import Town
from sim_pybullet.virtual.world import RolledWheels, beyond_nominal
from tests.robot.hat.rig import make_rig
from tests.trainer.judge_twin import as_bench_drives

DT_S = 1 / 60


@pytest.mark.parametrize(("drive", "off_m"), [("planar", 0.03), ("wheels", 0.05)])
def test_the_town_goes_where_the_step_odometry_says(drive: str, off_m: float) -> None:
    rig = make_rig()
    town = Town([[]], 1, drive=drive, dt_s=DT_S)  # type: ignore[arg-type]
    rolled, rng = RolledWheels(rig.hat, rig.clock), np.random.default_rng(0)
    tyres = MotorModel(1, DT_S)
    tyres.reset(0, beyond_nominal(NOMINAL.drive))
    with rig.driver:
        for action in (2, 1, 2, 4, 3):
            for _ in range(60):
                rig.drive(*ACTION_WHEELS[action], DT_S)
                town.step(tyres.step(rolled.since_last()[None], rng))
        for _ in range(60):
            rig.drive(0.0, 0.0, DT_S)
            town.step(tyres.step(rolled.since_last()[None], rng))
        expected = rig.driver.pose
    pose = Pose(*town.poses[0])
    town.close()
    assert math.hypot(expected.x_m, expected.y_m) > 0.5
    assert math.hypot(pose.x_m - expected.x_m, pose.y_m - expected.y_m) < off_m
    assert abs(math.remainder(pose.heading_rad - expected.heading_rad, 2 * math.pi)) < 4 * off_m


@pytest.mark.parametrize("lag_s", [0.08, 0.19])
def test_the_motor_model_turns_as_the_robots_own_ramp_lets_it(lag_s: float) -> None:
    """Five actions at random for 20 s; a lag without a ramp cannot tell where the robot heads."""
    look = replace(NOMINAL, drive=replace(NOMINAL.drive, forward_lag_s=lag_s, turn_lag_s=lag_s))
    rig, rng = make_rig(), np.random.default_rng(1)
    rolled, headings = RolledWheels(rig.hat, rig.clock), [np.zeros(3)]
    own, ramped, lagging = MotorModel(1, DT_S), MotorModel(1, DT_S), MotorModel(1, DT_S)
    own.reset(0, beyond_nominal(look.drive))
    ramped.reset(0, replace(as_bench_drives(look, 0.8, 0.0).drive, noise=0.0))
    lagged = {"forward_lag_s": lag_s + 0.02, "turn_lag_s": lag_s + 0.02, "delay_s": 0.08}
    lagging.reset(0, replace(NOMINAL.drive, noise=0.0, **lagged))
    with rig.driver:
        for action in [2, 2, *rng.integers(5, size=65)]:
            for _ in range(18):
                rig.drive(*ACTION_WHEELS[action], DT_S)
                wheels = np.array([ACTION_WHEELS[action]])
                asked = rolled.since_last()[None], wheels, wheels
                each = zip((own, ramped, lagging), asked, strict=True)
                turns = [model.step(speeds, rng)[0, 1] * DT_S for model, speeds in each]
                headings.append(headings[-1] + turns)
    truth, with_ramp, with_lag = np.array(headings)[60:].T
    assert np.std(truth) > 0.5
    assert np.std(with_ramp - truth) < 0.05
    assert np.std(with_lag - truth) > 0.15


def test_no_time_is_no_motion() -> None:
    rig = make_rig()
    assert RolledWheels(rig.hat, rig.clock).since_last().tolist() == [0.0, 0.0]
