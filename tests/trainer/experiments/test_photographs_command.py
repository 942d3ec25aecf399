"""The command `experiment real-photographs`, part by part."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from trainer.cli import main
from trainer.experiments.photographs.attention import LabelledFrame, attention_sheet

SHIPPED = Path("robot/models/lane_coached.onnx")


def words(data: Path, out: Path, *only: str) -> list[str]:
    asked = ["--data", str(data), "--out", str(out), "--policy", f"lane={SHIPPED}"]
    return ["experiment", "real-photographs", *asked, "--only", *only]


def test_a_part_that_there_is_not_is_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(tmp_path, tmp_path / "out", "attention", "agremeent")) == 2
    assert "did you mean 'agreement'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_attention_and_lines_of_real_photographs(data_dir: Path, tmp_path: Path) -> None:
    assert main(words(data_dir / "real", tmp_path, "attention", "agreement")) == 0
    text = (tmp_path / "tables.md").read_text()
    assert text.index("## Lines that policies look at") < text.index("## The yellow line")
    assert cv2.imread(str(tmp_path / "attention.png")).shape[1] == 2 * 160


def test_a_sheet_of_attention_has_a_row_for_each_site_and_a_column_for_each_policy() -> None:
    rng = np.random.default_rng(0)
    none = np.zeros((FRAME_HEIGHT_PX, FRAME_WIDTH_PX), bool)
    frames = [
        LabelledFrame(site, rng.integers(0, 256, (*none.shape, 3), dtype=np.uint8), none, none)
        for site in ("a", "a", "b")
    ]
    sheet = attention_sheet([("one", SHIPPED), ("two", SHIPPED)], frames)
    assert sheet.shape == (16 + 2 * 80, 3 * 160, 3)
    np.testing.assert_array_equal(sheet[16:, 160:320], sheet[16:, 320:])
    assert (sheet[16:, :160] != sheet[16:, 160:320]).any()
