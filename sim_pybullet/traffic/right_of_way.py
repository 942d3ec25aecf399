"""``RightOfWay``: one car at a time in a junction, who stood first goes first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from sim_pybullet.traffic.streets import NO_JUNCTION

NEAR_M = 0.35  # from axle to junction: who is so near asks
STOP_M = 0.17  # where a car stands: the red line and a few centimetres before it
STAND_S = 0.5
_STANDS_MPS = 0.03
_EXIT_M = 0.7  # must be free behind the line, so that nobody stands in a junction
_TIGHT_M = 0.35  # is enough for who has been patient, or a queue all round a block never moves
_PATIENCE_S = 6.0  # who has the way and does not go loses it


class Approach(NamedTuple):
    """How A cars of G groups come to junctions; numbers of junctions, or `NO_JUNCTION`."""

    next: np.ndarray  # (G, A) int, the one ahead
    line_m: np.ndarray  # (G, A) to its border, from the axle
    inside: np.ndarray  # (G, A) int, the one it is in
    free_m: np.ndarray  # (G, A)
    red: np.ndarray  # (G, A) bool
    closing_mps: np.ndarray  # (G, A) how fast ``free_m`` shrinks


class RightOfWay:
    """Who may enter the junctions of G groups."""

    def __init__(self, groups: int, cars: int, junctions: int) -> None:
        self._holder = np.full((groups, junctions), -1)
        self._held_s = np.zeros((groups, junctions))
        self._stood_s = np.zeros((groups, cars))

    def begin(self, group: int) -> None:
        """Forget what was."""
        self._holder[group], self._held_s[group], self._stood_s[group] = -1, 0.0, 0.0

    def ask(self, approach: Approach, speeds_mps: np.ndarray) -> np.ndarray:
        """(G, A) bool: who may go on into the next junction, one decision later."""
        at_line = approach.line_m < NEAR_M
        stands = at_line & (speeds_mps < _STANDS_MPS)
        self._stood_s = np.where(at_line, self._stood_s + CONTROL_DT_S * stands, 0.0)
        for group, junction in np.argwhere(self._holder >= 0).tolist():
            self._release(group, junction, approach)
        may = approach.next == NO_JUNCTION
        asking = np.argwhere(at_line)
        for group, car in asking[np.argsort(-self._stood_s[at_line], kind="stable")].tolist():
            may[group, car] = self._grant(group, car, approach)
        return may

    def _release(self, group: int, junction: int, approach: Approach) -> None:
        holder = self._holder[group, junction]
        inside = approach.inside[group, holder] == junction
        self._held_s[group, junction] += CONTROL_DT_S * (not inside)
        gone = not inside and approach.next[group, holder] != junction
        if gone or self._held_s[group, junction] > _PATIENCE_S:
            self._holder[group, junction] = -1

    def _grant(self, group: int, car: int, approach: Approach) -> bool:
        junction = approach.next[group, car]
        holder = self._holder[group, junction]
        if holder == car:
            return True
        line_m, free_m = approach.line_m[group, car], approach.free_m[group, car]
        stood_s = self._stood_s[group, car]
        exit_m = _EXIT_M if stood_s < _PATIENCE_S else _TIGHT_M
        ready = stood_s >= STAND_S and free_m > line_m + exit_m
        taken = holder >= 0 or (approach.inside[group] == junction).any()
        if taken or not ready or approach.red[group, car]:
            return False
        self._holder[group, junction], self._held_s[group, junction] = car, 0.0
        return True
