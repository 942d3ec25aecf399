"""What real photographs say of some policies, kept part by part, and one page of tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from robot.errors import ConfigError
from robot.output import write_png, write_text
from robot.typed_config import from_plain, to_plain
from sim_pybullet.look import NOMINAL
from trainer.config import choose
from trainer.experiments.photographs.agreement import SiteAgreement, compare_lines
from trainer.experiments.photographs.attention import (
    SiteAttention,
    attention_by_site,
    attention_sheet,
    labelled_frames,
)
from trainer.experiments.tables import markdown, number
from trainer.run import read_json, write_json

Row = TypeVar("Row", SiteAttention, SiteAgreement)


@dataclass(frozen=True)
class Photographs:
    """What was asked for; parts of the answer that were made for other policies are made anew."""

    data: Path  # holds the folders of the sites
    out: Path
    policies: tuple[tuple[str, Path], ...]  # names and ONNX files
    only: tuple[str, ...]  # parts


def named(given: Sequence[str]) -> tuple[tuple[str, Path], ...]:
    """(name, file) of each ``name=model.onnx``.

    Raises:
        ConfigError: another form, no file, or a name twice.
    """
    found: dict[str, Path] = {}
    for text in given:
        name, _, path = text.partition("=")
        if not path or name in found or not Path(path).is_file():
            raise ConfigError(f"--policy: expected name=model.onnx, each name once, got {text!r}")
        found[name] = Path(path)
    return tuple(found.items())


def look_at_photographs(asked: Photographs) -> str:
    """Do what is not done yet; the tables.

    Raises:
        DuckpilotError: a photograph is missing, or a policy is none.
    """
    policies = [f"{name} {path} {path.stat().st_size}" for name, path in asked.policies]
    parts: dict[str, Callable[[], str]] = {
        "attention": lambda: (
            "## Lines that policies look at\n\n"
            + attention_table(_kept(asked, "attention", policies, SiteAttention, _look))
        ),
        "agreement": lambda: (
            "## The yellow line\n\n"
            + agreement_table(_kept(asked, "agreement", [], SiteAgreement, _detect))
        ),
    }
    chosen = [choose("only", name, parts) for name in asked.only]
    if not asked.data.is_dir():
        raise ConfigError(f"{asked.data}: expected the folder of the sites, got no such folder")
    asked.out.mkdir(parents=True, exist_ok=True)
    text = "\n".join(part() for part in chosen)
    write_text(asked.out / "tables.md", text)
    return text


def _kept(
    asked: Photographs,
    name: str,
    inputs: list[Any],
    kind: type[Row],
    make: Callable[[Photographs], list[Row]],
) -> list[Row]:
    """The rows of a part, from its file if that answers the same question."""
    path = asked.out / f"{name}.json"
    if path.exists():
        found = read_json(path)
        if found["inputs"] == inputs:
            return [from_plain(kind, _with_nan(row), str(path)) for row in found["rows"]]
    rows = make(asked)
    write_json(path, {"inputs": inputs, "rows": [to_plain(row) for row in rows]})
    return rows


def _with_nan(row: dict[str, Any]) -> dict[str, Any]:
    return {key: math.nan if value is None else value for key, value in row.items()}


def _look(asked: Photographs) -> list[SiteAttention]:
    frames = labelled_frames(asked.data)
    write_png(asked.out / "attention.png", attention_sheet(asked.policies, frames))
    rows = [attention_by_site(name, path, frames) for name, path in asked.policies]
    return [row for each in rows for row in each]


def _detect(asked: Photographs) -> list[SiteAgreement]:
    return compare_lines(asked.data, NOMINAL.rig())


def attention_table(rows: Sequence[SiteAttention]) -> str:
    """In Markdown."""
    head = ("policy", "site", "photographs", "white", "yellow", "white, asked", "yellow, asked")
    cells = [
        (
            row.policy,
            row.site,
            str(row.photographs),
            *(
                number(share, 1)
                for share in (row.white, row.yellow, row.influence_white, row.influence_yellow)
            ),
        )
        for row in rows
    ]
    return markdown(head, cells)


def agreement_table(rows: Sequence[SiteAgreement]) -> str:
    """In Markdown, with a sum."""
    found = ("site", "photographs", "judged", "agrees", "", "missed", "invented", "wrong side")
    head = (*found, "offset", "heading")
    cells = []
    for row in rows:
        failures = (row.missed, row.invented, row.wrong_side)
        cells.append(
            (
                row.site,
                str(row.photographs),
                str(row.judged),
                str(row.agrees),
                f"{row.agrees / max(row.judged, 1):.0%}",
                *(str(len(files)) for files in failures),
                f"{number(100 * row.offset_mae_m, 1)} cm",
                f"{number(math.degrees(row.heading_mae_rad), 0)}°",
            )
        )
    judged, agrees = (sum(getattr(row, name) for row in rows) for name in ("judged", "agrees"))
    photographs = str(sum(row.photographs for row in rows))
    total = ("**all**", photographs, str(judged), str(agrees), f"**{agrees / judged:.1%}**")
    return markdown(head, [*cells, (*total, *[""] * 5)])
