"""One robot, or N, as environments of Gymnasium."""

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from robot.contract import CONTROL_DT_S, ImageSpec
from robot.errors import ConfigError, expect_between
from robot.typed_config import from_plain, to_plain
from sim_pybullet.batch import BatchStep, BatchWorld, Observation
from sim_pybullet.tasks.spec import Choices, find_task

SEEDS = 2**31


def action_space(world: BatchWorld, continuous: bool = False) -> spaces.Space[Any]:
    """One number per action of the task's vehicle; or any pair of its two speeds, -1 to 1."""
    if continuous:
        return spaces.Box(-1.0, 1.0, (2,), np.float32)
    return spaces.Discrete(len(world.task.vehicle.actions))


def observation_space(shape: tuple[int, ...], told: int) -> spaces.Space[Any]:
    """Pictures of this shape (H, W, 3 F), in a Dict with ``path`` where numbers are told, too."""
    image = spaces.Box(0, 255, shape, np.uint8)
    if not told:
        return image
    return spaces.Dict({"image": image, "path": spaces.Box(-1.0, 1.0, (told,), np.float32)})


def start_poses(options: dict[str, Any] | None, n_robots: int) -> np.ndarray | None:
    """The poses (N, 3) of ``reset(options={"pose": ...})``; ConfigError for anything else in it."""
    if not options:
        return None
    if set(options) != {"pose"}:
        raise ConfigError(f"expected no options of reset but 'pose', got {options!r}")
    try:
        poses = np.broadcast_to(np.asarray(options["pose"], dtype=float), (n_robots, 3))
    except (TypeError, ValueError):
        poses = np.full((n_robots, 3), np.nan)
    if not np.isfinite(poses).all():
        raise ConfigError(
            "pose: expected x [m], y [m] and heading [rad], one for all or one for each of "
            f"{n_robots} robots, got {options['pose']!r}"
        )
    return poses.copy()


def as_space_member(observation: Observation, i: int | None = None) -> Any:
    """All robots' observations in the form of the space; or one's, in arrays of its own."""
    image, path = observation
    if i is not None:
        image, path = image[[i]][0], None if path is None else path[i].copy()
    return image if path is None else {"image": image, "path": path}


def step_infos(world: BatchWorld, step: BatchStep) -> list[dict[str, Any]]:
    """One info per robot: see ``DriveEnv`` for the keys."""
    task, judged = world.task, step.task
    columns = {
        **step.course._asdict(),
        **dict(zip(task.fact_names, judged.facts, strict=True)),
        "collided": step.collided,
        "is_success": judged.success,
    }
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    infos: list[dict[str, Any]] = [dict(zip(columns, row, strict=True)) for row in rows]
    for info, terms in zip(infos, judged.terms.T.tolist(), strict=True):
        info["terms"] = dict(zip(task.term_names, terms, strict=True))
    for i, metrics in zip(step.finished.robots, step.finished.metrics, strict=True):
        infos[i]["drive"] = metrics._asdict()
    return infos


class DriveVectorEnv(VectorEnv[Any, Any, Any]):
    """The robots of a ``BatchWorld``: arguments and all else as of `sim_pybullet.env.DriveEnv`.

    A robot whose episode ends begins the next one within the same step
    (``AutoresetMode.SAME_STEP``): ``final_obs`` and ``final_info`` hold the end of the old one.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (as the base class has it)
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / CONTROL_DT_S),
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self, world: BatchWorld, render_mode: str | None = None, continuous: bool = False
    ) -> None:
        self.world, self.render_mode, self.num_envs = world, render_mode, world.n_robots
        self.single_observation_space = observation_space(world.feed.shape, world.told)
        self.single_action_space = action_space(world, continuous)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Any = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of every robot; of several seeds the first counts for all.

        DuckpilotError for options other than ``pose``, (3,) for all or (N, 3), or where no episode
        can begin.
        """
        poses = start_poses(options, self.num_envs)
        first = seed if seed is None or isinstance(seed, int) else seed[0]
        super().reset(seed=first)
        if first is not None:
            self.world.seed(int(self.np_random.integers(SEEDS)))
        return as_space_member(self.world.reset(poses)), {}

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Carry out one action of each robot for 0.1 s."""
        step = self.world.step(actions)
        ended = {int(i): k for k, i in enumerate(step.finished.robots)}
        infos: dict[str, Any] = {}
        for i, info in enumerate(step_infos(self.world, step)):
            if i in ended:
                last = as_space_member(step.finished.observation, ended[i])
                info = {"final_obs": last, "final_info": info}
            infos = self._add_info(infos, info, i)
        seen = as_space_member(step.observation)
        return seen, step.reward, step.task.terminated, step.task.truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The picture (H, W, 3) uint8 that each robot saw last; None unless ``rgb_array``."""
        return tuple(self.world.feed.newest) if self.render_mode == "rgb_array" else None

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002
        """Free the world."""
        self.world.close()


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
    ``path``, ten angles in [-1, 1] (`robot.navigation.path`).

    ``continuous=True``: Box(-1, 1, (2,)), left and right wheel speed as shares of
    `robot.contract.MAX_WHEEL_MPS`; of a race car, steering and throttle.

    Reward, start and ends: as the task says, see `sim_pybullet.tasks`.

    Info of every step: ``terms`` (reward by name), ``arc_m``, ``offset_m``, ``heading_error_rad``,
    ``progress_m``, ``travelled_m`` (`sim_pybullet.tasks.spec.Course`), ``laps`` or
    ``remaining_m``, ``collided``, ``is_success``; at the end also ``drive``
    (`sim_pybullet.batch.DriveMetrics`).

    Traffic: Discrete(7), the five, slow and stop; the last three frames, (H, W, 9). Track racing:
    Discrete(9), `sim_pybullet.tasks.track_racing.RACING_ACTIONS`; the last four, (H, W, 12).

    Args:
        world: of one robot; it ends with the environment.
        render_mode: ``rgb_array`` lets ``render`` give the picture that the robot saw last;
            ``human`` shows it in a window after every step, ten a second.
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
        self.observation_space = observation_space(world.feed.shape, world.told)
        self.action_space = action_space(world, continuous)
        self._window: Any = None  # matplotlib's picture
        self._seen = np.zeros((*world.feed.shape[:2], 3), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; the same seed begins the same ones.

        ``options``: ``pose``, (x [m], y [m], heading [rad]), where the robot begins; DuckpilotError
        for others, or where no episode can begin.
        """
        poses = start_poses(options, 1)
        super().reset(seed=seed)
        if seed is not None:
            self.world.seed(int(self.np_random.integers(SEEDS)))
        return self._show(self.world.reset(poses)), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out one action for 0.1 s."""
        step = self.world.step(np.asarray(action)[None])
        ended = len(step.finished.robots) > 0
        observation = self._show(step.finished.observation if ended else step.observation)
        ends = bool(step.task.terminated[0]), bool(step.task.truncated[0])
        return observation, float(step.reward[0]), *ends, step_infos(self.world, step)[0]

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
        self._seen = observation.image[0, ..., -3:]  # the newest
        if self.render_mode == "human":
            self._show_in_window()
        return as_space_member(observation, 0)

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
    road_map: Any = (),
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

    MapError: no such map, or not one for this task. ConfigError: no such task or look, or something
    that this task has no use for.
    """
    spec = find_task(task)
    expect_between("world_seed", world_seed, 0, 2**63 - 1)
    expect_between("pool_size", pool_size, 1, 10_000)
    one = isinstance(road_map, str) or not isinstance(road_map or (), Iterable)
    names = [road_map] if one else [*(road_map or ())] or [spec.map]
    chosen = from_plain(Choices, {k: to_plain(v) for k, v in choices.items()}, where=task)
    built = spec.build([spec.load(str(name)) for name in names], robots, chosen)
    return BatchWorld(built, spec.looks(look, pose_error), image, world_seed, pool_size)
