from __future__ import annotations

import socket
import threading
from pathlib import Path
from typing import Iterator, List

import pytest

from robot.camera import source
from robot.camera.source import SocketStream
from robot.errors import ContractError, HardwareError


@pytest.fixture
def server(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "camera"))
        listening.listen()
        yield listening


def opened(server: socket.socket) -> SocketStream:
    return SocketStream(server.getsockname(), (2, 1))


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (b"RGB9\0\2\0\1abcdef", HardwareError),
        (b"RGB8\0\1\0\2abcdef", ContractError),
        (b"RGB8\0\2\0\1abcdef", None),
    ],
)
def test_a_picture_of_another_kind_ends_the_stream_and_one_of_another_size_is_odd(
    server: socket.socket, answer: bytes, error: type
) -> None:
    stream = opened(server)
    peer, _ = server.accept()
    with peer:
        peer.sendall(answer)
        if error is None:
            assert stream.grab().tolist() == [[[97, 98, 99], [100, 101, 102]]]
        else:
            with pytest.raises(error, match="expected 2 x 1 px, got "):
                stream.grab()
        assert peer.recv(9) == b"n"
    stream.close()


def test_after_a_picture_of_another_size_the_next_one_is_taken_whole(server: socket.socket) -> None:
    stream = opened(server)
    peer, _ = server.accept()
    with peer:
        peer.sendall(b"RGB8\0\1\0\2uvwxyzRGB8\0\2\0\1abcdef")
        with pytest.raises(ContractError):
            stream.grab()
        assert stream.grab().tobytes() == b"abcdef"
    stream.close()


def test_a_camera_that_says_nothing_is_waited_for_two_seconds(
    server: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert source.SILENCE_S == 2.0
    monkeypatch.setattr(source, "SILENCE_S", 0.05)
    stream = opened(server)
    told: List[str] = []

    def grab() -> None:
        try:
            stream.grab()
        except HardwareError as error:
            told.append(str(error))

    grabbing = threading.Thread(target=grab, daemon=True)
    grabbing.start()
    grabbing.join(5.0)
    assert [each.partition(": ")[2] for each in told] == [
        "expected a picture, got: no picture for 0.05 s"
    ]
    stream.close()
