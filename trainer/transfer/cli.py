"""The commands ``collect`` and ``translate``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from robot.errors import ConfigError

Preset = Annotated[str, tyro.conf.arg(name="preset")]


def collect_command(
    out: Path,
    pictures: Path | None = None,
    map_names: Annotated[tuple[str, ...], tyro.conf.arg(name="map")] = ("loop", "town"),
    look: str = "randomised",
    frames: int = 2000,
    every: int = 1,
    seed: int = 0,
) -> int:
    """Gather frames with their labels from the simulator, or frames from pictures.

    Args:
        out: a folder that does not exist yet; gets image/, and from the simulator label/.
        pictures: a folder of pictures, a video or a robot's recording (.mcap); without it the
            simulator is asked.
        map_names: simulator: map or track files, or names of shipped ones; not both kinds.
        look: simulator: a look or a distribution of looks, a file or a shipped name.
        frames: how many at most.
        every: pictures: take one of so many.
        seed: simulator: of everything random.
    """
    from trainer.transfer import collect

    with Progress(transient=True) as bar:
        row = bar.add_task("frames", total=frames)

        def tick(count: int) -> None:
            bar.advance(row, count)

        if pictures is not None:
            source = collect.Source("pictures", (str(pictures),), frames, every=every)
            found = collect.pictures_at(pictures, every)
            frames = collect.collect_pictures(out, found, source, tick)
        else:
            source = collect.Source("simulator", map_names, frames, look, seed)
            collect.collect_simulator(out, source, tick)
    _say(f"{out}: {frames} frames")
    return 0


def train_command(
    out: Path,
    sim: tuple[Path, ...] = (),
    real: tuple[Path, ...] = (),
    preset_name: Preset = "fast",
    steps: int | None = None,
    structure: float | None = None,
    seed: int = 0,
    resume: bool = False,
) -> int:
    """Train CycleGAN between simulator and photographs; leaves both translators, and sheet.png.

    They are the best of the training by simulated frames held out: those closest to the photographs
    (KID) that keep at least 0.85 of the painted lines.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        sim: collections from the simulator (python -m trainer collect).
        real: folders of photographs; each is drawn from equally often.
        preset_name: fast (80x40), paper (160x120) or debug.
        steps: updates, in place of the preset's.
        structure: weight of keeping painted lines in place; 0 is plain CycleGAN.
        seed: of everything random.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    from robot.camera.replay import picture_files
    from trainer.run import take_up
    from trainer.transfer.cyclegan import TranslationConfig, translation_preset
    from trainer.transfer.unpaired import train_translation
    from trainer.transfer.validation import LANE_OVERLAP

    def fresh() -> TranslationConfig:
        if not sim or not real:
            raise ConfigError("translate train: expected --sim and --real folders, got none")
        config = translation_preset(preset_name, tuple(map(str, sim)), tuple(map(str, real)))
        for each in (*sim, *real):
            picture_files(each)  # refused before anything is written
        return replace(
            config,
            seed=seed,
            steps=config.steps if steps is None else steps,
            structure=config.structure if structure is None else structure,
        )

    config = take_up(TranslationConfig, out, resume, fresh)
    best = train_translation(out, config, Console())
    assert best.score is not None  # the last update is judged
    _say(
        f"{out}: kept those of update {best.steps}: KID {best.score.kid:.3f}, "
        f"lanes kept {best.score.lanes:.3f} (at least {LANE_OVERLAP} is due) on frames held out"
    )
    return 0


def judge_command(
    model: Path,
    sim: tuple[Path, ...],
    real: tuple[Path, ...],
    json: Path | None = None,
) -> int:
    """KID, FID and how well a translator sim-to-real keeps painted lines in place.

    Args:
        model: a translator, .onnx.
        sim: collections from the simulator, best none that it was trained with.
        real: folders of photographs.
        json: write the figures there.
    """
    from robot.inference.translator import OnnxTranslator
    from trainer.run import write_json
    from trainer.transfer.judge import judge
    from trainer.transfer.validation import LANE_OVERLAP

    found = judge(OnnxTranslator(model), sim, real)
    if json is not None:
        write_json(json, found)
    _say(
        f"{model}: lanes kept {found.lanes_kept:.3f} (at least {LANE_OVERLAP} is due), "
        f"KID {found.before.kid:.3f} -> {found.after.kid:.3f} "
        f"(photographs apart {found.photographs_apart.kid:.3f}), "
        f"FID {found.before.fid:.1f} -> {found.after.fid:.1f} ({found.photographs_apart.fid:.1f})"
    )
    return 0


def _say(*lines: object) -> None:
    for line in lines:
        Console(soft_wrap=True).print(str(line), markup=False)
