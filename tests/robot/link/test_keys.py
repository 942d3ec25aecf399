"""Keys: made once, kept from others, never overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.errors import ConfigError
from robot.link.keys import MACHINES, keygen, load_keys

pytest.importorskip("zmq")


def test_each_machine_has_its_secret_and_the_public_keys_of_the_others(tmp_path: Path) -> None:
    folders = keygen(tmp_path)
    keys = {name: load_keys(folder) for name, folder in folders.items()}
    assert set(keys) == set(MACHINES)
    for name, own in keys.items():
        assert own.peers == {other: k.public for other, k in keys.items() if other != name}
        assert own.secret.decode() not in repr(own)
    assert len({k.secret for k in keys.values()} | {k.public for k in keys.values()}) == 6


def test_the_secret_is_readable_by_its_owner_only(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    secret = folder / "secret.key"
    assert secret.stat().st_mode & 0o777 == 0o600
    secret.chmod(0o640)
    with pytest.raises(ConfigError, match="chmod 600"):
        load_keys(folder)


def test_keys_are_never_overwritten(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    before = (folder / "secret.key").read_bytes()
    with pytest.raises(ConfigError, match="never overwritten"):
        keygen(tmp_path)
    assert (folder / "secret.key").read_bytes() == before


def test_a_folder_without_keys_says_how_to_make_them(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="robot keygen"):
        load_keys(tmp_path)


def test_a_spoilt_key_and_an_unknown_peer_are_refused(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    with pytest.raises(ConfigError, match="did you mean 'monitor'"):
        load_keys(folder).peer("moniter")
    (folder / "public.key").write_text("not a key\n")
    with pytest.raises(ConfigError, match="40 characters"):
        load_keys(folder)
