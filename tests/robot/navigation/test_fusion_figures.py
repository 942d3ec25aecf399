"""The figures of the filter on a drive without chance, worked out once.

The simulator runs this filter for every robot that learns; whatever changes a figure changes what
was learned with it.
"""

from __future__ import annotations

import math
from typing import List

import numpy as np
import pytest

from robot.navigation.fusion import FusionConfig, PoseFusion, compose
from tests.robot.navigation.test_fusion import position_sd_m


def test_what_the_filter_takes_for_granted() -> None:
    config = FusionConfig()
    assert (config.position_m, config.correlation_s, config.jitter) == (0.03, 2.0, 0.5)
    assert math.degrees(config.heading_rad) == pytest.approx(5.0)
    assert (config.forward_scale, config.turn_scale, config.drift_rad_per_m) == (0.05, 0.1, 0.2)
    assert config.bounds == (0.2, 0.35, 1.4)
    assert (config.step_noise, config.turn_noise, config.wander_rad) == (0.02, 0.05, 0.1)
    assert (config.gate, config.rejections) == (16.3, 5)


def figures() -> List[List[float]]:
    """Of two robots, every two seconds: poses, how sure, how far off their wheels, rejected.

    Pictures are late and sometimes missing, or far off; one has no heading; robot 1 is carried away
    after eight seconds and its filter begun anew after ten.
    """
    fusion, true, told = PoseFusion(2), np.array([[1.0, 2.0, 0.5], [0.0, -1.0, 3.0]]), []
    past = []
    for tick in range(140):
        now_s = 5.0 + 0.1 * tick
        forward = np.array([0.03, 0.02 + 0.01 * math.sin(0.3 * tick)])
        turn = np.array([0.1 * math.sin(0.21 * tick), -0.05])
        way = np.stack((1.06 * forward, 0.0 * forward, 0.9 * turn + 0.15 * forward), axis=1)
        true = compose(true, way)
        past.append(true)
        fusion.move(forward, turn, now_s)
        if tick == 80:
            true = true + np.array([[0.0, 0.0, 0.0], [0.7, -0.4, 1.0]])
        if tick == 100:
            fusion.reset(np.array([1]))
        if tick == 120:
            fusion.relearn(np.array([True, False]))
        if tick >= 2 and tick % 5 != 4:
            noise = [[math.sin(1.7 * tick * tick + 5 * k + j) for j in range(3)] for k in range(2)]
            measured = past[tick - 2] + np.array(noise) * (0.02, 0.02, 0.05)
            if tick % 31 == 13:
                measured[0, 0] += 0.9
            measured[1, 2] = math.nan if tick % 7 == 3 else measured[1, 2]
            measured[1] = math.nan if tick % 11 == 5 else measured[1]
            fusion.measure(measured, np.array([now_s - 0.2, now_s - 0.17]))
        if tick % 20 == 19:
            rows = (*fusion.poses.ravel(), *position_sd_m(fusion), *fusion._state[:, 3:6].ravel())
            told.append([*rows, *fusion.rejected, *fusion.age_s(now_s)])
    return told


def test_the_figures_of_a_drive() -> None:
    np.testing.assert_allclose(figures(), FIGURES, rtol=2e-4, atol=2e-6)


FIGURES: List[List[float]] = [
    [
        1.30565, 2.49998, 1.21361, -0.360154, -0.821305, 2.12785,
        0.031157, 0.0281439, 0.00868731, -0.000137865, -0.0231575, 0.0104454,
        -0.0124928, 0.0257545, 0.0, 0.0, 0.3, 0.27,
    ],
    [
        1.69158, 2.97349, 1.27116, -0.461365, -0.419055, 1.27834,
        0.030364, 0.0277103, 0.0216744, -0.057807, 0.0842031, 0.0257029,
        -0.0532377, 0.0717804, 0.0, 0.0, 0.3, 0.37,
    ],
    [
        1.89514, 3.56844, 0.75186, -0.242818, -0.0692995, 0.50861,
        0.0305932, 0.0264254, 0.0446126, -0.0695649, 0.117531, 0.0366521,
        -0.0894693, 0.107154, 0.0, 0.0, 0.3, 0.27,
    ],
    [
        2.04826, 4.15244, 1.49897, 0.166126, -0.0176143, -0.323543,
        0.0312203, 0.0270365, 0.0490129, -0.0799498, 0.115471, 0.0358272,
        -0.0989126, 0.107134, 0.0, 0.0, 0.3, 0.27,
    ],
    [
        2.28887, 4.71052, 1.55145, 1.28891, -0.319558, -0.235888,
        0.0309199, 0.0294336, 0.0459337, -0.0886144, 0.124417, 0.00232447,
        -0.0168121, 0.0339527, 0.0, 0.0, 0.3, 0.27,
    ],
    [
        2.32514, 5.32721, 1.01014, 1.62804, -0.550483, -1.03525,
        0.0309894, 0.0282994, 0.0514927, -0.0815108, 0.12967, 0.0115388,
        -0.0565839, 0.0842797, 0.0, 0.0, 0.3, 0.27,
    ],
    [
        2.31953, 5.91497, 1.73063, 1.68323, -0.958799, -1.86338,
        0.0312307, 0.0284896, 0.0115962, 0.000974803, -0.019634, 0.0207529,
        -0.0739735, 0.122235, 0.0, 0.0, 0.3, 0.27,
    ],
]  # fmt: skip
