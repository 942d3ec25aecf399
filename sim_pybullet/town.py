"""``Town``: the bodies of N robots and of what stands around them, in one PyBullet client."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from robot.contract import DRIVE
from robot.geometry import Pose
from sim_pybullet.bullet import Client, pybullet
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.scene import Solid

URDF = Path(__file__).parent / "assets" / "duckpilot.urdf"
Drive = Literal["planar", "wheels"]
CHASSIS_M, CHASSIS_CENTRE_M = (0.18, 0.13, 0.1), (-0.024, 0.0, 0.07)  # as in the URDF
STATIC: Final = 1  # collision groups, one bit each
ROBOT: Final = 2

_WHEELS = ("left_wheel", "right_wheel")  # links that turn; the others slide freely
_WHEEL_TORQUE_NM = 0.5  # more than the tyres can pass on: wheels turn as they are told
_SUBSTEPS = 4  # contact of a wheel with the floor needs about 1/120 s
_APART_M = 100.0  # at least, between the origins of two worlds in the client
_COMPOUND = 16  # PyBullet's greatest number of shapes in one body
_TOUCH_M = 1e-3  # Bullet reports pairs of bodies already when they are 20 mm apart
_DISTANCE = 8  # place of the distance in a contact point


@dataclass(frozen=True)
class _Body:
    """A robot in the client: its number, its wheels' joints, its centre of mass from its origin."""

    number: int
    wheels: tuple[int, ...] = ()  # left, right
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Town:
    """N robots among solids that do not move; robots pass through each other.

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
        dt_s: float = PHYSICS_DT_S,
        reach_m: float = 0.0,
    ) -> None:
        self._dt_s = dt_s
        self._wheels = drive == "wheels"
        self._client = Client()
        self._client.setTimeStep(dt_s)
        self._client.setPhysicsEngineParameter(
            numSubSteps=_SUBSTEPS if self._wheels else 0, deterministicOverlappingPairs=1
        )
        self._client.setGravity(0.0, 0.0, -9.81 if self._wheels else 0.0)
        self._floor = self._add_floor() if self._wheels else -1
        reaches_m = [abs(solid.x_m) for solids in worlds for solid in solids]
        self._apart_m = max(_APART_M, 2.0 * max([reach_m, *reaches_m]))
        self._solids = list(worlds)
        self._standing = [
            self._add_solids(solids, world * self._apart_m) for world, solids in enumerate(worlds)
        ]
        add = self._load_robot if self._wheels else self._add_box_robot
        self._bodies = [add() for _ in range(n_robots)]
        self._origins = np.zeros((n_robots, 3))  # of each robot's world in the client
        self._poses = np.zeros((n_robots, 3))
        self._collided = np.zeros(n_robots, dtype=bool)
        for i in range(n_robots):
            self.place(i, Pose(0.0, 0.0, 0.0))

    def close(self) -> None:
        """Free the physics client."""
        self._client.close()

    @property
    def poses(self) -> np.ndarray:
        """(N, 3): x [m], y [m], heading [rad] of each robot in its world."""
        return self._poses.copy()

    @property
    def collided(self) -> np.ndarray:
        """(N,) bool: whether the robot touched a solid in the last step."""
        return self._collided.copy()

    def place(self, i: int, pose: Pose, world: int = 0) -> None:
        """Put robot ``i`` down at rest in a world."""
        self._origins[i, 0] = world * self._apart_m
        self._poses[i] = pose
        self._collided[i] = False
        x_m, y_m, heading_rad = self._origins[i] + self._poses[i]
        body, c, s = self._bodies[i], np.cos(heading_rad), np.sin(heading_rad)
        cx, cy, cz = body.centre_m
        position = (x_m + c * cx - s * cy, y_m + s * cx + c * cy, cz)
        turn = (0.0, 0.0, np.sin(0.5 * heading_rad), np.cos(0.5 * heading_rad))
        self._client.resetBasePositionAndOrientation(body.number, position, turn)
        self._client.resetBaseVelocity(body.number, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for joint in body.wheels:
            self._client.resetJointState(body.number, joint, 0.0, 0.0)

    def furnish(self, world: int, solids: Sequence[Solid]) -> None:
        """Put these solids in the place of those that stand in a world, if they are others."""
        if self._solids[world] is not solids:
            for number in self._standing[world]:
                self._client.removeBody(number)
            self._standing[world] = self._add_solids(solids, world * self._apart_m)
            self._solids[world] = solids

    def step(self, twists: np.ndarray) -> None:
        """Advance by one time step at twists (N, 2): forward speed [m/s] and turn rate [rad/s]."""
        forward, turn = np.asarray(twists, dtype=float).T
        if self._wheels:
            self._spin(forward, turn)
        else:
            self._glide(forward, turn)
        self._client.stepSimulation()
        self._poses = self._found() - self._origins
        touching = self._touching()
        self._collided = np.array([body.number in touching for body in self._bodies])

    def _glide(self, forward: np.ndarray, turn: np.ndarray) -> None:
        """Over the floor along the chord of the arc that the twist makes in one step."""
        half = 0.5 * self._dt_s * turn
        chord = forward * np.sinc(half / np.pi)
        heading = self._poses[:, 2] + half
        velocities = np.stack((chord * np.cos(heading), chord * np.sin(heading), turn), axis=1)
        put, client = pybullet.resetBaseVelocity, self._client.number
        for body, (vx, vy, rate) in zip(self._bodies, velocities.tolist(), strict=True):
            put(body.number, (vx, vy, 0.0), (0.0, 0.0, rate), client)

    def _spin(self, forward: np.ndarray, turn: np.ndarray) -> None:
        """The motors hold the wheels' rates, within a torque."""
        half = 0.5 * DRIVE.baseline_m * turn
        rates = np.stack((forward - half, forward + half), axis=1) / DRIVE.wheel_radius_m
        for body, pair in zip(self._bodies, rates.tolist(), strict=True):
            self._client.setJointMotorControlArray(
                body.number,
                body.wheels,
                pybullet.VELOCITY_CONTROL,
                targetVelocities=pair,
                forces=(_WHEEL_TORQUE_NM, _WHEEL_TORQUE_NM),
            )

    def _found(self) -> np.ndarray:
        """(N, 3) where the robots' origins are in the client."""
        get, client = pybullet.getBasePositionAndOrientation, self._client.number
        states = [get(body.number, client) for body in self._bodies]
        x, y, z, w = np.array([turn for _, turn in states]).T
        heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        c, s = np.cos(heading), np.sin(heading)
        at = np.array([position for position, _ in states])
        cx, cy, _ = np.array([body.centre_m for body in self._bodies]).T
        return np.stack((at[:, 0] - c * cx + s * cy, at[:, 1] - s * cx - c * cy, heading), axis=1)

    def _touching(self) -> set[int]:
        """Numbers of the bodies that touched one another, but for the floor, in the last step."""
        found = set()
        for contact in self._client.getContactPoints():
            if contact[_DISTANCE] < _TOUCH_M and self._floor not in contact[1:3]:
                found.update(contact[1:3])
        return found

    def _add_floor(self) -> int:
        """Endless, at z = 0; wheels grip on it."""
        shape = self._client.createCollisionShape(pybullet.GEOM_PLANE)
        number = self._client.createMultiBody(0.0, shape)
        self._client.changeDynamics(number, -1, lateralFriction=1.0)
        self._client.setCollisionFilterGroupMask(number, -1, STATIC, ROBOT)
        return int(number)

    def _add_solids(self, solids: Sequence[Solid], x_m: float) -> list[int]:
        """Solids that collide, shifted to the east, to stay in place; their bodies' numbers."""
        hard = [solid for solid in solids if solid.collides and min(solid.size_m) > 0.0]
        numbers = []
        for first in range(0, len(hard), _COMPOUND):
            shape = self._compound(hard[first : first + _COMPOUND])
            number = self._client.createMultiBody(0.0, shape, basePosition=(x_m, 0.0, 0.0))
            self._client.setCollisionFilterGroupMask(number, -1, STATIC, ROBOT)
            numbers.append(int(number))
        return numbers

    def _compound(self, solids: Sequence[Solid]) -> int:
        half = [0.5 * np.array(solid.size_m) for solid in solids]
        round_ = [solid.shape == "cylinder" for solid in solids]
        return int(
            self._client.createCollisionShapeArray(
                shapeTypes=[pybullet.GEOM_CYLINDER if r else pybullet.GEOM_BOX for r in round_],
                radii=[float(h[0]) for h in half],
                lengths=[solid.size_m[2] for solid in solids],
                halfExtents=[h.tolist() for h in half],
                collisionFramePositions=[
                    (s.x_m, s.y_m, s.base_m + 0.5 * s.size_m[2]) for s in solids
                ],
                collisionFrameOrientations=[
                    (0.0, 0.0, np.sin(0.5 * s.heading_rad), np.cos(0.5 * s.heading_rad))
                    for s in solids
                ],
            )
        )

    def _add_box_robot(self) -> _Body:
        """A box that slides upright."""
        shape = self._client.createCollisionShape(
            pybullet.GEOM_BOX,
            halfExtents=[0.5 * side for side in CHASSIS_M],
            collisionFramePosition=CHASSIS_CENTRE_M,
        )
        number = self._client.createMultiBody(1.0, shape)
        # A principal moment of zero stands for an infinite one: the box neither pitches nor rolls.
        self._client.changeDynamics(number, -1, localInertiaDiagonal=(0.0, 0.0, 0.004))
        self._calm(number, -1)
        self._client.setCollisionFilterGroupMask(number, -1, ROBOT, STATIC)
        return _Body(int(number))

    def _load_robot(self) -> _Body:
        """A robot on wheels."""
        number = self._client.loadURDF(str(URDF))
        count = self._client.getNumJoints(number)
        links = {self._client.getJointInfo(number, k)[12].decode(): k for k in range(count)}
        for link in (-1, *links.values()):
            self._calm(number, link)
            self._client.setCollisionFilterGroupMask(number, link, ROBOT, STATIC)
        joints = tuple(links[name] for name in _WHEELS)
        for joint in links.values():
            self._client.changeDynamics(number, joint, lateralFriction=float(joint in joints))
        centre = self._client.getDynamicsInfo(number, -1)[3]
        return _Body(int(number), joints, (centre[0], centre[1], centre[2]))

    def _calm(self, number: int, link: int) -> None:
        """No drag of the air, which Bullet adds by itself, and no falling asleep."""
        self._client.changeDynamics(
            number,
            link,
            linearDamping=0.0,
            angularDamping=0.0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        )
