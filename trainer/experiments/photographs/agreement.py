"""How often `trainer.judging.yellow_line` says of a photograph what a person says of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.lens import CameraRig
from trainer.experiments.photographs.lines import (
    Drawn,
    DrawnLine,
    drawn_line,
    frames_of,
    load_lines,
)
from trainer.judging.yellow_dashes import DEFAULT, floor_table
from trainer.judging.yellow_line import YellowLine, detect_yellow_line

AGREES, MISSED, INVENTED, WRONG_SIDE, NOT_JUDGED = (
    "agrees",
    "missed",
    "invented",
    "wrong side",
    "not judged",
)
# Lines between these distances may be found or not; the detector's range lies between them.
SURELY_NEAR_M, SURELY_FAR_M = 0.9 * DEFAULT.range_m, 1.1 * DEFAULT.range_m
TOO_CLOSE_M = 0.01  # to the line: no side can be told


@dataclass(frozen=True)
class SiteAgreement:
    """One place."""

    site: str
    photographs: int
    judged: int
    agrees: int
    missed: tuple[str, ...]  # a person sees a line, the detector none
    invented: tuple[str, ...]  # the other way round
    wrong_side: tuple[str, ...]
    offset_mae_m: float  # where both see a line: of the offset from it
    heading_mae_rad: float


def verdict(found: YellowLine, drawn: Sequence[DrawnLine]) -> str:
    """Of a detection, from the lines that a person drew on the same photograph."""
    nearest_m = min((each.nearest_m for each in drawn), default=np.inf)
    if SURELY_NEAR_M <= nearest_m < SURELY_FAR_M:
        return NOT_JUDGED
    near = nearest_m < SURELY_NEAR_M
    if found.found != near:
        return MISSED if near else INVENTED
    if not near:
        return AGREES
    sides_m = [each.line.offset_m for each in drawn if each.nearest_m < SURELY_FAR_M]
    if min(abs(side_m) for side_m in sides_m) < TOO_CLOSE_M:
        return NOT_JUDGED
    same = any((side_m > 0.0) == found.crossed for side_m in sides_m)
    return AGREES if same else WRONG_SIDE


def compare_lines(photographs: Path, rig: CameraRig) -> list[SiteAgreement]:
    """Every site's agreement.

    Args:
        photographs: the folder that holds the sites' folders.
        rig: lens and mounting that are assumed for all of them.

    Raises:
        ConfigError: a photograph is missing.
    """
    lines = load_lines()
    reference_m = floor_table(rig, FRAME_WIDTH_PX, FRAME_HEIGHT_PX, DEFAULT.range_m).reference_m
    rows = []
    for site in lines.sites:
        verdicts: dict[str, list[str]] = {}
        errors = []
        for drawn, frame in frames_of(site, photographs):
            found = detect_yellow_line(frame, rig)
            people = _lines(drawn, lines.size, rig, reference_m)
            said = verdict(found, people)
            verdicts.setdefault(said, []).append(drawn.file)
            if said == AGREES and found.found:
                errors.append(_error(found, people))
        rows.append(_row(site.name, verdicts, np.array(errors).reshape(-1, 2)))
    return rows


def _lines(
    drawn: Drawn, size: tuple[int, int], rig: CameraRig, reference_m: float
) -> list[DrawnLine]:
    found = [drawn_line(points, size, rig, reference_m) for points in drawn.yellow]
    return [each for each in found if each is not None]


def _error(found: YellowLine, people: Sequence[DrawnLine]) -> tuple[float, float]:
    """Offset [m] and heading [rad] from the line that fits best."""
    errors = [
        (abs(found.offset_m - p.line.offset_m), abs(found.heading_rad - p.line.heading_rad))
        for p in people
    ]
    return min(errors)


def _row(name: str, verdicts: dict[str, list[str]], errors: np.ndarray) -> SiteAgreement:
    counts = Counter({said: len(files) for said, files in verdicts.items()})
    judged = counts.total() - counts[NOT_JUDGED]
    offset_m, heading_rad = errors.mean(axis=0) if len(errors) else (np.nan, np.nan)
    missed, invented, wrong = (
        tuple(verdicts.get(said, ())) for said in (MISSED, INVENTED, WRONG_SIDE)
    )
    return SiteAgreement(
        name,
        counts.total(),
        judged,
        counts[AGREES],
        missed,
        invented,
        wrong,
        float(offset_m),
        float(heading_rad),
    )
