"""Results are written whole or not at all, and refused before the work where they cannot be."""

import os
from pathlib import Path

import pytest

from robot.errors import ConfigError
from robot.output import atomically, expect_folder, expect_writable, write_bytes, write_json


def test_a_place_that_takes_no_file_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept", encoding="utf-8")
    for path in (tmp_path, tmp_path / "file" / "x.json", Path("/proc/none/x.json")):
        with pytest.raises(ConfigError, match="expected a"):
            expect_writable(path)
    with pytest.raises(ConfigError, match="expected a place to write to"):
        expect_folder(tmp_path / "file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text(encoding="utf-8") == "kept"


def test_a_place_that_takes_files_is_left_as_it_is(tmp_path: Path) -> None:
    expect_writable(tmp_path / "new" / "folder" / "x.json", None)
    expect_folder(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_a_result_replaces_neither_what_is_read_nor_another_result(tmp_path: Path) -> None:
    model = tmp_path / "model.onnx"
    model.write_bytes(b"a policy")
    link = tmp_path / "link.json"
    link.symlink_to(model)
    for path in (model, link):
        with pytest.raises(ConfigError, match="what is read"):
            expect_writable(path, inputs=[model])
    with pytest.raises(ConfigError, match="another output"):
        expect_writable(tmp_path / "x", tmp_path / "." / "x")


def test_a_writing_that_fails_leaves_the_old_file_and_nothing_beside(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    write_json(path, {"a": 1})

    def fail() -> None:
        with atomically(path) as temporary:
            temporary.write_text("half", encoding="utf-8")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert path.read_text(encoding="utf-8") == '{\n "a": 1\n}\n'
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link_and_a_pipe_a_pipe(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "target", tmp_path / "link", tmp_path / "pipe"
    target.write_bytes(b"old")
    link.symlink_to(target)
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    os.mkfifo(pipe)
    expect_writable(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_bytes(pipe, b"figures")
    assert os.read(reader, 100) == b"figures"
    os.close(reader)
    assert pipe.is_fifo()


def test_who_may_read_a_file_still_may_when_it_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"old")
    path.chmod(0o644)
    before = os.umask(0o077)
    try:
        write_bytes(path, b"new")
        write_bytes(tmp_path / "own", b"new")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o644
    assert (tmp_path / "own").stat().st_mode & 0o777 == 0o600


def test_a_file_stays_its_owners_where_that_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot.yaml").write_bytes(b"old")
    told = []
    monkeypatch.setattr(os, "chown", lambda _, *owner: told.append(owner))
    write_bytes(tmp_path / "robot.yaml", b"new")
    assert told == [(os.getuid(), os.getgid())]

    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chmod", refuse)  # as FAT does
    write_bytes(tmp_path / "robot.yaml", b"newer")
    assert (tmp_path / "robot.yaml").read_bytes() == b"newer"
