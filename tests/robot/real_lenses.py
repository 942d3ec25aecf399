"""The lenses of real Duckiebots, from their ROS calibrations."""

from __future__ import annotations

from pathlib import Path
from typing import List

from robot.lens import Lens
from robot.typed_config import read_yaml


def real_lenses(data_dir: Path) -> List[Lens]:
    lenses = []
    for path in sorted((data_dir / "real/duckiebot_camera_calibration").glob("*intrinsic*.yaml")):
        ros = read_yaml(path)
        assert ros["distortion_model"] == "plumb_bob"
        k, size = ros["camera_matrix"]["data"], (ros["image_width"], ros["image_height"])
        distortion = tuple(ros["distortion_coefficients"]["data"])
        lenses.append(Lens("plumb_bob", *size, k[0], k[4], k[2], k[5], distortion))
    assert lenses
    return lenses
