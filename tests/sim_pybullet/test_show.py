from pathlib import Path

import cv2
import numpy as np
import pytest

from sim_pybullet.classes import SemanticClass
from sim_pybullet.show import CLASS_RGB, main, sheet


def test_writes_a_sheet(tmp_path: Path) -> None:
    out = tmp_path / "looks.png"
    words = ["--out", str(out), "--count", "3", "--map", "loop", "--look", "reality/rink"]
    assert main(words) == 0
    picture = cv2.imread(str(out))
    assert picture.shape == (122, 6 * 162, 3)
    assert picture[:120, :160].std() > 10
    assert [path.name for path in tmp_path.iterdir()] == ["looks.png"]


@pytest.mark.parametrize(("name", "look"), [("loop", "nominal"), ("karting", "tracks/dusk")])
def test_a_row_for_each_draw_compares_the_cameras(tmp_path: Path, name: str, look: str) -> None:
    out = tmp_path / "cameras.png"
    words = ["--out", str(out), "--map", name, "--look", look, "--count", "2", "--cameras"]
    assert main(words) == 0
    picture = cv2.imread(str(out))
    assert picture.shape == (2 * 122, 3 * 162, 3)
    pybullet, ray, classes = (picture[:120, k : k + 160].astype(int) for k in (0, 162, 324))
    assert np.abs(pybullet - ray).mean() < 6.0
    assert {tuple(rgb) for rgb in classes.reshape(-1, 3)[:, ::-1].tolist()} <= {*CLASS_RGB.values()}


@pytest.mark.parametrize(
    ("words", "says"),
    [(["--look", "reality/rnik"], "did you mean 'reality/rink'"), (["--map", "twn"], "'town'")],
)
def test_wrong_input_is_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    assert main(["--out", str(tmp_path / "looks.png"), *words]) == 2
    assert says in capsys.readouterr().err


def test_every_picture_is_on_the_sheet() -> None:
    pictures = np.stack([np.full((4, 5, 3), k, np.uint8) for k in range(1, 8)])
    assert set(np.unique(sheet(pictures))) == {*range(1, 8), 255}


def test_every_class_has_a_colour() -> None:
    assert set(CLASS_RGB) == set(SemanticClass)
    assert len(set(CLASS_RGB.values())) == len(SemanticClass)
