import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.inference.policy import PARSING, TranslatorContract
from tests.robot.tiny_onnx import write_translator
from tests.trainer.experiments.test_racing_policy import write_policy
from trainer.cli import main
from trainer.experiments.records import Turn
from trainer.experiments.table1 import BLOCK_FRAMES, chance, compare
from trainer.judging.intervals import bootstrap


def write_drive(folder: Path, count: int) -> None:
    """A drive in which a bright bar stands on the side that the person steers to."""
    lines = []
    for k in range(count):
        turn = (k // 10) % 3
        picture = np.full((120, 160, 3), 40, np.uint8)
        picture[50:, 10 + 55 * turn : 35 + 55 * turn] = 220
        cv2.imwrite(str(folder / f"{k}.jpg"), picture)
        lines.append(f"{k}.jpg {25.0 * (turn - 1)}")
    (folder / "data.txt").write_text("\n".join(lines))


def test_a_plain_rule_is_learned_and_a_second_call_learns_no_more(tmp_path: Path) -> None:
    write_drive(tmp_path, 150)
    out = tmp_path / "out"
    command = ["experiment", "paper-b-accuracy", "--data", str(tmp_path), "--out", str(out)]
    options = ["--seeds", "1", "--steps", "60", "--rate-hz", "10"]
    assert main([*command, *options]) == 0
    first = json.loads((out / "table1.json").read_text())
    rows = {row["driver"]: row for row in first["rows"]}
    assert rows["supervised"]["accuracy"] > 0.8
    assert rows["drawn by lot"]["accuracy"] < 0.6
    assert (out / "table1.png").stat().st_size > 1000
    (kept,) = out.glob("supervised_0_60_*.pt")
    written = kept.stat().st_mtime_ns
    assert main([*command, *options]) == 0
    assert kept.stat().st_mtime_ns == written
    assert json.loads((out / "table1.json").read_text()) == first


def test_who_sees_through_something_has_supervised_networks_that_see_likewise(
    tmp_path: Path,
) -> None:
    write_drive(tmp_path, 150)
    image = ImageSpec(60, 44, 4)
    write_policy(tmp_path / "policy.onnx", size=image.shape[:2])
    negative = write_translator(
        tmp_path / "negative.onnx", TranslatorContract("segnet", PARSING, image)
    )
    out = tmp_path / "out"
    command = ["experiment", "paper-b-accuracy", "--data", str(tmp_path), "--out", str(out)]
    command += ["--policy", f"plain={tmp_path / 'policy.onnx'}"]
    command += ["--policy", f"ours={tmp_path / 'policy.onnx'}+{negative}"]
    assert main([*command, "--seeds", "1", "--steps", "60", "--rate-hz", "10"]) == 0
    rows = json.loads((out / "table1.json").read_text())["rows"]
    found = {row["driver"]: row["accuracy"] for row in rows}
    assert found["plain"] > 0.9  # it steers to the light,
    assert found["ours"] < 0.6  # and sees it dark
    kinds = [name for name in found if name.startswith("supervised")]
    assert kinds == ["supervised", "supervised, as ours sees"]
    assert min(found[kind] for kind in kinds) > 0.8


def test_the_interval_widens_where_mistakes_come_in_stretches() -> None:
    scattered = np.arange(400) % 2 == 0
    stretched = (np.arange(400) // 40) % 2 == 0
    narrow, wide = (bootstrap(each, np.mean, BLOCK_FRAMES) for each in (scattered, stretched))
    assert wide[1] - wide[0] > 3 * (narrow[1] - narrow[0])
    assert narrow[0] <= 0.5 <= narrow[1]
    assert wide[0] <= 0.5 <= wide[1]


def test_a_perfect_driver_and_one_that_knows_one_turn() -> None:
    wanted = np.array([Turn.LEFT, Turn.RIGHT, Turn.STRAIGHT, Turn.RIGHT])
    assert compare("x", 0, wanted, wanted).accuracy == 1.0
    always = compare("x", 0, wanted, np.full(4, Turn.RIGHT))
    assert (always.accuracy, always.balanced) == (0.5, 1 / 3)


@pytest.mark.parametrize("angle", [0.0, 25.0])
def test_a_drive_of_one_turn_is_refused_with_its_angles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], angle: float
) -> None:
    write_drive(tmp_path, 90)
    (tmp_path / "data.txt").write_text("\n".join(f"{k}.jpg {angle}" for k in range(90)))
    command = ["experiment", "paper-b-accuracy", "--data", str(tmp_path)]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"the angles go from {angle:g} to {angle:g} degrees" in said


def test_who_needs_no_picture_stands_beside_with_both_commonest_turns() -> None:
    wanted = np.array([Turn.LEFT] * 6 + [Turn.RIGHT] * 4)
    rows = {row.driver: row.accuracy for row in chance(wanted, Turn.STRAIGHT)}
    assert rows["always straight"] == 0.0
    assert rows["always left"] == 0.6
    assert len(rows) == 3
