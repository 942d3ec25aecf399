"""The camera's mount and lens, found again from drawn pictures of the printed board."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Callable, Dict, List, Tuple

import numpy as np
import pytest

from robot.bringup import chessboard
from robot.bringup.camera_place import Freedom, fit_camera
from robot.bringup.chessboard import (
    board_points_m,
    find_board,
    fit_lens,
    fit_mount,
)
from robot.camera.files import read_picture, write_png
from robot.cli import main
from robot.config import CameraConfig, RobotConfig
from robot.errors import ConfigError
from robot.lens import DUCKIEBOT_LENS, CameraRig, Lens, Mount
from robot.typed_config import load_yaml
from tests.robot.bringup.boards import floor_picture, held_boards

NEAR_M = 0.18
FISHEYE = Lens("fisheye", 640, 480, 310.0, 312.0, 322.0, 236.0, (-0.02, 0.004, -0.001, 0.0))
MOUNTS: Dict[str, Mount] = {
    "nominal": Mount(),
    "tilted": Mount(0.115, 0.07, 0.004, math.radians(23.7), math.radians(2.0), math.radians(-1.5)),
    "low and level": Mount(0.092, 0.06, -0.003, math.radians(15.0), math.radians(-1.0), 0.02),
}


@pytest.mark.parametrize("name", MOUNTS)
def test_pitch_and_height_are_found_again(name: str) -> None:
    lens = DUCKIEBOT_LENS if name == "nominal" else FISHEYE
    mount, rng = MOUNTS[name], np.random.default_rng(len(name))
    corners = find_board(floor_picture(CameraRig(lens, mount), NEAR_M, rng))
    assert corners is not None
    found, residual_px = fit_mount(corners, lens, NEAR_M, mount)
    assert found.pitch_rad == pytest.approx(mount.pitch_rad, abs=math.radians(0.2))
    assert found.roll_rad == pytest.approx(mount.roll_rad, abs=math.radians(0.4))
    assert found.height_m == pytest.approx(mount.height_m, abs=0.002)
    assert residual_px < 0.6


def test_exact_corners_give_the_exact_mount_wherever_the_board_lies() -> None:
    mount = MOUNTS["tilted"]
    pixels = CameraRig(FISHEYE, mount).to_pixels(board_points_m(0.2))
    found, residual_px = fit_mount(pixels, FISHEYE, 0.18, mount)  # it lies 2 cm farther than told
    assert residual_px < 1e-6
    expected = replace(mount, forward_m=mount.forward_m - 0.02)
    assert vars(found) == pytest.approx(vars(expected), abs=1e-7)


def test_how_sure_the_height_is_is_how_far_it_scatters_by_a_pixel() -> None:
    mount, rng = MOUNTS["tilted"], np.random.default_rng(5)
    points_m = board_points_m(NEAR_M)[[0, 6, 21, 27]]
    pixels = CameraRig(FISHEYE, mount).to_pixels(points_m)
    fits = [
        fit_camera(pixels + rng.normal(0.0, 1.0, pixels.shape), points_m[:, :2], FISHEYE, Freedom())
        for _ in range(60)
    ]
    scatter_m = np.std([fit.position_m[2] for fit in fits])
    assert np.median([fit.height_sigma_m for fit in fits]) == pytest.approx(scatter_m, rel=0.3)
    known = Freedom(height_m=mount.height_m)
    fit = fit_camera(pixels, points_m[:, :2], FISHEYE, known)
    assert (fit.position_m[2], fit.height_sigma_m) == (mount.height_m, 0.0)


def test_as_many_equations_as_unknowns_are_enough() -> None:
    """Four points tell place, focal length and one coefficient; three do not."""
    points_m = board_points_m(NEAR_M)[[0, 6, 21, 27]]
    lens = replace(FISHEYE, distortion=(-0.02, 0.0, 0.0, 0.0))
    pixels, free = CameraRig(lens, MOUNTS["tilted"]).to_pixels(points_m), Freedom(True, 1)
    for times in (0.3, 1.0, 2.5):
        begin = replace(lens, fx_px=times * lens.fx_px, fy_px=times * lens.fy_px)
        fit = fit_camera(pixels, points_m[:, :2], begin, free)
        assert fit.lens.fx_px == pytest.approx(310.0, rel=1e-4)
    with pytest.raises(ConfigError, match="3 points give 6 equations for 8 unknowns"):
        fit_camera(pixels[:3], points_m[:3, :2], lens, free)


WRONG: Dict[str, Tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "bent sheet": (
        lambda c: c + 4.0 * np.sin(np.arange(len(c)))[:, None],
        r"miss the fitted board by .* px, expected at most 1\.00",
    ),
    "picture upside down": (lambda c: (640.0, 480.0) - c[::-1], r"expected"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_cannot_be_is_refused_with_the_residual(wrong: str) -> None:
    change, message = WRONG[wrong]
    corners = change(CameraRig(FISHEYE, Mount()).to_pixels(board_points_m(NEAR_M)))
    with pytest.raises(ConfigError, match=message):
        fit_mount(corners, FISHEYE, NEAR_M, Mount())


def test_the_squares_are_three_centimetres_wide() -> None:
    """Far row first, from left to right; of 8 squares across the fourth corner is in the middle."""
    corners = board_points_m(0.18)
    assert corners[[0, 3, 6, 27]] == pytest.approx(
        np.array([(0.30, 0.09, 0.0), (0.30, 0.0, 0.0), (0.30, -0.09, 0.0), (0.21, -0.09, 0.0)])
    )


def test_a_picture_is_taken_after_the_camera_has_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures, did = iter(range(99)), []
    camera = SimpleNamespace(grab=lambda: next(pictures), close=lambda: did.append("closed"))
    monkeypatch.setattr(chessboard, "open_stream", lambda _, size: did.append(size) or camera)
    assert chessboard.take_picture(CameraConfig()) == 15
    assert did == [(640, 480), "closed"]


def test_a_board_told_at_the_wrong_distance_is_noticed() -> None:
    pixels = CameraRig(FISHEYE, Mount()).to_pixels(board_points_m(0.30))
    with pytest.raises(ConfigError, match="the board lies 120 mm farther"):
        fit_mount(pixels, FISHEYE, NEAR_M, Mount())


# The least and the most that a robot's camera may be found to have, each with a little beyond.
BOUNDS = {
    "height_m": ((0.031, 0.029), (0.39, 0.41)),
    "pitch_rad": ((-4.9, -5.1), (59.0, 61.0)),
    "roll_rad": ((-11.9, -12.1), (11.9, 12.1)),
    "yaw_rad": ((-11.9, -12.1), (11.9, 12.1)),
    "forward_m": ((0.017, 0.015), (0.115, 0.117)),  # 5 cm from 0.066 m
    "left_m": ((-0.049, -0.051), (0.049, 0.051)),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_mount_that_no_robot_has_is_refused(name: str) -> None:
    for within, beyond in BOUNDS[name]:
        for value in (within, beyond):
            told = value if name.endswith("_m") else math.radians(value)
            mount = replace(Mount(), **{name: told})
            pixels = CameraRig(FISHEYE, mount).to_pixels(board_points_m(NEAR_M))
            if value == within:
                found, _ = fit_mount(pixels, FISHEYE, NEAR_M, Mount())
                assert vars(found) == pytest.approx(vars(mount), abs=1e-5)
                continue
            named = "the board lies" if name in ("forward_m", "left_m") else f"camera {name}"
            with pytest.raises(ConfigError, match=named):
                fit_mount(pixels, FISHEYE, NEAR_M, Mount())


def test_the_command_writes_pitch_and_height_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mount, config, shot = MOUNTS["tilted"], tmp_path / "robot.yaml", tmp_path / "shot.png"
    text = "model: m.onnx # mine\ncamera: {kind: v4l2}\n"
    config.write_text(text)
    rig = CameraRig(DUCKIEBOT_LENS, mount)
    write_png(shot, floor_picture(rig, NEAR_M, np.random.default_rng(1)))
    arguments = ["calibrate", "camera", "--config", str(config), "--image", str(shot)]
    assert main(arguments) == 0
    told = capsys.readouterr().out
    assert "residual" in told
    assert "camera.mount.height_m: 0.108 -> 0.1" in told
    found = load_yaml(RobotConfig, config).camera
    assert found.mount.pitch_rad == pytest.approx(mount.pitch_rad, abs=math.radians(0.2))
    assert found.kind == "v4l2"
    assert config.read_text().startswith("model: m.onnx # mine\n")
    config.write_text(text)
    write_png(shot, floor_picture(rig, NEAR_M, np.random.default_rng(1))[60:420])
    assert main(arguments) == 2
    assert "expected a picture of the lens' shape, 640x480, got 640x360" in capsys.readouterr().err
    write_png(shot, np.full((480, 640, 3), 128, np.uint8))
    assert main(arguments) == 2
    assert "expected the board with all its 8 by 5 squares" in capsys.readouterr().err
    assert config.read_text() == text


@pytest.mark.parametrize(
    ("truth", "most_px"), [(FISHEYE, 1.0), (DUCKIEBOT_LENS, 3.0)], ids=["fisheye", "plumb bob"]
)
def test_a_lens_is_found_again(truth: Lens, most_px: float) -> None:
    """A plumb-bob lens is only nearly equidistant; 3 px of 640 are half a degree."""
    boards = held_boards(truth, 20, np.random.default_rng(3))
    lens, residual_px = fit_lens(boards, (640, 480))
    assert residual_px < 0.5
    v, u = np.mgrid[40:440:9j, 60:580:9j]
    rays = truth.unproject(np.stack((u, v), axis=-1))
    misses_px = np.linalg.norm(lens.project(rays) - np.stack((u, v), axis=-1), axis=-1)
    assert misses_px.max() < most_px


def test_a_lens_that_cannot_be_is_refused() -> None:
    rng = np.random.default_rng(4)
    boards = held_boards(FISHEYE, 12, rng)
    with pytest.raises(ConfigError, match=r"expected 8 pictures or more.*got 5"):
        fit_lens(boards[:5], (640, 480))
    covered = min(np.ptp(np.concatenate(boards), axis=0) / (640, 480))
    for share, told in ((0.3, "30 %"), (0.59, "59 %")):
        with pytest.raises(ConfigError, match=f"{told}.*hold the board into every corner"):
            fit_lens([share / covered * board for board in boards], (640, 480))
    shaken = [board + rng.normal(0.0, 3.0, board.shape) for board in boards]
    with pytest.raises(ConfigError, match=r"miss the fitted lens by|no lens fits"):
        fit_lens(shaken, (640, 480))


@pytest.mark.parametrize("residual_px", [1.01, math.nan])
def test_a_fit_that_misses_by_more_than_a_pixel_is_no_lens(
    residual_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    boards = held_boards(FISHEYE, 12, np.random.default_rng(4))
    found = (residual_px, np.eye(3), np.zeros(4), None, None)
    monkeypatch.setattr("cv2.fisheye.calibrate", lambda *_: found)
    with pytest.raises(ConfigError, match=r"miss the fitted lens by .* expected at most 1\.00"):
        fit_lens(boards, (640, 480))


def test_pictures_of_the_board_are_read_from_a_folder(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for name, mount in MOUNTS.items():
        write_png(tmp_path / f"{name}.png", floor_picture(CameraRig(FISHEYE, mount), NEAR_M, rng))
    write_png(tmp_path / "zz-no-board.png", np.full((480, 640, 3), 128, np.uint8))
    boards, size = chessboard.boards_from_files(tmp_path)
    assert (len(boards), size) == (len(MOUNTS), (640, 480))


def test_pictures_of_the_board_are_taken_by_the_robots_camera_until_there_are_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """So mode, size and flip are the ones that it drives with."""
    config, boards = tmp_path / "robot.yaml", tmp_path / "boards"
    config.write_text("model: m.onnx\ncamera: {kind: v4l2, number: 7}\n")
    answers, cameras = iter("yyyyn"), []

    def take(camera: CameraConfig) -> np.ndarray:
        cameras.append(camera.number)
        return np.full((480, 640, 3), len(cameras), np.uint8)

    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    arguments = ["calibrate", "lens", "--images", str(boards), "--config", str(config)]
    assert main(arguments) == 1, "there is no such camera"
    monkeypatch.setattr(chessboard, "take_picture", take)
    assert main(arguments) == 2
    assert "expected 8 pictures or more" in capsys.readouterr().err
    assert cameras == [7, 7, 7]
    assert [read_picture(file)[0, 0, 0] for file in sorted(boards.iterdir())] == [1, 2, 3]


@pytest.mark.parametrize("size", [(1280, 720), (480, 640)])
def test_pictures_that_the_robot_would_cut_fit_no_lens(
    size: Tuple[int, int], tmp_path: Path
) -> None:
    write_png(tmp_path / "wide.png", np.full((size[1], size[0], 3), 128, np.uint8))
    with pytest.raises(ConfigError, match=r"expected 4:3 pictures of one size, got \[\("):
        chessboard.boards_from_files(tmp_path)


def test_pictures_of_two_sizes_fit_no_lens(tmp_path: Path) -> None:
    for name, height in (("large", 480), ("small", 240)):
        write_png(tmp_path / f"{name}.png", np.full((height, height * 4 // 3, 3), 128, np.uint8))
    with pytest.raises(ConfigError, match=r"of one size, got \[\(320, 240\), \(640, 480\)\]"):
        chessboard.boards_from_files(tmp_path)


def test_the_sheet_is_in_true_size(tmp_path: Path) -> None:
    assert main(["calibrate", "target", "--out", str(tmp_path / "target.pdf")]) == 0
    pdf = (tmp_path / "target.pdf").read_bytes()
    squares = [line.split() for line in pdf.split(b"\n") if line.endswith(b" re")]
    assert len(squares) == 20
    points_per_mm = 72.0 / 25.4
    assert {round(float(side) / points_per_mm, 2) for line in squares for side in line[2:4]} == {30}
    assert min(float(line[0]) for line in squares) / points_per_mm == pytest.approx(28.5, abs=0.01)
    start = int(pdf.split(b"startxref\n")[1].split(b"\n")[0])
    assert pdf[start : start + 4] == b"xref"
    offsets: List[int] = [int(line[:10]) for line in pdf[start:].split(b"\n")[3:8]]
    assert [pdf[at : at + 7] for at in offsets] == [b"%d 0 obj" % n for n in range(1, 6)]
    assert main(["calibrate", "target", "--out", str(tmp_path / "target.doc")]) == 2
