"""What an installation changes, in order; doing it and undoing it, with a manifest."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Callable, List, NamedTuple, Sequence

from robot.errors import ConfigError
from robot.install import files
from robot.install.changes import (
    Change,
    Commands,
    Host,
    WrittenFile,
    at,
    enabled,
    folder,
    group,
    membership,
    user,
)
from robot.install.files import UDEV, config_text, unit_text
from robot.output import write_json

Say = Callable[[str], None]
_MARK = f"{files.VENV}/.duckpilot-version"


class Source(NamedTuple):
    """What is installed: a checkout of this repository, and the Python that it runs on."""

    checkout: Path
    python: str
    model: Path

    @property
    def version(self) -> str:
        """Changes with every file that is installed."""
        digest = hashlib.sha256(self.python.encode("utf-8"))
        packages = (self.checkout / name for name in ("robot", "localizer_node"))
        found = [file for package in packages for file in package.rglob("*") if file.is_file()]
        for file in sorted(f for f in found if "__pycache__" not in f.parts):
            digest.update(str(file.relative_to(self.checkout)).encode("utf-8"))
            digest.update(file.read_bytes())
        return digest.hexdigest()


def make_plan(source: Source) -> List[Change]:
    """All changes, in the order in which they are made.

    Raises:
        ConfigError: the package does not lie in a checkout, or the model is absent.
    """
    pins = source.checkout / "constraints-nano.txt"
    if not (source.checkout / "pyproject.toml").is_file():
        raise ConfigError(
            f"{source.checkout}: expected a checkout of the repository, with pyproject.toml; run "
            "`python -m robot install` in one"
        )
    try:
        model = source.model.read_bytes()
    except OSError as error:
        raise ConfigError(f"{source.model}: expected an ONNX policy, got: {error}") from error
    reload_units = ("systemctl", "daemon-reload")
    reload_rules = ("udevadm", "control", "--reload")
    trigger = ("udevadm", "trigger", "--subsystem-match=i2c-dev")
    return [
        *(group(name) for name in files.GROUPS),
        user(files.USER, files.STATE),
        *(membership(files.USER, name) for name in files.GROUPS),
        folder(files.PREFIX),
        folder(files.ETC, files.USER),  # calibration replaces the configuration
        folder(files.KEYS, files.USER, 0o700),
        folder(files.STATE, files.USER),
        *_environment(source, str(pins)),
        WrittenFile(files.MODEL, model),
        WrittenFile(files.CONFIG, config_text(files.MODEL).encode("utf-8"), theirs=True),
        WrittenFile(files.UDEV_RULE, UDEV.encode("utf-8"), (reload_rules, trigger)),
        WrittenFile(
            files.UNIT_FILE, unit_text(" ".join(files.GROUPS)).encode("utf-8"), (reload_units,)
        ),
        enabled(files.UNIT),
    ]


def _environment(source: Source, pins: str) -> List[Change]:
    version = source.version

    def is_needed(host: Host) -> bool:
        mark = at(host, _MARK)
        return not mark.is_file() or mark.read_text(encoding="utf-8") != version

    pip = (f"{files.VENV}/bin/python", "-I", "-m", "pip", "install", "--upgrade")
    make = (
        (source.python, "-m", "venv", files.VENV),
        (*pip, "pip"),  # Ubuntu 18.04's is too old to know the wheels of onnxruntime
        (*pip, "--constraint", pins, str(source.checkout)),
    )
    environment = Commands(files.VENV, is_needed, make, (("rm", "-rf", files.VENV),))
    return [environment, WrittenFile(_MARK, version.encode("utf-8"))]


def install(plan: Sequence[Change], host: Host, say: Say, dry: bool) -> int:
    """Make every change that is needed, telling each; returns how many there were.

    Raises:
        HardwareError: a command failed; what was done until then is in the manifest.
    """
    done = _done(host)
    count = 0
    for change in plan:
        if not change.needed(host):
            continue
        count += 1
        for line in change.tell():
            say(f"would {line}" if dry and not line.startswith(" ") else line)
        if not dry:
            change.do(host)
            done = list(dict.fromkeys((*done, change.name)))
            _keep(host, done)
    return count


def uninstall(plan: Sequence[Change], host: Host, say: Say, dry: bool) -> int:
    """Undo, last first, what the manifest says was done; returns how many changes that were."""
    done = _done(host)
    mine = [change for change in reversed(plan) if change.name in done]
    for change in mine:
        for line in change.tell_undo():
            say(f"would {line}" if dry else line)
        if not dry:
            change.undo(host)
            done.remove(change.name)
            _keep(host, done)
    return len(mine)


def _done(host: Host) -> List[str]:
    path = at(host, files.MANIFEST)
    if not path.is_file():
        return []
    try:
        return [str(name) for name in json.loads(path.read_text(encoding="utf-8"))["done"]]
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: expected the list of what was installed: {error}") from error


def _keep(host: Host, done: Sequence[str]) -> None:
    path = at(host, files.MANIFEST)
    if done:
        write_json(path, {"schema": 1, "done": list(done)})
    elif path.exists():
        path.unlink()
