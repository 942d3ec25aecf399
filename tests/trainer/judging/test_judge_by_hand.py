"""What an evaluation asks, is shown, and says, without driving."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.navigation.road_map import load_map
from sim_pybullet.batch import DriveMetrics, Observation
from trainer.judging import evaluate
from trainer.judging import judge as module
from trainer.judging.evaluate import Drive, Evaluation, OnMap, _choose, _own_speeds
from trainer.judging.judge import _tell, answers
from trainer.options import EvaluateOptions

ASKED = EvaluateOptions("m.onnx", "lane", ("loop",), episodes=4, seed=7)
FIRST = Drive(7, True, DriveMetrics(10.0, 30.0, 0.6, 0.0, 0.02), laps=2.0, map="loop", lane="outer")
SECOND = Drive(8, False, DriveMetrics(2.0, 8.0, 0.4, 0.5, 0.05), failed=True, collided=True)


def test_the_policys_own_task_and_map_are_the_usual_ones() -> None:
    told = EvaluateOptions(model="m.onnx").filled_in("navigation")
    assert (told.task, told.map, told.model) == ("navigation", ("arena",), "m.onnx")
    told = EvaluateOptions(model="m.onnx", task="lane", map=("town",)).filled_in("navigation")
    assert (told.task, told.map) == ("lane", ("town",))


def test_a_file_answers_what_it_was_asked(tmp_path: Path) -> None:
    options = EvaluateOptions(model="m.onnx")
    out = tmp_path / "e.json"
    plain = json.loads(json.dumps(options.filled_in("lane").plain()))
    out.write_text(json.dumps({"inputs": plain}))
    assert answers(out, options)
    out.write_text(json.dumps({"inputs": {k: v for k, v in plain.items() if k != "lane"}}))
    assert answers(out, options), "an older one, without a choice of lanes"
    for wrong in ({**plain, "seed": 12}, {**plain, "task": ""}, {}, "lane", None):
        out.write_text(json.dumps({"inputs": wrong}))
        with pytest.raises(ConfigError, match="expected the evaluation asked for, got another one"):
            answers(out, options)


def told(result: Evaluation) -> str:
    heard = io.StringIO()
    _tell(Console(file=heard, width=200), result)
    return heard.getvalue()


RESULT = Evaluation(
    ASKED, 4, 0.75, 0.301, 0.0213, 30.0, 7.5, 0.2, (8,), "ppo", "r", 1, 1, None, 0.25, ()
)


def test_what_an_evaluation_says() -> None:
    said = told(RESULT)
    assert "m.onnx: success 75.0% of 4 (at least 30.1% with 95 % confidence)" in said
    assert "2.1 cm from the path" in said
    assert "laps" not in said
    assert "look nominal" not in said
    rows = (OnMap("a", None, None, 2, 1, 0.031), OnMap("b", "inner", "judging", 2, 2, 0.014))
    assert "kept for" not in told(replace(RESULT, by_map=rows[:1]))
    said = told(replace(RESULT, by_map=rows, laps=1.5, collisions=2))
    assert "look nominal" in said
    first, second = (line for line in said.splitlines() if " of 2" in line)
    assert all(word in first for word in ("a", "-", "nothing", "1 of 2", "3.1 cm"))
    assert all(word in second for word in ("b", "inner", "judging", "2 of 2", "1.4 cm"))
    assert "1.50 laps, 2 collisions, 0.2 m/s on average" in said


class Chooser:
    """A policy that notes what it sees, and chooses 3."""

    def __init__(self, actions: Any = ((0.3, 0.3), (0.1, 0.2)), frames: int = 2) -> None:
        image = ImageSpec(80, 60, 20)
        told = {"path_points": 4, "commands": 5}
        self.contract = SimpleNamespace(image=image, actions=actions, frames=frames, **told)
        self.seen: list[tuple[np.ndarray, np.ndarray | None]] = []

    def values(self, pictures: np.ndarray, path: np.ndarray | None) -> np.ndarray:
        self.seen.append((pictures, path))
        return np.eye(4)[[3]]


@pytest.mark.parametrize("zero", [None, "image", "path"])
def test_a_policy_sees_its_own_robots_stack_and_path_or_zeros(zero: str | None) -> None:
    images = np.zeros((3, 120, 160, 6), np.uint8)
    images[1, ..., :3], images[1, ..., 3:], images[2] = 50, 90, 200
    paths = np.arange(42.0, dtype=np.float32).reshape(3, 14) + 1.0
    policy: Any = Chooser()
    assert _choose(policy, Observation(images, paths), 1, zero) == 3
    ((pictures, path),) = policy.seen
    assert pictures.shape == (1, 40, 80, 6)
    assert path is not None
    shown = [0, 0] if zero == "image" else [50, 90]
    assert [int(pictures[0, 5, 5, k]) for k in (0, 3)] == shown
    way = [0.0] * 4 if zero == "path" else paths[1, :4]
    np.testing.assert_array_equal(path[0], [*way, *paths[1, 4:]], "its last commands stay")
    assert (images.any(), paths.all()) == (True, True), "whoever else is told them"
    if zero == "path":
        with pytest.raises(ConfigError, match="expected image, got path; this task gives none"):
            _choose(policy, Observation(images, None), 1, zero)
        policy.contract.path_points = 0
        with pytest.raises(ConfigError, match="expected image, got path; this task gives none"):
            _choose(policy, Observation(images, paths), 1, zero)
    else:
        _choose(policy, Observation(images, None), 1, zero)
        assert policy.seen[-1][1] is None


def test_a_policy_that_knows_fewer_pictures_sees_the_newest() -> None:
    images = np.zeros((1, 120, 160, 6), np.uint8)
    images[..., 3:] = 90
    policy: Any = Chooser(frames=1)
    _choose(policy, Observation(images, None), 0, None)
    ((pictures, _),) = policy.seen
    assert pictures.shape == (1, 40, 80, 3)
    assert (pictures == 90).all()


def test_a_policy_with_a_table_of_its_own_says_speeds() -> None:
    usual = ((0.3, 0.3), (0.1, 0.2))
    world: Any = SimpleNamespace(task=SimpleNamespace(vehicle=SimpleNamespace(actions=usual)))
    assert _own_speeds(Chooser(usual), world) is None  # type: ignore[arg-type]
    near = ((0.3 + 5e-7, 0.3), (0.1, 0.2))
    assert _own_speeds(Chooser(near), world) is None  # type: ignore[arg-type]
    own = ((0.3 + 2e-6, 0.3), (0.1, 0.2), (9.0, -9.0))
    for actions in (own, own[:2]):
        shares = _own_speeds(Chooser(actions), world)  # type: ignore[arg-type]
        assert shares is not None
        from robot.contract import MAX_WHEEL_MPS

        expected = np.clip(np.array(actions) / MAX_WHEEL_MPS, -1.0, 1.0)
        np.testing.assert_allclose(shares, expected)


def test_all_robots_drive_at_once_in_worlds_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[tuple[int, dict[str, Any]]] = []

    class World:
        def __init__(self, task: Any, looks: Any, image: Any, seed: int, **told: Any) -> None:
            made.append((task.n_robots, {"seed": seed, **told}))

    monkeypatch.setattr(evaluate, "BatchWorld", World)
    ridden = [(each, {}, evaluate.Ride()) for each in (SECOND, FIRST)]
    monkeypatch.setattr(evaluate, "drive", lambda *_: iter(ridden))
    monkeypatch.setattr(evaluate, "_own_speeds", lambda *_: None)
    for seeds in (range(20), range(3)):
        asked: Any = Chooser(), "lane", [load_map("loop")], [], seeds
        heard = [drive for drive, _ in evaluate.ridden(*asked, lane="both")]
        assert [(drive.seed, drive.lane) for drive in heard] == [(8, "outer"), (7, "inner")]
    assert [robots for robots, _ in made] == [20, 3]
    assert {(told["seed"], told["commands"]) for _, told in made} == {(1_000_000_007, 5)}


@pytest.mark.parametrize("name", ["model.onnx", ""])
def test_what_cannot_be_written_is_said_before_the_policy_is_opened(
    tmp_path: Path, name: str
) -> None:
    model, out = tmp_path / "model.onnx", tmp_path / name
    model.write_bytes(b"no policy at all")
    with pytest.raises(ConfigError, match="expected a file"):
        module.judge(out, EvaluateOptions(model=model), False, 1, Console())
    assert model.read_bytes() == b"no policy at all"
