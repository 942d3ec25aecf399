"""What a file is that cannot be replayed, in one true sentence."""

from __future__ import annotations

from typing import Set

from robot.recording import topics
from robot.recording.about import MODEL
from robot.recording.reader import (
    PathLike,
    entries,
    read_about,
    read_attachment,
    turn_of,
)

SHOWN_TOPICS = 5


def why_not(path: PathLike, with_model: bool = False) -> str:
    """Why nothing in a recording can be decided again; "" where something can.

    Args:
        path: an MCAP file, whole or cut off.
        with_model: whether a policy was named, so that none need lie in the recording.

    Raises:
        ConfigError: no such file, or no MCAP.
        ContractError: turns of another version.
    """
    found: Set[str] = set()
    turns = 0
    for entry in entries(path):
        found.add(entry.topic)
        if entry.topic == topics.TURN.name:
            turns += 1
            if turn_of(path, entry).decided:
                break
    else:
        return _without_decisions(path, found, turns)
    if with_model or read_attachment(path, MODEL) is not None:
        return ""
    return "it holds decisions, but not the policy that took them; name its file with --model"


def _without_decisions(path: PathLike, found: Set[str], turns: int) -> str:
    if turns:
        return f"the policy decided in none of its {turns} turns: the robot was never driven by it"
    if topics.TELEMETRY.name in found:
        return (
            "it is a monitor's recording, with reports and JPEG pictures as they came over the "
            "link, but without the robot's turns and exact frames, which a replay decides anew; "
            "take the robot's own recording of this drive (docs/recording.md), or play this one "
            "on the monitor's page, under Drives"
        )
    if read_about(path) and not found:
        return "it ends before the robot's first turn"
    told = ", ".join(sorted(found)[:SHOWN_TOPICS]) or "none"
    return f"it is an MCAP file, but no recording of a robot of ours; its topics: {told}"
