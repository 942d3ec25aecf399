import os
from pathlib import Path

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
    STRIP_FRAMES,
    WORST,
    DriveLog,
    Tracer,
    Track,
    load_drives,
)


def track(seed: int, end: str, deviation_m: float, strip: int = 1, steps: int = 30) -> Track:
    poses = np.full((steps, 3), 1.0, np.float32)
    poses[:, 0] = np.linspace(0.5, 1.5, steps)
    offset_m = np.zeros(steps, np.float32)
    offset_m[-1] = -deviation_m
    return Track(seed, 0, end, poses, offset_m, np.full((strip, 12, 16, 3), seed % 256, np.uint8))


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 0.2)), min_size=1, max_size=40))
def test_the_worst_keep_their_strips(drives: list[tuple[bool, float]]) -> None:
    log = DriveLog()
    for seed, (success, deviation_m) in enumerate(drives):
        log.add(track(seed, DONE if success else "collided", deviation_m))
    everyone = sorted((t.badness for t in log.tracks), reverse=True)
    assert len(log.tracks) == len(drives)
    assert [t.badness for t in log.worst] == everyone[:WORST]


def test_how_a_robot_was_put_down_is_no_deviation() -> None:
    start = track(0, DONE, 0.01)
    start.offset_m[:SETTLED] = 0.5
    assert start.deviation_m == pytest.approx(0.01)
    short = track(0, "collided", 0.04, steps=3)
    assert short.deviation_m == pytest.approx(0.04)


def test_drives_come_back_from_their_file(tmp_path: Path) -> None:
    tracks = [track(k, DONE if k % 2 else "left its path", 0.01 * k, 1 + k % 8) for k in range(13)]
    log = DriveLog()
    for one in tracks:
        log.add(one)
    log.save(tmp_path / "drives.npz")
    back = load_drives(tmp_path / "drives.npz")
    for before, after in zip(log.tracks, back.tracks, strict=True):
        assert (before.seed, before.end, before.map_index) == (
            after.seed,
            after.end,
            after.map_index,
        )
        np.testing.assert_array_equal(before.poses, after.poses)
        np.testing.assert_array_equal(before.offset_m, after.offset_m)
    assert [t.seed for t in back.worst] == [t.seed for t in log.worst]
    for before, after in zip(log.worst, back.worst, strict=True):
        np.testing.assert_array_equal(before.strip, after.strip)
    assert os.listdir(tmp_path) == ["drives.npz"]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing"])
def test_what_is_no_file_of_drives_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ConfigError, match="expected drives"):
        load_drives(tmp_path / "a.npz")


def test_tracks_are_where_the_robots_were() -> None:
    """Robots that spin on the spot: each ends, and its track is that of the world's own poses."""
    robots, asked = 2, [10, 11, 21]
    task = find_task("lane").build([load_map("loop")], robots)
    world = BatchWorld(task, [NOMINAL], seed=3, numbers=asked)
    log = DriveLog()
    tracer = Tracer(world, log)
    observation, seen = world.reset(), [[] for _ in range(robots)]
    expected: dict[int, np.ndarray] = {}
    frames: dict[int, np.ndarray] = {}
    while world.active.any():
        for robot in range(robots):
            seen[robot].append(world.poses[robot])
        tracer.see(observation)
        numbers = world.numbers
        step = world.step(np.zeros(robots, dtype=int))
        tracer.end(step, numbers)
        for k, robot in enumerate(step.finished.robots.tolist()):
            seed = int(numbers[robot])
            expected[seed] = np.array([*seen[robot], step.poses[robot]])
            frames[seed] = step.finished.observation.image[k]
            seen[robot] = []
        observation = step.observation
    world.close()
    assert [t.seed for t in log.tracks] == [10, 11, 21]
    for one in log.tracks:
        np.testing.assert_allclose(one.poses, expected[one.seed], atol=1e-5)
        assert len(one.offset_m) == len(one.poses)
        assert not one.success
        assert 1 <= len(one.strip) <= STRIP_FRAMES
        np.testing.assert_array_equal(one.strip[-1], frames[one.seed])
