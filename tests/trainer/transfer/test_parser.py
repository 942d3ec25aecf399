from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.policy import PARSING, OnnxTranslator
from trainer import resumable
from trainer.cli import main
from trainer.transfer.cli import ParseOptions
from trainer.transfer.labelled import ROAD, Labelled
from trainer.transfer.networks import SegNet, unpooled
from trainer.transfer.parser import (
    class_weights,
    load_parser,
    save_parser,
    score_classes,
    teach,
)

HEIGHT, WIDTH = 24, 32


def stripes(count: int) -> Labelled:
    """Dark road, a bright line somewhere."""
    frames = np.full((count, HEIGHT, WIDTH, 3), 60, np.uint8)
    truth = np.full((count, HEIGHT, WIDTH), 1, np.uint8)
    for i in range(count):
        column = 4 + (5 * i) % (WIDTH - 8)
        frames[i, :, column : column + 4] = 230
        truth[i, :, column : column + 4] = 2
    return Labelled(np.array([f"s_{i}" for i in range(count)]), frames, truth)


@pytest.mark.parametrize("size", [(24, 32), (15, 21), (120, 160)])
def test_any_size_comes_out_as_it_went_in(size: tuple[int, int]) -> None:
    network = SegNet(6, (4, 6, 8), (1, 1, 2))
    assert network(torch.zeros(1, *size, 3, dtype=torch.uint8)).shape == (1, 6, *size)


@pytest.mark.parametrize("size", [(8, 10), (7, 9)])
def test_values_go_back_where_their_maxima_were(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    grid = torch.from_numpy(rng.integers(0, 3, (2, 3, *size)).astype(np.float32))  # with ties
    pooled, indices = torch.nn.MaxPool2d(2, return_indices=True)(grid)
    values = torch.from_numpy(rng.standard_normal(pooled.shape, np.float32))
    wanted = torch.nn.MaxUnpool2d(2)(values, indices, output_size=grid.shape)
    assert torch.equal(unpooled(values, indices, grid.shape), wanted)


def test_a_stripe_is_learned_and_a_parser_survives_its_file(tmp_path: Path) -> None:
    config = ParseOptions(size=(HEIGHT, WIDTH), steps=40, batch=4)
    parser = teach(config, [stripes(6)], tmp_path / "checkpoint.pt", Console(quiet=True))
    test = stripes(9)
    result = score_classes(test.truth, parser.parse(test.frames), ROAD)
    assert result.classes[2].iou > 0.6
    save_parser(parser, tmp_path / "parser.pt")
    frames = stripes(3).frames
    assert np.array_equal(load_parser(tmp_path / "parser.pt").parse(frames), parser.parse(frames))
    with pytest.raises(ConfigError, match="expected frames"):
        parser.parse(frames[:, :8])
    parser.export("here", tmp_path / "parser.onnx")
    translator = OnnxTranslator(tmp_path / "parser.onnx")
    assert translator.contract.image == ImageSpec(WIDTH, HEIGHT)
    assert translator.contract.direction == PARSING
    for few in (frames[:1], frames):
        np.testing.assert_array_equal(translator(few), ROAD.paint(parser.parse(few)))


def test_rare_classes_count_more_in_the_loss_and_absent_ones_as_usual() -> None:
    some = stripes(4)
    some.truth[:, 0, 0] = 5
    shares = {k: np.mean(some.truth == k) for k in (1, 2, 5)}
    weights = class_weights([some], 6)
    assert weights[1] < weights[2] < weights[5] <= 3.16
    assert weights[2] / weights[1] == pytest.approx((shares[1] / shares[2]) ** 0.25)
    assert weights[[0, 3, 4]].tolist() == [1.0, 1.0, 1.0]


class StopError(Exception):
    pass


def test_a_loop_that_was_killed_ends_as_one_that_was_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resumable, "SAVE_EVERY_S", -1.0)  # every step is saved

    def run(path: Path, stop_at: int) -> torch.Tensor:
        torch.manual_seed(0)
        layer = torch.nn.Linear(3, 1)
        optimiser = torch.optim.Adam(layer.parameters(), 0.1)
        parts = {"l": layer, "o": optimiser}

        def step(rng: np.random.Generator, k: int) -> str:
            if k == stop_at:
                raise StopError
            x = torch.from_numpy(rng.standard_normal((4, 3), np.float32)) + torch.rand(4, 3)
            optimiser.zero_grad()
            layer(x).square().mean().backward()
            optimiser.step()
            return ""

        resumable.run_steps(path, parts, 8, 3, step, "test", Console(quiet=True))
        return layer.weight.detach()

    with pytest.raises(StopError):
        run(tmp_path / "killed.pt", 5)
    assert torch.load(tmp_path / "killed.pt", weights_only=True)["step"] == 5
    resumed = run(tmp_path / "killed.pt", -1)
    assert torch.equal(resumed, run(tmp_path / "whole.pt", -1))


def test_the_command_refuses_what_does_not_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    for arguments, message in (
        ([], "expected --pairs or --annotations"),
        (["--pairs", str(tmp_path)], "expected pictures"),
    ):
        assert main(["parse", "train", "--out", str(out), *arguments]) == 2
        assert message in capsys.readouterr().err
    for wrong, valid in ((["--net", "smal"], "'small'"), (["--labels", "rode"], "'road'")):
        with pytest.raises(SystemExit) as ended:
            main(["parse", "train", "--out", str(out), *wrong])
        assert ended.value.code == 2
        assert valid in capsys.readouterr().err
    assert not out.exists()


def test_camvid_from_the_command_line(data_dir: Path, tmp_path: Path) -> None:
    pairs = str(data_dir / "real" / "camvid_parsing_pairs")
    arguments = ["--labels", "camvid", "--pairs", pairs, "--size", "30", "40"]
    out = tmp_path / "run"
    steps = ["--steps", "4", "--batch", "2"]
    assert main(["parse", "train", "--out", str(out), *arguments, *steps]) == 0
    names = {path.name for path in out.iterdir()}
    assert names == {"config.yaml", "checkpoint.pt", "parser.pt", "scores.json", "sheet.png"}
