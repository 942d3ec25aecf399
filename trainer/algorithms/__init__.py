"""The algorithms: each is one file here, named as it is asked for, with its ``ALGORITHM``.

Its configuration, its presets, how a model of it is built and what that logs. A file is imported
when somebody asks for the algorithm: to read their names takes no torch.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from robot.errors import ConfigError, nearest

if TYPE_CHECKING:
    from rich.console import Console
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.policies import BasePolicy
    from stable_baselines3.common.vec_env import VecEnv

    from trainer.config import RunConfig
    from trainer.run import RunFolder

EnvMaker = Callable[["RunConfig", int, int], "VecEnv"]  # of a run: so many robots, and a seed
NAMES = tuple(found.name for found in pkgutil.iter_modules(__path__))


@dataclass(frozen=True)
class LearnConfig:
    """What every algorithm's own configuration holds, among other things."""

    robots: int = 32  # that learn at once
    learning_rate: float = 5e-4
    max_grad_norm: float = 0.5


@dataclass(frozen=True)
class Making:
    """What a model is built from."""

    config: RunConfig
    env: VecEnv
    folder: RunFolder
    make_env: EnvMaker
    console: Console


@dataclass(frozen=True)
class Algorithm:
    """All that the rest of the trainer must know of an algorithm."""

    title: str  # in tables
    learn: LearnConfig
    policy: type[BasePolicy]
    build: Callable[[Making], BaseAlgorithm]
    # By task, preset or style, see `trainer.presets`.
    presets: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    own_workers: bool = False  # whether it has processes of its own
    # What of ``learn`` is divided among the processes of a training, see `trainer.training.crew`.
    divided: tuple[str, ...] = ("robots",)


def find_algorithm(name: str) -> Algorithm:
    """The algorithm of that name; ConfigError with the nearest if there is none."""
    if name not in NAMES:
        raise ConfigError(f"algorithm: unknown {name!r}; {nearest(name, NAMES)}")
    found: Algorithm = importlib.import_module(f"{__name__}.{name}").ALGORITHM
    return found
