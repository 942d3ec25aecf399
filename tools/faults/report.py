"""``docs/faults.md``: what the robot did about every fault."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from robot.output import write_bytes
from tools.faults.case import STOP_BUDGET_S, Outcome

HEAD = f"""# Faults

Each row is a fault, met by robot, localizer and monitor as they are, as processes of their own, on
the loop bench ([loop](loop.md)), while the robot drives a mission at 0.3 m/s. *Counts after* is the
age at which the fault is one; *last step* is when a motor last stepped, from the fault on: at most
{1000 * STOP_BUDGET_S:.0f} ms after the former. Then the fault is mended, and nothing may move and
nobody may be armed by that. *Shown* is what the monitor's page says (or the robot's terminal, where
there is no page). A dash: the robot must drive on, or did not drive.

Made by `python -m tools.faults --model MODEL --report docs/faults.md`, lock-step: times are the \
robot's own clock's. """


def write_report(outcomes: list[Outcome], path: Path, unmet: Sequence[str] = ()) -> None:
    """Write the table, whole or not at all; ``unmet`` are faults without an outcome yet."""
    passed = f"{sum(outcome.passed for outcome in outcomes)} of {len(outcomes)}"
    lines = [HEAD, f"{passed} as they must be.\n"]
    if unmet:
        lines.append(f"Not met in this run: {', '.join(unmet)}.\n")
    for family in dict.fromkeys(outcome.family for outcome in outcomes):
        lines.append(f"\n## {family[0].upper()}{family[1:]}\n\n")
        lines.append("| fault | | counts after [ms] | last step [ms] | shown | |\n")
        lines.append("|---|---|---|---|---|---|\n")
        lines += [_row(outcome) for outcome in outcomes if outcome.family == family]
    write_bytes(path, "".join(lines).encode("utf-8"))


def _row(outcome: Outcome) -> str:
    if math.isnan(outcome.stopped_s):
        counts = stopped = "–"
    else:
        counts = f"{1000 * outcome.threshold_s:.0f}"
        stopped = f"{1000 * outcome.stopped_s:.0f}"
    shown = f"{outcome.state}: {outcome.reason}".replace("|", "\\|")
    mark = "ok" if outcome.passed else f"**{outcome.problem}**".replace("|", "\\|")
    return f"| {outcome.name} | {outcome.what} | {counts} | {stopped} | {shown} | {mark} |\n"
