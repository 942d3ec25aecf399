"""Domain randomisation: distributions over ``Look``, read from YAML.

A file has the shape of a Look; each leaf is a value or one of ::

    {uniform: [low, high]}      colours: one draw per channel between two colours
    {log_uniform: [low, high]}  for gains, so that halving is as likely as doubling
    {normal: [mean, sd]}        cut off at three standard deviations
    {choice: [a, b, ...]}
    {integer: [low, high]}      both included
    {grey: [low, high, tint]}   a grey, each channel off by at most ``tint``

Absent leaves are nominal. Every leaf can so be switched off by deleting its line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot.errors import ConfigError, nearest
from robot.typed_config import read_yaml, to_plain
from sim_pybullet.look import NOMINAL, POSE_ERRORS, Look, look_from_plain

LOOKS_DIR = Path(__file__).parent / "looks"

Sampler = Callable[[np.random.Generator], Look]


@dataclass(frozen=True)
class Sites:
    """Several distributions of looks, all as likely, as a sampler."""

    sites: tuple[Sampler, ...]

    def __call__(self, rng: np.random.Generator) -> Look:
        """A look of any of them."""
        return one_site(self, rng)(rng)


def one_site(sample: Sampler, rng: np.random.Generator) -> Sampler:
    """A sampler all of whose looks are of one place: one of several sites, else itself."""
    if isinstance(sample, Sites):
        return one_site(sample.sites[int(rng.integers(len(sample.sites)))], rng)
    return sample


def shipped_looks() -> dict[str, Path]:
    """The looks and distributions that come with the project, by name, and folders of looks.

    A look in a folder is named with it, as ``tracks/dusk``.
    """
    files = {path.relative_to(LOOKS_DIR).with_suffix(""): path for path in _looks_in(LOOKS_DIR)}
    folders = {path.parent.relative_to(LOOKS_DIR): path.parent for path in _looks_in(LOOKS_DIR)}
    return {str(name): path for name, path in {**files, **folders}.items() if path != LOOKS_DIR}


def looks_of(source: str | Path) -> list[Path]:
    """The files of a folder of looks; of a file itself; names as of `load_looks`."""
    path = _find(source)
    return _looks_in(path) if path.is_dir() else [path]


def load_looks(
    source: str | Path, pose_error: str | None = None, without: Sequence[str] = ()
) -> list[Look] | Sampler:
    """As `load_look_sampler`, but files without distributions are listed: one, or a folder's."""
    samplers = [load_look_sampler(file, pose_error, without) for file in looks_of(source)]
    first, again = ([s(np.random.default_rng(k)) for s in samplers] for k in (0, 1))
    return first if first == again else load_look_sampler(source, pose_error, without)


def load_look_sampler(
    source: str | Path, pose_error: str | None = None, without: Sequence[str] = ()
) -> Sampler:
    """A sampler of Looks from YAML files, or from the names of shipped ones.

    Args:
        source: file or name; of a folder any of its files, all as likely.
        pose_error: a name in `sim_pybullet.look.POSE_ERRORS`; without it the Look's own.
        without: what stays nominal, ``group`` or ``group.field``.

    Raises:
        ConfigError: no such file or name, an unknown key, or a distribution that cannot be drawn.
    """
    path = _find(source)
    if path.is_dir():
        files = _looks_in(path)
        return Sites(tuple(load_look_sampler(file, pose_error, without) for file in files))
    sample = look_sampler(_without(read_yaml(path), without), where=str(path))
    if pose_error is None:
        return sample
    if pose_error not in POSE_ERRORS:
        raise ConfigError(f"pose error: unknown {pose_error!r}; {nearest(pose_error, POSE_ERRORS)}")
    pose = POSE_ERRORS[pose_error]
    return lambda rng: replace(sample(rng), pose=pose)


def is_reality(source: str | Path) -> bool:
    """Whether this names a look, or the looks, kept for judging policies."""
    return "reality" in Path(source).parts


def look_fields() -> tuple[str, ...]:
    """What ``without`` may name: every group of a Look, and every field as ``group.field``."""
    groups = to_plain(NOMINAL)
    leaves = [f"{group}.{leaf}" for group, inner in groups.items() for leaf in inner]
    return (*groups, *leaves)


def _without(data: Any, names: Sequence[str]) -> Any:
    """Plain data of a Look less these groups and fields."""
    for name in names:
        if name not in look_fields():
            raise ConfigError(f"without: unknown {name!r}; {nearest(name, look_fields())}")
        group, _, leaf = name.partition(".")
        inner = data.get(group, {})
        kept = {key: value for key, value in inner.items() if leaf and key != leaf}
        data = {**data, group: kept}
    return data


def _looks_in(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.yaml"))


def _find(source: str | Path) -> Path:
    path = Path(source)
    if path.exists():
        return path
    shipped = shipped_looks()
    if str(source) not in shipped:
        raise ConfigError(f"look {str(source)!r}: no such file; {nearest(str(source), shipped)}")
    return shipped[str(source)]


def look_sampler(data: Any, where: str = "look") -> Sampler:
    """A sampler from plain data; draws once to refuse what does not fit now, not mid-training."""

    def sample(rng: np.random.Generator) -> Look:
        return look_from_plain(_draw(data, rng, where))

    sample(np.random.default_rng(0))
    return sample


def fixed(look: Look) -> Sampler:
    """The sampler that always gives this Look."""
    return lambda _: look


def _draw(node: Any, rng: np.random.Generator, where: str) -> Any:
    if not isinstance(node, dict):
        return node
    if len(node) == 1:
        (name, arguments), *_ = node.items()
        if name in _DRAWS:
            try:
                return _DRAWS[name](rng, arguments)
            except (TypeError, ValueError, IndexError, KeyError) as error:
                raise ConfigError(f"{where}: cannot draw {name}: {arguments!r}: {error}") from error
    return {key: _draw(value, rng, f"{where}.{key}") for key, value in node.items()}


def _uniform(rng: np.random.Generator, arguments: Any) -> Any:
    low, high = np.asarray(arguments[0], dtype=float), np.asarray(arguments[1], dtype=float)
    if len(arguments) != 2 or np.any(high < low):
        raise ValueError("expected [low, high]")
    return np.asarray(rng.uniform(low, high)).tolist()


def _log_uniform(rng: np.random.Generator, arguments: Any) -> Any:
    low, high = np.asarray(arguments[0], dtype=float), np.asarray(arguments[1], dtype=float)
    if len(arguments) != 2 or np.any(low <= 0) or np.any(high < low):
        raise ValueError("expected [low, high], both positive")
    return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high)))).tolist()


def _normal(rng: np.random.Generator, arguments: Any) -> float:
    mean, sd = (float(v) for v in arguments)
    return mean + sd * float(np.clip(rng.standard_normal(), -3.0, 3.0))


def _choice(rng: np.random.Generator, arguments: Any) -> Any:
    if not arguments:
        raise ValueError("expected at least one value")
    return arguments[int(rng.integers(len(arguments)))]


def _integer(rng: np.random.Generator, arguments: Any) -> int:
    low, high = (int(v) for v in arguments)
    return int(rng.integers(low, high + 1))


def _grey(rng: np.random.Generator, arguments: Any) -> list[float]:
    low, high, tint = (float(v) for v in arguments)
    channels = rng.uniform(low, high) + rng.uniform(-tint, tint, 3)
    return np.clip(channels, 0.0, 255.0).tolist()


_DRAWS: dict[str, Callable[[np.random.Generator, Any], Any]] = {
    "uniform": _uniform,
    "log_uniform": _log_uniform,
    "normal": _normal,
    "choice": _choice,
    "integer": _integer,
    "grey": _grey,
}
