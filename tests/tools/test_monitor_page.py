"""The page in a real browser, used as a person uses it, on a demonstration robot."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robot.link.keys import keygen
from robot.navigation.road_map import RoadMap, load_map
from tests.robot.link.conftest import free_base_port
from tests.tools.browser import Browser, find_chromium
from tests.tools.demo_robot import on_straight_lane
from tools.monitor.app import UNSEEN

CHROMIUM = find_chromium()
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")

STATE = "document.querySelector('#state').textContent"
HEARD = "document.querySelectorAll('#inputs [data-level=ok]').length === 3"
ALARM = "document.querySelector('#alarm')"
KEEP = "document.querySelector('#auto')"


class Programs:
    """A monitor and a demonstration robot, each a process of its own."""

    def __init__(self, folder: Path, road_map: str, *more: str) -> None:
        base_port = free_base_port()
        config = folder / "link.yaml"
        keys = str(keygen(folder / "keys")["monitor"])
        config.write_text(json.dumps({"keys": keys, "base_port": base_port}))
        self.map = road_map
        robot = ["--keys", str(folder / "keys"), "--base-port", str(base_port), "--map", road_map]
        self.robot = self._start("tests.tools.demo_robot", *robot, *more)
        page = ["--port", str(free_base_port()), "--map", road_map, "--drives", str(folder / "d")]
        self.monitor = self._start("tools.monitor", "--link", str(config), *page)
        assert self.monitor.stdout is not None
        found = re.search(r"http://\S+", self.monitor.stdout.readline())
        assert found is not None
        self.address = found.group()

    def close(self) -> None:
        for process in (self.robot, self.monitor):
            process.kill()
            process.wait(5.0)

    def _start(self, module: str, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", module, *arguments]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@pytest.fixture
def programs(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Programs]:
    programs = Programs(tmp_path, *getattr(request, "param", "loop").split())
    yield programs
    programs.close()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    assert CHROMIUM is not None
    with Browser(CHROMIUM, tmp_path / "profile") as browser:
        yield browser


def opened(browser: Browser, programs: Programs, heard: str = HEARD) -> None:
    for _ in range(50):
        browser.open(programs.address)
        try:
            browser.until("!!document.querySelector('#state')", timeout_s=1.0)
            break
        except AssertionError:  # the server is not up yet
            time.sleep(0.1)
    browser.until(f"{STATE} === 'DISARMED'")
    browser.until(heard)


def on_screen(browser: Browser, name: str, x_m: float, y_m: float) -> tuple[float, float]:
    """The place on the map's canvas, which shows the map centred, with margins."""
    road_map = load_map(name)
    x, y, width, height = browser.evaluate(
        "(() => { const b = document.querySelector('#map').getBoundingClientRect();"
        "return [b.x, b.y, b.width, b.height]; })()"
    )
    margin_px, above_px, below_px = 18, 50, 70
    free_px = height - above_px - below_px
    scale = min((width - 2 * margin_px) / road_map.width_m, free_px / road_map.height_m)
    left = x + (width - road_map.width_m * scale) / 2
    bottom = y + above_px + (free_px + road_map.height_m * scale) / 2
    return left + x_m * scale, bottom - y_m * scale


def click_map(browser: Browser, x_m: float, y_m: float, name: str = "loop") -> None:
    browser.click(*on_screen(browser, name, x_m, y_m))


def text(browser: Browser, selector: str) -> str:
    return str(browser.evaluate(f"document.querySelector('{selector}').textContent"))


def test_a_person_drives_stops_and_sees_silence(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    assert browser.evaluate(f"{KEEP}.hidden"), "who navigates wants a mission"
    road_map = load_map("loop")
    start = on_straight_lane(road_map, 1.0 / 3.0)

    click_map(browser, *start.moved(0.3, 0.0)[:2])
    browser.click_on("#go")
    browser.until(f"{STATE} === 'AUTO'")
    browser.until("document.querySelector('#mission-phase').textContent === 'arrived'")

    browser.click_on("#tab-drives")
    browser.until("!!document.querySelector('#drives button')")
    browser.click_on("#drives button")
    browser.until("document.querySelector('#replay-text').textContent.includes('AUTO')")
    browser.until("document.querySelectorAll('#replay-states i').length >= 2")
    assert text(browser, "#state") == "HOLD", "the state of now stays in sight"
    browser.click_on("#replay-close")

    click_map(browser, *start[:2])  # behind the robot: once round the loop
    browser.click_on("#go")
    browser.until(f"{STATE} === 'AUTO'")
    pressed_s = time.monotonic()
    browser.key("keyDown", " ", "Space")
    browser.until(f"{STATE} === 'HOLD'")
    assert time.monotonic() - pressed_s < 1.0
    browser.key("keyUp", " ", "Space")
    assert text(browser, "#mission-phase") == "stopped"

    programs.robot.send_signal(signal.SIGKILL)
    browser.until(f"!{ALARM}.hidden && {ALARM}.textContent.includes('silent')", 4.0)
    assert text(browser, "#state") == "SILENT"
    assert browser.evaluate("document.querySelector('#arm').disabled")
    assert browser.problems == []


def chosen(browser: Browser) -> list[float]:
    """The destination that the page names."""
    return [float(v) for v in re.findall(r"-?[0-9.]+", text(browser, "#choice-text"))[:2]]


PROBLEM = "document.querySelector('#problem')"


def drag_map(browser: Browser, programs: Programs, places: list[tuple[float, float]]) -> None:
    (x0, y0), (x1, y1) = (on_screen(browser, programs.map, *place) for place in places)
    at = {"button": "left", "clickCount": 1}
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x0, y=y0, **at)
    for share in (0.5, 1.0):
        x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, buttons=1, **at)
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x1, y=y1, **at)


@pytest.mark.parametrize("programs", ["town"], indirect=True)
def test_a_place_off_the_road_is_told_beside_the_map_and_arms_nobody(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    road_map = load_map(programs.map)
    start = on_straight_lane(road_map, 1.0 / 3.0)

    click_map(browser, *off_road(road_map, 1.05), programs.map)
    browser.until(f"!{PROBLEM}.hidden")
    assert "more than a tile from any lane" in text(browser, "#problem")
    expect_problem_at(browser, *on_screen(browser, programs.map, *off_road(road_map, 1.05)))
    assert browser.evaluate("document.querySelector('#choice').hidden")

    click_map(browser, *off_road(road_map, 0.9), programs.map)  # within a tile: snapped to a lane
    browser.until(f"{PROBLEM}.hidden && !document.querySelector('#choice').hidden")
    x_m, y_m = chosen(browser)
    assert road_map.lane_index.near(x_m, y_m).distance_m.min() < 0.01

    far = start.moved(0.6, 0.0)
    drag_map(browser, programs, [far[:2], start.moved(0.9, 0.0)[:2]])
    browser.click_on("#go")
    browser.until(f"!{PROBLEM}.hidden")
    assert re.search(r"it is 0\.[56]\d m from there", text(browser, "#problem"))
    expect_problem_at(browser, *on_screen(browser, programs.map, *start.moved(0.9, 0.0)[:2]))
    assert text(browser, "#state") == "DISARMED"
    assert "READY" not in text(browser, "#log"), "nothing was armed on the way"
    browser.click_on("#forget")
    browser.until(f"{PROBLEM}.hidden")
    assert browser.problems == []


def expect_problem_at(browser: Browser, x: float, y: float) -> None:
    """Above or below a place on the screen, and within the map."""
    left, top, right, bottom = box(browser, "#problem")
    outer = box(browser, "#map")
    assert outer[0] <= left <= x <= right <= outer[2]
    assert outer[1] <= top < bottom <= outer[3]
    assert min(abs(y - bottom), abs(y - top)) < 45


def box(browser: Browser, selector: str) -> list[float]:
    """Left, top, right and bottom of an element [px of CSS]."""
    found: list[float] = browser.evaluate(
        f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
        "return [b.left, b.top, b.right, b.bottom]; })()"
    )
    return found


SNAPPED = """
(async () => {
  const { sampled, snap } = await import("/static/geometry.js");
  const { lanes, tile_size_m } = await (await fetch("/api/map")).json();
  const lines = lanes.map((lane) => sampled(lane, 12));
  return PLACES.map((place) => {
    const found = snap(place, lines, tile_size_m);
    return [found, found && snap(found, lines, tile_size_m)];
  });
})()
"""


@pytest.mark.parametrize("programs", ["town"], indirect=True)
def test_a_place_snaps_to_the_nearest_lane_within_a_tile(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    road_map = load_map(programs.map)
    size = (road_map.width_m, road_map.height_m)
    places = np.random.default_rng(0).uniform((-1.0, -1.0), np.add(size, 1.0), (200, 2))
    snapped = browser.evaluate(SNAPPED.replace("PLACES", json.dumps(places.tolist())))
    assert any(found is None for found, _ in snapped)
    for place, (found, again) in zip(places, snapped, strict=True):
        least_m = road_map.lane_index.near(*place).distance_m.min()
        if found is None:
            assert least_m > road_map.tile_size_m - 0.003
            continue
        assert np.hypot(*(place - found)) == pytest.approx(least_m, abs=0.003)
        assert road_map.lane_index.near(*found).distance_m.min() < 0.003
        assert again == pytest.approx(found, abs=1e-6), "a place on a lane stays"


def test_zooming_keeps_the_place_under_the_pointer_and_following_the_robot_in_the_middle(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    ahead = on_straight_lane(load_map("loop"), 1.0 / 3.0).moved(0.5, 0.0)
    x, y = on_screen(browser, "loop", *ahead[:2])
    browser.click(x, y)
    before = chosen(browser)
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-700)
    browser.click(x, y)
    assert chosen(browser) == pytest.approx(before, abs=0.011)

    browser.click_on("#follow")
    browser.click_on("#go")
    browser.until("document.querySelector('#mission-phase').textContent === 'arrived'", 30.0)
    left, top, right, bottom = box(browser, "#map")
    browser.click((left + right) / 2, top + 50 + (bottom - top - 120) / 2)
    assert chosen(browser) == pytest.approx(ahead[:2], abs=0.25), (
        "the middle of the map is the robot"
    )
    assert browser.problems == []


def test_the_last_minute_is_drawn_and_the_theme_turns(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    click_map(browser, *on_straight_lane(load_map("loop"), 1.0 / 3.0).moved(0.8, 0.0)[:2])
    browser.click_on("#go")
    browser.until(f"{STATE} === 'AUTO'")
    curves = "[...document.querySelectorAll('.plot .curve')].map((p) => p.getAttribute('d'))"
    browser.until(f"{curves}.every((d) => (d.match(/L/g) ?? []).length >= 5)")
    values = "[...document.querySelectorAll('.plot b')].map((b) => b.textContent)"
    assert all(re.search(r"[0-9.]+ (cm|ms)", value) for value in browser.evaluate(values))
    browser.theme("light")
    page = "getComputedStyle(document.body).backgroundColor"
    light = browser.evaluate(page)
    browser.click_on("#theme")
    assert browser.evaluate(page) != light
    browser.click_on("#theme")
    assert browser.evaluate(page) == light
    assert browser.problems == []


def off_road(road_map: RoadMap, tiles: float) -> tuple[float, float]:
    """A place on the map that is this many tiles from the nearest lane."""
    size = road_map.tile_size_m
    rng = np.random.default_rng(0)
    places = rng.uniform((0.0, 0.0), (road_map.width_m, road_map.height_m), (20_000, 2))
    for x_m, y_m in places:
        if abs(road_map.lane_index.near(x_m, y_m).distance_m.min() - tiles * size) < 0.02 * size:
            return float(x_m), float(y_m)
    raise AssertionError("no such place")


def test_a_hand_on_the_keys_drives_and_a_blurred_page_lets_go(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    browser.click_on("#arm")
    browser.until(f"{STATE} === 'READY'")
    browser.click_on("#by-hand")
    browser.key("keyDown", "ArrowUp", "ArrowUp")
    browser.until(f"{STATE} === 'MANUAL'")
    browser.until("!!document.querySelector('#actions .chosen')")
    browser.evaluate("dispatchEvent(new Event('blur'))")
    browser.until(f"{STATE} === 'HOLD'", 3.0)
    assert browser.problems == []


GAMEPAD = """(() => { const pad = { connected: true, axes: [0, 0], buttons: [] };
    for (let i = 0; i < 16; i++) pad.buttons.push({ value: 0, pressed: false });
    window.pad = pad; navigator.getGamepads = () => [null, pad]; })()"""


def test_a_gamepad_takes_over_and_hands_over_and_the_drive_is_marked(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    browser.evaluate(GAMEPAD)
    start = on_straight_lane(load_map("loop"), 1.0 / 3.0)
    click_map(browser, *start.moved(-0.1, 0.0)[:2])  # once round the loop
    browser.click_on("#by-hand")
    browser.click_on("#go")
    browser.until(f"{STATE} === 'AUTO'")
    time.sleep(0.5)
    assert text(browser, "#state") == "AUTO", "a stick at rest takes nothing over"
    browser.evaluate("pad.axes[0] = -0.3; pad.buttons[7].value = 0.5;")
    browser.until(f"{STATE} === 'MANUAL'")
    assert text(browser, "#hand-by") == "Driving by a gamepad"
    browser.evaluate("pad.axes[0] = 0.02; pad.buttons[7].value = 0;")
    time.sleep(0.6)
    assert text(browser, "#state") == "MANUAL", "it stands, in the person's hands"
    browser.click_on("#hand-over")
    browser.until(f"{STATE} === 'AUTO'")
    time.sleep(0.5)
    assert text(browser, "#state") == "AUTO"
    browser.click_on("#stop")
    browser.until(f"{STATE} === 'HOLD'")
    browser.click_on("#tab-drives")
    browser.until("document.querySelectorAll('#drives button').length === 1")
    browser.click_on("#drives button")
    browser.until("!document.querySelector('#replay').hidden")
    browser.click_on("#replay-play")
    for button, at_s in (("#mark-bad", 0.2), ("#mark-bad", 0.9)):
        browser.evaluate(
            f"(() => {{ const r = document.querySelector('#replay-time'); r.value = {at_s};"
            "r.dispatchEvent(new Event('input')); })()"
        )
        browser.click_on(button)
    browser.until("document.querySelectorAll('#replay-marks [data-kind=bad]').length === 1")
    browser.evaluate("document.querySelector('#replay-marks i').click()")
    browser.until("document.querySelectorAll('#replay-marks i').length === 0")
    assert browser.problems == []


def test_a_finger_on_the_pad_steers_and_lets_go(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    browser.click_on("#arm")
    browser.until(f"{STATE} === 'READY'")
    browser.click_on("#by-hand")
    x, y = browser.evaluate(
        "(() => { const s = document.querySelector('#stick'); s.scrollIntoView();"
        "const b = s.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    finger = {"button": "left", "buttons": 1, "clickCount": 1}
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **finger)
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x - 20, y=y - 30, **finger)
    browser.until(f"{STATE} === 'MANUAL'")
    assert text(browser, "#hand-by") == "Driving by the pad"
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, **finger)
    browser.until("document.querySelector('#hand-by').textContent === ''")
    browser.click_on("#by-hand")
    browser.until(f"{STATE} === 'HOLD'", 2.0)
    assert browser.problems == []


def test_a_finger_that_only_touches_stop_has_stopped_the_robot(
    browser: Browser, programs: Programs
) -> None:
    """One that slides, or comes beside the thumb on the pad, never makes a click."""
    opened(browser, programs)
    browser.click_on("#arm")
    browser.until(f"{STATE} === 'READY'")
    touch = "new PointerEvent('pointerdown', {bubbles: true, pointerId: 2, pointerType: 'touch'})"
    browser.evaluate(f"document.querySelector('#stop').dispatchEvent({touch}); 0")
    browser.until(f"{STATE} === 'HOLD'", 2.0)
    assert browser.problems == []


def test_a_page_whose_monitor_hangs_says_so(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    monitor = programs.monitor.pid
    os.kill(monitor, signal.SIGSTOP)
    try:
        browser.until(f"!{ALARM}.hidden && {ALARM}.textContent.includes('lost the monitor')", 4.0)
        assert text(browser, "#state") == "SILENT"
    finally:
        os.kill(monitor, signal.SIGCONT)
    browser.until(f"{ALARM}.hidden", 5.0)


def test_the_page_fits_its_window(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    for width, height in ((1400, 900), (1400, 500), (900, 700), (390, 844)):
        browser.size(width, height, mobile=width < 600)
        browser.until(f"innerWidth === {width}")
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        for scroll in (0, 10_000):
            browser.evaluate(f"scrollTo(0, {scroll})")
            top, bottom = browser.evaluate(
                "(() => { const b = document.querySelector('#stop').getBoundingClientRect();"
                "return [b.top, b.bottom]; })()"
            )
            assert 0 <= top < bottom <= height, "the stop button is always in sight"


@pytest.mark.parametrize("programs", ["loop --keeps-lane"], indirect=True)
def test_a_robot_that_keeps_its_lane_is_armed_and_let_go(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs, HEARD.replace("3", "2"))
    assert not browser.evaluate(f"{KEEP}.hidden")
    assert browser.evaluate(f"{KEEP}.disabled"), "it is not armed"
    browser.click_on("#arm")
    browser.until(f"!{KEEP}.disabled")
    browser.click_on("#auto")
    browser.until(f"{STATE} === 'AUTO'")
    assert "keeps its lane" in text(browser, "#mission-text")
    browser.click_on("#stop")
    browser.until(f"{STATE} === 'HOLD'")
    browser.until(f"{KEEP}.disabled")


def test_who_navigates_may_be_let_drive_on_only_while_its_place_is_unknown(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    assert browser.evaluate(f"{KEEP}.hidden"), "it knows its place"
    shown = (
        "import('/static/panels.js').then(({ showState }) => { showState({ silent: false, robot: "
        "{ state: 'READY', reason: '', pose: null, inputs: [{ name: 'pose' }] } });"
        f" window.told = [{KEEP}.hidden, {KEEP}.disabled]; }})"
    )
    browser.evaluate(f"void {shown}")
    browser.until("window.told !== undefined")
    assert browser.evaluate("window.told") == [False, False]


def test_a_policy_with_its_own_actions_is_shown_in_rows(
    browser: Browser, programs: Programs
) -> None:
    opened(browser, programs)
    browser.evaluate("void import('/static/panels.js').then((it) => { window.panels = it; })")
    browser.until("!!window.panels")
    actions = [[0.05, 0.1], [0, 0], [0.3, 0.3]]
    robot = json.dumps({"actions": actions, "values": [1, 3, 2], "action": 1})
    shown = browser.evaluate(
        f"(() => {{ window.panels.showAction({robot}, true);"
        "return [...document.querySelectorAll('#own-actions div')]"
        ".map((row) => [row.className, row.textContent]); })()"
    )
    assert shown == [
        ["", "0.05 | 0.10 m/s1.00"],
        ["chosen", "stop3.00"],
        ["", "0.30 | 0.30 m/s2.00"],
    ]
    browser.until("!document.querySelector('#own-actions div')")  # again the live robot's five


def test_a_page_in_the_background_watches_no_robot(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    start = on_straight_lane(load_map("loop"), 1.0 / 3.0)
    click_map(browser, *start.moved(-0.2, 0.0)[:2])  # once round the loop
    browser.click_on("#go")
    browser.until(f"{STATE} === 'AUTO'")
    hidden = "Object.defineProperty(document, 'hidden', {value: %s, configurable: true});"
    count = "seen = 0; send = WebSocket.prototype.send;"
    count += "WebSocket.prototype.send = function(d) { seen += d === 'seen'; send.call(this, d); };"
    browser.evaluate(hidden % "true" + count + "null")
    time.sleep(4.0)
    assert browser.evaluate("seen") == 0
    show = hidden % "false" + "document.dispatchEvent(new Event('visibilitychange'))"
    assert browser.evaluate(f"{show}, seen") == UNSEEN, "it catches up with all that came"
    browser.until(f"{STATE} === 'HOLD'")
    assert browser.problems == []
