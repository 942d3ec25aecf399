from pathlib import Path

import cv2
import pytest

from sim_pybullet.classes import SemanticClass
from sim_pybullet.show_cameras import CLASS_RGB, main


def test_the_sheet_holds_a_row_for_each_pose(tmp_path: Path) -> None:
    out = tmp_path / "sheet.png"
    assert main(["--out", str(out), "--map", "loop", "--poses", "2"]) == 0
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape == (2 * (14 + 2 * 120), 2 * 3 * 160, 3)
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]


def test_wrong_input_is_one_line_and_status_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--out", str(tmp_path / "sheet.png"), "--map", "twn"]) == 2
    assert "did you mean 'town'" in capsys.readouterr().err


def test_every_class_has_a_colour() -> None:
    assert set(CLASS_RGB) == set(SemanticClass)
    assert len(set(CLASS_RGB.values())) == len(SemanticClass)
