import pytest
import torch

from trainer.transfer.cyclegan import structure


def scene() -> tuple[torch.Tensor, torch.Tensor]:
    """A road (1, 3, 40, 80) with a white and a yellow line, and its paint."""
    paint = torch.zeros(1, 4, 40, 80)
    paint[:, 0, :, 50:56] = 1.0
    paint[:, 1, :, 20:24] = 1.0
    paint[:, 3] = 1.0 - paint[:, 0] - paint[:, 1]
    colours = torch.tensor([[0.9, 0.9, 0.9], [0.8, 0.6, -0.7], [0.0, 0.0, 0.0], [-0.6, -0.6, -0.6]])
    return torch.einsum("npij,pc->ncij", paint, colours), paint


@pytest.mark.parametrize(
    ("gain", "cast"), [(1.0, (0, 0, 0)), (0.5, (0.1, 0.2, -0.2)), (0.7, (-0.2, 0, 0.2))]
)
def test_light_and_casts_cost_little(gain: float, cast: tuple) -> None:
    picture, paint = scene()
    seen = gain * picture + torch.tensor(cast).view(1, 3, 1, 1)
    assert structure(seen, paint) < 0.1


@pytest.mark.parametrize("shift", [2, -2, 4])
def test_moved_lines_cost(shift: int) -> None:
    picture, paint = scene()
    kept, moved = structure(picture, paint), structure(torch.roll(picture, shift, 3), paint)
    assert moved > kept + 0.25


def test_vanished_invented_and_recoloured_lines_cost() -> None:
    picture, paint = scene()
    kept = structure(picture, paint)
    assert structure(torch.zeros_like(picture), paint) > kept + 1.0
    invented = picture.clone()
    invented[:, :, :, 66:70] = 0.9
    assert structure(invented, paint) > kept + 0.01
    white = picture.clone()
    white[:, :, :, 20:24] = 0.7
    assert structure(white, paint) > kept + 0.5


def test_a_picture_without_paint_is_no_error() -> None:
    picture = torch.zeros(1, 3, 40, 80, requires_grad=True)
    structure(picture, torch.zeros(1, 4, 40, 80)).backward()
    assert picture.grad is not None
    assert torch.isfinite(picture.grad).all()
