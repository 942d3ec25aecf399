"""A video of the bench: what the robot sees, what the overhead camera sees, the way on the map."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tools.loop.bench import Bench
from tools.video import MapView, side_by_side
from trainer.mp4 import Mp4

HEIGHT_PX = 400
EVERY_S = 0.1
QUALITY = 5.0
PATH_RGB = (90, 200, 255)
GOAL_RGB = (255, 220, 60)


class Film:
    """A video with a picture for every ``EVERY_S`` of a bench's time; ``close`` it."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._video = Mp4(path, 1.0 / EVERY_S, QUALITY)
        self._bench: Bench | None = None
        self._view: MapView
        self._due_s = 0.0
        self._filmed = False

    def _turn_to(self, bench: Bench) -> None:
        ground = bench.town.world.scene.ground
        self._bench = bench
        self._view = MapView(ground.rgb, ground.west_m, ground.north_m, ground.texel_m, HEIGHT_PX)
        self._due_s = bench.now_s

    def watch(self, bench: Bench) -> None:
        """Take a picture of this bench when it is time."""
        if self._bench is not bench:
            self._turn_to(bench)
        above, operator = bench.town.overhead.picture, bench.operator
        if bench.now_s < self._due_s or above is None or not operator.picture:
            return
        self._due_s += EVERY_S
        encoded = np.frombuffer(operator.picture, np.uint8)
        seen = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR))[..., ::-1]
        width = round(above.shape[1] * HEIGHT_PX / above.shape[0])
        overhead = cv2.resize(above, (width, HEIGHT_PX), interpolation=cv2.INTER_AREA)
        right = np.concatenate((overhead, self._map(bench)), axis=1)
        mission = operator.mission
        left_m = f"{mission['remaining_m']:.1f} m to drive" if mission else ""
        caption = f"{operator.state}: {operator.reason}   {left_m}"
        self._filmed = True
        self._video.add(side_by_side(seen, right, caption))

    def close(self) -> None:
        """Complete the video, if there is anything in it."""
        if self._filmed:
            self._video.close()

    def _map(self, bench: Bench) -> np.ndarray:
        picture = self._view.draw(bench.town.pose)
        robot = bench.operator.robot
        path = [self._view.pixel(*point) for point in robot.get("path") or ()]
        if path:
            points = np.array(path, dtype=np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [points], False, PATH_RGB, 2, cv2.LINE_AA)
            cv2.circle(picture, path[-1], 6, GOAL_RGB, -1, cv2.LINE_AA)
        if bench.operator.mission.get("phase") != "driving":
            self._view.trail.clear()
        return picture
