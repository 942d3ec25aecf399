"""What is looked at before any command begins: its numbers, and where its results go."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from robot.errors import expect_between
from robot.output import expect_folder, expect_writable

# Of every command that has an option of this name.
LIMITS: Mapping[str, tuple[float, float]] = {
    "seed": (0, 2**31 - 1),
    "seeds": (1, 10_000),
    "workers": (1, 1_000),
    "steps": (1, 10**12),
    "ppo_steps": (1, 10**12),
    "lane_steps": (1, 10**12),
    "translator_steps": (1, 10**12),
    "episodes": (1, 10_000_000),
    "lap_drives": (1, 1_000_000),
    "judgings": (1, 1_000_000),
    "frames": (1, 10_000_000),
    "every": (1, 10_000_000),
    "batch": (1, 100_000),
    "structure": (0.0, 1e6),
    "rate_hz": (0.1, 1e4),
}
OUT_IS_FILE = ("export", "parse export")


def check(command: str, options: Mapping[str, Any]) -> None:
    """Make sure that a command's options by name can be, and its results be written.

    ConfigError for a number out of its range, an output that cannot be or is an input.
    """
    every = dict(_flat(options))
    for name, value in every.items():
        if name in LIMITS and isinstance(value, (int, float)):
            expect_between(name, value, *LIMITS[name])
    out, files = every.get("out"), [every.get("json")]
    if out is not None and command in OUT_IS_FILE:
        files.append(out)
    elif out is not None:
        expect_folder(out)
    names = ("model", "parser", "pictures", "images", "source", "contract")
    inputs = (every[name] for name in names if every.get(name))
    expect_writable(*files, inputs=[Path(path) for path in inputs])


def _flat(options: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in options.items():
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            yield from _flat({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
        else:
            yield name, value
