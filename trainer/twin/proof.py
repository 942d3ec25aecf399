"""The proof of a taught policy: how it drives in its twin, where it fails, what it foretells."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

from robot.contract import Proof
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import RoadMap
from sim_pybullet.episodes import EPISODES_OF_A_WORLD, Looks
from sim_pybullet.tasks.spec import find_task
from trainer.judging.blocks import ROBOTS
from trainer.judging.evaluate import Ride, ridden
from trainer.judging.intervals import share
from trainer.twin.examples import Examples, foretold

FIRST, APART = 50_000, EPISODES_OF_A_WORLD + 1  # numbers of a proof's drives: no floor is shared
DOUBT = 0.003  # greatest chance that failures differ so by luck, of each of ``_WORDS``
# What is said where failures have more of something than successes, or less (-1).
_WORDS = (
    ("sensor", "exposure", -1, "in the dark"),
    ("sensor", "exposure", 1, "in bright light"),
    ("sensor", "noise", 1, "with noisy pictures"),
    ("ground", "shadows", 1, "in deep shadows"),
    ("ground", "wear", 1, "on worn lines"),
    ("ground", "patchiness", 1, "on a patchy floor"),
    ("light", "gloss", 1, "on a glossy floor"),
)


def prove(
    model: Path,
    twin: tuple[RoadMap, Looks] | None,
    held_out: Examples,
    drives: int,
    finished: Callable[[Any], None],
) -> Proof:
    """Drive a policy in its twin, if any, and ask it about what it did not learn of recordings."""
    policy = OnnxPolicy(model)
    same = steered = 0
    if len(held_out.shares):
        actions = policy.values(held_out.images, held_out.paths).argmax(axis=1)
        same, steered = foretold(actions, held_out, policy.contract)
    foretells = f"steers as the person did in {same} of {steered} held-out moments"
    if twin is None:
        return Proof(0, 0, 0.0, 1.0, steered, same, f"never driven; {foretells}")
    (road_map, looks), task = twin, policy.contract.task
    rings = bool(find_task(task).lanes)
    numbers, lane = range(FIRST, FIRST + APART * drives, APART), "both" if rings else None
    done: list[tuple[bool, Ride]] = []
    for some in (numbers[k : k + ROBOTS] for k in range(0, drives, ROBOTS)):
        for drive, ride in ridden(policy, task, [road_map], looks, some, lane=lane):
            done.append((drive.success, ride))
            finished(drive)
    succeeded = sum(success for success, _ in done)
    value, low, high = share(succeeded, drives)
    what = "two-lap drives" if rings else "missions"
    within = f"(95 %: {low:.0%} to {high:.0%})"
    sentence = f"{100.0 * value:.0f} % of {drives} {what} in its twin {within}"
    fails = where_failed(road_map, done)
    if fails:
        sentence += f"; fails {fails}"
    if steered:
        sentence += f"; {foretells}"
    return Proof(drives, succeeded, low, high, steered, same, sentence, fails)


def where_failed(road_map: RoadMap, rides: Sequence[tuple[bool, Ride]]) -> str:
    """In words where most failed of rides, each with its success, and in which looks; or ""."""
    failed = [ride for success, ride in rides if not success]
    if not failed:
        return ""
    places = Counter(_place(road_map, *ride.poses[-1][:2].tolist()) for ride in failed)
    place, count = places.most_common(1)[0]
    if count == 1 < len(failed):
        return f"in {len(failed)} different places"
    when = _look(failed, [ride for success, ride in rides if success])
    return f"most {place} ({count} of {len(failed)}){when}"


def _place(road_map: RoadMap, x_m: float, y_m: float) -> str:
    """As "on the bend in the north-east": of the nearest tile of road."""
    size_m = road_map.tile_size_m
    at = np.array([(t.column + 0.5, road_map.rows - t.row - 0.5) for t in road_map.road_tiles])
    near = int(np.hypot(*(size_m * at - (x_m, y_m)).T).argmin())
    tile, (east, north) = road_map.road_tiles[near], at[near]
    kind = "junction" if tile.is_junction else "straight" if tile.kind == "straight" else "bend"
    thirds = int(3.0 * north / road_map.rows), int(3.0 * east / road_map.columns)
    words = (("south", "", "north")[thirds[0]], ("west", "", "east")[thirds[1]])
    return f"on the {kind} in the {'-'.join(filter(None, words)) or 'middle'}"


def _look(failed: Sequence[Ride], others: Sequence[Ride]) -> str:
    """What is most unlike in the looks of those that failed, if luck does not explain it."""
    found = [(DOUBT, "")]
    for group, leaf, sign, words in _WORDS if others else ():
        ours, theirs = (
            [sign * getattr(getattr(ride.look, group), leaf) for ride in part]
            for part in (failed, others)
        )
        luck = float(mannwhitneyu(ours, theirs, alternative="greater").pvalue)
        found.append((luck, f", {words}"))
    return min(found)[1]
