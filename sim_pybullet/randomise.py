"""Domain randomisation: distributions over ``Look``, read from YAML.

A file has the shape of a Look; each leaf is a value or one of ::

    {uniform: [low, high]}      colours: one draw per channel between two colours
    {log_uniform: [low, high]}  for gains, so that halving is as likely as doubling
    {normal: [mean, sd]}        cut off at three standard deviations
    {integer: [low, high]}      both included
    {grey: [low, high, tint]}   a grey, each channel off by at most ``tint``

Absent leaves are nominal. Every leaf can so be switched off by deleting its line.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot.errors import ConfigError, expect_one_of
from robot.typed_config import named_file, read_yaml, to_plain
from sim_pybullet.look import NOMINAL, POSE_ERRORS, Look, look_from_plain

LOOKS_DIR = Path(__file__).parent / "looks"

Sampler = Callable[[np.random.Generator], Look]
# How to draw from a distribution, and the two values between which it draws.
_Draw = tuple[Callable[[np.random.Generator], Any], tuple[Any, Any]]


class Sites(tuple[Sampler, ...]):
    """Several distributions of looks, all as likely, as a sampler."""

    def __call__(self, rng: np.random.Generator) -> Look:
        """A look of any of them."""
        return one_site(self, rng)(rng)


def one_site(sample: Sampler, rng: np.random.Generator) -> Sampler:
    """A sampler all of whose looks are of one place: one of several sites, else itself."""
    return sample[int(rng.integers(len(sample)))] if isinstance(sample, Sites) else sample


def shipped_looks() -> dict[str, Path]:
    """The looks and distributions that come with the project, by name, and folders of looks.

    A look in a folder is named with it, as ``tracks/dusk``.
    """
    files = {path.relative_to(LOOKS_DIR).with_suffix(""): path for path in _looks_in(LOOKS_DIR)}
    folders = {path.parent.relative_to(LOOKS_DIR): path.parent for path in files.values()}
    return {str(name): path for name, path in {**files, **folders}.items() if path != LOOKS_DIR}


def looks_of(source: str | Path) -> list[Path]:
    """The files of a folder of looks; of a file itself; names as of `load_looks`."""
    path = named_file("look", source, shipped_looks())
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

    ConfigError: no such file or name, an unknown key, or a distribution that cannot be drawn.
    """
    path = named_file("look", source, shipped_looks())
    if path.is_dir():
        return Sites(load_look_sampler(file, pose_error, without) for file in _looks_in(path))
    sample = look_sampler(_without(read_yaml(path), without), where=str(path))
    if pose_error is None:
        return sample
    expect_one_of("pose error", pose_error, POSE_ERRORS)
    return lambda rng: replace(sample(rng), pose=POSE_ERRORS[pose_error])


def is_reality(source: str | Path) -> bool:
    """Whether this names a look, or the looks, kept for judging policies."""
    return "reality" in Path(source).parts


def _without(data: Any, names: Sequence[str]) -> Any:
    """Plain data of a Look less these groups, and fields as ``group.field``."""
    groups = to_plain(NOMINAL)
    known = (*groups, *(f"{group}.{leaf}" for group, inner in groups.items() for leaf in inner))
    for name in names:
        expect_one_of("without", name, known)
        group, _, leaf = name.partition(".")
        if isinstance(data, dict) and isinstance(data.get(group), dict):  # else it is refused later
            data = {**data, group: {k: v for k, v in data[group].items() if leaf and k != leaf}}
    return data


def _looks_in(folder: Path) -> list[Path]:
    if not (files := sorted(folder.rglob("*.yaml"))):
        raise ConfigError(f"{folder}: expected looks (.yaml) in this folder, got none")
    return files


def look_sampler(data: Any, where: str = "look") -> Sampler:
    """A sampler from plain data; what does not fit is refused now, not in mid-training.

    ConfigError: an unknown key, a distribution that cannot be drawn, or whose extremes are no Look.
    """
    if not isinstance(data, dict):
        return fixed(look_from_plain(data))
    draws = {
        group: {
            leaf: _prepared(node, f"{where}.{group}.{leaf}")
            for leaf, node in leaves.items()
            if isinstance(node, dict) and len(node) == 1 and next(iter(node)) in _DRAWS
        }
        for group, leaves in data.items()
        if isinstance(leaves, dict)
    }
    for end in (1, 0):  # one of its extremes in the place of every distribution
        extremes = {
            group: {**data[group], **{leaf: ends[end] for leaf, (_, ends) in leaves.items()}}
            for group, leaves in draws.items()
        }
        look = look_from_plain({**data, **extremes})

    def sample(rng: np.random.Generator) -> Look:
        """The look with every leaf drawn that is drawn, in the order of the file."""
        changed = {}
        for group, leaves in draws.items():
            before = getattr(look, group)
            drawn = {k: _like(getattr(before, k), draw(rng)) for k, (draw, _) in leaves.items()}
            changed[group] = replace(before, **drawn)
        return replace(look, **changed)

    return sample


def fixed(look: Look) -> Sampler:
    """The sampler that always gives this Look."""
    return lambda _: look


def _like(before: Any, drawn: Any) -> Any:
    """A value of the kind that a Look has."""
    return tuple(map(float, drawn)) if isinstance(before, tuple) else type(before)(drawn)


def _prepared(node: dict[str, Any], where: str) -> _Draw:
    ((name, arguments),) = node.items()
    try:
        return _DRAWS[name](arguments)
    except (TypeError, ValueError, LookupError, OverflowError) as error:
        raise ConfigError(f"{where}: cannot draw {name}: {arguments!r}: {error}") from error


def _ends(arguments: Any) -> tuple[Any, Any]:
    low, high = (np.asarray(end, dtype=float) for end in arguments)
    if np.any(high < low):
        raise ValueError("expected [low, high]")
    return low.tolist(), high.tolist()


def _uniform(arguments: Any) -> _Draw:
    ends = _ends(arguments)
    return lambda rng: rng.uniform(*ends), ends


def _log_uniform(arguments: Any) -> _Draw:
    ends = _ends(arguments)
    if np.any(np.array(ends) <= 0):
        raise ValueError("expected [low, high], both positive")
    draw, _ = _uniform(np.log(ends))
    return lambda rng: np.exp(draw(rng)).tolist(), ends


def _normal(arguments: Any) -> _Draw:
    mean, sd = (float(v) for v in arguments)
    ends = (mean - 3.0 * sd, mean + 3.0 * sd)
    return lambda rng: mean + sd * min(max(rng.standard_normal(), -3.0), 3.0), ends


def _integer(arguments: Any) -> _Draw:
    low, high = (int(v) for v in _ends(arguments))
    return lambda rng: int(rng.integers(low, high + 1)), (low, high)


def _grey(arguments: Any) -> _Draw:
    low, high, tint = (float(v) for v in arguments)
    if high < low or not 0.0 <= tint <= 255.0:
        raise ValueError("expected [low, high, tint]")

    def draw(rng: np.random.Generator) -> np.ndarray:
        return np.clip(rng.uniform(low, high) + rng.uniform(-tint, tint, 3), 0.0, 255.0)

    return draw, np.clip(np.repeat(((low,), (high,)), 3, axis=1), 0.0, 255.0).tolist()


_DRAWS: dict[str, Callable[[Any], _Draw]] = {
    "uniform": _uniform,
    "log_uniform": _log_uniform,
    "normal": _normal,
    "integer": _integer,
    "grey": _grey,
}
