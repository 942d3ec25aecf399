"""Drives as a LeRobot dataset, and back; where LeRobot itself is installed, it loads and learns."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robot.errors import ConfigError
from robot.recording.drive_file import picture, png
from robot.recording.reader import read_samples
from tests.tools.recorded import recorded
from tools.data.__main__ import main
from tools.data.drives import write_drive
from tools.data.lerobot import from_dataset, to_dataset
from trainer.mp4 import write_mp4

WHEELS = ["left_mps", "right_mps"]


def test_there_and_back_is_the_same_drive(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    drives = [recorded(tmp_path / "own", name) for name in ("a", "b")]
    assert to_dataset(drives, tmp_path / "dataset", "drive") == 2
    back = from_dataset(tmp_path / "dataset", tmp_path / "back")
    for there, here in zip(drives, back, strict=True):
        before, after = list(read_samples(there)), list(read_samples(here))
        assert [s.driver for s in after] == [s.driver for s in before]
        wheels = [s.wheels for s in before]
        assert np.allclose([s.wheels for s in after], wheels, rtol=0.0, atol=1e-7)
        for one, other in zip(before, after, strict=True):
            off = picture(one.picture).astype(float) - picture(other.picture)
            assert np.abs(off).mean() < 4.0, "the video loses little"
        gaps = np.diff([s.time_s for s in after])
        assert np.allclose(gaps, 0.1, atol=1e-3)


def test_what_is_no_whole_dataset_of_wheels_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"expected a whole LeRobot dataset v3\.0"):
        from_dataset(tmp_path, tmp_path / "out")
    info = tmp_path / "meta/info.json"
    info.parent.mkdir()
    for version, names, says in (
        ("v2.1", WHEELS, "v2.1; .*_v21_to_v30"),
        ("v3.0", ["arm"], "left_mps"),
    ):
        features = {"action": {"names": names, "dtype": "float32"}}
        told = {"codebase_version": version, "fps": 10, "features": features}
        info.write_text(json.dumps(told))
        with pytest.raises(ConfigError, match=says):
            from_dataset(tmp_path, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["meta"]


def test_of_cameras_the_first_that_shows_no_depth_is_taken(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    to_dataset([recorded(tmp_path, "a")], dataset := tmp_path / "dataset", "drive")
    before = list(read_samples(from_dataset(dataset, tmp_path / "before")[0]))
    file = dataset / "meta/info.json"
    info = json.loads(file.read_text())
    for depth in ({"video.is_depth_map": True}, {"is_depth_map": True}):
        film = {"dtype": "video", "shape": [120, 160, 1], "names": None, "info": depth}
        features = {"observation.images.depth": film, **info["features"]}
        file.write_text(json.dumps({**info, "features": features}))
        (drive,) = from_dataset(dataset, tmp_path / next(iter(depth)))
        assert [s.picture for s in read_samples(drive)] == [s.picture for s in before]
        features = {"observation.images.depth": film, "action": info["features"]["action"]}
        file.write_text(json.dumps({**info, "features": features}))
        with pytest.raises(ConfigError, match="got: no video of a camera"):
            from_dataset(dataset, tmp_path / "back")
    assert not (tmp_path / "back").exists()


def test_pictures_of_an_odd_size_become_no_video_of_another_size(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    samples = read_samples(recorded(tmp_path, "a"))
    odd = [s._replace(picture=png(np.zeros((121, 161, 3), np.uint8))) for s in samples]
    drive = write_drive(tmp_path, "odd", "donkeycar", odd)
    with pytest.raises(ConfigError, match=r"expected one even size, got .*\(121, 161, 3\)"):
        to_dataset([drive], tmp_path / "dataset", "drive")
    assert not (tmp_path / "dataset").exists()


def test_a_video_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    dataset = tmp_path / "dataset"
    to_dataset([recorded(tmp_path / "own", "a")], dataset, "drive")
    (film,) = dataset.rglob("*.mp4")
    write_mp4(film, [np.zeros((120, 160, 3), np.uint8)] * 29, 10.0)
    with pytest.raises(ConfigError, match=r"expected a whole .* a film of 29 pictures for 30 rows"):
        from_dataset(dataset, tmp_path / "back")
    assert not (tmp_path / "back").exists()


def _scaled(rows: list) -> list:
    return [{**row, "action": [1000.0 * mps for mps in row["action"]]} for row in rows]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_scaled, r"an action of \[.*\] m/s, beyond 3"),
        (lambda rows: [{**row, "timestamp": 0.0} for row in rows], "do not grow, at 0 s"),
        (lambda rows: rows[::-1], "missing or out of order"),
        (lambda rows: rows[:9] + rows[10:], "missing or out of order"),
        (lambda rows: rows[:-1], "29 rows of an episode of 30"),
    ],
)
def test_rows_that_cannot_be_are_refused(
    change: Callable[[list], list], says: str, tmp_path: Path
) -> None:
    parquet, pa = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    to_dataset([recorded(tmp_path, "a")], dataset := tmp_path / "dataset", "drive")
    file = next((dataset / "data").rglob("*.parquet"))
    table = parquet.read_table(file)
    rows = change(table.to_pylist())
    parquet.write_table(pa.Table.from_pylist(rows, schema=table.schema), file)
    with pytest.raises(ConfigError, match=says):
        from_dataset(dataset, tmp_path / "back")
    assert not (tmp_path / "back").exists()


@pytest.mark.parametrize("wrong", ["no episodes", "no rate", "no video"])
def test_a_dataset_that_lacks_a_part_is_refused(wrong: str, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    to_dataset([recorded(tmp_path, "a")], dataset := tmp_path / "dataset", "drive")
    if wrong == "no episodes":
        (dataset / "meta/episodes/chunk-000/file-000.parquet").unlink()
    elif wrong == "no video":
        next(dataset.rglob("*.mp4")).unlink()
    else:
        info = dataset / "meta/info.json"
        info.write_text(json.dumps({**json.loads(info.read_text()), "fps": 0}))
    with pytest.raises(ConfigError, match="expected a whole LeRobot dataset"):
        from_dataset(dataset, tmp_path / "back")
    assert not (tmp_path / "back").exists()


def test_without_pyarrow_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    drive = recorded(tmp_path / "own", "a")
    assert main(["to-lerobot", str(drive), "--out", str(tmp_path / "dataset")]) == 2
    assert "pip install '.[lerobot]'" in capsys.readouterr().err
    assert not (tmp_path / "dataset").exists()


@pytest.mark.slow
def test_lerobot_loads_it_and_trains_a_step(tmp_path: Path) -> None:
    pytest.importorskip("lerobot")
    import torch
    from lerobot.configs.types import FeatureType
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.datasets.utils import dataset_to_policy_features
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy

    drives = [recorded(tmp_path / "own", name) for name in ("a", "b")]
    to_dataset(drives, tmp_path / "dataset", "drive")
    ahead = {"action": [i / 10 for i in range(4)]}
    found = LeRobotDataset(
        "duck/drives", tmp_path / "dataset", delta_timestamps=ahead, video_backend="pyav"
    )
    assert (found.num_episodes, found.fps) == (2, 10)
    samples = [sample for drive in drives for sample in read_samples(drive)]
    assert len(found) == len(samples)
    item = found[len(samples) // 2 + 3]
    sample = samples[len(samples) // 2 + 3]
    assert item["task"] == "drive"
    assert item["action"][0].numpy() == pytest.approx(sample.wheels, abs=1e-6)
    seen = item["observation.images.front"].numpy().transpose(1, 2, 0)
    assert np.abs(seen - picture(sample.picture) / 255.0).mean() < 0.02
    features = dataset_to_policy_features(found.meta.features)
    outputs = {k: f for k, f in features.items() if f.type is FeatureType.ACTION}
    config = ACTConfig(
        input_features={k: f for k, f in features.items() if k not in outputs},
        output_features=outputs,
        chunk_size=4,
        n_action_steps=4,
        dim_model=32,
        n_heads=2,
        dim_feedforward=32,
        n_encoder_layers=1,
        pretrained_backbone_weights=None,
        device="cpu",
    )
    policy = ACTPolicy(config)
    optimiser = torch.optim.Adam(policy.parameters(), 1e-3)
    batch = next(iter(torch.utils.data.DataLoader(found, batch_size=4)))
    loss, _ = policy.forward(batch)
    loss.backward()
    optimiser.step()
    assert torch.isfinite(loss)
