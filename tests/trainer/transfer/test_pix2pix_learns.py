"""pix2pix learns a toy: a stripe on dark ground is to become another colour on another ground."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch.nn import functional

from trainer.transfer.pix2pix import Pix2Pix, Pix2PixConfig

HEIGHT, WIDTH = 16, 32
TOY = Pix2PixConfig((HEIGHT, WIDTH), 8, 2, 2, batch=8, learning_rate=2e-3)


def pairs(count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures (N, 3, H, W) and what they should become, stripe by stripe."""
    given = torch.full((count, 3, HEIGHT, WIDTH), -0.6)
    wanted = torch.tensor([0.3, -0.3, 0.0])[None, :, None, None].expand_as(given).clone()
    for k, column in enumerate(torch.randint(2, WIDTH - 6, (count,), generator=generator)):
        there = slice(int(column), int(column) + 4)
        given[k, :, :, there] = 0.8
        wanted[k, :, :, there] = torch.tensor([-0.8, 0.8, 0.5])[:, None, None]
    return given, wanted


def taught(config: Pix2PixConfig, steps: int) -> tuple[Pix2Pix, list[float]]:
    torch.set_num_threads(1)
    model, generator = Pix2Pix(config, 0), torch.Generator().manual_seed(0)
    return model, [model.step(*pairs(config.batch, generator)) for _ in range(steps)]


def distance(model: Pix2Pix) -> float:
    """L1 on pairs that nobody learned from."""
    given, wanted = pairs(16, torch.Generator().manual_seed(7))
    with torch.no_grad():
        return float(functional.l1_loss(model.generator.train()(given), wanted))


def test_the_wanted_colours_come_where_they_belong() -> None:
    model, _ = taught(TOY, 60)
    assert distance(model) < 0.1


def test_the_distance_counts_beside_the_critic() -> None:
    """Without it a critic alone is far slower, and never as near."""
    near, far = (taught(replace(TOY, l1=l1), 40)[1] for l1 in (100.0, 0.0))
    assert sum(near[-5:]) < 0.6 * sum(far[-5:])


def test_a_critic_alone_leads_the_right_way() -> None:
    """Who is taught by the critic alone comes nearer to what is wanted, not farther."""
    model, losses = taught(replace(TOY, l1=0.0), 80)
    assert distance(model) < 0.7 * losses[0]


def test_a_critic_tells_made_pictures_from_wanted_ones() -> None:
    model = Pix2Pix(TOY, 0)
    for group in model.of_generator.param_groups:
        group["lr"] = 0.0
    generator = torch.Generator().manual_seed(0)
    for _ in range(30):
        model.step(*pairs(TOY.batch, generator))
    given, wanted = pairs(16, generator)
    with torch.no_grad():
        made = model.generator(given)
        assert float(model.judged(given, wanted).mean()) > 1.0
        assert float(model.judged(given, made).mean()) < -1.0
