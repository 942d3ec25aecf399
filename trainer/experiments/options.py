"""What the experiments can be asked for: to read it takes none of what they need."""

from __future__ import annotations

from dataclasses import dataclass

MAPS = ("hamlet", "village", "suburb", "blocks")  # not the arena, where the six models are judged


@dataclass(frozen=True)
class SixModelsOptions:
    """What is trained, and where it is judged."""

    translator: str | None = None
    """An ONNX translator from simulated pictures to photographs; else no CycleGAN model."""
    preset: str = "fast"
    """paper, fast or debug."""
    map: tuple[str, ...] = MAPS
    """Maps of the navigation trainings."""
    test_map: str = "arena"
    """Map of the paths and missions."""
    look: str = "reality"
    """Look or looks in which all are judged."""
    pose_error: str = "arena"
    """In training and test alike: none or arena."""
    steps: int = 400_000
    """Of each navigation training by Dueling."""
    ppo_steps: int = 800_000
    """Of each by PPO, whose steps cost a third; the paper, too, gave it twice as many."""
    lane_steps: int = 60_000
    """Of each lane training."""
    judgings: int = 4
    """How often each is judged while it is trained; the best is kept."""
    lap_drives: int = 20
    """Drives of four laps of each lane keeper."""
    seeds: int = 3
    """Models of each kind, with seeds 0, 1, 2 …"""


@dataclass(frozen=True)
class Figure5Options:
    """What is trained, where, and how long."""

    algo: str = "ppo"
    """ppo, a2c or a3c."""
    preset: str = "fast"
    """paper, fast or debug."""
    map: str = "airfield"
    """The track of all trainings but the Oracle's."""
    look: str = "tracks/day"
    """The look of the trainings on it."""
    looks: str = "tracks"
    """The looks of domain randomisation."""
    test_map: str = "speedway"
    """The track on which all are judged."""
    test_look: str = "tracks_unseen/steppe"
    """The look in which all are judged; not one of those of domain randomisation."""
    steps: int = 100_000
    """Decisions of each training."""
    seeds: int = 3
    """Trainings of each kind, with seeds 0, 1, 2 …"""
    frames: int = 1000
    """From which each half of the translator learns; the paper has 15,000."""
    translator_steps: int = 1500
    """Updates of each half."""
