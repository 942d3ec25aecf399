"""Race tracks: closed centre lines of straights and arcs, as a YAML file or a TORCS track has them.

A ``Track`` is in the metres of a real race track. The simulator builds it at `SCALE`: a road 12 m
wide is then as wide as a Duckietown tile, the robot is as large as a car, and its camera is at the
height of a van driver's eyes. Speeds and distances of the racing task are those of the real track.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from robot.errors import ConfigError, MapError, nearest
from robot.navigation.path import Path
from robot.typed_config import load_yaml, read_yaml

SCALE = 0.05  # metres of the simulated world per metre of a track
TRACKS_DIR = FilePath(__file__).parent.parent / "tracks"
CLOSED_M = 0.01  # the end of a closed track's last segment is so near to the start of its first
SPACING_M = 1.0  # between the points of a centre line
MARGIN_M = 3.0  # of the world beyond the walls
_MOST_GAP = 0.02  # of the length: a larger gap is a mistake in the file
_ROUNDS = 20  # of Newton's method
_STEP = 1e-6  # relative, to take derivatives with


@dataclass(frozen=True)
class Straight:
    """So many metres straight ahead."""

    straight_m: float


@dataclass(frozen=True)
class Arc:
    """A part of a circle."""

    radius_m: float
    angle_deg: float  # positive to the left


Segment = Straight | Arc


@dataclass(frozen=True)
class Track:
    """A closed race track on level ground; it is driven in the order of its segments.

    Raises:
        MapError: a length, a radius or the width is not positive, or there is no segment.
    """

    name: str
    segments: tuple[Segment, ...]
    width_m: float = 12.0  # of the road
    verge_m: float = 4.0  # of the grass on either side, up to the wall

    def __post_init__(self) -> None:
        sizes = [s.straight_m if isinstance(s, Straight) else s.radius_m for s in self.segments]
        if not sizes or min(sizes) <= 0.0 or self.width_m <= 0.0 or self.verge_m <= 0.0:
            raise MapError(
                f"track {self.name}: expected segments, and lengths, radii, width_m and verge_m "
                f"above 0, got {len(sizes)} segments, the smallest {min(sizes, default=0.0)} m, "
                f"width {self.width_m} m, verge {self.verge_m} m"
            )

    @property
    def length_m(self) -> float:
        """Of the centre line."""
        return sum(segment_length_m(segment) for segment in self.segments)

    @property
    def gap_m(self) -> float:
        """From the end of the last segment to the start of the first."""
        x_m, y_m, _ = _end(self.segments)
        return math.hypot(x_m, y_m)


class CentreLine(NamedTuple):
    """A track as the simulated world has it: everything at `SCALE`, the south-west corner at 0."""

    path: Path
    curvature: np.ndarray  # (M,) [1/m] at the path's points, positive to the left
    size_m: tuple[float, float]  # of the world, east-west and south-north
    half_width_m: float  # of the road
    verge_m: float


def segment_length_m(segment: Segment) -> float:
    """Of one segment's centre line."""
    if isinstance(segment, Straight):
        return segment.straight_m
    return segment.radius_m * math.radians(abs(segment.angle_deg))


def shipped_tracks() -> dict[str, FilePath]:
    """The tracks that come with the project, by name."""
    return {path.stem: path for path in sorted(TRACKS_DIR.glob("*.yaml"))}


def is_track(source: str | FilePath) -> bool:
    """Whether this names a track, not a map; what does not exist is none."""
    path = FilePath(source)
    if not path.exists():
        return str(source) in shipped_tracks()
    return path.suffix == ".xml" or "segments" in read_yaml(path)


def load_track(source: str | FilePath) -> Track:
    """A track from a YAML file, a TORCS track (``.xml``), or the name of a shipped one, closed.

    Raises:
        MapError: no such file or name, or a centre line that is far from closed.
        ConfigError: a file that does not hold a track.
    """
    path = FilePath(source)
    if not path.exists():
        shipped = shipped_tracks()
        if str(source) not in shipped:
            raise MapError(f"track {str(source)!r}: no such file; {nearest(str(source), shipped)}")
        path = shipped[str(source)]
    if path.suffix == ".xml":
        from sim_pybullet.racing.torcs import read_torcs  # which builds on this module

        return read_torcs(path)
    return close(load_yaml(Track, path))


def close(track: Track) -> Track:
    """The track with lengths, radii and angles changed as little as its closing takes.

    Newton's method on the end's position and heading with the smallest relative changes (weighted
    least squares: an angle counts ten times as much as a length).

    Raises:
        MapError: the gap is over 2 % of the length, or the turns do not add up to whole circles.
    """
    x_m, y_m, heading_rad = _end(track.segments)
    turns = round(heading_rad / math.tau)
    gap_m, askew_rad = math.hypot(x_m, y_m), heading_rad - turns * math.tau
    if gap_m > _MOST_GAP * track.length_m or abs(askew_rad) > _MOST_GAP * math.tau:
        raise MapError(
            f"track {track.name}: expected a centre line that returns to its start, its end is "
            f"{gap_m:.1f} m away and {math.degrees(askew_rad):.1f} degrees askew; change the "
            "lengths, radii or angles of its segments"
        )
    segments = track.segments
    weights = np.concatenate(
        [[1.0] if isinstance(s, Straight) else [1.0, 0.1] for s in track.segments]
    )
    for _ in range(_ROUNDS):
        error = np.array(_end(segments)) - (0.0, 0.0, turns * math.tau)
        if np.abs(error).max() < 1e-9:
            break
        jacobian = _jacobian(segments)
        weighted = (jacobian * weights**2).T
        segments = _scaled(segments, -weighted @ np.linalg.solve(jacobian @ weighted, error))
    return replace(track, segments=segments)


def mirrored(track: Track) -> Track:
    """The same track with left and right exchanged."""
    segments = tuple(
        segment if isinstance(segment, Straight) else replace(segment, angle_deg=-segment.angle_deg)
        for segment in track.segments
    )
    return replace(track, name=f"{track.name} mirrored", segments=segments)


def centre_line(track: Track) -> CentreLine:
    """The track at `SCALE`, with a point every `SPACING_M` of the real one.

    Raises:
        ConfigError: the track is not closed; `load_track` closes it.
    """
    if track.gap_m > CLOSED_M:
        raise ConfigError(
            f"track {track.name}: expected a closed track, its gap is {track.gap_m:.3f} m; "
            "close it with sim_pybullet.racing.track.close"
        )
    length_m = track.length_m
    count = math.ceil(length_m / SPACING_M)
    arc_m = np.arange(count) * (length_m / count)
    points, headings, curvature = _sample(track.segments, arc_m)
    half_m = 0.5 * track.width_m
    around_m = half_m + track.verge_m + MARGIN_M
    corner = points.min(axis=0) - around_m
    size = (points.max(axis=0) + around_m - corner) * SCALE
    path = Path((points - corner) * SCALE, headings, arc_m * SCALE, True, length_m * SCALE)
    return CentreLine(
        path,
        curvature / SCALE,
        (float(size[0]), float(size[1])),
        half_m * SCALE,
        track.verge_m * SCALE,
    )


def _end(segments: Sequence[Segment]) -> tuple[float, float, float]:
    """Where a drive from the origin along x ends: x, y [m] and the heading turned by [rad]."""
    pose = (0.0, 0.0, 0.0)
    for segment in segments:
        pose = _advance(pose, segment, segment_length_m(segment))
    return pose


def _advance(
    pose: tuple[float, float, float], segment: Segment, way_m: float
) -> tuple[float, float, float]:
    """The pose after ``way_m`` of a segment that begins at ``pose``: the chord of the arc."""
    x_m, y_m, heading_rad = pose
    turn_rad = way_m * _curvature(segment)
    chord_m = way_m * float(np.sinc(0.5 * turn_rad / math.pi))
    along_rad = heading_rad + 0.5 * turn_rad
    return (
        x_m + chord_m * math.cos(along_rad),
        y_m + chord_m * math.sin(along_rad),
        heading_rad + turn_rad,
    )


def _curvature(segment: Segment) -> float:
    if isinstance(segment, Straight):
        return 0.0
    return math.copysign(1.0 / segment.radius_m, segment.angle_deg)


def _scaled(segments: Sequence[Segment], scales: np.ndarray) -> tuple[Segment, ...]:
    """Segments whose numbers are multiplied by 1 + scales."""
    changed: list[Segment] = []
    factors = iter((1.0 + scales).tolist())
    for segment in segments:
        if isinstance(segment, Straight):
            changed.append(Straight(segment.straight_m * next(factors)))
        else:
            changed.append(Arc(segment.radius_m * next(factors), segment.angle_deg * next(factors)))
    return tuple(changed)


def _jacobian(segments: Sequence[Segment]) -> np.ndarray:
    """(3, K) of the end by relative changes of the segments' numbers.

    A segment that changes shifts all that follows, and turns it about the segment's own end.
    """
    x_m, y_m, _ = _end(segments)
    columns, pose = [], (0.0, 0.0, 0.0)
    for segment in segments:
        after = _advance(pose, segment, segment_length_m(segment))
        for k in range(1 if isinstance(segment, Straight) else 2):
            scales = np.zeros(2)
            scales[k] = _STEP
            (changed,) = _scaled((segment,), scales)
            moved = _advance(pose, changed, segment_length_m(changed))
            dx, dy, turned = ((m - a) / _STEP for m, a in zip(moved, after, strict=True))
            columns.append((dx - turned * (y_m - after[1]), dy + turned * (x_m - after[0]), turned))
        pose = after
    return np.array(columns).T


def _sample(
    segments: Sequence[Segment], arc_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (M, 2), headings (M,) in (-pi, pi] and curvatures (M,) at arc lengths (M,)."""
    points, headings = np.zeros((len(arc_m), 2)), np.zeros(len(arc_m))
    curvature = np.zeros(len(arc_m))
    pose, begin_m = (0.0, 0.0, 0.0), 0.0
    for segment in segments:
        end_m = begin_m + segment_length_m(segment)
        for k in np.flatnonzero((arc_m >= begin_m) & (arc_m < end_m)):
            *points[k], headings[k] = _advance(pose, segment, float(arc_m[k]) - begin_m)
            curvature[k] = _curvature(segment)
        pose, begin_m = _advance(pose, segment, end_m - begin_m), end_m
    wrapped = np.pi - (np.pi - headings) % math.tau
    return points, wrapped, curvature
