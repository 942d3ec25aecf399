"""Dueling DQN (Wang et al. 2016): Double DQN whose network adds a value and advantages."""

from dataclasses import replace

from trainer.algorithms import ddqn
from trainer.learners.networks import DuelingPolicy

ALGORITHM = replace(ddqn.ALGORITHM, title="Dueling DQN", policy=DuelingPolicy)
