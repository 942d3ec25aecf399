import time
from contextlib import ExitStack

import pytest

from localizer_node.__main__ import publisher
from robot.errors import ConfigError
from robot.link.freshness import PoseGate
from robot.link.messages import PosesMessage, Sighting
from robot.link.sockets import LinkConfig, Subscriber
from robot.typed_config import from_plain

POSE = Sighting("robot", 1.0, 2.0, 0.5, 0.9)
OTHER = Sighting("other", 0.4, 0.6, None, 0.8)


def test_a_message_tells_the_poses_of_a_picture():
    message = PosesMessage((POSE, OTHER), 12.5)
    assert PosesMessage.from_bytes(message.to_bytes()) == message
    told = message.of("robot")
    assert (told.x_m, told.y_m, told.heading_rad, told.confidence) == (1.0, 2.0, 0.5, 0.9)
    assert told.t_capture_s == 12.5
    assert message.of("nobody") is None


def test_each_of_two_robots_gets_its_pose_from_one_stream(configs):
    """A stream keeps its newest message only: neither robot may push out the other."""
    with ExitStack() as stack:
        publish = publisher(configs["localizer"], stack)
        link = stack.enter_context(configs["robot"].open())
        ears = [Subscriber(link, PosesMessage) for _ in range(2)]
        gates = [PoseGate("robot"), PoseGate("other")]
        taken = [0, 0]
        deadline = time.monotonic() + 10.0
        while min(taken) < 20 and time.monotonic() < deadline:
            publish((POSE, OTHER), 12.5)
            time.sleep(0.02)
            for i, name in enumerate(("robot", "other")):
                message = ears[i].receive()
                if message is not None:
                    assert gates[i].take(message.of(name), time.monotonic())
                    taken[i] += 1
        assert min(taken) == 20
        assert not any(gate.stream.refused for gate in gates)


def test_poses_arrive_where_the_robot_listens(configs):
    """Over the encrypted link, from the localizer's keys to the robot's."""
    received = None
    with ExitStack() as stack, configs["robot"].open() as link:
        publish = publisher(configs["localizer"], stack)
        subscriber = Subscriber(link, PosesMessage)
        deadline = time.monotonic() + 5.0
        while received is None and time.monotonic() < deadline:
            publish((), 12.5)
            publish((POSE,), 12.5)
            time.sleep(0.02)
            received = subscriber.receive()
    assert received is not None
    assert [seen.robot for seen in received.robots] == ["robot"]


def test_a_link_without_keys_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="keygen"):
        publisher(LinkConfig(str(tmp_path)), ExitStack())
    with pytest.raises(ConfigError, match="missing keys"):
        from_plain(LinkConfig, {"base_port": 6000})
