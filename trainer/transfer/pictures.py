"""Folders of pictures, those of labelled frames from the simulator among them, and sheets of them.

Pictures lie in ``image/``, in ``images/image/`` (CamVid), or anywhere in the folder itself; labels,
where there are any, in ``label/`` beside ``image/``. A collection is such a folder of 160x120 PNG
files; a label's grey values are `sim_pybullet.scene.SemanticClass`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from rich.progress import track

from robot.camera.files import picture_files, play, read_picture, write_png
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess
from robot.navigation.road_map import RoadMap
from robot.output import write_yaml
from robot.recording.reader import read_frames
from sim_pybullet.episodes import LookPool
from sim_pybullet.racing.track import SCALE, Track, is_track
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.scene import SemanticClass
from sim_pybullet.scenery.objects import Place, lane_poses
from sim_pybullet.sensing.sensor import apply_sensor
from sim_pybullet.tasks.spec import find_task
from trainer.division import maps_named, refuse_judging_look, refuse_judging_maps
from trainer.run import appearing
from trainer.transfer.cli import Source

_C = SemanticClass
PAINTS = (_C.WHITE_LINE, _C.YELLOW_LINE, _C.RED_LINE, _C.ROAD)
SHEET_ROWS = 6
_ENLARGED, _GAP = 2, 4  # of pictures on a sheet


class Pictures(NamedTuple):
    """Pictures of several folders."""

    images: np.ndarray  # (N, H, W, 3) uint8 RGB
    folder: np.ndarray  # (N,) which folder each comes from
    files: tuple[Path, ...]  # (N,) where all are folders

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count,) indices: every folder as often as every other, however many pictures it has."""
        chosen = rng.integers(self.folder.max() + 1, size=count)
        members = [np.flatnonzero(self.folder == k) for k in range(self.folder.max() + 1)]
        return np.array([rng.choice(members[k]) for k in chosen])


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name; ConfigError if there are none."""
    inner = (folder / "image", folder / "images" / "image")
    return picture_files(next((each for each in inner if each.is_dir()), folder))


def pictures_of(path: Path) -> Iterator[np.ndarray]:
    """Those (H, W, 3) uint8 RGB of a folder, a video or a robot's recording (.mcap).

    DuckpilotError if there is none.
    """
    if path.suffix == ".mcap":
        return (frame for _, frame in read_frames(path))
    return map(read_picture, pictures_in(path)) if path.is_dir() else play(path)


def label_of(picture: Path) -> np.ndarray:
    """The grey values (H, W) uint8 of a picture's label; ConfigError if there is none."""
    path = picture.parent.parent / "label" / f"{picture.stem}.png"
    label = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else None
    if label is None or label.ndim != 2 or label.dtype != np.uint8:
        told = f"{path}: expected the labels of {picture.name}, 8-bit grey, got none; "
        raise ConfigError(f"{told}gather frames with duckpilot collect")
    return np.asarray(label)


def load_pictures(folders: Sequence[Path], image: ImageSpec) -> Pictures:
    """All of `pictures_of` some paths, as a policy's; ConfigError where there are none."""
    found = [[preprocess(fit_to_frame(p), image) for p in pictures_of(path)] for path in folders]
    if empty := [path for path, some in zip(folders, found, strict=True) if not some]:
        raise ConfigError(f"{empty[0]}: expected pictures, got none")
    files = tuple(f for path in folders if path.is_dir() for f in pictures_in(path))
    numbers = np.repeat(range(len(found)), [len(some) for some in found])
    return Pictures(np.stack([each for some in found for each in some]), numbers, files)


def load_paint(pictures: Pictures, image: ImageSpec) -> np.ndarray:
    """How much of each pixel is paint or bare road, for pictures of simulated collections.

    (N, 4, H, W) uint8, 255 is all of it: white, yellow and red lines, road; resized by area.
    """
    if len(pictures.files) != len(pictures.images):
        raise ConfigError("sim: expected folders of duckpilot collect, got a film or recording")
    size, shares = (image.width_px, image.height_px), []
    for label in map(label_of, pictures.files):
        masks = [np.uint8(255) * (label == kind) for kind in PAINTS]
        shares.append([cv2.resize(mask, size, interpolation=cv2.INTER_AREA) for mask in masks])
    return np.array(shares)[:, :, image.crop_top_px :]


def spread(many: int, count: int) -> np.ndarray:
    """(count,) indices, evenly over so many."""
    return np.linspace(0, many - 1, count).astype(int)


def draw_sheet(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write a PNG file of titled columns, each pictures (N, H, W, 3) uint8 RGB of one size."""
    made, around = [], ((0, 0), (0, _GAP), (0, _GAP), (0, 0))
    for name, pictures in columns.items():
        title = np.full((16, pictures.shape[2] * _ENLARGED + _GAP, 3), 255, np.uint8)
        cv2.putText(title, name, (2, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
        large = pictures.repeat(_ENLARGED, 1).repeat(_ENLARGED, 2)
        made.append(np.vstack([title, *np.pad(large, around, constant_values=255)]))
    write_png(path, np.hstack(made))


_BATCH = 32
_OFFSET_M = 0.04  # standard deviations of where a learning robot is in its lane
_OFFSET_TRACK = 0.5  # likewise of a race car, in half-widths of the road
_HEADING_RAD = 0.25
_ASTRAY = 0.1  # share of frames with any heading: robots that have lost their lane see these


def collect(out: Path, source: Source) -> None:
    """Gather frames in a folder that appears when all are there.

    DuckpilotError if ``out`` exists, or a map or look is none to learn from.
    """
    with appearing(out) as folder:
        write_yaml(folder / "collection.yaml", source)
        frames = track(simulated(source), "frames", source.frames, transient=True)
        for number, (frame, label) in enumerate(frames):
            for part, picture in (("image", frame[..., ::-1]), ("label", label)):
                (folder / part).mkdir(exist_ok=True)
                if not cv2.imwrite(str(folder / part / f"{number:06d}.png"), picture):
                    raise OSError(f"{folder}: cannot be written")


def simulated(source: Source) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Robots on random places of lanes or tracks, in randomly drawn looks: frames and labels."""
    spec = find_task("track" if any(map(is_track, source.maps)) else "lane")
    road_maps = [spec.load(name) for name in maps_named(source.maps)]
    refuse_judging_maps(road_maps, "learn")
    refuse_judging_look(source.look, "learn")
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
