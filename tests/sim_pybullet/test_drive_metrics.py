"""The driving metrics of drives that one can work out by hand."""

import numpy as np
import pytest

from sim_pybullet.batch import DriveRecorder


def test_a_drive_worked_out_by_hand() -> None:
    recorder = DriveRecorder(2)
    half = np.full(2, 0.1)
    for offset in (0.0, 0.05, -0.05, 0.2):
        recorder.add(np.full(2, 0.03), np.array([offset, 0.0]), half)
    crooked, straight = recorder.metrics(0), recorder.metrics(1)
    assert crooked.driven_lane_m == pytest.approx(0.09)
    assert crooked.survival_time_s == pytest.approx(0.4)
    assert crooked.deviation_m_s == pytest.approx(0.03)
    assert crooked.outside_lane_s == pytest.approx(0.1)
    assert crooked.mean_offset_m == pytest.approx(0.075)
    assert straight == pytest.approx((0.12, 0.4, 0.0, 0.0, 0.0))


def test_begin_forgets_only_these_robots() -> None:
    recorder = DriveRecorder(2)
    recorder.add(np.full(2, 0.03), np.zeros(2), np.full(2, 0.1))
    recorder.begin(np.array([1]))
    assert recorder.metrics(0).driven_lane_m == pytest.approx(0.03)
    assert recorder.metrics(1) == (0.0, 0.0, 0.0, 0.0, 0.0)
