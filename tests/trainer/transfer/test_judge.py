"""Which generators of a training are kept."""

from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.presets import preset
from trainer.transfer.cyclegan import CycleGan, translation_preset
from trainer.transfer.networks import as_bytes
from trainer.transfer.pictures import Pictures, load_paint, load_pictures
from trainer.transfer.unpaired import (
    Best,
    Judge,
    Score,
    UnpairedPictures,
    held_out,
    held_out_photographs,
)

FAST: ImageSpec = preset("lane", "dueling", "fast").image
SCORES = [Score(kid, lanes) for kid, lanes in product((0.5, 2.0), (0.7, 0.855, 0.87, 0.95))]


def test_nothing_that_loses_lines_takes_the_place_of_what_keeps_them() -> None:
    for new, old in product(SCORES, SCORES):
        if new.better_than(old):
            assert not old.better_than(new)
            assert new.lanes >= 0.86 or new.lanes > old.lanes
    assert Score(0.5, 0.87).better_than(Score(2.0, 0.95))
    assert not Score(0.5, 0.70).better_than(Score(2.0, 0.95))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
def test_the_best_is_kept_whenever_it_comes(order: tuple[int, ...]) -> None:
    model = CycleGan(translation_preset("debug", ("sim",), ("real",)), torch.device("cpu"))
    scores = [Score(2.0, 0.95), Score(0.5, 0.9), Score(0.1, 0.5)]
    best = Best()
    for k in order:
        model.steps = 10 + k
        best.offer(scores[k], model)
        with torch.no_grad():
            next(model.kept_to_real.parameters()).add_(1.0)  # what is kept stays as it was
    assert (best.score, best.steps) == (scores[1], 11)
    first = next(iter(best.weights[0].values()))
    now = next(model.kept_to_real.parameters())
    assert float((now - first).mean()) == pytest.approx(3 - order.index(1))


def test_pictures_held_out_are_of_every_collection() -> None:
    folder = np.repeat([0, 1, 2, 3], [30, 6, 2, 1])
    out = held_out(Pictures(np.zeros((39, 1, 1, 3)), folder, ()))
    assert [int(out[folder == k].sum()) for k in range(4)] == [4, 2, 1, 0]


def test_one_picture_is_too_few(sim: Path, real: Path) -> None:
    pictures, photographs = (load_pictures([folder], FAST) for folder in (sim, real))
    one = np.arange(len(pictures.images)) == 0
    paint = load_paint(pictures, FAST)
    with pytest.raises(ConfigError, match="got too few"):
        Judge(pictures.part(one), paint[one], photographs.images)


def test_the_identity_keeps_all_lines(sim: Path, real: Path) -> None:
    pictures, photographs = (load_pictures([folder], FAST) for folder in (sim, real))
    paint = load_paint(pictures, FAST)
    asked = Judge(pictures, paint, photographs.images)
    assert asked.score(lambda some: some).lanes == 1.0
    assert asked.score(np.zeros_like).lanes == 0.0


def test_photographs_held_out_are_the_end_of_every_drive() -> None:
    names = [f"noon_{k:04d}" for k in range(32)] + [f"night_{k:04d}" for k in range(5)] + ["one_0"]
    files = tuple(Path(f"site/{name}.png") for name in names)
    pictures = Pictures(np.zeros((38, 1, 1, 3)), np.zeros(38, int), files)
    out = held_out_photographs(pictures)
    assert [n for n, away in zip(names, out, strict=True) if away] == [
        *(f"noon_{k:04d}" for k in range(28, 32)),
        *(f"night_{k:04d}" for k in (3, 4)),
    ]


def test_nobody_is_judged_by_photographs_that_taught(
    sim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every photograph has a colour of its own; which are drawn, and which are judged by?"""
    judged: set[int] = set()
    monkeypatch.setattr(
        "trainer.transfer.unpaired.features",
        lambda pictures: judged.update(pictures[:, 0, 0, 0].tolist()),
    )
    for folder, first in (("a", 20), ("b", 120)):
        (tmp_path / folder).mkdir()
        for k in range(9):
            picture = np.full((60, 80, 3), first + 5 * k, np.uint8)
            cv2.imwrite(str(tmp_path / folder / f"drive_{k}.png"), picture)
    folders = tuple(str(tmp_path / folder) for folder in "ab")
    config = translation_preset("debug", (str(sim),), folders)
    pictures = UnpairedPictures(config, torch.device("cpu"))
    rng, drawn = np.random.default_rng(0), set()
    for _ in range(40):
        real = as_bytes(pictures.draw(4, rng).real)
        drawn |= set(real[:, 0, 0, 0].tolist())
    assert judged == {20 + 5 * 7, 20 + 5 * 8, 120 + 5 * 7, 120 + 5 * 8}
    assert drawn == {first + 5 * k for first in (20, 120) for k in range(7)}
