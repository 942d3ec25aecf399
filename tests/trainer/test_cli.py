import subprocess
import sys
from pathlib import Path

import pytest

from trainer.cli import main
from trainer.presets import preset


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


def test_summary_names_every_algorithm(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["summary", "--preset", "debug"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in ("ddqn", "dueling", "a2c", "a3c", "ppo", "dagger"))
    net = preset("lane", "ppo", "debug").net
    critic = (net.image_fc * net.head_fc + net.head_fc) + (net.head_fc + 1)
    (row,) = [line for line in out.splitlines() if {"lane", "ppo"} <= set(line.split())]
    trained, driving = (int(word.replace(",", "")) for word in row.split()[-4:-1:2])
    assert trained - driving == critic


def test_an_unknown_flag_is_status_2() -> None:
    command = [sys.executable, "-m", "trainer", "train", "--outt", "x"]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 2
