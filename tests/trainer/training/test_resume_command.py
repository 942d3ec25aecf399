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
        ("--algo dueling", "algorithm"),  # although it is the default
        ("--map rings/bean --seed 3", "maps, seed"),
        ("--look randomised", "look"),
        ("--task navigation", "task"),
        ("--preset fast", "preset"),
        ("--full", "evaluation"),
        ("--judge-look randomised", "evaluation"),
    ],
)
def test_other_options_are_refused_by_name(
    run: Path, words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (run / "config.yaml").read_bytes()
    again = ["--preset", "debug", "--algo", "ppo", *words.split()]
    assert main(["train", "--out", str(run), "--resume", *again]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert set(said.split(", ")) <= set(error.split("got another ")[1].split(";")[0].split(", "))
    assert (run / "config.yaml").read_bytes() == before


def test_some_of_the_options_are_no_answer(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "--out", str(run), "--resume", "--seed", "0"]) == 2
    assert "algorithm" in capsys.readouterr().err


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
