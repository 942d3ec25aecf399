"""The film of a drive: every fact of a moment is seen where it belongs."""

from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from robot.geometry import Pose
from robot.inference.policy import SHIPPED_MODELS
from sim_pybullet.scene import Ground
from tools.video import DUCK, DriveFilm, MapView, Moment, _draw_values
from trainer.mp4 import write_mp4

MODEL = SHIPPED_MODELS / "lane_dueling.onnx"
BLACK = np.zeros((200, 300, 3), np.uint8)
GROUND = Ground(BLACK, BLACK[..., 0], 0.01, 0.0, 2.0, (0.0, 0.0, 0.0))  # 3 m by 2 m
CAMERA, VALUES, MAP, STATE, BELOW = (
    np.s_[:600, :800],
    np.s_[600:, :800],
    np.s_[64:550, 816:1264],
    np.s_[:56, 800:],
    np.s_[555:620, 800:],
)


def moment(**other: object) -> Moment:
    frame = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
    first = Moment(frame, Pose(1.0, 1.0, 0.0), None, "AUTO", "", values=(0.1, 0.2, 0.9, 0.3, 0.4))
    return replace(first, **{"action": 2, **other})


@pytest.fixture
def film(tmp_path: Path) -> DriveFilm:
    film = DriveFilm(tmp_path / "films" / "drive.mp4", MODEL, 0.1)
    film.turn_to(GROUND)
    return film


def view() -> MapView:
    return MapView(GROUND, 150, 400)


def test_map_corners_are_picture_corners_and_the_box_holds_it() -> None:
    assert view().pixel(0.0, 2.0) == (0, 0)
    assert view().pixel(3.0, 0.0) == (150, 100)
    assert view().floor.shape == (100, 150, 3)
    assert MapView(GROUND, 400, 50).floor.shape == (50, 75, 3)


def test_the_robot_is_drawn_where_it_is_and_believes_to_be_and_leaves_a_trail() -> None:
    above = view()
    above.draw(moment(pose=Pose(0.5, 1.0, 0.0)))
    picture = above.draw(moment(pose=Pose(2.0, 1.0, 1.0)))
    assert picture[above.pixel(2.0, 1.0)[::-1]].any()
    assert picture[above.pixel(1.2, 1.0)[::-1]].any(), "the trail joins both places"
    assert not picture[10:20, 10:20].any()
    astray = above.draw(moment(pose=Pose(2.0, 1.0, 1.0), believed=Pose(0.3, 1.7, 0.0)))
    assert astray[5:25, 5:25].any()
    assert view().draw(moment(path=((0.2, 0.2), (0.4, 0.2))))[85:95, 10:20].any()


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"camera": np.zeros((120, 160, 3), np.uint8)}, CAMERA),
        ({"values": (0.9, 0.2, 0.1, 0.3, 0.4)}, VALUES),
        ({"believed": Pose(1.4, 1.0, 0.0)}, MAP),
        ({"path": ((0.5, 0.5), (0.5, 1.5))}, MAP),
        ({"state": "FAULT"}, STATE),
        ({"reason": "no picture"}, STATE),
        ({"note": "1.2 m to drive"}, BELOW),
    ],
)
def test_what_changes_is_seen_in_its_own_part(
    film: DriveFilm, change: dict[str, object], part: tuple[slice, slice]
) -> None:
    there = {"believed": Pose(0.4, 0.4, 0.0)}
    before, after = (film._picture(moment(**{**there, **new}), 0.3) for new in ({}, change))
    changed = (before != after).any(axis=2)
    assert changed[part].any()
    changed[part] = False
    assert not changed.any()


def test_the_picture_shows_where_the_policy_looks(film: DriveFilm) -> None:
    grey = np.full((120, 160, 3), 90, np.uint8)
    grey[70:, 60:80] = 255  # something to look at
    seen = film._picture(moment(camera=grey), 0.3)[CAMERA].astype(int)
    warmth = seen[..., 0] - seen[..., 2]
    assert warmth.max() > 40
    assert np.median(warmth) < 20


def test_a_film_holds_every_moment_and_the_speed_is_that_of_the_way(
    film: DriveFilm, monkeypatch: pytest.MonkeyPatch
) -> None:
    speeds: list[float] = []
    picture = film._picture

    def spied(at: Moment, speed_mps: float) -> np.ndarray:
        speeds.append(speed_mps)
        return picture(at, speed_mps)

    monkeypatch.setattr(film, "_picture", spied)
    for k in range(3):
        film.add(moment(pose=Pose(1.0 + 0.03 * k, 1.0, 0.0)))
    film.turn_to(GROUND)
    film.add(moment(pose=Pose(0.2, 0.2, 0.0)))  # carried there, not driven
    film.close()
    assert speeds == pytest.approx([0.0, 0.3, 0.3, 0.0])
    path = film._video._path
    reader = imageio_ffmpeg.read_frames(str(path))
    assert next(reader)["size"] == (1280, 720)
    assert len(list(reader)) == 4
    assert [p.name for p in path.parent.iterdir()] == ["drive.mp4"]


def test_a_video_holds_every_frame(tmp_path: Path) -> None:
    write_mp4(tmp_path / "a.mp4", [np.full((12, 16, 3), 40 * k, np.uint8) for k in range(5)], 10)
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    assert next(reader)["size"] == (16, 12)
    assert len(list(reader)) == 5


@pytest.mark.parametrize("count", [2, 6, 16])
def test_each_action_of_a_policys_own_has_a_cell(count: int) -> None:
    actions = (*((0.1 * k, 0.1) for k in range(count - 1)), (0.0, 0.0))
    width = 800 // count
    for chosen in range(count):
        picture = np.zeros((720, 1280, 3), np.uint8)
        _draw_values(picture, moment(values=tuple(range(count)), action=chosen), actions)
        lit = (picture == DUCK).all(axis=2).any(axis=0)
        assert lit[chosen * width : (chosen + 1) * width].any()
        assert not lit[: chosen * width].any()
        assert not lit[(chosen + 1) * width :].any()
