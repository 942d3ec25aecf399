"""What paper A reports (section 4, Table 3); it gives no seconds. Strings are shown as they are."""

from __future__ import annotations

from dataclasses import dataclass

NAMES = {
    "ddqn": "Double DQN",
    "dueling": "Dueling DQN",
    "a2c": "A2C",
    "a3c": "A3C",
    "ppo": "PPO",
    "dagger": "DAgger",
    "coached": "DAgger after a PPO coach",
}
TASK_TITLES = {"lane": "Lane keeping", "navigation": "Navigation", "track": "Race tracks"}


@dataclass(frozen=True)
class PaperRow:
    """One algorithm on one task."""

    learned: str  # steps until it had learned
    trained: str  # steps of the whole training
    driving: str  # how the trained model drove; for navigation Table 3


PAPER: dict[tuple[str, str], PaperRow] = {
    ("lane", "ddqn"): PaperRow("about 10,000", "2 M", "drives on until stopped"),
    ("lane", "dueling"): PaperRow("within 1 M", "2 M", "drives on until stopped"),
    ("lane", "a2c"): PaperRow("never steadily", "longer than the others", "unsteady"),
    ("lane", "ppo"): PaperRow(
        "250,000 (steady from 550,000)", "not given", "drives on until stopped"
    ),
    ("navigation", "dueling"): PaperRow("not given", "1.5 M", "96.4 % of 1000"),
    ("navigation", "ppo"): PaperRow("not given", "3 M", "66 % of 1000"),
}
NOTHING = PaperRow("–", "–", "–")


def paper_row(task: str, algorithm: str) -> PaperRow:
    """What the paper says, or dashes."""
    return PAPER.get((task, algorithm), NOTHING)


def paper_algorithms(task: str) -> list[str]:
    """Those that the paper has a figure for, in its order (Figures 30 to 33, 34 and 35)."""
    return [algorithm for of, algorithm in PAPER if of == task]
