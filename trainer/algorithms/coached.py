"""DAgger whose expert is taught first, by reinforcement that is told the true path."""

from trainer.algorithms import Algorithm
from trainer.algorithms.dagger import DIVIDED, PRESETS, DaggerConfig, build
from trainer.learners.networks import ImitatingPolicy

ALGORITHM = Algorithm(
    "DAgger after a PPO coach",
    DaggerConfig(coach_steps=200_000),
    ImitatingPolicy,
    build,
    {**PRESETS, "debug": {"learn": {**PRESETS["debug"]["learn"], "coach_steps": 4_096}}},
    divided=DIVIDED,
)
