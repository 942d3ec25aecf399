"""``docs/faults.md``: what the robot did about every fault."""

import re
from collections.abc import Sequence
from pathlib import Path

from robot.output import write_bytes
from tools.faults.case import STOP_BUDGET_S, TABLE, Outcome


def write_report(outcomes: list[Outcome], path: Path, unmet: Sequence[str] = ()) -> None:
    """Write the table, whole or not at all; ``unmet`` are faults without an outcome yet."""
    passed = f"{sum(not outcome.problem for outcome in outcomes)} of {len(outcomes)}"
    lines = [TABLE["page"].rstrip().format(1000.0 * STOP_BUDGET_S) + f" {passed} passed.\n"]
    if unmet:
        lines.append(f"Not met in this run: {', '.join(unmet)}.\n")
    for family in dict.fromkeys(outcome.family for outcome in outcomes):
        lines.append(f"\n## {family[0].upper()}{family[1:]}\n\n")
        lines.append("| fault | limit [ms] | last step [ms] | shown |\n|---|---|---|---|\n")
        above = ""
        for outcome in outcomes:
            if outcome.family == family:
                shown = _shown(outcome)
                lines.append(_row(outcome, "″" if shown == above else shown))
                above = shown
    write_bytes(path, "".join(lines).encode("utf-8"))


def _shown(outcome: Outcome) -> str:
    """What went wrong, if anything, then state and reason, without ages and advice."""
    reason = re.sub(r"^silent .* terminal |^motors: motor thread: ", "", outcome.reason)
    reason = re.sub(r" is \d+ ms old, more", " is older", reason)
    reason = re.split(r"[;(]|, got \[|: i2c: ", reason)[0]
    state = outcome.state if " by a person" in reason else f"{outcome.state}: {reason}"
    return f"**{outcome.problem}** {state}".replace("**** ", "").strip().replace("|", "\\|")


def _row(outcome: Outcome, shown: str) -> str:
    limit = stopped = "–"
    if outcome.stopped_s is not None:
        limit = f"{1000 * outcome.threshold_s:.0f}"
        stopped = f"{1000 * outcome.stopped_s:.0f}"
    fault = ": ".join(filter(None, (outcome.name, outcome.what)))
    return f"| {fault} | {limit} | {stopped} | {shown} |\n"
