"""What robots tell each other where no localizer does: all must say where they are, and know it."""

from __future__ import annotations

import functools
import math
from typing import Any, Dict, List

import numpy as np
import pytest

from robot.geometry import Pose
from robot.link.messages import Belief, PoseMessage, Telemetry
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import Company
from robot.navigation.road_watch import RoadWatch
from tests.robot.navigation.test_neighbours import (
    HALF_DUCK_M,
    HALF_ROBOT_M,
    HERE,
    LOOP,
    NOSE_M,
    TURN_S,
    VIEW,
    WAY,
    Car,
    ways,
)
from tests.thorough import count

ABOVE = {"duck1": (1.0, 0.1), "me": (0.6, 0.1), "other": (0.8, 0.1)}


def report(name: str, pose: Pose, now_s: float, within_m: float = 0.05) -> Telemetry:
    """What a robot says that knows its place so well; its clock began at another time."""
    sent_s = 7.0 * len(name) + now_s
    known = Belief(within_m, 0.02, 0.0, 0.1, "sight")
    stamp = {"session": "a" * 16, "sequence": round(10.0 * now_s), "t_sent_s": sent_s}
    return Telemetry(name, "AUTO", pose=tuple(pose), belief=known, **stamp)


class Heard:
    """One robot that hears two others, without a localizer."""

    def __init__(self) -> None:
        self.now_s = 20.0
        self.mail: Dict[str, Telemetry] = {}
        take = {name: functools.partial(self.mail.pop, name, None) for name in ("a", "other")}
        self.neighbours = Company(LaneView(LOOP), "me", take)

    def free_m(self, **said: Telemetry) -> float:
        self.now_s += TURN_S
        self.mail.update(said)
        return self.neighbours.ahead(self.now_s, HERE, WAY).free_m

    def both(self, **of_a: Any) -> float:
        a = report("a", Pose(1.2, 0.1, 0.0), self.now_s, **of_a)
        return self.free_m(a=a, other=report("other", Pose(1.4, 1.4, 0.0), self.now_s))


def test_robots_that_tell_each_other_where_they_are_need_no_localizer() -> None:
    company = Heard()
    assert math.isnan(company.free_m()), "nobody said anything"
    assert company.both() == pytest.approx(0.6 - HALF_ROBOT_M - NOSE_M, abs=0.011)
    for _ in range(8):
        assert math.isfinite(company.free_m()), "what was said holds for a second"


def test_what_a_robot_tells_of_its_place_errs_by_five_centimetres() -> None:
    company = Heard()
    company.both()
    assert company.neighbours.ahead(company.now_s, HERE, WAY).free_sigma_m == 0.05


def test_a_localizer_tells_them_of_what_does_not_tell_of_itself() -> None:
    company = Heard()
    company.both()
    for k in range(5):
        stamp = (company.now_s, "c" * 16, k, company.now_s)
        poses = [PoseMessage(name, *place, None, 0.9, *stamp) for name, place in ABOVE.items()]
        company.neighbours.hear(poses, company.now_s)
        free_m = company.both()
    assert free_m == pytest.approx(0.4 - HALF_DUCK_M - NOSE_M, abs=0.011)


@pytest.mark.parametrize("why", ["silent", "does not know its place", "is another", "was silent"])
def test_a_robot_stands_unless_it_knows_where_each_of_the_others_is(why: str) -> None:
    company = Heard()
    if why == "was silent":
        company.both()
    for _ in range(15):
        other = report("other", Pose(1.4, 1.4, 0.0), company.now_s)
        if why == "does not know its place":
            free_m = company.both(within_m=0.13)
        elif why == "is another":
            free_m = company.free_m(other=other, a=report("b", Pose(1.2, 0.1, 0.0), company.now_s))
        else:
            free_m = company.free_m(other=other)
    assert math.isnan(free_m)
    assert math.isfinite(company.both())


@pytest.mark.parametrize(
    ("within_m", "step_m", "heard"),
    [(0.25, 0.0, True), (0.26, 0.0, False), (0.13, 0.01, False), (0.12, 0.01, True)],
)
def test_who_stands_for_five_seconds_need_not_know_its_place_so_well(
    within_m: float, step_m: float, heard: bool
) -> None:
    """Else it might stand before one that waits at a junction until it knows its place."""
    company, free_m = Heard(), []
    for k in range(70):
        a = report("a", Pose(1.2 + step_m * k, 0.1, 0.0), company.now_s, within_m=within_m)
        other = report("other", Pose(1.4, 1.4, 0.0), company.now_s)
        free_m.append(company.free_m(a=a, other=other))
    assert math.isfinite(free_m[53]) is math.isfinite(free_m[-1]) is heard
    assert math.isfinite(free_m[48]) is (within_m == 0.12), "it has not stood for so long"


def test_who_drives_off_again_must_know_its_place_at_once() -> None:
    company, free_m = Heard(), []
    for k in range(90):
        driven_m = 0.02 * max(0, k - 60)
        a = report("a", Pose(1.2 + driven_m, 0.1, 0.0), company.now_s, within_m=0.2)
        other = report("other", Pose(1.4, 1.4, 0.0), company.now_s)
        free_m.append(company.free_m(a=a, other=other))
    assert math.isfinite(free_m[60])
    assert math.isnan(free_m[75]), "a second after it was last known to stand"


def cross_in_company(seed: int) -> float:
    """As `cross`, where each tells the others its place, late, and now and then in vain."""
    rng = np.random.default_rng(seed)
    mail: Dict[str, Dict[str, Telemetry]] = {f"r{arm}": {} for arm in range(4)}
    cars = []
    for (name, box), paths in zip(mail.items(), ways()):
        cars.append(Car(name, paths[int(rng.integers(3))], float(rng.uniform(0.05, 0.3))))
        others = {n: functools.partial(box.pop, n, None) for n in mail if n != name}
        cars[-1].watch = RoadWatch(VIEW, Company(VIEW, name, others))
    on_the_way: List[List[Telemetry]] = []
    for k in range(1200):
        now_s = 100.0 + TURN_S * k
        on_the_way.append([report(car.name, car.pose, now_s) for car in cars])
        for car in cars:
            for said in on_the_way[max(k - 2, 0)]:
                if rng.random() >= 0.05:
                    mail[car.name][said.robot] = said
            car.turn(now_s)
        assert sum(car.inside for car in cars) <= 1, f"two inside with seed {seed}"
        if all(car.arc_m > 1.35 for car in cars):
            return now_s - 100.0
    raise AssertionError(f"somebody waits for ever with seed {seed}")


@pytest.mark.slow
def test_four_robots_that_only_hear_each_other_pass_one_after_the_other() -> None:
    assert max(cross_in_company(seed) for seed in range(count(2, 20))) < 60.0
