"""A CSI camera through ``gst-launch-1.0``, whose pictures come over a pipe.

OpenCV's wheels know no GStreamer, and a Jetson's CSI cameras give colour pictures through nothing
else. The child process is the same with any source, so ``videotestsrc`` tests it anywhere.
"""

from __future__ import annotations

import os
import select
import subprocess
import tempfile
from typing import List, Sequence, Tuple

import numpy as np

from robot.errors import HardwareError

SILENCE_S = 2.0  # without a byte: the child hangs
FIRST_PICTURE_S = 8.0  # nvargus takes seconds to set up a sensor
END_S = 1.0  # that the child gets to end by itself
BYTES_PER_PIXEL = 4  # BGRx, the only 8-bit RGB order that nvvidconv writes
LAST_WORDS_BYTES = 400


def csi_command(sensor: int, flip: int, fps: int, size_px: Tuple[int, int]) -> List[str]:
    """The command for an IMX219 on a Jetson: sensor mode 3 (1640x1232), scaled by its hardware.

    Args:
        sensor: which CSI port.
        flip: nvvidconv's ``flip-method``; 2 turns the picture upside down.
        fps: pictures a second, up to 30.
        size_px: width and height of what comes out.
    """
    source = (
        f"nvarguscamerasrc sensor-id={sensor} sensor-mode=3 ! "
        f"video/x-raw(memory:NVMM),width=1640,height=1232,format=NV12,framerate={fps}/1 ! "
        f"nvvidconv flip-method={flip}"
    )
    return gst_command(source.split(), size_px)


def gst_command(source: Sequence[str], size_px: Tuple[int, int]) -> List[str]:
    """``gst-launch-1.0`` from a source to standard output; one picture waits at most."""
    caps = f"video/x-raw,format=BGRx,width={size_px[0]},height={size_px[1]}"
    queue = ["queue", "leaky=downstream", "max-size-buffers=1"]
    sink = ["fdsink", "fd=1", "sync=false"]
    return ["gst-launch-1.0", "-q", *source, "!", caps, "!", *queue, "!", *sink]


class GstStream:
    """Pictures from a child process that writes raw BGRx to its standard output.

    Raises:
        HardwareError: the command cannot be started.
    """

    def __init__(
        self, command: Sequence[str], size_px: Tuple[int, int], silence_s: float = SILENCE_S
    ) -> None:
        self._program = command[0]
        self._width_px, self._height_px = size_px
        self._silence_s = silence_s
        self._wait_s = max(FIRST_PICTURE_S, silence_s)
        self._last_words = tempfile.TemporaryFile()  # noqa: SIM115  open until close()
        try:
            self._child = subprocess.Popen(
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=self._last_words,
                bufsize=0,
                start_new_session=True,  # an interrupt from the keyboard is the robot's to handle
            )
        except OSError as error:
            self._last_words.close()
            raise HardwareError(
                f"{self._program}: expected a program that starts, got: {error.strerror}; "
                "install gstreamer1.0-tools"
            ) from error
        assert self._child.stdout is not None
        self._pipe = self._child.stdout.fileno()

    def grab(self) -> np.ndarray:
        """The next picture (H, W, 3) uint8 RGB.

        Raises:
            HardwareError: the child ended, or has been silent for ``silence_s``.
        """
        size = self._width_px * self._height_px * BYTES_PER_PIXEL
        data = bytearray()
        while len(data) < size:
            if not select.select([self._pipe], [], [], self._wait_s)[0]:
                raise HardwareError(f"camera: no picture for {self._wait_s:g} s; {self._said()}")
            part = os.read(self._pipe, size - len(data))
            if not part:
                raise HardwareError(f"camera: {self._program} ended; {self._said()}")
            data += part
        self._wait_s = self._silence_s
        shape = (self._height_px, self._width_px, BYTES_PER_PIXEL)
        pixels = np.frombuffer(data, np.uint8).reshape(shape)
        return np.ascontiguousarray(pixels[..., 2::-1])

    def close(self) -> None:
        """End the child, by force if it must be."""
        self._child.terminate()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._last_words.close()

    def _said(self) -> str:
        length = self._last_words.seek(0, os.SEEK_END)
        self._last_words.seek(max(0, length - LAST_WORDS_BYTES))
        text = self._last_words.read().decode("utf-8", "replace").strip()
        return f"it said: {text}" if text else "it said nothing"
