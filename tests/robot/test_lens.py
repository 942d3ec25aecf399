import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.errors import ConfigError
from robot.lens import DUCKIEBOT_LENS, CameraRig, Lens, Mount
from tests.robot.real_lenses import real_lenses

SMALL = DUCKIEBOT_LENS.scaled(160, 120)
FISHEYE = Lens("fisheye", 160, 120, 50.0, 50.0, 79.5, 59.5, (0.01, -0.002, 0.001, 0.0))
PINHOLE = Lens("pinhole", 160, 120, 78.0, 78.0, 79.5, 59.5)
LENSES = [SMALL, FISHEYE, PINHOLE, DUCKIEBOT_LENS]


def grid(lens: Lens, step: int = 8) -> np.ndarray:
    v, u = np.mgrid[0 : lens.height_px : step, 0 : lens.width_px : step]
    return np.stack((u, v), axis=-1).astype(float)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens.model}-{lens.width_px}")
def test_projecting_an_unprojected_pixel_returns_it(lens: Lens) -> None:
    rays = lens.unproject(grid(lens))
    assert np.allclose(np.linalg.norm(rays, axis=-1), 1.0)
    assert np.allclose(lens.project(3.7 * rays), grid(lens), atol=1e-6)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens.model}-{lens.width_px}")
def test_scaling_keeps_the_rays_of_the_corners(lens: Lens) -> None:
    half = lens.scaled(lens.width_px // 2, lens.height_px // 2)
    # A pixel of the half-size picture is centred on the corner shared by four pixels.
    assert np.allclose(half.unproject([[0.0, 0.0]]), lens.unproject([[0.5, 0.5]]), atol=1e-9)


def test_the_robot_lens_sees_111_by_84_degrees() -> None:
    rays = DUCKIEBOT_LENS.unproject([[0, 240], [639, 240], [320, 0], [320, 479]])
    across, down = rays[0] @ rays[1], rays[2] @ rays[3]
    assert math.degrees(math.acos(across)) == pytest.approx(111.3, abs=1.5)
    assert math.degrees(math.acos(down)) == pytest.approx(84.3, abs=1.5)


def test_an_equidistant_fisheye_sees_behind_itself() -> None:
    lens = Lens("fisheye", 200, 200, 50.0, 50.0, 100.0, 100.0, (0.0, 0.0, 0.0, 0.0))
    ray = lens.unproject([[195.0, 100.0]])[0]
    assert math.acos(ray[2]) == pytest.approx(95.0 / 50.0)
    assert np.allclose(lens.project(ray), [195.0, 100.0])


@given(st.floats(0.15, 1.5), st.floats(-0.3, 0.3))
def test_a_floor_point_comes_back_from_its_pixel(x: float, y: float) -> None:
    rig = CameraRig(SMALL)
    pixel = rig.to_pixels(np.array([x, y, 0.0]))
    assume(np.all((pixel >= 0) & (pixel <= (159, 119))))
    assert np.allclose(rig.to_floor(pixel), [x, y], atol=1e-6)


def test_mount_angles_turn_the_way_they_say() -> None:
    forward = np.array([0.0, 0.0, 1.0])
    assert (Mount(pitch_rad=0.2).rotation @ forward)[2] < 0
    assert (Mount(pitch_rad=0.0, yaw_rad=0.2).rotation @ forward)[1] > 0
    right = np.array([1.0, 0.0, 0.0])
    assert (Mount(pitch_rad=0.0, roll_rad=0.2).rotation @ right)[2] < 0


def test_above_the_horizon_is_no_floor() -> None:
    assert np.isnan(CameraRig(SMALL).to_floor(np.array([80.0, 2.0]))).all()


@pytest.mark.parametrize("wrong", [{"fx_px": -700.0}, {"fy_px": 0.0}, {"width_px": 0}])
def test_a_lens_that_cannot_be_is_refused(wrong: Dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="above 0"):
        replace(DUCKIEBOT_LENS, **wrong)


def test_a_picture_of_another_shape_is_none_of_the_lens() -> None:
    assert DUCKIEBOT_LENS.of_picture(320, 240).fx_px == pytest.approx(DUCKIEBOT_LENS.fx_px / 2)
    with pytest.raises(ConfigError, match="shape, 640x480, got 640x360"):
        DUCKIEBOT_LENS.of_picture(640, 360)
    assert DUCKIEBOT_LENS.scaled(640, 360).height_px == 360, (
        "as simulated pictures may be stretched"
    )


@pytest.mark.parametrize("height_m", [0.0, 10.8])
def test_a_camera_a_robot_cannot_carry_is_refused(height_m: float) -> None:
    with pytest.raises(ConfigError, match=r"height_m: expected 0\.01 to 1\.0"):
        Mount(height_m)


def test_an_unknown_model_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'fisheye'"):
        Lens("fisheyes", 10, 10, 1, 1, 1, 1)
    with pytest.raises(ConfigError, match="coefficients, got 2"):
        Lens("fisheye", 10, 10, 1, 1, 1, 1, (0.1, 0.2))


def test_lenses_of_real_robots_project_what_they_unproject(data_dir: Path) -> None:
    for lens in real_lenses(data_dir):
        centre = np.array([[lens.width_px / 2, lens.height_px / 2]])
        assert np.allclose(lens.project(lens.unproject(centre)), centre, atol=1e-6)


def test_beyond_the_fold_of_its_polynomial_a_lens_sees_nothing() -> None:
    lens = Lens("plumb_bob", 160, 120, 78.0, 78.0, 79.5, 59.5, (-0.4, 0.0, 0.0, 0.0))
    tangents = np.array([0.5, 0.9, 0.95, 2.0])  # the slope of r (1 - 0.4 r^2) ends at r = 0.913
    pixels = lens.project(np.stack((tangents, 0 * tangents, 1 + 0 * tangents), axis=-1))
    assert np.array_equal(np.isnan(pixels[:, 0]), [False, False, True, True])
