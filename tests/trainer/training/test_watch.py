"""When a training looks how well it drives, what it keeps of that, and when it is done."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tests.trainer.toy import toy_config
from trainer.config import RunConfig
from trainer.run import EpisodeLog, RunFolder
from trainer.training import watch
from trainer.training.checkpoint import Evaluated, TrainState
from trainer.training.watch import GreedyResult, Watch, drive_greedily


def watching(config: RunConfig, path: Path, state: TrainState) -> Any:
    """Over a model that does nothing but be at a step."""
    folder, alone = RunFolder(path), SimpleNamespace(news=list)
    log, console = EpisodeLog(folder), Console(quiet=True)
    one: Any = Watch(config, folder, state, log, SimpleNamespace(), console, alone)  # type: ignore[arg-type]
    quiet = SimpleNamespace(record=lambda *_: None, dump=lambda *_: None)
    policy = SimpleNamespace(state_dict=dict)
    one.model = SimpleNamespace(num_timesteps=0, policy=policy, logger=quiet)
    return one


def driven(step: int, success: float = 0.5, reward: float = 8.0, length: float = 16.0) -> Evaluated:
    return Evaluated(step, 1.0, success, reward, length)


def test_the_policy_that_is_kept_fails_least_then_earns_most_for_a_decision() -> None:
    """Not most in all, since who dawdles earns longer; of equals the first."""

    def best(*each: Evaluated) -> int | None:
        found = TrainState(evaluations=each).best
        return found.step if found else None

    assert best() is None
    assert best(driven(1, 0.9, 100.0), driven(2, 1.0, -5.0), driven(3, 0.8, 900.0)) == 2
    assert best(driven(1, 1.0, 30.0, 10.0), driven(2, 1.0, 50.0, 50.0)) == 1
    assert best(driven(1), driven(2, 1.0), driven(3, 1.0)) == 2


@pytest.mark.parametrize(
    ("last", "share", "due"),
    [(0, 0.0, 1_000), (4_000, 0.0, 5_000), (40_000, 0.0, 50_000), (40_000, 0.2, 60_000)],
)
def test_the_longer_a_run_the_rarer_it_is_judged(
    last: int, share: float, due: int, tmp_path: Path
) -> None:
    """After 1,000 steps, after a quarter of the steps so far, and after a share of all."""
    config = toy_config("ppo", 100_000)
    config = replace(config, evaluation=replace(config.evaluation, every_share=share))
    state = TrainState(evaluations=(driven(last),) if last else ())
    one = watching(config, tmp_path, state)
    for step in (due - 8, due):
        one.model.num_timesteps = step
        assert one._evaluation_is_due() == (step == due)


def test_only_a_better_policy_is_kept_and_two_perfect_ones_in_a_row_are_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = toy_config("ppo", 100_000, seed=7)
    config = replace(config, evaluation=replace(config.evaluation, stop_after_perfect=2))
    kept, seeds, ended = list[Path](), list[int](), list[str]()
    shares = [0.5, 1.0, 0.9, 1.0, 1.0]

    def drives(_: Any, __: Any, seed: int, ___: int, film: Any) -> GreedyResult:
        film(np.zeros(3))
        part = np.full((1, 10), shares[len(seeds)])
        seeds.append(seed)
        return GreedyResult(part, np.ones((1, 10)), part, np.full((1, 10), np.nan))

    monkeypatch.setattr(watch, "drive_greedily", drives)
    monkeypatch.setattr(watch, "save_torch", lambda path, _: kept.append(path))
    one = watching(config, tmp_path, TrainState())
    for step in range(1, 6):
        one.model.num_timesteps = step * 1_000
        one.evaluate()
        ended.append(one.state.stopped_by)
        assert len(kept) == min(step, 2)
    assert set(kept) == {tmp_path / "best.pt"}
    assert ended == ["", "", "", "", "solved"]
    # the robots of ``seed`` are seeded from it on: none starts as in training, or as before
    assert seeds[0] > 7 + 1_000_000
    assert (np.diff(seeds) >= 10).all()


def test_time_goes_on_where_a_run_was_cut_off_and_judging_is_part_of_it(tmp_path: Path) -> None:
    config = replace(toy_config("ppo", 100_000), seconds=50.0)
    state = TrainState(seconds=49.0, evaluation_seconds=40.0, cpu_seconds=20.0)
    one = watching(config, tmp_path, state)
    assert one._goes_on()
    assert 49.0 <= state.seconds < 50.0
    assert state.cpu_seconds >= 20.0
    one._started -= 1.0
    assert not one._goes_on()
    assert state.stopped_by == "seconds"


class Weaving:
    """Two robots whose episodes take two decisions and four; each step is that much farther off."""

    num_envs = 2

    def seed(self, seed: int) -> None:
        self.seeded = seed

    def reset(self) -> np.ndarray:
        self.steps = 0
        return np.full((2, 1, 1, 3), self.seeded, np.uint8)

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        self.steps += 1
        done = np.array((self.steps % 2 == 0, self.steps % 4 == 0))
        infos = [{"offset_m": (-1) ** self.steps * 0.1 * self.steps, "is_success": True}] * 2
        return actions[:, None, None, None], np.array((1.0, 0.5)), done, infos


def test_each_robot_drives_its_episodes_and_others_wait() -> None:
    result = drive_greedily(lambda seen: seen[:, 0, 0, 0], Weaving(), seed=5, rounds=2)  # type: ignore[arg-type]
    assert result.steps.tolist() == [[2, 4], [2, 4]]
    assert result.rewards.tolist() == [[2, 2], [2, 2]]
    assert result.success.tolist() == [[1, 1], [1, 1]]
    # means of 1 and 2, of 1 to 4, of 3 and 4, and of 5 to 8, in tenths of a metre
    np.testing.assert_allclose(result.distance_m, [[0.15, 0.25], [0.35, 0.65]])
