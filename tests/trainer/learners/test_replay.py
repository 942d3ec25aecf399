from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from robot.errors import ConfigError
from trainer.learners.replay import MappedReplayBuffer

ROBOTS, GAMMA, N_STEPS = 3, 0.9, 3
IMAGE = spaces.Box(0, 255, (2, 2, 3), np.uint8)
BOTH = spaces.Dict({"image": IMAGE, "path": spaces.Box(-1, 1, (2,), np.float32)})
ACTIONS = spaces.Discrete(5)


def open_buffer(folder: Path, space: spaces.Space = IMAGE, size: int = 30) -> MappedReplayBuffer:
    return MappedReplayBuffer(
        size, space, ACTIONS, n_envs=ROBOTS, folder=folder, n_steps=N_STEPS, gamma=GAMMA
    )


def picture(number: int) -> np.ndarray:
    return np.full((ROBOTS, 2, 2, 3), number, dtype=np.uint8)


def fill(buffer: MappedReplayBuffer, first: int, count: int, ends: tuple[int, ...] = ()) -> None:
    """Row i: picture i -> i + 1, reward i; robots end in ``ends``, the last by time limit."""
    for i in range(first, first + count):
        done = np.full(ROBOTS, i in ends)
        infos: list[dict[str, Any]] = [{} for _ in range(ROBOTS)]
        infos[-1]["TimeLimit.truncated"] = bool(done[-1])
        buffer.add(
            picture(i), picture(i + 1), np.full(ROBOTS, i % 5), np.full(ROBOTS, i), done, infos
        )


def sample_all(buffer: MappedReplayBuffer) -> Any:
    rng = np.random.default_rng(0)
    np.random.seed(0)  # noqa: NPY002  stable-baselines3 draws the robots from numpy's global state
    rows = buffer.buffer_size if buffer.full else buffer.pos
    return buffer._get_samples(rng.integers(rows, size=500))


def test_n_step_returns_stop_at_the_end_of_an_episode(tmp_path: Path) -> None:
    buffer = open_buffer(tmp_path)
    fill(buffer, 0, 9, ends=(4,))
    batch = sample_all(buffer)
    ended_by_failure = set()
    for seen, following, reward, over, discount in zip(
        batch.observations[:, 0, 0, 0].tolist(),
        batch.next_observations[:, 0, 0, 0].tolist(),
        batch.rewards[:, 0].tolist(),
        batch.dones[:, 0].tolist(),
        batch.discounts[:, 0].tolist(),
        strict=True,
    ):
        last = 4 if seen <= 4 else 8
        steps = min(N_STEPS, last - seen + 1)
        assert following == seen + steps
        assert discount == pytest.approx(GAMMA**steps)
        assert reward == pytest.approx(sum(GAMMA**k * (seen + k) for k in range(steps)))
        if over:
            ended_by_failure.add(seen)
    assert ended_by_failure == {2, 3, 4}


def test_contents_outlive_the_process_and_lead_nowhere(tmp_path: Path) -> None:
    buffer = open_buffer(tmp_path)
    fill(buffer, 0, 6)
    again = open_buffer(tmp_path)
    assert (again.pos, again.full) == (6, False)
    fill(again, 100, 3)
    batch = sample_all(again)
    seen = batch.observations[:, 0, 0, 0].numpy()
    following = batch.next_observations[:, 0, 0, 0].numpy()
    assert set(seen) == {0, 1, 2, 3, 4, 5, 100, 101, 102}
    assert (following[seen < 10] <= 6).all(), "an old transition leads into a new episode"


def test_half_written_row_is_repaired(tmp_path: Path) -> None:
    buffer = open_buffer(tmp_path)
    fill(buffer, 0, 14)  # 10 rows: the oldest four are overwritten
    buffer.seen["image"][buffer.pos] = 200
    buffer.rewards[buffer.pos] = np.nan
    again = open_buffer(tmp_path)
    assert (again.pos, again.full) == (4, True)
    batch = sample_all(again)
    assert np.isfinite(batch.rewards.numpy()).all()
    assert batch.observations.max() < 200


def test_buffer_of_another_shape_begins_empty(tmp_path: Path) -> None:
    fill(open_buffer(tmp_path), 0, 6)
    assert open_buffer(tmp_path, size=60).pos == 0


def test_dict_observations_come_back_together(tmp_path: Path) -> None:
    buffer = open_buffer(tmp_path, BOTH)
    for i in range(5):
        now = {"image": picture(i), "path": np.full((ROBOTS, 2), i / 10, np.float32)}
        then = {"image": picture(i + 1), "path": np.full((ROBOTS, 2), (i + 1) / 10, np.float32)}
        zero = np.zeros(ROBOTS)
        buffer.add(now, then, zero, zero, zero, [{}] * ROBOTS)
    batch = sample_all(buffer)
    for part in (batch.observations, batch.next_observations):
        np.testing.assert_allclose(part["image"][:, 0, 0, 0] / 10.0, part["path"][:, 0], atol=1e-6)


def test_too_little_disk_is_said_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="GB free"):
        open_buffer(tmp_path, spaces.Box(0, 255, (999, 999, 3), np.uint8), size=10**7)
    assert not any(tmp_path.iterdir())
