"""What watches a training: episodes, evaluations, checkpoints, budget and display.

Each is a stable-baselines3 callback of its own; they share one `TrainState`.
"""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from robot.contract import CONTROL_DT_S
from trainer.config import RunConfig
from trainer.learners.networks import GreedyNetwork
from trainer.mp4 import enlarged, write_mp4
from trainer.run import Episode, EpisodeLog, RunFolder
from trainer.training.checkpoint import Evaluated, TrainState, save_checkpoint, save_policy
from trainer.training.greedy import drive_greedily

Clock = Callable[[], float]
DISPLAY_PERIOD_S = 0.25
LOG_PERIOD_S = 2.0
RECENT_EPISODES = 50  # the paper's running mean
LONGEST_FILM = 600  # decisions of an evaluation that are filmed: a minute


class Stopwatch(BaseCallback):
    """Keeps `TrainState.seconds`, and stops the run when its time is up or a person says so.

    CPU seconds are kept beside them, since on a busy machine the wall clock says little.
    """

    def __init__(self, state: TrainState, budget_s: float | None, clock: Clock) -> None:
        super().__init__()
        self._state, self._budget_s, self._clock = state, budget_s, clock
        self._started = clock() - state.seconds
        self._cpu_started = time.process_time() - state.cpu_seconds

    def _on_step(self) -> bool:
        self._state.seconds = self._clock() - self._started
        workers_s = getattr(self.model, "workers_cpu_s", 0.0)  # of A3C
        self._state.cpu_seconds = time.process_time() + workers_s - self._cpu_started
        if self._budget_s is not None and self._state.seconds >= self._budget_s:
            self._state.stopped_by = "seconds"
        return not self._state.stopped_by


class EpisodeRecorder(BaseCallback):
    """One line of ``progress.csv`` for each episode; TensorBoard every two seconds."""

    def __init__(
        self, state: TrainState, log: EpisodeLog, clock: Clock, reward_scale: float
    ) -> None:
        super().__init__()
        self.recent: deque[Episode] = deque(maxlen=RECENT_EPISODES)
        self._state, self._log, self._clock = state, log, clock
        self._reward_scale = reward_scale
        self._logged = clock()

    def _on_training_start(self) -> None:
        self._rewards = np.zeros(self.training_env.num_envs)
        self._lengths = np.zeros(self.training_env.num_envs, dtype=int)

    def _on_step(self) -> bool:
        if "episodes" in self.locals:  # of asynchronous workers, who count for themselves
            for robot, reward, length, success in self.locals["episodes"]:
                self._add(robot, reward, length, success)
        else:
            self._count()
        if self._clock() - self._logged >= LOG_PERIOD_S:
            self._logged = self._clock()
            self._log.flush()
            self._write_scalars()
        return True

    def _count(self) -> None:
        self._rewards += self.locals["rewards"] / self._reward_scale
        self._lengths += 1
        for robot in np.flatnonzero(self.locals["dones"]):
            success = bool(self.locals["infos"][robot].get("is_success", False))
            self._add(int(robot), float(self._rewards[robot]), int(self._lengths[robot]), success)
            self._rewards[robot], self._lengths[robot] = 0.0, 0

    def _add(self, robot: int, reward: float, length: int, success: bool) -> None:
        episode = Episode(self.num_timesteps, self._state.seconds, robot, reward, length, success)
        self._log.add(episode)
        self.recent.append(episode)

    def _write_scalars(self) -> None:
        if self.recent:
            self.logger.record("episode/reward", np.mean([e.reward for e in self.recent]))
            self.logger.record("episode/length", np.mean([e.length for e in self.recent]))
            self.logger.record("episode/success", np.mean([e.success for e in self.recent]))
        self.logger.record("time/seconds", self._state.seconds)
        self.logger.dump(self.num_timesteps)


class Evaluator(BaseCallback):
    """Drives greedily now and then, keeps the best policy, stops when it is good enough."""

    def __init__(
        self, state: TrainState, config: RunConfig, folder: RunFolder, env: VecEnv, clock: Clock
    ) -> None:
        super().__init__()
        self._state, self._config, self._folder = state, config, folder
        self._env, self._clock = env, clock

    def _on_step(self) -> bool:
        last = self._state.evaluations[-1].step if self._state.evaluations else 0
        wanted = self._config.evaluation
        # the longer the run, the rarer: evaluations take a bounded share of its time
        share = wanted.every_share * self._config.steps
        if self.num_timesteps - last >= max(wanted.every_steps, last // 4, share):
            self.evaluate()
        return not self._state.stopped_by

    def evaluate(self) -> Evaluated:
        """One evaluation now, on starts that no earlier one has used."""
        began, cpu_began = self._clock(), time.process_time()
        state, wanted = self._state, self._config.evaluation
        seed = self._config.seed + 1_000_003 + len(state.evaluations) * wanted.episodes
        frames: list[np.ndarray] = []
        network = GreedyNetwork(self.model.policy)
        result = drive_greedily(network, self._env, seed, wanted.rounds, frames.append)
        took = self._clock() - began
        state.evaluation_seconds += took
        evaluated = Evaluated(
            self.model.num_timesteps,
            state.seconds + took,
            float(result.success.mean()),
            float(result.rewards.mean()),
            float(result.steps.mean()),
            state.cpu_seconds + time.process_time() - cpu_began,
            None if np.isnan(distance_m := result.distance_m.mean()) else float(distance_m),
        )
        state.evaluations.append(evaluated)
        if state.best is evaluated:
            save_policy(self._folder.best, self.model.policy)
        if frames[0].ndim == 3:
            write_mp4(self._folder.film, map(enlarged, frames[:LONGEST_FILM]), 1 / CONTROL_DT_S)
        self._record(evaluated)
        enough = wanted.stop_after_perfect
        if enough and [e.success_rate for e in state.evaluations[-enough:]] == [1.0] * enough:
            state.stopped_by = "solved"
        return evaluated

    def _record(self, evaluated: Evaluated) -> None:
        self.logger.record("evaluation/success", evaluated.success_rate)
        self.logger.record("evaluation/reward", evaluated.mean_reward)
        self.logger.record("evaluation/length", evaluated.mean_steps)
        if evaluated.mean_distance_m is not None:
            self.logger.record("evaluation/distance_m", evaluated.mean_distance_m)
        self.logger.dump(evaluated.step)


class Checkpointer(BaseCallback):
    """A checkpoint every ``period_s`` [s]."""

    def __init__(
        self,
        state: TrainState,
        folder: RunFolder,
        log: EpisodeLog,
        clock: Clock,
        period_s: float,
    ) -> None:
        super().__init__()
        self._state, self._folder, self._log = state, folder, log
        self._clock, self._period_s = clock, period_s
        self._saved = clock()

    def _on_step(self) -> bool:
        if self._clock() - self._saved >= self._period_s:
            self.save()
        return True

    def save(self) -> None:
        """A checkpoint now, and every episode before it."""
        self._log.flush()
        save_checkpoint(self._folder.checkpoint, self.model, self._state)
        self._saved = self._clock()


class Display(BaseCallback):
    """A bar with steps, steps per second, and returns; a line per evaluation.

    Both returns are the reward summed over an episode, and means. Of those while it learns the
    last 50 count: they begin anywhere, with choices made by chance, and often end early.
    """

    def __init__(
        self, state: TrainState, config: RunConfig, recorder: EpisodeRecorder, console: Console
    ) -> None:
        super().__init__()
        self._state, self._config, self._recorder = state, config, recorder
        self._bar = Progress(
            TextColumn(f"{config.task} {config.algorithm}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f} steps"),
            TextColumn("{task.fields[rate]:.0f}/s · return {task.fields[learning]} learning"),
            TextColumn("· {task.fields[judged]} evaluated"),
            TimeElapsedColumn(),
            console=console,
        )
        self._task = self._bar.add_task("", total=config.steps, rate=0.0, learning="-", judged="-")
        self._shown = 0.0
        self._evaluations = len(state.evaluations)

    def _on_training_start(self) -> None:
        self._bar.start()
        self._first = (self.num_timesteps, self._state.seconds)

    def _on_step(self) -> bool:
        if self._state.seconds - self._shown >= DISPLAY_PERIOD_S:
            self._shown = self._state.seconds
            self._update()
        for e in self._state.evaluations[self._evaluations :]:
            self._bar.console.print(
                f"step {e.step:>7} · {e.seconds:6.1f} s · evaluation: success "
                f"{e.success_rate:4.0%}, return {e.mean_reward:.0f} in {e.mean_steps:.0f} decisions"
            )
        self._evaluations = len(self._state.evaluations)
        return True

    def _update(self) -> None:
        recent, evaluations = self._recorder.recent, self._state.evaluations
        steps, seconds = self._first
        self._bar.update(
            self._task,
            completed=self.num_timesteps,
            rate=(self.num_timesteps - steps) / max(self._state.seconds - seconds, 1e-9),
            learning=f"{np.mean([e.reward for e in recent]):.0f}" if recent else "-",
            judged=f"{evaluations[-1].success_rate:.0%}, {evaluations[-1].mean_reward:.0f}"
            if evaluations
            else "-",
        )

    def stop(self) -> None:
        """Leave the bar as it is and give the terminal back."""
        self._bar.stop()


@contextmanager
def stop_on_signal(state: TrainState) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the run at the next step instead of in the middle of one."""

    def ask_to_stop(*_: object) -> None:
        state.stopped_by = "interrupted"

    caught = (signal.SIGINT, signal.SIGTERM)
    previous = [signal.signal(number, ask_to_stop) for number in caught]
    try:
        yield
    finally:
        for number, handler in zip(caught, previous, strict=True):
            signal.signal(number, handler)


MONOTONIC: Clock = time.monotonic
