"""Figure 5 of paper B: the way through scene parsing beside domain randomisation, on race tracks.

All drivers learn by the same algorithm and are judged, while they learn, on the same track in the
same look. One learns right there (the paper's "Oracle"), the others on another track in other
looks: seen through a translator into the look of the test, in ten looks, or as it is.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from trainer.experiments.options import Figure5Options
from trainer.options import TrainOptions
from trainer.run import RunFolder
from trainer.sweeps.jobs import TrainJob


class Variant(NamedTuple):
    """A kind of driver."""

    title: str
    at_the_test: bool  # learns where it is judged
    randomised: bool = False
    translated: bool = False


VARIANTS = {  # in the paper's order, the best first
    "oracle": Variant("Oracle", at_the_test=True),
    "translated": Variant("translated through parsing", at_the_test=False, translated=True),
    "dr": Variant("domain randomisation", at_the_test=False, randomised=True),
    "none": Variant("untranslated", at_the_test=False),
}


def translator(out: Path, options: Figure5Options, console: Console) -> Path:
    """The ONNX translator from the training's look into the test's; made where it is missing.

    Raises:
        DuckpilotError: a track or look that does not exist.
    """
    from trainer.envs import find_looks, load_places
    from trainer.parsing.translation_run import TranslationRun, begin, finish
    from trainer.translation.collect import Source, collect_simulator

    path = out / "translator"
    halves = {
        "frames": (options.map, options.look),
        "test_frames": (options.test_map, options.test_look),
    }
    for name, (place, look) in halves.items():
        if not (out / name).exists():
            console.print(f"{out / name}: {options.frames} frames of {place} in {look}")
            source = Source("simulator", (place,), options.frames, look)
            places = load_places("track", (place,))
            looks = find_looks("track", look, None)
            out.mkdir(parents=True, exist_ok=True)
            collect_simulator(out / name, places, looks, source, lambda _: None)
    if (path / "sim_to_real.onnx").exists():
        return path / "sim_to_real.onnx"
    wanted = TranslationRun(
        sim=str(out / "frames"),
        real=str(out / "test_frames"),
        parser="",
        preset=options.preset,
        net="small",
        steps=options.translator_steps,
        seed=0,
        task="track",
        labels="track",
    )
    return finish(path, begin(path, wanted, resume=True), console)


def run_folder(out: Path, variant: str, seed: int) -> RunFolder:
    """Of one training."""
    return RunFolder(out / f"{variant}_{seed}")


def trainings(out: Path, options: Figure5Options, translator: Path) -> list[TrainJob]:
    """All of them, seed by seed, so that every kind has come equally far."""
    return [
        TrainJob(
            run_folder(out, name, seed).path,
            _training(options, variant, seed, translator),
            resume=True,
        )
        for seed in range(options.seeds)
        for name, variant in VARIANTS.items()
    ]


def _training(
    options: Figure5Options, variant: Variant, seed: int, translator: Path
) -> TrainOptions:
    look = options.looks if variant.randomised else options.look
    return TrainOptions(
        task="track",
        algo=options.algo,
        preset=options.preset,
        map=(options.test_map if variant.at_the_test else options.map,),
        steps=options.steps,
        seed=seed,
        look=options.test_look if variant.at_the_test else look,
        translate=str(translator) if variant.translated else None,
        judge_map=(options.test_map,),
        judge_look=options.test_look,
        full=True,
    )
