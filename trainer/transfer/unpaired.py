"""A CycleGAN run: trained from beginning to end, or from where it was cut off; judged, exported.

More updates are not always better: pictures come closer to photographs and drift away again, and
lines fade. So the best generators are kept, judged on pictures that none of them learned from: how
close they are to photographs, and whether lines are where they were.

KID is told from features that need no download: those of a fixed network of random filters, three
convolutions drawn from seed 0, each followed by rectification and halving, averaged over a grid of
2 x 2 cells at every depth, and standardised by the set compared with. A deviation there counts for
no less than one grey level: in a set whose skies are all alike some features hardly deviate.

Untrained filters answer to colour, contrast, sharpness, noise and oriented texture, and hardly to
what things are. Figures compare with others of the same folders and picture size only.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from rich.console import Console
from torch import nn

from robot.errors import ConfigError
from robot.inference.translator import DIRECTIONS, OnnxTranslator, TranslatorContract
from trainer.export import export_translator
from trainer.resumable import Loop
from trainer.transfer.cyclegan import Batch, CycleGan, TranslationConfig
from trainer.transfer.labelled import ends
from trainer.transfer.networks import PictureTranslator, as_floats, through
from trainer.transfer.pictures import SHEET_ROWS, Pictures, draw_sheet, load_paint, load_pictures

LANE_OVERLAP = 0.85  # of the lines in picture and translation: what a translation must keep
_MARGIN = 0.01  # more than is due, since other pictures give other figures
FEWEST = 2  # pictures that a distance can be told from
_CHANNELS = (16, 24, 32)
_SPLITS = 40
_SPLIT = 50
_GREY_LEVEL = 2.0 / 255.0  # of pictures as the networks get them, -1 .. 1
_FLOOR_SHARE = 0.98  # of a pixel that must be white or yellow paint, or road
_LEAST_CONTRAST = 25.0  # grey levels between paint and road, below which nothing is a line


class Score(NamedTuple):
    """How good a translator sim-to-real is."""

    kid: float  # distance to the photographs, of all collections together
    lanes: float  # lines kept, in the collection where it is least

    def better_than(self, other: Score | None) -> bool:
        """Closer to photographs, among those that keep enough lines; else by the lines kept."""
        if other is None:
            return True
        due = LANE_OVERLAP + _MARGIN
        if min(self.lanes, other.lanes) >= due:
            return self.kid < other.kid
        return self.lanes > other.lanes


class Judge:
    """Judges translators sim-to-real by pictures, their paint (`load_paint`) and photographs.

    ConfigError if there are too few of either.
    """

    def __init__(self, sim: Pictures, paint: np.ndarray, photographs: np.ndarray) -> None:
        if min(len(sim.images), len(photographs)) < FEWEST:
            raise ConfigError(
                f"translation: expected at least {2 * FEWEST} simulated pictures in a collection "
                f"and {2 * FEWEST} photographs of a drive, got too few to judge translations by"
            )
        self._real = features(photographs)
        self._parts = []
        for number in np.unique(sim.folder):
            mine = sim.folder == number
            found = bright_lines(sim.images[mine], paint[mine])
            self._parts.append((sim.images[mine], paint[mine], found))

    def score(self, translate: Callable[[np.ndarray], np.ndarray]) -> Score:
        """Of what makes of pictures (N, H, W, 3) uint8 others of the same size."""
        seen, kept = [], []
        for pictures, paint, found in self._parts:
            translated = translate(pictures)
            seen.append(features(translated))
            kept.append(overlap(bright_lines(translated, paint), found))
        return Score(kernel_distance(np.concatenate(seen), self._real), min(kept))

    def apart(self) -> float:
        """KID of every second photograph from the others: as close as it gets."""
        return kernel_distance(self._real[::2], self._real[1::2])


def judge(translator: OnnxTranslator, sim: Sequence[Path], real: Sequence[Path]) -> dict[str, Any]:
    """``--json`` of ``translate judge``: distances to photographs, and the lines kept.

    ``sim`` are collections from the simulator, best none that it was trained with.
    """
    simulated, photographs = (load_pictures(paths, translator.image) for paths in (sim, real))
    asked = Judge(simulated, load_paint(simulated, translator.image), photographs.images)
    before, after = asked.score(lambda pictures: pictures), asked.score(translator)
    return {
        "translator": str(translator.path),
        "pictures": len(simulated.images),
        "photographs": len(photographs.images),
        "kid_before": before.kid,
        "kid_after": after.kid,
        "kid_apart": asked.apart(),  # photographs from each other
        "lanes_kept": after.lanes,  # in the collection where it is least; LANE_OVERLAP is due
    }


def features(pictures: np.ndarray) -> np.ndarray:
    """(N, 2 * 4 * 72) float64 of pictures (N, H, W, 3) uint8: means and deviations of each cell."""
    layers = _network()

    def of_some(some: torch.Tensor) -> torch.Tensor:
        maps, parts = as_floats(some), []
        for layer in layers:
            maps = layer(maps)
            mean = nn.functional.adaptive_avg_pool2d(maps, 2)
            square = nn.functional.adaptive_avg_pool2d(maps * maps, 2)
            parts += [mean.flatten(1), (square - mean**2).clamp_min(0).sqrt().flatten(1)]
            maps = nn.functional.avg_pool2d(maps, 2)
        return torch.cat(parts, 1).double()

    return through(of_some, pictures, size=64)


def kernel_distance(made: np.ndarray, real: np.ndarray, seed: int = 0) -> float:
    """KID (Binkowski et al. 2018): unbiased squared MMD of a cubic kernel, over splits of 50.

    ``made`` are features (N, D), ``real`` (M, D), by which both are standardised.
    """
    made, real = _standardised(made, real)
    rng, distances = np.random.default_rng(seed), []
    for _ in range(_SPLITS):
        a = made[rng.choice(len(made), min(_SPLIT, len(made)), replace=False)]
        b = real[rng.choice(len(real), min(_SPLIT, len(real)), replace=False)]
        n, m = len(a), len(b)
        within_a, within_b = _kernel(a, a), _kernel(b, b)
        distances.append(
            (within_a.sum() - np.trace(within_a)) / (n * (n - 1))
            + (within_b.sum() - np.trace(within_b)) / (m * (m - 1))
            - 2.0 * _kernel(a, b).mean()
        )
    return float(np.mean(distances))


def bright_lines(pictures: np.ndarray, paint: np.ndarray) -> np.ndarray:
    """(N, H, W) uint8, 1 on lines, told by brightness alone: a judge that learned nothing.

    On the floor that the simulator says is in sight there are two kinds of pixels, bright paint and
    dark road. Otsu's threshold (1979) parts them in each picture, on red and green: blue is what
    casts take away. ``paint`` (N, 4, H, W), as of `load_paint`, says only where to look.
    """
    masks = np.zeros(pictures.shape[:3], np.uint8)
    shares = paint.astype(np.float32) / 255.0
    floors = shares[:, 0] + shares[:, 1] + shares[:, 3] >= _FLOOR_SHARE
    brightness = pictures[..., :2].mean(-1)
    for mask, light, floor in zip(masks, brightness, floors, strict=True):
        seen = np.round(light[floor]).astype(np.uint8)
        if not len(seen):
            continue
        level, _ = cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        bright = seen > level
        both = bright.any() and not bright.all()
        if both and seen[bright].mean() - seen[~bright].mean() > _LEAST_CONTRAST:
            mask[floor] = light[floor] > level
    return masks


def overlap(found: np.ndarray, expected: np.ndarray) -> float:
    """Intersection over union of all line pixels of masks (N, H, W), whatever their colour."""
    both = ((found > 0) & (expected > 0)).sum()
    either = ((found > 0) | (expected > 0)).sum()
    return float(both / either) if either else 1.0


def _network() -> list[nn.Module]:
    generator = torch.Generator().manual_seed(0)
    layers: list[nn.Module] = []
    before = 3
    for after in _CHANNELS:
        conv = nn.Conv2d(before, after, 3, 1, 1)
        with torch.no_grad():
            conv.weight.normal_(0.0, (2.0 / (9 * before)) ** 0.5, generator=generator)
            conv.bias.normal_(0.0, 0.1, generator=generator)  # type: ignore[union-attr]
        layers.append(nn.Sequential(conv, nn.ReLU()))
        before = after
    return layers


def _standardised(made: np.ndarray, real: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean, deviation = real.mean(0), np.hypot(real.std(0), _GREY_LEVEL)
    return (made - mean) / deviation, (real - mean) / deviation


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a @ b.T / a.shape[1] + 1.0) ** 3)


JUDGE_EVERY = 125
HELD_OUT_EVERY = 8  # one picture of so many is not learned from
_LARGEST_SHIFT = 0.05  # of the picture: photographs are cut a little differently each time


class UnpairedPictures:
    """Draws batches: simulated pictures with their paint, and photographs.

    ``judge`` has the simulated pictures and photographs that are not drawn.
    """

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        self.sim, self.real = (
            load_pictures([Path(folder) for folder in folders], config.image)
            for folders in (config.sim, config.real)
        )
        self._paint = load_paint(self.sim, config.image)
        self._device = device
        out, away = held_out(self.sim), held_out_photographs(self.real)
        self.judge = Judge(self.sim.part(out), self._paint[out], self.real.images[away])
        self.sim, self._paint = self.sim.part(~out), self._paint[~out]
        self.real = self.real.part(~away)

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """So many of each."""
        sim, real = self.sim.draw(count, rng), self.real.draw(count, rng)
        photographs = np.stack([_shifted(self.real.images[k], rng) for k in real])
        parts = (self.sim.images[sim], photographs, self._paint[sim])
        first, second, paint = (torch.from_numpy(part).to(self._device) for part in parts)
        return Batch(as_floats(first), as_floats(second), paint.float() / 255.0)


class Best:
    """The best generators of a training so far."""

    def __init__(self) -> None:
        self.score: Score | None = None
        self.steps = 0  # updates until then
        self.weights: list[dict[str, Any]] = []  # of sim-to-real, real-to-sim

    def offer(self, score: Score, model: CycleGan) -> None:
        """Keep the newest generators, which have this score, if none so far were better."""
        if score.better_than(self.score):
            self.score, self.steps = score, model.steps
            self.weights = [copy.deepcopy(each.state_dict()) for each in model.kept]

    def generators(self, model: CycleGan) -> tuple[nn.Module, nn.Module]:
        """Sim-to-real and real-to-sim with the weights kept, in place of the model's newest."""
        for generator, weights in zip(model.kept, self.weights, strict=True):
            generator.load_state_dict(weights)
        return model.kept_to_real, model.kept_to_sim

    def state_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "score": self.score and tuple(self.score)}

    def load_state_dict(self, state_dict: dict[str, Any], /) -> None:
        """Take it up again."""
        vars(self).update(state_dict)
        self.score = self.score and Score(*self.score)


def train_translation(out: Path, config: TranslationConfig, console: Console) -> Best:
    """Train until the steps are done; go on from a checkpoint if there is one.

    Leaves the best generators by the pictures held out as ONNX files, and ``sheet.png``.
    ConfigError if a folder of pictures is absent, empty or without labels.
    """
    on_gpu = config.device == "auto" and torch.cuda.is_available()
    device = torch.device("cuda" if on_gpu else "cpu")
    pictures = UnpairedPictures(config, device)
    model, best = CycleGan(config, device), Best()

    def step(*_: object) -> str:
        losses = model.step(pictures.draw(config.batch, model.rng))
        if model.steps % JUDGE_EVERY == 0 or model.steps == config.steps:
            kept = PictureTranslator(model.kept_to_real)
            best.offer(pictures.judge.score(lambda some: through(kept, some, device)), model)
        return f"cycle {losses['cycle']:.2f}, structure {losses['structure']:.2f}"

    parts = {"model": model, "best": best}
    Loop(out / "checkpoint.pt", parts, config.steps, config.seed).run(step, "CycleGAN", console)
    generators = [PictureTranslator(each) for each in best.generators(model)]
    for direction, generator in zip(DIRECTIONS, generators, strict=True):
        contract = TranslatorContract(
            "cyclegan", direction, config.image, out.resolve().name, best.steps
        )
        export_translator(generator, contract, onnx_file(out, direction))
    given = pictures.sim.images[:: -(-len(pictures.sim.images) // SHEET_ROWS)]
    made = through(generators[0], given)
    back = through(generators[1], made)
    draw_sheet(out / "sheet.png", {"picture": given, "translation": made, "cycle": back})
    return best


def held_out(sim: Pictures) -> np.ndarray:
    """(N,) bool: spread over every collection of two pictures or more."""
    chosen = np.zeros(len(sim.images), bool)
    for number in np.unique(sim.folder):
        mine = np.flatnonzero(sim.folder == number)
        chosen[mine[1 :: min(HELD_OUT_EVERY, max(2, len(mine) // FEWEST))]] = True
    return chosen


def held_out_photographs(real: Pictures) -> np.ndarray:
    """(N,) bool: the end of every drive of every folder, see `ends`.

    Neighbours in a drive look alike, so photographs here and there would not be strangers.
    """
    chosen = np.zeros(len(real.images), bool)
    for number in np.unique(real.folder):
        mine = np.flatnonzero(real.folder == number)
        names = [real.files[i].stem for i in mine]
        chosen[mine] = ends(names, 1.0 / HELD_OUT_EVERY, FEWEST)
    return chosen


def onnx_file(out: Path, direction: str) -> Path:
    """A run's translator in this direction, one of `robot.inference.translator.DIRECTIONS`."""
    return out / f"{direction.replace('-', '_')}.onnx"


def _shifted(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moved by a few pixels, the edge repeated: there are only some hundred photographs."""
    height, width = picture.shape[:2]
    most = max(1, round(_LARGEST_SHIFT * width))
    down, right = rng.integers(-most, most + 1, 2)
    rows = np.clip(np.arange(height) + down, 0, height - 1)
    columns = np.clip(np.arange(width) + right, 0, width - 1)
    return picture[rows][:, columns]
