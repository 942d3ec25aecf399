"""One open page of the monitor: what it is sent, and which of its words are passed on."""

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.testclient import TestClient

from robot.contract import Stick
from robot.link.messages import FrameMessage
from robot.link.sockets import LinkConfig
from robot.navigation.road_map import load_map
from tools.monitor import app as module
from tools.monitor.monitor import Monitor


class Noting:
    """A monitor that notes by which stick it is to drive, and lets only some pages."""

    def __init__(self, taken: tuple[bool, ...]) -> None:
        self.sticks: list[Stick | None] = []
        self.notes: list[str] = []
        self.state = SimpleNamespace(note=lambda _, text: self.notes.append(text))
        self._taken = iter(taken)

    def page_showed(self, _: object) -> None:
        """Whoever drives watches, and whoever says that it saw something."""

    def drive_by_hand(self, _: object, stick: Stick | None) -> bool:
        self.sticks.append(stick)
        return next(self._taken)


def heard_of(*texts: str | None, taken: tuple[bool, ...] = (True,) * 9) -> Noting:
    """What a monitor hears of a page that says this; None is bytes."""
    said: list[dict[str, Any]] = [{"type": "websocket.receive", "text": text} for text in texts]
    waiting = iter([*said, {"type": "websocket.disconnect"}])

    async def receive() -> dict[str, Any]:
        return next(waiting)

    monitor: Any = Noting(taken)
    socket: Any = SimpleNamespace(receive=receive)
    asyncio.run(module.Page(socket, monitor).listen())
    return monitor


@pytest.mark.parametrize(
    "text",
    [
        *("", "hello", "{}", "[]", "1", "null", '"manual"', None),
        *('{"manual": [0, 9]}', '{"manual": [-1.01, 0]}', '{"manual": [0.5, NaN]}'),
        *('{"manual": "11"}', '{"manual": true}', '{"manual": [1]}', '{"manual": [0, 0, 0]}'),
        *('{"manual": {"0": 1, "1": 1}}', '{"manual": [null, 1]}', '{"manual": [[0], 1]}'),
        '{"manual": [0, 1]' + 200 * " " + "}",
    ],
)
def test_what_is_no_stick_drives_nobody(text: str | None) -> None:
    heard = heard_of(text, '{"manual": null}')
    assert heard.sticks == [None], "and the page lives on"


def test_a_stick_goes_to_its_ends() -> None:
    for steer, speed in ((1.0, 1.0), (-1.0, -1.0), (0.25, -0.5)):
        assert heard_of(json.dumps({"manual": [steer, speed]})).sticks == [Stick(steer, speed)]


def test_that_another_page_drives_is_said_once_and_again_when_it_was_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MANUAL_EVERY_S", 0.0)
    taken = (False, False, True, False)
    heard = heard_of(*['{"manual": [0, 1]}'] * 4, taken=taken)
    assert heard.notes == ["driving by hand: another page drives"] * 2


def sent_by(monitor: Monitor, *acts: Callable[[], None]) -> list[Any]:
    """What a page is sent that shows all of it, with ``acts`` between two states."""
    sent: list[Any] = []

    async def watch() -> None:
        socket: Any = SimpleNamespace(send_text=send_text, send_bytes=send_bytes)
        page = module.Page(socket, monitor)
        sending = asyncio.create_task(page.send())
        for act in acts:
            act()
            page._room.release()
            await asyncio.sleep(0.01)
        sending.cancel()

    async def send_text(text: str) -> None:
        sent.extend(entry["text"] for entry in json.loads(text)["log"])

    async def send_bytes(data: bytes) -> None:
        sent.append(data)

    asyncio.run(watch())
    return sent


def test_each_picture_and_each_line_is_sent_once_also_of_a_robot_that_began_anew(
    configs: dict[str, LinkConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SEND_EVERY_S", 0.001)
    monitor = Monitor(configs["monitor"], tmp_path)

    pictures = {sequence: b"\xff\xd8%d\xff\xd9" % sequence for sequence in (5, 2)}

    def comes(sequence: int) -> None:
        monitor.state.frame = FrameMessage(pictures[sequence], 9.0, "run", sequence)
        monitor.state.note("info", f"line {sequence}")

    acts = (lambda: comes(5), lambda: None, lambda: comes(2), lambda: None)
    assert sent_by(monitor, *acts) == ["line 5", pictures[5], "line 2", pictures[2]]
    monitor.close()


@pytest.fixture
def browser(configs: dict[str, LinkConfig], tmp_path: Path) -> Iterator[TestClient]:
    """That has shown the token; the monitor does not turn."""
    monitor = Monitor(configs["monitor"], tmp_path)
    app = module.create_app(monitor, load_map("loop"), "secret")
    browser = TestClient(app, base_url="http://127.0.0.1:8600")
    browser.get("/?token=secret")
    yield browser
    monitor.close()


def test_a_picture_of_a_drive_is_sent_as_what_it_is(
    browser: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    for found in ((b"1", "image/png"), (b"2", "image/jpeg")):
        monkeypatch.setattr(module, "read_picture", lambda *_, found=found: found)
        answer = browser.get("/api/drives/one/picture?t_s=0")
        assert (answer.content, answer.headers["content-type"]) == found
    monkeypatch.setattr(module, "read_picture", lambda *_: None)
    assert browser.get("/api/drives/one/picture?t_s=0").status_code == 204


def test_a_refusal_says_what_is_wrong_in_one_short_line(browser: TestClient) -> None:
    body = {"kind": "arm", "x" * 5000 + "\n\x1b[31m": 1}
    headers = {"origin": "http://127.0.0.1:8600"}
    answer = browser.post("/api/command", json=body, headers=headers)
    assert answer.status_code == 422
    assert len(answer.json()["detail"]) <= 201
    assert answer.json()["detail"].isprintable()
