"""Another light for each picture: the same for all of a stack, and nothing else changes."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3.common.vec_env import VecEnv

from trainer.envs import make_env
from trainer.learners.world import TRUE_PATH, under_other_lights, with_true_path
from trainer.presets import preset
from trainer.relit import GAINS, GAMMAS, draw_light, relit


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
def test_whatever_is_seen_is_relit_and_nothing_else_changes(with_path: bool) -> None:
    config, cars = preset("track", "ppo", "debug"), 3

    def world() -> VecEnv:
        env = make_env(config, cars, seed=3)
        return with_true_path(env) if with_path else env

    plain, lit, rng = (
        world(),
        under_other_lights(world(), np.random.default_rng(0)),
        np.random.default_rng(0),
    )
    assert lit.observation_space == plain.observation_space

    def compare(seen: Any, shown: Any) -> None:
        """One picture or all of them, in the order in which lights are drawn."""
        if with_path:
            np.testing.assert_array_equal(seen[TRUE_PATH], shown[TRUE_PATH])
            seen, shown = seen["image"], shown["image"]
        pair = (np.reshape(x, (-1, *x.shape[-3:])) for x in (seen, shown))
        for picture, other in zip(*pair, strict=True):
            np.testing.assert_array_equal(other, relit(picture, rng))

    compare(plain.reset(), lit.reset())
    ended = 0
    for _ in range(120):
        seen, rewards, done, infos = plain.step(np.full(cars, 1))
        shown, same, _, others = lit.step(np.full(cars, 1))
        np.testing.assert_array_equal(rewards, same)
        for i in np.flatnonzero(done):
            compare(infos[i]["terminal_observation"], others[i]["terminal_observation"])
            ended += 1
        compare(seen, shown)
    assert ended
    plain.close()
    lit.close()
