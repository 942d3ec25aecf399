from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.navigation.path import PathBatch
from robot.navigation.road_map import load_map
from robot.recording.reader import read_frames
from sim_pybullet.racing.track import centre_line, load_track
from sim_pybullet.scene import SemanticClass
from trainer.cli import main
from trainer.transfer import pictures
from trainer.transfer.cli import Source
from trainer.transfer.pictures import (
    collect,
    load_paint,
    load_pictures,
    positions,
)


def read(path: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def test_frames_and_labels_belong_together(sim: Path) -> None:
    names = sorted(path.name for path in (sim / "image").iterdir())
    assert len(names) == 6
    lines = 0
    for name in names:
        frame, label = (read(sim / part / name) for part in ("image", "label"))
        assert frame.shape == (120, 160, 3)
        lines += int(np.isin(label, (SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE)).sum())
        white, road = (frame[label == k] for k in (SemanticClass.WHITE_LINE, SemanticClass.ROAD))
        if len(white) > 50:
            assert np.median(white) > np.median(road) + 60
    assert lines > 500
    assert "seed: 3" in (sim / "collection.yaml").read_text()


def test_a_seed_gives_the_same_frames(sim: Path, tmp_path: Path) -> None:
    collect(tmp_path / "a", Source(("loop",), 6, "nominal", seed=3))
    for part in ("image", "label"):
        ours, again = (read(folder / part / "000004.png") for folder in (sim, tmp_path / "a"))
        np.testing.assert_array_equal(ours, again)


def test_frames_of_a_track_show_its_road_from_everywhere_along_it() -> None:
    track = load_track("karting")
    poses = positions(track, 200, np.random.default_rng(0))
    line = centre_line(track)
    at = PathBatch([line.path] * 200).project(poses[:, :2])
    assert np.abs(at.offset_m).mean() < line.half_width_m
    counts, _ = np.histogram(at.arc_m, bins=8, range=(0.0, line.path.length_m))
    assert counts.min() > 8


def test_a_failure_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(_: Source) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        yield np.zeros((120, 160, 3), np.uint8), np.zeros((120, 160), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(pictures, "simulated", stopped)
    with pytest.raises(KeyboardInterrupt):
        collect(tmp_path / "out", Source(("loop",), 40, "nominal"))
    assert not list(tmp_path.iterdir())


def test_wrong_input_is_one_line_and_status_2(
    sim: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["collect", "--out", str(sim)]) == 2
    assert "expected a new folder" in capsys.readouterr().err
    new = str(tmp_path / "new")
    assert main(["collect", "--out", new, "--look", "randomized"]) == 2
    assert "did you mean 'randomised'" in capsys.readouterr().err


def test_robots_stand_near_their_lane() -> None:
    town = load_map("town")
    poses = positions(town, 200, np.random.default_rng(0))
    assert np.mean([town.on_road(x, y) for x, y, _ in poses]) > 0.98


def test_paint_is_where_the_pictures_show_it(sim: Path) -> None:
    image = ImageSpec(80, 60, 20)
    pictures = load_pictures([sim], image)
    paint = load_paint(pictures, image)
    assert paint.shape == (6, 4, 40, 80)
    white = paint[:, 0] > 250
    road = paint[:, 3] > 250
    brightness = pictures.images.mean(-1)
    assert brightness[white].mean() > brightness[road].mean() + 80


def test_a_robots_recording_and_a_folder_are_photographs_alike(real: Path) -> None:
    pytest.importorskip("mcap")
    recording = Path(__file__).parents[2] / "data" / "golden_drive.mcap"
    frames = [frame for _, frame in read_frames(recording)]
    both = load_pictures([recording, real], ImageSpec())
    np.testing.assert_array_equal(both.images[: len(frames)], np.stack(frames))
    assert both.folder.tolist() == [0] * len(frames) + [1] * 5


def test_photographs_have_no_labels(real: Path) -> None:
    with pytest.raises(ConfigError, match="expected the labels of 0"):
        load_paint(load_pictures([real], ImageSpec()), ImageSpec())


def test_what_a_killed_run_left_is_swept_away(tmp_path: Path) -> None:
    left = tmp_path / ".out.partial" / "image"
    left.mkdir(parents=True)
    (left / "000099.png").write_bytes(b"half a picture")
    words = ["collect", "--out", str(tmp_path / "out"), "--map", "loop", "--look", "nominal"]
    assert main([*words, "--frames", "2"]) == 0
    for part in ("image", "label"):
        names = sorted(path.name for path in (tmp_path / "out" / part).iterdir())
        assert names == ["000000.png", "000001.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_nothing_is_gathered_of_a_look_kept_for_judging(tmp_path: Path) -> None:
    """A translator that learned from it would bring it to who learns through it."""
    with pytest.raises(ConfigError, match="kept for judging"):
        collect(tmp_path / "a", Source(("loop",), 6, "reality"))
    assert not (tmp_path / "a").exists()
