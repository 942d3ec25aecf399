"""A real overhead camera with a wide lens over a robot football field (vss-vision's pictures)."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from localizer_node.calibrate import KnownPoint, calibrate, guess_lens
from localizer_node.calibration import Board, Colour, Marker
from localizer_node.node import locate_frame
from robot.bringup.camera_place import Freedom
from robot.camera.files import read_picture
from robot.errors import ConfigError

SEEN = json.loads((Path(__file__).parent / "overhead_colour_markers.json").read_text())
FIELD_M = (1.5, 1.3)
PIXEL_MM = 9.3  # on the floor: the pictures are 320 px wide
FREEDOM = Freedom(True, height_m=1.8)


def field_points():
    middle = (FIELD_M[0] / 2.0, FIELD_M[1] / 2.0)
    return [
        KnownPoint(float(u), float(v), middle[0] + x / 100.0, middle[1] + y / 100.0)
        for u, v, x, y in SEEN["field"]
    ]


def fit(model, limit_mm=PIXEL_MM):
    lens = guess_lens(model, 320, 180)
    return calibrate(field_points(), lens, FREEDOM, FIELD_M, (), max_residual_mm=limit_mm)


def test_the_field_s_marks_calibrate_its_fisheye_to_less_than_a_pixel():
    report = fit("fisheye")
    assert report.calibration.residual_mm < PIXEL_MM
    with pytest.raises(ConfigError, match="the lens model"):
        fit("pinhole")


@pytest.mark.parametrize("name", sorted(SEEN["blue"]))
def test_every_blue_tag_is_found_and_nothing_else(name, data_dir):
    """Blue tags of 4 to 7 px on a floor that is blue itself, beside other colours and clutter."""
    tag = Marker("tag", "plain", board=Board(0.06, 0.05, 0.08))
    colours = (Colour("blue", 185.0, 255.0, 0.35, 0.42),)
    calibration = replace(fit("fisheye").calibration, robots=(tag,), colours=colours)
    picture = read_picture(data_dir / "real" / "overhead_colour_markers" / "images" / name)
    found = [(d.u_px, d.v_px) for d in locate_frame(picture, calibration)]
    for expected in SEEN["blue"][name]:
        assert min(math.dist(expected, pixel) for pixel in found) < 2.0
    assert len(found) == len(SEEN["blue"][name])
