"""A CycleGAN between the twin's pictures and the recorded ones."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.policy import OnnxTranslator, open_translator
from trainer.run import take_up
from trainer.transfer.cli import Source
from trainer.transfer.cyclegan import TranslationConfig, train_translation
from trainer.transfer.pictures import collect

FRAMES = 640  # of the twin


def twin_to_real(
    recordings: Sequence[Path], image: ImageSpec, out: Path, steps: int, seed: int, console: Console
) -> OnnxTranslator:
    """Learn it, or go on, in the folder of a twin.yaml; ConfigError: another was begun there."""
    folder, sim = out / "cyclegan", out / "cyclegan" / "sim"
    pictures = (str(sim),), tuple(map(str, recordings)), image
    config = TranslationConfig(*pictures, steps=steps, seed=seed)
    if take_up(TranslationConfig, folder, True, lambda: config) != config:
        raise ConfigError(f"{folder}: expected one of these recordings; choose another --out")
    if not sim.exists():
        collect(sim, Source(frames=FRAMES, look=str(out / "twin.yaml"), seed=seed))
    return open_translator(train_translation(folder, config, console), image)
