"""Reads the centre line of a TORCS track (``.xml``; Debian's package ``torcs-data`` has many).

Understood as TORCS' own reader does (src/modules/track/track4.cpp): segments ``str``, ``lft`` and
``rgt`` of length ``lg``, or of ``radius``, ``end radius`` and ``arc``; a turn whose radius changes
is a chain of arcs, one per profile step. Heights, banking and surfaces are left out.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

from robot.errors import ConfigError, nearest
from sim_pybullet.racing.track import Arc, Segment, Straight, Track, close

INSTALLED = Path("/usr/share/games/torcs/tracks")  # by Debian's package torcs-data
_TO_SI = {"m": 1.0, "ft": 0.3048, "feet": 0.3048, "deg": math.pi / 180.0, "rad": 1.0}
_SIDES = {"lft": 1.0, "rgt": -1.0}
_LISTS = ("Track Segments", "segments")  # of version 4 and of version 3
_DEFAULT_VERGE_M = 4.0
_MOST_VERGE_M = 8.0  # what lies farther out is no grass but run-off, pits and landscape


def installed_tracks() -> dict[str, Path]:
    """The tracks of an installed TORCS by name, such as ``aalborg``."""
    return {path.stem: path for path in sorted(INSTALLED.glob("*/*/*.xml"))}


def read_torcs(path: Path) -> Track:
    """A TORCS track; gaps of a few metres that some files leave are closed.

    Raises:
        ConfigError: not a TORCS track, or a segment of unknown type.
        MapError: see `sim_pybullet.racing.track.close`.
    """
    return close(parse_torcs(path.read_text(encoding="latin-1"), str(path)))


def parse_torcs(text: str, where: str) -> Track:
    """The track in the text of a file as it is written, closed or not; errors as `read_torcs`."""
    # The document type names files of TORCS that describe surfaces and objects: not needed here.
    text = re.sub(r"<!DOCTYPE[^\[>]*(\[.*?\])?\s*>", "", text, flags=re.DOTALL)
    text = re.sub(r"&(?!(?:amp|lt|gt|quot|apos|#\d+);)[\w.-]+;", "", text)
    try:
        root = ElementTree.fromstring(text.strip())
    except ElementTree.ParseError as error:
        raise ConfigError(f"{where}: expected a TORCS track, got: {error}") from error
    main = root.find("section[@name='Main Track']")
    lists = [] if main is None else [main.find(f"section[@name='{name}']") for name in _LISTS]
    found = [part for parts in lists if parts is not None for part in parts.iterfind("section")]
    if main is None or not found:
        raise ConfigError(
            f"{where}: expected a TORCS track with sections 'Main Track' and 'Track Segments'; "
            "choose the file of a track, as tracks/road/aalborg/aalborg.xml"
        )
    step_m = _number(main, "profil steps length", 0.0)
    segments = tuple(part for section in found for part in _segments(section, step_m, where))
    sides = [main.find(f"section[@name='{side} Side']") for side in ("Left", "Right")]
    verges = [_number(side, "width", _DEFAULT_VERGE_M) for side in sides if side is not None]
    verge_m = min([_MOST_VERGE_M, *(width for width in verges if width > 0.0)])
    verge_m = verge_m if any(width > 0.0 for width in verges) else _DEFAULT_VERGE_M
    return Track(Path(where).stem, segments, _number(main, "width", 10.0), verge_m)


def _segments(section: ElementTree.Element, step_m: float, where: str) -> list[Segment]:
    kind = _text(section, "type")
    if kind == "str":
        return [Straight(_number(section, "lg", 0.0))]
    if kind not in _SIDES:
        raise ConfigError(
            f"{where}: segment {section.get('name')!r} of unknown type {kind!r}; "
            f"{nearest(kind, ('str', *_SIDES))}"
        )
    angle_rad = _number(section, "arc", 0.0)
    radius_m = _number(section, "radius", 0.0)
    end_m = _number(section, "end radius", radius_m)
    if end_m == radius_m:
        return [Arc(radius_m, _SIDES[kind] * math.degrees(angle_rad))]
    steps = _steps(section, 0.5 * (radius_m + end_m) * angle_rad, step_m)
    radii_m = [radius_m + (end_m - radius_m) * k / (steps - 1) for k in range(steps)]
    share = angle_rad / sum(1.0 / radius for radius in radii_m)  # every step is as long
    return [Arc(r, _SIDES[kind] * math.degrees(share / r)) for r in radii_m]


def _steps(section: ElementTree.Element, length_m: float, step_m: float) -> int:
    """How many arcs make a turn whose radius changes; at least its first and its last."""
    step_m = _number(section, "profil steps length", step_m)
    steps = length_m / step_m + 1.0 if step_m > 0.0 else _number(section, "profil steps", 1.0)
    return max(2, int(steps))


def _number(section: ElementTree.Element, name: str, default: float) -> float:
    """An attribute in SI units."""
    found = section.find(f"attnum[@name='{name}']")
    if found is None:
        return default
    return float(found.get("val", default)) * _TO_SI.get(found.get("unit", ""), 1.0)


def _text(section: ElementTree.Element, name: str) -> str:
    found = section.find(f"attstr[@name='{name}']")
    return "" if found is None else found.get("val", "")
