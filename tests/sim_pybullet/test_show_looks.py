from pathlib import Path

import cv2
import numpy as np
import pytest

from sim_pybullet.show_looks import main, sheet


def test_writes_a_sheet(tmp_path: Path) -> None:
    out = tmp_path / "looks.png"
    words = ["--out", str(out), "--count", "3", "--map", "loop", "--look", "reality/rink"]
    assert main(words) == 0
    picture = cv2.imread(str(out))
    assert picture.shape == (122, 6 * 162, 3)
    assert picture[:120, :160].std() > 10


def test_wrong_input_is_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "looks.png")
    assert main(["--out", out, "--look", "reality/rnik"]) == 2
    assert "did you mean 'reality/rink'" in capsys.readouterr().err


def test_every_picture_is_on_the_sheet() -> None:
    pictures = np.stack([np.full((4, 5, 3), k, np.uint8) for k in range(1, 8)])
    assert set(np.unique(sheet(pictures))) == {*range(1, 8), 255}
