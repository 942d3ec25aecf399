"""How a policy is taught; apart from what learns, so that a command line reads it soon."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TeachConfig:
    """How much of what."""

    steps: int = 900
    """Decisions of each robot."""
    robots: int = 12
    """In each of the two worlds."""
    batch: int = 128
    """Frames of worlds in an update; recorded ones come on top."""
    recorded: int = 32
    """Recorded frames in an update."""
    every: int = 2
    """Decisions between updates."""
    rate: float = 4e-4
    """Of learning, at first."""
    buffer: int = 24_000
    """Frames of worlds that are kept."""
    expert_share: float = 0.15
    """Of the steps, over which the expert's share of the driving falls to 0."""
    random_share: float = 0.08
    """Of the actions, so that recoveries are seen."""
    painted: int = 10
    """Worlds of each kind."""
