import io
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from rich.console import Console

from robot.contract import PolicyContract
from robot.errors import ConfigError
from robot.typed_config import to_plain
from sim_pybullet.look import NOMINAL, load_look
from sim_pybullet.randomise import load_look_sampler
from trainer.cli import main
from trainer.experiments.options import VALUES
from trainer.experiments.sensitivity import (
    SensitivityOptions,
    drives,
    points,
    table_rows,
)
from trainer.export import export_network
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy
from trainer.presets import preset

OPTIONS = SensitivityOptions(model=("a.onnx", "b.onnx"))


def write_values(folder: Path, values: object) -> Path:
    path = folder / "values.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


def test_a_point_differs_from_the_look_in_its_field_alone(tmp_path: Path) -> None:
    drives(tmp_path, OPTIONS)
    nominal = to_plain(NOMINAL)
    for point in points(OPTIONS)[1:]:
        look = to_plain(load_look(tmp_path / "looks" / f"{point.name}.yaml"))
        group, leaf = point.field.split(".")
        assert look[group][leaf] == pytest.approx(point.value)
        look[group][leaf] = nominal[group][leaf]
        assert look == nominal


def test_every_policy_is_asked_about_every_shipped_value_on_the_same_episodes(
    tmp_path: Path,
) -> None:
    jobs = drives(tmp_path, OPTIONS)
    count = sum(
        len(v) for group in yaml.safe_load(VALUES.read_text()).values() for v in group.values()
    )
    assert len({job.json for job in jobs}) == len(jobs) == 2 * (count + 1)
    alike = {repr(replace(job.options, model="", look="")) for job in jobs}
    assert len(alike) == 1
    for job in jobs:
        load_look_sampler(job.options.look)


def test_looks_of_another_question_are_not_mixed_in(tmp_path: Path) -> None:
    drives(tmp_path, OPTIONS)
    drives(tmp_path, OPTIONS)
    with pytest.raises(ConfigError, match="got another"):
        drives(tmp_path, replace(OPTIONS, look="randomised"))
    with pytest.raises(ConfigError, match="expected one file"):
        drives(tmp_path, replace(OPTIONS, look="reality"))
    with pytest.raises(ConfigError, match="different names"):
        drives(tmp_path, replace(OPTIONS, model=("x/a.onnx", "y/a.onnx")))
    with pytest.raises(ConfigError, match="expected a list"):
        points(replace(OPTIONS, values=write_values(tmp_path, {"sensor": {"noise": 3}})))


def test_the_table_marks_what_training_does_not_reach(tmp_path: Path) -> None:
    config = preset("lane", "ddqn", "debug")
    model = tmp_path / "untrained.onnx"
    contract = PolicyContract("lane", "ddqn", config.image)
    export_network(GreedyNetwork(build_policy(config)), contract, model)
    values = {"camera": {"height_m": [0.11, 0.3]}, "sensor": {"white_balance": [[1, 1, 9.5]]}}
    asked = write_values(tmp_path, values)
    options = SensitivityOptions(model=(str(model),), values=asked, episodes=1)
    for job in drives(tmp_path, options):
        assert job.run(Console(file=io.StringIO())) == 0
    assert all(job.finished() for job in drives(tmp_path, options))
    _, *rows = table_rows(tmp_path, options)
    assert [row[:2] for row in rows] == [
        ("unchanged", ""),
        ("camera.height_m", "0.11"),
        ("camera.height_m", "0.3*"),
        ("sensor.white_balance", "1+1+9.5*"),
    ]


def test_an_unknown_field_is_refused_with_the_nearest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = write_values(tmp_path, {"camera": {"heigth_m": [0.1]}})
    command = ["experiment", "sensitivity", "--out", str(tmp_path), "--model", "a.onnx"]
    assert main([*command, "--values", str(values)]) == 2
    assert "did you mean 'height_m'" in capsys.readouterr().err
