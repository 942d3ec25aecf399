"""Things that stand on a road map: duckies, signs, trees. Read from either style of map file.

What each is made of says ``objects.yaml``; what reaches into a lane closes it.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Dict, FrozenSet, List, Literal, NamedTuple, Optional, Set, Tuple

import numpy as np

from robot.errors import MapError, nearest
from robot.geometry import Pose, wrap_angle
from robot.navigation.road_map import RoadMap, number, numbers, refuse_misspelt_keys
from robot.typed_config import from_plain, read_yaml

HALF_ROBOT_M = 0.09  # what a robot needs to each side of the middle of its lane
_SPACING_M = 0.05
_FILE = Path(__file__).parent / "objects.yaml"
Rgb = Tuple[float, float, float]
_FORMS = ("pos", "pose", "place", "attach")
_KEYS = (*_FORMS, "kind", "rotate", "height", "scale", "static", "optional", "color", "tag")
# How far a sign stands from the corner of its tile, along the kerb and away from it [m]; the slots
# count counter-clockwise round the corner (duckietown-world's map format).
_ALONG_M, _AWAY_M = 0.09, 0.035
_SLOTS_M: Tuple[Tuple[float, float], ...] = (
    (_ALONG_M, _AWAY_M), (_AWAY_M, _ALONG_M), (-_AWAY_M, _ALONG_M), (-_ALONG_M, _AWAY_M),
    (-_ALONG_M, -_AWAY_M), (-_AWAY_M, -_ALONG_M), (_AWAY_M, -_ALONG_M), (_ALONG_M, -_AWAY_M),
)  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One solid of an object, lengths in units of the object's height."""

    rgb: Rgb
    size: Tuple[float, float, float]
    forward: float = 0.0
    left: float = 0.0
    base: float = 0.0
    shape: Literal["box", "cylinder"] = "box"
    collides: bool = True
    own_colour: bool = False  # takes the colour that the map gives the object


@dataclass(frozen=True)
class Kind:
    """One kind of object."""

    height_m: float  # natural
    class_name: str = "OBJECT"  # of `sim_pybullet.scene.SemanticClass`
    parts: Tuple[Part, ...] = ()


@lru_cache(maxsize=1)
def colours() -> Dict[str, Rgb]:
    """The colours that a map may give an object, by name."""
    return {name: (r, g, b) for name, (r, g, b) in read_yaml(_FILE)["colours"].items()}


@lru_cache(maxsize=1)
def kinds() -> Dict[str, Kind]:
    """What maps call objects, the signs by their faces."""
    data = read_yaml(_FILE)
    plain = {name: (kind, "") for name, kind in data["kinds"].items()}
    for name, face in data["sign_faces"].items():
        plain[f"sign_{name}"] = (data["sign"], face)
    found = {}
    for name, (kind, face) in plain.items():
        named = {**colours(), "face": colours().get(face)}
        parts = [{**p, "rgb": named.get(str(p["rgb"]), p["rgb"])} for p in kind.get("parts", [])]
        found[name] = from_plain(Kind, {**kind, "parts": parts})
    return found


@dataclass(frozen=True)
class MapObject:
    """One object in the world frame; its front looks along ``heading_rad``."""

    name: str
    kind: str
    x_m: float
    y_m: float
    heading_rad: float
    height_m: float
    static: bool = True  # others move by themselves
    optional: bool = False  # may be left out of an episode
    color: Optional[str] = None


def objects_of(road_map: RoadMap) -> Tuple[MapObject, ...]:
    """The objects of a map; MapError names the object and what its entry should say."""
    entries, where = road_map.objects, f"{road_map.name}: objects"
    if entries is None:
        return ()
    if isinstance(entries, list):
        entries = {f"object {i}": entry for i, entry in enumerate(entries)}
    if not isinstance(entries, dict):
        raise MapError(f"{where}: expected objects as a mapping or a list, got {entries!r}")
    return tuple(_read_object(str(n), e, road_map, f"{where}: {n}") for n, e in entries.items())


def _read_object(name: str, entry: Any, grid: RoadMap, where: str) -> MapObject:
    if not isinstance(entry, dict):
        raise MapError(f"{where}: expected a mapping with kind and a position, got {entry!r}")
    refuse_misspelt_keys(entry, _KEYS, where)
    kind = entry.get("kind")
    if not isinstance(kind, str) or kind not in kinds():
        raise MapError(f"{where}: unknown kind {kind!r}; {nearest(str(kind), kinds())}")
    x_m, y_m, heading_rad = _place(entry, grid, where)
    if "height" in entry and "scale" in entry:
        raise MapError(f"{where}: expected height or scale, got both; remove one of them")
    if "height" in entry:
        height_m = number(entry["height"], f"{where}: height")
    else:
        height_m = kinds()[kind].height_m * number(entry.get("scale", 1.0), f"{where}: scale")
    if not 0.0 <= height_m <= 10.0 or (height_m == 0.0 and kind != "floor_tag"):
        raise MapError(f"{where}: expected a height above 0 m, at most 10 m, got {height_m}")
    flags = [entry.get("static", True), entry.get("optional", False)]
    if not all(isinstance(flag, bool) for flag in flags):
        raise MapError(f"{where}: static, optional: expected true or false, got {flags}")
    color = None if entry.get("color") is None else str(entry["color"])
    heading_rad = float(wrap_angle(heading_rad))
    return MapObject(name, kind, x_m, y_m, heading_rad, height_m, flags[0], flags[1], color)


def _place(entry: Dict[str, Any], grid: RoadMap, where: str) -> Pose:
    forms = [form for form in _FORMS if form in entry]
    if not forms or (len(forms) > 1 and forms != ["pose", "attach"]):
        told = f"{where}: expected one position (pos and rotate, place, pose or attach), "
        raise MapError(f"{told}got {' and '.join(forms) or 'none'}")
    rotate_rad = math.radians(number(entry.get("rotate", 0.0), f"{where}: rotate"))
    tile_m = grid.tile_size_m
    if "pos" in entry:  # tiles east and south of the north-west corner
        east, south = numbers(entry["pos"], 2, f"{where}: pos")
        return Pose(east * tile_m, (grid.rows - south) * tile_m, rotate_rad)
    base, label, relative = Pose(0.0, 0.0, 0.0), "pose", entry.get("pose")
    if "place" in entry:  # metres from the centre of a tile
        column, row_north = _tile_of(entry["place"], grid, f"{where}: place")
        base = Pose((column + 0.5) * tile_m, (row_north + 0.5) * tile_m, 0.0)
        label, relative = "place.relative", entry["place"].get("relative")
    elif "attach" in entry:
        base = _slot_of(entry["attach"], rotate_rad, grid, f"{where}: attach")
    x_m, y_m, turn_rad = _transform(relative, f"{where}: {label}")
    x_m, y_m = base.to_world(np.array([x_m, y_m])).tolist()
    return Pose(x_m, y_m, base.heading_rad + turn_rad)


def _slot_of(data: Any, rotate_rad: float, grid: RoadMap, where: str) -> Pose:
    """One of eight places round the south-west corner of a tile."""
    column, row_north = _tile_of(data, grid, where)
    slot, last = data.get("slot"), len(_SLOTS_M) - 1
    if str(slot) not in map(str, range(last + 1)):
        raise MapError(f"{where}.slot: expected 0 to {last}, got {slot!r}")
    dx_m, dy_m = _SLOTS_M[int(slot)]
    return Pose(column * grid.tile_size_m + dx_m, row_north * grid.tile_size_m + dy_m, rotate_rad)


def _tile_of(data: Any, grid: RoadMap, where: str) -> Tuple[int, int]:
    """(column, rows north of the south row); the line beyond the last tile has corners too."""
    if not isinstance(data, dict):
        raise MapError(f"{where}: expected a mapping with tile: [column, row], got {data!r}")
    column, row_north = numbers(data.get("tile"), 2, f"{where}.tile")
    inside = 0 <= column <= grid.columns and 0 <= row_north <= grid.rows
    if not inside or column != int(column) or row_north != int(row_north):
        told = f"{where}.tile: expected whole numbers, column 0 to {grid.columns} and row 0 to "
        raise MapError(f"{told}{grid.rows} counted from the south-west, got {data['tile']!r}")
    return int(column), int(row_north)


def _transform(data: Any, where: str) -> Pose:
    """A ``~SE2Transform``: p [m] and theta_deg (or theta [rad]); what is absent is zero."""
    content = data.get("~SE2Transform", data) if isinstance(data, dict) else data
    if content is None:
        return Pose(0.0, 0.0, 0.0)
    if not isinstance(content, dict):
        raise MapError(f"{where}: expected ~SE2Transform with p and theta_deg, got {data!r}")
    refuse_misspelt_keys(content, ("p", "theta_deg", "theta"), where)
    x_m, y_m = numbers(content.get("p", [0.0, 0.0]), 2, f"{where}: p")
    if "theta_deg" in content:
        return Pose(x_m, y_m, math.radians(number(content["theta_deg"], f"{where}: theta_deg")))
    return Pose(x_m, y_m, number(content.get("theta", 0.0), f"{where}: theta"))


class Blocked(NamedTuple):
    """What is in the way on a map."""

    points_m: np.ndarray  # (K, 2) of things, in the lanes
    lanes: FrozenSet[int]  # indices into the map's lanes


def blocked(road_map: RoadMap, every: bool = False) -> Blocked:
    """What its objects that stand there in every episode, or all, leave no room for, or forbid."""
    points: List[Tuple[float, float]] = []
    lanes: Set[int] = set()
    things = [o for o in objects_of(road_map) if every or (o.static and not o.optional)]
    for thing in things if road_map.lanes else []:
        if thing.kind in _FORBIDDEN:
            lanes.update(_forbidden(thing, road_map))
        outline = footprint(thing)
        far_m = np.hypot(*(outline - (thing.x_m, thing.y_m)).T).max(initial=0.0) + HALF_ROBOT_M
        if road_map.lane_index.near(thing.x_m, thing.y_m).distance_m.min() > far_m:
            continue
        for x_m, y_m in outline.tolist():
            near = road_map.lane_index.near(x_m, y_m).distance_m < HALF_ROBOT_M
            if near.any():
                points.append((x_m, y_m))
                lanes.update(np.flatnonzero(near).tolist())
    return Blocked(np.array(points).reshape(-1, 2), frozenset(lanes))


# Turns that signs forbid to who faces them: from the lanes that begin before them.
_FORBIDDEN = {
    "sign_do_not_enter": ("left", "straight", "right"),
    "sign_no_left_turn": ("left",),
    "sign_no_right_turn": ("right",),
    "sign_oneway_right": ("left",),
    "sign_oneway_left": ("right",),
}


def _forbidden(sign: MapObject, road_map: RoadMap) -> Set[int]:
    """The lanes that one may not take past a sign, of those that begin nearest to its face."""
    ways = np.array([lane.control_points_m for lane in road_map.lanes])
    (x, y), (ends_x, ends_y) = (ways[:, 1] - ways[:, 0]).T, (ways[:, 3] - ways[:, 2]).T
    headings = np.arctan2(y, x)
    away_m = np.hypot(*(ways[:, 0] - (sign.x_m, sign.y_m)).T)
    away_m[np.cos(headings - sign.heading_rad) > -math.sqrt(0.5)] = math.inf  # do not face it
    turned = np.asarray(wrap_angle(np.arctan2(ends_y, ends_x) - headings))
    turns = np.where(turned > 0.5, "left", np.where(turned < -0.5, "right", "straight"))
    near = away_m < min(road_map.tile_size_m, away_m.min()) + 1e-6
    return set(np.flatnonzero(near & np.isin(turns, _FORBIDDEN[sign.kind])).tolist())


def footprint(thing: MapObject) -> np.ndarray:
    """(K, 2) points in the world, every 5 cm of what a robot can run into."""
    place = Pose(thing.x_m, thing.y_m, thing.heading_rad)
    hard = [_points(part, thing.height_m) for part in kinds()[thing.kind].parts if part.collides]
    return place.to_world(np.concatenate([np.zeros((0, 2)), *hard]))


def _points(part: Part, height_m: float) -> np.ndarray:
    length, width = part.size[0], part.size[0 if part.shape == "cylinder" else 1]
    steps = [max(2, math.ceil(side * height_m / _SPACING_M) + 1) for side in (length, width)]
    x, y = np.meshgrid(
        np.linspace(-length / 2, length / 2, steps[0]), np.linspace(-width / 2, width / 2, steps[1])
    )
    if part.shape == "cylinder":
        inside = np.maximum(np.hypot(x, y) / (length / 2), 1.0)
        x, y = x / inside, y / inside
    return height_m * np.stack((x + part.forward, y + part.left), axis=-1).reshape(-1, 2)
