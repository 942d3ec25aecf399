from collections.abc import Iterable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld, DriveMetrics, Observation
from sim_pybullet.look import NOMINAL
from sim_pybullet.tasks.spec import find_task
from trainer.judging.evaluate import (
    DONE,
    SETTLED,
    Drive,
    Ride,
    _end,
    drive,
)
from trainer.judging.films import WORST, Scene, film_worst, films, films_of, keep_films
from trainer.judging.judge import _scene

HALF_LANE_M = 0.111


def ridden(offsets_m: list[float]) -> Ride:
    """With pictures that count the decisions."""
    ride = Ride(half_lane_m=HALF_LANE_M)
    for k, offset_m in enumerate(offsets_m):
        ride.add(np.zeros(3), offset_m, np.full((12, 16, 3), k, np.uint8))
    return ride


def shown(film: Sequence[np.ndarray]) -> list[int]:
    return [int(frame[0, 0, 0]) for frame in film]


def offered(ends: list[tuple[str, float]], first: int, end_before: int) -> list[Scene]:
    """Of some of the drives that ended so, this far off at their end."""
    scenes = []
    for seed, (end, off_m) in list(enumerate(ends))[first:end_before]:
        ride = ridden([0.0] * 29 + [-off_m])
        ride.end = end
        metrics = DriveMetrics(1.0, 3.0, 0.1, 0.0, 0.02)
        scenes.append(_scene(Drive(seed, end == DONE, metrics, map="arena"), ride))
    return [scene for scene in scenes if scene is not None]


@given(st.lists(st.integers(-9, 9), min_size=1, max_size=40, unique=True))
def test_the_worst_are_kept_with_what_was_seen(badness: list[int]) -> None:
    written: list[tuple[str, int]] = []

    def write(path: Path, frames: Iterable[np.ndarray], _: float) -> None:
        written.append((path.name, shown(list(frames))[0] - 9))

    scenes = [((k > 0, k), f"episode {k}", [np.full((2, 2, 3), k + 9, np.uint8)]) for k in badness]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("trainer.judging.films.write_mp4", write)
        found = film_worst(scenes, Path("folder/e"))
    worst = sorted(badness, reverse=True)[:WORST]
    assert [(each.badness, each.title) for each in found] == [
        ((k > 0, k), f"episode {k}") for k in worst
    ]
    assert written == [(f"e_{rank}.mp4", k) for rank, k in enumerate(worst, start=1)]


def test_how_a_robot_was_put_down_is_no_deviation() -> None:
    ride = ridden([0.5] * SETTLED + [0.01, -0.02])
    assert ride.farthest_m == pytest.approx(0.02)
    assert ridden([0.5] * 3).farthest_m == 0.0


def test_a_film_ends_with_a_failure_or_where_a_robot_was_farthest_off() -> None:
    offsets = [0.0] * 140
    offsets[3], offsets[33] = 0.5, -0.2  # the first while it still settles
    ride = ridden(offsets)
    assert shown(ride.farthest) == list(range(34))
    assert shown(ride.frames) == list(range(40, 140))


def test_what_failed_or_left_its_lane_is_filmed_and_films_of_before_go(tmp_path: Path) -> None:
    ends = [(DONE, 0.01), ("left its path", 0.05), (DONE, 0.12), ("collided", 0.0), (DONE, 0.1)]
    beside = films_of(tmp_path / "e.json")
    found = [
        film for k in (0, 3) for film in film_worst(offered(ends, k, k + 3), tmp_path / f"{k}")
    ]
    told = keep_films(found, *beside)
    assert [title for title, _ in told] == [
        "Episode 1 on arena - left its path",
        "Episode 3 on arena - collided",
        "Episode 2 on arena - out of its lane for a while",
    ]
    assert sorted(path.name for _, path in told) == sorted(p.name for p in tmp_path.glob("e_*"))
    assert [path.read_bytes() for _, path in told] == [
        found[k].path.read_bytes() for k in (0, 2, 1)
    ]
    assert keep_films([], *beside) == []
    assert not list(tmp_path.glob("e_*"))
    assert films(tmp_path, "e_worst") == []


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
    assert _end(step, 0) == end


def test_rides_are_what_the_robots_did_and_saw() -> None:
    """Robots that spin on the spot: each ends."""
    robots, asked = 3, [10, 11, 21]
    task = find_task("lane").build([load_map("loop")], robots)
    world = BatchWorld(task, [NOMINAL], seed=3, numbers=asked)
    seen: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {number: [] for number in asked}

    def choose(observation: Observation) -> np.ndarray:
        for robot in np.flatnonzero(world.active).tolist():
            picture = observation.image[robot, ..., -3:].copy()
            seen[int(world.numbers[robot])].append((world.poses[robot].copy(), picture))
        return np.zeros(robots, dtype=int)

    ends = list(drive(world, choose))
    assert sorted(done.seed for done, _, _ in ends) == asked
    for done, facts, ride in ends:
        poses, pictures = zip(*seen[done.seed], strict=True)
        np.testing.assert_array_equal(ride.poses[:-1], poses)
        np.testing.assert_array_equal(np.stack([*ride.frames]), pictures[-100:])
        assert ride.half_lane_m == pytest.approx(HALF_LANE_M, abs=1e-3)
        assert (done.map, done.success, ride.end) == ("loop", False, "turned away")
        assert done.laps == facts["laps"]
