"""The figures of an evaluation, by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim_pybullet.drive_metrics import DriveMetrics
from sim_pybullet.tasks.base import TaskStep
from sim_pybullet.tasks.following import Course
from trainer.judging.drive_log import Tracer, _end, _Ride
from trainer.judging.evaluate import Drive, summarise, wilson_low
from trainer.options import EvaluateOptions

DRIVES = [
    Drive(7, True, DriveMetrics(10.0, 30.0, 0.6, 0.0, 0.02), failed=False, laps=2.0),
    Drive(8, False, DriveMetrics(2.0, 8.0, 0.4, 0.5, 0.05), failed=True, laps=0.5, collided=True),
    Drive(9, False, DriveMetrics(6.0, 40.0, 0.2, 0.1, 0.005), failed=True, laps=1.0),
    Drive(10, True, DriveMetrics(12.0, 42.0, 1.2, 0.2, 0.03), failed=False, laps=2.5),
]
POLICY: Any = SimpleNamespace(contract=SimpleNamespace(algorithm="ppo", run="abc"))


def test_the_figures_of_four_drives() -> None:
    inputs = EvaluateOptions("m.onnx", "lane", ("loop",), episodes=4, seed=7)
    found = summarise(inputs, POLICY, DRIVES)
    assert (found.episodes, found.success_rate, found.failures) == (4, 0.5, (8, 9))
    assert (found.collisions, found.failed_ends) == (1, 2)
    assert found.mean_path_distance_m == pytest.approx(2.4 / 120.0)
    assert found.survival_time_s == pytest.approx(30.0)
    assert found.driven_lane_m == pytest.approx(7.5)
    assert found.outside_lane_s == pytest.approx(0.2)
    assert found.laps == pytest.approx(1.5)
    assert found.mean_speed_mps == pytest.approx(30.0 / 120.0)
    assert (found.algorithm, found.run, found.schema) == ("ppo", "abc", 1)
    assert found.success_rate_low == pytest.approx(0.1500, abs=1e-4)  # of 2 in 4, from a table


def test_a_race_cars_speed_is_that_on_the_real_track() -> None:
    inputs = EvaluateOptions("m.onnx", "track", ("forest",), episodes=4, seed=7)
    without = [drive._replace(laps=None) for drive in DRIVES]
    found = summarise(inputs, POLICY, without)
    assert found.laps is None
    assert found.mean_speed_mps == pytest.approx(20.0 * 30.0 / 120.0)


@pytest.mark.parametrize(
    ("successes", "episodes", "low"), [(15, 20, 0.5313), (98, 100, 0.9300), (1, 2, 0.0945)]
)
def test_wilsons_interval(successes: int, episodes: int, low: float) -> None:
    assert wilson_low(successes, episodes) == pytest.approx(low, abs=1e-4)


def step_of(
    offset_m: list[float],
    terminated: list[bool],
    travelled_m: list[float],
    success: tuple[bool, ...] = (False, False),
    collided: tuple[bool, ...] = (False, False),
    turned_rad: float = 0.0,
) -> Any:
    count = len(offset_m)
    zeros = np.zeros(count)
    course = Course(
        zeros, np.array(offset_m), np.full(count, turned_rad), zeros, np.array(travelled_m)
    )
    ended = np.array(terminated)
    task = TaskStep(np.zeros((2, count)), np.zeros((1, count)), ended, ended, np.array(success))
    poses = np.zeros((count, 3))
    return SimpleNamespace(task=task, course=course, collided=np.array(collided), poses=poses)


@pytest.mark.parametrize(
    ("step", "end"),
    [
        (step_of([0.0], [False], [0.0], success=(True,), collided=(False,)), "done"),
        (step_of([0.0], [True], [0.0], success=(False,), collided=(True,)), "collided"),
        (step_of([0.0], [False], [0.0], success=(False,), collided=(False,)), "out of time"),
        (step_of([0.2], [True], [0.0], (False,), (False,), turned_rad=-1.8), "turned away"),
        (step_of([0.2], [True], [0.0], (False,), (False,), turned_rad=1.7), "left its path"),
    ],
)
def test_why_an_episode_ended(step: Any, end: str) -> None:
    assert _end(step, 0) == end


def frame(number: int) -> np.ndarray:
    return np.full((2, 2, 3), number, np.uint8)


def ridden(offsets_m: list[float], success: bool) -> Any:
    ride = _Ride()
    for number, offset_m in enumerate(offsets_m):
        ride.add(np.full(3, float(number)), offset_m, frame(number))
    last = step_of([0.0], [not success], [0.0], success=(success,), collided=(False,))
    return ride.end(5, last, 0, frame(len(offsets_m)))


def test_a_strip_shows_every_fifth_decision_up_to_the_worst_moment() -> None:
    offsets = [0.0] * 50
    offsets[3], offsets[33] = 0.5, -0.1  # the first while it still settles
    track = ridden(offsets, success=True)
    assert track.strip[:, 0, 0, 0].tolist() == [0, 5, 10, 15, 20, 25, 30]
    assert track.deviation_m == pytest.approx(0.1)
    assert len(track.poses) == 51


def test_a_strip_of_a_failure_ends_with_its_end_and_has_eight_frames() -> None:
    track = ridden([0.0] * 62, success=False)
    assert track.strip[:, 0, 0, 0].tolist() == [30, 35, 40, 45, 50, 55, 60, 62]
    assert (track.seed, track.end) == (5, "left its path")


def test_a_tracer_keeps_nothing_of_robots_that_stand_aside() -> None:
    world: Any = SimpleNamespace(
        task=SimpleNamespace(course=SimpleNamespace(offset_m=np.array([0.1, 0.2]))),
        maps=np.array([1, 2]),
        poses=np.zeros((2, 3)),
        n_robots=2,
        active=np.array([True, False]),
    )
    kept: list[Any] = []
    tracer = Tracer(world, SimpleNamespace(add=kept.append))  # type: ignore[arg-type]
    image = np.zeros((2, 2, 2, 6), np.uint8)
    image[0, ..., 3:] = 9  # the newest of two stacked pictures
    observation: Any = SimpleNamespace(image=image)
    step = step_of([0.1, 0.2], [True, True], [0.0, 0.0])
    step.finished = SimpleNamespace(robots=np.array([0]), observation=observation)
    tracer.see(observation)
    tracer.end(step, np.array([4, -1]))
    assert [(track.seed, track.map_index) for track in kept] == [(4, 1)]
    assert (kept[0].strip == 9).all()
    assert kept[0].offset_m.tolist() == pytest.approx([0.1, 0.1])
