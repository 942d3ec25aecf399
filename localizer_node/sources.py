"""Pictures for the localizer: a USB or CSI camera, a video file, or a folder of pictures."""

import re
import time
from contextlib import closing
from itertools import count
from typing import Iterator

from robot.camera.files import play
from robot.camera.source import Frame, GstStream, SocketStream, Stream, V4l2Stream, csi_command
from robot.errors import ContractError, HardwareError
from robot.lens import Lens


def open_source(source: str, lens: Lens, fps: int = 30) -> Iterator[Frame]:
    """Frames of a source until it ends; those of a file or folder are taken 1 / ``fps`` apart.

    A source is a number N for /dev/videoN; ``csi`` or ``csi:N`` for a Jetson's CSI port;
    ``socket:PATH`` for a virtual camera; or the path of a video or of a folder of pictures. A
    camera is set to the lens' size. ConfigError: there is nothing to play. HardwareError: the
    camera cannot be opened, or (on iteration) went silent.
    """
    size_px = (lens.width_px, lens.height_px)
    if re.fullmatch("[0-9]{1,3}", source):
        return _live(V4l2Stream(int(source), size_px, fps))
    if source.startswith("socket:"):
        return _live(SocketStream(source[len("socket:") :], size_px))
    csi = re.fullmatch(r"csi(?::(\d))?", source)
    if csi:
        return _live(GstStream(csi_command(int(csi.group(1) or 0), 0, fps, size_px), size_px))
    return (Frame(picture, i, i / fps) for i, picture in enumerate(play(source)))


def _live(stream: Stream) -> Iterator[Frame]:
    with closing(stream):
        for number in count():
            try:
                picture = stream.grab()
            except ContractError as error:  # it was opened for pictures of this size and kind
                raise HardwareError(str(error)) from error
            yield Frame(picture, number, time.monotonic())
