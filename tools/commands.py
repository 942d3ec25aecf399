"""The small commands and their options; imports nothing heavy."""

from pathlib import Path

from tyro.conf import Positional


def demo_command(out: Path = Path("runs/demo"), seed: int = 0, seconds: float = 75.0) -> int:
    """Train, export, evaluate and drive through virtual hardware, before your eyes.

    Every stage is a command that a person can run alone; the demo prints each one, then runs it. A
    demo that was killed goes on with the stage it was in.

    Args:
        out: folder of the demo.
        seed: of everything random.
        seconds: of training.
    """
    from tools.demo import show_all

    return show_all(out, seed, seconds)


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
