"""``DriveEnv``: one robot as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import gymnasium
import numpy as np

from robot.contract import CONTROL_DT_S, ImageSpec
from sim_pybullet import spaces
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.vector_env import DriveVectorEnv

RenderMode = Literal["human", "rgb_array"]


class DriveEnv(gymnasium.Env[Any, Any]):
    """A small robot drives on a Duckietown road by what its camera shows.

    Actions: Discrete(5), `robot.contract.Action`, each a pair of wheel speeds held for 0.1 s.

    ==  ============  ==============  ================
    0   LEFT          0.18 m/s         2.4 rad/s
    1   SLIGHT_LEFT   0.30 m/s         0.9 rad/s
    2   STRAIGHT      0.30 m/s         0.0 rad/s
    3   SLIGHT_RIGHT  0.30 m/s        -0.9 rad/s
    4   RIGHT         0.18 m/s        -2.4 rad/s
    ==  ============  ==============  ================

    Observation: the picture, Box (H, W, 3) uint8 RGB; 120 x 160 unless another
    `robot.contract.ImageSpec` is asked for. A task that guides gives a Dict of ``image`` and
    ``path``, ten angles in [-1, 1] (`robot.navigation.guidance`).

    ``continuous=True``: Box(-1, 1, (2,)), left and right wheel speed as shares of
    `robot.contract.MAX_WHEEL_MPS`; of a race car, steering and throttle.

    Reward, start and ends: as the task says, see `sim_pybullet.tasks`.

    Info of every step: ``terms`` (reward by name), ``arc_m``, ``offset_m``, ``heading_error_rad``,
    ``progress_m``, ``travelled_m`` (`sim_pybullet.tasks.following.Course`), ``laps`` or
    ``remaining_m``, ``collided``, ``is_success``; at the end also ``drive``
    (`sim_pybullet.drive_metrics.DriveMetrics`).

    Traffic: Discrete(7), the five, slow and stop, `sim_pybullet.tasks.traffic`; pictures are
    (H, W, 9), the last three frames.

    Track racing: Discrete(9), `sim_pybullet.racing.racing_cars.RACING_ACTIONS`; pictures are (H, W,
    12), the last four frames.

    Args:
        world: of one robot; it ends with the environment.
        render_mode: ``rgb_array`` lets ``render`` give the picture that the robot saw last;
            ``human`` shows it in a window after every step, ten a second.
        continuous: actions are any two speeds, Box(-1, 1, (2,)).
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (as the base class has it)
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(1.0 / CONTROL_DT_S),
    }

    def __init__(
        self, world: BatchWorld, render_mode: RenderMode | None = None, continuous: bool = False
    ) -> None:
        self.world = world
        self.render_mode = render_mode
        self.observation_space = spaces.observation_space(world)
        self.action_space = spaces.action_space(world, continuous)
        self._window: Any = None  # matplotlib's picture
        self._seen = np.zeros((*world.image_shape[:2], 3), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; the same seed begins the same ones.

        ``options``: ``pose``, (x [m], y [m], heading [rad]), where the robot begins; DuckpilotError
        for others, or where no episode can begin.
        """
        poses = spaces.start_poses(options, 1)
        super().reset(seed=seed)
        if seed is not None:
            self.world.seed(int(self.np_random.integers(spaces.SEEDS)))
        return self._show(self.world.reset(poses)), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out one action for 0.1 s."""
        step = self.world.step(np.asarray(action)[None])
        ended = len(step.finished.robots) > 0
        observation = self._show(step.finished.observation if ended else step.observation)
        return (
            observation,
            float(step.reward[0]),
            bool(step.task.terminated[0]),
            bool(step.task.truncated[0]),
            spaces.step_infos(self.world, step)[0],
        )

    def render(self) -> np.ndarray | None:
        """The picture (H, W, 3) uint8 that the robot saw last; None unless ``rgb_array``."""
        return self._seen.copy() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Free the world, close the window."""
        self.world.close()
        if self._window is not None:
            import matplotlib.pyplot as plt

            plt.close(self._window.figure)

    def _show(self, observation: Observation) -> Any:
        self._seen = spaces.newest_picture(observation.image[0])
        if self.render_mode == "human":
            self._show_in_window()
        return spaces.as_space_member(observation, 0)

    def _show_in_window(self) -> None:
        """By matplotlib, which draws nothing where there is no screen."""
        import matplotlib.pyplot as plt

        if self._window is None:
            plt.ion()
            axes = plt.subplots(num="duckpilot", clear=True)[1]
            axes.axis("off")
            self._window = axes.imshow(self._seen)
        self._window.set_data(self._seen)
        canvas = self._window.figure.canvas
        canvas.draw_idle()
        canvas.start_event_loop(CONTROL_DT_S)


def make(
    task: str, render_mode: RenderMode | None = None, continuous: bool = False, **world: Any
) -> DriveEnv:
    """The environment of a task, as the registered ids make it; ``world`` as of `make_world`."""
    return DriveEnv(make_world(task, 1, **world), render_mode, continuous)


def make_vector(
    task: str,
    num_envs: int = 1,
    render_mode: str | None = None,
    continuous: bool = False,
    **world: Any,
) -> DriveVectorEnv:
    """The vector environment of a task, as `gymnasium.make_vec` makes it of a registered id."""
    return DriveVectorEnv(make_world(task, num_envs, **world), render_mode, continuous)


def make_world(
    task: str,
    robots: int = 1,
    road_map: str | Sequence[str] = (),
    look: str = "nominal",
    pose_error: str | None = None,
    image: ImageSpec | None = None,
    world_seed: int = 0,
    pool_size: int = 16,
    **choices: Any,
) -> BatchWorld:
    """The world of a task, for any face of it.

    Args:
        robots: how many.
        road_map: one or more files, or names of shipped maps or tracks, each episode on one of
            them; else the task's own.
        look: a file, or the name of a shipped look or distribution of looks.
        pose_error: ``none`` or ``arena``, in place of the look's own.
        image: the picture of the policy.
        world_seed: of the painted worlds; episodes follow the seed of ``reset``.
        pool_size: how many worlds are painted of each map.
        choices: ``lane``, ``style``, ``laps``, ``scenario`` or ``start_spread``, as of
            `sim_pybullet.tasks.spec.Choices`.

    Raises:
        MapError: no such map, or not one for this task.
        ConfigError: no such task or look, or something that this task has no use for.
    """
    spec = find_task(task)
    names = [road_map] if isinstance(road_map, str) else road_map or [spec.map]
    built = spec.build([spec.load(name) for name in names], robots, Choices(**choices))
    return BatchWorld(built, spec.looks(look, pose_error), image, world_seed, pool_size)
