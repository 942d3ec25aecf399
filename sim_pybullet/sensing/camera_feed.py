"""``CameraFeed``: the pictures of N robots as they arrive, late, repeated, through a sensor and a
translator."""

import numpy as np

from robot.contract import ImageSpec
from robot.geometry import wrap_angle
from robot.inference.policy import Translator
from sim_pybullet.look import CameraLook, Look
from sim_pybullet.motors import PHYSICS_DT_S, DelayLine
from sim_pybullet.rendering.ray_camera import BatchCamera
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.scene import Scene
from sim_pybullet.sensing.sensor import Mirror, Sensors


class CameraFeed:
    """Between the world and the policy.

    After a `sim_pybullet.look.TimingLook`: a picture shows what there was to see ``camera_delay_s``
    ago; with probability ``frame_skip`` the previous one comes again.

    ``device`` is torch's where pictures are tensors, None where they are arrays.
    """

    def __init__(
        self,
        camera: BatchCamera,
        n_robots: int,
        crop_top_px: int = 0,  # rows that the camera leaves out above: `robot.contract.ImageSpec`
        translator: Translator | None = None,  # what every picture passes through last
        dt_s: float = PHYSICS_DT_S,
        movers: int = 0,  # so many things that move are drawn
        frames: int = 1,  # so many of its last a robot sees; the first one stands for its past
    ) -> None:
        self._camera, self._movers = camera, movers
        self._dt_s = dt_s
        self._translator = translator
        height, width, _ = camera.shape
        self.shape, self.device = (height, width, 3 * frames), camera.device
        if camera.device is None:
            self._sensors = Sensors(n_robots, camera.shape, crop_top_px)
        else:
            from sim_pybullet.sensing.torch_sensor import TorchSensors

            self._sensors = TorchSensors(n_robots, camera.shape, crop_top_px, camera.device)
        self._image = ImageSpec(width, height + crop_top_px, crop_top_px)
        self._scenes: list[Scene | None] = [None] * n_robots
        self._cameras: list[CameraLook | None] = [None] * n_robots
        self._headings, self._turns_radps = np.zeros(n_robots), np.zeros(n_robots)
        # x, y, cosine and sine of the heading, of the robot and of each mover
        self._past = DelayLine(n_robots, 4 + 4 * movers)
        self._skip = np.zeros(n_robots)
        self._first = np.ones(n_robots, dtype=bool)  # no picture of this episode was taken yet
        self._stack = self._sensors.blank((n_robots, *self.shape))
        # where robots, and what moves, were when the newest picture was taken; whether it came now
        self.shown = np.zeros((n_robots, 1 + movers, 3))
        self.fresh = np.zeros(n_robots, dtype=bool)

    @property
    def newest(self) -> np.ndarray:
        """(N, H, W, 3) the pictures that came last; black before the first."""
        return self._stack[..., -3:].copy()

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """(N,) what the cameras of robots that have begun look at, without what moves."""
        return tuple(scene for scene in self._scenes if scene is not None)

    def begin(
        self, i: int, scene: Scene, look: Look, pose: np.ndarray, movers: np.ndarray | None = None
    ) -> None:
        """Robot ``i`` begins an episode at a pose (3,), where it has stood for a while.

        ``movers`` (U, 3) stood likewise, NaN where they are not there.
        """
        if self._scenes[i] is not scene or self._cameras[i] != look.camera:
            self._camera.set_robot(i, scene, look.rig())
            self._scenes[i], self._cameras[i] = scene, look.camera
        delay = look.timing.camera_delay_s / self._dt_s
        around = pose[None] if movers is None else np.vstack((pose, movers))
        self._past.reset(i, delay, _as_vectors(around).ravel())
        mirror = None
        if scene.light.gloss:
            mirror = Mirror(scene.light, pixel_rays(look.rig(), self._image).directions)
        self._sensors.put(i, look.sensor, mirror)
        self._headings[i], self._turns_radps[i] = pose[2], 0.0
        self._skip[i] = look.timing.frame_skip
        self._first[i] = True

    def record(self, poses: np.ndarray, movers: np.ndarray | None = None) -> None:
        """Take note of the poses (N, 3), and the movers' (N, U, 3), after one more physics step."""
        around = poses[:, None] if movers is None else np.hstack((poses[:, None], movers))
        self._past.push(_as_vectors(around).reshape(len(poses), -1))
        self._turns_radps[:] = wrap_angle(poses[:, 2] - self._headings) / self._dt_s
        self._headings = poses[:, 2].copy()

    def pictures(
        self,
        rng: np.random.Generator,
        robots: np.ndarray | None = None,
        noise_rng: np.random.Generator | None = None,
    ) -> np.ndarray:
        """What is seen now: (M, H, W, 3 F) uint8 RGB in a fresh array, of all robots or of some.

        Where the camera draws on a device of torch it is a tensor there.
        The newest picture comes last; the sensor's noise is ``noise_rng``'s, where there is one.
        """
        noise_rng = rng if noise_rng is None else noise_rng
        x, y, cosine, sine = np.moveaxis(self._past.read().reshape(len(self._skip), -1, 4), -1, 0)
        around = np.stack((x, y, np.arctan2(sine, cosine)), axis=-1)
        poses = np.ascontiguousarray(around[:, 0])
        chosen = np.arange(len(poses)) if robots is None else robots
        moving = (around[chosen, 1:],) if self._movers else ()
        light = self._camera.render(poses[chosen], robots, *moving)
        turns_radps, headings_rad = self._turns_radps[chosen], poses[chosen, 2]
        pictures = self._sensors.take(light, chosen, noise_rng, turns_radps, headings_rad)
        if self._translator is not None:
            pictures = self._translator(pictures)
        again, first = np.zeros(len(chosen), dtype=bool), self._first[chosen]
        if self._skip.any():
            again = (rng.random(len(pictures)) < self._skip[chosen]) & ~first
            pictures[again] = self._stack[chosen[again], ..., -3:]
        self.shown[chosen[~again]] = around[chosen[~again]]
        self.fresh[:] = False
        self.fresh[chosen[~again]] = True
        rows = slice(None) if robots is None else robots  # a view is faster where all are drawn
        seen = self._sensors.blank((len(chosen), *self.shape))
        seen[..., :-3], seen[..., -3:] = self._stack[rows][..., 3:], pictures
        for k in range(0, self.shape[2], 3):
            seen[first, ..., k : k + 3] = pictures[first]
        self._stack[rows], self._first[chosen] = seen, False
        return seen


def _as_vectors(poses: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 4)."""
    heading = poses[..., 2]
    return np.stack((poses[..., 0], poses[..., 1], np.cos(heading), np.sin(heading)), axis=-1)
