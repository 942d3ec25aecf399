"""What a step of training costs with a translator as filter, beside one without.

    python -m tools.translation_cost --translator runs/t/sim_to_real.onnx --task lane

Two trainings in one process take turns, so that whatever else the machine does meets both. Figures
are processor time of one thread; the ratio is the median over the turns.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from robot.command_line import OneLineParser, answer, whole
from robot.output import expect_writable, write_json

if TYPE_CHECKING:
    from trainer.config import RunConfig

ALGORITHMS = ("dueling", "ppo")
_MOST = 2.0  # times the untranslated step: what is due
_STEPS = {"dueling": 40, "ppo": 64}  # of all robots in a turn; PPO's is a rollout and its updates


@dataclass(frozen=True)
class Cost:
    """Processor time of a step of all robots, learning included."""

    algorithm: str
    robots: int
    without_ms: float  # medians
    with_ms: float
    ratio: float


def measure(
    config: RunConfig,
    translator: str,
    turns: int,
    steps: int,
    clock: Callable[[], float] = time.process_time,
) -> Cost:
    """Let a training with and one without a translator take turns.

    Args:
        config: of the training without.
        translator: an ONNX file.
        turns: of each; one more comes before they count.
        steps: of all robots in a turn.
        clock: seconds of processor time.

    Raises:
        ContractError: the translator is for other pictures.
    """
    import numpy as np
    from rich.console import Console

    from trainer.algorithms import Making, find_algorithm
    from trainer.envs import ScaledReward, make_env
    from trainer.learners.true_path import WithTruePath
    from trainer.run import RunFolder

    robots = config.learn.robots
    with tempfile.TemporaryDirectory() as folder:
        learners = []
        for k, through in enumerate((None, translator)):
            chosen = replace(config, translate=through)
            env = make_env(chosen, robots, chosen.seed)
            told = WithTruePath(env) if chosen.true_path else env
            scaled = ScaledReward(told, chosen.reward_scale)
            place, console = RunFolder(Path(folder) / str(k)), Console(quiet=True)
            making = Making(chosen, scaled, place, make_env, console)
            learners.append(find_algorithm(chosen.algorithm).build(making))
        times = np.empty((turns + 1, 2))
        for row in times:
            for k, learner in enumerate(learners):
                began = clock()
                learner.learn(steps * robots, reset_num_timesteps=False)
                row[k] = 1e3 * (clock() - began) / steps
    counted = times[1:]
    medians = np.median(counted, axis=0)
    ratio = np.median(counted[:, 1] / counted[:, 0])
    return Cost(config.algorithm, robots, float(medians[0]), float(medians[1]), float(ratio))


def main(arguments: list[str] | None = None) -> int:
    """0 where both algorithms stay within twice the step without, 1 where one does not."""
    parser = OneLineParser(
        prog="python -m tools.translation_cost", description=(__doc__ or "").split("\n\n")[0]
    )
    parser.add_argument("--translator", required=True, help="ONNX file, sim-to-real")
    parser.add_argument("--task", default="lane", help="lane or navigation")
    parser.add_argument("--look", default="nominal")
    parser.add_argument("--turns", type=whole(1, 1000), default=8)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args(arguments)
    return answer("translation_cost", lambda: compare(asked))


def compare(asked: argparse.Namespace) -> int:
    """Measure each algorithm; the exit status."""
    import torch
    from rich.console import Console

    from trainer.presets import preset

    expect_writable(asked.json, inputs=[Path(asked.translator)])
    torch.set_num_threads(1)
    console = Console(soft_wrap=True)
    costs = []
    for name in ALGORITHMS:
        config = replace(preset(asked.task, name, "fast"), look=asked.look)
        found = measure(config, asked.translator, asked.turns, _STEPS[name])
        costs.append(found)
        console.print(
            f"{name}, {found.robots} robots: {found.without_ms:.1f} ms without, "
            f"{found.with_ms:.1f} ms with, {found.ratio:.2f} times (at most {_MOST:g} is due)"
        )
    if asked.json is not None:
        write_json(asked.json, [asdict(cost) for cost in costs])
    return 0 if all(cost.ratio <= _MOST for cost in costs) else 1


if __name__ == "__main__":
    sys.exit(main())
