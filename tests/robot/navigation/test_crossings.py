"""Who stands at which junction, and who is inside: by poses, on maps that are drawn here."""

from __future__ import annotations

from typing import Dict, Optional, Tuple

import numpy as np
import pytest

from robot.geometry import Pose
from robot.link.messages import PoseMessage
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import AHEAD_M, Crossings, Neighbours, Traveller
from robot.safety.road_ahead import Junction
from tests.robot.navigation.test_lane_view import CROSS, EASTWARDS_M, TILE, map_of

Place = Tuple[float, float, Optional[float]]
AT_LINE: Place = (TILE - 0.066 - 0.05, EASTWARDS_M, 0.0)  # its nose 5 cm before the line
INSIDE: Place = (1.5 * TILE, EASTWARDS_M, 0.0)


def junction_of_me(seen: Dict[str, Place], believed: Place = AT_LINE) -> Optional[Junction]:
    """What a robot that believes to be there is told of its junction."""
    neighbours = Neighbours(LaneView(CROSS), "me")
    for k in range(3):
        now_s = 20.0 + 0.1 * k
        stamp = (7.0 + now_s, "a" * 16, k, 7.0 + now_s)
        poses = [PoseMessage(name, *place, 0.9, *stamp) for name, place in seen.items()]
        neighbours.hear(poses, now_s)
    x_m, y_m, heading_rad = believed
    way_m = np.stack((x_m + AHEAD_M, y_m + 0.0 * AHEAD_M), axis=1)
    return neighbours.ahead(now_s, Pose(x_m, y_m, heading_rad or 0.0), way_m).junction


def test_who_was_never_seen_with_a_heading_is_at_no_junction() -> None:
    other = (2.0 * TILE + 0.066 + 0.05, 1.7 * TILE)  # it comes from the east
    for heading_rad, count in ((np.pi, 1), (None, 0)):
        junction = junction_of_me({"me": AT_LINE, "other": (*other, heading_rad)})
        assert junction is not None
        assert len(junction.others) == count
    along = (AT_LINE[0], AT_LINE[1], None)  # where any robot without a heading seems to head east
    junction = junction_of_me({"me": (*other, np.pi), "other": along}, (*other, np.pi))
    assert junction is not None
    assert junction.others == ()


@pytest.mark.parametrize(("believed", "inside"), [(AT_LINE, False), (INSIDE, True)])
def test_who_is_seen_inside_is_so_only_where_it_believes_that_too(
    believed: Place, inside: bool
) -> None:
    junction = junction_of_me({"me": INSIDE}, believed)
    assert junction is not None
    assert junction.own.inside is inside


def test_robots_at_two_junctions_have_nothing_to_do_with_each_other() -> None:
    road = map_of("straight/E 4way straight/E 4way straight/E")
    first = Pose(TILE - 0.1, 0.3 * TILE, 0.0)
    second = Pose(3.0 * TILE - 0.1, 0.3 * TILE, 0.0)
    within = Pose(3.5 * TILE, 0.3 * TILE, 0.0)
    told = Crossings(road).update(
        9.0,
        {
            "a": Traveller(first, 0.0, 0.04),
            "b": Traveller(second, 0.0, 0.04),
            "c": Traveller(within, 0.2, 1.0),
        },
    )
    assert told["a"].others == ()
    assert [other.name for other in told["b"].others] == ["c"]


def test_who_drives_from_one_junction_into_the_next_arrives_there_anew() -> None:
    crossings, arrived_s = Crossings(map_of("4way 4way")), []
    for now_s, x_m in ((5.0, 0.5 * TILE), (6.0, 0.6 * TILE), (9.0, 1.6 * TILE)):
        robots = {"a": Traveller(Pose(x_m, 0.3 * TILE, 0.0), 0.2, 1.0)}
        arrived_s.append(crossings.update(now_s, robots)["a"].own.arrived_s)
    assert arrived_s == [5.0, 5.0, 9.0]
