"""What objects of a map are made of, as ``assets/objects.yaml`` says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from robot.typed_config import from_plain, read_yaml
from sim_pybullet.look import Rgb

_FILE = Path(__file__).parents[1] / "assets" / "objects.yaml"


@dataclass(frozen=True)
class Part:
    """One solid of an object, lengths in units of the object's height."""

    rgb: Rgb
    size: tuple[float, float, float]
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
    parts: tuple[Part, ...] = ()


@lru_cache(maxsize=1)
def colours() -> dict[str, Rgb]:
    """The colours that a map may give an object, by name."""
    return {name: (r, g, b) for name, (r, g, b) in read_yaml(_FILE)["colours"].items()}


@lru_cache(maxsize=1)
def kinds() -> dict[str, Kind]:
    """What maps call objects, the signs by their faces."""
    data = read_yaml(_FILE)
    plain = {name: (kind, "") for name, kind in data["kinds"].items()}
    plain |= {f"sign_{name}": (data["sign"], face) for name, face in data["sign_faces"].items()}
    return {name: _read_kind(kind, face) for name, (kind, face) in plain.items()}


def _read_kind(data: dict[str, Any], face: str) -> Kind:
    named = {**colours(), "face": colours().get(face)}
    parts = [
        {**part, "rgb": named.get(str(part["rgb"]), part["rgb"])} for part in data.get("parts", [])
    ]
    return from_plain(Kind, {**data, "parts": parts})
