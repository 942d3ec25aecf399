import time

import pytest

from localizer_node.publish import PosePublisher, message_of
from localizer_node.track import RobotPose
from robot.errors import ConfigError
from robot.link.config import LinkConfig
from robot.link.messages import PoseMessage

POSE = RobotPose("robot", 1.0, 2.0, 0.5, 0.3, 0.0, 0.1, 0.9, 42, 12.5)


def test_a_message_tells_the_pose():
    message = message_of(POSE)
    assert (message.robot, message.x_m, message.y_m, message.heading_rad) == (
        "robot",
        1.0,
        2.0,
        0.5,
    )
    assert (message.confidence, message.t_capture_s) == (0.9, 12.5)
    assert PoseMessage.from_bytes(message.to_bytes()) == message


def test_poses_arrive_where_the_robot_listens(configs):
    """Over the encrypted link, from the localizer's keys to the robot's."""
    received = None
    with PosePublisher(configs["localizer"]) as publish, configs["robot"].open() as link:
        subscriber = configs["robot"].subscriber(link, PoseMessage)
        deadline = time.monotonic() + 5.0
        while received is None and time.monotonic() < deadline:
            publish(())
            publish((POSE,))
            time.sleep(0.02)
            received = subscriber.receive()
    assert received is not None
    assert (received.robot, received.x_m, received.heading_rad) == ("robot", 1.0, 0.5)


def test_a_link_without_keys_must_say_so():
    with pytest.raises(ConfigError, match="plaintext"):
        PosePublisher(LinkConfig())
