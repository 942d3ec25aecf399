"""The algorithms: each is one file here, named as it is asked for, with its ``ALGORITHM``.

Its configuration, its presets, how a model of it is built and what that logs. A file is imported
when somebody asks for the algorithm: to read their names takes no torch.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from robot.errors import expect_one_of

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
class Shares:
    """What of ``learn`` N processes of a training share, so that together they learn as one does.

    The fewer robots a process has, the more of its time goes into what a step costs anyhow: so
    where it can be, steps are shared, and each process has as many robots as one alone.
    """

    divided: Mapping[str, int]  # a share each, for a good number of processes of so much
    times: tuple[str, ...] = ()  # N times as much each

    def fits(self, learn: LearnConfig, workers: int, least: int = 0) -> bool:
        """Whether so many can share it, and each has ``least`` times what is good."""
        # a file is read with a bare ``LearnConfig`` first, which has none of these
        shares = [(divmod(getattr(learn, k, 0), workers), n) for k, n in self.divided.items()]
        return all(rest == 0 and share >= least * good for (share, rest), good in shares)

    def good_number(self, learn: LearnConfig, cores: int) -> int:
        """One process for each core, but none with so little that it is not worth while."""
        return next((n for n in range(cores, 1, -1) if self.fits(learn, n, least=1)), 1)

    def of_each(self, learn: LearnConfig, workers: int) -> LearnConfig:
        """What one of them does."""
        each: Any = {name: getattr(learn, name) // workers for name in self.divided}
        return replace(learn, **each, **{k: getattr(learn, k) * workers for k in self.times})


@dataclass(frozen=True)
class Algorithm:
    """All that the rest of the trainer must know of an algorithm."""

    title: str  # in tables
    learn: LearnConfig
    policy: type[BasePolicy]
    build: Callable[[Making], BaseAlgorithm]
    # By task, preset or style, see `trainer.presets`.
    presets: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    shares: Shares | None = Shares({"robots": 8})  # none: it has processes of its own


def find_algorithm(name: str) -> Algorithm:
    """The algorithm of that name; ConfigError with the nearest if there is none."""
    expect_one_of("algorithm", name, NAMES)
    found: Algorithm = importlib.import_module(f"{__name__}.{name}").ALGORITHM
    return found
