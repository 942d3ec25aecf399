"""The figures of the way check on drives without chance, worked out once.

Whatever changes one of them changes what is doubted, and with it the rates in docs/plausibility.md.
"""

from __future__ import annotations

import math
from typing import Callable, Dict, List, Tuple

import numpy as np
import pytest

from robot.geometry import Pose
from robot.navigation.way_check import WayCheck

Spoil = Callable[[int, np.ndarray], np.ndarray]  # tick, pose -> pose


def drive(spoil: Spoil, white_m: float, wheels: float = 1.0) -> List[Tuple[float, float, bool]]:
    """Coarse and fine doubt and whether it stands, at every tick of 0.1 s; pictures are older.

    ``wheels``: how far they drive for a metre that they count.
    """
    way, true, odometry = WayCheck(), Pose(1.0, 2.0, 0.4), Pose(-2.0, 0.5, 2.9)
    told = []
    for tick in range(90):
        speed_mps = 0.3 * min(1.0, tick / 6.0) * (0.6 if 30 <= tick < 45 else 1.0)
        turn_rad = 0.12 * math.sin(0.27 * tick)
        odometry = odometry.moved(0.1 * speed_mps, turn_rad)
        true = true.moved(0.1 * wheels * speed_mps, 1.03 * turn_rad)
        way.stepped(10.0 + 0.1 * tick, odometry)
        if tick % 7 == 3:
            continue  # a picture was lost
        noise = [math.sin(2.1 * tick * tick + k) for k in range(3)]
        seen = np.array(true) + white_m * np.array(noise) * (1.0, 1.0, 3.0)
        way.see(10.0 + 0.1 * tick - 0.037, Pose(*spoil(tick, seen)))
        told.append((way.doubt.coarse, way.doubt.fine, way.doubt.stands))
    return told


def honest(_: int, seen: np.ndarray) -> np.ndarray:
    return seen


def drifting(tick: int, seen: np.ndarray) -> np.ndarray:
    return seen + max(0, tick - 60) * np.array([0.004, 0.002, 0.003])


def aside(tick: int, seen: np.ndarray) -> np.ndarray:
    return seen + (np.array([-0.05, 0.06, 0.0]) if 50 <= tick < 56 else 0.0)


def held(tick: int, seen: np.ndarray) -> np.ndarray:
    return np.array([1.9, 2.1, 0.5]) if tick >= 70 else seen


CASES: Dict[str, Tuple[Spoil, float, float]] = {
    "honest": (honest, 0.001, 1.0),
    "noisy": (honest, 0.02, 1.0),
    "worn": (honest, 0.0005, 0.93),
    "drifting": (drifting, 0.001, 0.96),
    "aside": (aside, 0.002, 1.02),
    "held": (held, 0.004, 1.0),
}
FIGURES: Dict[str, List[float]] = {  # coarse and fine, at seven moments
    "honest": [
        0.00086394,
        0.0,
        0.0044354,
        0.0,
        0.0046845,
        0.0024096,
        0.0033893,
        0.0026914,
        0.0053932,
        0.012929,
        0.0042565,
        0.0020775,
        0.0031703,
        0.0010713,
    ],
    "noisy": [
        0.0013455,
        0.0,
        0.017812,
        0.0,
        0.0095049,
        0.0,
        0.060462,
        0.0,
        0.029081,
        0.0,
        0.019367,
        0.0,
        0.024403,
        0.0,
    ],
    "worn": [
        0.0019503,
        0.0,
        0.022285,
        0.0,
        0.022835,
        0.22242,
        0.0067081,
        0.0042111,
        0.016932,
        0.0063977,
        0.020782,
        0.00045907,
        0.018659,
        0.00048296,
    ],
    "drifting": [
        0.0004507,
        0.0,
        0.010629,
        0.0,
        0.010886,
        0.075365,
        0.0031101,
        0.0045499,
        0.007834,
        0.012551,
        0.02274,
        1.1911,
        0.062702,
        5.6807,
    ],
    "aside": [
        0.0022597,
        0.0,
        0.0049045,
        0.0,
        0.0047858,
        0.0029104,
        0.0056492,
        0.010635,
        0.0078915,
        0.022543,
        0.10285,
        3.6023,
        0.00449,
        0.0052318,
    ],
    "held": [
        0.00054866,
        0.0,
        0.0040974,
        0.0,
        0.0040168,
        0.0,
        0.0034461,
        0.0,
        0.0051875,
        0.0,
        0.0058774,
        0.0,
        44.12,
        0.0,
    ],
}


def figures(name: str) -> List[float]:
    told = drive(*CASES[name])
    return [value for row in told[9::10] for value in row[:2]]


@pytest.mark.parametrize("name", CASES)
def test_the_figures_of_a_drive(name: str) -> None:
    assert figures(name) == pytest.approx(FIGURES[name], rel=2e-4)
    assert sum(stands for _, _, stands in drive(*CASES[name])) == (3 if name == "held" else 0)
