"""The proof of a taught policy: how it drives in its twin, where it fails, and what it foretells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

from robot.contract import Proof
from robot.inference.policy import OnnxPolicy
from robot.navigation.road_map import RoadMap
from sim_pybullet.episodes import Looks
from sim_pybullet.look import Look
from sim_pybullet.tasks.spec import find_task
from trainer.judging.evaluate import ridden, wilson_low
from trainer.judging.rides import Ride
from trainer.twin.examples import Examples, foretold

FIRST = 50_000  # number of the first drive of a proof
DOUBT = 0.003  # greatest chance that failures differ so by luck, of each of ``_WORDS``
# What is said of a look whose value is low or high among those that fail.
_WORDS = {
    "sensor.exposure": ("in the dark", "in bright light"),
    "light.ambient": ("in the dark", "in bright light"),
    "ground.shadows": ("without shadows", "in deep shadows"),
    "ground.wear": ("on new paint", "on worn lines"),
    "ground.gaps": ("on whole lines", "where lines end"),
    "ground.patchiness": ("on an even floor", "on a patchy floor"),
    "light.gloss": ("on a dull floor", "on a glossy floor"),
    "sensor.blur_px": ("with sharp pictures", "with blurred pictures"),
    "sensor.shutter_s": ("with sharp pictures", "with pictures that smear in turns"),
    "sensor.noise": ("with clean pictures", "with noisy pictures"),
    "timing.camera_delay_s": ("with early pictures", "with late pictures"),
    "drive.delay_s": ("with quick motors", "with late motors"),
    "drive.trim": ("where it pulls to the right", "where it pulls to the left"),
    "camera.pitch_rad": ("with the camera tilted up", "with the camera tilted down"),
}


def prove(
    model: Path,
    road_map: RoadMap,
    twin: Looks,
    held_out: Examples,
    drives: int,
    finished: Callable[[Any], None],
) -> Proof:
    """Drive a policy in its twin, and ask it about recordings that it did not learn from."""
    policy = OnnxPolicy(model)
    task = policy.contract.task
    rings = bool(find_task(task).lanes)
    numbers, lane = range(FIRST, FIRST + drives), "both" if rings else None
    done: list[tuple[bool, Ride]] = []
    for drive, ride in ridden(policy, task, [road_map], twin, numbers, lane=lane):
        done.append((drive.success, ride))
        finished(drive)
    succeeded = sum(success for success, _ in done)
    low, high = wilson_low(succeeded, drives), 1.0 - wilson_low(drives - succeeded, drives)
    same, steered = told(policy, held_out)
    what = "two-lap drives" if rings else "missions"
    share = 100.0 * succeeded / drives
    sentence = f"{share:.0f} % of {drives} {what} in its twin (95 %: {low:.0%} to {high:.0%})"
    fails = where_failed(road_map, done)
    if fails:
        sentence += f"; fails most {fails}"
    if steered:
        sentence += f"; steers as the person did in {same} of {steered} held-out moments"
    return Proof(drives, succeeded, low, high, steered, same, sentence, fails)


def where_failed(road_map: RoadMap, rides: Sequence[tuple[bool, Ride]]) -> str:
    """The part of the map where most drives failed, and in which looks, in words; "" if none did.

    ``rides``: of each whether it succeeded.
    """
    failed = [ride for success, ride in rides if not success]
    if not failed:
        return ""
    places = Counter(_place(road_map, *ride.poses[-1][:2].tolist()) for ride in failed)
    place, count = places.most_common(1)[0]
    when = _look(failed, [ride for success, ride in rides if success])
    return f"{place} ({count} of {len(failed)}){when}"


def _place(road_map: RoadMap, x_m: float, y_m: float) -> str:
    """As "on the bend in the north-east": the nearest tile of road."""
    size = road_map.tile_size_m
    middles = [
        ((tile.column + 0.5) * size, (road_map.rows - tile.row - 0.5) * size, tile)
        for tile in road_map.road_tiles
    ]
    x_m, y_m, tile = min(middles, key=lambda at: np.hypot(at[0] - x_m, at[1] - y_m))
    kind = "straight" if tile.kind == "straight" else "bend"
    kind = "junction" if tile.is_junction else kind
    north, east = y_m / road_map.height_m - 0.5, x_m / road_map.width_m - 0.5
    words = [
        low if share < -1 / 6 else high if share > 1 / 6 else ""
        for share, low, high in ((north, "south", "north"), (east, "west", "east"))
    ]
    return f"on the {kind} in the {'-'.join(filter(None, words)) or 'middle'}"


def _look(failed: Sequence[Ride], others: Sequence[Ride]) -> str:
    """What is most unlike in the looks of those that failed, if luck does not explain it."""
    found = [(DOUBT, "")]
    if failed and others:
        for name, words in _WORDS.items():
            ours, theirs = ([_value(ride.look, name) for ride in part] for part in (failed, others))
            if np.ptp([*ours, *theirs]) > 0.0:
                luck = float(mannwhitneyu(ours, theirs).pvalue)
                found.append((luck, f", {words[int(np.median(ours) > np.median(theirs))]}"))
    return min(found)[1]


def _value(look: Look, name: str) -> float:
    group, leaf = name.split(".")
    return float(getattr(getattr(look, group), leaf))


def told(policy: OnnxPolicy, seen: Examples) -> tuple[int, int]:
    """See `foretold`."""
    if not len(seen.actions):
        return 0, 0
    rows = range(len(seen.actions))
    paths = [None if seen.paths is None else seen.paths[k : k + 1] for k in rows]
    chosen = [policy.act(seen.images[k : k + 1], paths[k])[0] for k in rows]
    return foretold(np.array(chosen), seen, policy.contract)
