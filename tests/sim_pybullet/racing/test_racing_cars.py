"""Laws of the cars: they speed up, brake, and turn no more sharply than their tyres hold."""

import numpy as np
import pytest

from sim_pybullet.look import DriveLook
from sim_pybullet.racing.track import SCALE
from sim_pybullet.tasks.track_racing import (
    GRASS_GRIP_MPS2,
    GRIP_MPS2,
    RACING_ACTIONS,
    SHARPEST_PER_M,
    TOP_SPEED_MPS,
    RacingCars,
)
from tests.sim_pybullet.racing.actions import RacingAction

CALM = DriveLook(noise=0.0)


def drive(cars: RacingCars, action: RacingAction, steps: int) -> np.ndarray:
    """Speeds [m/s] and turn rates [rad/s] of car 0 in the real world, (steps, 2)."""
    rng = np.random.default_rng(0)
    actions = np.full(len(cars.speed_mps), int(action))
    twists = np.array([cars.step(actions, rng)[0] for _ in range(steps)])
    return twists / (SCALE, 1.0)


def calm_cars(count: int = 1) -> RacingCars:
    cars = RacingCars(count)
    for i in range(count):
        cars.reset(i, CALM)
    return cars


def test_who_ended_on_grass_begins_on_asphalt() -> None:
    cars = calm_cars(2)
    cars.on_grass[:] = True
    cars.reset(1, CALM)
    assert cars.on_grass.tolist() == [True, False]


def test_nine_actions_in_the_papers_order() -> None:
    assert len(RACING_ACTIONS) == len(RacingAction) == 9
    for action, (steer, throttle) in zip(RacingAction, RACING_ACTIONS, strict=True):
        assert ("LEFT" in action.name, "RIGHT" in action.name) == (steer > 0, steer < 0)
        assert ("ACC" in action.name, "BRAKE" in action.name) == (throttle > 0, throttle < 0)


def test_accelerating_nears_the_top_speed_and_braking_stops() -> None:
    cars = calm_cars()
    faster = drive(cars, RacingAction.STRAIGHT_ACCELERATE, 900)[:, 0]
    assert (np.diff(faster) > 0.0).all()
    assert 0.95 * TOP_SPEED_MPS < faster[-1] < TOP_SPEED_MPS
    rolling = drive(cars, RacingAction.STRAIGHT, 30)[:, 0]
    assert 0.9 * faster[-1] < rolling[-1] < faster[-1]
    assert drive(cars, RacingAction.STRAIGHT_BRAKE, 120)[-1, 0] == 0.0
    assert drive(cars, RacingAction.LEFT, 10)[:, 1].max() == 0.0, "a parked car does not turn"


@pytest.mark.parametrize("grass", [False, True])
def test_tyres_hold_no_more_than_their_grip(grass: bool) -> None:
    cars = calm_cars()
    cars.on_grass[:] = grass
    speed, turn = drive(cars, RacingAction.LEFT_ACCELERATE, 400).T
    most = GRASS_GRIP_MPS2 if grass else GRIP_MPS2
    assert (speed * turn <= most * 1.1 + 1e-9).all()  # one step of acceleration later
    assert (turn <= speed * SHARPEST_PER_M + 1e-9).all()
    assert (speed * turn).max() > 0.9 * most


def test_grass_slows_a_car_down() -> None:
    asphalt, grass = calm_cars(), calm_cars()
    grass.on_grass[:] = True
    on, off = (drive(c, RacingAction.STRAIGHT_ACCELERATE, 300)[-1, 0] for c in (asphalt, grass))
    assert off < 0.5 * on


def test_left_and_right_mirror_each_other_and_cars_do_not_mix() -> None:
    cars = calm_cars(2)
    actions = np.array([RacingAction.LEFT_ACCELERATE, RacingAction.RIGHT_ACCELERATE])
    for _ in range(50):
        left, right = cars.step(actions, np.random.default_rng(0))
    assert left[0] == right[0] > 0.0
    assert left[1] == -right[1] > 0.0
    cars.reset(0, CALM)
    assert cars.speed_mps[0] == 0.0 < cars.speed_mps[1]


def test_a_delay_holds_back_the_command() -> None:
    late = RacingCars(1)
    late.reset(0, DriveLook(delay_s=0.2, noise=0.0))
    speeds = drive(late, RacingAction.STRAIGHT_ACCELERATE, 12)[:, 0]
    assert (speeds[:6] == 0.0).all()
    assert speeds[-1] > 0.0


def test_a_governor_holds_a_car_at_its_speed_and_brakes_still_brake() -> None:
    cars = calm_cars()
    cars.governed_mps = 8.0
    speeds = drive(cars, RacingAction.STRAIGHT_ACCELERATE, 200)[:, 0]
    assert 7.5 < speeds[-50:].min() <= speeds.max() < 8.5
    assert drive(cars, RacingAction.STRAIGHT_BRAKE, 60)[-1, 0] == 0.0


def test_a_car_begins_at_the_speed_that_its_task_wants() -> None:
    cars = RacingCars(2)
    cars.starts_mps[:] = 5.0, 0.0
    for i in range(2):
        cars.reset(i, CALM)
    assert cars.speed_mps.tolist() == [5.0, 0.0]
    assert not cars.steering.any()
