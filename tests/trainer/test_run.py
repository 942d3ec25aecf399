import json
from pathlib import Path

import pytest

from robot.errors import ConfigError
from robot.output import write_json
from trainer.presets import preset
from trainer.run import Episode, EpisodeLog, RunFolder, atomically, refuse_run


def episode(step: int) -> Episode:
    return Episode(step, step / 100.0, step % 4, step / 8.0, 16, step % 2 == 0)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def fail() -> None:
        with atomically(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_numbers_that_are_none_are_null(tmp_path: Path) -> None:
    write_json(tmp_path / "m.json", {"a": float("nan"), "b": [1.0, float("nan")]})
    assert json.loads((tmp_path / "m.json").read_text()) == {"a": None, "b": [1.0, None]}


def test_episodes_come_back_and_later_ones_are_dropped_on_resuming(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    log = EpisodeLog(folder)
    for step in (16, 33, 48):
        log.add(episode(step))
    log.file.close()
    assert folder.episodes() == [episode(16), episode(33), episode(48)]
    assert EpisodeLog(folder, resumed_at=33).count == 2
    assert folder.episodes() == [episode(16), episode(33)]


def test_a_line_cut_short_by_a_kill_is_ignored(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    log = EpisodeLog(folder)
    log.add(episode(16))
    log.file.close()
    with folder.progress.open("a") as file:
        file.write("32,0.3")
    assert folder.episodes() == [episode(16)]


def test_a_second_run_in_one_folder_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.go_on(preset("lane", "ppo", "debug"))
    with pytest.raises(ConfigError, match="--resume"):
        refuse_run(tmp_path)


def test_a_run_takes_no_place_of_a_taught_policy(tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_text("taught")
    with pytest.raises(ConfigError, match="choose another --out"):
        refuse_run(tmp_path)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected the folder of a run"):
        RunFolder(tmp_path).load_config()
