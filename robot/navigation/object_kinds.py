"""What objects of a map are made of, as ``objects.yaml`` says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Dict, Literal, Tuple

from robot.typed_config import from_plain, read_yaml

_FILE = Path(__file__).parent / "objects.yaml"
Rgb = Tuple[float, float, float]


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
    class_name: str = "OBJECT"  # of `sim_pybullet.classes.SemanticClass`
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
    return {name: _read_kind(kind, face) for name, (kind, face) in plain.items()}


def _read_kind(data: Dict[str, Any], face: str) -> Kind:
    named = {**colours(), "face": colours().get(face)}
    parts = [
        {**part, "rgb": named.get(str(part["rgb"]), part["rgb"])} for part in data.get("parts", [])
    ]
    return from_plain(Kind, {**data, "parts": parts})
