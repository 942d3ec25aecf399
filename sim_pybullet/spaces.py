"""What the environments share: spaces, observations and infos."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from robot.contract import PATH_POINTS
from robot.errors import ConfigError
from sim_pybullet.batch import BatchStep, BatchWorld, Observation

SEEDS = 2**31


def action_space(world: BatchWorld, continuous: bool = False) -> spaces.Space[Any]:
    """One number per action of the task's vehicle; or any pair of its two speeds, -1 to 1."""
    if continuous:
        return spaces.Box(-1.0, 1.0, (2,), np.float32)
    return spaces.Discrete(len(world.task.vehicle.actions))


def observation_space(world: BatchWorld) -> spaces.Space[Any]:
    """The picture or stacked pictures, with ``path`` beside it in a Dict where the task guides."""
    image = spaces.Box(0, 255, world.image_shape, np.uint8)
    if not world.task.guided:
        return image
    path = spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)
    return spaces.Dict({"image": image, "path": path})


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
        image, path = image[i].copy(), None if path is None else path[i].copy()
    return image if path is None else {"image": image, "path": path}


def newest_picture(image: np.ndarray) -> np.ndarray:
    """The last frame (..., H, W, 3) of stacked ones (..., H, W, 3 F)."""
    return image[..., -3:]


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
