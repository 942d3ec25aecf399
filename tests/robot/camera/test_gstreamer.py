"""The child process is real: a small program that plays, hangs or dies as gst-launch may."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import List

import numpy as np
import pytest

from robot.camera import source
from robot.camera.source import (
    FIRST_PICTURE_S,
    JOIN_S,
    GstStream,
    NewestFrame,
    csi_command,
    gst_command,
    open_stream,
)
from robot.config import CameraConfig
from robot.errors import ConfigError, HardwareError
from tests.robot.camera.test_newest import eventually

SIZE = (8, 6)
PLAY = """
import os, sys, time
for level in range(1, {count} + 1):
    os.write(int(sys.argv[1]), bytes((level, 2 * level, 3 * level, 255)) * 48)
    time.sleep({pause})
"""
HALF = "import os, sys; os.write(int(sys.argv[1]), bytes(50))"


PIECES = """
import os, sys, time
data = bytes((1, 2, 3, 255)) * 48 + bytes((4, 5, 6, 255)) * 48
for piece in (data[:100], data[100:]):
    os.write(int(sys.argv[1]), piece)
    time.sleep(0.1)
"""


def program(body: str, count: int = 200, pause: float = 0.005) -> List[str]:
    return [sys.executable, "-c", PLAY.format(count=count, pause=pause) + body, "{video}"]


def test_reads_pictures_as_rgb() -> None:
    stream = GstStream(program("", count=3), SIZE)
    for level in (1, 2, 3):
        picture = stream.grab()
        assert picture.shape == (6, 8, 3)
        assert (picture == (3 * level, 2 * level, level)).all()
    stream.close()


def test_pictures_that_come_in_pieces_are_put_together() -> None:
    """As all do that are larger than a pipe."""
    stream = GstStream([sys.executable, "-c", PIECES, "{video}"], SIZE)
    for rgb in ((3, 2, 1), (6, 5, 4)):
        assert (stream.grab() == rgb).all()
    stream.close()


def test_what_the_child_prints_does_not_get_among_the_pixels() -> None:
    """As nvarguscamerasrc, which prints to standard output before the first picture and later."""
    chatty = PLAY.replace("os.write(", "os.write(1, b'x' * 83); os.write(")
    command = [sys.executable, "-c", chatty.format(count=3, pause=0.005), "{video}"]
    stream = GstStream(command, SIZE)
    for level in (1, 2, 3):
        assert (stream.grab() == (3 * level, 2 * level, level)).all()
    with pytest.raises(HardwareError, match=r"ended; it said: x{83}"):
        stream.grab()
    stream.close()


def test_the_shipped_command_writes_pictures_to_a_descriptor_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = tmp_path / "gst-launch-1.0"
    fake.write_text(
        f"#!{sys.executable}\n"
        "import os, sys\n"
        "os.write(1, b'GST_ARGUS: Creating output stream'.ljust(83))\n"
        "words = sys.argv[sys.argv.index('fdsink') + 1 :]\n"
        "fd = next(int(word[3:]) for word in words if word.startswith('fd='))\n"
        "assert fd > 2\n"
        "os.write(fd, bytes((1, 2, 3, 255)) * 48)\n"
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    stream = GstStream(csi_command(sensor=0, flip=0, fps=30, size_px=SIZE), SIZE)
    assert (stream.grab() == (3, 2, 1)).all()
    stream.close()


def test_opening_and_closing_leaves_no_descriptor_behind() -> None:
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        stream = GstStream(program("", count=1), SIZE)
        stream.grab()
        stream.close()
        with pytest.raises(HardwareError):
            GstStream(["no-such-gst", "{video}"], SIZE)
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_rate_that_the_sensor_mode_has_not_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"at most 30 with a CSI camera, got 60; .*1640x1232"):
        CameraConfig("csi", fps=60)
    assert CameraConfig("csi", fps=30).fps == 30
    assert CameraConfig("v4l2", fps=60).fps == 60


def test_a_child_that_ends_says_why() -> None:
    stream = GstStream(program("sys.exit('ERROR: no cameras available')", count=1), SIZE)
    stream.grab()
    with pytest.raises(HardwareError, match=r"ended; it said: ERROR: no cameras available"):
        stream.grab()
    stream.close()


def test_half_a_picture_is_no_picture() -> None:
    stream = GstStream([sys.executable, "-c", HALF, "{video}"], SIZE)
    with pytest.raises(HardwareError, match="ended; it said nothing"):
        stream.grab()
    stream.close()


def test_a_child_that_hangs_is_noticed_and_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "SILENCE_S", 0.1)
    stubborn = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)"
    stream = GstStream(program(stubborn, count=1), SIZE)
    stream.grab()
    time.sleep(0.2)  # let it set its signal handler
    began_s = time.monotonic()
    with pytest.raises(HardwareError, match=r"no picture for 0\.1 s"):
        stream.grab()
    stream.close()
    assert time.monotonic() - began_s < 3.0
    with pytest.raises(ProcessLookupError):
        os.kill(stream._child.pid, 0)


def test_the_first_picture_is_waited_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "SILENCE_S", 0.001)
    stream = GstStream(program("", count=1), SIZE)
    assert stream.grab().shape == (6, 8, 3)
    stream.close()


def test_a_child_is_asked_to_end_before_it_is_killed_and_hears_no_ctrl_c() -> None:
    """A camera that is not let go in order may stay taken."""
    stream = GstStream(program("time.sleep(60)", count=1), SIZE)
    stream.grab()
    assert os.getsid(stream._child.pid) != os.getsid(0)
    stream.close()
    assert stream._child.returncode == -signal.SIGTERM


def test_a_program_that_is_not_there_is_named() -> None:
    with pytest.raises(HardwareError, match="no-such-gst: expected a program that starts"):
        GstStream(["no-such-gst"], SIZE)


@pytest.mark.usefixtures("quickly")
def test_the_camera_comes_back_when_the_child_is_killed() -> None:
    streams: List[GstStream] = []

    def open_stream() -> GstStream:
        streams.append(GstStream(program("", count=10_000), SIZE))
        return streams[-1]

    with NewestFrame(open_stream, time.monotonic) as camera:
        eventually(lambda: camera.read() is not None)
        streams[0]._child.kill()
        eventually(lambda: len(streams) == 2 and camera.problem == "")
        assert len(streams) == 2
    assert streams[1]._child.returncode is not None


def test_the_csi_command_scales_in_hardware_and_queues_one_picture() -> None:
    command = csi_command(sensor=1, flip=2, fps=21, size_px=(320, 240))
    assert command[:2] == ["gst-launch-1.0", "-q"]
    assert command.index("nvvidconv") < command.index(
        "video/x-raw,format=BGRx,width=320,height=240"
    )
    mode = "video/x-raw(memory:NVMM),width=1640,height=1232,format=NV12,framerate=21/1"
    needed = {"sensor-id=1", "sensor-mode=3", mode, "flip-method=2", "sync=false"}
    assert needed | {"leaky=downstream", "max-size-buffers=1"} <= set(command)


def test_each_kind_of_camera_is_opened_as_configured(monkeypatch: pytest.MonkeyPatch) -> None:
    for kind in ("GstStream", "V4l2Stream", "SocketStream"):
        monkeypatch.setattr(source, kind, lambda *told, kind=kind: (kind, *told))
    size = (320, 240)
    csi, v4l2 = CameraConfig("csi", 1, 2, 21), CameraConfig("v4l2", 3, fps=60)
    assert open_stream(csi, size) == ("GstStream", csi_command(1, 2, 21, size), size)
    assert open_stream(v4l2, size) == ("V4l2Stream", 3, size, 60)
    virtual = CameraConfig("socket", path="/run/camera")
    assert open_stream(virtual, size) == ("SocketStream", "/run/camera", (160, 120))


@pytest.mark.skipif(shutil.which("gst-launch-1.0") is None, reason="no gst-launch-1.0")
def test_the_real_gst_launch_plays(tmp_path: Path) -> None:
    stream = GstStream(gst_command(["videotestsrc", "pattern=red"], (160, 120)), (160, 120))
    assert (np.abs(stream.grab().astype(int) - (255, 0, 0)) < 8).all()
    stream.close()


def test_a_program_that_ends_waits_for_the_child_before_its_first_picture() -> None:
    """Else `gst-launch-1.0` lives on, in a session of its own, and holds the camera."""
    assert JOIN_S > FIRST_PICTURE_S >= 8.0
    assert NewestFrame(lambda: GstStream(["none"], SIZE), time.monotonic)._patience_s == JOIN_S
