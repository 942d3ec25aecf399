"""Robots in one picture: blue boards of the right size on the floor, their fronts, their tags.

Sizes are compared in metres, after the lens and the board's height are undone. Tags are AprilTags
of the 36h11 family, by OpenCV's aruco module (Olson 2011; Garrido-Jurado 2014).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import cv2
import numpy as np

from localizer_node.calibration import Calibration, Marker, map_outline
from localizer_node.colour import Blob, blobs, mask_of


@lru_cache(maxsize=None)
def _detector() -> Any:
    parameters = cv2.aruco.DetectorParameters()
    # Corners lie where lines fitted to the black square's sides meet. On drawn tags of 18 to 28 px,
    # enlarged three times, this came within 0.1 mm and 0.15 degrees RMS at 0.8 ms; the other
    # refinements of OpenCV 4.14 within 0.4 to 1.2 mm and 0.1 to 0.8 degrees.
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    # The board's edge runs close to the tag's, and blur mixes neighbouring cells at their rims.
    parameters.minMarkerDistanceRate = 0.02
    parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return cv2.aruco.ArucoDetector(dictionary, parameters)


def read_tags(image: np.ndarray, zoom: int) -> List[Tuple[int, np.ndarray]]:
    """Number and corners (4, 2), clockwise from the upper left, of tags in an RGB picture (H, W, 3)
    that is enlarged first: small tags are read better so.
    """
    grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    if zoom > 1:
        grey = cv2.resize(grey, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)
    corners, numbers, _ = _detector().detectMarkers(grey)
    places = [(c.reshape(4, 2).astype(float) + 0.5) / zoom - 0.5 for c in corners]
    return [] if numbers is None else list(zip(numbers.ravel().tolist(), places))


def draw_tag(number: int, cell_px: int = 8) -> np.ndarray:
    """The printable tag: (10, 10) cells of ``cell_px`` with its white margin, RGB uint8."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    black = cv2.aruco.generateImageMarker(dictionary, number, 8 * cell_px, borderBits=1)
    return np.repeat(np.pad(black, cell_px, constant_values=255)[..., None], 3, axis=2)


SIZE_TOLERANCE = 0.4  # relative, of each side
FILL_RANGE = (0.75, 1.25)  # area over that of the rectangle with the same second moments
BASELINE_TOLERANCE = 0.25  # relative, between the middles of rear and front
TAG_TOLERANCE = 0.25
MAP_MARGIN_M = 0.05
TAG_SIDE_PX = 48  # smaller tags are enlarged to about this before they are read


@dataclass(frozen=True)
class Detection:
    """One robot in one picture."""

    robot: str  # its name
    kind: str  # of its marker
    x_m: float  # of the robot's origin; of the board's middle while heading_rad is None
    y_m: float
    heading_rad: Optional[float]
    confidence: float  # 0..1: how well size, shape and distances fit
    u_px: float  # where the board's middle is in the raw picture
    v_px: float

    @property
    def pixel(self) -> Tuple[float, float]:
        """(u, v) [px]."""
        return self.u_px, self.v_px


class Part(NamedTuple):
    """A blob as it lies at the height of the boards."""

    centre_m: np.ndarray  # (2,)
    sides_m: Tuple[float, float]  # of the rectangle with the same second moments, longer first
    fill: float  # area over that rectangle's: 1 for a rectangle, 1.05 for a disc, less for an L
    centre_px: Tuple[float, float]


def measured(blob: Blob, centre_m: np.ndarray, jacobian: np.ndarray, centre_px: np.ndarray) -> Part:
    """A blob on the floor, by the derivative (2, 2) [m/px] of pixel to floor at its centre."""
    uu, uv, vv = blob.covariance_px2
    pixel = 1.0 / 12.0  # the variance of a pixel's own width
    covariance = jacobian @ np.array([[uu + pixel, uv], [uv, vv + pixel]]) @ jacobian.T
    values = np.linalg.eigvalsh(covariance)
    short, long = (math.sqrt(12.0 * max(float(v), 1e-12)) for v in values)
    area = blob.area_px * abs(float(np.linalg.det(jacobian)))
    place = (float(centre_px[0]), float(centre_px[1]))
    return Part(centre_m, (long, short), area / (long * short), place)


def bell(error: float, width: float) -> float:
    """1 at no error, 0.6 at ``width``."""
    return math.exp(-0.5 * (error / width) ** 2)


def size_fit(part: Part, expected_m: Sequence[float]) -> float:
    """How well a part has these sides [m] and is a filled rectangle: 1 exactly, 0 beyond doubt."""
    errors = [a / b - 1.0 for a, b in zip(part.sides_m, sorted(expected_m, reverse=True))]
    if max(map(abs, errors)) > SIZE_TOLERANCE or not FILL_RANGE[0] <= part.fill <= FILL_RANGE[1]:
        return 0.0
    return bell(math.hypot(*errors), SIZE_TOLERANCE / 2.0)


class Detector:
    """Finds the robots of one calibration; holds no state between pictures."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        robots = calibration.robots
        kinds = ("plain", "two_colour", "tag")
        self._of = {kind: [m for m in robots if m.kind == kind] for kind in kinds}
        self._board_height_m = float(np.mean([m.board.height_m for m in robots] or [0.0]))
        self._roi = np.array(calibration.roi_px, dtype=np.float32)
        # Least and greatest scale on the map [px/m], at the boards' height.
        size = np.array(calibration.map_size_m)
        grid = np.stack(np.meshgrid((0.02, 0.5, 0.98), (0.02, 0.5, 0.98)), axis=-1).reshape(-1, 2)
        pixels = calibration.to_pixels(grid * size, self._board_height_m)
        inverse = np.linalg.inv(calibration.linearised(pixels, self._board_height_m)[1])
        scales = np.linalg.svd(inverse[np.isfinite(inverse).all((1, 2))], compute_uv=False)
        self._scales = float(scales.min()), float(scales.max())

    def detect(self, image: np.ndarray) -> Tuple[Detection, ...]:
        """The robots in an RGB picture (H, W, 3), inside the region of interest."""
        robots = self.calibration.robots
        if not robots:
            return ()
        u0, v0, u1, v1 = self.calibration.roi_rect()
        crop, corner_px = image[v0:v1, u0:u1], np.array((u0, v0))
        hsv = cv2.cvtColor(np.ascontiguousarray(crop), cv2.COLOR_RGB2HSV)

        def parts(colour: str, areas_m2: Iterable[float]) -> List[Part]:
            mask = mask_of(hsv, self.calibration.colour(colour))
            sizes_px = np.outer(np.square(self._scales), list(areas_m2))
            least_px, most_px = 0.35 * sizes_px.min(), 10.0 * sizes_px.max()  # boards may touch
            return self._parts(blobs(crop, mask, least_px, most_px), corner_px)

        rears = parts(self.calibration.board_colour, (m.blue_m[0] * m.blue_m[1] for m in robots))
        found = [each for marker in self._of["plain"] for each in self._bare(marker, rears)]
        for marker in self._of["two_colour"]:
            boards = [m.board for m in self._of["two_colour"]]
            fronts = parts(marker.front, (b.front_m * b.width_m for b in boards))
            found += self._pairs(marker, rears, fronts)
        found += self._read_tags(image, rears)
        return tuple(filter(self._inside, found))

    def _parts(self, found: Sequence[Blob], corner_px: np.ndarray) -> List[Part]:
        if not found:
            return []
        centres = np.array([b.centre_px for b in found]) + corner_px
        places, jacobians = self.calibration.linearised(centres, self._board_height_m)
        return [measured(b, p, j, c) for b, p, j, c in zip(found, places, jacobians, centres)]

    def _at_height(self, part: Part, marker: Marker) -> np.ndarray:
        """The part's place for this marker's own board height [m]."""
        return self.calibration.camera.to_floor(np.array(part.centre_px), marker.board.height_m)

    def _bare(self, marker: Marker, rears: Sequence[Part]) -> Iterator[Detection]:
        """Plain boards: places without a heading."""
        for rear in rears:
            fit = size_fit(rear, marker.blue_m)
            if fit > 0.0:
                x, y = (float(v) for v in self._at_height(rear, marker))
                yield Detection(marker.robot, marker.kind, x, y, None, fit, *rear.centre_px)

    def _pairs(
        self, marker: Marker, rears: Sequence[Part], fronts: Sequence[Part]
    ) -> Iterator[Detection]:
        """Boards of two colours: each rear with the front that fits best."""
        share = marker.board.front_m / marker.board.length_m
        for rear in rears if fronts else ():
            fits = [_front_fit(marker, rear, front) for front in fronts]
            front, fit = fronts[int(np.argmax(fits))], size_fit(rear, marker.blue_m) * max(fits)
            if fit > 0.0:
                back_m, fore_m = self._at_height(rear, marker), self._at_height(front, marker)
                middle = back_m * (1.0 - share) + fore_m * share
                heading = math.atan2(*(fore_m - back_m)[::-1])
                pixel = np.array(rear.centre_px) * (1.0 - share) + np.array(front.centre_px) * share
                yield _placed(marker, middle, heading, math.sqrt(fit), pixel)

    def _read_tags(self, image: np.ndarray, rears: Sequence[Part]) -> List[Detection]:
        """The tags that lie on or beside blue which is large enough to bear one."""
        if not self._of["tag"]:
            return []
        sides_m = [m.board.tag_m for m in self._of["tag"]]
        least_m = 0.5 * min(min(m.blue_m) for m in self._of["tag"])
        reach = int(1.5 * max(sides_m) * self._scales[1]) + 2
        zoom = int(np.clip(math.ceil(TAG_SIDE_PX / (min(sides_m) * self._scales[0])), 1, 3))
        found: List[Detection] = []  # two boards side by side show each tag twice
        for rear in rears:
            if rear.sides_m[0] <= least_m:
                continue
            left, top = corner_px = [max(int(c) - reach, 0) for c in rear.centre_px]
            window = image[top : top + 2 * reach, left : left + 2 * reach]
            for number, corners_px in read_tags(window, zoom):
                for marker in self._of["tag"]:
                    pixels = corners_px + np.array(corner_px)
                    seen = self._tag(marker, pixels) if number == marker.tag else None
                    if seen and all(math.dist(seen.pixel, other.pixel) > 2.0 for other in found):
                        found.append(seen)
        return found

    def _tag(self, marker: Marker, pixels: np.ndarray) -> Optional[Detection]:
        corners = self.calibration.camera.to_floor(pixels, marker.board.height_m)
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        errors = sides / marker.board.tag_m - 1.0
        if not np.all(np.abs(errors) < TAG_TOLERANCE):
            return None
        ahead = corners[0] + corners[1] - corners[2] - corners[3]
        heading = math.atan2(ahead[1], ahead[0])
        fit = bell(float(np.abs(errors).max()), TAG_TOLERANCE)
        return _placed(marker, corners.mean(axis=0), heading, fit, pixels.mean(axis=0))

    def _inside(self, detection: Detection) -> bool:
        sides = zip((detection.x_m, detection.y_m), self.calibration.map_size_m)
        if not all(-MAP_MARGIN_M <= at <= size_m + MAP_MARGIN_M for at, size_m in sides):
            return False
        return not len(self._roi) or cv2.pointPolygonTest(self._roi, detection.pixel, False) >= 0


def _front_fit(marker: Marker, rear: Part, front: Part) -> float:
    """How well a part has the size of the front and lies as far from the rear as it should."""
    board = marker.board
    error = float(np.linalg.norm(front.centre_m - rear.centre_m)) / (board.length_m / 2.0) - 1.0
    if abs(error) > BASELINE_TOLERANCE:
        return 0.0
    return size_fit(front, (board.front_m, board.width_m)) * bell(error, 0.15)


def _placed(
    marker: Marker, middle_m: np.ndarray, heading_rad: float, fit: float, pixel: np.ndarray
) -> Detection:
    """The detection of a robot whose board's middle and heading are known."""
    x = float(middle_m[0]) - marker.board.forward_m * math.cos(heading_rad)
    y = float(middle_m[1]) - marker.board.forward_m * math.sin(heading_rad)
    return Detection(marker.robot, marker.kind, x, y, heading_rad, fit, *pixel.tolist())


OUTLINE_RGB, FOUND_RGB = (250, 210, 60), (60, 230, 110)
ARROW_M = 0.18


def annotated(
    image: np.ndarray, calibration: Calibration, detections: Iterable[Detection]
) -> np.ndarray:
    """A copy of the raw RGB picture with the map's edge and each robot's place and heading."""
    picture = image.copy()
    edge = np.round(calibration.to_pixels(map_outline(calibration.map_size_m))).astype(np.int32)
    cv2.polylines(picture, [edge.reshape(-1, 1, 2)], True, OUTLINE_RGB, 1, cv2.LINE_AA)
    heights = {m.robot: m.board.height_m for m in calibration.robots}
    for found in detections:
        _draw(picture, calibration, found, heights.get(found.robot, 0.0))
    return picture


def _draw(picture: np.ndarray, calibration: Calibration, found: Detection, height_m: float) -> None:
    start = (round(found.u_px), round(found.v_px))
    cv2.circle(picture, start, 4, FOUND_RGB, 2, cv2.LINE_AA)
    if found.heading_rad is not None:
        ahead = np.array([math.cos(found.heading_rad), math.sin(found.heading_rad)])
        tip = calibration.to_pixels(np.array([found.x_m, found.y_m]) + ARROW_M * ahead, height_m)
        end = (round(float(tip[0])), round(float(tip[1])))
        cv2.arrowedLine(picture, start, end, FOUND_RGB, 2, cv2.LINE_AA, tipLength=0.25)
    degrees = "?" if found.heading_rad is None else f"{math.degrees(found.heading_rad):.0f}"
    label = f"{found.robot} {found.x_m:.2f} {found.y_m:.2f} {degrees}"
    where = (start[0] + 14, start[1] - 14)
    cv2.putText(picture, label, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, label, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, FOUND_RGB, 1, cv2.LINE_AA)
