"""Drive maps of evaluations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from robot.contract import CONTROL_DT_S
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import NOMINAL
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.tasks.following import HALF_LANE_TILES
from trainer.judging.drive_log import DONE, Track
from trainer.report.curves import save_figure

FLOOR_PX_PER_TILE = 64
PALENESS = 0.6  # of the floor's colours, so that tracks stand out
DEVIATION = LinearSegmentedColormap.from_list("deviation", ["#1f6fb4", "#f0a030", "#c01020"])


def draw_drives(road_maps: Sequence[RoadMap], tracks: Sequence[Track], path: Path) -> None:
    """Write the maps from above with tracks coloured by their distance from the path."""
    columns = min(3, len(road_maps))
    rows = -(-len(road_maps) // columns)
    tallest = max(road_map.height_m / road_map.width_m for road_map in road_maps)
    size = (5.4 * columns, (4.4 * tallest + 0.7) * rows)
    figure = Figure(figsize=size, layout="constrained")
    for index, road_map in enumerate(road_maps):
        axis = figure.add_subplot(rows, columns, index + 1)
        _draw_map(axis, road_map, [t for t in tracks if t.map_index == index])
    save_figure(figure, path)


def tell(track: Track, maps: Sequence[str]) -> str:
    """One line about an episode."""
    seconds, place = (len(track.poses) - 1) * CONTROL_DT_S, Path(maps[track.map_index]).stem
    return (
        f"episode {track.seed} on {place}: {track.end} after {seconds:.1f} s, "
        f"at most {100 * track.deviation_m:.1f} cm from its path"
    )


def _draw_map(axis: Axes, road_map: RoadMap, tracks: Sequence[Track]) -> None:
    extent = (0.0, road_map.width_m, 0.0, road_map.height_m)
    axis.imshow(_floor(road_map), extent=extent, interpolation="bilinear")
    half_lane_cm = 100.0 * HALF_LANE_TILES * road_map.tile_size_m
    lines, offsets_cm = _segments(sorted(tracks, key=lambda track: track.badness))
    drawn = LineCollection(list(lines), cmap=DEVIATION, norm=Normalize(0.0, half_lane_cm))
    drawn.set_array(offsets_cm)
    axis.add_collection(drawn)
    failed = np.array([t.poses[-1, :2] for t in tracks if not t.success])
    if len(failed):
        axis.plot(*failed.T, "X", color="black", markeredgecolor="white", markersize=8)
    axis.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xlabel="x [m]", ylabel="y [m]")
    done = sum(track.success for track in tracks)
    axis.set_title(f"{road_map.name}: {done} of {len(tracks)} {DONE}", fontsize=10)
    bar = axis.figure.colorbar(drawn, ax=axis, shrink=0.75, pad=0.02)
    bar.set_label("distance from the path [cm]; top: edge of the lane", fontsize=8)


def _segments(tracks: Sequence[Track]) -> tuple[np.ndarray, np.ndarray]:
    """(S, 2, 2) [m] and the greater distance from the path at their ends (S,) [cm]."""
    if not tracks:
        return np.zeros((0, 2, 2)), np.zeros(0)
    lines = [np.stack((t.poses[:-1, :2], t.poses[1:, :2]), axis=1) for t in tracks]
    worse = [np.maximum(np.abs(t.offset_m[:-1]), np.abs(t.offset_m[1:])) for t in tracks]
    return np.concatenate(lines), 100.0 * np.concatenate(worse)


def _floor(road_map: RoadMap) -> np.ndarray:
    rgb = paint_ground(road_map, NOMINAL.ground).rgb
    size = (FLOOR_PX_PER_TILE * road_map.columns, FLOOR_PX_PER_TILE * road_map.rows)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(float)
    return np.asarray((1.0 - PALENESS) * small + PALENESS * 255.0).round().astype(np.uint8)
