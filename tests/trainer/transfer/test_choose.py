"""What is chosen is chosen on training frames."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.console import Console

from tests.trainer.transfer.test_parser import HEIGHT, WIDTH, stripes
from trainer.cli import main
from trainer.transfer import parser as parsers
from trainer.transfer.labelled import Labelled
from trainer.transfer.parser import ParseConfig, Parser, choose_undone

QUIET = Console(quiet=True)
CONFIG = ParseConfig("road", height_px=HEIGHT, width_px=WIDTH, steps=30, batch=4)


def test_who_learns_and_who_is_asked_share_no_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learned: list[str] = []
    asked: list[str] = []

    def teach(config: ParseConfig, sources: list[Labelled], path: Path, console: Console) -> Parser:
        learned.extend(name for source in sources for name in source.names)
        return teach_parser(config, sources, path, console)

    def evaluate(parser: Parser, data: Labelled, source: str = "") -> object:
        asked.extend(data.names)
        return evaluate_parser(parser, data, source)

    teach_parser, evaluate_parser = parsers.teach, parsers.evaluate
    monkeypatch.setattr(parsers, "teach", teach)
    monkeypatch.setattr(parsers, "evaluate", evaluate)
    choose_undone(CONFIG, [stripes(8)], tmp_path / "c.pt", QUIET)
    assert set(learned) == {f"s_{i}" for i in range(6)}
    assert asked == 5 * ["s_6", "s_7"]


def test_the_share_with_the_best_mean_iou_is_taken(tmp_path: Path) -> None:
    choice = choose_undone(CONFIG, [stripes(12)], tmp_path / "c.pt", QUIET)
    found = dict(choice.scores)
    assert list(found) == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert found[choice.best].mean_iou == max(score.mean_iou for score in found.values())
    assert len({score.pixel_accuracy for score in found.values()}) > 1, "a share matters"


def test_held_out_photographs_have_no_say(tmp_path: Path) -> None:
    """The same choice, to the last digit, whatever is drawn on the held-out photographs."""
    import cv2

    photos = tmp_path / "photos"
    photos.mkdir()
    for i in range(8):
        cv2.imwrite(str(photos / f"{i}.png"), stripes(8).frames[i])
    for name, x in (("right", 4), ("wrong", 20)):
        rows = ["size: [32, 24]", "photographs:"]
        for i in range(8):
            held, left = i >= 4, x if i >= 4 else 4 + 5 * i % (WIDTH - 8)
            rows += [f"  - file: '{i}.png'", f"    held_out: {str(held).lower()}", "    shapes:"]
            rows += [f"      - {{kind: white_line, points: [[{left}, 0], [{left}, 24]], width: 4}}"]
        (tmp_path / f"{name}.yaml").write_text("\n".join(rows))
        command = ["parse", "choose", "--out", str(tmp_path / name), "--size", "24", "32"]
        command += ["--annotations", str(tmp_path / f"{name}.yaml"), "--photos", str(photos)]
        assert main([*command, "--steps", "4"]) == 0
    choices = [(tmp_path / name / "choice.json").read_bytes() for name in ("right", "wrong")]
    assert choices[0] == choices[1]
