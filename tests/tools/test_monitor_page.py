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

import pytest

from robot.navigation.road_map import load_map
from tests.robot.link.conftest import free_base_port
from tests.tools.browser import Browser, find_chromium
from tools.monitor.demo_drive import start_pose

CHROMIUM = find_chromium()
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")

STATE = "document.querySelector('#state').textContent"
HEARD = "document.querySelectorAll('#inputs [data-level=ok]').length === 3"
ALARM = "document.querySelector('#alarm')"


class Programs:
    """A monitor and a demonstration robot, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        base_port = free_base_port()
        config = folder / "link.yaml"
        config.write_text(json.dumps({"plaintext": True, "base_port": base_port}))
        robot = ["demo_robot", "--base-port", str(base_port), "--map", "loop", "--no-camera"]
        self.robot = self._start(*robot)
        page = ["--port", str(free_base_port()), "--map", "loop", "--drives", str(folder / "d")]
        self.monitor = self._start("", "--link", str(config), *page)
        assert self.monitor.stdout is not None
        found = re.search(r"http://\S+", self.monitor.stdout.readline())
        assert found is not None
        self.address = found.group()

    def close(self) -> None:
        for process in (self.robot, self.monitor):
            process.kill()
            process.wait(5.0)

    def _start(self, module: str, *arguments: str) -> subprocess.Popen[str]:
        name = f"tools.monitor.{module}" if module else "tools.monitor"
        command = [sys.executable, "-m", name, *arguments]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@pytest.fixture
def programs(tmp_path: Path) -> Iterator[Programs]:
    programs = Programs(tmp_path)
    yield programs
    programs.close()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    assert CHROMIUM is not None
    with Browser(CHROMIUM, tmp_path / "profile") as browser:
        yield browser


def opened(browser: Browser, programs: Programs) -> None:
    for _ in range(50):
        browser.open(programs.address)
        try:
            browser.until("!!document.querySelector('#state')", timeout_s=1.0)
            break
        except AssertionError:  # the server is not up yet
            time.sleep(0.1)
    browser.until(f"{STATE} === 'DISARMED'")
    browser.until(HEARD)


def click_map(browser: Browser, x_m: float, y_m: float) -> None:
    """Click the place on the map's canvas, which shows the loop map centred, with margins."""
    road_map = load_map("loop")
    x, y, width, height = browser.evaluate(
        "(() => { const b = document.querySelector('#map').getBoundingClientRect();"
        "return [b.x, b.y, b.width, b.height]; })()"
    )
    margin_px, below_px = 18, 70
    free_px = height - margin_px - below_px
    scale = min((width - 2 * margin_px) / road_map.width_m, free_px / road_map.height_m)
    left = x + (width - road_map.width_m * scale) / 2
    bottom = y + margin_px + (free_px + road_map.height_m * scale) / 2
    browser.click(left + x_m * scale, bottom - y_m * scale)


def text(browser: Browser, selector: str) -> str:
    return str(browser.evaluate(f"document.querySelector('{selector}').textContent"))


def test_a_person_drives_stops_and_sees_silence(browser: Browser, programs: Programs) -> None:
    opened(browser, programs)
    road_map = load_map("loop")
    start = start_pose(road_map)

    click_map(browser, 0.5 * road_map.width_m, 0.5 * road_map.height_m)
    browser.click_on("#go")
    browser.until("!document.querySelector('#toast').hidden")
    assert "nearest lane" in text(browser, "#toast")
    browser.click_on("#forget")

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
