"""``Town``: the bodies of N robots and of what stands around them, in one PyBullet client."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from robot.contract import DRIVE
from robot.geometry import Pose
from sim_pybullet.bullet import ROBOT, STATIC, Bullet
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.scene import Solid

URDF = Path(__file__).parent / "assets" / "duckpilot.urdf"
Drive = Literal["planar", "wheels"]
CHASSIS_M, CHASSIS_CENTRE_M = (0.18, 0.13, 0.1), (-0.024, 0.0, 0.07)  # as in the URDF

_WHEELS = ("left_wheel", "right_wheel")
_WHEEL_TORQUE_NM = 0.5  # more than the tyres can pass on: wheels turn as they are told
_SUBSTEPS = 4  # contact of a wheel with the floor needs about 1/120 s
_APART_M = 100.0  # at least, between the origins of two worlds in the client


class Town:
    """N robots among solids that do not move; robots pass through each other unless they collide.

    ``worlds`` are W lists of solids (`sim_pybullet.scene.Scene.solids`); every robot is in one of
    them and knows no other. Poses in and out are in the frame of that world's map, and lie within
    ``reach_m`` of its origin.

    ``planar`` robots have a single body, upright by construction, whose velocity is set in every
    step: they follow a twist exactly, until they meet something. Robots on ``wheels`` stand on
    the floor and move by the friction of two driven wheels and a caster (for virtual hardware).
    """

    def __init__(
        self,
        worlds: Sequence[Sequence[Solid]],
        n_robots: int,
        drive: Drive = "planar",
        robots_collide: bool = False,
        dt_s: float = PHYSICS_DT_S,
        reach_m: float = 0.0,
    ) -> None:
        self._dt_s = dt_s
        self._wheels = drive == "wheels"
        self._bullet = Bullet(dt_s, self._wheels, _SUBSTEPS if self._wheels else 1)
        self._floor = self._bullet.add_floor() if self._wheels else -1
        reaches_m = [abs(solid.x_m) for solids in worlds for solid in solids]
        self._apart_m = max(_APART_M, 2.0 * max([reach_m, *reaches_m]))
        self._solids = list(worlds)
        self._standing = [
            self._bullet.add_solids(solids, world * self._apart_m, 0.0)
            for world, solids in enumerate(worlds)
        ]
        mask = STATIC | ROBOT if robots_collide else STATIC
        self._bodies = [
            self._bullet.load_robot(URDF, _WHEELS, mask)
            if self._wheels
            else self._bullet.add_box_robot(CHASSIS_M, CHASSIS_CENTRE_M, mask)
            for _ in range(n_robots)
        ]
        self._origins = np.zeros((n_robots, 3))  # of each robot's world in the client
        self._poses = np.zeros((n_robots, 3))
        self._collided = np.zeros(n_robots, dtype=bool)
        for i in range(n_robots):
            self.place(i, Pose(0.0, 0.0, 0.0))

    def close(self) -> None:
        """Free the physics client."""
        self._bullet.close()

    @property
    def poses(self) -> np.ndarray:
        """(N, 3): x [m], y [m], heading [rad] of each robot in its world."""
        return self._poses.copy()

    @property
    def collided(self) -> np.ndarray:
        """(N,) bool: whether the robot touched a solid (or, if asked, a robot) in the last step."""
        return self._collided.copy()

    def place(self, i: int, pose: Pose, world: int = 0) -> None:
        """Put robot ``i`` down at rest in a world."""
        self._origins[i, 0] = world * self._apart_m
        self._poses[i] = pose
        self._collided[i] = False
        x_m, y_m, heading_rad = self._origins[i] + self._poses[i]
        self._bullet.place(self._bodies[i], x_m, y_m, heading_rad)

    def furnish(self, world: int, solids: Sequence[Solid]) -> None:
        """Put these solids in the place of those that stand in a world, if they are others."""
        if self._solids[world] is not solids:
            self._bullet.remove(self._standing[world])
            self._standing[world] = self._bullet.add_solids(solids, world * self._apart_m, 0.0)
            self._solids[world] = solids

    def step(self, twists: np.ndarray) -> None:
        """Advance by one time step at twists (N, 2): forward speed [m/s] and turn rate [rad/s]."""
        if self._wheels:
            forward, turn = np.asarray(twists, dtype=float).T
            half = 0.5 * DRIVE.baseline_m * turn
            rates = np.stack((forward - half, forward + half), axis=1) / DRIVE.wheel_radius_m
            self._bullet.spin(self._bodies, rates, _WHEEL_TORQUE_NM)
        else:
            self._bullet.glide(self._bodies, self._velocities(twists))
        self._bullet.step()
        self._poses = self._bullet.poses(self._bodies) - self._origins
        touching = self._bullet.touching(ignored=self._floor)
        self._collided = np.array([body.number in touching for body in self._bodies])

    def _velocities(self, twists: np.ndarray) -> np.ndarray:
        """(N, 3) over the floor: the chord of the arc that the twist makes in one step."""
        forward, turn = np.asarray(twists, dtype=float).T
        half = 0.5 * self._dt_s * turn
        chord = forward * np.sinc(half / np.pi)
        heading = self._poses[:, 2] + half
        return np.stack((chord * np.cos(heading), chord * np.sin(heading), turn), axis=1)
