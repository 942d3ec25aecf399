"""One update of CycleGAN and of pix2pix, written out again: who learns from which losses."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional

from trainer.transfer.cyclegan import (
    Batch,
    CycleGan,
    ImagePool,
    TranslationConfig,
    adversarial,
    structure,
    translation_preset,
)
from trainer.transfer.pix2pix import Pairs, Pix2Pix, Pix2PixConfig

CPU = torch.device("cpu")
SMALL = Pix2PixConfig((16, 32), 4, 2, 1, batch=2, learning_rate=1e-3)


def config(**changes: object) -> TranslationConfig:
    base = replace(translation_preset("debug", ("sim",), ("real",)), width=4, critic_width=4)
    return replace(base, **changes)  # type: ignore[arg-type]


def batch(seed: int) -> Batch:
    generator = torch.Generator().manual_seed(seed)
    sim, real = (torch.rand(2, 3, 16, 32, generator=generator) * 2 - 1 for _ in range(2))
    return Batch(sim, real, torch.rand(2, 4, 16, 32, generator=generator).round())


def begun(of: TranslationConfig) -> CycleGan:
    """Fresh generators change nothing, and have nothing to lose: these do."""
    model, generator = CycleGan(of, CPU), torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in model._pair.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=generator))
    return model


def gradients(parameters: list[torch.Tensor], loss: torch.Tensor) -> list[torch.Tensor]:
    return list(torch.autograd.grad(loss, parameters))


def assert_gradients(network: torch.nn.Module, expected: list[torch.Tensor]) -> None:
    for parameter, gradient in zip(network.parameters(), expected, strict=True):
        assert parameter.grad is not None
        torch.testing.assert_close(parameter.grad, gradient, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("steps", [0, 1])
def test_what_the_generators_of_cyclegan_learn_from(steps: int) -> None:
    """Both fool a critic and come back; lines stay; every second time the other is left alone."""
    model = begun(config())
    before, given = copy.deepcopy(model), batch(3)
    to_real, to_sim = before.to_real, before.to_sim
    losses = model.step(given, np.random.default_rng(0), steps)
    made_real, made_sim = to_real(given.sim), to_sim(given.real)
    there, back = to_real(given.real), to_sim(given.sim)
    expected = {
        "fool_real": (before.real_critic(made_real) - 1.0).square().mean(),
        "fool_sim": (before.sim_critic(made_sim) - 1.0).square().mean(),
        "cycle": (to_sim(made_real) - given.sim).abs().mean()
        + (to_real(made_sim) - given.real).abs().mean(),
        "structure": structure(made_real, given.paint),
        "identity": 2.0 * ((there - given.real) if steps else (back - given.sim)).abs().mean(),
    }
    for name, loss in expected.items():
        assert losses[name] == pytest.approx(loss.item(), rel=1e-4)
    total = expected["fool_real"] + expected["fool_sim"] + 10.0 * expected["cycle"]
    total = total + expected["identity"] + 5.0 * expected["structure"]
    parameters = [*to_real.parameters(), *to_sim.parameters()]
    assert_gradients(model._pair, gradients(parameters, total))


def test_what_the_critics_of_cyclegan_learn_from() -> None:
    """Half of it is what is real, half what was made: nothing was in the pools yet."""
    model = begun(config())
    before, given = copy.deepcopy(model), batch(4)
    losses = model.step(given, np.random.default_rng(0), 0)
    made_real, made_sim = before.to_real(given.sim).detach(), before.to_sim(given.real).detach()
    total = torch.zeros(())
    for name, critic, real, made in (
        ("critic_real", before.real_critic, given.real, made_real),
        ("critic_sim", before.sim_critic, given.sim, made_sim),
    ):
        loss = 0.5 * (critic(real) - 1.0).square().mean() + 0.5 * critic(made).square().mean()
        assert losses[name] == pytest.approx(loss.item(), rel=1e-4)
        total = total + loss
    expected = gradients(list(before._judges.parameters()), total)
    assert_gradients(model._judges, expected)
    assert all(torch.equal(a, b) for a, b in zip(model.real_pool.pictures, made_real, strict=True))
    assert all(torch.equal(a, b) for a, b in zip(model.sim_pool.pictures, made_sim, strict=True))


@pytest.mark.parametrize("name", ["identity", "structure"])
def test_a_loss_without_weight_teaches_nothing(name: str) -> None:
    without, whole, given = begun(config(**{name: 0.0})), begun(config()), batch(5)
    losses = without.step(given, np.random.default_rng(0), 0)
    whole.step(given, np.random.default_rng(0), 0)
    assert ("identity" in losses) is (name != "identity")
    pairs = zip(without._pair.parameters(), whole._pair.parameters(), strict=True)
    assert any((a.grad - b.grad).abs().max() > 1e-4 for a, b in pairs)  # type: ignore[operator]


def test_adam_has_the_momentum_of_gans() -> None:
    model = CycleGan(config(), CPU)
    for optimiser in (model.generators, model.critics):
        (group,) = optimiser.param_groups
        assert group["betas"] == (0.5, 0.999)
    own = Pix2Pix(SMALL, 0)
    for of in (own.of_generator, own.of_critic):
        assert of.param_groups[0]["betas"] == (0.5, 0.999)
        assert of.param_groups[0]["lr"] == 1e-3


def test_real_is_one_and_made_is_nothing() -> None:
    scores = torch.tensor([0.0, 1.0, 3.0])
    assert float(adversarial(scores, True)) == pytest.approx((1.0 + 0.0 + 4.0) / 3.0)
    assert float(adversarial(scores, False)) == pytest.approx((0.0 + 1.0 + 9.0) / 3.0)


def test_half_of_what_a_full_pool_is_given_is_exchanged() -> None:
    pool, rng = ImagePool(50), np.random.default_rng(0)
    exchanged = 0
    for k in range(1_000):
        made = torch.full((1, 1, 1, 1), float(k))
        got = float(pool.exchanged(made, rng).item())
        assert got == k or k >= 50
        exchanged += got != k
        assert len(pool.pictures) == min(k + 1, 50)
    assert 425 < exchanged < 525


def test_the_mean_of_the_weights_is_over_two_hundred_steps() -> None:
    model = CycleGan(config(), CPU)
    for steps, share in ((1, 1.0), (4, 0.25), (200, 0.005), (900, 0.005)):
        kept = list(model.kept.parameters())
        for each, newest in zip(kept, model._pair.parameters(), strict=True):
            each.zero_()
            newest.data.fill_(1.0)
        model._average(steps)
        assert all(torch.allclose(p, torch.full_like(p, share)) for p in kept)


@pytest.mark.parametrize(
    ("steps", "share"), [(0, 1.0), (499, 1.0), (500, 1.0), (750, 0.5), (999, 0.002)]
)
def test_the_rate_of_cyclegan_falls_in_its_second_half(steps: int, share: float) -> None:
    model = CycleGan(config(steps=1_000, learning_rate=8e-4), CPU)
    assert model._rate(steps) == pytest.approx(8e-4 * share)


def test_the_rate_of_the_shortest_runs_falls_evenly_too() -> None:
    for steps, done, share in ((3, 2, 2.0 / 3.0), (1, 0, 1.0), (2, 1, 1.0)):
        model = CycleGan(config(steps=steps, learning_rate=8e-4), CPU)
        assert model._rate(done) == pytest.approx(8e-4 * share)


def test_one_step_of_pix2pix() -> None:
    """The critic by the halved sum over true and made pairs; then the generator by L1 and by it."""
    model = Pix2Pix(SMALL, 0)
    pairs = Pairs(
        *(np.random.default_rng(k).integers(0, 256, (4, 16, 32, 3), np.uint8) for k in (1, 2))
    )
    given, wanted = pairs.draw(2, np.random.default_rng(0))
    before = copy.deepcopy(model)
    distance = model.step(given, wanted)
    made = before.generator.train()(given)
    assert distance == pytest.approx((made - wanted).abs().mean().item(), rel=1e-5)
    critic = before.critic
    real, fake = (critic(torch.cat((given, each), 1)) for each in (wanted, made.detach()))
    loss = -0.5 * (functional.logsigmoid(real).mean() + functional.logsigmoid(-fake).mean())
    before.of_critic.zero_grad()
    loss.backward()
    before.of_critic.step()
    for ours, theirs in zip(critic.parameters(), model.critic.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-6)
    fooled = -functional.logsigmoid(critic(torch.cat((given, made), 1))).mean()
    total = fooled + 100.0 * (made - wanted).abs().mean()
    expected = gradients(list(before.generator.parameters()), total)
    for parameter, gradient in zip(model.generator.parameters(), expected, strict=True):
        assert parameter.grad is not None
        torch.testing.assert_close(parameter.grad, gradient, rtol=1e-3, atol=1e-5)


def test_pairs_are_mirrored_together_and_half_of_the_time() -> None:
    given = np.zeros((3, 4, 6, 3), np.uint8)
    given[:, :, 0], given[..., 2] = 255, 51 * np.arange(3)[:, None, None]
    pairs, mirrored, chosen = Pairs(given, 255 - given), 0, set()
    rng = np.random.default_rng(0)
    for _ in range(100):
        one, other = pairs.draw(4, rng)
        torch.testing.assert_close(one, -other)
        mirrored += int((one[:, 0, 0, -1] > 0).sum())
        chosen |= set(one[:, 2, 0, 3].tolist())
    assert 160 < mirrored < 240
    assert len(chosen) == 3


def test_weights_of_pix2pix_begin_small() -> None:
    model = Pix2Pix(replace(SMALL, channels=16, halvings=3), 0)
    for network in (model.generator, model.critic):
        for module in network.modules():
            weight = getattr(module, "weight", None)
            if isinstance(module, torch.nn.BatchNorm2d):
                assert abs(float(module.weight.mean()) - 1.0) < 0.03
                assert float(module.weight.std()) < 0.05
            elif weight is not None and weight.numel() > 1_000:
                assert float(weight.std()) == pytest.approx(0.02, rel=0.1)
                assert abs(float(weight.mean())) < 0.002
