"""Who drives by hand, who watches, and what a robot is asked: a monitor on a clock of our own."""

import asyncio
import errno
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from robot.contract import Stick
from robot.geometry import WheelSpeeds
from robot.link.messages import Ack, FrameMessage, Mission, MissionStatus, Telemetry
from robot.link.sockets import LinkConfig
from tools.monitor import monitor as module
from tools.monitor.drives import DriveRecorder, list_drives
from tools.monitor.monitor import Monitor, _what

AHEAD = Stick(0.0, 1.0)
GOAL = Mission((1.0, 2.0))


class Robot:
    """A command client that notes what is sent, and answers it as it is told to."""

    def __init__(self, answered: Callable[[Ack], None], refuses: tuple[str, ...] = ()) -> None:
        self.sent: list[str] = []
        self.wheels: list[WheelSpeeds | None] = []
        self.beats: list[bool] = []
        self._answered, self._refuses = answered, refuses

    def send(self, kind: str, mission: object = None, wheels: WheelSpeeds | None = None) -> str:
        self.sent.append(kind)
        if kind == "manual":
            self.wheels.append(wheels)
            return str(len(self.sent))
        ack = Ack(str(len(self.sent)), kind not in self._refuses, "", "run1")
        asyncio.get_running_loop().call_soon(self._answered, ack)
        return ack.id

    def poll(self, beat: bool) -> list[Ack]:
        self.beats.append(beat)
        return []

    def silence_s(self) -> float:
        return 0.7


class World:
    """A monitor, its robot, and the time."""

    def __init__(self, config: LinkConfig, folder: Path) -> None:
        self.now_s = 100.0
        self.monitor = Monitor(config, folder)
        self.told("")

    def told(self, *refuses: str) -> Robot:
        self.robot = Robot(self.monitor._answered, refuses)
        self.monitor._client = self.robot  # type: ignore[assignment]
        return self.robot

    def hand(self, page: str, after_s: float, stick: Stick | None = AHEAD) -> bool:
        self.now_s += after_s
        return self.monitor.drive_by_hand(page, stick)

    def texts(self) -> list[str]:
        return [entry.text for entry in self.monitor.state.log_after(0)]


@pytest.fixture
def world(
    configs: dict[str, LinkConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[World]:
    world = World(configs["monitor"], tmp_path)
    clock = SimpleNamespace(monotonic=lambda: world.now_s, time=lambda: 1.7e9 + world.now_s)
    monkeypatch.setattr(module, "time", clock)
    yield world
    world.monitor.close()


def test_who_drives_by_hand_does_so_for_0_3_seconds_after_its_last_word(world: World) -> None:
    assert world.hand("one", 0.0)
    assert world.hand("one", 0.1)
    assert not world.hand("other", 0.29)
    assert world.hand("other", 0.02)
    assert not world.hand("one", 0.0)
    assert world.robot.wheels == [AHEAD.wheels] * 3, "a refused hand is not passed on"


def test_a_hand_that_lets_go_is_free_for_another_at_once(world: World) -> None:
    assert world.hand("one", 0.0, Stick(0.0, 0.0))
    assert world.hand("one", 0.0, None)
    assert world.hand("other", 0.0)
    assert world.robot.wheels == [Stick(0.0, 0.0).wheels, None, AHEAD.wheels]


def test_only_the_page_that_drives_lets_go_when_it_is_closed(world: World) -> None:
    world.hand("one", 0.0)
    world.monitor.page_closed("other")
    assert world.robot.wheels == [AHEAD.wheels]
    world.monitor.page_closed("one")
    assert world.robot.wheels == [AHEAD.wheels, None]


def test_the_robot_is_watched_for_a_second_after_any_page_showed_something(world: World) -> None:
    world.monitor.page_showed("one")
    world.now_s += 0.9
    world.monitor.page_showed("other")
    for after_s in (0.0, 0.99, 0.02):
        world.now_s += after_s
        world.monitor.turn()
    assert world.robot.beats == [True, True, False]


@pytest.mark.parametrize(
    ("refuses", "state", "sent"),
    [
        ((), "HOLD", ["plan", "arm", "mission"]),
        (("plan",), "HOLD", ["plan"]),
        *((("arm",), state, ["plan", "arm"]) for state in ("DISARMED", "HOLD", "FAULT", "")),
        *((("arm",), state, ["plan", "arm", "mission"]) for state in ("READY", "MANUAL", "AUTO")),
        (("mission",), "HOLD", ["plan", "arm", "mission", "disarm"]),
        (("arm", "mission"), "READY", ["plan", "arm", "mission"]),
    ],
)
def test_arm_and_drive_arms_who_would_go_and_leaves_who_would_not(
    world: World,
    monkeypatch: pytest.MonkeyPatch,
    refuses: tuple[str, ...],
    state: str,
    sent: list[str],
) -> None:
    monkeypatch.setattr(module, "NEWS_S", 0.01)
    robot = world.told(*refuses)
    world.monitor.state.telemetry = Telemetry("duck", state) if state else None
    answer = asyncio.run(world.monitor.drive(GOAL, arm=True))
    assert robot.sent == sent
    assert answer.accepted is (sent[-1] == "mission" and "mission" not in refuses)


def test_a_robot_that_is_only_to_drive_is_not_armed(world: World) -> None:
    robot = world.told("mission")
    assert not asyncio.run(world.monitor.drive(GOAL, arm=False)).accepted
    assert robot.sent == ["mission"]


def test_a_robot_armed_by_another_a_moment_before_is_sent(world: World) -> None:
    """Its report, four times a second at least, may still be on the way."""

    async def press() -> Ack:
        armed = Telemetry("duck", "READY")
        news = asyncio.get_running_loop().call_later
        news(0.2, setattr, world.monitor.state, "telemetry", armed)
        return await world.monitor.drive(GOAL, arm=True)

    robot = world.told("arm")
    assert asyncio.run(press()).accepted
    assert robot.sent == ["plan", "arm", "mission"]


def test_who_hears_no_answer_is_told_so_in_time_to_do_something_else(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert module.PATIENCE_S <= 2.0
    monkeypatch.setattr(module, "PATIENCE_S", 0.01)
    monkeypatch.setattr(world.robot, "_answered", lambda _: None)
    answer = asyncio.run(world.monitor.command("arm"))
    assert (answer.accepted, answer.reason[:13]) == (False, "no answer yet")


def test_why_a_hand_moves_nothing_is_logged_once_until_it_changes(world: World) -> None:
    for reason in ("not armed", "not armed", "late", "", "late"):
        world.hand("one", 0.1)
        told = Ack(str(len(world.robot.sent)), not reason, reason, "run1")
        world.monitor._answered(told)
    assert world.texts() == ["manual: not armed", "manual: late", "manual: late"]
    world.hand("one", 0.1)
    world.monitor._answered(Ack(str(len(world.robot.sent)), False, "not sent"))
    assert len(world.texts()) == 3, "the next one may be heard"


def test_an_answer_is_logged_with_what_was_asked(world: World) -> None:
    asyncio.run(world.monitor.command("mission", GOAL))
    assert world.texts() == ["drive to (1.00, 2.00) m"]
    there = Mission((1.0, 2.0), (3.0, 4.0))
    assert _what("mission", there) == "drive to (1.00, 2.00) m"
    assert _what("place", there) == "it stands at (3.00, 4.00) m"


def test_what_is_old_is_neither_recorded_nor_explained(world: World) -> None:
    report = Telemetry("duck", "AUTO", session="run1", sequence=5, t_sent_s=9.0)
    picture = FrameMessage(b"\xff\xd8\xff\xd9", 9.0, "run1", 5, 9.0)
    taken: list[object] = []
    monitor: Any = world.monitor
    monitor._telemetry = SimpleNamespace(receive=lambda: report)
    monitor._frames = SimpleNamespace(receive=lambda: picture)
    monitor._recorder = SimpleNamespace(take=taken.append, take_frame=taken.append)
    monitor._attention = SimpleNamespace(newest=None, offer=lambda frame: taken.append("offered"))
    for _ in range(3):
        monitor.turn()
    monitor._recorder = None
    assert [type(each).__name__ for each in taken] == ["Explained", "FrameMessage", "str"]
    assert monitor.snapshot().heard[-1].age_s == 0.7, "since the robot last answered"


def test_a_full_disk_ends_recording_and_nothing_else(world: World) -> None:
    def full(_: DriveRecorder) -> bool:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for _ in range(2):
        world.monitor._record(full)
    assert world.texts() == ["drives are no longer recorded: No space left on device"]


def test_a_monitor_that_is_closed_completes_its_drive_and_lets_its_links_go(
    configs: dict[str, LinkConfig], tmp_path: Path
) -> None:
    monitor = Monitor(configs["monitor"], tmp_path)
    driving = MissionStatus("m1", (1.0, 2.0), "driving")
    cast(DriveRecorder, monitor._recorder).take(Telemetry("duck", "AUTO", mission=driving))
    assert list_drives(tmp_path) == []
    monitor.close()
    assert [drive.phase for drive in list_drives(tmp_path)] == ["stopped"]
    assert monitor.state.drives == 1
    assert monitor._telemetry._socket.closed
