import json
import shutil
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess_batch
from trainer.experiments.records import (
    FULL_LOCK_DEG,
    STACK,
    Drive,
    Turn,
    frames_of,
    load_drive,
    split_by_time,
    turns,
)

ANGLES = (-0.5, 0.0, 0.2, 0.9)
IMAGE = ImageSpec(40, 30, 10)


def write_pictures(folder: Path, names: list[str]) -> None:
    for k, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((120, 160, 3), 2 * k, np.uint8))


def write_layout(folder: Path, layout: str) -> None:
    """The same drive as each program writes it."""
    files = [f"{k}_cam.jpg" for k in range(len(ANGLES))]
    inner = {"sully": "", "labels": "images", "tub": "images"}[layout]
    write_pictures(folder / inner, files)
    rows = [
        {"_index": k, "cam/image_array": file, "user/angle": angle}
        for k, (file, angle) in enumerate(zip(files, ANGLES, strict=True))
    ]
    if layout == "sully":
        lines = [
            f"{f} {a * FULL_LOCK_DEG:f},2018-07-01 17:09:44:912"
            for f, a in zip(files, ANGLES, strict=True)
        ]
        (folder / "data.txt").write_text("\n".join(lines) + "\n")
    elif layout == "labels":
        lines = [f"dev/{f},{k},{a},0.5" for k, (f, a) in enumerate(zip(files, ANGLES, strict=True))]
        (folder / "labels.csv").write_text("\n".join(["file,index,angle,throttle", *lines]))
    else:
        thrown = {"_index": 77, "cam/image_array": "gone.jpg", "user/angle": 0.1}
        first, rest = [*rows[:2], thrown], rows[2:]
        for number, part in ((9, first), (10, rest)):
            text = "\n".join(json.dumps(row) for row in part)
            (folder / f"catalog_{number}.catalog").write_text(text + "\n")
        last = {"paths": ["catalog_9.catalog", "catalog_10.catalog"], "deleted_indexes": [77]}
        (folder / "manifest.json").write_text(f'["a"]\n{{}}\n{json.dumps(last)}\n')


@pytest.mark.parametrize("layout", ["sully", "labels", "tub"])
def test_every_layout_gives_the_same_drive(tmp_path: Path, layout: str) -> None:
    write_layout(tmp_path, layout)
    drive = load_drive(tmp_path)
    assert [path.name for path in drive.files] == [f"{k}_cam.jpg" for k in range(len(ANGLES))]
    assert np.allclose(drive.steering_deg, np.array(ANGLES) * FULL_LOCK_DEG)
    assert turns(drive.steering_deg).tolist() == [
        Turn.LEFT,
        Turn.STRAIGHT,
        Turn.STRAIGHT,
        Turn.RIGHT,
    ]


def test_a_tub_is_what_its_manifest_names_and_broken_lines_are_counted(tmp_path: Path) -> None:
    write_layout(tmp_path, "tub")
    names = ["catalog_10.catalog", "catalog_9.catalog"]
    (tmp_path / "manifest.json").write_text(f"[]\n{json.dumps({'paths': names})}\n")
    (tmp_path / "._catalog_9.catalog").write_bytes(b"\0\5\x16\7\xb0\xff Mac OS X")
    (tmp_path / "catalog_11.catalog").write_text("given up\n")
    with (tmp_path / "catalog_9.catalog").open("ab") as file:
        file.write(b"\0" * 40 + b"\n" + b'{"_index": 5, "cam/im\n' + b"\xff\xfe\n" + b"[]\n{}\n")
    (tmp_path / "images" / "gone.jpg").touch()
    drive = load_drive(tmp_path)
    assert [path.name[0] for path in drive.files] == ["2", "3", "0", "1", "g"]
    assert drive.skipped == 5
    (tmp_path / "catalog_9.catalog").unlink()
    with pytest.raises(ConfigError, match=r"catalog_9\.catalog: expected a part of the drive"):
        load_drive(tmp_path)


def test_a_published_tub_is_read_with_the_rubbish_that_computers_leave(
    tmp_path: Path, data_dir: Path
) -> None:
    tub = tmp_path / "tub"
    shutil.copytree(
        data_dir / "real" / "donkeycar_boards" / "tub", tub, copy_function=shutil.copyfile
    )
    tub.chmod(0o755)
    whole = load_drive(tub)
    (tub / "._catalog_0.catalog").write_bytes(b"\0\5\x16\7\0\2\xb0\xc3\x28")
    lines = (tub / "catalog_0.catalog").read_bytes().splitlines()
    lines[100] = b"\0" * len(lines[100])
    (tub / "catalog_0.catalog").unlink()
    (tub / "catalog_0.catalog").write_bytes(b"\n".join(lines))
    drive = load_drive(tub)
    assert (len(whole.files), len(drive.files)) == (302, 301)
    assert (whole.skipped, drive.skipped) == (0, 1)


def test_what_is_no_drive_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"expected one of labels\.csv"):
        load_drive(tmp_path)
    (tmp_path / "data.txt").write_text("0.jpg left\n")
    with pytest.raises(ConfigError, match=r"data\.txt:1: expected an angle, got 'left'"):
        load_drive(tmp_path)
    (tmp_path / "data.txt").write_text("0.jpg 3\n")
    with pytest.raises(ConfigError, match=r"got no angle beyond 3; multiply radians"):
        load_drive(tmp_path)
    (tmp_path / "data.txt").write_text("0.jpg 30\n1.jpg -5\n")
    with pytest.raises(ConfigError, match=r"none for 2, the first 0\.jpg"):
        load_drive(tmp_path)
    (tmp_path / "data.txt").unlink()
    (tmp_path / "labels.csv").write_text("file,angle\na.jpg,-17\n")
    with pytest.raises(ConfigError, match=r"labels\.csv:2.*in \[-1, 1\]"):
        load_drive(tmp_path)


@given(st.floats(-720, 720), st.floats(-720, 720))
def test_turns_follow_the_angle_and_mirror_with_it(a: float, b: float) -> None:
    low, high, mirrored = turns(np.array([min(a, b), max(a, b), -a]))
    assert low <= high
    assert mirrored == Turn.RIGHT - turns(np.array([a]))[0]


def test_training_and_test_share_no_picture(tmp_path: Path) -> None:
    write_pictures(tmp_path, [f"{k:03d}.jpg" for k in range(100)])
    drive = Drive(tuple(sorted(tmp_path.glob("*.jpg"))), np.linspace(-20, 20, 100))
    frames, see = frames_of(drive), partial(preprocess_batch, spec=IMAGE)
    training, test = split_by_time(drive, frames, 1, see)
    assert training.stacked().shape == (57, 20, 40, 3 * STACK)
    assert test.stacked().shape == (17, 20, 40, 3 * STACK)
    assert (np.diff(training.stacked()[5, 0, 0, ::3].astype(int)) >= 0).all()
    assert training.last.max() + 20 < test.last.min() - (STACK - 1) + 1
    apart, test = split_by_time(drive, frames, 2, see)
    assert np.array_equal(apart.stacked([0])[0, ..., ::3][..., -1], apart.pictures[6, ..., 0])
    assert np.array_equal(apart.stacked([0])[0, ..., 0], apart.pictures[0, ..., 0])
    assert apart.last.max() + 20 < test.last.min() - 2 * (STACK - 1) + 1
    assert (apart.turns == turns(drive.steering_deg)[apart.last]).all()
    for count in (3, 20):
        with pytest.raises(ConfigError, match=f"expected enough pictures.* got {count}"):
            split_by_time(drive, frames[:count], 1, see)


@pytest.mark.parametrize("kind", ["grey", "wide", "large"])
def test_pictures_of_other_sizes_and_grey_ones_are_taken(tmp_path: Path, kind: str) -> None:
    shape = {"grey": (120, 160), "wide": (66, 200, 3), "large": (480, 640, 3)}[kind]
    for k in range(5):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full(shape, 40 * k, np.uint8))
    drive = Drive(tuple(sorted(tmp_path.glob("*.png"))), np.zeros(5))
    pictures = preprocess_batch(frames_of(drive), IMAGE)
    assert pictures.shape == (5, *IMAGE.shape)
    assert (pictures[3] == 120).all()
