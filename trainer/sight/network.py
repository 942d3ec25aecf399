"""The network of `robot.vision.sight`: seven convolutions, one layer, and what it is taught by."""

from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn
from torch.nn import functional as f

from robot.output import atomically
from robot.vision.sight import COLUMNS, OnnxSight, SightContract, as_seen
from trainer.export import TOLERANCE, expect_alike, write_onnx
from trainer.learners.backbone import HALF, Twice, centred, read_backbone
from trainer.sight import pictures as shown
from trainer.sight.pictures import FIGURES, IMAGE, Pictures

CHANNELS = (32, 64, 128)
_HIDDEN = 192
_SURE, _KINDS = 2 * FIGURES, 2 * FIGURES + 3  # where columns of probabilities begin
# Middle and spread of the figures, in which the network speaks.
_MIDDLE = (0.0, 0.0, 0.0, 0.3, 0.3)
_SPREAD = (0.05, 0.3, 2.0, 0.15, 0.2)
_LOG_SD = (-4.0, 2.0)  # least and most, of the standard deviation in spreads
# Weight of an error by its variance to this power: Seitzer et al., On the pitfalls of
# heteroscedastic uncertainty estimation, ICLR 2022. At 0 hard pictures are given up too early.
_BETA = 0.5
_AT_ONCE = 512


def _convolution(of: int, to: int, size: int, stride: int) -> nn.Sequential:
    """With batch normalisation (Ioffe and Szegedy 2015), which the ONNX file folds into it."""
    convolution = nn.Conv2d(of, to, size, stride, size // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(to), nn.ReLU())


def _twice(channels: int) -> Twice:
    return Twice(*(_convolution(channels, channels, 3, 1)[:2] for _ in range(2)))


class SightNetwork(nn.Module):
    """Pictures (N, 40, 80, 3) uint8 -> what they show (N, 18), see `robot.vision.sight.COLUMNS`."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third = CHANNELS
        self.body = nn.Sequential(
            _convolution(3, first, 5, 2),
            _convolution(first, second, 3, 2),
            _twice(second),
            _convolution(second, third, 3, 2),
            _twice(third),
            nn.Flatten(),
            nn.LazyLinear(_HIDDEN),
            nn.ReLU(),
        )
        self.head = nn.Linear(_HIDDEN, len(COLUMNS))
        self.eval()
        self.body(torch.zeros(1, 3, *IMAGE.shape[:2]))  # the lazy layer takes its size
        self.train()
        # of standard deviations, (5,); set when the network is judged on maps to choose by
        self.scale = nn.Buffer(torch.ones(FIGURES))
        self.middle = nn.Buffer(torch.tensor(_MIDDLE))
        self.spread = nn.Buffer(torch.tensor(_SPREAD))

    def raw(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 18) in spreads, logarithms and logits."""
        with torch.autocast("cpu", torch.bfloat16, enabled=self.training and HALF):
            features = self.body(centred(images))
        return self.head(features.float())

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """See the class."""
        raw = self.raw(images)
        figures = raw[:, :FIGURES] * self.spread + self.middle
        deviations = self.scale * self.spread * raw[:, FIGURES:_SURE].clamp(*_LOG_SD).exp()
        sure = raw[:, _SURE:_KINDS].sigmoid()
        return torch.cat((figures, deviations, sure, raw[:, _KINDS:].softmax(1)), 1)

    def loss(self, images: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """How wrong it is about pictures with these labels, where a question has an answer."""
        raw = self.raw(images)
        wanted = (labels[:, :FIGURES] - self.middle) / self.spread
        known = torch.isfinite(wanted)
        log_sd = raw[:, FIGURES:_SURE].clamp(*_LOG_SD)
        square = (raw[:, :FIGURES] - torch.nan_to_num(wanted)) ** 2
        likely = 0.5 * square * (-2.0 * log_sd).exp() + log_sd
        likely = likely * (2.0 * _BETA * log_sd).exp().detach()
        total = (likely * known).sum() / len(images)
        for column, logit in zip(
            (shown.LINE, shown.ROAD, shown.THING), raw[:, _SURE:_KINDS].T, strict=True
        ):
            asked = labels[:, column] >= 0.0
            right = labels[:, column].clamp(min=0.0)
            each = f.binary_cross_entropy_with_logits(logit, right, reduction="none")
            total = total + (each * asked).sum() / len(images)
        kinds = labels[:, shown.KIND].long()
        wrong = f.cross_entropy(raw[:, _KINDS:], kinds, ignore_index=-1, reduction="sum")
        return total + 0.5 * wrong / len(images)

    @torch.no_grad()
    def see(self, images: np.ndarray) -> np.ndarray:
        """(N, 18) of pictures (N, 40, 80, 3) uint8."""
        parts = np.array_split(images, max(1, len(images) // _AT_ONCE))
        device = self.scale.device
        return np.concatenate([self(torch.from_numpy(p).to(device)).cpu().numpy() for p in parts])


def learned(path: Path) -> SightNetwork:
    """A sight, .onnx, to learn on: batch normalisation is part of its layers. ContractError."""
    OnnxSight(path)  # refuses what is none
    network = SightNetwork()
    network.body = nn.Sequential(*read_backbone(path)).requires_grad_()
    values = {each.name: each for each in onnx.load(str(path)).graph.initializer}
    for name, part in network.head.named_parameters():
        part.data = torch.from_numpy(onnx.numpy_helper.to_array(values[f"head.{name}"]).copy())
    return network


def calibrate(network: SightNetwork, pictures: Pictures) -> None:
    """Scale the standard deviations, so that errors are on average what they promise.

    Asked are pictures that came for the first time, of lines and things only those that must be
    seen: those that hardly can be have errors of their own.
    """
    network.eval()
    network.scale.fill_(1.0)
    seen = as_seen(network.see(pictures.images))
    ratio = (seen.figures - pictures.labels[:, :FIGURES]) / seen.deviations
    ratio[pictures.labels[:, shown.NEW] <= 0.0] = np.nan
    for figure, column in ((shown.LINE_FIGURE, shown.LINE), (shown.FREE, shown.THING)):
        ratio[pictures.labels[:, column] != 1.0, figure] = np.nan
    ratio = np.vstack((ratio, np.ones(FIGURES)))  # what no picture tells stays as it is
    network.scale.copy_(torch.from_numpy(np.sqrt(np.nanmean(ratio**2, axis=0))))


def export_sight(
    network: SightNetwork, contract: SightContract, images: np.ndarray, path: Path
) -> None:
    """Write the network with its contract; ContractError if torch sees else in these pictures."""
    example = {"image": torch.from_numpy(images[:2])}
    with atomically(path) as temporary:
        write_onnx(network, example, "seen", contract, temporary)
    for ours, theirs in zip(as_seen(network.see(images)), OnnxSight(path)(images), strict=True):
        expect_alike(path, ours, theirs, TOLERANCE)
