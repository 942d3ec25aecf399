"""In which look a mission is driven: one site for some missions, then another."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_pybullet.look import Look
from sim_pybullet.randomise import LOOKS_DIR, load_look_sampler, load_looks, looks_of

MISSIONS_PER_SITE = 5  # then the bench begins anew: a floor cannot change below a robot


@dataclass(frozen=True)
class Site:
    """One draw of a look; all that was drawn belongs to the same place."""

    name: str  # of the look's file, as ``reality/night``
    look: Look
    until: int | None  # how many missions are over when the robot leaves it, if ever


def sites_of(source: str, seed: int) -> Callable[[int], Site]:
    """Where the robot is after so many missions.

    A look without distributions is the only site. Otherwise every ``MISSIONS_PER_SITE`` missions
    see another draw; of a folder, such as ``reality``, the files take turns in an order drawn by
    the seed, so that none is left out. ConfigError: no such look, or one that does not fit.
    """
    files, looks = looks_of(source), load_looks(source)
    if not callable(looks) and len(looks) == 1:
        return lambda _: Site(_name(files[0]), looks[0], None)
    samplers = [load_look_sampler(file) for file in files]
    order = np.random.default_rng(seed).permutation(len(files))

    def site(missions: int) -> Site:
        stretch = missions // MISSIONS_PER_SITE
        k = int(order[stretch % len(files)])
        look = samplers[k](np.random.default_rng((seed, stretch)))
        return Site(_name(files[k]), look, (stretch + 1) * MISSIONS_PER_SITE)

    return site


def _name(file: Path) -> str:
    inside = LOOKS_DIR in file.parents
    return str(file.relative_to(LOOKS_DIR).with_suffix("")) if inside else str(file)
