"""The commands that make and judge policies, each imported with what it needs when it runs."""

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from robot.errors import ConfigError
from trainer.options import EvaluateOptions, SweepOptions, TrainOptions
from trainer.processes import ONE_THREAD
from trainer.sweeps.sweep import run_sweep

EXPORT_ROBOTS = 32
Several = Annotated[SweepOptions, tyro.conf.arg(name="")]


def train_command(
    out: Path,
    options: Annotated[TrainOptions, tyro.conf.arg(name="")],
    many: Several,
    resume: bool = False,
    given: tyro.conf.Suppress[tuple[str, ...]] = (),
) -> int:
    """Train a policy; leaves a run folder with model.onnx, curve.png and metrics.json.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume. With --seeds or --matrix
            the folder of all runs; finished ones are skipped, others go on.
        resume: go on with the run in --out, if there is one, with its own configuration; give its
            options again, or none.
        given: the names of the options that were given.
    """
    from trainer.sweeps.jobs import TrainJob, combinations

    if many.wanted:
        jobs = [TrainJob(out / n, each, resume=True) for n, each in combinations(options, many)]
        return run_sweep(jobs, many, Console(soft_wrap=True))
    if "numba" not in sys.modules:
        os.environ.update(ONE_THREAD)  # other cores are for other processes
    return TrainJob(out, options, resume, given, many).run(Console())


def evaluate_command(
    options: Annotated[EvaluateOptions, tyro.conf.arg(name="")],
    many: Several,
    json: Path | None = None,
    drives: bool = False,
) -> int:
    """Drive an exported policy greedily through whole frames, and count successes.

    Args:
        json: write the figures there. With --seeds or --matrix what is its own is added to each
            name; without --json the files are evaluation_*.json beside the models.
        drives: film the worst that failed or left their lane, beside --json, for report.
    """
    from trainer.judging.judge import judge
    from trainer.sweeps.jobs import evaluate_jobs

    if many.wanted or many.ray is not None:
        return run_sweep(evaluate_jobs(json, options, drives, many), many, Console(soft_wrap=True))
    if drives and json is None:
        raise ConfigError("drives: expected --json FILE, beside which they are kept, got none")
    options.check()
    return judge(json, options, drives, many.workers, Console(soft_wrap=True))


def export_command(
    source: tyro.conf.Positional[str], contract: Path | None = None, out: Path | None = None
) -> int:
    """Write a policy as ONNX, checked against torch: a run's, or one from elsewhere.

    Of a run: model.onnx and model_int8.onnx in its folder, checked on 1,000 frames.

    Args:
        source: a run folder; or a stable-baselines3 zip, a TorchScript file, or MODULE:ATTRIBUTE
            of a torch module. Open none that you do not trust: such files can run code.
        contract: elsewhere: YAML that says what the policy sees and does; a zip says it itself.
        out: elsewhere: the file to write, .onnx; else beside the source.
    """
    console = Console(soft_wrap=True)
    if not Path(source).is_dir() and (Path(source).exists() or ":" in source):
        from trainer.outside import export_outside

        path, difference = export_outside(source, contract, out)
        console.print(f"{path}: differs from torch by at most {difference:.1e}")
        return 0
    if contract is not None or out is not None:
        told = "--contract and --out are for policies from elsewhere only"
        raise ConfigError(f"{source}: expected a file or MODULE:ATTRIBUTE, got neither; {told}")
    from trainer.envs import make_env
    from trainer.export import export_run
    from trainer.run import RunFolder

    folder = RunFolder(Path(source))
    config = replace(folder.load_config(), device="cpu")
    env = make_env(config, EXPORT_ROBOTS, config.seed)
    exported = export_run(folder, config, env)
    env.close()
    console.print(
        f"{folder.onnx}: differs from torch by at most {exported.largest_difference:.1e} over "
        f"{exported.frames} frames; INT8 chooses alike on {exported.int8_same_choice:.1%} of them, "
        "none of which it was calibrated on"
    )
    return 0


def report_command(
    runs: tyro.conf.Positional[tuple[Path, ...]], out: Path = Path("runs/report")
) -> int:
    """Write report.html: summary, films, curves and tables of runs, as far as they have come.

    Args:
        runs: run folders, or folders of run folders.
    """
    if not runs:
        raise ConfigError("report: expected one run folder or more, got none")
    from trainer.report.page import write_report

    Console(soft_wrap=True).print(str(write_report(runs, out)), markup=False)
    return 0


def explain_command(model: Path, images: Path, out: Path) -> int:
    """Show what a policy looks at: its attention laid over pictures, the yellower the more.

    Args:
        model: an ONNX file, a run folder, or a checkpoint in one.
        images: a picture, a folder of pictures, or a video.
        out: folder for the pictures, or the video, and sheet.png.
    """
    from trainer.judging.explain import write_explained

    count = write_explained(model, images, out)
    Console(soft_wrap=True).print(f"{out}: {count} pictures, some of them on sheet.png")
    return 0
