"""The only module that speaks to PyBullet: one client per instance, bodies by name, no state kept.

Lengths in metres, angles in radians, in the client's own frame; z is up.
"""

from __future__ import annotations

import math
import os
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from robot.geometry import Pose
from sim_pybullet.rendering.pinhole_cover import PinholeView
from sim_pybullet.scene import Ground, Mover, Scene, Solid

_stderr, _nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, 2)  # it announces its build time
try:
    import pybullet
finally:
    os.dup2(_stderr, 2)
    os.close(_nowhere)
    os.close(_stderr)

STATIC: Final = 1  # collision groups, one bit each
ROBOT: Final = 2
_COMPOUND = 16  # PyBullet's greatest number of shapes in one body
_TOUCH_M = 1e-3  # Bullet reports pairs of bodies already when they are 20 mm apart
_NEAR_M, _FAR_M = 0.01, 300.0  # what a camera sees
_BELOW_M = 2e-3  # the floor's picture: what goes on beyond it
_DISTANCE = 8  # place of the distance in a contact point


class _Client:
    """PyBullet's functions, bound to a client of their own that ends with this object."""

    def __init__(self) -> None:
        self.number: int = pybullet.connect(pybullet.DIRECT)
        self.close = weakref.finalize(self, pybullet.disconnect, self.number)

    def __getattr__(self, name: str) -> Any:
        return partial(getattr(pybullet, name), physicsClientId=self.number)


@dataclass(frozen=True)
class Body:
    """A robot in the client: its number, its wheels' joints, its centre of mass from its origin."""

    number: int
    wheels: tuple[int, ...] = ()  # left, right
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Bullet:
    """A physics client without a window; Bullet cuts each step into ``substeps`` parts."""

    def __init__(self, dt_s: float, gravity: bool = False, substeps: int = 1) -> None:
        self._client = _Client()
        self._client.setTimeStep(dt_s)
        self._client.setPhysicsEngineParameter(
            numSubSteps=substeps if substeps > 1 else 0, deterministicOverlappingPairs=1
        )
        self._client.setGravity(0.0, 0.0, -9.81 if gravity else 0.0)

    def close(self) -> None:
        """Free the client; it cannot be used afterwards."""
        self._client.close()

    def step(self) -> None:
        """Advance all bodies by one time step."""
        self._client.stepSimulation()

    def add_floor(self) -> int:
        """An endless floor at z = 0 on which wheels grip; its body number."""
        shape = self._client.createCollisionShape(pybullet.GEOM_PLANE)
        number = self._client.createMultiBody(0.0, shape)
        self._client.changeDynamics(number, -1, lateralFriction=1.0)
        self._client.setCollisionFilterGroupMask(number, -1, STATIC, ROBOT)
        return int(number)

    def add_solids(self, solids: Sequence[Solid], x_m: float, y_m: float) -> list[int]:
        """Solids that collide, shifted by (x_m, y_m), to stay in place; their bodies' numbers."""
        hard = [solid for solid in solids if solid.collides and min(solid.size_m) > 0.0]
        numbers = []
        for first in range(0, len(hard), _COMPOUND):
            shape = self._compound(hard[first : first + _COMPOUND])
            number = self._client.createMultiBody(0.0, shape, basePosition=(x_m, y_m, 0.0))
            self._client.setCollisionFilterGroupMask(number, -1, STATIC, ROBOT)
            numbers.append(int(number))
        return numbers

    def remove(self, numbers: Sequence[int]) -> None:
        """Take these bodies out of the client."""
        for number in numbers:
            self._client.removeBody(number)

    def add_box_robot(
        self, size_m: tuple[float, ...], centre_m: tuple[float, ...], mask: int
    ) -> Body:
        """A box that slides upright: its origin, about which it turns, is off its centre.

        ``mask`` holds the groups it collides with.
        """
        shape = self._client.createCollisionShape(
            pybullet.GEOM_BOX,
            halfExtents=[0.5 * side for side in size_m],
            collisionFramePosition=centre_m,
        )
        number = self._client.createMultiBody(1.0, shape)
        # A principal moment of zero stands for an infinite one: the box neither pitches nor rolls.
        self._client.changeDynamics(number, -1, localInertiaDiagonal=(0.0, 0.0, 0.004))
        self._calm(number, -1)
        self._client.setCollisionFilterGroupMask(number, -1, ROBOT, mask)
        return Body(int(number))

    def load_robot(self, urdf: Path, wheels: tuple[str, str], mask: int) -> Body:
        """A robot on wheels; ``wheels`` names the links that turn, the others slide freely."""
        number = self._client.loadURDF(str(urdf))
        links = {}
        for joint in range(self._client.getNumJoints(number)):
            links[self._client.getJointInfo(number, joint)[12].decode()] = joint
        for link in (-1, *links.values()):
            self._calm(number, link)
            self._client.setCollisionFilterGroupMask(number, link, ROBOT, mask)
        joints = tuple(links[name] for name in wheels)
        for joint in links.values():
            self._client.changeDynamics(number, joint, lateralFriction=float(joint in joints))
        centre = self._client.getDynamicsInfo(number, -1)[3]
        return Body(int(number), joints, (centre[0], centre[1], centre[2]))

    def place(self, body: Body, x_m: float, y_m: float, heading_rad: float) -> None:
        """Put a robot down at rest."""
        c, s = np.cos(heading_rad), np.sin(heading_rad)
        cx, cy, cz = body.centre_m
        position = (x_m + c * cx - s * cy, y_m + s * cx + c * cy, cz)
        turn = (0.0, 0.0, np.sin(0.5 * heading_rad), np.cos(0.5 * heading_rad))
        self._client.resetBasePositionAndOrientation(body.number, position, turn)
        self._client.resetBaseVelocity(body.number, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for joint in body.wheels:
            self._client.resetJointState(body.number, joint, 0.0, 0.0)

    def poses(self, bodies: Sequence[Body]) -> np.ndarray:
        """Where the robots' origins are: rows of x [m], y [m], heading [rad], (N, 3)."""
        get, client = pybullet.getBasePositionAndOrientation, self._client.number
        states = [get(body.number, client) for body in bodies]
        x, y, z, w = np.array([turn for _, turn in states]).T
        heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        c, s = np.cos(heading), np.sin(heading)
        at = np.array([position for position, _ in states])
        cx, cy, _ = np.array([body.centre_m for body in bodies]).T
        return np.stack((at[:, 0] - c * cx + s * cy, at[:, 1] - s * cx - c * cy, heading), axis=1)

    def glide(self, bodies: Sequence[Body], velocities: np.ndarray) -> None:
        """Set velocities over the floor (N, 3): along x, along y [m/s], turn rate [rad/s]."""
        put, client = pybullet.resetBaseVelocity, self._client.number
        for body, (vx, vy, turn) in zip(bodies, velocities.tolist(), strict=True):
            put(body.number, (vx, vy, 0.0), (0.0, 0.0, turn), client)

    def spin(self, bodies: Sequence[Body], rates: np.ndarray, torque_nm: float) -> None:
        """Let the motors hold these wheel rates (N, 2) [rad/s], left and right, within a torque."""
        for body, pair in zip(bodies, rates.tolist(), strict=True):
            self._client.setJointMotorControlArray(
                body.number,
                body.wheels,
                pybullet.VELOCITY_CONTROL,
                targetVelocities=pair,
                forces=(torque_nm, torque_nm),
            )

    def touching(self, ignored: int = -1) -> set[int]:
        """Numbers of the bodies that touched one another when the last step began.

        Contacts with the body ``ignored`` do not count.
        """
        found = set()
        for contact in self._client.getContactPoints():
            if contact[_DISTANCE] < _TOUCH_M and ignored not in contact[1:3]:
                found.update(contact[1:3])
        return found

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

    def _calm(self, number: int, link: int) -> None:
        """No drag of the air, which Bullet adds by itself, and no falling asleep."""
        self._client.changeDynamics(
            number,
            link,
            linearDamping=0.0,
            angularDamping=0.0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        )


class Drawing(NamedTuple):
    """A pinhole picture (H, W, 3) uint8 RGB and the body that each pixel shows (H, W), -1: none."""

    rgb: np.ndarray
    bodies: np.ndarray


class Stage:
    """A scene to be looked at, in a client without a window, drawn by PyBullet's TinyRenderer.

    ``movers`` are away until `move` says where they are.
    """

    def __init__(self, scene: Scene, movers: Sequence[Mover] = ()) -> None:
        self._client, ground = _Client(), scene.ground
        self._add_floor(ground)
        middle_m = 0.5 * np.array(ground.classes.shape) * ground.texel_m
        x_m, y_m = ground.west_m + middle_m[1], ground.north_m - middle_m[0]
        far = (2.0 * _FAR_M, 2.0 * _FAR_M, 1.0)
        below = Solid("box", x_m, y_m, 0.0, far, ground.outside_rgb, base_m=-1.0 - _BELOW_M)
        for solid in (below, *scene.solids):
            self._place(self._add(solid), solid, Pose(0.0, 0.0, 0.0))
        self._movers = [[(self._add(solid), solid) for solid in mover] for mover in movers]
        self.move([Pose(np.nan, np.nan, np.nan)] * len(movers))

    def close(self) -> None:
        """Free the client; it cannot be used afterwards."""
        self._client.close()

    def move(self, poses: Sequence[Pose]) -> None:
        """Put every mover's origin somewhere; away where that is NaN."""
        for parts, pose in zip(self._movers, poses, strict=True):
            for body, solid in parts:
                self._place(body, solid, pose)

    def _add_floor(self, ground: Ground) -> None:
        height, width = ground.classes.shape
        west, north = ground.west_m, ground.north_m
        east, south = west + width * ground.texel_m, north - height * ground.texel_m
        shape = self._client.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=[(west, south, 0), (east, south, 0), (east, north, 0), (west, north, 0)],
            normals=[(0, 0, 1)] * 4,
            uvs=[(0, 0), (1, 0), (1, 1), (0, 1)],
            indices=[0, 1, 2, 0, 2, 3],
            specularColor=(0.0, 0.0, 0.0),
        )
        body = self._client.createMultiBody(0.0, -1, shape)
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "texture.png")
            cv2.imwrite(path, ground.rgb[..., ::-1], (cv2.IMWRITE_PNG_COMPRESSION, 1))
            number = self._client.loadTexture(path)
        self._client.changeVisualShape(body, -1, textureUniqueId=number)

    def _add(self, solid: Solid) -> int:
        length, width, height = solid.size_m
        shape = self._client.createVisualShape(
            pybullet.GEOM_CYLINDER if solid.shape == "cylinder" else pybullet.GEOM_BOX,
            radius=0.5 * length,
            length=height,
            halfExtents=(0.5 * length, 0.5 * width, 0.5 * height),
            rgbaColor=(*(value / 255.0 for value in solid.rgb), 1.0),
            specularColor=(0.0, 0.0, 0.0),
        )
        return int(self._client.createMultiBody(0.0, -1, shape))

    def _place(self, body: int, solid: Solid, origin: Pose) -> None:
        """Put a solid down that stands about an origin."""
        away = math.isnan(origin.x_m)
        x_m, y_m = (0.0, 0.0) if away else origin.to_world(np.array([solid.x_m, solid.y_m]))
        half = 0.0 if away else 0.5 * (origin.heading_rad + solid.heading_rad)
        z_m = -_FAR_M if away else solid.base_m + 0.5 * solid.size_m[2]
        turn = (0.0, 0.0, math.sin(half), math.cos(half))
        self._client.resetBasePositionAndOrientation(body, (x_m, y_m, z_m), turn)

    def draw(
        self, view: PinholeView, eye_m: np.ndarray, turn: np.ndarray, light: np.ndarray
    ) -> Drawing:
        """What a pinhole at ``eye_m`` sees.

        ``turn`` (3, 3) takes the view's axes to the world; ``light`` (5,) is the direction to the
        light, its ambient and its diffuse share. No shadows, no gloss.
        """
        world_to_gl = np.eye(4)
        world_to_gl[:3, :3] = (turn * (1.0, -1.0, -1.0)).T  # OpenGL looks along -z, y up
        world_to_gl[:3, 3] = -world_to_gl[:3, :3] @ eye_m
        # TinyRenderer takes a pixel's colour at its bottom left corner, we at its centre.
        shift = 0.5 * (view.high - view.low) / view.size_px * (1.0, -1.0)
        (left, bottom), (right, top) = _NEAR_M * (view.low + shift), _NEAR_M * (view.high + shift)
        frustum = self._client.computeProjectionMatrix(left, right, -top, -bottom, _NEAR_M, _FAR_M)
        width, height, rgba, _, bodies = self._client.getCameraImage(
            *view.size_px,
            viewMatrix=world_to_gl.T.ravel().tolist(),
            projectionMatrix=frustum,
            lightDirection=light[:3].tolist(),
            lightColor=(1.0, 1.0, 1.0),
            shadow=0,
            lightAmbientCoeff=float(light[3]),
            lightDiffuseCoeff=float(light[4]),
            lightSpecularCoeff=0.0,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        rgb = np.asarray(rgba, np.uint8).reshape(height, width, 4)[..., :3]
        return Drawing(np.ascontiguousarray(rgb), np.asarray(bodies).reshape(height, width))
