"""Who may learn from what: every map and look belongs to one part, written in ``division.yaml``.

Policies learn on the first part and are chosen on the second. The third judges them, and nothing is
ever chosen by it: whoever would train or choose there is refused. A map is known by its roads, not
by its name: a copy of a judging map, turned or mirrored or with other tiles, is that map.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from robot.errors import ConfigError
from robot.navigation.road_map import RoadMap, load_map, shipped_maps
from robot.typed_config import load_yaml
from sim_pybullet.randomise import is_reality, load_look_sampler, looks_of
from sim_pybullet.scenery.objects import Place

_SIDES = "SENW"  # in this order each is a quarter turn counter-clockwise from the one before
_MIRRORED = "SWNE"


@dataclass(frozen=True)
class Parts:
    """Names of one kind of thing, by what they are for."""

    training: tuple[str, ...] = ()
    choosing: tuple[str, ...] = ()
    judging: tuple[str, ...] = ()


@dataclass(frozen=True)
class Division:
    """What ``division.yaml`` holds."""

    maps: Parts
    looks: Parts
    pictures: Parts  # photographs and recorded drives that people took; none comes with this
    sites: Parts  # of annotated photographs, trainer/sight/photographs.yaml
    outside: tuple[str, ...]  # judging maps that do not come with this: NAME FINGERPRINT


@lru_cache(maxsize=1)
def division() -> Division:
    """The shipped file."""
    return load_yaml(Division, Path(__file__).with_name("division.yaml"))


def fingerprint(road_map: RoadMap) -> str:
    """Twelve digits that maps share whose roads are the same, however they lie on the grid.

    Where roads leave each tile counts; the size of the tiles, objects, kinds of floor, empty rows
    and columns around the roads, quarter turns and mirror images do not.
    """
    grid = np.array([["".join(t.road_sides) for t in row] for row in road_map.tiles], object)
    rows, columns = (np.flatnonzero((grid != "").any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return ""
    grid = grid[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    both = (grid, _SIDES), (grid[:, ::-1], _MIRRORED)
    text = min(_written(np.rot90(one, k), sides, k) for one, sides in both for k in range(4))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def part_of(road_map: RoadMap) -> str | None:
    """To which of `Parts` a map belongs, by its roads; None for one that is nobody's."""
    return _known().get(fingerprint(road_map), (None, ""))[0]


def maps_named(names: Iterable[str]) -> tuple[str, ...]:
    """These names, a folder of shipped maps (``judging/rings``) replaced by the maps in it."""
    found: list[str] = []
    for name in names:
        inner = [each for each in shipped_maps() if each.startswith(f"{name.rstrip('/')}/")]
        found += inner or [name]
    return tuple(found)


def refuse_judging_maps(places: Sequence[Place], use: str = "train") -> None:
    """ConfigError if one of these maps is kept for judging; race tracks belong to no part."""
    for place in places:
        if isinstance(place, RoadMap) and part_of(place) == "judging":
            name = _known()[fingerprint(place)][1]
            raise ConfigError(
                f"map: expected one to {use} on, got {place.name}, whose roads are those of "
                f"{name}, kept for judging policies (trainer/division.yaml); train on "
                f"{_some(division().maps.training)}, choose on {_some(division().maps.choosing)}"
            )


def refuse_like_named(places: Sequence[Place]) -> None:
    """ConfigError if maps that differ have one name, by which drives on them are told apart."""
    last = {place.name: place for place in places}
    if like := [place.name for place in places if last[place.name] != place]:
        raise ConfigError(f"map: expected maps of different names, got two {like[0]}; rename one")


def refuse_judging_look(look: str, use: str = "train") -> None:
    """ConfigError if this look is kept for judging, or there is none of that name.

    They are known by their name, and a copy by its painter, which no other look has.
    """
    files = looks_of(look)
    painters = {load_look_sampler(f)(np.random.default_rng(0)).ground.painter for f in files}
    if is_reality(look) or "strips" in painters:
        raise ConfigError(
            f"look: expected one to {use} in, got {look!r}: those in reality/, and copies of them, "
            f"are kept for judging policies; {use} in {_some(division().looks.training)}, and "
            "evaluate in this one when the policy is chosen"
        )


@lru_cache(maxsize=1)
def _known() -> dict[str, tuple[str, str]]:
    """The part and the name of every map that belongs to one, by fingerprint."""
    maps = division().maps
    outside = {digits: ("judging", name) for name, digits in map(str.split, division().outside)}
    shipped = ((part, name) for part, names in vars(maps).items() for name in names)
    return {fingerprint(load_map(name)): (part, name) for part, name in shipped} | outside


def _written(grid: np.ndarray, sides: str, quarter_turns: int) -> str:
    turned = str.maketrans(sides, _SIDES[quarter_turns:] + _SIDES[:quarter_turns])
    return "/".join(",".join("".join(sorted(t.translate(turned))) for t in row) for row in grid)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (" and others" if len(names) > 4 else "")
