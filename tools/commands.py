"""The command of replay and its options; imports nothing heavy."""

from pathlib import Path

from tyro.conf import Positional


def replay_command(recording: Positional[Path], model: Path | None = None) -> int:
    """Decide a recorded drive again, and compare.

    Exit status 0: every action came out as it was. 1: some did not; they are listed. 2: a file in
    which there is nothing to decide again, and why.

    Args:
        recording: an .mcap file of the robot's.
        model: another policy: what would it have done?
    """
    from tools.replay import decide_again

    return decide_again(recording, model)
