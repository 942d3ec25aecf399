"""Table 1 of paper B: who foretells what a person did on a recorded drive."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.experiments.driving_pictures import See, Stacks, load_stacks, split_by_time
from trainer.experiments.racing_policy import SteeringPolicy
from trainer.experiments.records import Drive, Turn, load_drive
from trainer.experiments.supervised import LikePolicies, teach_turns
from trainer.experiments.table1 import Accuracy, Table, chance, compare, shares
from trainer.experiments.taught_rule import RoadReader, lesson
from trainer.experiments.turning import Turning, goes_on_turning, shifts_px, turning
from trainer.presets import preset

DECISION_S = 0.1  # between a policy's pictures
Named = tuple[str, int, SteeringPolicy]


def foretell(
    data: Path,
    out: Path,
    policies: Sequence[Named],
    looks: Sequence[str],
    rate_hz: float,
    seeds: int,
    steps: int,
    taught_steps: int,
    console: Console,
) -> Table:
    """Everyone's accuracy on the test part of a drive.

    Args:
        data: the drive, see `trainer.experiments.records`.
        out: a folder that exists, for the supervised networks.
        policies: names, seeds and policies.
        looks: where networks are taught in simulation, see `trainer.experiments.taught_rule`.
        rate_hz: pictures of the drive in a second.
        seeds: how many networks of each kind.
        steps: updates of each supervised one.
        taught_steps: updates of each that is taught in simulation.
        console: hears of progress.

    Raises:
        ConfigError: the drive cannot be read, or is none to learn or to test on.
    """
    drive = load_drive(data)
    if drive.skipped:
        console.print(f"{data}: skipped {drive.skipped} broken records", markup=False)
    every = pictures_apart(rate_hz)
    image = preset("track", "ppo", "fast").image
    training, test = split_by_time(load_stacks(drive, image, every))
    for part, name in ((training, "first 60 %"), (test, "rest")):
        _refuse_one_turn(part, name, drive)
    moved_px = shifts_px(drive)
    of_angles = turning(drive.steering_deg, moved_px)
    rows = chance(test.turns, int(np.bincount(training.turns).argmax()))
    rows += _going_on(drive, moved_px, training, test)
    for name, seed, policy in policies:
        seen = split_by_time(load_stacks(drive, policy.image, every, policy.see))[1].stacked()
        rows.append(compare(name, seed, test.turns, policy.turns(seen)))
    for look in looks:
        in_simulation, see = lesson(look)
        moments = split_by_time(load_stacks(drive, image, every, see))[1]
        newest = moments._replace(every=0).stacked()
        for seed in range(seeds):
            checkpoint = out / f"taught_{_stem(look)}_{seed}_{taught_steps}.pt"
            network = teach_turns(
                in_simulation, taught_steps, seed, checkpoint, console, RoadReader
            )
            rows.append(compare(f"taught in {look}", seed, test.turns, network.turns(newest)))
    for kind, (pictures, how) in _supervised(policies, image).items():
        part, rest = split_by_time(load_stacks(drive, pictures, every, how))
        for seed in range(seeds):
            checkpoint = out / f"{_stem(kind)}_{seed}_{steps}.pt"
            network = teach_turns(part, steps, seed, checkpoint, console, LikePolicies)
            rows.append(compare(kind, seed, rest.turns, network.turns(rest.stacked())))
    counts = len(training.last), len(test.last)
    parts = shares(training.turns), shares(test.turns)
    return Table(str(data), *counts, *parts, of_angles, tuple(rows))


def _supervised(
    policies: Sequence[Named], image: ImageSpec
) -> dict[str, tuple[ImageSpec, See | None]]:
    """What supervised networks see: the task's pictures; and for each translator that a policy sees
    the drive through, pictures of that size, and what it makes of them."""
    kinds: dict[str, tuple[ImageSpec, See | None]] = {"supervised": (image, None)}
    through: dict[str, str] = {}  # the first policy of each translator
    for name, _, policy in policies:
        if policy.translator and through.setdefault(policy.translator, name) == name:
            kinds.setdefault(f"supervised, size of {name}", (policy.image, None))
            kinds.setdefault(f"supervised, as {name} sees", (policy.image, policy.see))
    return kinds


def pictures_apart(rate_hz: float) -> int:
    """Of how many pictures one is taken, so that a stack's are a decision apart.

    Raises:
        ConfigError: no such rate.
    """
    if not rate_hz > 0.0:
        raise ConfigError(f"rate: expected pictures in a second, above 0, got {rate_hz}")
    return max(1, round(DECISION_S * rate_hz))


def _stem(look: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", look)


def _refuse_one_turn(part: Stacks, name: str, drive: Drive) -> None:
    done = {Turn(turn).name.lower() for turn in part.turns.tolist()}
    if len(done) < 2:
        low, high = drive.steering_deg.min(), drive.steering_deg.max()
        raise ConfigError(
            f"drive: expected turns of two kinds at least in its {name}, got only "
            f"{', '.join(done)}; the angles go from {low:.3g} to {high:.3g} degrees: another part "
            "of the drive, or other units?"
        )


def _going_on(drive: Drive, moved_px: np.ndarray, training: Stacks, test: Stacks) -> list[Accuracy]:
    """Who goes on turning as the pictures turn, the scale of it from the training part."""
    end = int(training.last[-1])
    scale = turning(drive.steering_deg[: end + 1], moved_px[:end])
    if scale.px_per_deg <= 0.0:
        return []
    guessed = goes_on_turning(moved_px, scale.px_per_deg, test.reach)[test.last]
    return [compare("goes on turning", 0, test.turns, guessed)]


def words(found: Turning) -> str:
    """One line for a person."""
    return (
        f"angles and pictures agree with a correlation of {found.correlation:.2f}, "
        f"{found.late_frames} pictures after the angle"
    )
