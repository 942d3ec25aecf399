"""Poses to robot and monitor, over the project's link."""

from __future__ import annotations

from typing import Tuple

from localizer_node.track import RobotPose
from robot.link.config import LinkConfig
from robot.link.messages import PosesMessage, Sighting


class PosePublisher:
    """Publishes the poses of each picture; use it as a context, or close it.

    Raises:
        ConfigError: the link's keys are absent, or the configuration does not fit.
    """

    def __init__(self, config: LinkConfig) -> None:
        self._link = config.open()
        self._publisher = config.publisher(self._link, PosesMessage)

    def __call__(self, poses: Tuple[RobotPose, ...]) -> None:
        """Send the poses of one picture; with none, only let new listeners in."""
        self._link.admit()
        if poses:
            self._publisher.send(message_of(poses))

    def __enter__(self) -> PosePublisher:
        return self

    def __exit__(self, *_: object) -> None:
        self._link.close()


def message_of(poses: Tuple[RobotPose, ...]) -> PosesMessage:
    """The message that tells the poses of one picture, of which there is at least one."""
    seen = tuple(Sighting(p.robot, p.x_m, p.y_m, p.heading_rad, p.confidence) for p in poses)
    return PosesMessage(seen, poses[0].t_capture_s)
