"""What pictures tell of a drive's turning, and whether its angles agree."""

import cv2
import numpy as np
import pytest

from robot.errors import ConfigError
from trainer.experiments.drive_pictures import frames_of, shifts_px, turning
from trainer.experiments.records import Drive

LATE = 4
PX_PER_DEG = 0.2


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """Someone turns before a painted wall; the wall answers four pictures later."""
    folder, rng = tmp_path_factory.mktemp("drive"), np.random.default_rng(0)
    wall = cv2.GaussianBlur(rng.integers(0, 256, (120, 900), np.uint8), (0, 0), 2.0)
    angle = 20.0 * np.sin(np.arange(120) / 9.0)
    place, files = 400.0, []
    for k in range(len(angle)):
        view = np.float32([[1, 0, -place], [0, 1, 0]])
        picture = cv2.warpAffine(wall, view, (160, 120), borderMode=cv2.BORDER_REFLECT)
        files.append(folder / f"{k:03d}.png")
        cv2.imwrite(str(files[-1]), picture)
        place += PX_PER_DEG * angle[max(0, k - LATE)]
    return Drive(tuple(files), angle)


def test_the_agreement_and_the_delay_are_found(drive: Drive) -> None:
    found = turning(drive.steering_deg, shifts_px(frames_of(drive)))
    assert found.correlation > 0.95
    assert abs(found.late_frames - LATE) <= 1


def test_angles_of_the_wrong_sign_are_refused_and_none_tell_nothing(drive: Drive) -> None:
    moved_px = shifts_px(frames_of(drive))
    with pytest.raises(ConfigError, match="change the sign"):
        turning(-drive.steering_deg, moved_px)
    assert turning(np.zeros(len(drive)), moved_px).correlation == 0.0
