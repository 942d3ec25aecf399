from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from robot.errors import ConfigError
from robot.typed_config import to_plain
from sim_pybullet.scene import SemanticClass
from trainer.transfer.cli import ParseOptions, Sources
from trainer.transfer.labelled import (
    CAMVID,
    ROAD,
    SHIPPED,
    VOID,
    Annotations,
    Photograph,
    Shape,
    draw,
    load_annotations,
    load_drawn,
    load_pairs,
    load_sources,
)
from trainer.transfer.parser import draw_batch

SIZE = (12, 16)
CLASS = {name: k for k, name in enumerate(ROAD.classes)}


def write_pairs(folder: Path, names: list[str], value: int) -> None:
    for part in ("image", "label"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for name in names:
        cv2.imwrite(str(folder / "image" / f"{name}.png"), np.full((24, 32, 3), 90, np.uint8))
        cv2.imwrite(str(folder / "label" / f"{name}.png"), np.full((24, 32), value, np.uint8))


def test_camvid_void_is_void_and_the_end_of_each_sequence_is_held_out(tmp_path: Path) -> None:
    write_pairs(tmp_path, [f"b_{k:03d}" for k in range(8)], 11)
    write_pairs(tmp_path, [f"a_{k:03d}" for k in range(4)], 3)
    data = load_pairs(tmp_path, CAMVID, SIZE)
    assert (data.truth[:4] == 3).all()
    assert (data.truth[4:] == VOID).all()
    ((_, training, held_out),) = load_sources(
        ParseOptions(Sources((str(tmp_path),)), "camvid", size=SIZE)
    )
    assert held_out.names.tolist() == ["a_003", "b_006", "b_007"]
    assert set(training.names) | set(held_out.names) == set(data.names)
    assert not set(training.names) & set(held_out.names)


def test_a_collection_is_read_as_the_simulator_means_it(tmp_path: Path) -> None:
    write_pairs(tmp_path, ["000000"], SemanticClass.PERSON)
    with pytest.raises(ConfigError, match="collection from the simulator"):
        load_pairs(tmp_path, ROAD, SIZE)
    (tmp_path / "collection.yaml").write_text("kind: simulator\n")
    assert (load_pairs(tmp_path, ROAD, SIZE).truth == CLASS["object"]).all()


def test_a_picture_without_its_label_is_refused(tmp_path: Path) -> None:
    write_pairs(tmp_path, ["a_0"], 3)
    (tmp_path / "label" / "a_0.png").unlink()
    with pytest.raises(ConfigError, match=r"a_0\.png"):
        load_pairs(tmp_path, CAMVID, SIZE)
    with pytest.raises(ConfigError, match="expected pictures"):
        load_pairs(tmp_path / "label", CAMVID, SIZE)


@pytest.mark.parametrize("depth", [np.uint16, "palette"])
def test_labels_that_are_no_eight_bit_grey_are_refused(tmp_path: Path, depth: object) -> None:
    """16 bits became class 0 throughout, a palette what its colours are in grey."""
    write_pairs(tmp_path, ["a_0"], 3)
    label, classes = tmp_path / "label" / "a_0.png", np.full((24, 32), 3, np.uint8)
    if depth == "palette":
        picture = Image.fromarray(classes, "P")
        picture.putpalette([9, 99, 200] * 4)
        picture.save(label)
    else:
        cv2.imwrite(str(label), classes.astype(np.uint16))
    with pytest.raises(ConfigError, match=r"labels of a_0\.png, 8-bit grey"):
        load_pairs(tmp_path, CAMVID, SIZE)


@pytest.mark.parametrize("count", [1, 2])
def test_a_source_that_holds_nothing_out_is_refused_before_anything_is_learned(
    tmp_path: Path, count: int
) -> None:
    write_pairs(tmp_path, [f"a_{k}" for k in range(count)], 3)
    with pytest.raises(ConfigError, match="frames to learn from and others held out"):
        load_sources(ParseOptions(Sources((str(tmp_path),)), "camvid", size=SIZE))


def square(kind: str, low: float, high: float) -> Shape:
    return Shape(kind, ((low, low), (high, low), (high, high), (low, high)))


def test_shapes_cover_each_other_in_order_at_any_scale() -> None:
    photograph = Photograph("x.jpg", False, (square("road", 2, 30), square("white_line", 10, 20)))
    for scale in (1, 2, 4):
        picture = draw(photograph, (40, 40), (40 * scale, 40 * scale))
        assert np.mean(picture == CLASS["white_line"]) == pytest.approx(100 / 1600, abs=0.02)
        assert np.mean(picture == CLASS["road"]) == pytest.approx(684 / 1600, abs=0.04)
        assert picture[15 * scale, 15 * scale] == CLASS["white_line"]


def test_a_line_is_as_wide_as_it_says() -> None:
    line = Shape("yellow_line", ((0, 20), (40, 20)), 4.0)
    picture = draw(Photograph("x.jpg", False, (line,)), (40, 40), (80, 80))
    assert np.count_nonzero(picture[:, 40]) == pytest.approx(8, abs=1)


def test_an_unknown_class_names_the_nearest() -> None:
    wrong = Photograph("x.jpg", False, (square("white_lane", 0, 9),))
    with pytest.raises(ConfigError, match=r"x\.jpg.*did you mean 'white_line'"):
        draw(wrong, (40, 40), (40, 40))


def test_annotations_find_their_photographs(tmp_path: Path) -> None:
    shapes = (square("road", 0, 40), square("void", 0, 10))
    drawn = Annotations((40, 30), tuple(Photograph(f"{n}.png", n == "b", shapes) for n in "ab"))
    (tmp_path / "drawn.yaml").write_text(yaml.safe_dump(to_plain(drawn)))
    assert load_annotations(tmp_path / "drawn.yaml") == drawn
    with pytest.raises(ConfigError, match=r"a\.png"):
        load_drawn(drawn, tmp_path, SIZE)
    write_pairs(tmp_path, ["a", "b"], 0)
    with pytest.raises(ConfigError, match=r"one photograph named a\.png, found 2"):
        load_drawn(drawn, tmp_path, SIZE)  # labels have their names, too
    asked = Sources((), str(tmp_path / "drawn.yaml"), str(tmp_path / "image"))
    ((_, training, held_out),) = load_sources(ParseOptions(asked, size=SIZE))
    assert (training.names.tolist(), held_out.names.tolist()) == (["a.png"], ["b.png"])
    assert set(np.unique(training.truth)) == {CLASS["road"], VOID}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_annotations_can_be_drawn_and_hold_frames_out(name: str) -> None:
    annotations = load_annotations(name)
    width, height = annotations.size
    seen = np.zeros(256, bool)
    for photograph in annotations.photographs:
        picture = draw(photograph, annotations.size, (height, width))
        assert np.mean(picture == CLASS["road"]) > 0.05, photograph.file
        seen[np.unique(picture)] = True
    assert seen[: len(ROAD.classes) - 2].all()
    assert {p.held_out for p in annotations.photographs} == {True, False}


def test_labels_stay_on_what_they_label_in_a_batch(tmp_path: Path) -> None:
    """Crops and mirrors move frame and label together."""
    write_pairs(tmp_path, ["a_0"], 3)
    frame, label = np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 3, np.uint8)
    frame[:, :9], label[:, :9] = 200, 5
    cv2.imwrite(str(tmp_path / "image" / "a_0.png"), frame)
    cv2.imwrite(str(tmp_path / "label" / "a_0.png"), label)
    data = load_pairs(tmp_path, CAMVID, (24, 32))
    frames, truth = draw_batch([data], 32, np.random.default_rng(0))
    bright = frames.mean(-1) > 0.5 * frames.mean(-1).max(axis=(1, 2), keepdims=True)
    some = (truth == 5).any(axis=(1, 2))
    assert some.sum() > 10
    assert np.mean(bright[some] == (truth[some] == 5)) > 0.93
