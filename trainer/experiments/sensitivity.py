"""How far each field of a look may go before a policy fails: one at a time, all others unchanged.

Training looks are ranges, and a robot may lie outside one of them: its camera is mounted by hand.
What policies make of that no mean over a distribution of looks tells.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from robot.errors import ConfigError
from robot.output import write_text
from robot.typed_config import read_yaml, to_plain
from sim_pybullet.randomise import load_look_sampler, look_sampler, looks_of
from trainer.experiments.options import SensitivityOptions
from trainer.options import EvaluateOptions
from trainer.run import read_json
from trainer.sweeps.jobs import EvaluateJob

UNCHANGED = "unchanged"
_DRAWS = 1_000  # of the training looks, to tell how far they reach


class Point(NamedTuple):
    """A look with one field changed."""

    field: str  # group.leaf, or UNCHANGED
    value: Any
    data: dict[str, Any]  # of its YAML file

    @property
    def name(self) -> str:
        """Of its files."""
        return self.field if self.field == UNCHANGED else f"{self.field}_{_text(self.value)}"


def points(options: SensitivityOptions) -> list[Point]:
    """The look as it is, and with each value of each field.

    Raises:
        ConfigError: a folder of looks, an unknown field, or values that are no list.
    """
    files = looks_of(options.look)
    if len(files) != 1:
        raise ConfigError(f"look: expected one file, got {options.look} with {len(files)}")
    base, asked = read_yaml(files[0]) or {}, read_yaml(options.values)
    if not isinstance(asked, dict) or not all(isinstance(v, dict) for v in asked.values()):
        raise ConfigError(f"{options.values}: expected group: {{field: [values]}}, got other YAML")
    found = [Point(UNCHANGED, None, base)]
    for group, leaves in asked.items():
        for leaf, values in leaves.items():
            if not isinstance(values, list) or not values:
                where = f"{options.values}: {group}.{leaf}"
                raise ConfigError(f"{where}: expected a list of values, got {values!r}")
            for value in values:
                data = {**base, group: {**base.get(group, {}), leaf: value}}
                look_sampler(data, str(options.values))
                found.append(Point(f"{group}.{leaf}", value, data))
    return found


def drives(out: Path, options: SensitivityOptions) -> list[EvaluateJob]:
    """An evaluation of each policy at each point; writes the looks into ``out/looks``.

    Raises:
        ConfigError: no policy, two of one name, a look that cannot be, or other looks lie there.
    """
    names = [Path(model).stem for model in options.model]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"model: expected policies of different names, got {names}")
    jobs = []
    for point in points(options):
        look = out / "looks" / f"{point.name}.yaml"
        _keep(look, point.data)
        for model in options.model:
            job = EvaluateOptions(
                model,
                options.task,
                options.map,
                look=str(look),
                pose_error=options.pose_error,
                episodes=options.episodes,
                seed=options.seed,
            )
            jobs.append(EvaluateJob(_figures(out, model, point), job, drives=False))
    return jobs


def table_rows(out: Path, options: SensitivityOptions) -> list[tuple[str, ...]]:
    """Successes at each value, and how far from the path; the first row says what is what.

    Values beyond the training looks are marked with an asterisk.
    """
    episodes = f"of {options.episodes}"
    rows = [("field", "value", *(f"{Path(model).stem}, {episodes}" for model in options.model))]
    beyond = _beyond(options)
    for point in points(options):
        cells = []
        for model in options.model:
            found = read_json(_figures(out, model, point))
            successes = found["episodes"] - len(found["failures"])
            cells.append(f"{successes} ({100 * found['mean_path_distance_m']:.1f} cm)")
        value = "" if point.field == UNCHANGED else _text(point.value) + "*" * beyond(point)
        rows.append((point.field, value, *cells))
    return rows


def _beyond(options: SensitivityOptions) -> Callable[[Point], bool]:
    """Tells of a field's value whether a number of it lies outside all draws for the training."""
    sample, rng = load_look_sampler(options.trained), np.random.default_rng(0)
    drawn = [to_plain(sample(rng)) for _ in range(_DRAWS)]

    def beyond(point: Point) -> bool:
        group, leaf = point.field.split(".")
        values = np.array([look[group][leaf] for look in drawn], dtype=float)
        low, high = values.min(axis=0), values.max(axis=0)
        slack = 0.02 * (high - low)  # the very ends of a range are seldom drawn
        value = np.asarray(point.value, dtype=float)
        return bool(np.any(value < low - slack) or np.any(value > high + slack))

    return beyond


def _figures(out: Path, model: str, point: Point) -> Path:
    return out / Path(model).stem / f"{point.name}.json"


def _keep(path: Path, data: dict[str, Any]) -> None:
    """Write a look, once: figures that lie beside it are of this one and no other."""
    if path.exists():
        if read_yaml(path) != data:
            raise ConfigError(f"{path}: expected the look asked for, got another; choose --out")
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, yaml.safe_dump(data))


def _text(value: Any) -> str:
    return "+".join(map(_text, value)) if isinstance(value, list) else str(value)
