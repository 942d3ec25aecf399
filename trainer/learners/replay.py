"""A replay buffer that lies in files, so that it outlives its process.

stable-baselines3's `NStepReplayBuffer` does the n-step arithmetic; here it only ever sees the
numbers of the pictures, and the pictures stay where they are until a batch asks for them. That
also gives it the dict observations which it does not have.
"""

import shutil
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import NStepReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from robot.errors import ConfigError
from trainer.algorithms import Making
from trainer.envs import parts_of
from trainer.learners.policies import common_arguments

_NUMBER = spaces.Box(0, np.iinfo(np.int64).max, shape=(), dtype=np.int64)
_SCALARS = ("actions", "rewards", "dones", "timeouts")


def off_policy(making: Making, **own: Any) -> dict[str, Any]:
    """What those who learn from a replay buffer in the run's folder are told."""
    learn, replay = cast(Any, making.config.learn), making.folder.replay
    if getattr(making.env, "pictures", None) is not None:  # those of an earlier process are gone
        shutil.rmtree(replay, ignore_errors=True)
    return common_arguments(making) | {
        "batch_size": learn.batch,
        "gradient_steps": learn.gradient_steps,
        "buffer_size": learn.buffer,
        "learning_starts": learn.warm_up,
        "target_update_interval": learn.robots,  # that is, every step of all robots
        "replay_buffer_class": MappedReplayBuffer,
        "replay_buffer_kwargs": {"folder": replay, **own},
    }


class MappedReplayBuffer(NStepReplayBuffer):
    """Transitions of N robots in memory-mapped files under ``folder``.

    The file ``rows`` holds the number of rows ever written and is set after the row itself, so a
    process that dies at any moment leaves at most one half-written row, which is repaired
    when the next one opens it.
    A folder that already holds a buffer of this shape is taken over with its contents.
    """

    def __init__(
        self, buffer_size: int, seen: spaces.Space, *rest: Any, folder: Path, **own: Any
    ) -> None:
        super().__init__(buffer_size, _NUMBER, *rest, **own)
        self.folder, self.taken_over = folder, True
        folder.mkdir(parents=True, exist_ok=True)
        rows = (self.buffer_size, self.n_envs)
        self.observations = np.arange(rows[0] * rows[1], dtype=np.int64).reshape(rows)
        self.next_observations = self.observations
        parts = parts_of(seen)
        sizes = [np.prod(rows + part.shape) * part.dtype.itemsize for part in parts.values()]
        needed = 2 * int(sum(sizes)) - sum(path.stat().st_size for path in folder.iterdir())
        free = shutil.disk_usage(folder).free
        if needed > free:
            raise ConfigError(
                f"replay buffer: expected {needed / 1e9:.1f} GB free under {folder}, "
                f"got {free / 1e9:.1f}; choose a smaller buffer or another --out"
            )
        self.seen, self.seen_next = (
            {k: self._map(f"{which}{k}", rows + s.shape, s.dtype) for k, s in parts.items()}
            for which in ("", "next_")
        )
        for name in _SCALARS:
            array = getattr(self, name)
            setattr(self, name, self._map(name, array.shape, array.dtype))
        self.rows = self._map("rows", (1,), np.dtype(np.int64))
        # Take up an old buffer: its robots are gone, so its last transitions lead nowhere.
        if not self.taken_over:
            self.rows[0] = 0
        written = int(self.rows[0])
        self.full, self.pos = written >= self.buffer_size, written % self.buffer_size
        if written:
            last = self.pos - 1
            self.timeouts[last] = np.maximum(self.timeouts[last], 1.0 - self.dones[last])
            scalars = (getattr(self, name) for name in _SCALARS)
            for array in (*self.seen.values(), *self.seen_next.values(), *scalars):
                array[self.pos] = array[last]  # may be half written

    def add(self, obs: Any, next_obs: Any, *rest: Any) -> None:
        """One row: a transition of every robot."""
        for store, observation in ((self.seen, obs), (self.seen_next, next_obs)):
            for name, part in parts_of(observation).items():
                store[name][self.pos] = part
        numbers = self.observations[self.pos]
        super().add(numbers, numbers, *rest)
        self.rows[0] += 1

    def _get_samples(
        self, batch_inds: np.ndarray, env: VecNormalize | None = None
    ) -> ReplayBufferSamples:
        samples = super()._get_samples(batch_inds, env)
        return samples._replace(
            observations=self._fetch(self.seen, samples.observations),
            next_observations=self._fetch(self.seen_next, samples.next_observations),
        )

    def _fetch(self, store: dict[str, np.ndarray], numbers: torch.Tensor) -> Any:
        which = numbers.cpu().numpy()
        batch = {
            name: torch.from_numpy(array.reshape(-1, *array.shape[2:])[which]).to(self.device)
            for name, array in store.items()
        }
        return batch if len(batch) > 1 else batch["image"]

    def _map(self, name: str, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
        path = self.folder / name
        fits = path.exists() and path.stat().st_size == int(np.prod(shape)) * dtype.itemsize
        self.taken_over = self.taken_over and fits
        # np.asarray: indexing a plain array is several times quicker than indexing a np.memmap
        return np.asarray(np.memmap(path, dtype, mode="r+" if fits else "w+", shape=shape))
