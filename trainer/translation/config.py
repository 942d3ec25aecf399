"""What a translation is trained with, and the presets: ``fast``, ``paper``, ``debug``."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.config import choose
from trainer.presets import preset

GENERATORS = {"unet": "U-Net", "resnet": "residual blocks"}


@dataclass(frozen=True)
class TranslationConfig:
    """CycleGAN (Zhu et al. 2017); ``config.yaml`` of a run's folder.

    The preset ``paper`` has its weights and learning rate; ``fast`` is in more of a hurry.
    """

    sim: tuple[str, ...]  # folders of simulated frames with labels
    real: tuple[str, ...]  # folders of photographs
    image: ImageSpec
    generator: str = "unet"
    width: int = 12  # channels of the first layer
    blocks: int = 1  # residual blocks at the narrowest place
    critic_width: int = 16
    critic_layers: int = 2  # that halve; with 2 a patch is 22 px wide, with 3 it is 46
    steps: int = 2_000
    batch: int = 2
    learning_rate: float = 6e-4
    decay_from: float = 0.5  # share of the steps after which the rate falls linearly to 0
    cycle: float = 10.0  # weights of the losses
    identity: float = 1.0
    structure: float = 5.0  # that painted lines stay where they are
    pool: int = 50  # translations that the critics may see again (Shrivastava et al. 2017)
    seed: int = 0
    threads: int = 1
    device: str = "cpu"

    def __post_init__(self) -> None:
        choose("generator", self.generator, GENERATORS)
        if self.steps < 1 or self.batch < 1:
            raise ConfigError(
                f"translation: expected steps and batch from 1, got {self.steps}, {self.batch}"
            )


def translation_preset(name: str, sim: tuple[str, ...], real: tuple[str, ...]) -> TranslationConfig:
    """The named starting point; pictures are those of the policies of the same preset.

    Raises:
        ConfigError: an unknown name, with the nearest known one.
    """
    image = preset("lane", "dueling", name).image
    fast = TranslationConfig(sim, real, image)
    return choose(
        "preset",
        name,
        {
            "fast": fast,
            "paper": replace(
                fast,
                generator="resnet",
                width=32,
                blocks=6,
                critic_width=64,
                critic_layers=3,
                steps=100_000,
                batch=1,
                learning_rate=2e-4,
                identity=5.0,
                device="auto",
            ),
            "debug": replace(fast, width=8, critic_width=8, steps=8, batch=2, pool=4),
        },
    )
