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

from sim_pybullet.look import Rgb
from sim_pybullet.rendering.pinhole_cover import PinholeView
from sim_pybullet.rendering.solid_mesh import Mesh
from sim_pybullet.scene import Solid

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
    """Meshes to be looked at, in a client without a window, drawn by PyBullet's TinyRenderer."""

    def __init__(self) -> None:
        self._client = _Client()

    def close(self) -> None:
        """Free the client; it cannot be used afterwards."""
        self._client.close()

    def add(self, mesh: Mesh, rgb: Rgb = (255.0, 255.0, 255.0)) -> int:
        """A mesh of one colour at the origin; its body number."""
        shape = self._client.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            normals=mesh.normals.tolist(),
            uvs=mesh.uvs.tolist(),
            indices=mesh.faces.ravel().tolist(),
            rgbaColor=(rgb[0] / 255.0, rgb[1] / 255.0, rgb[2] / 255.0, 1.0),
            specularColor=(0.0, 0.0, 0.0),
        )
        return int(self._client.createMultiBody(0.0, -1, shape))

    def texture(self, body: int, rgb: np.ndarray) -> None:
        """Cover a body with a picture (H, W, 3) uint8 whose bottom left is u = v = 0."""
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "texture.png")
            cv2.imwrite(path, rgb[..., ::-1], (cv2.IMWRITE_PNG_COMPRESSION, 1))
            number = self._client.loadTexture(path)
        self._client.changeVisualShape(body, -1, textureUniqueId=number)

    def place(self, body: int, position_m: tuple[float, ...], heading_rad: float = 0.0) -> None:
        """Put a body's origin somewhere, turned about the vertical."""
        turn = (0.0, 0.0, math.sin(0.5 * heading_rad), math.cos(0.5 * heading_rad))
        self._client.resetBasePositionAndOrientation(body, position_m, turn)

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
        right = 0.5 * (view.right - view.left) / view.width_px
        down = 0.5 * (view.bottom - view.top) / view.height_px
        frustum = self._client.computeProjectionMatrix(
            _NEAR_M * (view.left + right),
            _NEAR_M * (view.right + right),
            _NEAR_M * (down - view.bottom),
            _NEAR_M * (down - view.top),
            _NEAR_M,
            _FAR_M,
        )
        width, height, rgba, _, bodies = self._client.getCameraImage(
            view.width_px,
            view.height_px,
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
