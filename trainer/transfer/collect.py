"""Gathering frames from the simulator with their labels.

A collection is a folder of 160x120 PNG files: ``image/``, and ``label/`` of the same names (grey
value: `sim_pybullet.scene.SemanticClass`).
"""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.navigation.road_map import RoadMap
from robot.typed_config import to_plain
from sim_pybullet.episodes import LookPool
from sim_pybullet.racing.track import SCALE, Track, is_track
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scenery.objects import Place, lane_poses
from sim_pybullet.sensing.sensor import apply_sensor
from sim_pybullet.tasks.spec import find_task
from trainer.division import maps_named, refuse_judging_maps

_BATCH = 32
_OFFSET_M = 0.04  # standard deviations of where a learning robot is in its lane
_OFFSET_TRACK = 0.5  # likewise of a race car, in half-widths of the road
_HEADING_RAD = 0.25
_ASTRAY = 0.1  # share of frames with any heading: robots that have lost their lane see these


@dataclass(frozen=True)
class Source:
    """``collection.yaml``."""

    maps: tuple[str, ...]
    frames: int
    look: str
    seed: int = 0


def collect(out: Path, source: Source, tick: Callable[[], None]) -> None:
    """Gather frames in a folder that appears when all are there, ``tick`` by one.

    DuckpilotError if ``out`` exists, or a map or look is none to learn from.
    """
    with _appearing(out, source) as folder:
        for number, (frame, label) in enumerate(simulated(source)):
            for part, picture in (("image", frame[..., ::-1]), ("label", label)):
                (folder / part).mkdir(exist_ok=True)
                if not cv2.imwrite(str(folder / part / f"{number:06d}.png"), picture):
                    raise OSError(f"{folder}: cannot be written")
            tick()


def simulated(source: Source) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Robots on random places of lanes or tracks, in randomly drawn looks: frames and labels."""
    spec = find_task("track" if any(map(is_track, source.maps)) else "lane")
    road_maps = [spec.load(name) for name in maps_named(source.maps)]
    refuse_judging_maps(road_maps, "learn")
    looks, rng = spec.looks(source.look, None), np.random.default_rng(source.seed)
    pool = LookPool(road_maps, looks, rng, max(2, 48 // len(road_maps)))
    for first in range(0, source.frames, _BATCH):
        seen = snapshots(road_maps, pool, min(_BATCH, source.frames - first), rng)
        yield from zip(*seen, strict=True)


def positions(place: Place, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) poses near the middle of random lanes, or of the road of a track.

    On lanes some of them head anywhere. MapError if the map has no lanes.
    """
    along = lane_poses(place, count, rng)
    offset_m = _OFFSET_M
    if isinstance(place, Track):
        offset_m = _OFFSET_TRACK * 0.5 * place.width_m * SCALE
    offset, turned = rng.normal(0.0, offset_m, count), rng.normal(0.0, _HEADING_RAD, count)
    left = np.stack((-np.sin(along[:, 2]), np.cos(along[:, 2])), axis=1)
    poses = np.column_stack((along[:, :2] + offset[:, None] * left, along[:, 2] + turned))
    if isinstance(place, RoadMap):
        astray = rng.random(count) < _ASTRAY
        poses[astray, 2] = rng.uniform(-np.pi, np.pi, astray.sum())
    return poses


def snapshots(
    road_maps: Sequence[Place], pool: LookPool, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Robots on random places of lanes or tracks, each in a look drawn from the maps' pool.

    Frames (N, 120, 160, 3) uint8 RGB and their labels (N, 120, 160) uint8, `SemanticClass`.
    """
    camera = RayCamera(ImageSpec(), count)
    poses, sensors = np.empty((count, 3)), []
    for i, chosen in enumerate(rng.integers(len(road_maps), size=count).tolist()):
        world, look = pool.draw(chosen, rng)
        camera.set_robot(i, pool.worlds[world].scene, look.rig())
        poses[i] = positions(road_maps[chosen], 1, rng)[0]
        sensors.append(look.sensor)
    return apply_sensor(camera.render(poses), sensors, rng), camera.segment(poses)


@contextmanager
def _appearing(out: Path, source: Source) -> Iterator[Path]:
    """A folder that takes its name once all is in it."""
    if out.exists():
        raise ConfigError(f"{out}: expected no such folder yet, got one; choose another --out")
    unfinished = out.with_name(f".{out.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        unfinished.mkdir(parents=True)
        text = yaml.safe_dump(to_plain(source), sort_keys=False)
        (unfinished / "collection.yaml").write_text(text)
        yield unfinished
        unfinished.rename(out)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
