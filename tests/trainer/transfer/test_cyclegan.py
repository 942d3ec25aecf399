import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from robot.errors import ConfigError
from trainer.learners.backbone import centred
from trainer.transfer.cyclegan import (
    Batch,
    CycleGan,
    ImagePool,
    TranslationConfig,
    translation_preset,
)
from trainer.transfer.networks import PictureTranslator, as_bytes, narrow_unet

CPU = torch.device("cpu")


def config(**changes: object) -> TranslationConfig:
    base = translation_preset("debug", ("sim",), ("real",))
    return replace(base, **changes)  # type: ignore[arg-type]


def batch(seed: int, count: int = 2) -> Batch:
    generator = torch.Generator().manual_seed(seed)
    sim, real = (torch.rand(count, 3, 40, 80, generator=generator) * 2 - 1 for _ in range(2))
    return Batch(sim, real, torch.rand(count, 4, 40, 80, generator=generator))


@pytest.mark.parametrize("size", [(40, 80), (120, 160), (30, 50)])
def test_a_fresh_generator_changes_nothing(size: tuple[int, int]) -> None:
    translator = PictureTranslator(narrow_unet(8, 1))
    pictures = torch.randint(0, 256, (2, *size, 3), dtype=torch.uint8)
    assert torch.equal(translator(pictures), pictures)


def test_bytes_and_floats_are_each_others_inverse() -> None:
    pictures = torch.arange(256, dtype=torch.uint8).reshape(1, 16, 16, 1).expand(1, 16, 16, 3)
    assert torch.equal(as_bytes(centred(pictures)), pictures)
    assert as_bytes(torch.full((1, 3, 1, 1), 3.0)).max() == 255


def test_an_interrupted_training_goes_on_as_if_it_had_not_been() -> None:
    whole = CycleGan(config(), CPU)
    for k in range(4):
        whole.step(batch(k), np.random.default_rng(k), k)
    first = CycleGan(config(), CPU)
    for k in range(2):
        first.step(batch(k), np.random.default_rng(k), k)
    second = CycleGan(config(seed=9), CPU)
    for name, part in second.parts.items():
        part.load_state_dict(copy.deepcopy(first.parts[name].state_dict()))
    assert len(second.real_pool.pictures) == 4
    for k in range(2, 4):
        losses = second.step(batch(k), np.random.default_rng(k), k)
    assert all(np.isfinite(loss) for loss in losses.values())
    for ours, expected in zip(second.to_real.parameters(), whole.to_real.parameters(), strict=True):
        torch.testing.assert_close(ours, expected)


def test_the_rate_falls_to_nothing() -> None:
    model = CycleGan(config(steps=4), CPU)
    rates = []
    for k in range(4):
        model.step(batch(k), np.random.default_rng(k), k)
        rates.append(model.generators.param_groups[0]["lr"])
    assert rates[0] == rates[1] == rates[2] == pytest.approx(config().learning_rate)
    assert rates[3] == pytest.approx(0.5 * config().learning_rate)


def test_the_kept_generators_are_means_of_the_weights_so_far() -> None:
    model = CycleGan(config(), CPU)
    seen = []
    for k in range(3):
        model.step(batch(k), np.random.default_rng(k), k)
        seen.append([p.detach().clone() for p in model.to_real.parameters()])
    for kept, *steps in zip(model.kept[0].parameters(), *seen, strict=True):
        torch.testing.assert_close(kept, torch.stack(steps).mean(0))
        assert not kept.requires_grad


def test_the_pool_gives_back_earlier_pictures() -> None:
    pool, rng = ImagePool(2), np.random.default_rng(0)
    seen = []
    for k in range(30):
        given = pool.exchanged(torch.full((1, 3, 2, 2), float(k)), rng)
        seen.append(int(given[0, 0, 0, 0]))
    assert seen[:2] == [0, 1]
    assert any(value < k for k, value in enumerate(seen))
    assert len(pool.pictures) == 2


def test_names_of_presets_are_checked() -> None:
    with pytest.raises(ConfigError, match="did you mean 'paper'"):
        translation_preset("papers", (), ())
