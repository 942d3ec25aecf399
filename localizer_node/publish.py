"""Poses to robot and monitor, over the project's link."""

from __future__ import annotations

from typing import Tuple

from localizer_node.track import RobotPose
from robot.link.config import LinkConfig
from robot.link.messages import PoseMessage


class PosePublisher:
    """Publishes the poses of each picture; use it as a context, or close it.

    Raises:
        ConfigError: the link's keys are absent, or the configuration does not fit.
    """

    def __init__(self, config: LinkConfig) -> None:
        self._link = config.open()
        self._publisher = config.publisher(self._link, PoseMessage)

    def __call__(self, poses: Tuple[RobotPose, ...]) -> None:
        """Send the poses of one picture; with none, only let new listeners in."""
        self._link.admit()
        for pose in poses:
            self._publisher.send(message_of(pose))

    def __enter__(self) -> PosePublisher:
        return self

    def __exit__(self, *_: object) -> None:
        self._link.close()


def message_of(pose: RobotPose) -> PoseMessage:
    """The message that tells this pose."""
    return PoseMessage(
        pose.robot, pose.x_m, pose.y_m, pose.heading_rad, pose.confidence, pose.t_capture_s
    )
