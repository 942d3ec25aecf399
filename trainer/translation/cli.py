"""The commands ``collect``, ``traits`` and ``translate``."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from robot.camera.replay import picture_files
from robot.errors import ConfigError
from robot.typed_config import to_plain


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
        out: a folder that does not exist yet; gets image/, and from the simulator label/ and lane/.
        pictures: a folder of pictures, a video or a robot's recording (.mcap); without it the
            simulator is asked.
        map_names: simulator: map or track files, or names of shipped ones; not both kinds.
        look: simulator: a look or a distribution of looks, a file or a shipped name.
        frames: how many at most.
        every: pictures: take one of so many.
        seed: simulator: of everything random.
    """
    from trainer.division import maps_named, refuse_judging_maps
    from trainer.envs import find_looks, load_places
    from trainer.translation.collect import (
        Source,
        collect_pictures,
        collect_simulator,
        pictures_at,
    )

    if frames < 1 or every < 1:
        raise ConfigError(f"frames, every: expected 1 or more, got {frames}, {every}")
    with ExitStack() as stack:

        @cache  # when the first frame is done: no bar beside the line that says what is wrong
        def bar() -> Any:
            return stack.enter_context(tqdm(total=frames, unit="frame", dynamic_ncols=True))

        def tick(count: int) -> None:
            bar().update(count)

        if pictures is not None:
            source = Source("pictures", (str(pictures),), frames, every=every)
            found = collect_pictures(out, pictures_at(pictures, every), source, tick)
        else:
            source, found = Source("simulator", map_names, frames, look, seed), frames
            from sim_pybullet.racing.track import is_track

            task = "track" if any(map(is_track, map_names)) else "lane"
            places = load_places(task, maps_named(map_names))
            refuse_judging_maps(places, "learn")
            looks = find_looks(task, look, None)
            collect_simulator(out, places, looks, source, tick)
    Console(soft_wrap=True).print(f"{out}: {found} frames")
    return 0


def train_command(
    out: Path,
    sim: tuple[Path, ...] = (),
    real: tuple[Path, ...] = (),
    preset_name: Annotated[str, tyro.conf.arg(name="preset")] = "fast",
    generator: str | None = None,
    steps: int | None = None,
    batch: int | None = None,
    structure: float | None = None,
    seed: int = 0,
    resume: bool = False,
) -> int:
    """Train CycleGAN between simulated frames and photographs; leaves both translators as ONNX.

    They are the best of the training by simulated frames held out: those closest to the photographs
    (KID) that keep at least 0.85 of the painted lines.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        sim: collections from the simulator (python -m trainer collect).
        real: folders of photographs; each is drawn from equally often.
        preset_name: fast (80x40), paper (160x120) or debug.
        generator: unet or resnet, in place of the preset's.
        steps: updates, in place of the preset's.
        batch: pictures of each kind in an update, in place of the preset's.
        structure: weight of keeping painted lines in place; 0 is plain CycleGAN.
        seed: of everything random.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    from trainer.run import refuse_run
    from trainer.translation.config import translation_preset
    from trainer.translation.export import export_translators
    from trainer.translation.folder import TranslationFolder
    from trainer.translation.train import train_translation
    from trainer.translation.validation import LANE_OVERLAP, Score

    folder = TranslationFolder(out)
    if resume and folder.config.exists():
        config = folder.load_config()
    else:
        if not sim or not real:
            raise ConfigError("translate train: expected --sim and --real folders, got none")
        config = translation_preset(preset_name, tuple(map(str, sim)), tuple(map(str, real)))
        wanted = {"generator": generator, "steps": steps, "batch": batch, "structure": structure}
        changes = {name: value for name, value in wanted.items() if value is not None}
        config = replace(config, seed=seed, **changes)  # type: ignore[arg-type]
        refuse_run(out)
        for each in (*sim, *real):
            picture_files(each)  # refused before anything is written
        folder.create(config)
    kept, console = train_translation(folder, config), Console(soft_wrap=True)
    score = Score(*kept.score)
    console.print(
        f"kept those of update {kept.steps}: KID {score.kid:.3f}, lanes kept {score.lanes:.3f} "
        f"(at least {LANE_OVERLAP} is due) on frames held out"
    )
    for path in export_translators(folder):
        console.print(str(path))
    return 0


def export_command(run: tyro.conf.Positional[Path]) -> int:
    """Write sim_to_real.onnx and real_to_sim.onnx of a run's checkpoint, checked against torch.

    Args:
        run: its folder.
    """
    from trainer.translation.export import export_translators
    from trainer.translation.folder import TranslationFolder

    for path in export_translators(TranslationFolder(run)):
        Console(soft_wrap=True).print(str(path))
    return 0


def lanes_command(
    out: Path,
    sim: tuple[Path, ...],
    test: tuple[Path, ...] = (),
    preset_name: Annotated[str, tyro.conf.arg(name="preset")] = "fast",
    steps: int = 1000,
    seed: int = 0,
) -> int:
    """Train the network that finds painted lines, by which translations are judged.

    Args:
        out: file to write.
        sim: collections from the simulator to learn from.
        test: others, to test on.
        preset_name: fast or paper, for the size of the pictures.
        steps: updates.
        seed: of everything random.
    """
    from trainer.presets import preset
    from trainer.translation.lanes import (
        lane_masks,
        overlap,
        save_lane_finder,
        train_lane_finder,
        true_masks,
    )
    from trainer.translation.pictures import load_paint, load_pictures

    image = preset("lane", "dueling", preset_name).image
    finder = train_lane_finder(load_pictures(sim, image), image, steps, seed)
    save_lane_finder(out, finder, image)
    said = f"{out}"
    if test:
        pictures = load_pictures(test, image)
        truth = true_masks(load_paint(pictures, image))
        kept = overlap(lane_masks(finder, pictures.images), truth)
        said += f": overlap with painted lines {kept:.3f}"
    Console(soft_wrap=True).print(said)
    return 0


def judge_command(
    model: Path,
    sim: tuple[Path, ...],
    real: tuple[Path, ...],
    lanes: Path | None = None,
    json: Path | None = None,
) -> int:
    """KID, FID and how well a translator sim-to-real keeps painted lines in place.

    Args:
        model: a translator, .onnx.
        sim: collections from the simulator, best none that it was trained with.
        real: folders of photographs.
        lanes: what translate lanes wrote, to find lines with; else they are found by brightness.
        json: write the figures there.
    """
    from robot.inference.translator import OnnxTranslator
    from trainer.run import write_json
    from trainer.translation.bright_lines import bright_lines
    from trainer.translation.judge import FindLines, judge
    from trainer.translation.lanes import lane_masks, load_lane_finder
    from trainer.translation.validation import LANE_OVERLAP

    translator = OnnxTranslator(model)
    find: FindLines = bright_lines
    if lanes is not None:
        find = partial(lane_masks, load_lane_finder(lanes, translator.image))
    found = judge(translator, sim, real, find)
    if json is not None:
        write_json(json, found)
    Console(soft_wrap=True).print(
        f"{model}: lanes kept {found.lanes_kept:.3f} (at least {LANE_OVERLAP} is due), "
        f"KID {found.before.kid:.3f} -> {found.after.kid:.3f} "
        f"(photographs apart {found.photographs_apart.kid:.3f}), "
        f"FID {found.before.fid:.1f} -> {found.after.fid:.1f} ({found.photographs_apart.fid:.1f})"
    )
    return 0


def sheet_command(
    run: tyro.conf.Positional[Path],
    out: Path,
    sim: tuple[Path, ...],
    real: tuple[Path, ...] = (),
    rows: int = 8,
) -> int:
    """Draw input, translation, cycle and, with --real, the nearest photograph, and name it.

    Args:
        run: the folder of a run whose translators were exported.
        out: PNG file to write.
        sim: collections from the simulator.
        real: folders of photographs; without them the sheet shows none.
        rows: how many pictures.
    """
    from robot.inference.translator import DIRECTIONS, OnnxTranslator
    from trainer.translation.folder import TranslationFolder
    from trainer.translation.judge import draw_sheet, even_rows
    from trainer.translation.pictures import load_pictures

    folder = TranslationFolder(run)
    there, back = (OnnxTranslator(folder.onnx(direction)) for direction in DIRECTIONS)
    pictures = even_rows(load_pictures(sim, there.image), rows)
    photographs = load_pictures(real, there.image) if real else None
    nearest = draw_sheet(out, there, back, pictures, photographs)
    for row, file in enumerate(nearest, start=1):
        Console(soft_wrap=True).print(f"row {row}: {file}", markup=False)
    return 0


def traits_command(
    pictures: tyro.conf.Positional[tuple[Path, ...]] = (),
    look: tuple[str, ...] = (),
    frames: int = 100,
    json: Path | None = None,
) -> int:
    """Measure what photographs look like, and looks beside them: colours, noise, blur, light.

    Args:
        pictures: folders of photographs, or collections.
        look: looks or distributions of looks, files or shipped names, drawn from the simulator.
        frames: of each look, and the most of each folder.
        json: write the figures there.
    """
    from trainer.run import write_json
    from trainer.translation.traits import FIGURES, measure_folder, measure_look

    if not pictures and not look:
        raise ConfigError("traits: expected folders of pictures or --look, got neither")
    found = {str(folder): measure_folder(folder, frames) for folder in pictures}
    found.update({name: measure_look(name, frames) for name in look})
    table = Table("", "n", *FIGURES)
    for name, traits in found.items():
        table.add_row(Path(name).name, str(traits.pictures), *traits.figures())
    Console().print(table)
    if json is not None:
        write_json(json, {name: to_plain(traits) for name, traits in found.items()})
    return 0
