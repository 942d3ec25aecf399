"""The presets ``paper``, ``fast`` and ``debug`` of every task and algorithm.

``paper`` is the network and picture of the Duckiebot paper (Figures 7 and 15), ``fast`` the same
shape made small enough for two CPU cores, ``debug`` takes seconds and learns nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.config import (
    ALGORITHMS,
    SHAPES,
    TASKS,
    WHOLE_FRAME,
    A2cConfig,
    A3cConfig,
    DaggerConfig,
    EvaluationConfig,
    NetConfig,
    PpoConfig,
    QConfig,
    RunConfig,
    choose,
)

_PAPER_NET = NetConfig((32, 64, 64), image_fc=512, path_fc=(64, 128), head_fc=256)
_FAST_IMAGE = ImageSpec(80, 60, crop_top_px=20)
_TRACK_IMAGE = ImageSpec(48, 36, crop_top_px=4)
_TRACK_STEPS = {PpoConfig: 160_000, DaggerConfig: 16_000}
_DEBUG_NET = NetConfig((4, 4, 4), image_fc=16, path_fc=(8, 8), head_fc=16)


def preset(task: str, algorithm: str, name: str) -> RunConfig:
    """The named starting point of a run.

    Raises:
        ConfigError: an unknown name, with the nearest known one.
    """
    learn = choose("algorithm", algorithm, ALGORITHMS)
    maps = (choose("task", task, TASKS),)
    run = RunConfig(task, algorithm, name, learn, maps, image=_FAST_IMAGE)
    if task == "navigation":
        run = _navigation(run)
    elif task == "track":
        run = _track(run)
    return choose("preset", name, PRESETS)(run)


def cruising(config: RunConfig) -> RunConfig:
    """The run in the style "cruise": what a turn is worth shows at once, and choices stay open.

    With a farther view or less entropy a driver weaves, for which it hardly pays: learned from the
    true road ahead, it held the wheels straight 16 % of the time instead of 50 %. People are not
    always near the middle of the road: cars begin anywhere on it, and under any light.

    Raises:
        ConfigError: the run is not one on tracks.
    """
    if config.task != "track":
        raise ConfigError(f"style: expected race for the task {config.task!r}, got 'cruise'")
    config = replace(config, style="cruise", start_spread=4.0)
    learn = config.learn
    if isinstance(learn, (PpoConfig, A2cConfig, A3cConfig)):
        learn = replace(learn, gamma=0.9, entropy=0.02)
        config = replace(config, entropy_left=0.25)
    if isinstance(learn, PpoConfig):
        learn = replace(learn, learning_rate=1e-3, rollout=64)
    if isinstance(learn, DaggerConfig):
        learn = replace(learn, learning_rate=1e-3, gradient_steps=4, random_share=0.3)
    if not isinstance(learn, A3cConfig):  # whose workers have worlds of their own
        config = replace(config, relit=True)
    if isinstance(learn, (PpoConfig, A2cConfig)):
        config = replace(config, true_path=1.0)
    return replace(config, learn=learn)


def _navigation(run: RunConfig) -> RunConfig:
    """A run uses all its steps, the last ones to settle: few failures are left to learn from."""
    learn = run.learn
    if isinstance(learn, QConfig):
        learn = replace(learn, gamma=0.9, action_gap=0.8, epsilon_steps=10_000)
    steps = 60_000 if isinstance(learn, (PpoConfig, A2cConfig, A3cConfig)) else 24_000
    evaluation = EvaluationConfig(
        episodes=60, rounds=3, every_steps=8_000, every_share=0.25, stop_after_perfect=0
    )
    told = isinstance(learn, (QConfig, PpoConfig, A2cConfig))
    return replace(
        run,
        learn=learn,
        steps=steps,
        evaluation=evaluation,
        start_spread=4.0,
        true_path=1.0 if told else 0.0,
        rate_left=0.03,
    )


def _track(run: RunConfig) -> RunConfig:
    """Pictures reach up to the horizon, where a fast car looks; a reward is worth what it is."""
    # Who begins at rest finds brakes bad. With a small bonus for entropy they are given up before
    # there is speed to need them for; so the bonus begins large, and falls to nothing.
    learn = run.learn
    if isinstance(learn, PpoConfig):
        learn = replace(learn, rollout=32, epochs=4, learning_rate=2e-3)
        learn = replace(learn, gae_lambda=0.95, entropy=0.05)
    if isinstance(learn, A3cConfig):
        learn = replace(learn, robots=4, learning_rate=7e-4, warm_up=30_000)
        learn = replace(learn, entropy=0.2, normalised=True)
    if isinstance(learn, A2cConfig):
        learn = replace(learn, entropy=0.02)  # of rewards of some 0.1 a decision
    if isinstance(learn, (QConfig, DaggerConfig)):
        learn = replace(learn, buffer=20_000)  # 18 kB a stack of pictures, kept twice: 0.7 GB
    if not isinstance(learn, DaggerConfig):
        learn = replace(learn, gamma=0.98)
    return replace(
        run,
        learn=learn,
        image=_TRACK_IMAGE,
        net=NetConfig((16, 32), centred=True),
        reward_scale=1.0,
        steps=_TRACK_STEPS.get(type(learn), 400_000),
        evaluation=EvaluationConfig(episodes=8, every_steps=10_000),
        rate_left=0.1,
        entropy_left=0.0,
    )


def _paper(run: RunConfig) -> RunConfig:
    net = _PAPER_NET if run.task == "lane" else replace(_PAPER_NET, image_fc=256)
    learn = run.learn
    if run.task == "track":
        net = replace(net, channels=(32, 64, 64, 64), centred=True)
    if isinstance(learn, A3cConfig):  # paper B, section 3.1
        learn = replace(learn, robots=1, learning_rate=0.01, rms_decay=0.9, rms_epsilon=0.1)
        learn = replace(learn, entropy=0.02, normalised=False, warm_up=0)
    if isinstance(learn, (QConfig, DaggerConfig)):
        learn = replace(learn, buffer=20_000 // SHAPES[run.task].frames)  # 58 kB each, kept twice
    return replace(run, image=WHOLE_FRAME, net=net, learn=learn, steps=2_000_000, device="auto")


def _debug(run: RunConfig) -> RunConfig:
    small = {"robots": 4}
    if isinstance(run.learn, (QConfig, DaggerConfig)):
        small.update(buffer=1_000, warm_up=64, batch=16)
        if getattr(run.learn, "coach_steps", 0):
            small.update(coach_steps=4_096)
    elif isinstance(run.learn, A3cConfig):
        small.update(robots=1, workers=2)
    elif isinstance(run.learn, PpoConfig):
        small.update(rollout=16, minibatch=32)
    learn = replace(run.learn, **small)  # type: ignore[arg-type]
    evaluation = EvaluationConfig(episodes=2, every_steps=256)
    channels = _DEBUG_NET.channels[: len(run.net.channels)]
    net = replace(_DEBUG_NET, channels=channels, centred=run.net.centred)
    return replace(run, net=net, learn=learn, evaluation=evaluation, steps=512)


PRESETS: Mapping[str, Callable[[RunConfig], RunConfig]] = {
    "paper": _paper,
    "fast": lambda config: config,
    "debug": _debug,
}
