"""A training from beginning to end, or from where it was cut off."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from trainer.algorithms import EnvMaker, Making, find_algorithm
from trainer.config import RunConfig, judged
from trainer.envs import ScaledReward
from trainer.export import export_run
from trainer.learners.replay import MappedReplayBuffer
from trainer.learners.true_path import WithTruePath
from trainer.relit import Relit
from trainer.report.curves import draw_curve
from trainer.run import EpisodeLog, RunFolder, write_json
from trainer.training.checkpoint import Evaluated, TrainState, load_checkpoint
from trainer.training.watch import Clock, Watch


@dataclass(frozen=True)
class Metrics:
    """``metrics.json``."""

    train_seconds: float  # wall clock, evaluations included
    evaluation_seconds: float
    cpu_seconds: float  # of the process, all threads, evaluations included
    train_steps: int
    episodes: int
    success_rate: float  # of the kept policy, on its evaluation
    stopped_by: str
    solved_seconds: float  # first evaluation without a failure; NaN: none
    solved_steps: float
    seed: int
    evaluations: tuple[Evaluated, ...]
    schema: int = 1


def train(
    config: RunConfig,
    folder: RunFolder,
    make_env: EnvMaker,
    console: Console,
    clock: Clock = time.monotonic,
    checkpoint_period_s: float = 10.0,
) -> Metrics:
    """Train until the steps, the seconds or the task are done; go on from a checkpoint if any.

    Leaves `RunFolder`'s files. An interrupted run keeps its replay buffer and can go on.

    Raises:
        DuckpilotError: ``make_env`` refuses the configuration; then nothing was written.
    """
    torch.set_num_threads(config.threads)
    session = _Session(config, folder, make_env, console, clock, checkpoint_period_s)
    try:
        session.learn()
        return session.finish()
    finally:
        session.close()


class _Session:
    """One process's share of a run."""

    def __init__(
        self,
        config: RunConfig,
        folder: RunFolder,
        make_env: EnvMaker,
        console: Console,
        clock: Clock,
        checkpoint_period_s: float,
    ) -> None:
        self.config, self.folder = config, folder
        drivers = -(-config.evaluation.episodes // config.evaluation.rounds)
        self.evaluation_env = make_env(judged(config), drivers, config.seed)
        algorithm = find_algorithm(config.algorithm)
        robots = self.evaluation_env
        if not algorithm.own_worlds:
            robots = make_env(config, config.learn.robots, config.seed)
        if config.true_path:
            robots = WithTruePath(robots)
        if config.relit:
            robots = Relit(robots, np.random.default_rng(config.seed))
        self.env = ScaledReward(robots, config.reward_scale)
        folder.go_on(config)
        self.model = algorithm.build(Making(config, self.env, folder, make_env, console))
        self.state = TrainState()
        if folder.checkpoint.exists():
            self.state = load_checkpoint(folder.checkpoint, self.model)
            self.state.stopped_by = ""
            self.model.set_random_seed(config.seed + self.model.num_timesteps)
        board = str(folder.tensorboard)
        folder.tensorboard.mkdir(parents=True, exist_ok=True)
        self.model.set_logger(Logger(board, [TensorBoardOutputFormat(board)]))
        self.log = EpisodeLog(folder, self.model.num_timesteps)
        beside = (self.log, self.evaluation_env, console, clock, checkpoint_period_s)
        self.watch = Watch(config, folder, self.state, *beside)
        self.watch.init_callback(self.model)

    def learn(self) -> None:
        """Until something stops it."""
        with _stop_on_signal(self.state):
            self.model.learn(
                max(0, self.config.steps - self.model.num_timesteps),
                callback=self.watch,
                log_interval=None,  # type: ignore[arg-type]  # we log ourselves
                reset_num_timesteps=False,
            )
        self.state.stopped_by = self.state.stopped_by or "steps"

    def finish(self) -> Metrics:
        """Leave the files; an interrupted run has no model and no metrics yet."""
        evaluations, reason = self.state.evaluations, self.state.stopped_by
        interrupted = reason == "interrupted"
        if not interrupted and not (
            evaluations and evaluations[-1].step == self.model.num_timesteps
        ):
            self.watch.evaluate()
            self.state.stopped_by = reason
        self.watch.save()
        draw_curve(self.folder, self.config)
        metrics = self._metrics()
        if not interrupted:
            env = self.evaluation_env
            export_run(self.folder, self.config, env, frames=10 * env.num_envs, int8=False)
            write_json(self.folder.metrics, metrics)
        return metrics

    def _metrics(self) -> Metrics:
        state, nan = self.state, float("nan")
        solved = next((e for e in state.evaluations if e.success_rate == 1.0), None)
        return Metrics(
            train_seconds=state.seconds,
            evaluation_seconds=state.evaluation_seconds,
            cpu_seconds=state.cpu_seconds,
            train_steps=self.model.num_timesteps,
            episodes=self.log.count,
            success_rate=state.best.success_rate if state.best else nan,
            stopped_by=state.stopped_by,
            solved_seconds=solved.seconds if solved else nan,
            solved_steps=solved.step if solved else nan,
            seed=self.config.seed,
            evaluations=tuple(state.evaluations),
        )

    def close(self) -> None:
        """Let go of files and environments; the replay buffer of a finished run is deleted."""
        self.watch.close()
        self.log.close()
        self.model.logger.close()
        self.env.close()
        if self.env.venv is not self.evaluation_env:
            self.evaluation_env.close()
        buffer = getattr(self.model, "replay_buffer", None)
        if isinstance(buffer, MappedReplayBuffer):
            buffer.close(delete=self.state.stopped_by not in ("", "interrupted"))


@contextmanager
def _stop_on_signal(state: TrainState) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the run at the next step instead of in the middle of one."""

    def ask_to_stop(*_: object) -> None:
        state.stopped_by = "interrupted"

    caught = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, ask_to_stop) for number in caught}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
