"""``python -m tools.replay RECORDING``: decides a recorded drive again and compares."""

import sys
from functools import partial
from pathlib import Path

from tyro.conf import Positional

from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy
from robot.recording.replay import replay
from trainer.cli import Command, run

SHOWN = 20
main = partial(run, Command("tools.replay:replay_command"), prog="python -m tools.replay")


def replay_command(recording: Positional[Path], model: Path | None = None) -> int:
    """Decide a recorded drive again, and compare.

    Exit status 0: every action came out as it was. 1: some did not; they are listed. 2: a file in
    which there is nothing to decide again, and why.

    Args:
        recording: an .mcap file of the robot's.
        model: another policy: what would it have done?
    """
    found = replay(recording, OnnxPolicy(model) if model else None)
    if not found.decisions:
        told = f"{recording}: expected the robot's own recording of a drive by its policy, "
        raise ContractError(f"{told}found no decision in its {found.turns} turns")
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
