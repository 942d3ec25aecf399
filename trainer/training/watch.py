"""What happens beside the steps of a training: records, evaluations, checkpoints, display."""

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from robot.contract import CONTROL_DT_S
from trainer.config import RunConfig
from trainer.envs import image_changed, parts_of
from trainer.learners.backbone import Seer
from trainer.learners.episode_count import EpisodeCount, EpisodeEnd
from trainer.learners.networks import GreedyNetwork
from trainer.mp4 import enlarged, write_mp4
from trainer.run import Episode, EpisodeLog, RunFolder
from trainer.torch_file import save_torch
from trainer.training.checkpoint import Evaluated, TrainState, save_checkpoint
from trainer.training.crew import Crew, share_of

DISPLAY_PERIOD_S = 0.25
LOG_PERIOD_S = 2.0
CHECKPOINT_PERIOD_S = 10.0
RECENT_EPISODES = 50  # the paper's running mean
LONGEST_FILM = 600  # decisions of an evaluation that are filmed: a minute


class Watch(BaseCallback):
    """Watches one training, and stops it when its time is up, or the task done.

    ``folder`` gets the best policy, the film of an evaluation, and checkpoints; ``state`` is the
    record that it keeps, ``env`` where the policy is evaluated, ``crew`` the processes that learn
    with this one.
    """

    def __init__(
        self,
        config: RunConfig,
        folder: RunFolder,
        state: TrainState,
        log: EpisodeLog,
        env: VecEnv,
        console: Console,
        crew: Crew,
    ) -> None:
        super().__init__()
        self._config, self._folder, self.state, self._log = config, folder, state, log
        self._env, self._crew, self._others_cpu_s = env, crew, 0.0
        backbone = config.net.backbone
        self._seer = Seer(Path(backbone), config.device) if backbone else None
        self._count = EpisodeCount(share_of(config, rank=0).learn.robots, config.reward_scale)
        self._recent: deque[Episode] = deque(maxlen=RECENT_EPISODES)
        self._saved = self._logged = self._shown = time.monotonic()
        self._started = time.monotonic() - state.seconds
        self._cpu_started = time.process_time() - state.cpu_seconds
        self.bar = Progress(
            TextColumn(f"{config.task} {config.algorithm}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f} steps · {task.fields[told]}"),
            TimeElapsedColumn(),
            console=console,
        )
        self._row = self.bar.add_task("", total=config.steps, told="")

    def _on_training_start(self) -> None:
        self._first = (self.steps, self.state.seconds)

    @property
    def steps(self) -> int:
        """Decisions so far, of all robots of all processes."""
        return int(self.model.num_timesteps * self._config.workers)

    def _on_rollout_end(self) -> None:
        told = getattr(self.model, "news", self._crew.news)()  # A3C has a crew of its own
        for ended, _ in told:
            self._remember(ended)
        if told:
            self._others_cpu_s = sum(cpu_s for _, cpu_s in told)

    def _remember(self, ended: list[EpisodeEnd]) -> None:
        for end in ended:
            self._recent.append(Episode(self.steps, self.state.seconds, *end))
            self._log.add(self._recent[-1])

    def _on_step(self) -> bool:
        seen = self.locals
        self._remember(self._count.ended(seen["rewards"], seen["dones"], seen["infos"]))
        now = time.monotonic()
        if now - self._logged >= LOG_PERIOD_S:
            self._logged = now
            self._log.file.flush()
            for name in ("reward", "length", "success") if self._recent else ():
                mean = np.mean([getattr(episode, name) for episode in self._recent])
                self.logger.record(f"episode/{name}", mean)
            self.logger.record("time/seconds", self.state.seconds)
            self.logger.dump(self.steps)
        if self._evaluation_is_due():
            self.evaluate()
        if time.monotonic() - self._saved >= CHECKPOINT_PERIOD_S:
            self.save()
        if now - self._shown >= DISPLAY_PERIOD_S:
            self._shown = now
            self._show()
        return self._goes_on()

    def _evaluation_is_due(self) -> bool:
        evaluations, wanted = self.state.evaluations, self._config.evaluation
        last = evaluations[-1].step if evaluations else 0
        # the longer the run, the rarer: evaluations take a bounded share of its time
        share = wanted.every_share * self._config.steps
        return self.steps - last >= max(wanted.every_steps, last // 4, share)

    def evaluate(self) -> None:
        """Drive greedily on starts that were never used, and keep the policy if it is the best."""
        began, cpu_began = time.monotonic(), time.process_time()
        state, wanted = self.state, self._config.evaluation
        seed = self._config.seed + 1_000_003 + len(state.evaluations) * wanted.episodes
        frames: list[np.ndarray] = []
        result = drive_greedily(self._choose, self._env, seed, wanted.rounds, frames.append)
        took, distance_m = time.monotonic() - began, float(result.distance_m.mean())
        state.evaluation_seconds += took
        parts = result.success, result.rewards, result.steps
        success, reward, length = (float(part.mean()) for part in parts)
        cpu_s = state.cpu_seconds + time.process_time() - cpu_began
        known_m = None if np.isnan(distance_m) else distance_m
        state.seconds, state.cpu_seconds = state.seconds + took, cpu_s
        evaluated = Evaluated(self.steps, state.seconds, success, reward, length, cpu_s, known_m)
        state.evaluations += (evaluated,)
        if state.best is evaluated:
            save_torch(self._folder.best, self.model.policy.state_dict())
            self._saved = -CHECKPOINT_PERIOD_S  # what tells of it is saved at once
        if frames[0].ndim == 3:
            write_mp4(self._folder.film, map(enlarged, frames[:LONGEST_FILM]), 1 / CONTROL_DT_S)
        self._tell(evaluated)
        enough = wanted.stop_after_perfect
        if enough and [e.success_rate for e in state.evaluations[-enough:]] == [1.0] * enough:
            state.stopped_by = "solved"

    def _choose(self, observation: Any) -> np.ndarray:
        seen = image_changed(observation, self._seer) if self._seer else observation
        return GreedyNetwork(self.model.policy).actions(seen)

    def _tell(self, e: Evaluated) -> None:
        self.logger.record("evaluation/success", e.success_rate)
        self.logger.record("evaluation/reward", e.mean_reward)
        self.logger.record("evaluation/length", e.mean_steps)
        if e.mean_distance_m is not None:
            self.logger.record("evaluation/distance_m", e.mean_distance_m)
        self.logger.dump(e.step)
        self.bar.console.print(
            f"step {e.step:>7} · {e.seconds:6.1f} s · evaluation: success {e.success_rate:4.0%}, "
            f"return {e.mean_reward:.0f} in {e.mean_steps:.0f} decisions"
        )

    def save(self) -> None:
        """A checkpoint now, and every episode before it."""
        self._log.file.flush()
        save_checkpoint(self._folder.checkpoint, self.model, self.state)
        self._saved = time.monotonic()

    def _show(self) -> None:
        """Returns are means of the reward of an episode; choices by chance lower that learning."""
        steps, seconds = self._first
        told = f"{(self.steps - steps) / max(self.state.seconds - seconds, 1e-9):.0f}/s"
        if self._recent:
            told += f" · return {np.mean([e.reward for e in self._recent]):.0f} learning"
        if self.state.evaluations:
            last = self.state.evaluations[-1]
            told += f" · {last.success_rate:.0%}, {last.mean_reward:.0f} evaluated"
        self.bar.update(self._row, completed=self.steps, told=told)

    def _goes_on(self) -> bool:
        """CPU seconds are kept, too: on a busy machine the wall clock says little."""
        state, budget_s = self.state, self._config.seconds
        state.seconds = time.monotonic() - self._started
        state.cpu_seconds = time.process_time() + self._others_cpu_s - self._cpu_started
        if budget_s is not None and state.seconds >= budget_s:
            state.stopped_by = "seconds"
        return not state.stopped_by


class GreedyResult(NamedTuple):
    """The first R episodes of each of N robots."""

    rewards: np.ndarray  # (R, N) summed over the episode
    steps: np.ndarray  # (R, N) decisions
    success: np.ndarray  # (R, N) 1 or 0
    distance_m: np.ndarray  # (R, N) from the path, mean of an episode; NaN where nothing tells it


def drive_greedily(
    choose: Callable[[Any], np.ndarray],
    env: VecEnv,
    seed: int,
    rounds: int = 1,
    watch: Callable[[np.ndarray], None] | None = None,
) -> GreedyResult:
    """Reset ``env`` with ``seed`` and drive until every robot has ended so many episodes.

    ``choose`` gives the actions (N,) of what N robots see.
    ``watch`` is shown what the first robot sees, (H, W, 3) uint8, in its first episode.
    """
    env.seed(seed)
    observation = env.reset()
    count, off_m = EpisodeCount(env.num_envs, 1.0), np.zeros(env.num_envs)
    ends: list[list[tuple[float, ...]]] = [[] for _ in range(env.num_envs)]
    while min(map(len, ends)) < rounds:
        if watch is not None and not ends[0]:
            watch(parts_of(observation)["image"][0, ..., -3:].copy())
        observation, reward, done, infos = env.step(choose(observation))
        off_m += [abs(info.get("offset_m", np.nan)) for info in infos]
        for k, *told in count.ended(reward, done, infos):
            if len(ends[k]) < rounds:  # others are waited for
                ends[k].append((*told, off_m[k] / told[1]))
            off_m[k] = 0.0
    return GreedyResult(*np.ascontiguousarray(np.array(ends, dtype=float).T))
