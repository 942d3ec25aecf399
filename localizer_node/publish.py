"""Poses to robot and monitor, over the project's link."""

from __future__ import annotations

from typing import Tuple

from localizer_node.node import Publish
from localizer_node.track import RobotPose
from robot.link.config import LinkConfig
from robot.link.messages import PoseMessage


def pose_publisher(config: LinkConfig) -> Publish:
    """A function that publishes the poses of one picture.

    Raises:
        ConfigError: the link's keys are absent, or the configuration does not fit.
    """
    publisher = config.publisher(config.open(), PoseMessage)

    def publish(poses: Tuple[RobotPose, ...]) -> None:
        for pose in poses:
            publisher.send(message_of(pose))

    return publish


def message_of(pose: RobotPose) -> PoseMessage:
    """The message that tells this pose."""
    return PoseMessage(
        pose.robot, pose.x_m, pose.y_m, pose.heading_rad, pose.confidence, pose.t_capture_s
    )
