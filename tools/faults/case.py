"""A fault as a row of ``cases.yaml``, and what came of it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot.typed_config import read_yaml

if TYPE_CHECKING:
    from tools.faults.stage import Stage

Act = Callable[["Stage"], Any]
TABLE = read_yaml(Path(__file__).with_name("cases.yaml"))
FAMILIES = tuple(name for name in TABLE if name not in ("page", "met"))
STOP_BUDGET_S = 0.25  # from the moment that a fault counts as one, until the last step


def nothing(_: "Stage") -> None:
    """Neither breaks nor mends."""


@dataclass(frozen=True)
class Case:
    """One fault, met while the robot drives a mission (unless ``moving`` is False)."""

    family: str
    name: str  # short, unique in its family
    what: str  # the fault in words
    inject: Act  # breaks something; what it gives may be a context, whose end mends it
    threshold_s: float = 0.0  # age at which it counts; the wheels stop ``STOP_BUDGET_S`` later
    by_sight_s: float = 0.0  # the same where sight alone tells the place, if it differs
    says: str = ""  # what the reason shown must contain, a regular expression
    states: tuple[str, ...] = ("FAULT",)  # to be shown, any of them; none: it must drive on
    before: Act = nothing  # prepares the bench, before the robot drives off
    approach: Act = nothing  # lets it drive on to where the fault comes
    moving: bool = True
    silent: bool = False  # the page must say that the robot is silent
    check: tuple[Act, ...] = ()  # last looks before mending; each tells what is wrong, or ""
    poses: bool = False  # of the localizer are what it is about: none by sight alone
    drives_again: bool = False  # mended, and armed by a person, without a new start


def case_of(family: str, row: dict[str, Any], known: dict[str, Any]) -> Case:
    """The case of a row, whose functions are among those ``known`` by name."""
    (inject,) = row.keys() - {field.name for field in fields(Case)}
    told = {name: value for name, value in row.items() if name != inject}
    told["inject"] = _act(known, inject, row[inject])
    told |= {name: known[row[name]] for name in {"before", "approach"} & row.keys()}
    told["check"] = tuple(_act(known, *check) for check in row.get("check", {}).items())
    told["states"] = tuple(row.get("states", Case.states))
    return Case(family, **told)


def _act(known: dict[str, Any], name: str, told: Any) -> Act:
    """A function of a stage, or with a dot a method of its parts, with what a row tells besides."""
    part = lambda stage, *several: attrgetter(name)(stage)(*several)  # noqa: E731
    function = part if "." in name else known[name]
    if isinstance(told, dict):
        return lambda stage: function(stage, **told)
    several = [] if told is None else told if isinstance(told, list) else [told]
    return lambda stage: function(stage, *several)


@contextmanager
def sets(stage: "Stage", part: str, **values: object) -> Iterator[None]:
    """Change attributes of a part of the stage."""
    of = attrgetter(part)(stage)
    before = {name: getattr(of, name) for name in values}
    vars(of).update(values)
    yield
    vars(of).update(before)


@dataclass(frozen=True)
class Outcome:
    """What a case came to; times in seconds of the bench's clock, None where none had to stop."""

    family: str
    name: str
    what: str
    stopped_s: float | None = None  # from the fault to the last step of a motor
    threshold_s: float = 0.0
    state: str = ""
    reason: str = ""
    problem: str = ""  # none when all was as it must be
