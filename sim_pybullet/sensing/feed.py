"""``CameraFeed``: the pictures of N robots as they arrive, late, repeated, through a sensor and a
translator."""

from __future__ import annotations

import numpy as np

from robot.contract import ImageSpec
from robot.geometry import wrap_angle
from robot.inference.translator import Translator
from robot.lens import CameraRig
from sim_pybullet.delay_line import DelayLine
from sim_pybullet.look import CameraLook, LightLook, Look, SensorLook
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.rendering.camera import BatchCamera
from sim_pybullet.scene import Scene
from sim_pybullet.sensing.optics import add_gloss
from sim_pybullet.sensing.sensor import apply_sensor


class CameraFeed:
    """Between the world and the policy.

    After a `sim_pybullet.look.TimingLook`: a picture shows what there was to see ``camera_delay_s``
    ago; with probability ``frame_skip`` the previous one comes again.

    Args:
        camera: draws N robots.
        n_robots: N.
        crop_top_px: how many rows the camera leaves out above, see `robot.contract.ImageSpec`.
        translator: what every picture passes through last.
        dt_s: time between two calls of ``record``.
    """

    def __init__(
        self,
        camera: BatchCamera,
        n_robots: int,
        crop_top_px: int = 0,
        translator: Translator | None = None,
        dt_s: float = PHYSICS_DT_S,
    ) -> None:
        self._camera = camera
        self._dt_s = dt_s
        self._translator = translator
        self._crop_top_px = crop_top_px
        self._sensors = [SensorLook()] * n_robots
        self._scenes: list[Scene | None] = [None] * n_robots
        self._cameras: list[CameraLook | None] = [None] * n_robots
        self._glossy: list[tuple[CameraRig, LightLook] | None] = [None] * n_robots
        self._headings, self._turns_radps = np.zeros(n_robots), np.zeros(n_robots)
        self._past = DelayLine(n_robots, 4)  # x, y, cosine and sine of the heading
        self._skip = np.zeros(n_robots)
        self._first = np.ones(n_robots, dtype=bool)  # no picture of this episode was taken yet
        self._shown = np.zeros((n_robots, *camera.shape), np.uint8)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""
        return self._camera.shape

    def begin(self, i: int, scene: Scene, look: Look, pose: np.ndarray) -> None:
        """Robot ``i`` begins an episode at a pose (3,), where it has stood for a while."""
        if self._scenes[i] is not scene or self._cameras[i] != look.camera:
            self._camera.set_robot(i, scene, look.rig())
            self._scenes[i], self._cameras[i] = scene, look.camera
        delay = look.timing.camera_delay_s / self._dt_s
        self._past.reset(i, delay, _as_vectors(pose[None])[0])
        self._sensors[i] = look.sensor
        self._glossy[i] = (look.rig(), scene.light) if scene.light.gloss else None
        self._headings[i], self._turns_radps[i] = pose[2], 0.0
        self._skip[i] = look.timing.frame_skip
        self._first[i] = True

    def record(self, poses: np.ndarray) -> None:
        """Take note of the poses (N, 3) after one more physics step."""
        self._past.push(_as_vectors(poses))
        self._turns_radps[:] = wrap_angle(poses[:, 2] - self._headings) / self._dt_s
        self._headings = poses[:, 2].copy()

    def pictures(
        self,
        rng: np.random.Generator,
        robots: np.ndarray | None = None,
        noise_rng: np.random.Generator | None = None,
    ) -> np.ndarray:
        """What arrives now: (M, H, W, 3) uint8 RGB in a fresh array, of all robots or of some.

        The sensor's noise comes from ``noise_rng``, where there is one.
        """
        noise_rng = rng if noise_rng is None else noise_rng
        x, y, cosine, sine = self._past.read().T
        poses = np.stack((x, y, np.arctan2(sine, cosine)), axis=1)
        chosen = slice(None) if robots is None else robots
        sensors = self._sensors if robots is None else [self._sensors[i] for i in robots]
        light = self._camera.render(poses[chosen], robots)
        everyone = range(len(poses)) if robots is None else robots.tolist()
        for picture, i in zip(light, everyone, strict=True):
            self._mirror(picture, i, poses[i, 2])
        turns = self._turns_radps[chosen]
        pictures = apply_sensor(light, sensors, noise_rng, self._crop_top_px, turns)
        if self._translator is not None:
            pictures = self._translator(pictures)
        if self._skip.any():
            again = (rng.random(len(pictures)) < self._skip[chosen]) & ~self._first[chosen]
            pictures[again] = self._shown[chosen][again]
            self._shown[chosen] = pictures
        self._first[chosen] = False
        return pictures

    def _mirror(self, picture: np.ndarray, i: int, heading_rad: float) -> None:
        """The light in the floor, where robot ``i``'s floor is glossy."""
        glossy = self._glossy[i]
        if glossy is not None:
            height, width, _ = self.shape
            image = ImageSpec(width, height + self._crop_top_px, self._crop_top_px)
            add_gloss(picture, glossy[0], image, glossy[1], heading_rad)


def _as_vectors(poses: np.ndarray) -> np.ndarray:
    heading = poses[:, 2]
    return np.stack((poses[:, 0], poses[:, 1], np.cos(heading), np.sin(heading)), axis=1)
