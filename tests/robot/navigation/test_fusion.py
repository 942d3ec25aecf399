import math
from typing import List, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.geometry import Pose, between, compose, wrap_angle
from robot.navigation.fusion import FusionConfig, PoseFusion

poses = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3)).map(lambda p: np.array([p]))
NEVER = np.full((1, 3), np.nan)


def position_sd_m(fusion: PoseFusion) -> np.ndarray:
    """(N,) standard deviation of the worse coordinate [m]."""
    return np.sqrt(np.max(fusion._covariance[:, (0, 1), (0, 1)], axis=1))


def drive(
    fusion: PoseFusion, true: np.ndarray, v: float, w: float, now: float, dt: float = 0.1
) -> np.ndarray:
    """Let the filter and the true robot drive the same arc; the new true pose."""
    fusion.move(np.array([v * dt]), np.array([w * dt]), now)
    return np.array([Pose(*true[0]).moved(v * dt, w * dt)])


@given(poses, poses)
def test_between_undoes_compose(start: np.ndarray, step: np.ndarray) -> None:
    assert np.allclose(between(start, compose(start, step)), step, atol=1e-9)


def test_unknown_until_the_first_pose_then_exactly_there() -> None:
    fusion = PoseFusion()
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    assert np.isnan(fusion.poses).all()
    fusion.measure(np.array([[1.0, 2.0, 0.5]]), np.array([0.0]))
    assert np.allclose(fusion.poses, [[1.0, 2.0, 0.5]])
    assert fusion.age_s(0.25)[0] == 0.25


def test_a_late_true_pose_is_carried_forward_by_the_steps() -> None:
    fusion, true, trace = PoseFusion(), np.array([[0.0, 0.0, 0.0]]), []
    for tick in range(40):
        now = 0.1 * tick
        true = drive(fusion, true, 0.3, 1.5, now)
        trace.append(true)
        if tick >= 2:
            fusion.measure(trace[tick - 2], np.array([now - 0.2]))
            assert np.allclose(fusion.poses, true, atol=1e-6)


def test_without_overhead_poses_the_steps_bridge_the_gap_and_doubt_grows() -> None:
    fusion, true = PoseFusion(), np.array([[1.0, 1.0, 0.3]])
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(true, np.array([0.0]))
    doubt = position_sd_m(fusion)[0]
    for tick in range(1, 11):
        true = drive(fusion, true, 0.3, -0.9, 0.1 * tick)
        fusion.measure(NEVER, np.array([-math.inf]))
    assert np.allclose(fusion.poses, true, atol=1e-9)
    assert position_sd_m(fusion)[0] > doubt


def test_an_outlier_is_counted_not_believed() -> None:
    fusion, true = PoseFusion(), np.array([[1.0, 1.0, 0.0]])
    for tick in range(30):
        true = drive(fusion, true, 0.2, 0.0, 0.1 * tick)
        fusion.measure(true, np.array([0.1 * tick]))
    before = fusion.poses.copy()
    fusion.move(np.zeros(1), np.zeros(1), 3.0)
    fusion.measure(true + np.array([[0.6, -0.5, 0.0]]), np.array([3.0]))
    assert np.allclose(fusion.poses, before)
    assert fusion.rejected[0] == 1


def test_a_repeated_or_older_picture_changes_nothing() -> None:
    fusion = PoseFusion()
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([[0.0, 0.0, 0.0]]), np.array([0.0]))
    fusion.move(np.zeros(1), np.zeros(1), 0.1)
    fusion.measure(np.array([[0.02, 0.0, 0.0]]), np.array([0.0]))
    assert np.allclose(fusion.poses, 0.0)


def test_a_picture_older_than_its_memory_finds_no_lost_robot_and_loses_no_place() -> None:
    fusion, config = PoseFusion(), FusionConfig()
    for tick in range(100):
        fusion.move(np.full(1, 0.01), np.zeros(1), 0.1 * tick)
        if tick < 50:
            fusion.measure(np.array([[0.01 * tick, 0.0, 0.0]]), np.array([0.1 * tick]))
    fusion.rejected[:] = config.rejections
    before = fusion.poses.copy()
    fusion.measure(np.array([[2.0, 2.0, 0.0]]), np.array([9.9 - 4.5]))
    assert np.array_equal(fusion.poses, before)
    assert fusion.rejected[0] == config.rejections + 1
    fusion.measure(np.array([[2.0, 2.0, 0.0]]), np.array([9.9]))
    assert np.allclose(fusion.poses, [[2.0, 2.0, 0.0]])


def test_a_position_without_heading_still_corrects_the_position() -> None:
    fusion = PoseFusion()
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([[0.0, 0.0, 0.2]]), np.array([0.0]))
    for tick in range(1, 200):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * tick)
        fusion.measure(np.array([[0.04, 0.0, np.nan]]), np.array([0.1 * tick]))
    assert 0.01 < fusion.poses[0, 0] < 0.04
    assert abs(fusion.poses[0, 2] - 0.2) < 1e-6


def test_robots_do_not_disturb_each_other() -> None:
    both, alone = PoseFusion(2), PoseFusion(1)
    rng = np.random.default_rng(0)
    for tick in range(50):
        forward, turn = rng.uniform(0, 0.03, 2), rng.uniform(-0.2, 0.2, 2)
        measured = rng.normal(0, 0.02, (2, 3))
        now = 0.1 * tick
        both.move(forward, turn, now)
        alone.move(forward[:1], turn[:1], now)
        captured = np.array([now, -math.inf])
        measured[1] = np.nan
        both.measure(measured, captured)
        alone.measure(measured[:1], captured[:1])
    assert np.allclose(both.poses[0], alone.poses[0])
    assert np.isnan(both.poses[1]).all()


def test_fusion_undoes_delay_gaps_and_outliers() -> None:
    """3 cm and 5 degrees drifting over 2 s, 200 ms late, with gaps; steps 3 % and turns 5 % off."""
    rms_m, late_rms_m, fusion, _ = drift_along(scale_sd=0.03, scrub_sd=0.05, drift_sd=0.0)
    assert rms_m < 0.035
    assert rms_m < 0.7 * late_rms_m
    assert 0.5 < rms_m / position_sd_m(fusion).mean() < 2.0, "the filter knows how good it is"


def test_fusion_learns_how_a_robot_drives() -> None:
    """Turns 10 % off, and wheels whose difference turns the robot by 0.3 rad in a metre."""
    rms_m, late_rms_m, fusion, turned = drift_along(scale_sd=0.05, scrub_sd=0.1, drift_sd=0.3)
    assert rms_m < 0.04
    assert rms_m < 0.75 * late_rms_m
    assert 0.5 < rms_m / position_sd_m(fusion).mean() < 2.0
    first, last = turned[20:60], turned[-100:]
    assert np.sqrt(np.mean(last**2)) < 0.85 * np.sqrt(np.mean(first**2))


def drift_along(
    scale_sd: float, scrub_sd: float, drift_sd: float
) -> Tuple[float, float, PoseFusion, np.ndarray]:
    """Error of the filter [m], of the late poses [m], the filter, heading errors (T, N) [rad]."""
    rng, count, dt = np.random.default_rng(1), 40, 0.1
    fusion, true, error = PoseFusion(count), np.zeros((count, 3)), np.zeros((count, 3))
    scale, scrub = rng.normal(1, scale_sd, count), rng.normal(1, scrub_sd, count)
    drift = rng.normal(0, drift_sd, count)  # [rad/m]
    deviation, keep = np.array([0.03, 0.03, math.radians(5)]), math.exp(-dt / 2.0)
    seen, squared, late, turned = [], [], [], []
    for tick in range(300):
        turn = 1.2 * np.sin(0.05 * tick + np.arange(count)) * dt
        forward = np.full(count, 0.28 * dt)
        true = compose(true, np.stack((forward, 0 * forward, turn), axis=1))
        fresh = rng.normal(0, deviation, (count, 3))
        error = keep * error + math.sqrt(1 - keep**2) * fresh
        seen.append(true + error)
        if rng.random() < 0.005:
            seen[-1][:, :2] += rng.uniform(-1, 1, (count, 2))
        fusion.move(forward * scale, turn * scrub + drift * forward, tick * dt)
        if tick >= 2 and tick % 40 < 32:  # then a gap of 0.8 s
            fusion.measure(seen[tick - 2], np.full(count, (tick - 2) * dt))
            squared.append((fusion.poses - true)[:, :2] ** 2)
            late.append((seen[tick - 2] - true)[:, :2] ** 2)
            turned.append(np.asarray(wrap_angle((fusion.poses - true)[:, 2])))
    rms_m, late_rms_m = math.sqrt(np.mean(squared[50:])), math.sqrt(np.mean(late[50:]))
    return rms_m, late_rms_m, fusion, np.array(turned)


def test_overhead_poses_with_fresh_errors_are_averaged() -> None:
    """A localizer better than configured, whose errors do not drift."""
    rng, fusion, true = np.random.default_rng(0), PoseFusion(20), np.zeros((20, 3))
    errors = []
    for tick in range(200):
        true = compose(true, np.tile([0.03, 0.0, 0.05], (20, 1)))
        fusion.move(np.full(20, 0.03), np.full(20, 0.05), 0.1 * tick)
        measured = true + rng.normal(0, [0.015, 0.015, 0.04], (20, 3))
        fusion.measure(measured, np.full(20, 0.1 * tick))
        errors.append((fusion.poses - true)[:, :2])
    assert math.sqrt(np.mean(np.square(errors[50:]))) < 0.011


def test_a_robot_that_was_carried_away_is_found_again() -> None:
    fusion, config = PoseFusion(), FusionConfig()
    for tick in range(20):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * tick)
        fusion.measure(np.array([[0.0, 0.0, 0.0]]), np.array([0.1 * tick]))
    for tick in range(20, 21 + config.rejections):
        fusion.move(np.zeros(1), np.zeros(1), 0.1 * tick)
        fusion.measure(np.array([[2.0, 1.0, 1.0]]), np.array([0.1 * tick]))
    assert np.allclose(fusion.poses, [[2.0, 1.0, 1.0]])


def held_fast(fusion: PoseFusion, seconds: float, begin_s: float = 0.0) -> None:
    """Steps of 0.3 m/s, and overhead poses that stay where they are."""
    for tick in range(round(10 * seconds)):
        now = begin_s + 0.1 * (tick + 1)
        fusion.move(np.array([0.03]), np.array([0.0]), now)
        fusion.measure(np.array([[1.0, 1.0, 0.4]]), np.array([now]))


def known_robot() -> PoseFusion:
    fusion = PoseFusion()
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.measure(np.array([[1.0, 1.0, 0.4]]), np.array([0.0]))
    return fusion


def test_who_is_reset_knows_neither_a_place_nor_when_it_was_seen() -> None:
    fusion = known_robot()
    fusion.rejected[:] = 3
    fusion.reset(np.arange(1))
    assert np.isnan(fusion.poses).all()
    assert (fusion.age_s(9.0)[0], fusion.rejected[0]) == (math.inf, 0)


def scale_of(fusion: PoseFusion) -> float:
    """How far the filter says that a robot drives which steps a metre ahead [m]."""
    before = fusion.poses.copy()
    for tick in range(10):
        fusion.move(np.array([0.1]), np.array([0.0]), 1000.0 + 0.01 * tick)
    return float(np.hypot(*(fusion.poses - before)[0, :2]))


def test_no_scale_explains_a_robot_that_stands_while_it_steps() -> None:
    fusion = known_robot()
    held_fast(fusion, 1.4)
    assert fusion.at_bound[0]
    assert 0.79 < scale_of(fusion) < 0.81


def test_wheels_that_are_off_by_what_wheels_can_be_are_no_doubt() -> None:
    for scale, scrub, drift in ((0.86, 1.2, 1.0), (1.14, 0.8, -1.0)):
        fusion, true, rng = known_robot(), np.array([[1.0, 1.0, 0.4]]), np.random.default_rng(5)
        error, keep = np.zeros(3), math.exp(-0.05)
        for tick in range(1, 400):
            forward, turn = 0.028, 0.12 * math.sin(0.05 * tick)
            moved = np.array([[scale * forward, 0.0, scrub * turn + drift * forward]])
            true = compose(true, moved)
            fresh = rng.normal(0, (0.03, 0.03, math.radians(5)), 3)
            error = keep * error + math.sqrt(1 - keep**2) * fresh
            fusion.move(np.array([forward]), np.array([turn]), 0.1 * tick)
            fusion.measure(true + error, np.array([0.1 * tick]))
            assert not fusion.at_bound[0]


@given(
    st.lists(st.tuples(st.floats(-0.04, 0.04), st.floats(-0.3, 0.3), poses), max_size=30),
)
def test_calibration_stays_within_its_bounds_whatever_comes(
    turns: List[Tuple[float, float, np.ndarray]],
) -> None:
    fusion = known_robot()
    for tick, (forward, turn, seen) in enumerate(turns, 1):
        fusion.move(np.array([forward]), np.array([turn]), 0.1 * tick)
        fusion.measure(seen, np.array([0.1 * tick]))
        assert (np.abs(fusion._state[0, 3:6]) <= (0.2, 0.35, 1.4)).all()
        assert np.isfinite(fusion.poses).all()


def test_what_a_fault_taught_is_forgotten_but_not_the_place() -> None:
    fusion = known_robot()
    held_fast(fusion, 1.4)
    before, doubt_m = fusion.poses.copy(), position_sd_m(fusion).copy()
    fusion.relearn(np.arange(1))
    assert np.allclose(fusion.poses, before)
    assert np.allclose(position_sd_m(fusion), doubt_m)
    assert not fusion.at_bound[0]
    assert abs(scale_of(fusion) - 1.0) < 0.001


def test_a_robot_found_again_elsewhere_learns_anew() -> None:
    fusion = known_robot()
    held_fast(fusion, 1.4)
    for tick in range(7):
        now = 1.5 + 0.1 * tick
        fusion.move(np.zeros(1), np.zeros(1), now)
        fusion.measure(np.array([[3.0, 2.0, 1.0]]), np.array([now]))
    assert np.allclose(fusion.poses, [[3.0, 2.0, 1.0]], atol=0.01)
    assert abs(scale_of(fusion) - 1.0) < 0.02


def put_at_origin() -> PoseFusion:
    """By a word that is true to 5 cm and a tenth of a radian."""
    fusion = PoseFusion()
    fusion.move(np.zeros(1), np.zeros(1), 0.0)
    fusion.put(np.arange(1), np.zeros((1, 3)), (0.05, 0.05, 0.1))
    return fusion


def test_who_was_put_somewhere_takes_an_overhead_pose_for_as_good_as_it_is() -> None:
    fusion = put_at_origin()
    assert fusion.certainty[0] == pytest.approx((2.448 * 0.05, 1.96 * 0.1), rel=1e-3)
    assert fusion.scale_deviations[0] == pytest.approx(0.05)
    fusion.measure(np.array([[0.06, 0.0, 0.0]]), np.zeros(1))
    share = 0.05**2 / (0.05**2 + 0.03**2 + 0.015**2)  # of its error half is new
    assert fusion.poses[0, 0] == pytest.approx(0.06 * share)


def test_who_backs_grows_as_unsure_as_who_drives_ahead() -> None:
    ahead, back = put_at_origin(), put_at_origin()
    for fusion, step_m in ((ahead, 0.03), (back, -0.03)):
        for tick in range(1, 30):
            fusion.move(np.array([step_m]), np.zeros(1), 0.1 * tick)
    assert np.allclose(back.certainty, ahead.certainty)
    assert (back.certainty > put_at_origin().certainty).all()


def test_a_pose_that_is_not_believed_is_no_newer_one() -> None:
    fusion = known_robot()
    fusion.move(np.zeros(1), np.zeros(1), 0.5)
    fusion.measure(np.array([[3.0, 1.0, 0.4]]), np.array([0.5]))
    assert (fusion.rejected[0], fusion.age_s(0.5)[0]) == (1, 0.5)


def test_a_picture_of_after_the_last_steps_is_one_of_the_last_steps() -> None:
    early, late = known_robot(), known_robot()
    for fusion, captured_s in ((early, 0.1), (late, 0.15)):
        fusion.move(np.full(1, 0.03), np.full(1, 0.2), 0.1)
        fusion.measure(np.array([[1.05, 1.0, 0.5]]), np.array([captured_s]))
    assert np.allclose(late.poses, early.poses)


def test_what_a_bound_takes_from_the_wheels_it_takes_from_the_place_too() -> None:
    """Simon, section 2.3, by hand: x and the scale of the way err alike."""
    fusion = put_at_origin()
    covariance = fusion._covariance[0]
    covariance[0, 0] = covariance[3, 3] = 0.01
    covariance[0, 3] = covariance[3, 0] = 0.009

    def compare(poses: np.ndarray, since: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array([[0.56]]), np.eye(9)[None, :1], np.array([[[0.01]]])

    fusion.correct(compare, np.zeros(1), np.ones(1, dtype=bool))
    beyond = 0.56 * 0.009 / 0.02 - 0.2
    share = (0.009 - 0.009 / 2.0) / (0.01 - 0.009**2 / 0.02)
    assert fusion._state[0, 3] == pytest.approx(0.2)
    assert fusion.poses[0, 0] == pytest.approx(0.28 - share * beyond)
