from pathlib import Path

import cv2
import numpy as np
import pytest

from sim_pybullet.show import main, sheet


def test_writes_a_sheet(tmp_path: Path) -> None:
    out = tmp_path / "looks.png"
    words = ["--out", str(out), "--count", "3", "--map", "loop", "--look", "reality/rink"]
    assert main(words) == 0
    picture = cv2.imread(str(out))
    assert picture.shape == (122, 6 * 162, 3)
    assert picture[:120, :160].std() > 10
    assert [path.name for path in tmp_path.iterdir()] == ["looks.png"]


def test_a_track_is_shown_like_a_map(tmp_path: Path) -> None:
    out = tmp_path / "track.png"
    words = ["--out", str(out), "--map", "karting", "--look", "tracks/dusk", "--count", "7"]
    assert main(words) == 0
    assert cv2.imread(str(out)).shape == (2 * 122, 6 * 162, 3)


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
