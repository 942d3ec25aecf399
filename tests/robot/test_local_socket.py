"""Sockets to virtual hardware: pieces, ends, and nobody there."""

from __future__ import annotations

import os
from pathlib import Path
from typing import List

import pytest

from robot.computer.local_socket import connect_local, receive_exactly
from robot.errors import HardwareError


class Pieces:
    """Gives what it has piece by piece, then has hung up, which it says once."""

    def __init__(self, *pieces: bytes) -> None:
        self._pieces: List[bytes] = [*pieces, b""]

    def recv_into(self, buffer: memoryview) -> int:
        assert self._pieces, "asked again after the end"
        piece = self._pieces.pop(0)
        buffer[: len(piece)] = piece
        return len(piece)


def test_what_comes_in_pieces_is_put_together_and_an_end_before_its_time_is_an_error() -> None:
    assert receive_exactly(Pieces(b"a", b"bcd", b"e"), 5) == b"abcde"  # type: ignore[arg-type]
    for there in ((), (b"ab", b"c")):
        with pytest.raises(OSError, match="hung up"):
            receive_exactly(Pieces(*there), 5)  # type: ignore[arg-type]


def test_where_nobody_listens_no_descriptor_stays(tmp_path: Path) -> None:
    before = os.listdir("/proc/self/fd")
    with pytest.raises(HardwareError, match="expected a virtual camera, got: No such file") as told:
        connect_local(str(tmp_path / "none"), "a virtual camera", 1.0)
    assert len(os.listdir("/proc/self/fd")) <= len(before), told  # garbage of others may go
