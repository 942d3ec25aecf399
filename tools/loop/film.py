"""A film of the bench: the robot as the monitor's page shows it, and where it truly is."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from robot.geometry import Pose
from tools.loop.bench import Bench
from tools.video import DriveFilm, Moment

EVERY_S = 0.1


class Film:
    """A picture for every ``EVERY_S`` of the time of one bench after the other; ``close`` it.

    Args:
        path: of the video.
        model: the policy that drives.
    """

    def __init__(self, path: Path, model: Path) -> None:
        self._film = DriveFilm(path, model, EVERY_S)
        self._bench: Bench | None = None
        self._due_s = 0.0
        self.close = self._film.close

    def watch(self, bench: Bench) -> None:
        """Take a picture of this bench when it is time."""
        if self._bench is not bench:
            self._bench, self._due_s = bench, bench.now_s
            self._film.turn_to(bench.town.world.scene.ground)
        if bench.now_s < self._due_s or not bench.operator.picture:
            return
        self._due_s += EVERY_S
        if bench.operator.mission.get("phase") != "driving":
            self._film.map.trail.clear()
        self._film.add(moment(bench))


def moment(bench: Bench) -> Moment:
    """The newest report and picture that reached the page, beside the true pose."""
    operator = bench.operator
    encoded = np.frombuffer(operator.picture, np.uint8)
    seen = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR))[..., ::-1]
    robot, mission = operator.robot, operator.mission
    believed = robot.get("pose")
    return Moment(
        seen,
        bench.town.pose,
        Pose(*believed) if believed else None,
        operator.state,
        operator.reason,
        robot.get("path") or (),
        robot.get("values") or (),
        robot.get("action"),
        f"{mission['remaining_m']:.1f} m to drive" if mission else "",
    )
