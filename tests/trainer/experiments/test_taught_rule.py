"""The rule that networks are taught in simulation."""

from pathlib import Path

import numpy as np
import pytest

from robot.errors import ConfigError
from sim_pybullet.racing.racing_cars import ALONG_M, ALONG_RAD
from sim_pybullet.racing.track import SCALE, centre_line, load_track
from trainer.experiments.records import Turn
from trainer.experiments.taught_rule import RoadReader, rule, simulated, views
from trainer.parsing.classes import ROAD
from trainer.parsing.segnet import SegNet
from trainer.parsing.train import ParseConfig, Parser, save_parser

TRACK = load_track("karting")
PATH = centre_line(TRACK).path


@pytest.mark.parametrize("offset_m", [-0.1, 0.0, 0.1])
def test_who_is_askew_turns_to_where_the_road_goes_wherever_on_it(offset_m: float) -> None:
    for arc_m in np.linspace(0.0, 0.9 * PATH.length_m, 12).tolist():
        x, y, heading = PATH.pose_at(arc_m)
        ahead = PATH.pose_at((arc_m + ALONG_M * SCALE) % PATH.length_m)[2]
        x, y = x - offset_m * np.sin(heading), y + offset_m * np.cos(heading)
        for askew, turn in ((0.6, Turn.RIGHT), (0.0, Turn.STRAIGHT), (-0.6, Turn.LEFT)):
            seen = rule(TRACK, np.array((x, y, ahead + askew * ALONG_RAD / 0.3)))
            assert seen == turn


def test_a_lesson_has_all_turns_and_each_picture_four_times() -> None:
    see = views("").simulated
    lesson = simulated([TRACK], "tracks/day", 40, see, seed=0)
    stacks = lesson.stacked([3])[0]
    assert np.array_equal(stacks[..., :3], stacks[..., -3:])
    assert np.array_equal(stacks[..., -3:], lesson.pictures[3])
    assert set(lesson.turns.tolist()) == set(Turn)
    again = simulated([TRACK], "tracks/day", 40, see, seed=0)
    assert np.array_equal(again.pictures, lesson.pictures)
    with pytest.raises(ConfigError, match="expected 1 or more"):
        simulated([TRACK], "tracks/day", 0, see, seed=0)


def test_through_a_parser_both_worlds_are_painted_in_its_colours(tmp_path: Path) -> None:
    config = ParseConfig("road", height_px=30, width_px=40)
    save_parser(Parser(config, SegNet(len(ROAD.classes))), tmp_path / "parser.pt")
    frames = np.random.default_rng(0).integers(0, 256, (2, 120, 160, 3), np.uint8)
    seen = views(str(tmp_path / "parser.pt"))
    assert np.array_equal(seen.simulated(frames), seen.real(frames))
    plain = views("")
    assert seen.real(frames).shape == plain.real(frames).shape
    assert not np.array_equal(seen.real(frames), plain.real(frames))
    even = np.unique(seen.real(frames[:1]).reshape(-1, 3), axis=0)
    assert {tuple(colour) for colour in even.tolist()} & set(ROAD.colours)


def test_the_reader_looks_at_the_newest_picture_only() -> None:
    network = RoadReader((32, 48, 3))
    stacks = np.random.default_rng(0).integers(0, 256, (6, 32, 48, 12), np.uint8)
    older = stacks.copy()
    older[..., :9] = 0
    assert np.array_equal(network.turns(stacks), network.turns(older))
