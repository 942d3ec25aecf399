"""Key pairs, allow-lists and roles for the encrypted links (CURVE: Curve25519, as in CurveCP).

``keygen`` makes one folder per machine: its pair of keys and, under ``allowed``, the public keys of
those whom it speaks to. Each file is one line: the role of the key's owner, a space, the key. What
a key may do follows from the role that the allow-list of its reader gives it, not from what its
owner says of itself. ``AllowList`` asks for it (ZAP, ZeroMQ RFC 27): every bound socket has a ZAP
domain of its own, the name of its stream, so that it is known what somebody wants.
"""

import logging
import os
import string
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Callable, Dict, List, Sequence, Tuple, Union

from robot.errors import ConfigError, nearest
from robot.link.messages import Reading
from robot.link.wire import tidy_text
from robot.output import expect_folder

if TYPE_CHECKING:
    import zmq

ROLES = ("robot", "localizer", "monitor")
# The streams in the order of their ports, and who may connect to each: a monitor to all.
BOUND_BY = {"pose": "localizer", "telemetry": "robot", "frame": "robot", "command": "robot"}
_TWO = "robot", "monitor"
ADMITS = {"pose": _TWO, "telemetry": _TWO, "frame": ("monitor",), "command": ("monitor",)}

SECRET, PUBLIC, ALLOWED = "secret.key", "public.key", "allowed"
READ_LIMIT = 1000  # characters: a key has 40
# The alphabet of ZeroMQ RFC 32 (Z85): 32 bytes are 40 of these.
_Z85 = frozenset(string.digits + string.ascii_letters + ".-:+=^!/*?&<>()[]{}@%$#")
ENDPOINT = "inproc://zeromq.zap.01"
MAX_ADMISSIONS = 16  # in one call, so that a flood cannot hold up the control loop
TELL_EVERY_S = 10.0  # of one who knocks at one socket again and again
STRANGER = "a stranger"
SHOWN_BYTES = 24  # of a name in a report
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Peer:
    """Somebody of the allow-list: what it is, and its public key (Z85)."""

    role: str
    public: bytes


@dataclass(frozen=True)
class Keys:
    """One machine's key pair (Z85), what the machine is, and its peers by name."""

    role: str
    public: bytes
    secret: bytes = field(repr=False)
    peers: Dict[str, Peer] = field(default_factory=dict)

    def peer(self, role: str) -> bytes:
        """The public key of the machine that is the ``role``; ConfigError unless one is allowed."""
        found = sorted(name for name, peer in self.peers.items() if peer.role == role)
        if len(found) != 1:
            got = ", ".join(found) or "none"
            roles = [peer.role for peer in self.peers.values()]
            raise ConfigError(f"keys: expected one {role}, got {got}; {nearest(role, roles)}")
        return self.peers[found[0]].public


def keygen(directory: Union[str, Path], machines: Sequence[str] = ROLES) -> Dict[str, Path]:
    """Make a folder for each machine that allows all the others; ConfigError: one is there."""
    import zmq

    folders = {name: Path(directory) / name for name in machines}
    for folder in folders.values():
        if folder.exists():
            raise ConfigError(f"{folder} is there: keys are never overwritten; delete it before")
    expect_folder(Path(directory))
    pairs = {name: zmq.curve_keypair() for name in machines}
    for name, folder in folders.items():
        (folder / ALLOWED).mkdir(parents=True)
        folder.chmod(0o700)
        _write(folder / SECRET, name, pairs[name][1], 0o600)
        _write(folder / PUBLIC, name, pairs[name][0])
        for peer in set(machines) - {name}:
            _write(folder / ALLOWED / f"{peer}.key", peer, pairs[peer][0])
    return folders


def load_keys(folder: Union[str, Path]) -> Keys:
    """This machine's keys, as of ``keygen``; ConfigError: absent, none, or others can read them."""
    folder = Path(folder)
    role, secret = _read(folder / SECRET)
    mode = (folder / SECRET).stat().st_mode & 0o777
    if mode & 0o077:
        raise ConfigError(f"{folder / SECRET}: others can read it, mode {mode:o}; chmod 600 it")
    public_role, public = _read(folder / PUBLIC)
    if public_role != role:
        got = f"{role} and {public_role}"
        raise ConfigError(f"{folder}: expected a pair of keys of one role, got those of {got}")
    paths = sorted((folder / ALLOWED).glob("*.key"))
    return Keys(role, public, secret, {path.stem: Peer(*_read(path)) for path in paths})


def _write(path: Path, role: str, key: bytes, mode: int = 0o644) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(b"%s %s\n" % (role.encode("ascii"), key))


def _read(path: Path) -> Tuple[str, bytes]:
    """Role and key."""
    remedy = "make keys with: duckpilot keygen DIR"
    try:
        with path.open(encoding="ascii", errors="replace") as file:
            words = file.read(READ_LIMIT).split()
    except OSError as error:
        raise ConfigError(f"{path}: expected a key, got: {error.strerror}; {remedy}") from error
    known = len(words) == 2 and words[0] in ROLES
    if not (known and len(words[1]) == 40 and _Z85.issuperset(words[1])):
        raise ConfigError(
            f"{path}: expected a role ({', '.join(ROLES)}) and a key of 40 characters of Z85, got "
            f"{len(words)} words, {sum(map(len, words))} characters; {remedy}"
        )
    return words[0], words[1].encode("ascii")


class AllowList:
    """Answers those who knock at this program's bound sockets; never blocks."""

    def __init__(
        self,
        context: "zmq.Context[zmq.Socket[bytes]]",
        keys: Keys,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        import zmq
        from zmq.utils import z85

        self._clock, self._peers = clock, keys.peers
        self._names = {z85.decode(peer.public): name for name, peer in keys.peers.items()}
        self._names[z85.decode(keys.public)] = keys.role
        self._refused = 0
        self._told_s: Dict[Tuple[str, str], float] = {}
        self._newest = ""
        self.socket = context.socket(zmq.REP)
        self.socket.linger = 0
        self.socket.bind(ENDPOINT)

    def admit(self) -> None:
        """Answer those who wait."""
        import zmq

        with suppress(zmq.Again):
            for _ in range(MAX_ADMISSIONS):
                self.socket.send_multipart(self._verdict(self.socket.recv_multipart(zmq.NOBLOCK)))

    def may(self, name: str, stream: str) -> bool:
        """Whether the peer of this name in the allow-list may use a stream."""
        peer = self._peers.get(name)
        return peer is not None and peer.role in ADMITS[stream]

    def reading(self) -> Reading:
        """For the monitor: how many were turned away, and who was the last."""
        name = f"turned away: {self._newest}" if self._newest else "turned away"
        level = "warn" if self._refused else "ok"
        return Reading(tidy_text(name, SHOWN_BYTES), self._refused, "", level)

    def _verdict(self, request: List[bytes]) -> List[bytes]:
        """Version, request id, domain, address, identity, mechanism, key -> the ZAP reply."""
        request_id = request[1] if len(request) > 1 else b""
        name, stream = STRANGER, ""
        if len(request) == 7 and request[5] == b"CURVE":
            name = self._names.get(request[6], STRANGER)
            stream = request[2].decode("ascii", "replace")
            if stream in ADMITS and self.may(name, stream):
                return [b"1.0", request_id, b"200", b"OK", name.encode(), b""]
        self._turn_away(name, stream, request[3] if len(request) > 3 else b"")
        return [b"1.0", request_id, b"400", b"not in the allow-list", b"", b""]

    def _turn_away(self, name: str, stream: str, address: bytes) -> None:
        self._refused += 1
        self._newest = name
        now_s = self._clock()
        if now_s - self._told_s.get((name, stream), -TELL_EVERY_S) < TELL_EVERY_S:
            return
        self._told_s[name, stream] = now_s
        who = name if name == STRANGER else f"the key of {name}"
        whom = " or ".join(ADMITS.get(stream, ("nobody",)))
        where = tidy_text(address.decode("ascii", "replace"), SHOWN_BYTES)
        logger.warning(
            "%s at %s was turned away from %r: expected a key of %s",
            *(who, where, tidy_text(stream, SHOWN_BYTES), whom),
        )
