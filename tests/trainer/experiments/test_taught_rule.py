"""The rule that networks are taught in simulation."""

import numpy as np
import pytest

from robot.errors import ConfigError
from sim_pybullet.racing.racing_cars import ALONG_M, ALONG_RAD
from sim_pybullet.racing.track import SCALE, centre_line, load_track
from trainer.experiments.records import Turn
from trainer.experiments.taught_rule import RoadReader, rule, simulated

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
    lesson = simulated([TRACK], "tracks/day", 40, None, seed=0)
    stacks = lesson.stacked([3])[0]
    assert np.array_equal(stacks[..., :3], stacks[..., -3:])
    assert np.array_equal(stacks[..., -3:], lesson.pictures[3])
    assert set(lesson.turns.tolist()) == set(Turn)
    again = simulated([TRACK], "tracks/day", 40, None, seed=0)
    assert np.array_equal(again.pictures, lesson.pictures)
    with pytest.raises(ConfigError, match="expected 1 or more"):
        simulated([TRACK], "tracks/day", 0, None, seed=0)


def test_the_reader_looks_at_the_newest_picture_only() -> None:
    network = RoadReader((32, 48, 3))
    stacks = np.random.default_rng(0).integers(0, 256, (6, 32, 48, 12), np.uint8)
    older = stacks.copy()
    older[..., :9] = 0
    assert np.array_equal(network.turns(stacks), network.turns(older))
