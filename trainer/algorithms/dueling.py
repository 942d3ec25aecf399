"""Dueling DQN (Wang et al. 2016): Double DQN whose network adds a value and advantages."""

from trainer.algorithms import Algorithm
from trainer.algorithms.ddqn import DIVIDED, PRESETS, QConfig, build
from trainer.learners.networks import DuelingPolicy

ALGORITHM = Algorithm("Dueling DQN", QConfig(), DuelingPolicy, build, PRESETS, divided=DIVIDED)
