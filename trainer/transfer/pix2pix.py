"""pix2pix (Isola et al. 2017) as paper B states it, and a small variant; two of them in a row.

Paper B's realistic translation network is virtual -> parsing -> real. The first learns from the
simulator's frames and labels, the second from photographs and what a parser sees in them, or from
another simulated world, which then stands for the real one (paper B, section 3.2). Between the two
each pixel becomes the nearest class's colour.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console
from torch import nn
from torch.nn import functional

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.policy import DIRECTIONS, TranslatorContract
from robot.inference.preprocess import preprocess_batch
from trainer.export import export_translator
from trainer.learners.backbone import centred
from trainer.presets import preset
from trainer.resumable import descend, run_steps, set_rate
from trainer.transfer.cli import ThroughOptions
from trainer.transfer.cyclegan import structure
from trainer.transfer.labelled import LABEL_SETS, ROAD, LabelSet, load_pairs
from trainer.transfer.networks import as_bytes, painted, paper_unet, patch_critic, resized, through
from trainer.transfer.parser import Parser, load_parser
from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, load_paint, load_pictures, spread


@dataclass(frozen=True)
class Pix2PixConfig:
    """Networks and weights of one translation."""

    size: tuple[int, int] | None = (256, 256)  # H, W inside the networks; None: the picture's own
    channels: int = 64  # of the first layer; doubled until `MOST_WIDENING`
    halvings: int = 8
    critic_layers: int = 3  # halvings of the PatchGAN; with 3 a patch is 70 px wide
    batch: int = 16
    learning_rate: float = 2e-4
    momentum: float = 0.5  # Adam's first
    l1: float = 100.0
    structure: float = 0.0  # weight of `cyclegan.structure` where `Pairs.lines` are told


PIX2PIX = {
    "paper": Pix2PixConfig(),
    "small": Pix2PixConfig(None, 16, 3, 2, batch=8, learning_rate=1e-3, structure=100.0),
}


Drawn = tuple[torch.Tensor, torch.Tensor]  # given and wanted, (N, C, H, W) in [-1, 1]


@dataclass(frozen=True)
class Pairs:
    """Pictures to translate and what they should become, both (N, H, W, 3) uint8."""

    given: np.ndarray
    wanted: np.ndarray
    lines: "Pairs | None" = None  # classes without a photograph; wanted is their paint (…, 4)

    def draw(self, count: int, rng: np.random.Generator) -> Drawn:
        """``count`` pairs (N, 3, H, W) in [-1, 1], half of them in the mirror."""
        chosen = rng.integers(len(self.given), size=count)
        mirrored = (rng.random(count) < 0.5)[:, None, None, None]
        given, wanted = (
            centred(torch.from_numpy(np.where(mirrored, some[:, :, ::-1], some)))
            for some in (self.given[chosen], self.wanted[chosen])
        )
        return given, wanted


class Pix2Pix:
    """Generator, critic and their optimisers."""

    def __init__(self, config: Pix2PixConfig, seed: int) -> None:
        torch.manual_seed(seed)
        self.config = config
        self.generator = paper_unet(config.size, config.channels, config.halvings).apply(_normal)
        critic = patch_critic(config.channels, config.critic_layers, 6, nn.BatchNorm2d)
        self.critic = critic.apply(_normal)
        self.of_generator, self.of_critic = (
            torch.optim.Adam(net.parameters(), config.learning_rate, (config.momentum, 0.999))
            for net in (self.generator, self.critic)
        )

    def judged(self, given: torch.Tensor, translation: torch.Tensor) -> torch.Tensor:
        """Logits (N, 1, h, w) that patches of a translation belong to the picture given."""
        size = self.config.size or given.shape[2:]
        pair = [resized(each, size, "bilinear") for each in (given, translation)]
        return self.critic(torch.cat(pair, 1))

    def step(self, given: torch.Tensor, wanted: torch.Tensor, lines: Drawn | None = None) -> float:
        """Teach both on pairs (N, 3, H, W); the L1 distance that was left, in [-1, 1].

        ``lines``: classes that no photograph shows, and the paint that must appear in them.
        """
        classes, paint = lines or (given[:0], None)
        made, drawn = self.generator.train()(torch.cat((given, classes))).tensor_split([len(given)])
        real, fake = self.judged(given, wanted), self.judged(given, made.detach())
        descend(self.of_critic, 0.5 * (_belongs(real, 1.0) + _belongs(fake, 0.0)))
        distance = functional.l1_loss(made, wanted)
        fooled = _belongs(self.judged(given, made), 1.0)
        moved = 0.0 if paint is None else structure(drawn, 0.5 * paint + 0.5)
        told = self.config.l1 * distance + self.config.structure * moved
        descend(self.of_generator, fooled + told)
        return float(distance.detach())


def teach_pairs(
    model: Pix2Pix, pairs: Pairs, steps: int, seed: int, checkpoint: Path, console: Console
) -> nn.Module:
    """Train one translation, from where ``checkpoint`` left off; its generator.

    The rate is constant for half of the steps and then falls linearly to nothing, as in Isola et
    al. 2017: the last updates would else leave their own texture on even surfaces.
    """
    parts = {name: part for name, part in vars(model).items() if name != "config"}
    optimisers = (model.of_generator, model.of_critic)

    def step(rng: np.random.Generator, k: int) -> str:
        set_rate(optimisers, model.config.learning_rate * min(1.0, 2.0 - 2.0 * k / steps))
        drawn = [each.draw(model.config.batch, rng) for each in (pairs, pairs.lines) if each]
        return f"L1 {model.step(*drawn[0], *drawn[1:]):.3f}"

    run_steps(checkpoint, parts, steps, seed, step, checkpoint.stem, console)
    return model.generator.eval()


def _belongs(logits: torch.Tensor, truth: float) -> torch.Tensor:
    return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, truth))


def _normal(module: nn.Module) -> None:
    """Isola et al.: weights from N(0, 0.02)."""
    if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
        nn.init.normal_(module.weight, 0.0, 0.02)
    elif isinstance(module, nn.BatchNorm2d):
        nn.init.normal_(module.weight, 1.0, 0.02)


FRAME = (120, 160)  # height, width [px]


def translate_through(out: Path, run: ThroughOptions, console: Console) -> Path:
    """Do what is left of a run in the folder ``out``; the translator's path.

    ConfigError if the simulator's frames, the photographs or the parser do not fit.
    """
    (virtual, real, image), labels, halves = both_pairs(run), LABEL_SETS[run.labels], []
    for name, pairs in (("virtual_to_parsing", virtual), ("parsing_to_real", real)):
        model, kept = Pix2Pix(PIX2PIX[run.net], run.seed), out / f"{name}.pt"
        halves.append(teach_pairs(model, pairs, run.steps, run.seed, kept, console))
    network, path = ThroughParsing(halves[0], halves[1], labels), out / "sim_to_real.onnx"
    name, notes = out.resolve().name, ("through parsing",)
    contract = TranslatorContract("pix2pix", DIRECTIONS[0], image, name, run.steps, notes=notes)
    export_translator(network, contract, path)
    chosen = spread(len(virtual.given), SHEET_ROWS)
    given = virtual.given[chosen]
    columns = {
        "input": given,
        "classes found": through(lambda some: as_bytes(network.parsed(some)), given),
        "true classes": virtual.wanted[chosen],
        "translation": through(network, given),
        "a photograph": real.wanted[spread(len(real.wanted), SHEET_ROWS)],
    }
    draw_sheet(out / "sheet.png", columns)
    return path


def both_pairs(run: ThroughOptions) -> tuple[Pairs, Pairs, ImageSpec]:
    """What each of the two networks learns from, and of which pictures; errors as above."""
    image, labels = preset(run.task, "dueling", run.preset).image, LABEL_SETS[run.labels]
    virtual = simulated_pairs(run.sim, image, labels)
    if run.parser:
        real = _real(Path(run.real), load_parser(Path(run.parser)), image)
        if PIX2PIX[run.net].structure:
            paint = load_paint(load_pictures([Path(run.sim)], image), image)
            real = replace(real, lines=Pairs(virtual.wanted, np.moveaxis(paint, 1, 3)))
    else:
        other = simulated_pairs(run.real, image, labels)
        real = Pairs(other.wanted, other.given)
    return virtual, real, image


def simulated_pairs(collection: str, image: ImageSpec, labels: LabelSet) -> Pairs:
    """A simulator's frames and their labels painted."""
    data = load_pairs(Path(collection), labels, FRAME)
    classes = _small(labels.paint(data.truth), labels, image)
    return Pairs(preprocess_batch(data.frames, image), classes)


def _real(photographs: Path, parser: Parser, image: ImageSpec) -> Pairs:
    """What a parser sees in photographs, painted, and the photographs."""
    if parser.labels is not ROAD:
        raise ConfigError(f"parser: expected one of labels road, got {parser.labels.name!r}")
    frames = load_pictures([photographs], ImageSpec()).images
    seen = ROAD.paint(parser.parse(preprocess_batch(frames, parser.image)))
    whole = [cv2.resize(one, FRAME[::-1], interpolation=cv2.INTER_NEAREST) for one in seen]
    return Pairs(_small(np.stack(whole), ROAD, image), preprocess_batch(frames, image))


def _small(classes: np.ndarray, labels: LabelSet, image: ImageSpec) -> np.ndarray:
    """Painted classes as a policy's pictures: made small as frames are, lest thin lines vanish."""
    return labels.paint(labels.read(preprocess_batch(classes, image)))


class ThroughParsing(nn.Module):
    """Both networks as one: (N, H, W, 3) uint8 RGB -> the same; what is exported."""

    def __init__(self, to_parsing: nn.Module, to_real: nn.Module, labels: LabelSet = ROAD) -> None:
        super().__init__()
        self.to_parsing, self.to_real = to_parsing, to_real
        colours = torch.tensor(labels.colours, dtype=torch.float32)
        self.colours = nn.Buffer(colours / 127.5 - 1.0)  # (C, 3) in [-1, 1]
        self.offsets = nn.Buffer(self.colours.square().sum(1))  # (C,)

    def parsed(self, pictures: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 -> (N, 3, H, W), each pixel one class's colour in [-1, 1]."""
        seen = self.to_parsing(centred(pictures))
        # |p|^2 less |p - c|^2
        nearness = functional.conv2d(seen, 2.0 * self.colours[:, :, None, None], -self.offsets)
        return painted(nearness, self.colours)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """See the class."""
        return as_bytes(self.to_real(self.parsed(image)))
