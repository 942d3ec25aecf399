"""Drive videos: what the robot sees beside where it is on the map."""

from __future__ import annotations

import cv2
import numpy as np

from robot.geometry import Pose

ROBOT_RGB = (255, 70, 160)
TRAIL_RGB = (255, 150, 200)
CAPTION_HEIGHT_PX = 28


class MapView:
    """The floor from above, scaled to a height, with a robot and the trail it left."""

    def __init__(
        self, floor_rgb: np.ndarray, west_m: float, north_m: float, texel_m: float, height_px: int
    ) -> None:
        scale = height_px / floor_rgb.shape[0]
        width_px = round(floor_rgb.shape[1] * scale)
        self.floor = cv2.resize(floor_rgb, (width_px, height_px), interpolation=cv2.INTER_AREA)
        self.px_per_m = scale / texel_m
        self.west_m, self.north_m = west_m, north_m
        self.trail: list[tuple[int, int]] = []

    def pixel(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Where a world point [m] is drawn."""
        column = (x_m - self.west_m) * self.px_per_m
        return round(column), round((self.north_m - y_m) * self.px_per_m)

    def draw(self, pose: Pose) -> np.ndarray:
        """The picture (H, W, 3) with the robot at ``pose``; the trail grows by it."""
        self.trail.append(self.pixel(pose.x_m, pose.y_m))
        picture = self.floor.copy()
        points = np.array(self.trail, dtype=np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [points], False, TRAIL_RGB, 2, cv2.LINE_AA)
        corners = pose.to_world(np.array([[0.11, 0.0], [-0.05, 0.065], [-0.05, -0.065]]))
        outline = np.array([self.pixel(x, y) for x, y in corners], dtype=np.int32)
        cv2.fillConvexPoly(picture, outline, ROBOT_RGB, cv2.LINE_AA)
        return picture


def side_by_side(camera: np.ndarray, above: np.ndarray, caption: str) -> np.ndarray:
    """Camera picture scaled to the map's height, the map, and one line of text below both."""
    height = above.shape[0]
    width = round(camera.shape[1] * height / camera.shape[0])
    view = cv2.resize(camera, (width, height), interpolation=cv2.INTER_CUBIC)
    both = np.concatenate((view, above), axis=1)
    bar = np.full((CAPTION_HEIGHT_PX, both.shape[1], 3), 24, dtype=np.uint8)
    cv2.putText(
        bar, caption, (10, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (235, 235, 235), 1, cv2.LINE_AA
    )
    return even(np.concatenate((both, bar), axis=0))


def even(picture: np.ndarray) -> np.ndarray:
    """Cut to even sides, as H.264 with 4:2:0 colour wants."""
    height, width = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
    return picture[:height, :width]
