import math

import numpy as np

from robot.navigation.way_seen import CLEAR, WaySeen, free_way_seen
from robot.vision.sight import COLUMNS, COLUMNS_BEFORE, Seen, as_seen


def picture(thing: float, free_m: float = 0.3) -> Seen:
    row = dict.fromkeys(COLUMNS, 0.0)
    row.update(thing=thing, free_m=free_m, sd_free_m=0.02)
    return as_seen(np.array([list(row.values())]))


def test_a_file_of_before_tells_of_nobody() -> None:
    way = free_way_seen(as_seen(np.full((1, len(COLUMNS_BEFORE)), 0.5), COLUMNS_BEFORE))
    assert way.free_m == math.inf


def test_what_is_seen_comes_nearer_as_the_wheels_turn() -> None:
    way = WaySeen()
    assert way.ahead(1.0).free_m == math.inf
    way.see(picture(0.9), 1.0)
    assert (way.ahead(1.1).free_m, way.ahead(1.1).free_sigma_m) == (0.3 - (1.1 - 1.0), 0.02)


def test_it_is_forgotten_only_after_several_pictures_without_it() -> None:
    way = WaySeen()
    way.see(picture(0.9), 0.0)
    for _ in range(CLEAR - 1):
        way.see(picture(0.1), 0.0)
        assert way.ahead(0.0).free_m == 0.3
    way.see(picture(0.1), 0.0)
    assert way.ahead(0.0).free_m == math.inf


def test_the_newest_picture_counts_whatever_was_before() -> None:
    way = WaySeen()
    way.see(picture(0.9, 0.3), 0.0)
    way.see(picture(0.9, 0.2), 0.05)
    assert way.ahead(0.05).free_m == 0.2
