import cv2
import numpy as np
import pytest

from localizer_node.sources import open_source
from robot.errors import ConfigError, HardwareError
from robot.lens import Lens

LENS = Lens("pinhole", 64, 48, 50.0, 50.0, 31.5, 23.5)
RED = np.full((48, 64, 3), (200, 10, 10), np.uint8)


def test_a_folder_gives_its_pictures_in_order(tmp_path):
    for i in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((48, 64, 3), 50 * i, np.uint8))
    (tmp_path / "notes.txt").write_text("no picture")
    frames = list(open_source(str(tmp_path), LENS, fps=10))
    assert [int(f.image[0, 0, 0]) for f in frames] == [0, 50, 100]
    assert [f.time_s for f in frames] == pytest.approx([0.0, 0.1, 0.2])


def test_a_video_gives_its_frames_in_rgb(tmp_path):
    path = str(tmp_path / "v.avi")
    writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 20.0, (64, 48))
    for _ in range(5):
        writer.write(np.ascontiguousarray(RED[..., ::-1]))
    writer.release()
    frames = list(open_source(path, LENS, fps=20))
    assert [f.time_s for f in frames] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])
    assert np.abs(frames[0].image.mean(axis=(0, 1)) - (200, 10, 10)).max() < 12


def test_sources_that_are_not_there(tmp_path):
    with pytest.raises(ConfigError, match="a folder of pictures or a video"):
        open_source(str(tmp_path / "none.avi"), LENS)
    with pytest.raises(ConfigError, match="got none"):
        open_source(str(tmp_path), LENS)
    for name in ("\u00b2", "9" * 20):
        with pytest.raises(ConfigError, match="no such path"):
            open_source(name, LENS)
    with pytest.raises(HardwareError, match="group video"):
        open_source("93", LENS)


def test_a_csi_camera_needs_gstreamer(monkeypatch):
    monkeypatch.setenv("PATH", "")
    for name in ("csi", "csi:1"):
        with pytest.raises(HardwareError, match=r"gstreamer1\.0-tools"):
            open_source(name, LENS)
