from pathlib import Path

import pytest

from trainer.cli import main


@pytest.mark.parametrize("look", ["reality", "reality/noon", "sim_pybullet/looks/reality/lab.yaml"])
def test_nobody_trains_in_reality(
    look: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "--out", str(tmp_path / "run"), "--look", look]) == 2
    assert "kept for judging policies" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
