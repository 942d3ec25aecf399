"""CycleGAN learns a toy: stripes on dark blue ground, and stripes on warm ground."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from trainer.presets import preset
from trainer.transfer.cyclegan import Batch, CycleGan, TranslationConfig, adversarial
from trainer.transfer.networks import PictureTranslator, as_bytes

CPU = torch.device("cpu")
HEIGHT, WIDTH = 16, 24
BLUE, WARM = torch.tensor([-0.8, -0.8, -0.2]), torch.tensor([0.2, -0.2, -0.8])
STEPS = 60


def stripes(ground: torch.Tensor, count: int, generator: torch.Generator) -> torch.Tensor:
    """(N, 3, H, W): a bright stripe somewhere on the ground."""
    pictures = ground[None, :, None, None].expand(count, 3, HEIGHT, WIDTH).clone()
    for picture, column in zip(
        pictures, torch.randint(2, WIDTH - 5, (count,), generator=generator), strict=True
    ):
        picture[:, :, int(column) : int(column) + 3] = 0.9
    return pictures


def config(**changes: float) -> TranslationConfig:
    image = preset("lane", "dueling", "debug").image
    base: dict[str, object] = {
        "width": 6, "critic_width": 8, "steps": STEPS, "batch": 4, "learning_rate": 4e-3,
        "decay_from": 1.0, "identity": 0.0, "structure": 0.0,
    }  # fmt: skip
    return TranslationConfig(("sim",), ("real",), image, **{**base, **changes})  # type: ignore[arg-type]


def batch(generator: torch.Generator, count: int = 4) -> Batch:
    sim, real = (stripes(ground, count, generator) for ground in (BLUE, WARM))
    return Batch(sim, real, torch.zeros(count, 4, HEIGHT, WIDTH))


@pytest.fixture(scope="module")
def taught() -> CycleGan:
    torch.set_num_threads(1)
    model, generator = CycleGan(config(), CPU), torch.Generator().manual_seed(0)
    rng = np.random.default_rng(0)
    for k in range(STEPS):
        model.step(batch(generator), rng, k)
    return model


def ground_of(pictures: torch.Tensor) -> torch.Tensor:
    """(3,) the median colour."""
    return pictures.permute(1, 0, 2, 3).flatten(1).median(dim=1).values


@torch.no_grad()
def test_both_ways_take_on_the_others_colours(taught: CycleGan) -> None:
    test = batch(torch.Generator().manual_seed(9), 16)
    far = float((WARM - BLUE).norm())
    assert float((ground_of(taught.to_real(test.sim)) - WARM).norm()) < 0.4 * far
    assert float((ground_of(taught.to_sim(test.real)) - BLUE).norm()) < 0.4 * far


@torch.no_grad()
def test_what_was_there_stays_there_and_comes_back(taught: CycleGan) -> None:
    test = batch(torch.Generator().manual_seed(9), 16)
    there = taught.to_real(test.sim)
    bright = test.sim.mean(1) > 0.5
    assert float(there.mean(1)[bright].mean()) > float(there.mean(1)[~bright].mean()) + 0.5
    assert float((taught.to_sim(there) - test.sim).abs().mean()) < 0.2


@torch.no_grad()
def test_critics_tell_their_domain_from_the_other(taught: CycleGan) -> None:
    test = batch(torch.Generator().manual_seed(9), 16)
    for critic, own, other in (
        (taught.real_critic, test.real, test.sim),
        (taught.sim_critic, test.sim, test.real),
    ):
        assert float(critic(own).mean()) > float(critic(other).mean()) + 0.2


def test_a_cycle_that_is_broken_is_mended() -> None:
    """One domain for both, so nothing but the cycle says what generators should do."""
    model, generator = CycleGan(config(), CPU), torch.Generator().manual_seed(0)
    with torch.no_grad():
        for network in (model.to_real, model.to_sim):
            for parameter in network.parameters():
                parameter.add_(0.1 * torch.randn(parameter.shape, generator=generator))
    losses, rng = [], np.random.default_rng(0)
    for k in range(40):
        one = batch(generator)
        losses.append(model.step(Batch(one.sim, one.sim, one.paint), rng, k)["cycle"])
    assert sum(losses[-5:]) < 0.55 * sum(losses[:5])


def test_the_weights_of_the_losses_count() -> None:
    """By what a step does to the generators: each weight alone must change it."""

    def after(**changes: float) -> torch.Tensor:
        model, generator = CycleGan(config(**changes), CPU), torch.Generator().manual_seed(3)
        rng = np.random.default_rng(0)
        for k in range(3):
            one = batch(generator)
            paint = (one.sim.mean(1, keepdim=True) > 0.5).float().expand(-1, 4, -1, -1)
            model.step(Batch(one.sim, one.real, paint), rng, k)
        return torch.cat([p.detach().flatten() for p in model.to_real.parameters()])

    plain = after()
    for changed in (after(cycle=0.0), after(identity=5.0), after(structure=5.0)):
        assert not torch.allclose(plain, changed, atol=1e-4)


def test_scores_of_one_are_real_and_of_zero_are_not() -> None:
    ones, zeros = torch.ones(2, 1, 3, 3), torch.zeros(2, 1, 3, 3)
    assert adversarial(ones, True) == adversarial(zeros, False) == 0.0
    assert adversarial(zeros, True) == adversarial(ones, False) == 1.0


def test_a_taught_translator_is_one_of_bytes(taught: CycleGan) -> None:
    sim = batch(torch.Generator().manual_seed(9), 4).sim
    translated = PictureTranslator(taught.to_real)(as_bytes(sim))
    assert translated.dtype == torch.uint8
    assert translated.float().mean((0, 1, 2))[0] > translated.float().mean((0, 1, 2))[2], "warm"
