from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.camera.files import PICTURES, picture_files, play, read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError, ContractError
from robot.inference.preprocess import FRAME_SHAPE


def plain(level: int) -> np.ndarray:
    return np.full(FRAME_SHAPE, level, np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    import cv2

    for i in range(4):
        cv2.imwrite(str(tmp_path / f"{i:03d}.png"), plain(40 * i))
    (tmp_path / "notes.txt").write_text("not a picture", encoding="utf-8")
    return tmp_path


@pytest.fixture
def video(tmp_path: Path) -> Path:
    import cv2

    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (160, 120))
    for i in range(4):
        writer.write(plain(40 * i))
    writer.release()
    return path


@pytest.mark.parametrize("source", ["folder", "video"])
def test_pictures_come_in_their_order(source: str, request: pytest.FixtureRequest) -> None:
    pictures = list(play(request.getfixturevalue(source)))
    assert {picture.shape for picture in pictures} == {FRAME_SHAPE}
    assert np.allclose([picture.mean() for picture in pictures], [0, 40, 80, 120], atol=2)


def test_colours_are_red_green_blue(tmp_path: Path) -> None:
    import cv2

    cv2.imwrite(str(tmp_path / "red.png"), np.full(FRAME_SHAPE, (0, 0, 255), np.uint8))  # BGR
    (picture,) = play(tmp_path)
    assert tuple(picture[0, 0]) == (255, 0, 0)
    video = cv2.VideoWriter(
        str(tmp_path / "red.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (160, 120)
    )
    video.write(np.ascontiguousarray(picture[..., ::-1]))
    video.release()
    (played,) = play(tmp_path / "red.avi")
    assert np.abs(played[60, 80].astype(int) - (255, 0, 0)).max() < 9


RICH = (".png", ".tif", ".tiff")  # formats with 16 bits and transparency
KINDS = [(ending, bits, channels) for ending in RICH for bits in (8, 16) for channels in (3, 4)]


@pytest.mark.parametrize(
    ("ending", "bits", "channels"),
    [
        *(
            (ending, 8, channels)
            for ending in PICTURES
            for channels in (1, 3)
            if ending != ".ppm" or channels == 3
        ),
        *KINDS,
    ],
)
def test_pictures_of_every_kind_are_found_and_become_frames(
    ending: str, bits: int, channels: int, tmp_path: Path
) -> None:
    import cv2

    level, kind = (200, np.uint8) if bits == 8 else (200 * 257, np.uint16)
    file = tmp_path / f"PICTURE{ending.upper()}"
    assert cv2.imwrite(str(file), np.full((30, 40, channels), level, kind))
    (found,) = picture_files(tmp_path)
    frame = fit_to_frame(read_picture(found))
    assert frame.shape == FRAME_SHAPE
    assert np.abs(frame.astype(int) - 200).max() <= 2


def test_what_cannot_be_played_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad.mp4").write_bytes(b"no video")
    (folder / "000.png").write_bytes(b"no picture")
    for path, said in (
        (tmp_path / "none", "got no such path"),
        (tmp_path / "notes.txt", "got another file"),
        (tmp_path / "empty", "got none"),
        (tmp_path / "bad.mp4", "cannot play"),
    ):
        with pytest.raises(ConfigError, match=said):
            play(path)
    with pytest.raises(ConfigError, match="cannot read"):
        next(play(folder))


@given(st.integers(1, 700), st.integers(1, 700), st.integers(0, 255))
def test_any_picture_becomes_a_frame(height: int, width: int, level: int) -> None:
    frame = fit_to_frame(np.full((height, width, 3), level, np.uint8))
    assert frame.shape == FRAME_SHAPE
    assert (frame == level).all()


def test_the_middle_is_kept() -> None:
    picture = np.zeros((480, 1280, 3), np.uint8)
    picture[:, 320:960] = 200
    assert (fit_to_frame(picture) == 200).all()
    assert (fit_to_frame(picture.transpose(1, 0, 2)) == 200).all()


def test_every_pixel_counts_in_the_frames_mean() -> None:
    """As of the pictures that policies were taught with; single pixels would flicker."""
    picture = np.zeros((480, 640, 3), np.uint8)
    picture[::4, ::4] = 160
    assert (fit_to_frame(picture) == 10).all()


@pytest.mark.parametrize("wrong", [np.zeros((4, 4)), np.zeros((4, 4, 4), np.uint8)])
def test_what_is_no_picture_is_refused(wrong: np.ndarray) -> None:
    with pytest.raises(ContractError, match=r"expected \(H, W, 3\) uint8 RGB"):
        fit_to_frame(wrong)


def chunk(kind: bytes, data: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(kind + data))
    return struct.pack(">I", len(data)) + kind + data + check


def test_a_header_of_more_pixels_than_any_camera_has_is_refused(tmp_path: Path) -> None:
    """OpenCV raises an error of its own there."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0))
    rows = chunk(b"IDAT", zlib.compress(bytes(1_000)))
    (tmp_path / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + head + rows + chunk(b"IEND", b""))
    with pytest.raises(ConfigError, match=r"huge\.png"):
        read_picture(tmp_path / "huge.png")
