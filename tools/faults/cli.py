"""The command of the faults, and its options; imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class FaultsOptions:
    """Which faults, and who meets them."""

    model: Path  # An ONNX policy for navigation.
    sight: Path | None = None  # ONNX; it alone tells the place, without a localizer.
    family: tyro.conf.UseAppendAction[tuple[str, ...]] = ()  # Only this one; once for each.
    case: tyro.conf.UseAppendAction[tuple[str, ...]] = ()  # Only this one, by name; once for each.
    seed: int = 0  # Of everything random.
    json: Path | None = None  # Write the outcomes; goes on from there.
    report: Path | None = None  # Write the table, such as docs/faults.md.


def faults_command(options: Annotated[FaultsOptions, tyro.conf.arg(name="")]) -> int:
    """Every fault in the loop with the real processes; a table.

    In lock-step: times are those of the robot's own clock, without what a slow computer adds.
    """
    from tools.faults.meet import meet

    return meet(options)
