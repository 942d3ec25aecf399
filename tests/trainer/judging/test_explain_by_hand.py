"""Attention, influence and their pictures, worked out by hand for networks that are one formula."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from onnx import helper

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.judging import explain as module
from trainer.judging.explain import (
    Explainer,
    convolution_outputs,
    explain,
    fuse,
    overlay,
    pictures,
    redraw,
    sheet,
)
from trainer.mp4 import write_mp4


class Contract:
    """A policy of pictures 40 by 80 below ten rows that it does not see."""

    image = ImageSpec(80, 50, crop_top_px=10)
    told, frames = 0, 1


class Session:
    """In place of a network: values of pictures."""

    def __init__(self, values: Any) -> None:
        self._values, self.asked = values, []  # type: ignore[var-annotated]

    def run(self, names: list[str], feeds: dict[str, np.ndarray]) -> list[np.ndarray]:
        self.asked.append((names, feeds))
        return [self._values(feeds["image"].astype(float))]


def explainer(values: Any, points: int = 0) -> Explainer:
    """One whose values (N, A) are a formula of its pictures."""
    made = Explainer.__new__(Explainer)
    made.contract = Contract()  # type: ignore[assignment]
    made.contract.told = points  # type: ignore[misc]
    made._session, made._layers = Session(values), []
    return made


def test_only_the_patch_that_a_value_depends_on_has_influence() -> None:
    """A twentieth of the width is 4 px; the value is what pixel (13, 22) shows of red."""
    image = np.full((40, 80, 3), 100, np.uint8)
    image[13, 22, 0] = 250
    found = explainer(lambda x: np.stack((x[:, 13, 22, 0], 0 * x[:, 0, 0, 0]), 1)).influence(image)
    expected = np.zeros((40, 80))
    expected[12:16, 20:24] = 1.0
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == np.float32


def test_influence_is_how_far_values_move_against_each_other() -> None:
    """Of two pixels, one moves one value by 80, the other two values to both sides by 30."""
    image = np.full((40, 80, 3), 100, np.uint8)
    image[0, 0], image[39, 79] = 180, 130

    def values(x: np.ndarray) -> np.ndarray:
        first, last = x[:, 0, 0, 1], x[:, 39, 79, 2]
        return np.stack((first + last, -last, 0 * last), 1)

    found = explainer(values).influence(image)
    # mean changes of three values less their mean: 80 (2, 1, 1) / 9, and 30 (1, 1, 0) / 3
    assert found[0, 0] == 1.0
    assert found[39, 79] == pytest.approx((30.0 * 2.0 / 3.0) / (80.0 * 4.0 / 9.0), rel=1e-5)
    assert np.count_nonzero(found) == 2 * 16


def test_what_all_values_have_in_common_is_no_influence() -> None:
    image = np.random.default_rng(0).integers(0, 256, (40, 80, 3), dtype=np.uint8)
    found = explainer(lambda x: np.repeat(x.mean((1, 2, 3))[:, None], 5, 1)).influence(image)
    assert found.max() <= 1.0
    np.testing.assert_allclose(explainer(lambda x: np.zeros((len(x), 5))).influence(image), 0.0)


def test_pictures_that_are_no_multiple_of_a_patch_are_covered_to_their_edges() -> None:
    image = np.full((39, 61, 3), 100, np.uint8)
    image[38, 60] = 0
    seen = explainer(lambda x: np.stack((x[:, 38, 60, 0], 0 * x[:, 0, 0, 0]), 1))
    found = seen.influence(image)
    assert found.shape == (39, 61)
    np.testing.assert_array_equal(np.argwhere(found), [[36, 60], [37, 60], [38, 60]])
    narrow = np.full((6, 12, 3), 100, np.uint8)
    narrow[2, 3] = 0
    found = explainer(lambda x: np.stack((x[:, 2, 3, 0], 0 * x[:, 0, 0, 0]), 1)).influence(narrow)
    np.testing.assert_array_equal(np.argwhere(found), [[2, 3]])


def test_a_navigator_is_asked_with_a_path_of_zeros() -> None:
    for points in (0, 10):
        seen = explainer(lambda x: np.zeros((len(x), 2)), points)
        seen.influence(np.zeros((40, 80, 3), np.uint8))
        ((names, feeds),) = seen._session.asked  # type: ignore[attr-defined]
        assert names == ["values"]
        assert set(feeds) == ({"image", "path"} if points else {"image"})
        if points:
            assert feeds["path"].shape == (len(feeds["image"]), 10)
            assert feeds["path"].dtype == np.float32
            assert not feeds["path"].any()


def test_layers_are_enlarged_and_multiplied_and_brought_to_one() -> None:
    first = np.arange(8, dtype=np.float32).reshape(2, 4)
    last = np.array([[3.0, 5.0]], np.float32)
    product = cv2.resize(last, (4, 2), interpolation=cv2.INTER_LINEAR) * first
    expected = (product - product.min()) / (product.max() - product.min())
    np.testing.assert_allclose(fuse([first, last], (2, 4)), expected, rtol=1e-6)
    assert fuse([first, last], (4, 8)).shape == (4, 8)
    flat = np.full((2, 4), 3.0, np.float32)
    assert not fuse([flat], (2, 4)).any()


def test_an_overlay_is_more_than_half_of_viridis() -> None:
    picture = np.full((1, 2, 3), (100, 50, 200), np.uint8)
    seen = overlay(picture, np.array([[0.0, 1.0]], np.float32))
    least, most = (68, 1, 84), (253, 231, 37)  # viridis, red to blue
    for shown, colour in zip(seen[0], (least, most), strict=True):
        wanted = 0.45 * picture[0, 0] + 0.55 * np.array(colour)
        np.testing.assert_allclose(shown, wanted, atol=1.1)


def test_pictures_of_folders_are_named_by_where_they_lie(tmp_path: Path) -> None:
    for name in ("a.png", "b/c.png"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), np.full((240, 320, 3), 90, np.uint8))
    found = list(pictures(tmp_path))
    assert {name for name, _ in found} >= {"a"} or [name for name, _ in found] == ["b_c"]
    assert all(frame.shape == (120, 160, 3) for _, frame in found)
    ((name, _),) = pictures(tmp_path / "b" / "c.png")
    assert name == "c"
    with pytest.raises(ConfigError):
        list(pictures(tmp_path / "none"))


def test_no_two_pictures_of_a_folder_have_one_name(tmp_path: Path) -> None:
    """What is drawn of them would lie in one file."""
    (tmp_path / "b").mkdir()
    for name in ("x.jpg", "x.png", "x_png.jpg", "b_c.png", "b/c.png"):
        cv2.imwrite(str(tmp_path / name), np.full((240, 320, 3), 90, np.uint8))
    names = [name for name, _ in pictures(tmp_path)]
    assert sorted(set(names)) == sorted(names)
    assert {"x", "x_png", "b_c"} < set(names)


def test_a_file_of_another_kind_is_told_which_ones_are_read(tmp_path: Path) -> None:
    (tmp_path / "drive.webm").write_bytes(b"nothing")
    with pytest.raises(ConfigError, match=r"\.png, \.jpg, .*\.tiff\), got a file"):
        list(pictures(tmp_path / "drive.webm"))


def test_a_video_without_pictures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"nothing")
    with pytest.raises(ConfigError):
        list(pictures(tmp_path / "a.mp4"))


def test_three_pictures_side_by_side_and_dark_where_nothing_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ten rows of fifty above: 48 of 240."""
    seen = explainer(lambda x: np.stack((x[:, 39, 79, 0], 0 * x[:, 0, 0, 0]), 1))
    one = np.zeros((1, 40, 80), np.float32)
    one[0, :, :40] = 1.0
    monkeypatch.setattr(seen, "attention", lambda _: one, raising=False)
    frame = np.full((120, 160, 3), 120, np.uint8)
    frame[110:, 150:] = 0
    shown = explain(seen, frame)
    assert shown.shape == (240, 960, 3)
    plain, features, influence = np.split(shown, 3, axis=1)
    assert (plain[:200, :290] == 120).all()
    assert (plain[230:, 310:] < 20).all()
    for part in (features, influence):
        np.testing.assert_array_equal(part[:48], 40)
        assert (part[49:200, :290] != 40).any(-1).all()
    np.testing.assert_allclose(
        features[120, 40], 0.45 * 120 + 0.55 * np.array((253, 231, 37)), atol=2
    )
    np.testing.assert_allclose(
        features[120, 280], 0.45 * 120 + 0.55 * np.array((68, 1, 84)), atol=2
    )
    assert influence[238, 318].sum() > influence[238, 160].sum() - 200
    np.testing.assert_allclose(
        influence[120, 40], 0.45 * 120 + 0.55 * np.array((68, 1, 84)), atol=2
    )


@pytest.mark.parametrize(("many", "rows"), [(1, 1), (3, 3), (16, 16), (17, 16), (200, 16)])
def test_a_sheet_has_up_to_sixteen_one_below_the_other(many: int, rows: int) -> None:
    drawn = sheet([np.full((240, 960, 3), k, np.uint8) for k in range(many)])
    assert drawn.shape == (rows * 150, 600, 3)
    shown = drawn[75::150, 300, 0].tolist()
    evenly = [round(k * (many - 1) / max(rows - 1, 1)) for k in range(rows)]
    assert shown == pytest.approx(evenly, abs=1)
    assert (shown[0], shown[-1]) == (0, many - 1)


@pytest.mark.parametrize(("filmed", "kept"), [(True, [0, 10, 20]), (False, [*range(23)])])
def test_every_tenth_picture_of_a_film_is_kept_for_the_sheet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, filmed: bool, kept: list[int]
) -> None:
    frames = [(f"{k:06d}", np.full((120, 160, 3), k, np.uint8)) for k in range(23)]
    written: dict[str, Any] = {"film": [], "pictures": []}

    class Film:
        def __init__(self, path: Path, fps: float) -> None:
            written["to"] = (path.name, fps)

        def add(self, picture: np.ndarray) -> None:
            written["film"].append(int(picture[0, 0, 0]))

        def close(self) -> None:
            written["closed"] = True

    monkeypatch.setattr(module, "Explainer", lambda _: None)
    monkeypatch.setattr(module, "pictures", lambda _: iter(frames))
    monkeypatch.setattr(module, "explain", lambda _, frame: frame)
    monkeypatch.setattr("trainer.mp4.Mp4", Film)
    monkeypatch.setattr(module, "write_png", lambda path, _: written["pictures"].append(path.name))
    monkeypatch.setattr(module, "sheet", lambda shown: written.update(kept=shown))
    source = tmp_path / ("drive.mp4" if filmed else "pictures")
    out = tmp_path / "new" / "out"
    assert module.write_explained(tmp_path / "m.onnx", source, out) == 23
    assert out.is_dir()
    assert [int(picture[0, 0, 0]) for picture in written["kept"]] == kept
    assert written["film"] == (list(range(23)) if filmed else [])
    assert written.get("closed", False) is filmed
    if filmed:
        assert written["to"] == ("drive_explained.mp4", 10.0)
        assert written["pictures"] == ["sheet.png"]
    else:
        assert written["pictures"] == [*(f"{k:06d}_explained.png" for k in range(23)), "sheet.png"]


def node(kind: str, *names: str) -> onnx.NodeProto:
    return helper.make_node(kind, names[:-1], [names[-1]])


def test_what_the_rectifiers_after_convolutions_give() -> None:
    """A rectifier may come after rounding; a convolution without one stands for itself."""
    graph = onnx.GraphProto()
    graph.node.extend(
        [
            node("Constant", "k"),
            node("Conv", "image", "w", "a"),
            node("Relu", "a", "b"),
            node("Conv", "b", "w", "c"),
            node("QuantizeLinear", "c", "s", "d"),
            node("DequantizeLinear", "d", "s", "e"),
            node("Relu", "e", "f"),
            node("Conv", "f", "w", "g"),
            node("Flatten", "g", "h"),
            node("Conv", "h", "w", "i"),
        ]
    )
    assert convolution_outputs(graph) == ["b", "f", "g", "i"]


def test_an_explained_video_is_as_fast_as_a_robot_decides() -> None:
    assert module.VIDEO_FPS == 10.0


def test_pictures_that_cannot_be_read_are_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder := tmp_path / "in").mkdir()
    for name in ("a.png", "c.png"):
        cv2.imwrite(str(folder / name), np.full((120, 160, 3), 90, np.uint8))
    (folder / "b.jpg").write_bytes(b"junk")
    (folder / "IMG_1.HEIC").write_bytes(b"junk")
    assert redraw(folder, tmp_path / "out", "seen", lambda frame: frame) == 2
    assert capsys.readouterr().out.startswith("skipped 2 that OpenCV cannot read, such as ")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"a_seen.png", "c_seen.png"}
    for name in ("a.png", "c.png"):
        (folder / name).write_bytes(b"junk")
    with pytest.raises(ConfigError, match="expected a picture, got a file that OpenCV cannot"):
        redraw(folder, tmp_path / "none", "seen", lambda frame: frame)


@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_a_drawn_film_is_as_fast_as_its_source(tmp_path: Path, rate: float) -> None:
    write_mp4(tmp_path / "a.mp4", [np.full((120, 160, 3), 9 * k, np.uint8) for k in range(9)], rate)
    assert redraw(tmp_path / "a.mp4", tmp_path / "out", "seen", lambda frame: frame) == 9
    film = cv2.VideoCapture(str(tmp_path / "out" / "a_seen.mp4"))
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(rate)
