import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.errors import ConfigError
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.spec import find_task
from trainer.judging.drive_log import (
    DONE,
    SETTLED,
    WORST,
    DriveLog,
    Ride,
    Rides,
    Track,
    Worst,
    drives_beside,
    end_of,
    film_of,
    load_drives,
)

TILE_M = 0.585  # a lane ends 0.111 m from its middle


def track(seed: int, end: str, deviation_m: float, steps: int = 30) -> Track:
    poses = np.full((steps, 3), 1.0, np.float32)
    poses[:, 0] = np.linspace(0.5, 1.5, steps)
    offset_m = np.zeros(steps, np.float32)
    offset_m[-1] = -deviation_m
    return Track(seed, 0, end, poses, offset_m)


def ridden(one: Track) -> Ride:
    ride = Ride(one.map_index)
    for k, (pose, offset_m) in enumerate(zip(one.poses, one.offset_m.tolist(), strict=True)):
        ride.add(pose, offset_m, np.full((12, 16, 3), k, np.uint8))
    return ride


def saved(tracks: list[Track], folder: Path) -> Path:
    log, evaluation = DriveLog([TILE_M]), folder / "evaluation.json"
    for one in tracks:
        log.end(one.seed, one.end, ridden(one))
    log.save(evaluation)
    return evaluation


@given(st.lists(st.integers(-9, 9), min_size=1, max_size=40, unique=True))
def test_the_worst_are_kept_with_what_was_seen(badness: list[int]) -> None:
    worst = Worst()
    for k in badness:
        worst.add((k > 0, k), f"episode {k}", [np.full((1, 1, 3), k + 9, np.uint8)])
    kept = [(of[1], what, int(film[0][0, 0, 0]) - 9) for of, what, film in worst.kept]
    assert kept == [(k, f"episode {k}", k) for k in sorted(badness, reverse=True)[:WORST]]


def test_how_a_robot_was_put_down_is_no_deviation() -> None:
    start = track(0, DONE, 0.01)
    start.offset_m[:SETTLED] = 0.5
    assert start.deviation_m == pytest.approx(0.01)
    short = track(0, "collided", 0.04, steps=3)
    assert short.deviation_m == pytest.approx(0.04)
    assert short.badness > start.badness


def test_drives_come_back_from_their_file_and_what_went_wrong_is_filmed(tmp_path: Path) -> None:
    ends = [(DONE, 0.01), ("left its path", 0.05), (DONE, 0.12), ("collided", 0.0), (DONE, 0.1)]
    tracks = [track(k, end, off_m) for k, (end, off_m) in enumerate(ends)]
    evaluation = saved(tracks[::-1], tmp_path)
    back = load_drives(drives_beside(evaluation))
    for before, after in zip(tracks, back, strict=True):
        assert before[:3] == after[:3]
        np.testing.assert_array_equal(before.poses, after.poses)
        np.testing.assert_array_equal(before.offset_m, after.offset_m)
    films = [film_of(evaluation, k).name for k in (1, 2, 3)]
    assert sorted(os.listdir(tmp_path)) == ["evaluation.npz", *films]
    saved(tracks[:1], tmp_path)
    assert os.listdir(tmp_path) == ["evaluation.npz"], "without the films of before"


def test_a_film_ends_with_a_failure_or_where_a_robot_was_farthest_off() -> None:
    offsets = np.zeros(140, np.float32)
    offsets[3], offsets[33] = 0.5, -0.1  # the first while it still settles
    ride = ridden(track(5, DONE, 0.0, 140)._replace(offset_m=offsets))
    assert [int(frame[0, 0, 0]) for frame in ride.farthest] == list(range(34))
    assert [int(frame[0, 0, 0]) for frame in ride.frames] == list(range(40, 140))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing"])
def test_what_is_no_file_of_drives_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ConfigError, match="expected drives"):
        load_drives(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("happened", "end"),
    [
        ({"success": True}, DONE),
        ({"collided": True, "terminated": True}, "collided"),
        ({}, "out of time"),
        ({"terminated": True, "turned_rad": -1.8}, "turned away"),
        ({"terminated": True, "turned_rad": 1.7}, "left its path"),
    ],
)
def test_why_an_episode_ended(happened: dict[str, Any], end: str) -> None:
    asked = {"success": False, "collided": False, "terminated": False, "turned_rad": 0.0}
    found = {name: np.array([value]) for name, value in (asked | happened).items()}
    step: Any = SimpleNamespace(
        task=SimpleNamespace(success=found["success"], terminated=found["terminated"]),
        course=SimpleNamespace(heading_error_rad=found["turned_rad"]),
        collided=found["collided"],
    )
    assert end_of(step, 0) == end


def test_tracks_are_where_the_robots_were() -> None:
    """Robots that spin on the spot: each ends, and its track is that of the world's own poses."""
    robots, asked = 2, [10, 11, 21]
    task = find_task("lane").build([load_map("loop")], robots)
    world = BatchWorld(task, [NOMINAL], seed=3, numbers=asked)
    rides, ended = Rides(world), set()
    observation, seen = world.reset(), [[] for _ in range(robots)]
    pictures: list[list[np.ndarray]] = [[] for _ in range(robots)]
    while world.active.any():
        for robot in np.flatnonzero(world.active).tolist():
            seen[robot].append(world.poses[robot])
            pictures[robot].append(observation.image[robot, ..., -3:].copy())
        rides.see(observation)
        numbers = world.numbers
        step = world.step(np.zeros(robots, dtype=int))
        for robot in step.finished.robots.tolist():
            ended.add(int(numbers[robot]))
            ride = rides.end(step, robot)
            np.testing.assert_array_equal(ride.poses, [*seen[robot], step.poses[robot]])
            assert len(ride.offset_m) == len(ride.poses)
            np.testing.assert_array_equal(np.stack([*ride.frames]), pictures[robot][-100:])
            assert end_of(step, robot) != DONE
            seen[robot], pictures[robot] = [], []
        observation = step.observation
    world.close()
    assert ended == set(asked)
