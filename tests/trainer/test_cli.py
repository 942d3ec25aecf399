import subprocess
import sys
from pathlib import Path

import pytest

from trainer.cli import main


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
