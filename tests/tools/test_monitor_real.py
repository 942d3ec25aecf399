"""The page in a real browser, on the robot's, localizer's and monitor's own processes."""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.recording.replay import replay
from tests.tools.browser import Browser, find_chromium
from tests.tools.pursuit import write_pursuit
from tools.faults.stage import Stage
from tools.loop.bench import BenchOptions

CHROMIUM = find_chromium()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]

STATE = "document.querySelector('#state').textContent"
PHASE = "document.querySelector('#mission-phase').textContent"
ALARM = "document.querySelector('#alarm').textContent"


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    model = write_pursuit(tmp_path / "pursuit.onnx")
    options = BenchOptions(model, record=True)
    with Stage(options, tmp_path) as stage:
        yield stage


def until(stage: Stage, browser: Browser, holds: str, patience_s: float = 60.0) -> None:
    """While the page is waited for, the virtual world must go on."""
    bench = stage.bench
    bench.until(lambda: bool(browser.evaluate(holds)), patience_s, holds)


def send(stage: Stage, browser: Browser, goal_m: tuple[float, float]) -> None:
    """Click a place on the map, which is centred with margins, and the button."""
    road_map = stage.bench.road_map
    x, y, width, height = browser.evaluate(
        "(() => { const b = document.querySelector('#map').getBoundingClientRect();"
        "return [b.x, b.y, b.width, b.height]; })()"
    )
    free_px = height - 50 - 70
    scale = min((width - 36) / road_map.width_m, free_px / road_map.height_m)
    left = x + (width - road_map.width_m * scale) / 2
    bottom = y + 50 + (free_px + road_map.height_m * scale) / 2
    browser.click(left + goal_m[0] * scale, bottom - goal_m[1] * scale)
    browser.click_on("#go")
    until(stage, browser, f"{STATE} === 'AUTO'")


def test_a_mission_an_emergency_stop_and_a_dead_robot(stage: Stage, tmp_path: Path) -> None:
    assert CHROMIUM is not None
    bench, start = stage.bench, stage.start
    (address,) = re.findall(r"http://\S+", bench.processes["monitor"].said())
    with Browser(CHROMIUM, tmp_path / "profile") as browser:
        browser.open(address)
        until(stage, browser, "document.querySelector('#state')?.textContent === 'DISARMED'")
        until(stage, browser, "document.querySelectorAll('#inputs [data-level=ok]').length === 3")
        ahead = start.to_world([0.5, 0.0])
        send(stage, browser, (float(ahead[0]), float(ahead[1])))
        until(stage, browser, f"{PHASE} === 'arrived'")
        assert math.dist(bench.town.world.pose[:2], ahead) < 0.25

        send(stage, browser, stage.goal)
        browser.key("keyDown", " ", "Space")
        until(stage, browser, f"{STATE} === 'HOLD'", 5.0)
        browser.key("keyUp", " ", "Space")

        bench.end("robot")
        until(stage, browser, f"{ALARM}.includes('silent')", 10.0)
        assert browser.evaluate(STATE) == "SILENT"
        assert browser.problems == []
    found = [replay(path) for path in bench.recordings.iterdir()]
    assert sum(one.decisions for one in found) > 5
    assert not any(one.differences for one in found)
