"""``python -m tests.tools.pictures FOLDER``: the monitor's picture and film in the documents."""

from __future__ import annotations

import base64
import io
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from tests.robot.link.conftest import free_base_port
from tests.tools.browser import Browser, find_chromium

SIZE_PX = (1280, 920)
FILM_PX = (860, 618)
EVERY_S = 0.8
GOAL = """(() => { const b = document.querySelector('#map').getBoundingClientRect();
return [b.x + 0.72 * b.width, b.y + 0.465 * b.height]; })()"""
SHARE = "parseFloat(document.querySelector('#mission-bar').style.width) || 0"  # of the way [%]
PHASE = "document.querySelector('#mission-phase').textContent"
HEARD = "document.querySelectorAll('#inputs [data-level=ok]').length === 3"


def take(folder: Path, program: str) -> None:
    """Drive a mission in the demonstration, and write ``monitor.png`` and ``drive.gif``."""
    with tempfile.TemporaryDirectory() as place:
        words = ["--demo", "--map", "town", "--port", str(free_base_port()), "--drives", place]
        command = [sys.executable, "-m", "tools.monitor", *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as monitor:
            assert monitor.stdout is not None
            found = re.search(r"http://\S+", monitor.stdout.readline())
            assert found is not None
            try:
                with Browser(program, Path(place, "profile"), *SIZE_PX) as page:
                    frames = _drive(page, found.group(), folder / "monitor.png")
            finally:
                monitor.terminate()
    flat = [frame.resize(FILM_PX).quantize(256, dither=Image.Dither.NONE) for frame in frames]
    lasts_ms = [*[int(500 * EVERY_S)] * (len(flat) - 1), 2000]  # at double speed
    flat[0].save(
        folder / "drive.gif", save_all=True, append_images=flat[1:], duration=lasts_ms, loop=0
    )


def _drive(page: Browser, address: str, picture: Path) -> list[Image.Image]:
    """Frames of a mission, the picture is that of its middle."""
    page.size(*SIZE_PX)
    time.sleep(3.0)
    page.open(address)
    page.until(HEARD, 30.0)
    page.click(*page.evaluate(GOAL))
    frames: list[Image.Image] = []
    due_s, share = time.monotonic(), 0.0
    phase = "none"
    while phase != "arrived":
        if len(frames) == 2:
            page.click_on("#go")
        due_s += EVERY_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        before, share = share, page.evaluate(SHARE)
        phase = page.evaluate(PHASE)
        assert phase != "stopped", "too busy a computer: the robot stopped"
        if before < 50.0 <= share:
            page.screenshot(picture)
        shot = page.call("Page.captureScreenshot", format="png")["data"]
        frames.append(Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB"))
    return frames


if __name__ == "__main__":
    chromium = find_chromium()
    if chromium is None:
        sys.exit("pictures: expected Chromium on the PATH, got none")
    take(Path(sys.argv[1]), chromium)
