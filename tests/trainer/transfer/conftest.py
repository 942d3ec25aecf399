"""A small collection from the simulator, and photographs that are none."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from trainer.transfer.cli import Source
from trainer.transfer.pictures import collect


@pytest.fixture(scope="session")
def sim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sim") / "frames"
    collect(out, Source(("loop",), 6, "nominal", seed=3))
    return out


@pytest.fixture(scope="session")
def real(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("real")
    rng = np.random.default_rng(0)
    for k in range(5):
        picture = rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{k}.png"), cv2.GaussianBlur(picture, (0, 0), 3.0))
    return folder
