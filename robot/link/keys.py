"""Key pairs and allow-lists for the encrypted links (CURVE: Curve25519, as in CurveCP).

``keygen`` makes one folder per machine, complete in itself: copy ``robot/`` to the robot,
``localizer/`` to the localizer, ``monitor/`` to the monitor, and delete the rest.

    DIR/robot/secret.key            0600, never leaves the robot
    DIR/robot/public.key
    DIR/robot/allowed/monitor.key   public keys of those that the robot speaks to
"""

from __future__ import annotations

import os
import string
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, Sequence, Tuple, Union

from robot.errors import ConfigError, nearest

MACHINES = ("robot", "localizer", "monitor")
SECRET, PUBLIC, ALLOWED = "secret.key", "public.key", "allowed"
# The alphabet of ZeroMQ RFC 32 (Z85): 32 bytes are 40 of these.
_Z85 = frozenset(string.digits + string.ascii_letters + ".-:+=^!/*?&<>()[]{}@%$#")


@dataclass(frozen=True)
class Keys:
    """One machine's key pair and the public keys of its peers, by name; all Z85 text."""

    public: bytes
    secret: bytes = field(repr=False)
    peers: Dict[str, bytes] = field(default_factory=dict)

    def peer(self, name: str) -> bytes:
        """The public key of the machine ``name``.

        Raises:
            ConfigError: its key is not in the allow-list.
        """
        if name not in self.peers:
            raise ConfigError(f"no public key for {name!r}; {nearest(name, self.peers)}")
        return self.peers[name]


def keygen(directory: Union[str, Path], machines: Sequence[str] = MACHINES) -> Dict[str, Path]:
    """Make a key folder per machine under ``directory``, each allowing all the others.

    Returns:
        The folder of each machine.

    Raises:
        ConfigError: a folder is there already (keys are never overwritten), or cannot be made.
    """
    import zmq

    folders = {name: Path(directory) / name for name in machines}
    for folder in folders.values():
        if folder.exists():
            raise ConfigError(
                f"{folder}: expected no such folder, got one: keys are never overwritten; "
                "choose another directory, or delete it to replace the keys of all machines"
            )
    pairs = {name: zmq.curve_keypair() for name in machines}
    try:
        for name, folder in folders.items():
            _write_folder(folder, name, pairs)
    except OSError as error:
        raise ConfigError(
            f"{directory}: expected a place to write keys to, got: {error.strerror}"
        ) from error
    return folders


def _write_folder(folder: Path, name: str, pairs: Dict[str, Tuple[bytes, bytes]]) -> None:
    (folder / ALLOWED).mkdir(parents=True)
    folder.chmod(0o700)
    public, secret = pairs[name]
    _write(folder / SECRET, secret, 0o600)
    _write(folder / PUBLIC, public, 0o644)
    for peer, (theirs, _) in pairs.items():
        if peer != name:
            _write(folder / ALLOWED / f"{peer}.key", theirs, 0o644)


def load_keys(folder: Union[str, Path]) -> Keys:
    """The keys of this machine from the folder that ``keygen`` made for it.

    Raises:
        ConfigError: a file is absent, no key, or the secret can be read by others.
    """
    folder = Path(folder)
    secret = _read(folder / SECRET)
    mode = (folder / SECRET).stat().st_mode & 0o777
    if mode & 0o077:
        raise ConfigError(
            f"{folder / SECRET}: expected mode 600, got {mode:o}: others can read the secret; "
            f"run chmod 600 {folder / SECRET}"
        )
    peers = {path.stem: _read(path) for path in sorted((folder / ALLOWED).glob("*.key"))}
    return Keys(_read(folder / PUBLIC), secret, peers)


def _write(path: Path, key: bytes, mode: int) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(key + b"\n")


def _read(path: Path) -> bytes:
    try:
        text = path.read_text(encoding="ascii", errors="replace").strip()
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a key, got: {error.strerror}; make keys with: robot keygen DIR"
        ) from error
    if len(text) != 40 or not _Z85.issuperset(text):
        raise ConfigError(f"{path}: expected 40 characters of Z85, got {len(text)} characters")
    return text.encode("ascii")
