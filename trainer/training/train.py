"""A training from beginning to end, or from where it was cut off."""

import shutil
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

import numba
import torch
from rich.console import Console
from stable_baselines3.common.logger import configure

from robot.output import write_json
from trainer.algorithms import EnvMaker, Making, find_algorithm
from trainer.config import RunConfig
from trainer.export import export_weights
from trainer.learners.world import learning_world
from trainer.processes import LocalProcesses, Processes
from trainer.report.curves import draw_curve
from trainer.run import EpisodeLog, RunFolder
from trainer.training.checkpoint import Evaluated, TrainState, read_state
from trainer.training.crew import Crew, share_of
from trainer.training.watch import Watch


@dataclass(frozen=True)
class Metrics:
    """``metrics.json``."""

    train_seconds: float  # wall clock, evaluations included
    evaluation_seconds: float
    cpu_seconds: float  # of the process, all threads, evaluations included
    train_steps: int
    episodes: int
    success_rate: float  # of the kept policy, on its evaluation
    stopped_by: str
    seed: int
    evaluations: tuple[Evaluated, ...]
    schema: int = 1


def train(
    config: RunConfig,
    folder: RunFolder,
    make_env: EnvMaker,
    console: Console,
    launcher: Processes | None = None,
) -> Metrics:
    """Train until the steps, the seconds or the task are done; go on from a checkpoint if any.

    Leaves `RunFolder`'s files. An interrupted run keeps its replay buffer and can go on. The
    launcher starts the other processes of a run of several.
    DuckpilotError: ``make_env`` refuses the configuration; then nothing was written.
    """
    torch.set_num_threads(config.threads)
    if config.workers > 1:
        numba.set_num_threads(1)  # the other processes have the other cores
    own = share_of(config, rank=0)
    with ExitStack() as closing:
        drivers = -(-config.evaluation.episodes // config.evaluation.rounds)
        # first of all: while the others make their worlds, this process does
        crew = Crew(config, make_env, folder.path, launcher or LocalProcesses())
        closing.callback(crew.close)
        judging_env = make_env(judged(config), drivers, config.seed)
        closing.callback(judging_env.close)
        algorithm = find_algorithm(config.algorithm)
        env = learning_world(own, make_env)
        closing.callback(env.close)
        folder.go_on(config)
        model = algorithm.build(Making(own, env, folder, make_env, console))
        state = TrainState()
        if folder.checkpoint.exists():
            state = read_state(folder.checkpoint, model)
            state.stopped_by = ""
            model.set_random_seed(own.seed + model.num_timesteps)
        model.set_logger(configure(str(folder.tensorboard), ["tensorboard"]))
        closing.callback(model.logger.close)
        log = EpisodeLog(folder, model.num_timesteps * config.workers)
        closing.callback(log.file.close)
        watch = Watch(config, folder, state, log, judging_env, console, crew)
        watch.init_callback(model)
        closing.enter_context(watch.bar)
        with _stop_on_signal(state):
            steps = max(0, own.steps - model.num_timesteps)
            crew.learn(model, steps, watch, stopped=lambda: bool(state.stopped_by))
            crew.close()
        state.stopped_by = state.stopped_by or "steps"
        return _finish(config, folder, watch, log.count)


def judged(config: RunConfig) -> RunConfig:
    """The run in whose world the greedy driving between updates takes place."""
    elsewhere = config.evaluation
    config = replace(config, start_spread=1.0, maps=elsewhere.maps or config.maps, device="cpu")
    if not elsewhere.look:
        return config
    return replace(config, look=elsewhere.look, translate=None, without=())


def _finish(config: RunConfig, folder: RunFolder, watch: Watch, episodes: int) -> Metrics:
    """Leave the files; an interrupted run has no model and no metrics yet."""
    state, steps = watch.state, watch.steps
    reason, interrupted = state.stopped_by, state.stopped_by == "interrupted"
    last = state.evaluations[-1].step if state.evaluations else -1
    if not interrupted and last != steps:
        watch.evaluate()
        state.stopped_by = reason
    watch.save()
    draw_curve(folder, config)
    metrics = Metrics(
        train_seconds=state.seconds,
        evaluation_seconds=state.evaluation_seconds,
        cpu_seconds=state.cpu_seconds,
        train_steps=steps,
        episodes=episodes,
        success_rate=state.best.success_rate if state.best else float("nan"),
        stopped_by=reason,
        seed=config.seed,
        evaluations=state.evaluations,
    )
    if not interrupted:
        export_weights(folder, config, folder.best, folder.onnx)
        write_json(folder.metrics, metrics)
        shutil.rmtree(folder.replay, ignore_errors=True)  # a finished run has no more use for it
    return metrics


@contextmanager
def _stop_on_signal(state: TrainState) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the run at the next step instead of in the middle of one."""

    def ask_to_stop(*_: object) -> None:
        state.stopped_by = "interrupted"

    with ExitStack() as caught:
        for number in (signal.SIGINT, signal.SIGTERM):
            caught.callback(signal.signal, number, signal.signal(number, ask_to_stop))
        yield
