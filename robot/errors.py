"""Errors a person can act on: what was expected, what came, and what would have been right."""

import difflib
from typing import Iterable


class DuckpilotError(ValueError):
    """Wrong input: a command line turns this into one line on stderr and exit status 2."""


class MapError(DuckpilotError):
    """A road map file that cannot be driven on as written."""


class ConfigError(DuckpilotError):
    """A configuration with an unknown key or a value of the wrong kind."""


class ContractError(DuckpilotError):
    """A policy, message or picture that does not keep the contract."""


class PlanError(DuckpilotError):
    """No plan: the start or the destination is off the road or cannot be reached."""


class HardwareError(RuntimeError):
    """A device that does not answer, or answers wrongly."""


def expect_between(name: str, value: float, low: float, high: float) -> None:
    """ConfigError unless ``value`` is a number from ``low`` to ``high``; NaN is none."""
    if not low <= value <= high:
        raise ConfigError(f"{name}: expected {low} to {high}, got {value}")


def expect_one_of(what: str, name: str, valid: Iterable[str]) -> None:
    """ConfigError that names the nearest choice unless ``name`` is among them."""
    if name not in valid:
        raise ConfigError(f"{what}: unknown {name!r}; {nearest(name, valid)}")


def nearest(name: str, valid: Iterable[str]) -> str:
    """The clause that ends an unknown-name message: the closest valid name, then all of them."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"{hint}valid: {', '.join(names)}"
