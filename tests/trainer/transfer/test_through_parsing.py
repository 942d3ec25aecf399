from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from robot.errors import ConfigError
from robot.inference.policy import OnnxTranslator
from sim_pybullet.scene import SemanticClass
from tests.trainer.judge_parsing import kept
from trainer.cli import main
from trainer.learners.backbone import centred
from trainer.presets import preset
from trainer.transfer import pix2pix
from trainer.transfer.cli import ParseOptions, ThroughOptions
from trainer.transfer.labelled import ROAD
from trainer.transfer.networks import SEGNETS, as_bytes
from trainer.transfer.parser import Parser, save_parser
from trainer.transfer.pix2pix import (
    PIX2PIX,
    Pairs,
    Pix2Pix,
    Pix2PixConfig,
    ThroughParsing,
)

CLASS = {name: k for k, name in enumerate(ROAD.classes)}


def generator(config: Pix2PixConfig) -> torch.nn.Module:
    return Pix2Pix(config, 0).generator


PAPER, SMALL = PIX2PIX["paper"], PIX2PIX["small"]
TINY = Pix2PixConfig((16, 32), 8, 2, 2, batch=4, learning_rate=1e-3)


def test_the_papers_network_is_as_it_says() -> None:
    network = Pix2Pix(PAPER, 0).generator
    convolutions = [m for m in network.modules() if isinstance(m, torch.nn.Conv2d)]
    enlargements = [m for m in network.modules() if isinstance(m, torch.nn.ConvTranspose2d)]
    assert (len(convolutions), len(enlargements)) == (8, 8)
    for layer in (*convolutions, *enlargements):
        assert (layer.kernel_size, layer.stride) == ((4, 4), (2, 2))
    leaks = [m.negative_slope for m in network.modules() if isinstance(m, torch.nn.LeakyReLU)]
    assert leaks == [0.2] * 8
    assert (PAPER.learning_rate, PAPER.momentum, PAPER.batch) == (2e-4, 0.5, 16)
    assert PAPER.size == (256, 256)


def test_a_patch_of_the_papers_critic_is_70_pixels_wide() -> None:
    model = Pix2Pix(PAPER, 0)
    model.critic.eval()
    given = torch.zeros(1, 3, 256, 256, requires_grad=True)
    scores = model.judged(given, torch.zeros(1, 3, 256, 256))
    scores[0, 0, scores.shape[2] // 2, scores.shape[3] // 2].backward()
    assert given.grad is not None
    seen = given.grad[0].abs().sum(0).nonzero()
    assert (seen.max(0).values - seen.min(0).values + 1).tolist() == [70, 70]


@pytest.mark.parametrize("config", [SMALL, TINY], ids=["small", "tiny"])
def test_a_translation_is_as_large_as_the_picture(config: Pix2PixConfig) -> None:
    network = generator(config)
    for size in ((40, 80), (24, 36), (35, 50)):
        made = network(torch.zeros(2, 3, *size))
        assert made.shape == (2, 3, *size)
        assert made.abs().max() <= 1.0


def stripes(count: int, rng: np.random.Generator) -> Pairs:
    """A grey road with a bright stripe; what it should become: its classes, painted."""
    truth = np.full((count, 16, 32), CLASS["road"], np.uint8)
    for k, column in enumerate(rng.integers(2, 26, count)):
        truth[k, :, column : column + 4] = CLASS["yellow_line"]
    given = np.where(truth[..., None] == CLASS["road"], (60, 60, 64), (180, 150, 60))
    return Pairs(given.astype(np.uint8), ROAD.paint(truth))


def test_a_stripe_is_parsed_where_it_is() -> None:
    rng = np.random.default_rng(0)
    model, training, test = Pix2Pix(TINY, 0), stripes(32, rng), stripes(8, rng)
    for _ in range(80):
        model.step(*training.draw(TINY.batch, rng))
    network = ThroughParsing(model.generator.eval(), generator(TINY).eval())
    with torch.no_grad():
        found = network.parsed(torch.from_numpy(test.given)).permute(0, 2, 3, 1).numpy()
    painted = ((found + 1.0) * 127.5).round().astype(np.uint8)
    assert set(np.unique(ROAD.read(painted))) <= set(range(len(ROAD.classes)))
    assert np.mean(ROAD.read(painted) == ROAD.read(test.wanted)) > 0.97


def test_lines_stay_where_no_photograph_shows_any() -> None:
    """Photographs without lines teach to paint none; told where paint is, it is painted there."""
    rng = np.random.default_rng(0)
    shown = stripes(16, rng)
    paint = np.zeros((16, 16, 32, 4), np.uint8)
    paint[..., 1] = 255 * (ROAD.read(shown.wanted) == CLASS["yellow_line"])
    paint[..., 3] = 255 - paint[..., 1]
    bare = np.full_like(shown.given, 60)
    contrasts = []
    for lines in (None, Pairs(shown.wanted, paint)):
        model = Pix2Pix(replace(TINY, structure=100.0), 0)
        pairs = Pairs(shown.wanted, bare, lines)
        for _ in range(120):
            drawn = [each.draw(4, rng) for each in (pairs, lines) if each]
            model.step(*drawn[0], *drawn[1:])
        with torch.no_grad():
            made = model.generator.eval()(centred(torch.from_numpy(shown.wanted)))[:, :2].mean(1)
        painted = torch.from_numpy(paint[..., 1] > 0)
        contrasts.append(float(made[painted].mean() - made[~painted].mean()))
    assert abs(contrasts[0]) < 0.15 < 0.3 < contrasts[1]


@pytest.mark.parametrize(("net", "told"), [("small", [False, True]), ("paper", [False, False])])
def test_only_the_small_network_is_told_where_lines_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, net: str, told: list[bool]
) -> None:
    """And of its halves the second, which knows lines by a parser alone."""
    seen = []

    def untaught(_: Pix2Pix, pairs: Pairs, *__: object) -> torch.nn.Module:
        seen.append(pairs.lines is not None)
        return generator(TINY).eval()

    monkeypatch.setattr(pix2pix, "teach_pairs", untaught)
    inputs, out = write_inputs(tmp_path, (60, 80)), str(tmp_path / "run")
    assert main(["parse", "translate", "--out", out, *inputs, "--net", net]) == 0
    assert seen == told


def test_lines_as_bright_as_paint_are_kept_and_a_run_that_is_none_is_refused(
    tmp_path: Path,
) -> None:
    inputs, out = write_inputs(tmp_path, (60, 80)), tmp_path / "run"
    assert main(["parse", "translate", "--out", str(out), *inputs, "--steps", "1"]) == 0
    for name in ("000000", "000001"):
        label = np.full((120, 160), SemanticClass.ROAD, np.uint8)
        label[:, 40:60], label[:, 100:120] = SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE
        cv2.imwrite(str(tmp_path / "sim" / "label" / f"{name}.png"), label)
        seen = np.where(label[..., None] == SemanticClass.ROAD, 50, 200).repeat(3, axis=2)
        cv2.imwrite(str(tmp_path / "sim" / "image" / f"{name}.png"), seen.astype(np.uint8))
    shares = kept(out, tmp_path / "sim")
    assert shares["paint"] == shares["true classes"] == 1.0
    assert shares["translation"] < 0.9  # of networks that have learned nothing
    with pytest.raises(ConfigError, match="half of a translation"):
        kept(tmp_path, tmp_path / "sim")


def test_between_the_networks_each_pixel_is_the_nearest_classes_colour() -> None:
    torch.manual_seed(0)
    network = ThroughParsing(generator(TINY).eval(), generator(TINY).eval())
    pictures = torch.randint(0, 256, (3, 16, 32, 3), dtype=torch.uint8)
    with torch.no_grad():
        seen = as_bytes(network.to_parsing(centred(pictures))).numpy()
        read = as_bytes(network.parsed(pictures)).numpy()
    assert np.mean(ROAD.paint(ROAD.read(seen)) == read) > 0.999  # bytes are rounded


def write_inputs(folder: Path, size: tuple[int, int]) -> list[str]:
    """A collection, photographs and a parser that has learned nothing."""
    rng = np.random.default_rng(0)
    for part, name in (("sim/image", "000000"), ("sim/image", "000001"), ("real", "a")):
        (folder / part).mkdir(parents=True, exist_ok=True)
        picture = rng.integers(0, 256, (120, 160, 3), np.uint8)
        cv2.imwrite(str(folder / part / f"{name}.png"), picture)
    (folder / "sim" / "label").mkdir()
    for name in ("000000", "000001"):
        labels = rng.integers(0, 12, (120, 160), np.uint8)
        cv2.imwrite(str(folder / "sim" / "label" / f"{name}.png"), labels)
    (folder / "sim" / "collection.yaml").write_text("kind: simulator\n")
    save_parser(Parser(ParseOptions(size=size)), folder / "parser.pt")
    names = {"--sim": "sim", "--real": "real", "--parser": "parser.pt"}
    return [text for flag, name in names.items() for text in (flag, str(folder / name))]


@pytest.mark.parametrize("size", [(60, 80), (90, 120)], ids=["the policy's", "larger"])
def test_the_command_leaves_a_translator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: tuple[int, int]
) -> None:
    image = preset("lane", "dueling", "fast").image
    inputs, out = write_inputs(tmp_path, size), tmp_path / "run"
    command = ["parse", "translate", "--out", str(out), *inputs, "--steps", "1"]
    assert main(command) == 0
    translator = OnnxTranslator(out / "sim_to_real.onnx")
    assert (translator.contract.method, translator.contract.image) == ("pix2pix", image)
    made = translator(np.zeros((3, *image.shape), np.uint8))
    assert made.shape == (3, *image.shape)
    assert (out / "sheet.png").exists()
    capsys.readouterr()
    assert main(command) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*command, "--resume"]) == 0


def test_a_parser_of_photographs_knows_roads_only() -> None:
    assert set(PIX2PIX) == set(SEGNETS) == {"paper", "small"}
    with pytest.raises(ConfigError, match="expected road with a parser"):
        ThroughOptions("a", "b", "c", "fast", "small", 1, 0, labels="track")
