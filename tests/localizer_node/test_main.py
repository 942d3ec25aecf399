import json
import math

import cv2
import numpy as np
import pytest

from localizer_node.__main__ import main
from localizer_node.calibration import Calibration, Marker, map_corners
from robot.link.keys import keygen
from robot.output import write_yaml
from robot.typed_config import load_yaml
from tests.localizer_node.rigs import FISHEYE, MAP_M, Rig, grid
from tests.robot.link.conftest import free_base_port

RIG = Rig(FISHEYE, yaw_rad=0.2)
POSE = (0.7, 1.9, 2.0)


@pytest.fixture
def arena(tmp_path):
    """A picture of one robot, and the calibration of its camera."""
    picture = RIG.floor()
    RIG.paint_robot(picture, Marker(), POSE)
    cv2.imwrite(str(tmp_path / "arena.png"), picture[..., ::-1])
    write_yaml(tmp_path / "arena.yaml", RIG.calibration())
    return tmp_path


def test_locate(arena, capsys):
    where = ["--image", str(arena / "arena.png"), "--calibration", str(arena / "arena.yaml")]
    out, drawn = arena / "found.json", arena / "found.png"
    assert main(["locate", *where, "--json", str(out), "--picture", str(drawn)]) == 0
    found = json.loads(out.read_text())
    assert (found["schema"], found["found"], found["robot"]) == (1, True, "robot")
    assert (found["x_m"], found["y_m"]) == pytest.approx(POSE[:2], abs=0.005)
    assert found["heading_rad"] == pytest.approx(POSE[2], abs=math.radians(2.0))
    assert 0.5 < found["confidence"] <= 1.0
    assert found["inputs"]["image"] == where[1]
    assert cv2.imread(str(drawn)).shape == (1280, 1280, 3)
    assert main(["locate", *where, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["robots"] == found["robots"]
    assert main(["locate", *where]) == 0
    assert "robot: x 0.7" in capsys.readouterr().out


def test_locate_nobody(arena, capsys):
    cv2.imwrite(str(arena / "arena.png"), RIG.floor()[..., ::-1])
    where = ["--image", str(arena / "arena.png"), "--calibration", str(arena / "arena.yaml")]
    assert main(["locate", *where, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["found"], found["x_m"], found["confidence"]) == (False, None, 0.0)
    assert main(["locate", *where]) == 0
    assert "no robot" in capsys.readouterr().out


def test_calibrate_by_corners_then_locate(arena, capsys):
    corners = [f"--corner={u},{v}" for u, v in RIG.see(map_corners(MAP_M)).round(1)]
    out = arena / "mine.yaml"
    image = ["--image", str(arena / "arena.png")]
    drawn = arena / "drawn.png"
    more = ["--height", "2.5", "--out", str(out), "--picture", str(drawn)]
    assert main(["calibrate", *image, *corners, *more]) == 0
    assert "so few points fit almost any lens" in capsys.readouterr().out
    assert load_yaml(Calibration, out).residual_mm < 8.0
    assert cv2.imread(str(drawn)).shape[:2] == (1280, 1280)
    assert main(["locate", *image, "--calibration", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["x_m"], found["y_m"]) == pytest.approx(POSE[:2], abs=0.01)


def test_calibrate_by_a_file_of_points_with_a_lens_and_robots(arena, capsys):
    lines = ["points:"]
    for p in RIG.known(grid(4, margin_m=0.1)):
        lines.append(f"- {{u_px: {p.u_px}, v_px: {p.v_px}, x_m: {p.x_m}, y_m: {p.y_m}}}")
    (arena / "points.yaml").write_text("\n".join(lines))
    (arena / "robots.yaml").write_text("robots:\n- {robot: seven, kind: tag, tag: 7}\n")
    lens = RIG.calibration().lens
    fields = ("model", "width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    text = "\n".join(f"{k}: {getattr(lens, k)}" for k in fields)
    (arena / "lens.yaml").write_text(f"{text}\ndistortion: {list(lens.distortion)}\n")
    files = [f"--{k}={arena / k}.yaml" for k in ("points", "robots", "lens")]
    image = ["--image", str(arena / "arena.png")]
    assert main(["calibrate", *files, *image, "--out", str(arena / "new.yaml")]) == 0
    made = load_yaml(Calibration, arena / "new.yaml")
    assert made.robots == (Marker("seven", "tag", tag=7),)
    assert made.lens == lens
    assert np.allclose(made.hanging.position_m, RIG.position_m, atol=1e-3)
    assert "camera 2.50 m above (1.12, 1.30) m" in capsys.readouterr().out


def test_run_prints_the_poses_of_each_picture(arena, capsys):
    frames = arena / "frames"
    frames.mkdir()
    picture, rng = cv2.imread(str(arena / "arena.png")), np.random.default_rng(0)
    for i in range(5):  # a live camera, whose pictures differ by noise
        noisy = np.clip(picture + rng.integers(-2, 3, picture.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(frames / f"{i}.png"), noisy)
    where = ["--source", str(frames), "--calibration", str(arena / "arena.yaml"), "--fps", "20"]
    assert main(["run", *where]) == 0
    poses = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [p["t_capture_s"] for p in poses] == pytest.approx([0.1, 0.15, 0.2])
    assert poses[0]["robot"] == "robot"


def test_the_pictures_of_a_file_are_not_published(arena, capsys):
    """They are of no time that a robot's clock knows: it would believe none of them."""
    keygen(arena / "keys")
    (arena / "link.yaml").write_text(
        f"keys: {arena}/keys/localizer\nbase_port: {free_base_port()}\n"
    )
    where = ["--source", str(arena), "--link", str(arena / "link.yaml")]
    assert main(["run", "--calibration", str(arena / "arena.yaml"), *where]) == 2
    assert "expected a camera for --link" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["locate", "--image", "no.png", "--calibration", "C"], "no.png"),
        (["locate", "--image", "I", "--calibration", "no.yaml"], "no.yaml"),
        (["calibrate", "--out", "X", "--image", "I", "--corner", "1,2"], "got 1"),
        (["calibrate", "--out", "X", "--image", "I", "--lens", "fisheyes"], "valid: fisheye"),
        (["calibrate", "--out", "X", "--image", "I", "--map", "arna"], "arena"),
        (["run", "--source", "nothing", "--calibration", "C"], "a folder of pictures or a video"),
    ],
)
def test_wrong_input_is_one_line_and_exit_status_2(arguments, complaint, arena, capsys):
    names = {"I": "arena.png", "C": "arena.yaml", "X": "out.yaml"}
    filled = [str(arena / names[a]) if a in names else a for a in arguments]
    if "--lens" in filled:
        filled += [f"--corner={u},{v}" for u, v in RIG.see(map_corners(MAP_M))]
    assert main(filled) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1
    assert not (arena / "out.yaml").exists()


@pytest.mark.parametrize("flag", ["--corner=1;2", "--height=low"])
def test_wrong_flags_say_what_they_should_be(flag, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["calibrate", "--out", "X", "--image", "I", flag])
    assert stopped.value.code == 2
    assert "expected" in capsys.readouterr().err


def test_a_camera_that_does_not_answer_is_exit_status_1(arena, capsys):
    assert main(["run", "--source", "93", "--calibration", str(arena / "arena.yaml")]) == 1
    assert "video93" in capsys.readouterr().err
