"""Race tracks: closed centre lines of straights and arcs, as a YAML file has them.

A ``Track`` is in the metres of a real race track. The simulator builds it at `SCALE`: a road 12 m
wide is then as wide as a Duckietown tile, and the robot as large as a car.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from robot.errors import MapError, nearest
from robot.geometry import Pose
from robot.navigation.path import Path
from robot.typed_config import load_yaml, read_yaml

SCALE = 0.05  # metres of the simulated world per metre of a track
TRACKS_DIR = FilePath(__file__).parent.parent / "tracks"
SPACING_M = 1.0  # between the points of a centre line
MARGIN_M = 3.0  # of the world beyond the walls
_MOST_GAP = 0.02  # of the length: a larger gap is a mistake in the file


@dataclass(frozen=True)
class Segment:
    """So many metres straight ahead, or a part of a circle."""

    straight_m: float = 0.0
    radius_m: float = 0.0
    angle_deg: float = 0.0  # of the circle, positive to the left

    @property
    def length_m(self) -> float:
        """Of the centre line."""
        return self.straight_m or self.radius_m * math.radians(abs(self.angle_deg))

    @property
    def curvature(self) -> float:
        """[1/m], positive to the left."""
        return math.copysign(1.0 / self.radius_m, self.angle_deg) if self.radius_m else 0.0


@dataclass(frozen=True)
class Track:
    """A closed race track on level ground, driven in the order of its segments.

    MapError where a length, a radius or the width is not above 0, or there is no segment.
    """

    name: str
    segments: tuple[Segment, ...]
    width_m: float = 12.0  # of the road
    verge_m: float = 4.0  # of the grass on either side, up to the wall

    def __post_init__(self) -> None:
        sizes = [min(s.straight_m + s.radius_m, s.length_m) for s in self.segments]
        sizes += [-1.0 for s in self.segments if s.straight_m and s.radius_m]
        if not sizes or min(sizes) <= 0.0 or self.width_m <= 0.0 or self.verge_m <= 0.0:
            raise MapError(
                f"track {self.name}: expected segments, and lengths, radii, width_m and verge_m "
                f"above 0, got {len(sizes)} segments, the smallest {min(sizes, default=0.0)} m, "
                f"width {self.width_m} m, verge {self.verge_m} m"
            )

    @property
    def length_m(self) -> float:
        """Of the centre line."""
        return sum(segment.length_m for segment in self.segments)


class CentreLine(NamedTuple):
    """A track as the simulated world has it: everything at `SCALE`, the south-west corner at 0."""

    path: Path
    curvature: np.ndarray  # (M,) [1/m] at the path's points, positive to the left
    size_m: tuple[float, float]  # of the world, east-west and south-north
    half_width_m: float  # of the road
    verge_m: float


def shipped_tracks() -> dict[str, FilePath]:
    """The tracks that come with the project, by name."""
    return {path.stem: path for path in sorted(TRACKS_DIR.glob("*.yaml"))}


def is_track(source: str | FilePath) -> bool:
    """Whether this names a track, not a map; what does not exist is none."""
    if (path := FilePath(source)).exists():
        return isinstance(found := read_yaml(path), dict) and "segments" in found
    return str(source) in shipped_tracks()


def load_track(source: str | FilePath) -> Track:
    """A track from a YAML file, or the name of a shipped one, closed.

    MapError if there is none, or it is far from closed; ConfigError for a file of something else.
    """
    path, shipped = FilePath(source), shipped_tracks()
    if not path.exists() and str(source) not in shipped:
        raise MapError(f"track {str(source)!r}: no such file; {nearest(str(source), shipped)}")
    return close(load_yaml(Track, path if path.exists() else shipped[str(source)]))


def close(track: Track) -> Track:
    """The track with its angles, then its lengths and radii changed as little as its closing takes.

    MapError if the gap is over 2 % of the length, or the turns do not add up to whole circles.
    """
    x_m, y_m, _ = _begins(track.segments)[-1]
    heading_rad = math.radians(sum(s.angle_deg for s in track.segments if s.radius_m))
    askew_rad = heading_rad - round(heading_rad / math.tau) * math.tau
    gap_m = math.hypot(x_m, y_m)
    if gap_m > _MOST_GAP * track.length_m or abs(askew_rad) > _MOST_GAP * math.tau:
        raise MapError(
            f"track {track.name}: expected a centre line that returns to its start, its end is "
            f"{gap_m:.1f} m away and {math.degrees(askew_rad):.1f} degrees askew; change the "
            "lengths, radii or angles of its segments"
        )
    if max(gap_m, abs(askew_rad)) < 1e-9:
        return track
    share = math.degrees(askew_rad) / max(sum(abs(s.angle_deg) for s in track.segments), 1e-9)
    eased = [replace(s, angle_deg=s.angle_deg - share * abs(s.angle_deg)) for s in track.segments]
    # Headings are settled now: the end is a sum of vectors, as long as each length or radius.
    ways = np.diff(np.array(_begins(eased))[:, :2], axis=0).T
    scales = 1.0 - np.linalg.lstsq(ways, ways.sum(axis=1), rcond=None)[0]
    segments = tuple(
        replace(s, straight_m=s.straight_m * scale, radius_m=s.radius_m * scale)
        for s, scale in zip(eased, scales.tolist(), strict=True)
    )
    return replace(track, segments=segments)


def mirrored(track: Track) -> Track:
    """The same track with left and right exchanged."""
    segments = tuple(replace(each, angle_deg=-each.angle_deg) for each in track.segments)
    return replace(track, name=f"{track.name} mirrored", segments=segments)


@lru_cache(maxsize=16)
def centre_line(track: Track) -> CentreLine:
    """The track, closed, at `SCALE`, with a point every `SPACING_M` of the real one."""
    track = close(track)
    length_m = track.length_m
    count = math.ceil(length_m / SPACING_M)
    arc_m = np.arange(count) * (length_m / count)
    points, headings, curvature = _sample(track.segments, arc_m)
    half_m = 0.5 * track.width_m
    around_m = half_m + track.verge_m + MARGIN_M
    corner = points.min(axis=0) - around_m
    east_m, north_m = ((points.max(axis=0) + around_m - corner) * SCALE).tolist()
    path = Path((points - corner) * SCALE, headings, arc_m * SCALE, True, length_m * SCALE)
    size_m = (east_m, north_m)
    return CentreLine(path, curvature / SCALE, size_m, half_m * SCALE, track.verge_m * SCALE)


def _begins(segments: Sequence[Segment]) -> list[Pose]:
    """Where each segment of a drive from the origin along x begins, and where the last one ends."""
    poses = [Pose(0.0, 0.0, 0.0)]
    for segment in segments:
        poses.append(poses[-1].moved(segment.length_m, segment.length_m * segment.curvature))
    return poses


def _sample(segments: Sequence[Segment], arc_m: np.ndarray) -> tuple[np.ndarray, ...]:
    """Points (M, 2), headings (M,) in (-pi, pi] and curvatures (M,) at arc lengths (M,)."""
    points, headings = np.zeros((len(arc_m), 2)), np.zeros(len(arc_m))
    curvature, begin_m = np.zeros(len(arc_m)), 0.0
    for segment, pose in zip(segments, _begins(segments), strict=False):
        end_m = begin_m + segment.length_m
        for k in np.flatnonzero((arc_m >= begin_m) & (arc_m < end_m)):
            way_m, curvature[k] = float(arc_m[k]) - begin_m, segment.curvature
            *points[k], headings[k] = pose.moved(way_m, way_m * segment.curvature)
        begin_m = end_m
    return points, headings, curvature
