"""``Lights``: every junction with one lets two ways of four go in turn."""

import math

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.navigation.map_objects import MapObject
from sim_pybullet.scene import Mover, SemanticClass, Solid

PERIOD_S = (4.0, 7.0)  # of which each light draws its own; 5 s where nothing is drawn
_RED, _GREEN, _DARK = (255.0, 60.0, 50.0), (60.0, 255.0, 110.0), (20.0, 20.0, 20.0)
_HALF_M = (0.035, 0.036)  # from the middle of the head to its faces ahead and aside, and
_RED_M, _GREEN_M, _LAMP_M = 0.32, 0.22, 0.045  # heights of lamps, as of a light of 0.366 m


def lamps(phase: int) -> Mover:
    """What the four faces of a light show: in phase 0 those along its heading are green."""
    found = []
    for face in range(4):
        turned_rad, forward_m = face * 0.5 * math.pi, _HALF_M[face % 2]
        x_m, y_m = forward_m * math.cos(turned_rad), forward_m * math.sin(turned_rad)
        go = face % 2 == phase
        for base_m, rgb in ((_RED_M, _DARK if go else _RED), (_GREEN_M, _GREEN if go else _DARK)):
            where, size_m = (x_m + 0.018, y_m, turned_rad), (0.006, _LAMP_M, _LAMP_M)
            found.append(Solid("box", *where, size_m, rgb, SemanticClass.SIGN, base_m))
    return tuple(found)


class Lights:
    """The lights of G groups, at most L of each; those of a map stand where it says."""

    def __init__(self, groups: int, count: int) -> None:
        self.places = np.full((groups, count, 3), np.nan)
        self.junctions = np.full((groups, count), -1)
        self._periods_s, self._clocks_s = np.full((2, groups, count), 5.0)

    def begin(
        self, group: int, lights: tuple[MapObject, ...], at: np.ndarray, rng: np.random.Generator
    ) -> None:
        """The lights of one group, each of a junction ``at`` (K,), at a random moment."""
        count = len(lights)
        self.places[group], self.junctions[group] = np.nan, -1
        for k, light in enumerate(lights):
            self.places[group, k] = light.x_m, light.y_m, light.heading_rad
        self.junctions[group, :count] = at
        self._periods_s[group] = rng.uniform(*PERIOD_S, self._periods_s.shape[1])
        self._clocks_s[group] = rng.uniform(0.0, 2.0 * self._periods_s[group])

    def step(self) -> None:
        """One decision on."""
        self._clocks_s = (self._clocks_s + CONTROL_DT_S) % (2.0 * self._periods_s)

    @property
    def phases(self) -> np.ndarray:
        """(G, L) 0 or 1, as of `lamps`."""
        return (self._clocks_s >= self._periods_s).astype(int)

    def shown(self) -> np.ndarray:
        """(G, 2 L, 3) poses of the lamps: of every light one phase is there, one is not."""
        both = np.repeat(self.places, 2, axis=1)
        phase = np.tile((0, 1), self.places.shape[1])
        both[np.repeat(self.phases, 2, axis=1) != phase] = np.nan
        return both

    def red(self, junctions: np.ndarray, headings: np.ndarray) -> np.ndarray:
        """(G, A) whether those who come to junctions (G, A) with headings (G, A) see red."""
        along = np.abs(np.cos(headings[:, :, None] - self.places[:, None, :, 2])) > math.sqrt(0.5)
        mine = (junctions[:, :, None] == self.junctions[:, None]) & (junctions >= 0)[:, :, None]
        return np.asarray((mine & (np.where(along, 0, 1) != self.phases[:, None])).any(axis=-1))
