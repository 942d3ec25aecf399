import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from trainer.cli import main
from trainer.transfer.traits import measure_traits

EDGE = np.full((120, 160, 3), 60, np.uint8)
EDGE[:, 80:] = 200


def frames(picture: np.ndarray) -> np.ndarray:
    return np.stack([picture] * 3)


@pytest.mark.parametrize("sigma", [1.0, 5.0, 9.0])
def test_noise_is_told(sigma: float) -> None:
    rng = np.random.default_rng(0)
    noisy = np.clip(128 + rng.normal(0, sigma, (3, 120, 160, 1)), 0, 255).astype(np.uint8)
    measured = measure_traits(np.repeat(noisy, 3, axis=3)).noise
    assert measured == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize("sigma", [1.0, 1.6, 2.4])
def test_blur_is_told(sigma: float) -> None:
    blurred = cv2.GaussianBlur(EDGE, (0, 0), sigma)
    assert measure_traits(frames(blurred)).edge_px == pytest.approx(sigma, rel=0.3)


def test_casts_vignettes_and_colours_are_told() -> None:
    picture = np.full((120, 160, 3), (100, 120, 60), np.uint8)
    picture[-24:, :32] = picture[-24:, :32] // 2
    picture[-24:, -32:] = picture[-24:, -32:] // 2
    traits = measure_traits(frames(picture))
    assert traits.road_rgb == (100, 120, 60)
    assert traits.cast_rg == pytest.approx(100 / 120)
    assert traits.cast_bg == pytest.approx(0.5)
    assert traits.corners == pytest.approx(0.5, abs=0.02)


def test_folders_and_looks_stand_side_by_side(
    real: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "traits.json"
    words = ["traits", str(real), "--look", "nominal", "--frames", "3", "--json", str(report)]
    assert main(words) == 0
    measured = json.loads(report.read_text())
    assert measured[str(real)]["pictures"] == 3
    nominal = measured["nominal"]
    assert nominal["paint_rgb"][0] > nominal["road_rgb"][0] + 100
    assert main(["traits"]) == 2
    assert "expected folders of pictures" in capsys.readouterr().err
