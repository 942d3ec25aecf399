"""The commands from collections to a judged translator, with networks that learn nothing."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from robot.errors import ConfigError
from robot.inference.policy import DIRECTIONS, open_translator
from trainer.cli import main
from trainer.presets import preset
from trainer.transfer.cyclegan import Newest
from trainer.transfer.judge import bright_lines, overlap
from trainer.transfer.pictures import load_paint, load_pictures

FAST = preset("lane", "dueling", "fast").image


@pytest.fixture(scope="module")
def run(sim: Path, real: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "debug"
    words = ["translate", "train", "--out", str(out), "--preset", "debug", "--steps", "2"]
    assert main([*words, "--sim", str(sim), "--real", str(real)]) == 0
    return out


def test_leaves_translators_of_both_directions(run: Path) -> None:
    pictures = np.random.default_rng(0).integers(0, 256, (4, *FAST.shape), dtype=np.uint8)
    for direction, name in zip(DIRECTIONS, ("sim_to_real", "real_to_sim"), strict=True):
        translator = open_translator(run / f"{name}.onnx", FAST, direction)
        assert translator.contract.trained_steps == 2
        translation = translator(pictures)
        assert translation.shape == pictures.shape
        np.testing.assert_array_equal(translator(pictures[:1])[0], translation[0])


def test_goes_on_where_it_was_killed(
    run: Path, sim: Path, real: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begun = run / "config.yaml"
    config = begun.read_text()
    try:
        begun.write_text(config.replace("steps: 2", "steps: 3"))
        assert main(["translate", "train", "--out", str(run), "--resume"]) == 0
        assert torch.load(run / "checkpoint.pt", weights_only=True)["step"] == 3
        assert main(["translate", "train", "--out", str(run), "--sim", "a", "--real", "b"]) == 2
        assert "add --resume" in capsys.readouterr().err
    finally:
        begun.write_text(config)


def test_judges_what_was_drawn_and_translated(
    run: Path, sim: Path, real: Path, tmp_path: Path
) -> None:
    report, onnx = tmp_path / "judged.json", run / "sim_to_real.onnx"
    words = ["--model", str(onnx), "--json", str(report), "--sim", str(sim), "--real", str(real)]
    assert main(["translate", "judge", *words]) == 0
    judged = json.loads(report.read_text())
    assert judged["lanes_kept"] > 0.85  # two steps from the identity nothing has moved
    assert judged["colours_after"] == pytest.approx(judged["colours_before"], rel=0.2)
    assert judged["colours_apart"] < judged["colours_before"]
    sheet = cv2.imread(str(run / "sheet.png"))
    width = 2 * FAST.shape[1] + 4
    assert sheet.shape[1] == 3 * width
    picture, translation, cycle = (sheet[16:, width * k : width * (k + 1)] for k in range(3))
    for made in (translation, cycle):
        assert np.abs(made.astype(int) - picture).mean() < 5.0


def test_overlap_is_that_of_all_line_pixels() -> None:
    line = np.array([[[0, 1, 1, 2]]])
    assert overlap(line, line) == 1.0
    assert overlap(np.array([[[0, 2, 1, 1]]]), line) == 1.0  # the colour does not count
    assert overlap(np.array([[[1, 1, 0, 0]]]), line) == 0.25
    assert overlap(np.zeros((1, 1, 4)), np.zeros((1, 1, 4))) == 1.0


def test_training_without_folders_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["translate", "train", "--out", str(tmp_path / "new")]) == 2
    assert "expected --sim and --real folders" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_film_is_no_collection_of_the_simulators(sim: Path, tmp_path: Path) -> None:
    film = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (160, 120))
    for level in (0, 90, 200):
        writer.write(np.full((120, 160, 3), level, np.uint8))
    writer.release()
    for folders in ([film], [sim, film]):
        with pytest.raises(ConfigError, match="folders of duckpilot collect, got a film"):
            load_paint(load_pictures(folders, FAST), FAST)


def test_one_photograph_is_enough_to_judge_by(
    run: Path, sim: Path, real: Path, tmp_path: Path
) -> None:
    picture = next(path for path in sorted(real.rglob("*")) if path.is_file())
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / picture.name).write_bytes(picture.read_bytes())
    words = ["--model", str(run / "sim_to_real.onnx"), "--json", str(tmp_path / "j.json")]
    words += ["--sim", str(sim), "--real", str(tmp_path / "one")]
    assert main(["translate", "judge", *words]) == 0
    assert json.loads((tmp_path / "j.json").read_text())["colours_apart"] == 0.0


def test_lines_are_found_by_brightness_where_they_are_painted(sim: Path) -> None:
    pictures = load_pictures([sim], FAST)
    paint = load_paint(pictures, FAST)
    truth = (paint[:, :2] > 127).any(1)
    found = bright_lines(pictures.images, paint)
    assert overlap(found, truth) > 0.6  # at the edges pixels are half paint
    dim = (pictures.images * (0.7, 0.6, 0.3)).astype(np.uint8)
    assert overlap(bright_lines(dim, paint), found) > 0.9
    moved = np.roll(pictures.images, 3, axis=2)
    assert overlap(bright_lines(moved, paint), found) < 0.7
    assert not bright_lines(np.full_like(dim, 90), paint).any()


def test_the_newest_that_keep_enough_of_the_lines_are_kept() -> None:
    generators, newest = torch.nn.Linear(1, 1), Newest()
    for steps, lanes, kept in (
        (1, 0.5, 1),  # none keeps enough yet: the best so far
        (2, 0.4, 1),
        (3, 0.7, 3),
        (4, 0.95, 4),
        (5, 0.86, 5),  # enough
        (6, 0.85, 5),  # short of what is due, with a margin
        (7, 0.9, 7),
    ):
        torch.nn.init.constant_(generators.weight, float(steps))
        newest.offer(lanes, generators, steps)
        assert newest.steps == float(newest.weights["weight"]) == kept
    again = Newest()
    again.load_state_dict(newest.state_dict())
    assert (again.steps, again.lanes) == (7, 0.9)
