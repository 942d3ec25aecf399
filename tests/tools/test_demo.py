"""The demo learns on some maps and is judged on others, and says on which."""

import json
from pathlib import Path

import numpy as np
import pytest

from robot.errors import ConfigError
from robot.navigation.path import lane_loop
from robot.navigation.road_map import load_map
from tools.demo import demo_command, stages, summarise
from trainer.division import maps_named, part_of


def options(arguments: tuple[str, ...]) -> dict[str, list[str]]:
    """The words after each option of a command line."""
    found: dict[str, list[str]] = {}
    for word in arguments:
        if word.startswith("--"):
            found[word] = []
        elif found:
            found[list(found)[-1]].append(word)
    return found


def test_it_is_judged_on_a_ring_with_bends_to_the_right_that_it_never_saw(tmp_path: Path) -> None:
    every = stages(tmp_path, 0, 75.0)
    train, _, judge, _, missions, _ = (options(s.arguments) for s in every)
    assert {part_of(load_map(name)) for name in train["--map"]} == {"training"}
    assert judge["--lane"] == ["both"]
    (ring,) = map(load_map, judge["--map"])
    assert part_of(ring) == "judging"
    for outer in (True, False):
        bends = np.diff(np.unwrap(lane_loop(ring, outer).headings_rad))
        assert bends[bends < -0.02].sum() < -1.4
    assert {part_of(load_map(n)) for n in maps_named(missions["--map"])} == {"judging"}
    assert every[-1].arguments[:3] == ("trainer", "report", str(tmp_path)), "all on one page"
    titles = [stage.title for stage in stages(tmp_path, 0, 75.0)]
    assert all(name in titles[0] for name in train["--map"])
    assert judge["--map"][0] in titles[2]


def test_its_figures_say_where_and_keep_their_keys(tmp_path: Path) -> None:
    (tmp_path / "lane").mkdir()
    for name, content in {
        "lane/metrics.json": {"train_seconds": 60.0, "train_steps": 9000},
        "lane/evaluation.json": {"success_rate": 0.95, "mean_path_distance_m": 0.01},
        "loop.json": {"laps": 2.01},
        "navigation.json": {"success_rate": 0.99},
    }.items():
        (tmp_path / name).write_text(json.dumps(content))
    metrics = summarise(tmp_path, 170.0)
    kept = ("train_seconds", "train_steps", "success_rate", "loop_laps", "total_seconds")
    assert [metrics[key] for key in kept] == [60.0, 9000, 0.95, 2.01, 170.0]
    assert metrics["judged_on"] not in metrics["learned_on"]
    assert part_of(load_map(metrics["judged_on"])) == "judging"


def test_it_clears_away_no_work_but_its_own(tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_text('{"train_seconds": 60.0}')
    (tmp_path / "model.onnx").write_text("trained for a day")
    with pytest.raises(ConfigError, match="expected a new folder, or one of a demo"):
        demo_command(tmp_path)
    assert (tmp_path / "model.onnx").read_text() == "trained for a day"
