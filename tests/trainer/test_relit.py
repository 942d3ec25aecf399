"""Another light for each episode: the same for all of a stack, and nothing else changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3.common.vec_env import VecEnv

from trainer.envs import make_env
from trainer.learners.true_path import TRUE_PATH, WithTruePath
from trainer.presets import preset
from trainer.relit import GAINS, GAMMAS, Relit, draw_light, relit, under


@given(st.integers(0, 2**32 - 1))
def test_a_light_keeps_the_order_of_grey_levels(seed: int) -> None:
    light = draw_light(np.random.default_rng(seed))
    assert light.shape == (256, 3)
    assert (np.diff(light.astype(int), axis=0) >= 0).all()
    assert (light[0] == 0).all()
    brightest = 255.0 * GAINS[1] ** 1.5 * (128 / 255) ** GAMMAS[0]
    assert (light[128] <= brightest).all()


def test_frames_of_a_stack_are_under_one_light() -> None:
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    before = frame.copy()
    lit = relit(np.tile(frame, 4), np.random.default_rng(1))
    np.testing.assert_array_equal(lit, np.tile(lit[..., :3], 4))
    np.testing.assert_array_equal(lit[..., :3], relit(frame, np.random.default_rng(1)))
    np.testing.assert_array_equal(frame, before)
    assert not np.array_equal(lit[..., :3], frame)


@pytest.mark.parametrize("with_path", [False, True])
def test_a_light_lasts_as_long_as_its_episode(with_path: bool) -> None:
    config, cars = preset("track", "ppo", "debug"), 3

    def world() -> VecEnv:
        env = make_env(config, cars, seed=3)
        return WithTruePath(env) if with_path else env

    plain, lit = world(), Relit(world(), np.random.default_rng(0))
    assert lit.observation_space == plain.observation_space
    lights, ended = [light.copy() for light in lit._lights], 0
    seen, shown = plain.reset(), lit.reset()
    for _ in range(150):
        pictures, others = (x["image"] if with_path else x for x in (seen, shown))
        for i, light in enumerate(lights):
            np.testing.assert_array_equal(others[i], under(pictures[i], light))
        if with_path:
            np.testing.assert_array_equal(seen[TRUE_PATH], shown[TRUE_PATH])
        seen, rewards, done, infos = plain.step(np.full(cars, 1))
        shown, same, _, others_infos = lit.step(np.full(cars, 1))
        np.testing.assert_array_equal(rewards, same)
        for i in np.flatnonzero(done):
            lasts = [x[i]["terminal_observation"] for x in (infos, others_infos)]
            last, other = (x["image"] if with_path else x for x in lasts)
            np.testing.assert_array_equal(other, under(last, lights[i]))
            assert not np.array_equal(lit._lights[i], lights[i])
            lights[i], ended = lit._lights[i].copy(), ended + 1
    assert ended
    plain.close()
    lit.close()
