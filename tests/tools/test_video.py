from pathlib import Path

import imageio_ffmpeg
import numpy as np

from robot.geometry import Pose
from tools.video import MapView, even, side_by_side
from trainer.mp4 import write_mp4


def view() -> MapView:
    return MapView(np.zeros((200, 300, 3), np.uint8), 0.0, 2.0, 0.01, height_px=100)


def test_map_corners_are_picture_corners() -> None:
    assert view().pixel(0.0, 2.0) == (0, 0)
    assert view().pixel(3.0, 0.0) == (150, 100)


def test_the_robot_is_drawn_where_it_is_and_leaves_a_trail() -> None:
    above = view()
    above.draw(Pose(0.5, 1.0, 0.0))
    picture = above.draw(Pose(2.0, 1.0, 1.0))
    column, row = above.pixel(2.0, 1.0)
    assert picture[row, column].any()
    column, row = above.pixel(1.2, 1.0)
    assert picture[row, column].any(), "the trail joins both places"
    assert not picture[10:20, 10:20].any()


def test_a_video_holds_every_frame(tmp_path: Path) -> None:
    frames = [
        side_by_side(np.full((12, 16, 3), 40 * k, np.uint8), view().floor, f"{k}") for k in range(5)
    ]
    write_mp4(tmp_path / "drive.mp4", frames, 10)
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "drive.mp4"))
    assert next(reader)["size"] == (frames[0].shape[1], frames[0].shape[0])
    assert len(list(reader)) == 5
    assert [p.name for p in tmp_path.iterdir()] == ["drive.mp4"]
    assert even(np.zeros((5, 7, 3), np.uint8)).shape == (4, 6, 3)
