"""Policies beside a person who drove: cameras lifted, leanings told."""

import numpy as np
import pytest

from robot.contract import ACTION_WHEELS, FRAME_HEIGHT_PX, FRAME_WIDTH_PX, Action
from robot.lens import CameraRig
from sim_pybullet.look import NOMINAL
from trainer.experiments.photographs.higher_camera import higher_view, lifted
from trainer.experiments.photographs.steering import leaning

RIG = NOMINAL.rig()
CAMERA = CameraRig(RIG.lens.scaled(FRAME_WIDTH_PX, FRAME_HEIGHT_PX), RIG.mount)


def test_from_as_high_up_nothing_changes() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    seen = lifted(frame, higher_view(RIG, 1.0)).astype(int)
    assert np.abs(seen - frame).max() <= 1


@pytest.mark.parametrize("times", [1.5, 2.0, 3.0])
def test_from_higher_up_a_road_is_narrower_by_as_much(times: float) -> None:
    view = higher_view(RIG, times)
    rows, columns = np.mgrid[70:118:6, 10:150:10]
    seen_at = CAMERA.to_floor(np.stack((columns, rows), axis=-1).astype(float))
    lies_at = CAMERA.to_floor(view[rows, columns].astype(float))
    foot = CAMERA.mount.position_m[:2]
    np.testing.assert_allclose(lies_at - foot, times * (seen_at - foot), rtol=0.01, atol=1e-3)


def test_what_is_above_the_horizon_stays() -> None:
    view = higher_view(RIG, 2.0)
    np.testing.assert_allclose(view[5, 80], (80.0, 5.0), atol=0.1)


def test_a_policy_leans_where_its_best_action_turns() -> None:
    for action in Action:
        values = np.full((1, len(Action)), -1.0)
        values[0, action] = 5.0
        left, right = ACTION_WHEELS[action]
        assert np.sign(np.round(leaning(values)[0], 2)) == np.sign(left - right)
    some = np.random.default_rng(0).normal(size=(20, len(Action)))
    np.testing.assert_allclose(leaning(7.0 * some + 3.0), leaning(some))
    assert np.abs(leaning(some)).max() <= 1.0
