"""DAgger whose expert is taught first, by reinforcement that is told the true path."""

from dataclasses import replace

from robot.contract import COMMANDS
from trainer.algorithms.dagger import ALGORITHM as DAGGER
from trainer.algorithms.dagger import PRESETS, DaggerConfig

_SHORT = {"learn": {**PRESETS["debug"]["learn"], "coach_steps": 4_096}}
ALGORITHM = replace(
    DAGGER,
    title="DAgger after a PPO coach",
    learn=DaggerConfig(coach_steps=200_000),
    presets={**PRESETS, "lane": {"commands": COMMANDS}, "debug": _SHORT},
)
