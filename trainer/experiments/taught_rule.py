"""What a network foretells that learned in simulation to turn as the road ahead does.

No reward, no action and no person's steering: it is taught with the rule of the expert that cruises
(`sim_pybullet.racing.racing_cars`), from single simulated pictures. What it scores on a real drive
says what pictures of a look, translated or not, are worth, apart from what reinforcement learns.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from robot.errors import ConfigError
from robot.geometry import wrap_angle
from robot.inference.preprocess import preprocess_batch
from robot.inference.translator import open_translator
from sim_pybullet.pool import LookPool
from sim_pybullet.racing.racing_cars import ALONG_M, ALONG_RAD
from sim_pybullet.racing.track import SCALE, Track, centre_line, load_track
from trainer.envs import find_looks
from trainer.experiments.driving_pictures import See, Stacks
from trainer.experiments.records import Turn
from trainer.experiments.supervised import TurnNetwork
from trainer.parsing.through_parsing import class_pictures
from trainer.parsing.train import load_parser
from trainer.presets import preset
from trainer.translation.collect import snapshots

TRACKS = ("harbour", "forest", "karting")
PICTURES = 2000
_AT_ONCE = 50
_LOOKS = 10  # drawn of each track


class RoadReader(TurnNetwork):
    """Three convolutions, two fully connected layers, and of a stack the newest picture only.

    The policies' own network, with its large first kernel, learned nothing from ten looks in 400
    such updates.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        """``shape``: (H, W, 3) of one picture."""
        nn.Module.__init__(self)
        layers: list[nn.Module] = []
        for inputs, outputs, kernel in ((3, 16, 5), (16, 32, 5), (32, 32, 3)):
            layers += [nn.Conv2d(inputs, outputs, kernel, 2, kernel // 2), nn.ReLU()]
        self.convolutions: nn.Module = nn.Sequential(*layers)
        flat = self.convolutions(torch.zeros(1, 3, *shape[:2])).numel()
        self.head = nn.Sequential(nn.Linear(flat, 64), nn.ReLU(), nn.Linear(64, len(Turn)))

    def forward(self, stacks: torch.Tensor) -> torch.Tensor:
        """See the class."""
        return super().forward(stacks[..., -3:])


class Views(NamedTuple):
    """Two worlds as a network sees them."""

    simulated: See  # frames of the simulator -> pictures
    real: See  # frames of a recorded drive -> pictures


def lesson(text: str) -> tuple[Stacks, See]:
    """The simulated pictures that ``text`` names with what the rule says to them; the real ones.

    Args:
        text: a look or a folder of looks of tracks: LOOK; LOOK+TRANSLATOR.onnx: translated; or
            LOOK+PARSER.pt: the classes that a parser sees, in the simulator as in reality.

    Raises:
        DuckpilotError: no such look, translator or parser, or one for other pictures.
    """
    look, _, file = text.partition("+")
    simulation, real = views(file)
    tracks = [load_track(name) for name in TRACKS]
    return simulated(tracks, look, PICTURES, simulation, seed=0), real


def views(file: str) -> Views:
    """How both worlds are seen through a translator, a parser, or nothing.

    Raises:
        DuckpilotError: no such file, or one for other pictures or labels.
    """
    image = preset("track", "ppo", "fast").image
    plain = partial(preprocess_batch, spec=image)
    if file.endswith(".pt"):
        parsed = partial(class_pictures, parser=load_parser(Path(file)), image=image)
        return Views(parsed, parsed)
    if not file:
        return Views(plain, plain)
    translator = open_translator(file, image)
    return Views(lambda frames: translator(plain(frames)), plain)


def simulated(tracks: list[Track], look: str, count: int, see: See, seed: int) -> Stacks:
    """Pictures of cars on random places, each four times in its stack, and the rule's turns.

    Raises:
        ConfigError: no such look, or less than one picture.
    """
    if count < 1:
        raise ConfigError(f"pictures: expected 1 or more, got {count}")
    rng = np.random.default_rng(seed)
    pool = LookPool(tracks, find_looks("track", look, None), rng, _LOOKS)
    parts, done = [], []
    for first in range(0, count, _AT_ONCE):
        seen = snapshots(tracks, pool, min(_AT_ONCE, count - first), rng)
        parts.append(see(seen.frames))
        places = zip(seen.poses, seen.road_maps.tolist(), strict=True)
        done += [rule(tracks[number], pose) for pose, number in places]
    return Stacks(np.concatenate(parts), np.arange(count), np.array(done, np.int64), every=0)


def rule(track: Track, pose: np.ndarray) -> Turn:
    """Which way who drives along the road turns at a pose (3,) of the world."""
    path = centre_line(track).path
    arc_m = path.arc_m[np.hypot(*(path.points_m - pose[:2]).T).argmin()]
    ahead = path.pose_at((arc_m + ALONG_M * SCALE) % path.length_m)[2]
    left = float(wrap_angle(ahead - pose[2]))
    if abs(left) <= ALONG_RAD:
        return Turn.STRAIGHT
    return Turn.LEFT if left > 0.0 else Turn.RIGHT
