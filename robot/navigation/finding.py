"""``Finding``: a robot with sight finds out where it is, and drives on in its lane meanwhile.

Told nothing, it looks for its place all over the map; told roughly, it drives until it is sure.
"""

import math
from typing import Optional

import numpy as np

from robot.geometry import Pose
from robot.navigation.planner import LaneGraph
from robot.navigation.sight_fix import SightFix
from robot.navigation.whereabouts import On, WayOn, Whereabouts
from robot.vision.sight import Seen

# 95 % sure of the place, and the deviation of the wheels' scale, with which missions may begin.
SURE_M, SURE_RAD, SURE_SCALE = 0.05, 0.3, 0.02
# Of the mean over the last pictures of how far what they show lies from the map's lane, a squared
# Mahalanobis distance that gives each new picture this weight. Honest drives had 4.4 at most.
STRANGE, WEIGHT = 6.0, 0.15
UNSEEN = 8.0  # counts for a picture without a road: one second of such is strange


class Finding:
    """Of one robot, by the filter that ``fix`` corrects."""

    def __init__(self, graph: LaneGraph, fix: SightFix) -> None:
        self.learned = False  # it knows its wheels, as it drove on until it was sure
        # how little of late its pictures show the lane that the map has where it believes to be
        self.strange = 0.0
        self._graph, self._fix = graph, fix
        self._search: Optional[Whereabouts] = None  # before any place is known
        self._way = WayOn(graph)

    @property
    def sure(self) -> bool:
        """Whether place and wheels are known well."""
        fusion = self._fix.fusion
        told = (*fusion.certainty[0].tolist(), float(fusion.scale_deviations[0]))
        return self._known and all(a <= b for a, b in zip(told, (SURE_M, SURE_RAD, SURE_SCALE)))

    @property
    def sentence(self) -> str:
        """How far it has come, for a person; empty before the first picture."""
        return "" if self._search is None else self._search.sentence

    def move(self, forward_m: float, turn_rad: float, now_s: float) -> None:
        """The wheels' steps that end now; for every tick."""
        if self._search is not None:
            self._search.move(forward_m, turn_rad, now_s)

    def see(self, seen: Seen, now_s: float) -> None:
        """What a new picture shows (N = 1)."""
        (far,) = self._fix.see(seen, np.ones(1, dtype=bool), now_s).tolist()
        if self._known:
            self._search = None
            road = self._fix.views[0].at(*self._fix.fusion.poses[0].tolist())
            if road is not None and not road.in_junction:  # there no lane is marked
                far = UNSEEN if math.isnan(far) else min(far, self._fix.fusion.config.gate)
                self.strange += WEIGHT * (far - self.strange)
        elif self._search is None:
            self._search = Whereabouts(self._graph, self._fix.views[0])
        else:
            for pose, deviations in self._search.see(seen, now_s):
                self._fix.fusion.put(np.arange(1), np.array([pose]), deviations)
                self._fix.took_s[:], self.strange = now_s, 0.0

    def on(self, now_s: float, driving: bool) -> Optional[On]:
        """How it may drive on; None where it sees no road, gave up or is sure."""
        if not self._known:
            return None if self._search is None else self._search.on(now_s)
        if self.sure:
            return None
        if not driving:  # somebody may carry it
            self._way.lay(Pose(*self._fix.fusion.poses[0].tolist()))
        return self._way.on(self._fix, now_s)

    @property
    def _known(self) -> bool:
        return math.isfinite(self._fix.fusion.poses[0].sum())
