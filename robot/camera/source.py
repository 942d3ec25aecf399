"""A camera is somebody who has the newest frame, whatever stream of pictures it comes from.

Streams are of USB cameras by OpenCV, CSI ones by GStreamer, and virtual ones behind a socket.
"""

import logging
import os
import select
import struct
import subprocess
import tempfile
from contextlib import ExitStack, closing
from typing import Any, Callable, List, NamedTuple, Optional, Protocol, Sequence, Tuple

import numpy as np

from robot.computer.local_socket import connect_local, receive_exactly
from robot.computer.threads import Worker
from robot.config import CameraConfig
from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.errors import ContractError, HardwareError


class Frame(NamedTuple):
    """A picture, its number, and when it was taken."""

    image: np.ndarray  # (H, W, 3) uint8 RGB; a robot's is (120, 160, 3)
    sequence: int  # grows by one or more; the same number is the same frame
    time_s: float  # by a monotonic clock


class Camera(Protocol):
    """Gives the newest frame, at once."""

    def read(self) -> Optional[Frame]:
        """The newest frame, perhaps again; None before the first. HardwareError: it has failed."""


def fit_to_frame(picture: np.ndarray) -> np.ndarray:
    """Any picture (H, W, 3) uint8 RGB as a frame (120, 160, 3): its middle 4:3, resized by area.

    ContractError: it is no RGB picture.
    """
    import cv2

    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        got = f"{picture.shape} {picture.dtype}"
        raise ContractError(f"picture: expected (H, W, 3) uint8 RGB, got {got}")
    height, width = picture.shape[:2]
    wide = min(width, max(1, round(height * FRAME_WIDTH_PX / FRAME_HEIGHT_PX)))
    high = min(height, max(1, round(width * FRAME_HEIGHT_PX / FRAME_WIDTH_PX)))
    top, left = (height - high) // 2, (width - wide) // 2
    middle = picture[top : top + high, left : left + wide]
    return cv2.resize(middle, (FRAME_WIDTH_PX, FRAME_HEIGHT_PX), interpolation=cv2.INTER_AREA)


CAPTURE_PX = (320, 240)  # twice a frame: the last halving is by area, on the processor
FIRST_WAIT_S = 0.5  # before opening again; doubles up to
LONGEST_WAIT_S = 8.0
ODD_WAIT_S = 0.01  # a stream of odd pictures must not keep a processor busy
JOIN_S = 12.0  # longer than any camera may take to its first picture

logger = logging.getLogger(__name__)


class Stream(Protocol):
    """An open camera."""

    def grab(self) -> np.ndarray:
        """The next picture (H, W, 3) uint8 RGB, waiting for it a second or so at most.

        HardwareError: none came. ContractError: an odd one came, and the next may well be good.
        """

    def close(self) -> None:
        """Let the device go, also after an error."""


class NewestFrame(Worker):
    """A ``Camera`` in a ``with`` block, over a stream that may end at any time.

    An odd picture counts as none. A stream that ends is opened again with a growing wait, also when
    the computer has no descriptor left for it; meanwhile ``read`` gives the last frame, whose age
    stops the robot. ``open_stream`` raises HardwareError; ``clock`` is monotonic [s].
    """

    def __init__(self, open_stream: Callable[[], Stream], clock: Callable[[], float]) -> None:
        super().__init__("camera", JOIN_S)
        self.problem = "the camera has not started"  # "" while pictures come
        self._open_stream = open_stream
        self._clock = clock
        self._frame: Optional[Frame] = None

    def read(self) -> Optional[Frame]:
        """The newest frame; None before the first. HardwareError: the thread itself has died."""
        self.check()
        return self._frame

    def _work(self) -> None:
        wait_s = FIRST_WAIT_S
        while not self._ending.is_set():
            before = self._frame
            try:
                self._play()
            except (RuntimeError, OSError, ValueError, MemoryError) as error:
                self._complain(error)
            if self._frame is not before:
                wait_s = FIRST_WAIT_S
            self._ending.wait(wait_s)
            wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)

    def _play(self) -> None:
        with closing(self._open_stream()) as stream:
            while not self._ending.is_set():
                try:
                    image = _frame_of(stream.grab())
                except ContractError as error:
                    self._complain(error)
                    self._ending.wait(ODD_WAIT_S)
                    continue
                sequence = self._frame.sequence + 1 if self._frame else 0
                # One assignment: the other thread sees the old frame or the new one.
                self._frame = Frame(image, sequence, self._clock())
                self.problem = ""

    def _complain(self, error: Exception) -> None:
        told = str(error) or type(error).__name__
        if told != self.problem:
            logger.warning("camera: %s", told)
        self.problem = told


def _frame_of(picture: np.ndarray) -> np.ndarray:
    """The picture as a frame; ContractError of whatever cannot be one."""
    try:
        return fit_to_frame(picture)
    except Exception as error:  # from NumPy, from OpenCV, or the lack of a shape at all
        raise ContractError(f"odd picture: {error or type(error).__name__}") from error


class V4l2Stream:
    """``/dev/video<device>``; OpenCV waits ten seconds at most. HardwareError: it does not open."""

    def __init__(self, device: int, size_px: Tuple[int, int], fps: int) -> None:
        import cv2

        self._name = f"/dev/video{device}"
        self._odd = cv2.error
        self._capture: Any = cv2.VideoCapture(device, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            told = f"{self._name}: expected a camera that opens; check its plug, that no other "
            raise HardwareError(f"{told}program uses it, and that this user is in the group video")
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
        self._capture.set(cv2.CAP_PROP_FPS, fps)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def grab(self) -> np.ndarray:
        """As `robot.camera.source.Stream` says."""
        try:
            good, picture = self._capture.read()
        except self._odd as error:
            raise ContractError(f"{self._name}: expected a picture, got: {error}") from error
        if not good or picture is None:
            raise HardwareError(f"{self._name}: expected a picture, got none; was it unplugged?")
        if picture.ndim != 3:
            raise ContractError(f"{self._name}: expected colours, got {picture.shape}")
        return np.ascontiguousarray(picture[..., ::-1])

    def close(self) -> None:
        """Let the device go."""
        self._capture.release()


NEXT = b"n"
HEADER = struct.Struct("!4sHH")  # magic, width, height
MAGIC = b"RGB8"
SILENCE_S = 2.0  # without a byte: the other side hangs


class SocketStream:
    """The virtual camera that listens at ``path``; keeps `robot.camera.source.Stream`.

    The reader asks for the next picture with one byte; the camera answers at its own next moment
    with a header and the pixels, RGB row by row. HardwareError: nobody listens there.
    """

    def __init__(self, path: str, size_px: Tuple[int, int]) -> None:
        self._path, self._size_px = path, size_px
        self._socket = connect_local(path, "a virtual camera", SILENCE_S)

    def grab(self) -> np.ndarray:
        """As `robot.camera.source.Stream` says."""
        try:
            self._socket.sendall(NEXT)
            return self._take()
        except OSError as error:
            what = error.strerror or f"no picture for {SILENCE_S:g} s"
            raise HardwareError(f"camera {self._path}: expected a picture, got: {what}") from error

    def _take(self) -> np.ndarray:
        magic, width, height = HEADER.unpack(receive_exactly(self._socket, HEADER.size))
        wanted = "{} x {} px".format(*self._size_px)
        told = f"camera {self._path}: expected {wanted}, got {magic!r} {width} x {height}"
        if magic != MAGIC:
            raise HardwareError(told)
        data = receive_exactly(self._socket, 3 * width * height)
        if (width, height) != self._size_px:
            raise ContractError(told)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


FIRST_PICTURE_S = 8.0  # nvargus takes seconds to set up a sensor
END_S = 1.0  # that the child gets to end by itself
BYTES_PER_PIXEL = 4  # BGRx, the only 8-bit RGB order that nvvidconv writes
LAST_WORDS_BYTES = 400
VIDEO_FD = "{video}"  # in a command: the descriptor that the pictures are written to


def csi_command(sensor: int, flip: int, fps: int, size_px: Tuple[int, int]) -> List[str]:
    """For an IMX219 at a Jetson's CSI port: mode 3, scaled in hardware; ``flip`` is nvvidconv's."""
    source = (
        f"nvarguscamerasrc sensor-id={sensor} sensor-mode=3 ! "
        f"video/x-raw(memory:NVMM),width=1640,height=1232,format=NV12,framerate={fps}/1 ! "
        f"nvvidconv flip-method={flip}"
    )
    return gst_command(source.split(), size_px)


def gst_command(source: Sequence[str], size_px: Tuple[int, int]) -> List[str]:
    """``gst-launch-1.0`` from a source to ``GstStream``; one picture waits at most."""
    caps = f"video/x-raw,format=BGRx,width={size_px[0]},height={size_px[1]}"
    queue = ["queue", "leaky=downstream", "max-size-buffers=1"]
    sink = ["fdsink", f"fd={VIDEO_FD}", "sync=false"]
    return ["gst-launch-1.0", "-q", *source, "!", caps, "!", *queue, "!", *sink]


class GstStream:
    """Pictures from a child process that writes raw BGRx to ``VIDEO_FD``: ``gst-launch-1.0``.

    OpenCV's wheels know no GStreamer, and a Jetson's CSI cameras give colour pictures through
    nothing else. The pipe is not the child's standard output, where nvarguscamerasrc prints what it
    does: one such line among the pixels would shift all pictures after it. Without a byte for
    `SILENCE_S` it hangs. HardwareError: the command cannot be started.
    """

    def __init__(self, command: Sequence[str], size_px: Tuple[int, int]) -> None:
        self._program = command[0]
        self._width_px, self._height_px = size_px
        self._wait_s = FIRST_PICTURE_S
        with ExitStack() as stack:
            self._last_words = stack.enter_context(tempfile.TemporaryFile())
            self._pipe, video = os.pipe()
            stack.callback(os.close, self._pipe)
            try:
                self._child = subprocess.Popen(
                    [word.replace(VIDEO_FD, str(video)) for word in command],
                    stdin=subprocess.DEVNULL,
                    stdout=self._last_words,
                    stderr=self._last_words,
                    pass_fds=(video,),
                    start_new_session=True,  # an interrupt from the keyboard is the robot's
                )
            except OSError as error:
                told = f"{self._program}: expected a program that starts, got: {error.strerror}; "
                raise HardwareError(f"{told}install gstreamer1.0-tools") from error
            finally:
                os.close(video)  # the child's alone: its end must be seen
            self._given_up = stack.pop_all()

    def grab(self) -> np.ndarray:
        """As `robot.camera.source.Stream` says."""
        size = self._width_px * self._height_px * BYTES_PER_PIXEL
        data = bytearray()
        poll = select.poll()  # not select, which knows no descriptor above 1023
        poll.register(self._pipe, select.POLLIN)
        while len(data) < size:
            if not poll.poll(1e3 * self._wait_s):
                raise HardwareError(f"camera: no picture for {self._wait_s:g} s; {self._said()}")
            part = os.read(self._pipe, size - len(data))
            if not part:
                raise HardwareError(f"camera: {self._program} ended; {self._said()}")
            data += part
        self._wait_s = SILENCE_S
        shape = (self._height_px, self._width_px, BYTES_PER_PIXEL)
        return np.ascontiguousarray(np.frombuffer(data, np.uint8).reshape(shape)[..., 2::-1])

    def close(self) -> None:
        """End the child, by force if it must be."""
        self._child.terminate()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._given_up.close()

    def _said(self) -> str:
        self._last_words.seek(max(0, self._last_words.seek(0, os.SEEK_END) - LAST_WORDS_BYTES))
        text = self._last_words.read().decode("utf-8", "replace").strip()
        return f"it said: {text}" if text else "it said nothing"


def open_stream(config: CameraConfig, size_px: Tuple[int, int]) -> Stream:
    """The configured camera's pictures, one after the other; HardwareError: it does not open."""
    if config.kind == "v4l2":
        return V4l2Stream(config.number, size_px, config.fps)
    if config.kind == "socket":
        return SocketStream(config.path, (FRAME_WIDTH_PX, FRAME_HEIGHT_PX))
    return GstStream(csi_command(config.number, config.flip, config.fps, size_px), size_px)
