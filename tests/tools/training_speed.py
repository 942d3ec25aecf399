"""How many decisions a training makes per second of processor time, and where the time goes.

``python -m tests.tools.training_speed --beside CHECKOUT`` measures this tree and another one, in
turn, and prints their ratios: on a busy machine only these mean anything. ``--processes 2``
compares so many processes of one training with one, by the clock: on a quiet machine only.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trainer.config import RunConfig

CASES = {
    f"{task}_{algorithm}_{look}": (task, algorithm, look)
    for task, algorithm in (("lane", "dueling"), ("navigation", "ppo"))
    for look in ("nominal", "randomised", "randomised_seen")  # by sight, in a checkout that can
}
STEPS = {  # decisions; the second half of them is measured
    ("fast", "dueling"): 4_096,
    ("fast", "ppo"): 12_288,
    ("debug", "ppo"): 512,
}


@dataclass(frozen=True)
class TrainingSpeed:
    """Shares of the processor's time: stepping the world; choosing, storing and learning."""

    decisions_per_cpu_s: float
    world_share: float
    learner_share: float


def measured(task: str, algorithm: str, look: str, size: str = "fast") -> RunConfig:
    """A training with one evaluation, at its end."""
    from trainer.presets import preset

    config = preset(task, algorithm, size)
    if look.endswith("_seen") and hasattr(config.net, "backbone"):
        sight = str(Path("robot/models/sight.onnx").resolve())
        config = replace(config, net=replace(config.net, backbone=sight))
    look = look.removesuffix("_seen")
    config = replace(config, look=look, steps=STEPS[size, algorithm])
    evaluation = replace(config.evaluation, episodes=1, rounds=1, every_steps=10 * config.steps)
    return replace(config, evaluation=evaluation)


def decisions_per_s(config: RunConfig) -> float:
    """By the clock, from the middle of a training to its end."""
    from rich.console import Console

    from trainer.envs import make_env
    from trainer.run import RunFolder
    from trainer.training.train import train

    with tempfile.TemporaryDirectory() as path:
        folder = RunFolder(Path(path) / "run")
        train(config, folder, make_env, Console(quiet=True))
        late = [e for e in folder.episodes() if e.step >= config.steps / 2]
    return (late[-1].step - late[0].step) / (late[-1].seconds - late[0].seconds)


def training_speed(task: str, algorithm: str, look: str, size: str = "fast") -> TrainingSpeed:
    """Of a training of preset ``size`` in this process, without painting and evaluations."""
    from rich.console import Console

    from trainer.envs import make_env
    from trainer.run import RunFolder
    from trainer.training.train import train

    config = measured(task, algorithm, look, size)
    spans: list[tuple[float, float]] = []  # of the world's steps, on the processor's clock

    def timed(config: Any, robots: int, seed: int) -> Any:
        env = make_env(config, robots, seed)
        if robots > 1:
            step = env.step_wait

            def step_wait() -> Any:
                began = time.process_time()
                result = step()
                spans.append((began, time.process_time()))
                return result

            env.step_wait = step_wait  # type: ignore[method-assign]
        return env

    with tempfile.TemporaryDirectory() as folder:
        train(config, RunFolder(Path(folder) / "run"), timed, Console(quiet=True))
    counted = spans[len(spans) // 2 :]
    total = counted[-1][0] - counted[0][0]
    world = sum(end - began for began, end in counted[:-1]) / total
    return TrainingSpeed((len(counted) - 1) * config.learn.robots / total, world, 1.0 - world)


def in_checkout(case: str, checkout: Path) -> TrainingSpeed:
    """A case measured in a process of its own, by the code of a checkout, in one thread."""
    from trainer.processes import ONE_THREAD  # an older checkout has no such module

    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(checkout)}
    words = [sys.executable, __file__, case]
    told = subprocess.run(words, cwd=checkout, env=environment, capture_output=True, check=True)
    return TrainingSpeed(**json.loads(told.stdout.splitlines()[-1]))


def main(words: list[str]) -> None:
    """``CASE`` measures one here; the others compare all, or the cases named after them."""
    if words[:1] == ["--processes"]:
        from trainer.processes import ONE_THREAD

        os.environ.update(ONE_THREAD)
        for case in words[2:] or CASES:
            short = measured(*CASES[case])
            config = replace(short, steps=8 * short.steps)  # many episodes end
            one, many = (decisions_per_s(replace(config, workers=n)) for n in (1, int(words[1])))
            print(f"{case} {one:.0f} and {many:.0f} decisions/s: {many / one:.2f}", flush=True)
        return
    if words[:1] != ["--beside"]:
        print(json.dumps(asdict(training_speed(*CASES[words[0]]))))
        return
    ours, theirs = Path(__file__).parents[2], Path(words[1]).resolve()
    for case in words[2:] or CASES:
        pairs = [(in_checkout(case, theirs), in_checkout(case, ours)) for _ in range(2)]
        ratios = [new.decisions_per_cpu_s / old.decisions_per_cpu_s for old, new in pairs]
        print(case, " and ".join(f"{ratio:.2f}" for ratio in ratios), *pairs[-1], flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
