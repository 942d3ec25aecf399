"""How a person steers, in two numbers; and that these tell of bends that nobody drove."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import FIVE_ACTIONS, ImageSpec
from robot.vision.sight import OnnxSight, Seen
from trainer.twin.examples import Examples, shares_of
from trainer.twin.manner import Manner, manner_of

COUNT = 300
BENDS_PM = (40.0 / 3.0, 3.0, 0.0, -3.0, -40.0 / 3.0)


class Eye:
    """Sees in the k-th picture the k-th of some lanes, with the k-th probability of a road."""

    contract = SimpleNamespace(image=ImageSpec(80, 60, 20))

    def __init__(self, lanes: np.ndarray, road: np.ndarray | float = 1.0) -> None:
        self.lanes, self.road = lanes, np.broadcast_to(road, len(lanes))

    def __call__(self, images: np.ndarray) -> Seen:
        assert len(images)
        assert images.shape[1:] == (40, 80, 3)
        which = images[:, 0, 0, :2].astype(int) @ (1, 256)
        figures = np.column_stack((self.lanes[which], np.zeros((len(which), 2))))
        rest = np.zeros((len(which), 5)), np.zeros(len(which)), self.road[which]
        return Seen(figures, *rest, np.zeros((len(which), 5)), np.zeros(len(which)))


def numbered(count: int = COUNT, size: tuple[int, ...] = (40, 80, 3)) -> np.ndarray:
    images = np.zeros((count, *size), np.uint8)
    images[:, 0, 0, 0], images[:, 0, 0, 1] = np.arange(count) % 256, np.arange(count) // 256
    return images


def lanes_of(rng: np.random.Generator, count: int = COUNT) -> np.ndarray:
    return rng.normal(0.0, (0.03, 0.15, 1.5), (count, 3))


def steered(lanes: np.ndarray, ahead_m: float, gain: float) -> np.ndarray:
    """The circle to the point of a bent lane that lies so far ahead, sharper by a factor."""
    offset_m, heading_rad, bend_pm = lanes.T
    left_m = 0.5 * bend_pm * ahead_m**2 - offset_m - heading_rad * ahead_m
    return np.asarray(gain * 2.0 * left_m / ahead_m**2)


def who(bends_pm: np.ndarray, images: np.ndarray | None = None) -> Examples:
    images = numbered(len(bends_pm)) if images is None else images
    shares = shares_of(bends_pm, FIVE_ACTIONS)
    return Examples(images, None, shares, np.ones(len(images)), bends_pm)


def found(eye: Any, person: Examples) -> Manner | None:
    return manner_of(person, cast("OnnxSight", eye))


@given(st.floats(0.15, 1.0), st.floats(0.4, 3.0), st.integers(0, 99))
def test_who_steers_by_a_manner_is_known_by_it(ahead_m: float, gain: float, seed: int) -> None:
    lanes = lanes_of(np.random.default_rng(seed))
    manner = found(Eye(lanes), who(steered(lanes, ahead_m, gain)))
    assert manner is not None
    assert manner.ahead_m == pytest.approx(ahead_m, rel=0.06)
    ours = steered(lanes, manner.ahead_m, manner.gain)
    theirs = steered(lanes, ahead_m, gain)
    assert np.abs(ours - theirs).max() < 0.1 * np.abs(theirs).max()


def test_chance_in_their_steering_makes_nobody_steer_less() -> None:
    """Least squares of what sight errs about and a person does by chance would: bends cut short."""
    rng = np.random.default_rng(1)
    true = lanes_of(rng, 2_000)
    seen = true + rng.normal(0.0, (0.02, 0.1, 1.0), true.shape)
    did_pm = steered(true, 0.4, 1.0) + rng.normal(0.0, 0.5, len(true))
    manner = found(Eye(seen), who(did_pm))
    assert manner is not None
    assert 0.9 < np.std(steered(seen, manner.ahead_m, manner.gain)) / np.std(did_pm) < 1.1


def test_it_tells_actions_of_what_is_in_sight_and_nothing_of_the_rest() -> None:
    lanes = lanes_of(np.random.default_rng(2), 6)
    lanes[5, 0] = 0.2  # turned round: in the oncoming lane
    eye = Eye(lanes, np.array((1.0, 0.9, 0.2, 1.0, 0.6, 1.0)))
    otherwise = np.tile(np.eye(5)[3], (6, 1))
    shares = Manner(cast("OnnxSight", eye), 0.5, 2.0).shares(numbered(6), otherwise)
    assert shares[[2, 5]].tolist() == otherwise[[2, 5]].tolist()
    wanted_pm = np.clip(steered(lanes, 0.5, 2.0), -40.0 / 3.0, 40.0 / 3.0)
    assert (shares @ BENDS_PM)[[0, 1, 3, 4]] == pytest.approx(wanted_pm[[0, 1, 3, 4]], abs=1e-4)
    assert (otherwise == np.eye(5)[3]).all(), "what was given stays"


def test_half_is_as_they_usually_would_but_what_corrects_is_theirs() -> None:
    lanes = lanes_of(np.random.default_rng(6), 4)
    person = who(np.array((3.0, -3.0, 0.0, 3.0)), numbered(4))._replace(
        weights=np.array((1, 4, 1, 4))
    )
    manner = Manner(cast("OnnxSight", Eye(lanes)), 0.5, 1.0)
    usual, told = manner.shares(person.images, person.shares), manner.smoothed(person).shares
    assert told[[1, 3]].tolist() == person.shares[[1, 3]].tolist()
    assert told[[0, 2]] == pytest.approx(0.5 * (usual + person.shares)[[0, 2]])


def test_who_steers_by_something_else_has_none() -> None:
    rng = np.random.default_rng(3)
    lanes = lanes_of(rng)
    did_pm = steered(lanes, 0.4, 1.0)
    assert found(Eye(lanes), who(rng.permutation(did_pm))) is None
    assert found(Eye(lanes), who(-did_pm)) is None, "the wrong way round"
    assert found(Eye(lanes, 0.3), who(did_pm)) is None, "no road in sight"
    assert found(Eye(lanes), who(np.zeros(COUNT))) is None, "never steered"
    other = numbered(size=(36, 64, 3))
    assert found(Eye(lanes), who(did_pm, other)) is None, "pictures of another policy"
    assert found(Eye(lanes), who(did_pm[:0])) is None


def test_pictures_without_a_road_tell_nothing_of_it() -> None:
    rng = np.random.default_rng(5)
    lanes, road = lanes_of(rng), rng.random(COUNT)
    did_pm = np.where(road > 0.5, steered(lanes, 0.4, 1.5), 13.0)
    manner = found(Eye(lanes, road), who(did_pm))
    assert manner is not None
    assert manner[1:] == pytest.approx((0.4, 1.5), rel=0.08)


@pytest.mark.parametrize(("noise", "known"), [(1.5, True), (2.0, False)])
def test_a_quarter_of_what_they_did_must_be_explained(noise: float, known: bool) -> None:
    rng = np.random.default_rng(4)
    lanes = lanes_of(rng, 2_000)
    did_pm = steered(lanes, 0.4, 1.0)
    did_pm = did_pm + noise * did_pm.std() * rng.normal(size=len(did_pm))
    assert (found(Eye(lanes), who(did_pm)) is not None) == known
