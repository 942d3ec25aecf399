import dataclasses
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from trainer.cli import _LIMITS, COMMANDS, Command, Group, main

# Numbers whose limits their own configuration knows.
CHECKED_THERE = {"judgings", "rate_left", "seconds", "start_spread", "true_path"}


def test_wrong_names_are_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(["train", "--out", str(tmp_path / "run"), "--algo", "dualing"])
    error = capsys.readouterr().err
    assert status == 2
    assert error.count("\n") == 1
    assert "did you mean 'dueling'" in error
    assert not (tmp_path / "run").exists()


def test_report_of_no_run_is_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path)]) == 2
    assert "expected the folder of a run" in capsys.readouterr().err


def test_an_output_that_cannot_be_is_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    out = str(tmp_path / "file" / "run")
    assert main(["train", "--preset", "debug", "--out", out]) == 2
    assert "Not a directory" in capsys.readouterr().err


def test_an_unknown_flag_is_status_2() -> None:
    command = [sys.executable, "-m", "trainer", "train", "--outt", "x"]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 2


def commands(group: Group) -> Iterator[Command]:
    for each in group.values():
        if isinstance(each, Command):
            yield each
        else:
            yield from commands(each)


def numbers(of: Any) -> Iterator[str]:
    """Names of the numbers among the options of a command."""
    for name, kind in get_type_hints(of).items():
        if dataclasses.is_dataclass(kind):
            yield from numbers(kind)
        elif name != "return" and {int, float} & {kind, *get_args(kind)}:
            yield name


def test_every_number_has_its_limits() -> None:
    for command in commands(COMMANDS):
        module, name = command.place.split(":")
        found = set(numbers(getattr(importlib.import_module(module), name)))
        assert found <= _LIMITS.keys() | CHECKED_THERE, command.place


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["train-sight", "--files", "0"], "files"),
        (["teach", "drive.mcap", "--drives", "-1"], "drives"),
        (["parse", "train", "--pairs", "pairs", "--size", "80", "0"], "size"),
    ],
)
def test_a_number_out_of_its_range_is_told_before_any_work(
    words: list[str], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--out", str(tmp_path / "run")]) == 2
    assert f"{name}: expected 1 to" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
