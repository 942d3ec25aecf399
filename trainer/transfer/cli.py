"""The commands ``collect``, ``traits`` and ``translate``."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

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
        out: a folder that does not exist yet; gets image/, and from the simulator label/ and lane/.
        pictures: a folder of pictures, a video or a robot's recording (.mcap); without it the
            simulator is asked.
        map_names: simulator: map or track files, or names of shipped ones; not both kinds.
        look: simulator: a look or a distribution of looks, a file or a shipped name.
        frames: how many at most.
        every: pictures: take one of so many.
        seed: simulator: of everything random.
    """
    from sim_pybullet.racing.track import is_track
    from trainer.division import maps_named, refuse_judging_maps
    from trainer.envs import find_looks, load_places
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
            task = "track" if any(map(is_track, map_names)) else "lane"
            places = load_places(task, maps_named(map_names))
            refuse_judging_maps(places, "learn")
            looks = find_looks(task, look, None)
            collect.collect_simulator(out, places, looks, source, tick)
    _say(f"{out}: {frames} frames")
    return 0


def train_command(
    out: Path,
    sim: tuple[Path, ...] = (),
    real: tuple[Path, ...] = (),
    preset_name: Preset = "fast",
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
    from robot.camera.replay import picture_files
    from trainer.run import take_up
    from trainer.transfer.cyclegan import TranslationConfig, translation_preset
    from trainer.transfer.unpaired import export_translators, train_translation
    from trainer.transfer.validation import LANE_OVERLAP

    def fresh() -> TranslationConfig:
        if not sim or not real:
            raise ConfigError("translate train: expected --sim and --real folders, got none")
        config = translation_preset(preset_name, tuple(map(str, sim)), tuple(map(str, real)))
        wanted = {"generator": generator, "steps": steps, "batch": batch, "structure": structure}
        changes = {name: value for name, value in wanted.items() if value is not None}
        for each in (*sim, *real):
            picture_files(each)  # refused before anything is written
        return replace(config, seed=seed, **changes)  # type: ignore[arg-type]

    config = take_up(TranslationConfig, out, resume, fresh)
    best = train_translation(out, config, Console())
    if best.score is not None:
        _say(
            f"kept those of update {best.steps}: KID {best.score.kid:.3f}, "
            f"lanes kept {best.score.lanes:.3f} (at least {LANE_OVERLAP} is due) on frames held out"
        )
    _say(*export_translators(out))
    return 0


def export_command(run: tyro.conf.Positional[Path]) -> int:
    """Write sim_to_real.onnx and real_to_sim.onnx of a run's checkpoint, checked against torch.

    Args:
        run: its folder.
    """
    from trainer.transfer.unpaired import export_translators

    _say(*export_translators(run))
    return 0


def lanes_command(
    out: Path,
    sim: tuple[Path, ...],
    test: tuple[Path, ...] = (),
    preset_name: Preset = "fast",
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
    from trainer.transfer.lanes import save_lane_finder, train_lane_finder
    from trainer.transfer.metrics import any_line, overlap
    from trainer.transfer.pictures import load_paint, load_pictures

    image, said = preset("lane", "dueling", preset_name).image, str(out)
    finder = train_lane_finder(sim, image, steps, seed, Console())
    save_lane_finder(out, finder, image)
    if test:
        pictures = load_pictures(test, image)
        kept = overlap(finder.find(pictures.images), any_line(load_paint(pictures, image)))
        said += f": overlap with painted lines {kept:.3f}"
    _say(said)
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
    from trainer.transfer.judge import FindLines, judge
    from trainer.transfer.lanes import load_lane_finder
    from trainer.transfer.metrics import bright_lines
    from trainer.transfer.validation import LANE_OVERLAP

    translator = OnnxTranslator(model)
    find: FindLines = bright_lines
    if lanes is not None:
        find = load_lane_finder(lanes, translator.image).find
    found = judge(translator, sim, real, find)
    if json is not None:
        write_json(json, found)
    _say(
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
    from trainer.transfer.judge import draw_run

    for row, file in enumerate(draw_run(out, run, sim, real, rows), start=1):
        _say(f"row {row}: {file}")
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
    from trainer.transfer.traits import measure_folder, measure_look

    if not pictures and not look:
        raise ConfigError("traits: expected folders of pictures or --look, got neither")
    found = {str(folder): measure_folder(folder, frames) for folder in pictures}
    found.update({name: measure_look(name, frames) for name in look})
    table = Table("", *next(iter(found.values())).figures())
    for name, traits in found.items():
        table.add_row(Path(name).name, *traits.figures().values())
    Console().print(table)
    if json is not None:
        write_json(json, {name: asdict(traits) for name, traits in found.items()})
    return 0


def _say(*lines: object) -> None:
    for line in lines:
        Console(soft_wrap=True).print(str(line), markup=False)
