"""Keys: made once, kept from others, never overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.errors import ConfigError
from robot.link.keys import Peer, keygen, load_keys

pytest.importorskip("zmq")


def test_each_machine_has_its_secret_and_the_public_keys_of_the_others(tmp_path: Path) -> None:
    folders = keygen(tmp_path)
    keys = {name: load_keys(folder) for name, folder in folders.items()}
    assert set(keys) == {"robot", "localizer", "monitor"}
    for name, own in keys.items():
        assert own.role == name
        assert own.peers == {n: Peer(n, k.public) for n, k in keys.items() if n != name}
        assert own.secret.decode() not in repr(own)
    assert len({k.secret for k in keys.values()} | {k.public for k in keys.values()}) == 6


def test_the_secret_is_readable_by_its_owner_only(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    secret = folder / "secret.key"
    assert secret.stat().st_mode & 0o777 == 0o600
    secret.chmod(0o640)
    with pytest.raises(ConfigError, match="chmod 600"):
        load_keys(folder)


def test_nobody_else_looks_into_the_folder_of_the_keys(tmp_path: Path) -> None:
    for folder in keygen(tmp_path).values():
        assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o604, 0o602, 0o601, 0o640, 0o620, 0o610, 0o666])
def test_a_secret_that_anybody_else_may_touch_is_no_secret(tmp_path: Path, mode: int) -> None:
    folder = keygen(tmp_path)["robot"]
    (folder / "secret.key").chmod(mode)
    with pytest.raises(ConfigError, match=f"mode {mode:o}; chmod 600 it"):
        load_keys(folder)


def test_keys_are_never_overwritten(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    before = (folder / "secret.key").read_bytes()
    with pytest.raises(ConfigError, match="never overwritten"):
        keygen(tmp_path)
    assert (folder / "secret.key").read_bytes() == before


def test_a_key_that_was_put_aside_is_allowed_no_longer(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    key = folder / "allowed" / "monitor.key"
    key.rename(key.with_name("monitor.key.lost"))
    assert set(load_keys(folder).peers) == {"localizer"}


def test_a_folder_without_keys_says_how_to_make_them(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="duckpilot keygen"):
        load_keys(tmp_path)


def test_a_spoilt_key_and_an_unknown_peer_are_refused(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    with pytest.raises(ConfigError, match="did you mean 'monitor'"):
        load_keys(folder).peer("moniter")
    (folder / "public.key").write_text("not a key\n")
    with pytest.raises(ConfigError, match="40 characters"):
        load_keys(folder)


def test_each_file_says_the_role_and_the_key_on_one_line(tmp_path: Path) -> None:
    folders = keygen(tmp_path)
    for name in ("robot", "localizer", "monitor"):
        others = {"robot", "localizer", "monitor"} - {name}
        files = {"secret.key": name, "public.key": name}
        files.update({f"allowed/{other}.key": other for other in others})
        for file, role in files.items():
            line = (folders[name] / file).read_text()
            assert line.count("\n") == 1
            assert line.split()[0] == role
            assert len(line.split()[1]) == 40


@pytest.mark.parametrize("file", ["secret.key", "public.key", "allowed/monitor.key"])
def test_a_key_without_a_role_is_refused(tmp_path: Path, file: str) -> None:
    folder = keygen(tmp_path)["robot"]
    path = folder / file
    path.write_text(path.read_text().split()[1] + "\n")
    with pytest.raises(ConfigError, match="expected a role") as caught:
        load_keys(folder)
    assert "\n" not in str(caught.value)


def test_a_pair_of_two_roles_and_two_of_one_role_are_refused(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["monitor"]
    public = folder / "public.key"
    public.write_text(public.read_text().replace("monitor", "robot"))
    with pytest.raises(ConfigError, match="expected a pair of keys of one role"):
        load_keys(folder)
    public.write_text(public.read_text().replace("robot", "monitor"))
    second = folder / "allowed" / "second.key"
    second.write_text((folder / "allowed" / "robot.key").read_text())
    with pytest.raises(ConfigError, match=r"expected one robot, got robot, second"):
        load_keys(folder).peer("robot")


@pytest.mark.parametrize(
    "text",
    [
        *("", "pilot " + "x" * 40, "robot " + "x" * 39, "robot a b", "\0"),
        *("robot " + "~" * 40, "robot " + "ä" * 20),
    ],
)
def test_what_is_no_key_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    folder = keygen(tmp_path)["robot"]
    (folder / "public.key").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="40 characters of Z85") as caught:
        load_keys(folder)
    assert "\n" not in str(caught.value)


def test_a_key_as_large_as_a_disk_is_not_read(tmp_path: Path) -> None:
    folder = keygen(tmp_path)["robot"]
    (folder / "public.key").write_bytes(b"robot " + b"x" * 10_000_000)
    with pytest.raises(ConfigError, match="40 characters of Z85, got 2 words, 999 characters"):
        load_keys(folder)
