"""CycleGAN (Zhu et al. 2017): one step; a run from its beginning, or from where it was cut off.

Pictures come closer to photographs the longer it goes on, and lines fade. So the newest generators
are kept that leave enough of the lines.
"""

import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from rich.console import Console
from torch import nn
from torch.nn import functional

from robot.contract import ImageSpec
from robot.inference.policy import DIRECTIONS, TranslatorContract
from trainer.export import export_translator
from trainer.learners.backbone import centred
from trainer.presets import preset
from trainer.resumable import descend, run_steps, set_rate
from trainer.transfer.judge import LANE_OVERLAP, lanes_kept
from trainer.transfer.networks import PictureTranslator, narrow_unet, patch_critic, through
from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, load_paint, load_pictures

AVERAGED_STEPS = 200  # over which the weights that are kept are averaged
# Of the structure loss:
WINDOW_PX = 7
_NO_PAINT = 1e-3  # variance of the template below which a window shows no edge of a line
_FLAT = 0.2  # standard deviation that bare road may have, of a range of 2
_FLOOR = 1e-4  # variance that counts as none


@dataclass(frozen=True)
class TranslationConfig:
    """CycleGAN (Zhu et al. 2017); ``config.yaml`` of a run's folder.

    The preset ``paper`` has its weights and learning rate; ``fast`` is in more of a hurry.
    """

    sim: tuple[str, ...]  # folders of simulated frames with labels
    real: tuple[str, ...]  # folders of photographs
    image: ImageSpec
    width: int = 12  # channels of the first layer
    blocks: int = 1  # residual blocks at the narrowest place
    critic_width: int = 16
    critic_layers: int = 2  # that halve; with 2 a patch is 34 px wide, with 3 it is 70
    steps: int = 2_000
    batch: int = 2
    learning_rate: float = 6e-4
    decay_from: float = 0.5  # share of the steps after which the rate falls linearly to 0
    cycle: float = 10.0  # weights of the losses
    identity: float = 1.0
    structure: float = 5.0  # that painted lines stay where they are
    pool: int = 50  # translations that the critics may see again (Shrivastava et al. 2017)
    seed: int = 0
    device: str = "cpu"


def translation_preset(name: str, sim: tuple[str, ...], real: tuple[str, ...]) -> TranslationConfig:
    """The named starting point, with the pictures of that preset's policies."""
    fast = TranslationConfig(sim, real, preset("lane", "dueling", name).image)
    paper: dict[str, Any] = {
        "width": 32, "blocks": 6, "critic_width": 64, "critic_layers": 3,
        "steps": 100_000, "batch": 1, "learning_rate": 2e-4, "identity": 5.0, "device": "auto",
    }  # fmt: skip
    debug = {"width": 8, "critic_width": 8, "steps": 8, "pool": 4}
    return replace(fast, **{"fast": {}, "paper": paper, "debug": debug}[name])


class Batch(NamedTuple):
    """Unpaired pictures (N, 3, H, W) in [-1, 1]; of the simulated ones the paint (N, 4, H, W)."""

    sim: torch.Tensor
    real: torch.Tensor
    paint: torch.Tensor


def adversarial(scores: torch.Tensor, real: bool) -> torch.Tensor:
    """Least squares (Mao et al. 2017)."""
    return functional.mse_loss(scores, torch.full_like(scores, float(real)))


def structure(translation: torch.Tensor, paint: torch.Tensor) -> torch.Tensor:
    """How little the painted lines of a translation lie where the simulator has them; 0 at best.

    Around every edge of a line the brightness must go as the paint does, and the yellowness as the
    yellow paint does, whatever the light and the colour of the road: one minus their normalised
    cross-correlation in windows. Bare road must show no contrast like that of a line.

    ``translation`` (N, 3, H, W) is in [-1, 1]; ``paint`` (N, 4, H, W) in [0, 1], shares of white,
    yellow and red paint and of road.
    """
    red, green, blue = translation.unbind(1)
    brightness = (red + green + blue)[:, None] / 3.0
    yellowness = (0.5 * (red + green) - blue)[:, None]
    white, yellow, _, road = (part[:, None] for part in paint.unbind(1))
    unlike = _unlike(brightness, white + 0.8 * yellow) + _unlike(yellowness, yellow)
    bare = (_pooled(road) > 0.99).float()
    variance = (_pooled(brightness**2) - _pooled(brightness) ** 2).clamp_min(0.0)
    excess = functional.relu(torch.sqrt(variance + _FLOOR) - _FLAT)
    return unlike + (bare * excess).sum() / bare.sum().clamp_min(1.0)


def _unlike(seen: torch.Tensor, template: torch.Tensor) -> torch.Tensor:
    mean_seen, mean_template = _pooled(seen), _pooled(template)
    covariance = _pooled(seen * template) - mean_seen * mean_template
    seen_variance = (_pooled(seen * seen) - mean_seen**2).clamp_min(0.0)
    variance = (_pooled(template * template) - mean_template**2).clamp_min(0.0)
    likeness = covariance / torch.sqrt((seen_variance + _FLOOR) * (variance + _FLOOR))
    weight = torch.sqrt(variance) * (variance > _NO_PAINT)
    return (weight * (1.0 - likeness)).sum() / weight.sum().clamp_min(1.0)


def _pooled(values: torch.Tensor) -> torch.Tensor:
    return functional.avg_pool2d(values, WINDOW_PX, 1)


class Memory:
    """What a training goes on with beside its weights: the attributes, plain data and tensors."""

    def state_dict(self) -> dict[str, Any]:
        """All of them."""
        return dict(vars(self))

    def load_state_dict(self, state_dict: dict[str, Any], /) -> None:
        """Take them up again."""
        vars(self).update(state_dict)


class ImagePool(Memory):
    """Earlier translations that a critic sees again, lest it forgets them."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.pictures: list[torch.Tensor] = []

    def exchanged(self, made: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
        """The translations, half of them exchanged for earlier ones."""
        given = []
        for picture in made.detach():
            if len(self.pictures) < self._size:
                self.pictures.append(picture)
            elif rng.random() < 0.5:
                k = int(rng.integers(self._size))
                self.pictures[k], picture = picture, self.pictures[k].to(made.device)
            given.append(picture)
        return torch.stack(given)


class CycleGan:
    """Two generators, two critics, their optimisers and pools: ``parts``, by name.

    ``kept`` are the generators to use, to real and to sim: running means of the weights. Generators
    and critics chase each other; a mean stands still (Yazici et al. 2019).
    """

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        generators = [narrow_unet(config.width, config.blocks) for _ in range(2)]
        critics = [patch_critic(config.critic_width, config.critic_layers) for _ in range(2)]
        self._pair = nn.ModuleList(generators).to(device)
        self.kept = copy.deepcopy(self._pair).requires_grad_(False)
        self._judges = nn.ModuleList(critics).to(device)
        self.to_real, self.to_sim = self._pair
        self.real_critic, self.sim_critic = self._judges
        self.generators, self.critics = (
            torch.optim.Adam(part.parameters(), config.learning_rate, (0.5, 0.999), fused=True)
            for part in (self._pair, self._judges)
        )
        self.real_pool, self.sim_pool = (ImagePool(config.pool) for _ in range(2))
        names = "_pair", "kept", "_judges", "generators", "critics", "real_pool", "sim_pool"
        self.parts: dict[str, Any] = {name: getattr(self, name) for name in names}

    def step(self, batch: Batch, rng: np.random.Generator, k: int) -> dict[str, float]:
        """Update ``k`` of all four networks; the losses by name, unweighted."""
        set_rate((self.generators, self.critics), self._rate(k))
        made_real, made_sim, losses = self._generate(batch, k)
        for name, critic, real, made, pool in (
            ("critic_real", self.real_critic, batch.real, made_real, self.real_pool),
            ("critic_sim", self.sim_critic, batch.sim, made_sim, self.sim_pool),
        ):
            earlier = pool.exchanged(made, rng)
            told = adversarial(critic(real), True) + adversarial(critic(earlier), False)
            losses[name] = 0.5 * told
        descend(self.critics, losses["critic_real"] + losses["critic_sim"])
        self._average(k + 1)
        return {name: float(loss.detach()) for name, loss in losses.items()}

    def _generate(
        self, batch: Batch, k: int
    ) -> tuple[torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        config = self.config
        self._judges.requires_grad_(False)
        made_real, made_sim = self.to_real(batch.sim), self.to_sim(batch.real)
        losses = {
            "fool_real": adversarial(self.real_critic(made_real), True),
            "fool_sim": adversarial(self.sim_critic(made_sim), True),
            "cycle": functional.l1_loss(self.to_sim(made_real), batch.sim)
            + functional.l1_loss(self.to_real(made_sim), batch.real),
            "structure": structure(made_real, batch.paint),
        }
        total = losses["fool_real"] + losses["fool_sim"] + config.cycle * losses["cycle"]
        if config.identity:
            # both directions in turns, each counted twice: the same on average for half the work
            network, same = (self.to_real, batch.real) if k % 2 else (self.to_sim, batch.sim)
            losses["identity"] = 2.0 * functional.l1_loss(network(same), same)
            total = total + config.identity * losses["identity"]
        descend(self.generators, total + config.structure * losses["structure"])
        self._judges.requires_grad_(True)
        return made_real.detach(), made_sim.detach(), losses

    @torch.no_grad()
    def _average(self, steps: int) -> None:
        for kept, newest in zip(self.kept.parameters(), self._pair.parameters(), strict=True):
            kept.lerp_(newest, 1.0 / min(steps, AVERAGED_STEPS))

    def _rate(self, k: int) -> float:
        begin = self.config.decay_from * self.config.steps
        left = 1.0 - max(0.0, k - begin) / max(1.0, self.config.steps - begin)
        return self.config.learning_rate * left


JUDGE_EVERY = 125  # updates
JUDGED_EVERY = 8  # one picture of so many
_DUE = LANE_OVERLAP + 0.01  # since other pictures give other figures
_LARGEST_SHIFT = 0.05  # of the picture: photographs are cut a little differently each time


class UnpairedPictures:
    """Draws batches: simulated pictures with their paint, and photographs."""

    def __init__(self, config: TranslationConfig, device: torch.device | str) -> None:
        self.sim, self._real = (
            load_pictures([Path(folder) for folder in folders], config.image)
            for folders in (config.sim, config.real)
        )
        self._paint, self._device = load_paint(self.sim, config.image), device

    def lanes_kept(self, translator: PictureTranslator) -> float:
        """As of `trainer.transfer.judge.lanes_kept`, of some of the pictures."""
        pictures, folder, paint = (
            part[::JUDGED_EVERY] for part in (self.sim.images, self.sim.folder, self._paint)
        )
        return lanes_kept(pictures, folder, paint, through(translator, pictures, self._device))

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """So many of each."""
        sim, real = self.sim.draw(count, rng), self._real.draw(count, rng)
        photographs = np.stack([_shifted(self._real.images[k], rng) for k in real])
        parts = (self.sim.images[sim], photographs, self._paint[sim])
        first, second, paint = (torch.from_numpy(part).to(self._device) for part in parts)
        return Batch(centred(first), centred(second), paint.float() / 255.0)


class Newest(Memory):
    """The newest generators of a training that keep enough of the lines; else those of the most."""

    def __init__(self) -> None:
        self.lanes, self.steps = -1.0, 0  # updates until then
        self.weights: dict[str, Any] = {}

    def offer(self, lanes: float, generators: nn.Module, steps: int) -> None:
        """Keep a copy of the weights, if they are to be kept."""
        if lanes >= min(_DUE, self.lanes):
            self.lanes, self.steps = lanes, steps
            self.weights = copy.deepcopy(generators.state_dict())


def train_translation(out: Path, config: TranslationConfig, console: Console) -> Path:
    """Train until the steps are done; go on from a checkpoint if there is one.

    Leaves both translators as ONNX files, and ``sheet.png``; the path of sim-to-real. ConfigError
    if a folder of pictures is absent, empty or without labels.
    """
    on_gpu = config.device == "auto" and torch.cuda.is_available()
    device = torch.device("cuda" if on_gpu else "cpu")
    pictures, model = UnpairedPictures(config, device), CycleGan(config, device)
    newest = Newest()

    def step(rng: np.random.Generator, k: int) -> str:
        losses, done = model.step(pictures.draw(config.batch, rng), rng, k), k + 1
        if done % JUDGE_EVERY == 0 or done == config.steps:
            newest.offer(pictures.lanes_kept(PictureTranslator(model.kept[0])), model.kept, done)
        return f"cycle {losses['cycle']:.2f}, structure {losses['structure']:.2f}"

    parts = {**model.parts, "newest": newest}
    run_steps(out / "checkpoint.pt", parts, config.steps, config.seed, step, "CycleGAN", console)
    model.kept.load_state_dict(newest.weights)
    generators = [PictureTranslator(each) for each in model.kept]
    of_run = config.image, out.resolve().name, newest.steps
    files = [out / f"{direction.replace('-', '_')}.onnx" for direction in DIRECTIONS]
    for direction, generator, file in zip(DIRECTIONS, generators, files, strict=True):
        export_translator(generator, TranslatorContract("cyclegan", direction, *of_run), file)
    given = pictures.sim.images[:: -(-len(pictures.sim.images) // SHEET_ROWS)]
    made = through(generators[0], given)
    back = through(generators[1], made)
    draw_sheet(out / "sheet.png", {"picture": given, "translation": made, "cycle": back})
    return files[0]


def _shifted(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moved by a few pixels, the edge repeated: there are only some hundred photographs."""
    height, width = picture.shape[:2]
    most = max(1, round(_LARGEST_SHIFT * width))
    down, right = most + rng.integers(-most, most + 1, 2)
    wider = np.pad(picture, ((most, most), (most, most), (0, 0)), "edge")
    return wider[down : down + height, right : right + width]
