"""The world under one virtual robot: wheels that turn move it, its camera sees where it went.

Camera, sensor, timing and tyres are those of a `Look`, by the same code as in training
(`sim_pybullet.sensing`, `sim_pybullet.motors`): who passes here has met nothing easier.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from robot.camera.source import Frame
from robot.computer.clock import Clock
from robot.contract import DRIVE, ImageSpec
from robot.geometry import Pose
from robot.hat.driver import MotorDriver
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import DriveLook, Look
from sim_pybullet.motors import MotorModel
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import Mover, Scene
from sim_pybullet.scenery.objects import build_scene
from sim_pybullet.sensing.camera_feed import CameraFeed
from sim_pybullet.town import Town
from sim_pybullet.virtual.clock import VirtualClock, run_until
from sim_pybullet.virtual.hat import VirtualHat

PHYSICS_DT_S = 1.0 / 60.0
_NOMINAL = DriveLook()


class RolledWheels:
    """The mean rim speeds of both wheels between two calls, measured at the rotors."""

    def __init__(self, hat: VirtualHat, clock: Clock) -> None:
        self._hat, self._clock = hat, clock
        self._time_s, self._angles_rad = clock.now(), hat.wheel_angles_rad

    def since_last(self) -> np.ndarray:
        """(2,) left and right [m/s] since the last call; zero within an instant."""
        now_s, angles_rad = self._clock.now(), self._hat.wheel_angles_rad
        duration_s = now_s - self._time_s
        if duration_s <= 0.0:
            return np.zeros(2)
        rims_mps = (angles_rad - self._angles_rad) * DRIVE.wheel_radius_m / duration_s
        self._time_s, self._angles_rad = now_s, angles_rad
        return np.asarray(rims_mps)


def beyond_nominal(look: DriveLook) -> DriveLook:
    """This look for wheels that have the nominal look's lags and noise, and a ramp, already.

    Such are the rotors': they lag and shake by themselves. Steps are exact, so a gain is a wheel
    of another radius, a trim two unequal ones, and a turn gain tyres that slip.
    """
    return replace(
        look,
        forward_lag_s=max(look.forward_lag_s - _NOMINAL.forward_lag_s, 0.0),
        turn_lag_s=max(look.turn_lag_s - _NOMINAL.turn_lag_s, 0.0),
        acceleration_mps2=_NOMINAL.acceleration_mps2,
        noise=math.sqrt(max(look.noise**2 - _NOMINAL.noise**2, 0.0)),
    )


class VirtualWorld:
    """A town with one robot whose wheels are the rotors of a ``VirtualHat``; its camera, too.

    In lock-step somebody calls ``advance``; otherwise ``follow``, some sixty times a second.
    """

    def __init__(
        self,
        road_map: RoadMap,
        look: Look,
        hat: VirtualHat,
        clock: Clock,
        rng: np.random.Generator,
        movers: tuple[Mover, ...] = (),
    ) -> None:
        self.around = np.full((len(movers), 3), np.nan)  # where they are seen; NaN: not there
        self.scene: Scene = build_scene(road_map, look, rng)
        self._look, self._clock, self._rng = look, clock, rng
        self._tyre_rng = rng.spawn(1)[0]  # so that what the camera draws does not depend on wheels
        self._town = Town([self.scene.solids], 1, drive="wheels", dt_s=PHYSICS_DT_S)
        camera = RayCamera(ImageSpec(), 1, movers)
        self._feed = CameraFeed(camera, 1, dt_s=PHYSICS_DT_S, movers=len(movers))
        self._rolled = RolledWheels(hat, clock)
        self._tyres = MotorModel(1, PHYSICS_DT_S)
        self._stepped_s = clock.now()
        self._frame: Frame | None = None
        self.place(self.pose)

    @property
    def pose(self) -> Pose:
        """Where the robot truly is."""
        return Pose(*self._town.poses[0])

    @property
    def collided(self) -> bool:
        """Whether it touched anything in the last step of physics."""
        return bool(self._town.collided[0])

    def place(self, pose: Pose) -> None:
        """Put the robot down, where it has stood for a while as its camera is concerned."""
        self._town.place(0, pose)
        self._rolled.since_last()
        self._tyres.reset(0, beyond_nominal(self._look.drive))
        self._feed.begin(0, self.scene, self._look, self._town.poses[0], self.around)

    def advance(self, driver: MotorDriver, time_s: float) -> None:
        """Run motors and physics side by side until the clock reads ``time_s`` [s]."""
        assert isinstance(self._clock, VirtualClock)
        while self.due_s <= time_s + 1e-9:
            run_until(driver, self._clock, self.due_s)
            self.follow()
        run_until(driver, self._clock, time_s)

    @property
    def due_s(self) -> float:
        """When physics must next be looked after [s]."""
        return self._stepped_s + PHYSICS_DT_S

    def follow(self) -> None:
        """Let physics catch up with the clock, driven by what the wheels have rolled since."""
        count = math.floor((self._clock.now() - self._stepped_s) / PHYSICS_DT_S + 1e-6)
        if count <= 0:
            return
        self._stepped_s += count * PHYSICS_DT_S
        rims_mps = self._rolled.since_last()
        for _ in range(count):
            self._town.step(self._tyres.step(rims_mps[None], self._tyre_rng))
            self._feed.record(self._town.poses, self.around[None])

    def see(self) -> np.ndarray:
        """The camera frame (120, 160, 3) uint8 RGB that arrives at this moment.

        As late as the look says, or with its ``frame_skip`` the one before again.
        """
        return self._feed.pictures(self._rng)[0]

    def read(self) -> Frame:
        """The frame of now; the same one again within the same instant."""
        now_s = self._clock.now()
        if self._frame is None or self._frame.time_s != now_s:
            sequence = 0 if self._frame is None else self._frame.sequence + 1
            self._frame = Frame(self.see(), sequence, now_s)
        return self._frame

    def close(self) -> None:
        """Free the physics client."""
        self._town.close()
