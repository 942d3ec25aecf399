from __future__ import annotations

import json
from pathlib import Path
from typing import List

import numpy as np
import pytest

from robot.cli import main
from robot.contract import ImageSpec
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy

COLOURS = {"a_red": (255, 0, 0), "b_green": (0, 255, 0), "c_blue": (0, 0, 255)}


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Three pictures of different sizes, and a file that is none."""
    import cv2

    folder = tmp_path / "pictures"
    folder.mkdir()
    for (name, rgb), size in zip(COLOURS.items(), ((120, 160), (480, 640), (50, 300))):
        cv2.imwrite(str(folder / f"{name}.png"), np.full((*size, 3), rgb[::-1], np.uint8))
    (folder / "labels.csv").write_text("x", encoding="utf-8")
    return folder


@pytest.mark.parametrize("image", [ImageSpec(), ImageSpec(80, 60, 20)])
def test_each_picture_gets_the_policys_action(
    tmp_path: Path, pictures: Path, image: ImageSpec
) -> None:
    model = write_policy(tmp_path / "m.onnx", lane_contract(image=image))
    out = tmp_path / "new" / "out.json"
    arguments = ["--model", str(model), "--images", str(pictures), "--json", str(out)]
    assert main(["infer", *arguments]) == 0
    result = json.loads(out.read_text(encoding="utf-8"))
    assert result["schema"] == 1
    assert result["inputs"]["model"] == str(model)
    assert [each["file"] for each in result["images"]] == [f"{name}.png" for name in COLOURS]
    assert [each["action"] for each in result["images"]] == [0, 1, 2]
    for each in result["images"]:
        assert int(np.argmax(each["values"])) == each["action"]


def test_folders_of_folders_are_searched(tmp_path: Path, pictures: Path) -> None:
    model, out = write_policy(tmp_path / "m.onnx", lane_contract()), tmp_path / "out.json"
    (pictures / "site").mkdir()
    (pictures / "b_green.png").rename(pictures / "site" / "b_green.png")
    arguments = ["--model", str(model), "--images", str(pictures), "--json", str(out)]
    assert main(["infer", *arguments]) == 0
    files = [each["file"] for each in json.loads(out.read_text(encoding="utf-8"))["images"]]
    assert files == ["a_red.png", "c_blue.png", "site/b_green.png"]


def test_a_navigating_policy_is_sent_straight_ahead(tmp_path: Path, pictures: Path) -> None:
    model = write_policy(tmp_path / "m.onnx", navigation_contract())
    out = tmp_path / "out.json"
    arguments = ["--model", str(model), "--images", str(pictures), "--json", str(out)]
    assert main(["infer", *arguments]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["inputs"]["path"] == "straight ahead"


def test_wrong_input_is_one_line_and_exit_status_2(
    tmp_path: Path, pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = str(write_policy(tmp_path / "m.onnx", lane_contract()))
    bad = tmp_path / "bad"
    bad.mkdir()
    (bad / "x.png").write_text("no picture", encoding="utf-8")
    good = {"--model": model, "--images": str(pictures), "--json": str(tmp_path / "o.json")}
    for change, said in (
        ({"--model": "none.onnx"}, "none.onnx: expected an ONNX policy"),
        ({"--images": "none"}, "none: expected a folder of pictures (.png, .jpg"),
        ({"--images": str(bad)}, "x.png: expected a picture"),
        ({"--json": "/proc/none/o.json"}, "expected a place to write to"),
    ):
        options = [part for option in {**good, **change}.items() for part in option]
        assert main(["infer", *options]) == 2
        error = capsys.readouterr().err
        assert error.startswith("robot infer: ")
        assert said in error
        assert error.count("\n") == 1


@pytest.mark.parametrize("name", ["m.onnx", "pictures/a_red.png"])
def test_what_is_read_is_not_written_over(tmp_path: Path, pictures: Path, name: str) -> None:
    write_policy(tmp_path / "m.onnx", lane_contract())
    before = (tmp_path / name).read_bytes()
    words = ["--model", str(tmp_path / "m.onnx"), "--images", str(pictures)]
    assert main(["infer", *words, "--json", str(tmp_path / name)]) == 2
    assert (tmp_path / name).read_bytes() == before


def test_pictures_of_a_kind_that_cannot_be_read_are_told_of(
    tmp_path: Path, pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (pictures / "IMG_0001.HEIC").write_bytes(b"of a telephone")
    model = str(write_policy(tmp_path / "m.onnx", lane_contract()))
    words = ["infer", "--model", model, "--images", str(pictures)]
    assert main([*words, "--json", str(tmp_path / "o.json")]) == 0
    assert "skipped 1 that OpenCV cannot read, such as IMG_0001.HEIC" in capsys.readouterr().out
    for path in pictures.glob("*.png"):
        path.unlink()
    assert main([*words, "--json", str(tmp_path / "none.json")]) == 2
    assert "expected pictures (.png, .jpg" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"), [([], "COMMAND"), (["fly"], "infer"), (["infer"], "--model")]
)
def test_wrong_arguments_are_one_line_too(
    arguments: List[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
