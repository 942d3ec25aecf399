"""The presets ``paper``, ``fast`` and ``debug`` of every task and algorithm.

``paper`` is the network and picture of the Duckiebot paper (Figures 7 and 15), ``fast`` the same
shape for two CPU cores, ``debug`` takes seconds and learns nothing. What a task or an algorithm
changes stands in its own file.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import TypeVar

from robot.contract import ImageSpec
from sim_pybullet.tasks.spec import Changes, find_task
from trainer.algorithms import find_algorithm
from trainer.config import WHOLE_FRAME, EvaluationConfig, NetConfig, RunConfig, expect_one_of

Settings = TypeVar("Settings")

_PAPER_NET = NetConfig((32, 64, 64), image_fc=256, path_fc=(64, 128), head_fc=256)
_FAST_IMAGE = ImageSpec(80, 60, crop_top_px=20)
_DEBUG_NET = NetConfig((4, 4, 4), image_fc=16, path_fc=(8, 8), head_fc=16)


def preset(task: str, algorithm: str, name: str, style: str = "race") -> RunConfig:
    """The named starting point of a run in a style; ConfigError with the nearest if none is so."""
    spec, learn = find_task(task, to_learn=True), find_algorithm(algorithm).learn
    expect_one_of("preset", name, PRESETS)
    run = RunConfig(task, algorithm, "fast", learn, (spec.map,), image=_FAST_IMAGE)
    run = _by_both(run, "fast", task)
    if name != "fast":
        run = _by_both(changed(run, PRESETS[name](run)), name, name)
    return _by_both(replace(run, preset=name, style=style), style, style)


def changed(settings: Settings, changes: Changes) -> Settings:
    """A dataclass with other values, of a nested one those named; ConfigError for no such field."""
    names = [each.name for each in fields(settings)]  # type: ignore[arg-type]
    new = {}
    for key, value in changes.items():
        expect_one_of("preset", key, names)
        new[key] = changed(getattr(settings, key), value) if isinstance(value, Mapping) else value
    return replace(settings, **new)  # type: ignore[type-var]


def _by_both(run: RunConfig, of_task: str, of_algorithm: str) -> RunConfig:
    """As the task's file says of the one name, then as the algorithm's says of the other."""
    changes = dict(find_task(run.task).presets.get(of_task, {}))
    if "learn" in changes:
        wanted = changes["learn"].items()
        changes["learn"] = {key: value for key, value in wanted if hasattr(run.learn, key)}
    run = changed(run, changes)
    return changed(run, find_algorithm(run.algorithm).presets.get(of_algorithm, {}))


def _paper(run: RunConfig) -> Changes:
    learn = {}
    if hasattr(run.learn, "buffer"):
        learn = {"buffer": 20_000 // find_task(run.task).kind.frames}  # 58 kB each, kept twice
    whole = {"image": WHOLE_FRAME, "net": _PAPER_NET, "learn": learn}
    return {**whole, "steps": 2_000_000, "device": "auto"}


def _debug(run: RunConfig) -> Changes:
    channels = _DEBUG_NET.channels[: len(run.net.channels)]
    net = replace(_DEBUG_NET, channels=channels, centred=run.net.centred)
    return {"net": net, "evaluation": EvaluationConfig(episodes=2, every_steps=256), "steps": 512}


PRESETS: Mapping[str, Callable[[RunConfig], Changes]] = {
    "paper": _paper,
    "fast": lambda _: {},
    "debug": _debug,
}
