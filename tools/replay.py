"""``python -m tools.replay RECORDING``: decides a recorded drive again and compares."""

import sys
from functools import partial
from pathlib import Path

from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy
from robot.recording.replay import replay
from trainer.cli import Command, run

SHOWN = 20
COMMAND = Command("tools.commands:replay_command", "decide a recorded drive again, and compare")
main = partial(run, COMMAND, prog="python -m tools.replay")


def decide_again(recording: Path, model: Path | None) -> int:
    """0: nothing differs; 1: something does; ContractError: nothing was decided in it."""
    found = replay(recording, OnnxPolicy(model) if model else None)
    if not found.decisions:
        raise ContractError(
            f"{recording}: expected the robot's own recording of a drive by its policy, "
            f"found no decision in its {found.turns} turns"
        )
    for difference in found.differences[:SHOWN]:
        print(f"turn {difference.number} at {difference.time_s:.2f} s: {difference.sentence}")
    if len(found.differences) > SHOWN:
        print(f"… and {len(found.differences) - SHOWN} more")
    how = "bit for bit" if found.exact else f"values within {found.worst:.1e}"
    close = f", {found.close} too close to call" if found.close else ""
    print(
        f"{recording.name}: {found.decisions} decisions of {found.turns} turns replayed "
        f"({how}), {len(found.differences)} differ{close}"
    )
    return 1 if found.differences else 0


if __name__ == "__main__":
    sys.exit(main())
