from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.errors import ConfigError
from robot.lens import CameraRig
from robot.output import write_yaml
from sim_pybullet.look import NOMINAL
from tests.trainer.judge_photographs import pursuit
from trainer.cli import main
from trainer.division import division
from trainer.sight.augment import shifted
from trainer.sight.photographs import (
    Annotated,
    Annotations,
    Polyline,
    Site,
    annotations_of,
    lane_of,
    learned_from,
)
from trainer.sight.pictures import FIGURES, IMAGE, LINE, NEW, ROAD, THING, is_seen

SIZE = (FRAME_WIDTH_PX, FRAME_HEIGHT_PX)


def drawn_line(beside_m: float, offset_m: float, heading_rad: float, bend_pm: float) -> Polyline:
    """What a person would draw of a line so far beside the middle of a bent lane."""
    along = np.linspace(-0.1, 0.9, 60)
    turn, half = along * bend_pm, 0.5 * along * bend_pm
    x = along * np.sinc(turn / np.pi) - beside_m * np.sin(turn)
    y = along * np.sin(half) * np.sinc(half / np.pi) + beside_m * np.cos(turn) - offset_m
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    floor = np.column_stack((c * x + s * y, c * y - s * x, 0.0 * x))
    rig = NOMINAL.rig()
    pixels = CameraRig(rig.lens.scaled(*SIZE), rig.mount).to_pixels(floor[floor[:, 0] > 0.05]) + 0.5
    inside = ((pixels >= 0.0) & (pixels <= SIZE)).all(axis=1)
    return tuple((float(u), float(v)) for u, v in pixels[inside])


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.13, 0.29), st.floats(-0.5, 0.5), st.floats(-1.5, 1.5))
def test_drawn_lines_say_how_the_lane_lies(
    offset_m: float, heading_rad: float, bend_pm: float
) -> None:
    yellow, white = (
        drawn_line(beside_m, offset_m, heading_rad, bend_pm) for beside_m in (0.117, -0.13572)
    )
    lane = lane_of(Annotated("x.png", yellow=(yellow,), white=white), SIZE)
    if len(yellow) < 15 or len(white) < 15:
        return  # one line alone, or a corner of one, tells less
    assert lane is not None
    assert lane[0] == pytest.approx(offset_m, abs=0.04)
    assert lane[1] == pytest.approx(heading_rad, abs=0.15)
    assert lane[2] == pytest.approx(bend_pm, abs=0.35)


def test_lines_that_no_lane_has_are_not_learned_from() -> None:
    right = drawn_line(-0.13572, 0.0, 0.0, 0.0)
    wide = drawn_line(0.25, 0.0, 0.0, 0.0)
    assert lane_of(Annotated("x.png", yellow=(wide,), white=right), SIZE) is None
    assert lane_of(Annotated("x.png"), SIZE) is None


@pytest.fixture
def floor(tmp_path: Path) -> Path:
    """A folder of three sites with one photograph each, one of them kept for judging."""
    white = drawn_line(-0.13572, 0.0, 0.0, 0.0)
    yellow = drawn_line(0.117, 0.0, 0.0, 0.0)
    sites = []
    for k, name in enumerate(("mine", "yours", division().sites.judging[0])):
        (tmp_path / name / "images").mkdir(parents=True)
        cv2.imwrite(str(tmp_path / name / "images" / "1.png"), np.full((120, 160, 3), 60 * k))
        told = Annotated("1.png", yellow=(yellow,), white=white, thing=name == "yours")
        sites.append(Site(name, name, (told,)))
    write_yaml(tmp_path / "photographs.yaml", Annotations(SIZE, tuple(sites)))
    return tmp_path


def test_own_photographs_are_learned_from_and_those_for_judging_never(floor: Path) -> None:
    found = learned_from(floor)
    assert found.images.shape == (2, *IMAGE.shape)
    assert [int(image.mean()) for image in found.images] == [0, 60]
    np.testing.assert_allclose(found.labels[:, :3], 0.0, atol=0.02)
    assert np.isnan(found.labels[:, 3:FIGURES]).all()
    assert found.labels[:, (LINE, ROAD, NEW)].tolist() == [[-1.0, 1.0, 0.0]] * 2
    assert found.labels[:, THING].tolist() == [0.0, 1.0]


def test_a_photograph_that_is_missing_is_told(floor: Path, tmp_path: Path) -> None:
    (floor / "mine" / "images" / "1.png").unlink()
    with pytest.raises(ConfigError, match=r"1\.png: expected an annotated photograph"):
        learned_from(floor)
    out = tmp_path / "run"
    words = ["train-sight", "--out", str(out), "--photographs", str(floor)]
    assert main(words) == 2
    assert not list(out.glob("training/*"))


def test_only_photographs_for_judging_teach_nothing(floor: Path) -> None:
    own = annotations_of(floor)
    kept = tuple(site for site in own.sites if site.name in division().sites.judging)
    write_yaml(floor / "photographs.yaml", Annotations(own.size, kept))
    with pytest.raises(ConfigError, match="found none"):
        learned_from(floor)


def test_a_person_would_drive_as_the_drawn_lines_say(data_dir: Path) -> None:
    """Of the shipped annotations: sensibly in nearly nine of ten photographs, and hardly wrong."""
    letters = []
    own = annotations_of(data_dir / "real")
    for site in (each for each in own.sites if each.name in division().sites.training):
        for drawn in site.photographs:
            lane = lane_of(drawn, own.size)
            if lane is not None and is_seen(*lane[:2]) and drawn.actions:
                letters.append(drawn.actions[pursuit(*lane)])
    assert len(letters) > 60
    assert letters.count("w") <= 1
    assert letters.count("s") >= 0.85 * len(letters)


def test_a_shifted_picture_is_nearly_the_same() -> None:
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, IMAGE.shape).astype(np.uint8), (0, 0), 6.0)
    for _ in range(20):
        other = shifted(image, rng)
        assert other.shape == image.shape
        assert 0.0 < np.abs(other.astype(float) - image).mean() < 10.0
