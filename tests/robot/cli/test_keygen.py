from __future__ import annotations

from pathlib import Path

import pytest

from robot.cli import main
from robot.link.keys import load_keys

pytest.importorskip("zmq")

MACHINES = ("robot", "localizer", "monitor")


def test_one_command_makes_the_keys_of_every_machine_and_never_overwrites_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keygen", str(tmp_path / "keys")]) == 0
    keys = {name: load_keys(tmp_path / "keys" / name) for name in MACHINES}
    assert all(set(own.peers) == set(MACHINES) - {name} for name, own in keys.items())
    told = capsys.readouterr().out
    assert not any(own.secret.decode() in told for own in keys.values())
    assert main(["keygen", str(tmp_path / "keys")]) == 2
    assert "never overwritten" in capsys.readouterr().err
    assert load_keys(tmp_path / "keys" / "robot") == keys["robot"]


def test_a_place_that_cannot_be_written_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["keygen", str(tmp_path / "file" / "keys")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
