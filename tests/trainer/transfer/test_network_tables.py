"""The layers of the networks, as the papers and our configurations say them."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
import torch
from torch import nn

from trainer.learners.backbone import centred
from trainer.transfer.cyclegan import TranslationConfig, translation_preset
from trainer.transfer.networks import (
    SEGNETS,
    AtSize,
    Changing,
    SegNet,
    UNet,
    as_bytes,
    narrow_unet,
    painted,
    paper_unet,
    patch_critic,
    resized,
    unpooled,
)
from trainer.transfer.pix2pix import PIX2PIX, Pix2PixConfig

CONVOLUTIONS = (nn.Conv2d, nn.ConvTranspose2d)


def table(network: nn.Module) -> list[tuple[Any, ...]]:
    """Of each convolution: channels in and out, kernel, stride, padding, whether it has a bias."""
    return [
        (
            m.in_channels,
            m.out_channels,
            m.kernel_size[0],
            m.stride[0],
            m.padding,
            m.bias is not None,
        )
        for m in network.modules()
        if isinstance(m, CONVOLUTIONS)
    ]


def count(network: nn.Module, kind: type[nn.Module]) -> int:
    return sum(isinstance(m, kind) for m in network.modules())


def test_the_narrow_unet_halves_three_times_and_comes_back() -> None:
    network = narrow_unet(12, 2)
    one, two = (1, 1), (1, 1)
    assert table(network) == [
        (3, 12, 4, 2, one, True),
        (12, 24, 4, 2, one, False),
        (24, 48, 4, 2, one, False),
        *[(48, 48, 3, 1, one, False)] * 4,
        (48, 24, 3, 1, two, False),
        (24 + 24, 12, 3, 1, one, False),
        (12 + 12, 6, 3, 1, one, True),
        (6 + 3, 3, 3, 1, one, True),
    ]
    norms = [m for m in network.modules() if isinstance(m, nn.InstanceNorm2d)]
    assert [m.num_features for m in norms] == [24, 48, 48, 48, 48, 48, 24, 12]
    assert all(m.affine for m in norms)
    slopes = [m.negative_slope for m in network.modules() if isinstance(m, nn.LeakyReLU)]
    assert slopes == [0.2, 0.2]


def test_a_residual_block_adds_to_what_it_was_given() -> None:
    network = narrow_unet(4, 1)
    assert isinstance(network, Changing)
    block = network.inner.deep[0]  # type: ignore[index,union-attr]
    seen = torch.rand(1, 16, 5, 10)
    torch.testing.assert_close(block(seen) - seen, block.inner(seen))


def test_a_change_is_added_as_a_squashed_double_and_leaks_beyond_black_and_white() -> None:
    said = torch.tensor([0.0, 0.1, -0.1, 2.0, -2.0]).view(1, 1, 1, 5)
    changing = Changing(_Says(said))
    made = changing(torch.full((1, 1, 1, 5), 0.5)).flatten()
    whole = 0.5 + 2.0 * torch.tanh(said.flatten())
    expected = torch.where(whole > 1.0, 1.0 + 0.1 * (whole - 1.0), whole)
    expected = torch.where(whole < -1.0, -1.0 + 0.1 * (whole + 1.0), expected)
    torch.testing.assert_close(made, expected)


class _Says(nn.Module):
    def __init__(self, said: torch.Tensor) -> None:
        super().__init__()
        self.said = said

    def forward(self, _: torch.Tensor) -> torch.Tensor:
        return self.said


def test_skips_go_to_where_they_were_halved() -> None:
    """Each way up ends beside what the halving that it undoes was given."""
    sizes: list[tuple[int, ...]] = []

    class Up(nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            sizes.append(tuple(x.shape[1:]))
            return x[:, :1]

    unet = UNet([nn.AvgPool2d(2), nn.AvgPool2d(2)], nn.Identity(), [Up(), Up()], nn.Identity())
    pictures = torch.rand(1, 3, 8, 12)
    made = unet(pictures)
    assert sizes == [(3, 2, 3), (4, 4, 6)]
    torch.testing.assert_close(made[:, 1:], pictures)
    assert made.shape == (1, 4, 8, 12)


def test_the_generator_of_pix2pix_is_that_of_the_paper() -> None:
    """Isola et al., 6.1: C64-C128-C256-C512-C512-C512-C512-C512, and back with skips."""
    network = paper_unet((256, 256), 64, 8)
    widths = [64, 128, 256, 512, 512, 512, 512, 512]
    down = [(a, b, 4, 2, (1, 1), False) for a, b in zip([3, *widths], widths, strict=False)]
    up = [
        *[(512, 512, 4, 2, (1, 1), False)],
        *[(1024, 512, 4, 2, (1, 1), False)] * 3,
        (1024, 256, 4, 2, (1, 1), False),
        (512, 128, 4, 2, (1, 1), False),
        (256, 64, 4, 2, (1, 1), False),
        (128, 3, 4, 2, (1, 1), True),
    ]
    assert table(network) == down + up
    assert count(network, nn.Dropout) == 3
    assert count(network, nn.BatchNorm2d) == 15
    assert all(m.p == 0.5 for m in network.modules() if isinstance(m, nn.Dropout))
    assert {m.negative_slope for m in network.modules() if isinstance(m, nn.LeakyReLU)} == {0.2}
    assert count(network, nn.Tanh) == 1
    assert isinstance(network, AtSize)
    dropped = [count(layer, nn.Dropout) for layer in network.inner.up]  # type: ignore[union-attr]
    assert dropped == [1, 1, 1, 0, 0, 0, 0], "the innermost"


def test_a_small_generator_of_pix2pix_has_no_noise() -> None:
    network = paper_unet((40, 80), 4, 3)
    assert count(network, nn.Dropout) == 0
    assert [row[:2] for row in table(network)] == [
        *((3, 4), (4, 8), (8, 16)),
        *((16, 8), (16, 4), (8, 3)),
    ]
    assert network(torch.rand(2, 3, 60, 90)).shape == (2, 3, 60, 90)


@pytest.mark.parametrize(("layers", "patch_px"), [(2, 34), (3, 70)])
def test_a_score_is_that_of_a_patch(layers: int, patch_px: int) -> None:
    torch.manual_seed(0)
    critic = patch_critic(4, layers, norm=nn.Identity)
    pictures = torch.rand(1, 3, 144, 144, requires_grad=True)
    scores = critic(pictures)
    middle = scores.shape[2] // 2
    scores[0, 0, middle, middle].backward()
    assert pictures.grad is not None
    rows = torch.nonzero(pictures.grad.abs().sum((0, 1, 3)) > 0.0)
    assert int(rows.max() - rows.min()) + 1 == patch_px


def test_a_critic_grows_wider_up_to_eight_times() -> None:
    critic = patch_critic(4, 5, inputs=6, norm=nn.BatchNorm2d)
    one = (1, 1)
    assert table(critic) == [
        (6, 4, 4, 2, one, True),
        (4, 8, 4, 2, one, False),
        (8, 16, 4, 2, one, False),
        (16, 32, 4, 2, one, False),
        (32, 32, 4, 2, one, False),
        (32, 32, 4, 1, one, False),
        (32, 1, 4, 1, one, True),
    ]
    assert count(critic, nn.BatchNorm2d) == 5
    assert [m.negative_slope for m in critic.modules() if isinstance(m, nn.LeakyReLU)] == [0.2] * 6


def test_segnet_has_the_thirteen_convolutions_of_vgg_and_their_mirror() -> None:
    channels, counts = SEGNETS["paper"]
    assert sum(counts) == 13
    rows = table(SegNet(11, channels, counts))
    down = [3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512]
    up = [*(512, 512, 512, 512, 512, 512, 256, 256, 256, 128, 128, 64, 64), 64]
    expected = [(a, b, 3, 1, "same", False) for a, b in pairwise(down)]
    expected += [(a, b, 3, 1, "same", False) for a, b in pairwise(up)]
    assert rows == [*expected, (64, 11, 3, 1, "same", True)]
    assert SEGNETS["small"] == ((16, 32, 64, 64), (1, 1, 2, 2))


@pytest.mark.parametrize("size", [(16, 32), (13, 22)])
def test_segnet_answers_for_every_pixel_of_any_size(size: tuple[int, int]) -> None:
    network = SegNet(5, (4, 8), (1, 2)).eval()
    pictures = torch.randint(0, 256, (2, *size, 3), dtype=torch.uint8)
    logits = network(pictures)
    assert logits.shape == (2, 5, *size)
    torch.testing.assert_close(network(pictures[1:])[0], logits[1])


def test_values_go_back_where_their_maxima_were() -> None:
    seen = torch.rand(2, 3, 6, 10)
    small, indices = nn.functional.max_pool2d(seen, 2, return_indices=True)
    expected = nn.functional.max_unpool2d(small, indices, 2)
    assert torch.equal(unpooled(small, indices, seen.shape), expected)


def test_pixels_are_painted_with_the_colour_of_their_best_class() -> None:
    generator = torch.Generator().manual_seed(0)
    scores = torch.randn(2, 4, 5, 6, generator=generator)
    colours = torch.rand(4, 3, generator=generator)
    expected = colours[scores.argmax(1)].permute(0, 3, 1, 2)
    assert torch.equal(painted(scores, colours), expected)
    assert torch.equal(painted(scores * 0.0, colours)[0, :, 0, 0], colours[0]), (
        "of equals the first"
    )


def test_floats_are_bytes_from_minus_one_to_one() -> None:
    bytes_ = torch.tensor([0, 127, 128, 255], dtype=torch.uint8).view(1, 1, 4, 1)
    floats = centred(bytes_.expand(1, 1, 4, 3))
    assert floats.shape == (1, 3, 1, 4)
    torch.testing.assert_close(floats[0, 0, 0], torch.tensor([-1.0, -1 / 255, 1 / 255, 1.0]))
    back = as_bytes(torch.tensor([-1.5, -1.0, 0.0, 0.0039, 0.0041, 1.0, 7.0]).view(1, 1, 1, 7))
    assert back.flatten().tolist() == [0, 0, 128, 128, 128, 255, 255]


def test_pictures_are_resized_as_asked_or_left_alone() -> None:
    pictures = torch.arange(4.0).view(1, 1, 2, 2)
    assert resized(pictures, (2, 2)) is pictures
    assert resized(pictures, (2, 4)).flatten().tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert resized(pictures, (2, 4), "bilinear")[0, 0, 0].tolist() == [0.0, 0.25, 0.75, 1.0]


def test_inside_a_network_of_one_size_pictures_have_it() -> None:
    seen: list[tuple[int, ...]] = []

    class Inner(nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            seen.append(tuple(x.shape))
            return x

    pictures = torch.arange(8.0).view(1, 1, 2, 4)
    made = AtSize(Inner(), (4, 8))(pictures)
    assert (seen, made.shape) == ([(1, 1, 4, 8)], pictures.shape)
    assert 0.0 < float(made[0, 0, 0, 0]) < 2.0, "blended, not picked"


def test_the_weights_of_cyclegan() -> None:
    fast = translation_preset("fast", ("s",), ("r",))
    told = (fast.width, fast.blocks, fast.critic_width, fast.critic_layers, fast.steps, fast.batch)
    assert told == (12, 1, 16, 2, 2_000, 2)
    assert (fast.learning_rate, fast.decay_from, fast.pool) == (6e-4, 0.5, 50)
    assert (fast.cycle, fast.identity, fast.structure) == (10.0, 1.0, 5.0)
    assert (fast.seed, fast.device) == (0, "cpu")
    paper = translation_preset("paper", ("s",), ("r",))
    told = (paper.width, paper.blocks, paper.critic_width, paper.critic_layers)
    assert told == (32, 6, 64, 3)
    assert (paper.steps, paper.batch, paper.learning_rate) == (100_000, 1, 2e-4)
    assert (paper.cycle, paper.identity, paper.pool, paper.device) == (10.0, 5.0, 50, "auto")
    assert isinstance(fast, TranslationConfig)


def test_the_weights_of_pix2pix() -> None:
    paper, small = PIX2PIX["paper"], PIX2PIX["small"]
    assert paper == Pix2PixConfig((256, 256), 64, 8, 3, 16, 2e-4, 0.5, 100.0, 0.0)
    assert small == Pix2PixConfig(None, 16, 3, 2, 8, 1e-3, 0.5, 100.0, 100.0)
    assert small.size is None
