"""Robots in one picture: blue boards of the right size on the floor, their fronts, their tags.

Coarse to fine: the blue mask of every n-th pixel says where to look; there the full picture is
segmented, and sizes are compared in metres, after the lens and the board's height are undone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from localizer_node.calibration import Calibration, Marker
from localizer_node.colour import Blob, blobs, mask_of, to_hsv
from localizer_node.rectify import Rect, Rectifier
from localizer_node.search import CoarseSearch, Part, bell, clipped, measured, merged, size_fit
from localizer_node.tags import Tag, TagReader

BASELINE_TOLERANCE = 0.25  # relative, between the middles of rear and front
TAG_TOLERANCE = 0.25
MAP_MARGIN_M = 0.05
TAG_SIDE_PX = 48  # smaller tags are enlarged to about this before they are read


@dataclass(frozen=True)
class Detection:
    """One robot in one picture."""

    robot: str  # its name; "" for a blue board whose tag could not be read
    kind: str  # of its marker
    x_m: float  # of the robot's origin; of the board's middle while heading_rad is None
    y_m: float
    heading_rad: Optional[float]
    confidence: float  # 0..1: how well size, shape and distances fit
    u_px: float  # where the board's middle is in the raw picture
    v_px: float


class Detector:
    """Finds the robots of one calibration; holds no state between pictures."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self.rectifier = Rectifier(calibration)
        self._markers = calibration.robots
        self._two_colour = [m for m in self._markers if m.kind == "two_colour"]
        self._tagged = [m for m in self._markers if m.kind == "tag"]
        self._reader = TagReader() if self._tagged else None
        heights = [m.board.height_m for m in self._markers]
        self._board_height_m = float(np.mean(heights)) if heights else 0.0
        self._scales = self._px_per_m()
        self._search = CoarseSearch(calibration, self._scales)
        self._roi = np.array(calibration.roi_px, dtype=np.float32)

    def _px_per_m(self) -> Tuple[float, float]:
        """Least and greatest scale on the map, at the boards' height."""
        size = np.array(self.calibration.map_size_m)
        grid = np.stack(np.meshgrid((0.02, 0.5, 0.98), (0.02, 0.5, 0.98)), axis=-1).reshape(-1, 2)
        pixels = self.rectifier.to_pixels(grid * size, self._board_height_m)
        inverse = np.linalg.inv(self.rectifier.linearised(pixels, self._board_height_m)[1])
        scales = np.linalg.svd(inverse, compute_uv=False)
        return float(np.nanmin(scales)), float(np.nanmax(scales))

    def window_px(self, x_m: float, y_m: float, reach_m: float) -> Rect:
        """The slice of the picture that shows a board within ``reach_m`` of a floor point."""
        corners = np.array([x_m, y_m]) + reach_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        pixels = self.rectifier.to_pixels(corners, self._board_height_m)
        low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
        return clipped(
            self.calibration.lens, (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
        )

    def detect(
        self, image: np.ndarray, regions: Optional[Sequence[Rect]] = None
    ) -> Tuple[Detection, ...]:
        """The robots in an RGB picture (H, W, 3), inside the region of interest or ``regions``.

        A tag without its blue around it is looked for in ``regions`` only: in a whole picture that
        takes longer than all the rest.
        """
        areas = [self.rectifier.roi_rect()] if regions is None else list(regions)
        found: List[Detection] = []
        for window in self._search.windows(image, areas):
            found += self._in_window(image, window)
        for area in regions or ():
            missing = [m for m in self._tagged if m.robot not in {d.robot for d in found}]
            found += self._read_tags(image, area, missing) if missing else []
        return tuple(d for d in found if self._inside(d))

    def _in_window(self, image: np.ndarray, window: Rect) -> List[Detection]:
        u0, v0, u1, v1 = window
        crop = image[v0:v1, u0:u1]
        if crop.size == 0:
            return []
        hsv = to_hsv(crop)
        blue = mask_of(hsv, self.calibration.colour(self.calibration.board_colour))
        rears = self._parts(blobs(crop, blue, self._least_px(0)), window)
        found: List[Detection] = []
        for name in sorted({m.front for m in self._two_colour}):
            colour = self.calibration.colour(name)
            fronts = self._parts(blobs(crop, mask_of(hsv, colour), self._least_px(1)), window)
            for marker in self._two_colour:
                if marker.front == name:
                    found += self._pairs(marker, rears, fronts)
        if self._tagged and len(found) < len(rears):
            for near in merged([self._around(r) for r in rears if self._may_bear_tag(r)]):
                found += self._read_tags(image, near, self._tagged)
        return found + self._bare(rears, found)

    def _least_px(self, part: int) -> float:
        """A third of the area of the smallest rear (0) or front (1) part."""
        areas = [m.blue_m[0] * m.blue_m[1] for m in self._markers]
        if part == 1:
            areas = [m.board.front_m * m.board.width_m for m in self._two_colour]
        return 0.35 * min(areas) * self._scales[0] ** 2

    def _parts(self, found: Sequence[Blob], window: Rect) -> List[Part]:
        if not found:
            return []
        centres = np.array([b.centre_px for b in found]) + window[:2]
        places, jacobians = self.rectifier.linearised(centres, self._board_height_m)
        return [measured(b, p, j, c) for b, p, j, c in zip(found, places, jacobians, centres)]

    def _at_height(self, part: Part, marker: Marker) -> np.ndarray:
        """The part's place for this marker's own board height [m]."""
        camera = np.array(self.calibration.camera_m)
        ratio = (camera[2] - marker.board.height_m) / (camera[2] - self._board_height_m)
        return camera[:2] + (part.centre_m - camera[:2]) * ratio

    def _pairs(
        self, marker: Marker, rears: Sequence[Part], fronts: Sequence[Part]
    ) -> List[Detection]:
        board = marker.board
        found = []
        for rear in rears:
            rear_fit = size_fit(rear, marker.blue_m)
            best: Optional[Tuple[float, Part]] = None
            for front in fronts:
                gap = float(np.linalg.norm(front.centre_m - rear.centre_m))
                error = gap / (board.length_m / 2.0) - 1.0
                if abs(error) > BASELINE_TOLERANCE:
                    continue
                fit = size_fit(front, (board.front_m, board.width_m)) * bell(error, 0.15)
                if fit > 0.0 and (best is None or fit > best[0]):
                    best = (fit, front)
            if best is not None and rear_fit > 0.0:
                found.append(
                    self._two_coloured(marker, rear, best[1], math.sqrt(rear_fit * best[0]))
                )
        return found

    def _two_coloured(
        self, marker: Marker, rear: Part, front: Part, confidence: float
    ) -> Detection:
        share = marker.board.front_m / marker.board.length_m
        back_m, fore_m = self._at_height(rear, marker), self._at_height(front, marker)
        middle = back_m * (1.0 - share) + fore_m * share
        heading = math.atan2(*(fore_m - back_m)[::-1])
        pixel = np.array(rear.centre_px) * (1.0 - share) + np.array(front.centre_px) * share
        return _placed(marker, middle, heading, confidence, pixel)

    def _bare(self, rears: Sequence[Part], named: Sequence[Detection]) -> List[Detection]:
        """Boards of which only the blue is known: no heading, and no name beside tags."""
        found = []
        for rear in rears:
            for marker in self._markers:
                fit = 0.0 if marker.kind == "two_colour" else size_fit(rear, marker.blue_m)
                apart = 0.5 * marker.board.width_m * self._scales[0]
                if fit == 0.0 or any(_distance_px(d, rear) < apart for d in named):
                    continue
                x, y = (float(v) for v in self._at_height(rear, marker))
                name = marker.robot if marker.kind == "plain" else ""
                found.append(Detection(name, marker.kind, x, y, None, fit, *rear.centre_px))
                break
        return found

    def _may_bear_tag(self, rear: Part) -> bool:
        return rear.sides_m[0] > 0.5 * min(min(m.blue_m) for m in self._tagged)

    def _around(self, rear: Part) -> Rect:
        """A window that holds the tag of a board whose blue has this centre."""
        reach = int(1.5 * max(m.board.tag_m for m in self._tagged) * self._scales[1]) + 2
        u, v = (int(c) for c in rear.centre_px)
        return clipped(self.calibration.lens, (u - reach, v - reach, u + reach, v + reach))

    def _read_tags(
        self, image: np.ndarray, window: Rect, markers: Sequence[Marker]
    ) -> List[Detection]:
        if self._reader is None:
            return []
        u0, v0, u1, v1 = window
        side = min(m.board.tag_m for m in self._tagged) * self._scales[0]
        small = (u1 - u0) * (v1 - v0) < 200**2
        zoom = int(np.clip(math.ceil(TAG_SIDE_PX / side), 1, 3)) if small else 1
        found = []
        for tag in self._reader.read(image[v0:v1, u0:u1], zoom):
            for marker in markers:
                if marker.tag == tag.number:
                    found += self._tag(marker, tag, np.array((u0, v0)))
        return found

    def _tag(self, marker: Marker, tag: Tag, offset_px: np.ndarray) -> List[Detection]:
        pixels = tag.corners_px + offset_px
        corners = self.rectifier.to_floor(pixels, marker.board.height_m)
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        errors = sides / marker.board.tag_m - 1.0
        if not np.all(np.abs(errors) < TAG_TOLERANCE):
            return []
        ahead = corners[0] + corners[1] - corners[2] - corners[3]
        heading = math.atan2(ahead[1], ahead[0])
        fit = bell(float(np.abs(errors).max()), TAG_TOLERANCE)
        return [_placed(marker, corners.mean(axis=0), heading, fit, pixels.mean(axis=0))]

    def _inside(self, detection: Detection) -> bool:
        import cv2

        if not self.rectifier.on_map(np.array((detection.x_m, detection.y_m)), MAP_MARGIN_M):
            return False
        if not len(self._roi):
            return True
        return cv2.pointPolygonTest(self._roi, (detection.u_px, detection.v_px), False) >= 0


def _distance_px(detection: Detection, part: Part) -> float:
    return math.hypot(detection.u_px - part.centre_px[0], detection.v_px - part.centre_px[1])


def _placed(
    marker: Marker, middle_m: np.ndarray, heading_rad: float, fit: float, pixel: np.ndarray
) -> Detection:
    """The detection of a robot whose board's middle and heading are known."""
    x = float(middle_m[0]) - marker.board.forward_m * math.cos(heading_rad)
    y = float(middle_m[1]) - marker.board.forward_m * math.sin(heading_rad)
    place = (float(pixel[0]), float(pixel[1]))
    return Detection(marker.robot, marker.kind, x, y, heading_rad, fit, *place)
