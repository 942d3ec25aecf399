"""The monitor with a demonstration robot on real links: commands, refusals, and letting go."""

import asyncio
import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from robot.contract import Stick
from robot.link.messages import Ack, Mission
from robot.link.sockets import LinkConfig
from robot.navigation.road_map import load_map
from robot.safety.state_machine import Answer, State
from robot.safety.state_machine import Command as Request
from tests.robot.link.conftest import until
from tests.tools.monitored import RobotThread
from tools.monitor import app as monitor_app
from tools.monitor.app import create_app
from tools.monitor.monitor import PAGE_ALIVE_S, Monitor

ORIGIN = "http://127.0.0.1:8600"
HEADERS = {"origin": ORIGIN}
LIVE = "ws://127.0.0.1:8600/ws"


@pytest.fixture
def config(configs: dict[str, LinkConfig]) -> LinkConfig:
    return configs["monitor"]


@pytest.fixture
def thread(configs: dict[str, LinkConfig]) -> Iterator[RobotThread]:
    with RobotThread(configs) as thread:
        yield thread


@pytest.fixture
def browser(config: LinkConfig, tmp_path: Path) -> Iterator[TestClient]:
    app = create_app(Monitor(config, tmp_path), load_map("loop"), "secret")
    with TestClient(app, base_url=ORIGIN) as browser:
        browser.get("/?token=secret")
        yield browser


class Page:
    """What the page's script does: read states, say that they were seen, drive."""

    def __init__(self, browser: TestClient, socket: WebSocketTestSession) -> None:
        self._browser = browser
        self.socket = socket
        self.state: dict[str, Any] = {}

    def read(self) -> None:
        self.state = json.loads(self.socket.receive_text())["state"]
        self.socket.send_text("seen")

    def until(self, **wanted: object) -> None:
        def fits() -> bool:
            self.read()
            robot = self.state["robot"] or {}
            return all(robot.get(key) == value for key, value in wanted.items())

        assert until(fits), f"expected {wanted}, got {self.state['robot']}"

    def ready(self) -> None:
        def heard() -> bool:
            self.read()
            ages = {
                one["name"]: one["age_s"]
                for one in (self.state["robot"] or {"inputs": ()})["inputs"]
            }
            return (ages.get("operator") or 9.0) < 0.5

        assert until(heard)
        assert self.ask("arm") == {"accepted": True, "reason": ""}
        self.until(state="READY")

    def ask(self, kind: str, **places: object) -> dict[str, Any]:
        body = {"kind": kind, **places}
        answer: dict[str, Any] = self._browser.post(
            "/api/command", json=body, headers=HEADERS
        ).json()
        return answer


@pytest.fixture
def page(thread: RobotThread, browser: TestClient) -> Iterator[Page]:
    with browser.websocket_connect(LIVE, headers=HEADERS) as socket:
        page = Page(browser, socket)
        page.ready()
        yield page


def ahead(thread: RobotThread, distance_m: float) -> tuple[float, float]:
    pose = thread.robot.pose.moved(distance_m, 0.0)
    return pose.x_m, pose.y_m


def test_a_mission_is_driven_to_its_end_and_recorded(
    page: Page, thread: RobotThread, browser: TestClient
) -> None:
    goal = ahead(thread, 0.3)
    assert page.ask("mission", destination=goal)["accepted"]
    page.until(state="AUTO")
    assert len(page.state["robot"]["path"]) > 5
    assert len(page.state["robot"]["values"]) == 5
    page.until(state="HOLD", reason="arrived")
    pose = thread.robot.pose
    assert (pose.x_m, pose.y_m) == pytest.approx(goal, abs=0.06)
    assert until(lambda: bool(browser.get("/api/drives").json()))
    (drive,) = browser.get("/api/drives").json()
    assert drive["phase"] == "arrived"
    assert len(browser.get(f"/api/drives/{drive['name']}").json()) > 5
    assert browser.get("/api/drives/nothing").status_code == 404


def test_a_goal_off_the_road_is_refused_with_the_reason(page: Page) -> None:
    answer = page.ask("mission", destination=(1.7, 1.2))
    assert not answer["accepted"]
    assert "the nearest lane is at" in answer["reason"]


def states_of(page: Page) -> set[str]:
    """Every state that a page was told for half a second."""
    seen: set[str] = set()
    began_s = time.monotonic()
    while time.monotonic() - began_s < 0.5:
        page.read()
        seen.add(page.state["robot"]["state"])
    return seen


def test_nothing_arms_for_a_mission_that_is_refused(page: Page, thread: RobotThread) -> None:
    assert page.ask("disarm")["accepted"]
    page.until(state="DISARMED")
    seen: list[State] = []
    arm = thread.robot.safety.command

    def watched(request: Any) -> Any:
        answer = arm(request)
        seen.append(thread.robot.safety.verdict.state)
        return answer

    thread.robot.safety.command = watched  # type: ignore[method-assign]
    answer = page.ask("mission", destination=(1.7, 1.2), arm=True)
    assert not answer["accepted"]
    assert "the nearest lane is at" in answer["reason"]
    assert states_of(page) == {"DISARMED"}
    assert seen == [], "the robot was not even asked to arm"


def test_arm_and_drive_is_one_request(page: Page, thread: RobotThread) -> None:
    assert page.ask("disarm")["accepted"]
    page.until(state="DISARMED")
    assert page.ask("mission", destination=ahead(thread, -0.1), arm=True)["accepted"]
    page.until(state="AUTO")


def test_arm_and_drive_of_a_robot_that_was_armed_just_before(
    page: Page, thread: RobotThread
) -> None:
    """The page still showed DISARMED when the button was pressed."""
    assert page.ask("mission", destination=ahead(thread, -0.1), arm=True)["accepted"]
    page.until(state="AUTO")


def test_a_robot_armed_for_a_mission_that_it_then_refuses_is_disarmed(
    page: Page, thread: RobotThread
) -> None:
    assert page.ask("disarm")["accepted"]
    page.until(state="DISARMED")
    command = thread.robot.safety.command

    def unwilling(request: Request) -> Answer:
        return Answer(False, "a doubt came") if request is Request.AUTO else command(request)

    thread.robot.safety.command = unwilling  # type: ignore[method-assign]
    answer = page.ask("mission", destination=ahead(thread, -0.1), arm=True)
    assert answer == {"accepted": False, "reason": "a doubt came"}
    page.until(state="DISARMED")


@pytest.mark.parametrize("halt", ["stop", "disarm"])
def test_a_stop_that_comes_while_a_robot_is_asked_keeps_it_from_arming(
    config: LinkConfig, tmp_path: Path, halt: str
) -> None:
    """The robot stands: it has nothing to stop, and remembers no stop."""
    sent: list[str] = []

    class Robot:
        def send(self, kind: str, mission: Mission | None) -> str:
            sent.append(kind)
            return str(len(sent))

    async def press() -> Ack:
        monitor = Monitor(config, tmp_path)
        monitor._client = Robot()  # type: ignore[assignment]
        going = asyncio.create_task(monitor.drive(Mission((1.0, 1.0)), arm=True))
        await asyncio.sleep(0)
        stopping = asyncio.create_task(monitor.command(halt))
        await asyncio.sleep(0)
        for number, (_, future) in monitor._waiting.items():
            future.set_result(Ack(number, True))
        assert (await stopping).accepted
        return await asyncio.wait_for(going, 1.0)

    answer = asyncio.run(press())
    assert sent == ["plan", halt]
    assert (answer.accepted, answer.reason) == (False, "stopped before it was armed")


class SlowRobot:
    """Has one STOP at a time under way, as a `CommandClient` has."""

    def send(self, kind: str, mission: Mission | None) -> str:
        return kind


def test_all_who_stop_at_once_are_answered(config: LinkConfig, tmp_path: Path) -> None:
    async def press() -> list[Ack]:
        monitor = Monitor(config, tmp_path)
        monitor._client = SlowRobot()  # type: ignore[assignment]
        pressed = [asyncio.create_task(monitor.command("stop")) for _ in range(3)]
        await asyncio.sleep(0)
        monitor._answered(Ack("stop", True))
        return await asyncio.gather(*pressed)

    assert all(answer.accepted for answer in asyncio.run(press()))


def test_a_stop_that_is_answered_late_is_logged_and_breaks_nothing(
    config: LinkConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.monitor.monitor.PATIENCE_S", 0.01)
    monitor = Monitor(config, tmp_path)
    monitor._client = SlowRobot()  # type: ignore[assignment]

    async def press() -> Ack:
        answer = await monitor.command("stop")
        monitor._answered(Ack("stop", True))
        return answer

    assert "STOP is repeated" in asyncio.run(press()).reason
    assert [entry.text for entry in monitor.state.log_after(0)] == ["stop"]


def test_a_page_that_is_closed_watches_no_longer(config: LinkConfig, tmp_path: Path) -> None:
    monitor = Monitor(config, tmp_path)
    assert not monitor.watched
    for page in ("one", "other"):
        monitor.page_showed(page)
    monitor.page_closed("one")
    assert monitor.watched
    monitor.page_closed("other")
    monitor.page_closed("other")
    assert not monitor.watched


def test_a_page_and_a_program_that_end_are_noticed_once(
    config: LinkConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monitor, ended = Monitor(config, tmp_path), []
    close = monitor.close
    monkeypatch.setattr(monitor, "page_closed", lambda _: ended.append("page"))
    monkeypatch.setattr(monitor, "close", lambda: ended.append("program") or close())
    with TestClient(create_app(monitor, load_map("loop"), "secret"), base_url=ORIGIN) as browser:
        browser.get("/?token=secret")
        with browser.websocket_connect(LIVE, headers=HEADERS):
            assert ended == []
        assert until(lambda: ended == ["page"])
    assert ended == ["page", "program"]


class Noting:
    """A monitor that notes what a page tells it, and answers no command."""

    def __init__(self) -> None:
        self.told: list[object] = []

    def page_showed(self, _: object) -> None:
        self.told.append("seen")

    def drive_by_hand(self, _: object, stick: Stick | None) -> bool:
        self.told.append(stick)
        return True

    async def command(self, kind: str) -> None:
        self.told.append(kind)
        await asyncio.Event().wait()


def told_by(*texts: str) -> list[object]:
    """What a monitor hears of a page that says this."""
    said = [{"type": "websocket.receive", "text": text} for text in texts]
    waiting = iter([*said, {"type": "websocket.disconnect"}])

    class Socket:
        async def receive(self) -> dict[str, str]:
            await asyncio.sleep(0)
            return next(waiting)

    async def listen() -> list[object]:
        noting = Noting()
        page = monitor_app.Page(Socket(), noting)  # type: ignore[arg-type]
        await asyncio.wait_for(page.listen(), 5.0)
        return noting.told

    return asyncio.run(listen())


AHEAD = '{"manual": [0, 1]}'


def test_a_hand_that_lets_go_is_passed_on_at_once() -> None:
    """However short it was: the robot would roll on for the rest of 0.3 s."""
    heard = told_by(AHEAD, AHEAD, '{"manual": null}', "seen")
    assert heard == ["seen", Stick(0.0, 1.0), "seen", "seen", None, "seen"]


def test_a_stick_is_passed_on_fifty_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    times_s = iter((100.0, 100.019, 100.021, 100.04, 100.042))
    monkeypatch.setattr(monitor_app, "time", SimpleNamespace(monotonic=times_s.__next__))
    heard = told_by(*[AHEAD] * 5)
    assert heard.count(Stick(0.0, 1.0)) == 3
    assert heard.count("seen") == 5, "who drives watches"


def test_a_stop_that_nobody_answers_holds_up_no_other_word() -> None:
    assert told_by("stop", "seen", "stop", "seen") == ["stop", "seen", "stop", "seen"]


def test_a_page_that_shows_nothing_is_sent_no_more(config: LinkConfig, tmp_path: Path) -> None:
    """Else what it shows grows older and older, and it vouches for that."""
    sent: list[str] = []

    class Socket:
        async def send_text(self, text: str) -> None:
            sent.append(text)

    async def watch() -> tuple[int, int]:
        page = monitor_app.Page(Socket(), Monitor(config, tmp_path))  # type: ignore[arg-type]
        sending = asyncio.create_task(page.send())
        await asyncio.sleep(1.0)
        before = len(sent)
        page._room.release()  # as "seen" does
        await asyncio.sleep(0.3)
        sending.cancel()
        return before, len(sent)

    assert asyncio.run(watch()) == (3, 4)


def test_a_robot_that_may_not_arm_is_not_sent(page: Page, thread: RobotThread) -> None:
    assert page.ask("stop")["accepted"]
    page.until(state="HOLD")
    command = thread.robot.safety.command

    def unwilling(request: Request) -> Answer:
        return Answer(False, "no frame") if request is Request.ARM else command(request)

    thread.robot.safety.command = unwilling  # type: ignore[method-assign]
    answer = page.ask("mission", destination=ahead(thread, -0.1), arm=True)
    assert answer == {"accepted": False, "reason": "no frame"}
    assert states_of(page) == {"HOLD"}


@pytest.mark.parametrize(("away_m", "taken"), [(0.1, True), (0.3, False)])
def test_a_mission_from_a_start_is_for_a_robot_that_is_there(
    page: Page, thread: RobotThread, away_m: float, taken: bool
) -> None:
    start = ahead(thread, away_m)
    answer = page.ask("mission", destination=ahead(thread, 0.5), start=start)
    assert answer["accepted"] is taken
    if not taken:
        assert "it is 0.30 m from there" in answer["reason"]
        assert thread.robot.safety.verdict.state is State.READY


def test_where_a_robot_stands_that_has_no_sight_is_the_localizers_to_tell(
    page: Page, thread: RobotThread
) -> None:
    answer = page.ask("place", destination=ahead(thread, 0.5), start=ahead(thread, 0.0))
    assert not answer["accepted"]
    assert "robot with sight" in answer["reason"]


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "mission"},
        {"kind": "place"},
        {"kind": "place", "destination": [1.0, 1.0]},
        {"kind": "place", "destination": [1.0, 1.0], "start": [1.0, 1.0], "arm": True},
        {"kind": "arm", "start": [1.0, 1.0]},
        {"kind": "arm", "arm": True},
        {"kind": "arm", "destination": [1.0, 1.0]},
        {"kind": "mission", "destination": [1e9, 0.0]},
    ],
)
def test_what_cannot_be_asked_is_refused_by_the_monitor(browser: TestClient, body: object) -> None:
    answer = browser.post("/api/command", json=body, headers=HEADERS).json()
    assert not answer["accepted"]
    assert "expected" in answer["reason"]


@pytest.mark.parametrize("body", [{"kind": "manual"}, {"kind": "arm", "x": 1}, {}, []])
def test_a_malformed_request_is_refused(browser: TestClient, body: object) -> None:
    assert browser.post("/api/command", json=body, headers=HEADERS).status_code == 422


def test_another_site_cannot_command_or_watch(browser: TestClient) -> None:
    foreign = {"origin": "http://evil.example"}
    answer = browser.post("/api/command", json={"kind": "arm"}, headers=foreign)
    assert answer.status_code == 403
    with pytest.raises(WebSocketDisconnect), browser.websocket_connect(LIVE, headers=foreign):
        pass


def test_stop_stands_the_robot_and_needs_a_person_to_go_on(page: Page, thread: RobotThread) -> None:
    page.ask("mission", destination=ahead(thread, -0.1))
    page.until(state="AUTO")
    asked_s = time.monotonic()
    assert page.ask("stop")["accepted"]
    assert time.monotonic() - asked_s < 0.5
    stood = thread.robot.pose
    time.sleep(0.3)
    assert thread.robot.pose == stood
    page.until(state="HOLD")
    assert not page.ask("mission", destination=ahead(thread, -0.1))["accepted"]


def drive_by_hand(page: Page, thread: RobotThread) -> None:
    began = thread.robot.pose

    def moving() -> bool:
        page.socket.send_text(json.dumps({"manual": [0, 1]}))
        page.read()
        return thread.robot.pose != began

    assert until(moving)
    assert thread.robot.safety.verdict.state is State.MANUAL


def standing_within_s(thread: RobotThread) -> float:
    """How long it takes until the robot has stood for 0.2 s [s]."""
    began_s = moved_s = time.monotonic()
    pose = thread.robot.pose
    while time.monotonic() - moved_s < 0.2:
        if thread.robot.pose != pose:
            pose, moved_s = thread.robot.pose, time.monotonic()
        time.sleep(0.01)
    return moved_s - began_s


def test_a_stop_comes_in_beside_requests_that_wait_for_one_another(
    page: Page, thread: RobotThread
) -> None:
    """A browser has six requests under way at most; a seventh waits, but not a word like this."""
    assert page.ask("mission", destination=ahead(thread, 0.5))["accepted"]
    page.until(state="AUTO")
    page.socket.send_text("stop")
    page.until(state="HOLD", reason="stop, by a person")


def test_a_hand_that_lets_go_without_a_word_stops_the_robot(
    page: Page, thread: RobotThread
) -> None:
    drive_by_hand(page, thread)
    assert standing_within_s(thread) < 0.3 + 0.3
    page.until(state="HOLD")


def test_a_page_that_is_closed_stops_the_hand_at_once(page: Page, thread: RobotThread) -> None:
    drive_by_hand(page, thread)
    page.socket.close()
    assert standing_within_s(thread) < 0.5
    assert until(lambda: thread.robot.safety.verdict.state is State.HOLD)


def test_of_two_pages_one_drives_by_hand(
    page: Page, thread: RobotThread, browser: TestClient
) -> None:
    drive_by_hand(page, thread)
    heading_rad = thread.robot.pose.heading_rad
    with browser.websocket_connect(LIVE, headers=HEADERS) as socket:
        other = Page(browser, socket)
        for _ in range(5):
            page.socket.send_text(json.dumps({"manual": [0, 1]}))
            other.socket.send_text(json.dumps({"manual": [1, 0.6]}))
            page.read()
            other.read()
        assert thread.robot.pose.heading_rad == pytest.approx(heading_rad), "none of it was LEFT"
        assert other.ask("stop")["accepted"]
    page.until(state="HOLD")


def test_a_second_monitor_watches_and_stops(
    page: Page, thread: RobotThread, config: LinkConfig, tmp_path: Path
) -> None:
    assert page.ask("mission", destination=ahead(thread, -0.1))["accepted"]
    app = create_app(Monitor(config, tmp_path / "second"), load_map("loop"), "secret")
    with TestClient(app, base_url=ORIGIN) as browser:
        browser.get("/?token=secret")
        with browser.websocket_connect(LIVE, headers=HEADERS) as socket:
            second = Page(browser, socket)

            def refused() -> bool:
                page.read()
                second.read()
                answer = second.ask("mission", destination=ahead(thread, 0.3))
                return "another operator" in answer["reason"]

            assert until(refused)
            assert thread.robot.safety.verdict.state is State.AUTO
            assert second.ask("stop")["accepted"]
            second.until(state="HOLD")
    page.until(state="HOLD")


def test_a_mission_stops_when_nobody_watches(page: Page, thread: RobotThread) -> None:
    page.ask("mission", destination=ahead(thread, -0.1))
    page.until(state="AUTO")
    limit_s = PAGE_ALIVE_S + thread.robot.safety.limits.link_age_s
    closed_s = time.monotonic()  # no more state is read, so none is answered with "seen"
    assert until(lambda: thread.robot.safety.verdict.state is State.HOLD)
    assert time.monotonic() - closed_s < limit_s + 0.7
    assert "operator" in thread.robot.safety.verdict.sentence


@pytest.mark.parametrize(
    "text",
    [
        "hello",
        "{}",
        "[]",
        '{"manual": [0, 9]}',
        '{"manual": true}',
        '{"manual": "11"}',
        '{"manual": [0.5, NaN]}',
        "1",
    ],
)
def test_garbage_from_a_page_moves_nothing(page: Page, thread: RobotThread, text: str) -> None:
    page.socket.send_text(text)
    page.until(state="READY")
    assert thread.robot.safety.verdict.state is State.READY


def test_a_robot_that_dies_is_silent_on_the_page(
    configs: dict[str, LinkConfig], browser: TestClient
) -> None:
    with browser.websocket_connect(LIVE, headers=HEADERS) as socket:
        page = Page(browser, socket)
        page.read()
        assert page.state["silent"]
        with RobotThread(configs):
            page.until(state="DISARMED")
            assert not page.state["silent"]

        def silent() -> bool:
            page.read()
            return bool(page.state["silent"])

        assert until(silent)
        answer = page.ask("arm")
        assert answer == {"accepted": False, "reason": "the robot does not answer"}
        assert "STOP is repeated" in page.ask("stop")["reason"]


def test_the_map_and_the_page_are_served(browser: TestClient) -> None:
    assert browser.get("/api/map").json()["name"] == "loop"
    page = browser.get("/").text
    for name in ("app.js", "style.css", "icon.svg"):
        assert f"/static/{name}" in page
        assert browser.get(f"/static/{name}").status_code == 200


def test_a_monitor_that_breaks_ends_the_program(
    config: LinkConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page of a broken monitor would go on to show the past."""
    ended: list[int] = []
    monkeypatch.setattr(signal, "raise_signal", ended.append)
    monitor = Monitor(config, tmp_path)
    with TestClient(create_app(monitor, load_map("loop"), "secret"), base_url=ORIGIN):
        monkeypatch.setattr(monitor, "turn", lambda: 1 / 0)
        assert until(lambda: ended == [signal.SIGTERM])


def nested(depth: int) -> list[str]:
    """JSON that is nothing but depth, and JSON of ours with depth inside."""
    lists, objects = "[" * depth + "]" * depth, '{"a":' * depth + "1" + "}" * depth
    return [lists, objects, f'{{"manual":{lists}}}', f'{{"kind":{lists}}}']


DEPTHS = (10, 30, 60, 200, 500, 800, 900, 950, 980, 990, 1000, 1200, 2000, 100_000)


def test_depth_is_refused_and_the_page_lives_on(page: Page, browser: TestClient) -> None:
    for depth in DEPTHS:
        for text in nested(depth):
            page.socket.send_text(text)
            answer = browser.post("/api/command", content=text, headers=JSON)
            assert answer.status_code in (400, 413, 422), (depth, answer.status_code)
            assert len(answer.content) < 300
    for _ in range(3):
        page.read()
    assert page.ask("stop")["accepted"]
    page.until(state="HOLD")


JSON = {**HEADERS, "content-type": "application/json"}


@pytest.mark.parametrize(
    "body",
    [
        b'{"kind": NaN}',
        b'{"kind": "\\ud800"}',
        b'"\\ud800"',
        b'{"kind": "mission", "destination": [1' + b"0" * 400 + b", 1]}",
        b"\xff\xfe",
        b"",
        b"null",
        b"{" + b'"a":1,' * 500 + b'"b":2}',
    ],
)
def test_whatever_is_posted_is_answered_in_short(browser: TestClient, body: bytes) -> None:
    answer = browser.post("/api/command", content=body, headers=JSON)
    assert answer.status_code in (200, 400, 422)
    assert len(answer.content) < 400
    if answer.status_code == 200:
        assert not answer.json()["accepted"]


def test_a_body_has_a_size_and_a_limit(browser: TestClient) -> None:
    stop = b'{"kind": "stop"}'
    fits = browser.post("/api/command", content=stop.ljust(65536), headers=JSON)
    assert fits.status_code == 200
    larger = browser.post("/api/command", content=stop.ljust(65537), headers=JSON)
    assert (larger.status_code, larger.text) == (
        413,
        "expected Content-Length, at most 65536 bytes\n",
    )
    padded = {**JSON, "content-length": "0" * 20 + "9"}
    assert browser.post("/api/command", content=stop, headers=padded).status_code == 413
    pieces = browser.post("/api/command", content=iter([stop]), headers=JSON)
    assert pieces.status_code == 413


def test_what_is_no_text_of_ours_leaves_the_page_alone(page: Page) -> None:
    for text in (
        "",
        "x" * 201,
        '{"manual": [0, 1]' + " " * 200 + "}",
        "[]",
        "1",
        '{"manual": true}',
    ):
        page.socket.send_text(text)
    page.socket.send_bytes(bytes(100))
    page.socket.send_bytes(b"seen")
    for _ in range(3):
        page.read()
    assert page.state["robot"]["state"] == "READY"


def test_a_page_that_floods_passes_on_no_more_than_fifty_commands_a_second(
    page: Page, thread: RobotThread
) -> None:
    asked: list[float] = []
    ask = thread.robot.runtime.ask

    def counted(command: Any, wheels: Any = None) -> Any:
        if command is Request.MANUAL:
            asked.append(time.monotonic())
        return ask(command, wheels)

    thread.robot.runtime.ask = counted  # type: ignore[method-assign]
    began_s = time.monotonic()
    while time.monotonic() - began_s < 0.5:
        for _ in range(50):
            page.socket.send_text('{"manual": [0, 1]}')
        page.read()
    page.socket.send_text('{"manual": null}')
    assert until(lambda: len(asked) > 0)
    took_s = time.monotonic() - began_s
    assert len(asked) <= 50 * took_s + 3


def test_a_drive_by_hand_is_recorded_and_marked(
    page: Page, thread: RobotThread, browser: TestClient
) -> None:
    drive_by_hand(page, thread)
    page.until(state="HOLD")
    assert until(lambda: bool(browser.get("/api/drives").json()))
    (drive,) = browser.get("/api/drives").json()
    assert drive["phase"] == "by hand"
    marks = f"/api/drives/{drive['name']}/marks"
    piece = {"from_s": 0.0, "to_s": 0.2, "kind": "good"}
    assert browser.post(marks, json=[piece], headers=HEADERS).json()["accepted"]
    assert browser.get(marks).json()[0]["kind"] == "good"
    many = [{**piece, "to_s": 0.001 * k} for k in range(1, 301)]
    assert browser.post(marks, json=many, headers=HEADERS).json()["accepted"]
    assert len(browser.get(marks).json()) == 300
    assert browser.get(f"/api/drives/{drive['name']}").json()[0]["state"] == "MANUAL"
    backwards = {**piece, "to_s": 0.0}
    answer = browser.post(marks, json=[backwards], headers=HEADERS).json()
    assert "to a later one" in answer["reason"]
    for wrong in ({**piece, "kind": "ugly"}, {**piece, "from_s": -1.0}, {}):
        assert browser.post(marks, json=[wrong], headers=HEADERS).status_code == 422
    foreign = {"origin": "http://evil.example"}
    assert browser.post(marks, json=[piece], headers=foreign).status_code == 403
    assert browser.get("/api/drives/nothing/marks").status_code == 404


@pytest.mark.parametrize("t_s", ["nan", "inf", "-1", "1e7", "x"])
def test_a_time_that_no_drive_has_is_refused(browser: TestClient, t_s: str) -> None:
    assert browser.get(f"/api/drives/a/picture?t_s={t_s}").status_code == 422
