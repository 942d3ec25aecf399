"""``train --resume`` goes on with the run that was asked for, or says what differs."""

from pathlib import Path

import pytest

from trainer.cli import main
from trainer.run import RunFolder

TRAIN = ["train", "--preset", "debug", "--algo", "ppo", "--steps", "256"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "run"
    assert main([*TRAIN, "--out", str(out)]) == 0
    return out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--algo dueling", ["--algo dueling (the run: ppo)"]),  # although it is the default
        ("--map zigzag --seed 3", ["--map zigzag (the run: loop)", "--seed 3 (the run: 0)"]),
        ("--look randomised", ["--look randomised (the run: nominal)"]),
        ("--task navigation", ["--task navigation (the run: lane)"]),
        ("--preset fast", ["--preset fast (the run: debug)"]),
        ("--full", ["--full True (the run: False)"]),
        ("--judge-look randomised", ["--judge-look randomised"]),
    ],
)
def test_other_options_are_refused_by_name(
    run: Path, words: str, said: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = (run / "config.yaml").read_bytes()
    assert main(["train", "--out", str(run), "--resume", *words.split()]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert [each for each in said if each not in error] == []
    assert (run / "config.yaml").read_bytes() == before


@pytest.mark.parametrize("words", ["", "--algo ppo --map loop --seed 0 --preset debug"])
def test_a_run_that_has_ended_is_left_as_it_is(
    run: Path, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    assert main(["train", "--out", str(run), "--resume", *words.split()]) == 0
    assert "done before, 256 steps" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before


def test_a_run_that_has_ended_goes_on_for_more_steps(run: Path) -> None:
    assert main(["train", "--out", str(run), "--resume", "--steps", "512"]) == 0
    assert RunFolder(run).load_config().steps == 512
