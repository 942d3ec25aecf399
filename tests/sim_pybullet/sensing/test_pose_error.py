import math

import numpy as np

from sim_pybullet.look import ARENA_POSE, PoseLook
from sim_pybullet.sensing.guidance_feed import PoseError

DT = 0.1


def run(look: PoseLook, ticks: int, seed: int = 0, count: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Errors (T, N, 3) against the pose at capture time, and delays (T, N); NaN where none came."""
    rng, model = np.random.default_rng(seed), PoseError(count)
    for robot in range(count):
        model.reset(robot, look, rng)
    errors, delays = [], []
    for tick in range(ticks):
        true = np.full((count, 3), 0.01 * tick)
        true[:, 2] = 0.0
        told, captured_s = model.observe(true, tick * DT, rng)
        at_capture = np.where(np.isfinite(captured_s), captured_s / DT * 0.01, 0.0)
        errors.append(told - np.stack((at_capture, at_capture, 0 * at_capture), axis=1))
        delays.append(np.where(np.isfinite(captured_s), tick * DT - captured_s, np.nan))
    return np.array(errors), np.array(delays)


def test_no_error_is_the_true_pose_at_once() -> None:
    errors, delays = run(PoseLook(), 50)
    assert np.allclose(errors, 0.0)
    assert np.allclose(delays, 0.0)


def test_delay_is_what_it_says() -> None:
    _, delays = run(PoseLook(delay_s=0.2), 50)
    assert np.isnan(delays[:2]).all()
    assert np.allclose(delays[2:], 0.2)


def test_errors_have_their_size_and_drift_over_two_seconds() -> None:
    look = PoseLook(position_m=0.03, heading_rad=math.radians(5))
    errors, _ = run(look, 2000, count=20)
    assert np.allclose(errors.std(axis=(0, 1)), [0.03, 0.03, math.radians(5)], rtol=0.1)
    lag = round(2.0 / DT)
    kept = np.mean(errors[lag:] * errors[:-lag]) / np.mean(errors**2)
    assert abs(kept - math.exp(-1)) < 0.08


def test_gaps_are_no_longer_than_promised_and_outliers_as_rare() -> None:
    errors, _ = run(ARENA_POSE, 6000, count=5)
    missing = np.isnan(errors[10:, :, 0])
    rows = ["".join("01"[int(m)] for m in row) for row in missing.T]
    longest = max(len(gap) for row in rows for gap in row.split("0"))
    assert 0.3 < longest * DT <= 1.1
    share = np.mean(np.abs(errors[10:][~missing][:, :2]).max(axis=1) > 0.2)
    assert 0.002 < share < 0.008


def test_the_same_seed_gives_the_same_errors() -> None:
    one, two = run(ARENA_POSE, 100, seed=4)[0], run(ARENA_POSE, 100, seed=4)[0]
    assert np.array_equal(one, two, equal_nan=True)
